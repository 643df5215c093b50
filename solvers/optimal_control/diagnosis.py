"""Diagnosis of infeasible optimal control problems: the smallest relaxation of limits that gives a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.model import Model
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram
from ...models.programs.triplets import dm
from ...models.verification import Check
from ..contract.backend import Answer, Request, Termination
from ..contract.registry import find_backend
from ..run.diagnosis import Diagnosis, Finding

__all__ = ["diagnose_control"]

Vector = NDArray[np.float64]

#: Largest number of iterations of the first search, and of each search with one relaxed limit.
MOST, ALONE = 1000, 450
#: Slack, relative to a limit's typical size, below which the limit is satisfied.
KEPT = 1e-5
#: Relative violation above which an implied condition is violated on the coarse mesh.
MISSED = 1e-3
#: Number of intervals and nodes of the coarse mesh.
INTERVALS, DEGREE = 12, 5
#: Weight of the distance from the guess relative to the relaxation; it makes the optimum unique.
NEAR = 1e-6


def diagnose_control(model: Model[ControlPlan], time_limit: float | None) -> Diagnosis:
    """Return the limits that must be relaxed for a motion to exist, and by how much.

    Dynamics and initial values are kept. Limits of states, controls, paths, final values, boundary
    conditions and times may be relaxed. The first search relaxes all of them and minimises the sum of
    the relaxations relative to their typical sizes. If the sum is positive, each limit is relaxed
    alone. The searches are local, on one fixed mesh.

    Parameters
    ----------
    model : Model
        An optimal control problem, or a model that lowers to one.
    time_limit : float, optional
        Seconds for all searches.

    Returns
    -------
    Diagnosis
        Feasible with a motion, infeasible with findings, or undecided.
    """
    general: Model[ControlPlan] | None = model
    while general is not None and not isinstance(general, OptimalControlProblem):
        general = general.lower()
    assert isinstance(general, OptimalControlProblem)
    program = _program(general, "drop")
    assert isinstance(program, NonlinearProgram)
    rows, columns = _relaxable_blocks(general, program)
    method = f"least widening of limits, {INTERVALS} Radau intervals of {DEGREE} nodes, with ipopt"
    request = Request(time_limit=time_limit)
    answer, needed = _relax(request, program, rows, columns, MOST)
    termination = answer.termination
    if termination is not Termination.LOCALLY_OPTIMAL:
        return Diagnosis(model.name, None, method, f"not settled: ipopt ended with {termination}")
    if not needed:
        assert answer.point is not None
        implied = _violated_implications(general, np.asarray(answer.point)[: program.size])
        if implied:
            summary = "no plan: a required value contradicts the value that other conditions imply"
            return Diagnosis(model.name, False, method, summary, implied)
        return Diagnosis(model.name, True, method, "a motion that satisfies all limits exists")
    # The relaxation of all limits together is a good start for the relaxation of one.
    assert answer.point is not None
    program = replace(program, guess=np.asarray(answer.point)[: program.size])
    alone: list[_Relaxation] = []
    for number, block in enumerate([*rows, *columns]):
        if request.left() == 0.0:
            break
        blocks = ([block], []) if number < len(rows) else ([], [block])
        answer, widenings = _relax(request, program, *blocks, ALONE)
        if answer.termination is Termination.LOCALLY_OPTIMAL:
            alone += widenings
    summary = "no motion near the search satisfies all limits"
    if alone:
        summary += "; relaxing one of these is enough:"
        alone.sort(key=lambda widening: widening.share)
    else:
        summary += ", and relaxing one is not enough:"
        alone = sorted(needed, key=lambda widening: -widening.share)
    findings = tuple(widening.finding for widening in alone)
    return Diagnosis(model.name, False, method, summary, findings)


def _program(model: OptimalControlProblem, dependent: str) -> Any:
    """Return the program on the coarse mesh."""
    options = {"intervals": INTERVALS, "degree": DEGREE, "refine": False}
    return model.formulate("radau", dependent=dependent, **options).program


@dataclass(frozen=True)
class _Relaxation:
    """Relaxation of a limit: as a share of its typical size, and as a finding."""

    share: float
    finding: Finding


def _relax(
    whole: Request, program: NonlinearProgram, rows: list[Block], columns: list[Block], most: int
) -> tuple[Answer, list[_Relaxation]]:
    """Return the answer of the search for the smallest relaxation, and the relaxed limits."""
    elastic, scales = _elastic(program, rows, columns)
    answer = whole.within(find_backend("ipopt"), elastic, options={"max_iter": most})
    if answer.point is None:
        return answer, []
    slack, groups = np.asarray(answer.point)[program.size :], [*rows, *columns]
    result = []
    for number in np.flatnonzero(slack > KEPT):
        block, amount = groups[number], float(slack[number] * scales[number])
        unit = f" {block.unit}" if block.unit else ""
        on_rows = number < len(rows)
        low = (program.row_lower if on_rows else program.column_lower)[block.slice]
        high = (program.row_upper if on_rows else program.column_upper)[block.slice]
        text = f"{block.title}: {_limits(low, high)}{unit} would have to give by {amount:.4g}{unit}"
        result.append(_Relaxation(float(slack[number]), _finding(text, block, amount)))
    return answer, result


def _violated_implications(model: OptimalControlProblem, point: Vector) -> tuple[Finding, ...]:
    """Return the conditions that the program omitted as implied, and that the motion violates."""
    result = []
    for check in _program(model, "keep").verify(point, tolerance=MISSED).violated:
        unit = f" {check.unit}" if check.unit else ""
        text = (
            f"{check.name} at {check.where or 'its place'} is violated by {check.worst:.4g}{unit}, "
            "and no free quantity changes it"
        )
        result.append(_finding(text, check, check.worst))
    return tuple(result)


def _finding(text: str, item: Block | Check, amount: float) -> Finding:
    data = {"block": item.name, "by": amount, "unit": item.unit}
    return Finding(text, item.equation, item.name, data)


def _relaxable_blocks(
    model: OptimalControlProblem, program: NonlinearProgram
) -> tuple[list[Block], list[Block]]:
    """Return the blocks of rows and of columns whose limits may be relaxed.

    Final values are columns inside of a state's block; each becomes a block of its own.
    """
    fixed = ("dynamics of ", "definition of ", "time goes forward", "calm controls")
    rows = [block for block in program.rows if not block.name.startswith(fixed)]
    columns: list[Block] = []
    names = {
        name + suffix
        for phase in model.definition.phases
        for name in phase.state_names
        for suffix in ("", f" of {phase.name}")
    }
    low, high = program.column_lower, program.column_upper
    for block in program.columns:
        bounded = np.isfinite(low[block.slice]) | np.isfinite(high[block.slice])
        if block.name in names:
            inner = Block(block.name, "", block.start + 1, block.size - 2, unit=block.unit)
            name, end = f"final value of {block.name}", block.start + block.size - 1
            last = Block(name, "", end, 1, unit=block.unit)
            if inner.size > 0 and bounded[1:-1].any():
                columns.append(inner)
            if bounded[-1]:
                columns.append(last)
        elif bounded.any() and not block.name.startswith(("integral ", "start time")):
            columns.append(block)
    # Times and final values first: they matter most, and the search may run out of time.
    first = ("end time", "final value")
    return rows, sorted(columns, key=lambda block: not block.name.startswith(first))


def _limits(low: Vector, high: Vector) -> str:
    """Return the bounds of a block for messages."""
    smallest, largest = float(low.min()), float(high.max())
    if smallest == largest:
        return f"the value {smallest:g}"
    if not np.isfinite(smallest):
        return f"the limit {largest:g}"
    if not np.isfinite(largest):
        return f"the limit {smallest:g}"
    return f"the limits {smallest:g} to {largest:g}"


def _elastic(
    program: NonlinearProgram, rows: list[Block], columns: list[Block]
) -> tuple[NonlinearProgram, Vector]:
    """Return `program` with the bounds of `rows` and `columns` relaxed by one slack per block.

    The slacks are the last columns, in units of the typical sizes of their blocks, which are the second
    result. All other rows and bounds are unchanged. The objective is the sum of the slacks. As a sum, it
    relaxes few blocks if few suffice.
    """
    import casadi

    n, rest, groups = program.size, program.row_count, [*rows, *columns]
    # Bounded quantities of the original program: rows first, then columns.
    low = np.concatenate([program.row_lower, program.column_lower])
    high = np.concatenate([program.row_upper, program.column_upper])
    sizes = np.concatenate([program.row_scale, program.column_scale])
    relaxed = [np.arange(rest + n)[block.slice] for block in rows]
    relaxed += [rest + np.arange(n)[block.slice] for block in columns]
    scales = np.array([sizes[indices].max() for indices in relaxed])
    # The kept rows, then each finite bound of a relaxed block, plus or minus its group's slack.
    unchanged = np.setdiff1d(np.arange(rest), np.concatenate([*relaxed, np.empty(0)]))
    places, widths = [unchanged], [np.zeros((unchanged.size, len(groups)))]
    lower, upper = [low[unchanged]], [high[unchanged]]
    for number, indices in enumerate(relaxed):
        for edge, sign in ((low, 1.0), (high, -1.0)):
            finite = indices[np.isfinite(edge[indices])]
            places.append(finite)
            width = np.zeros((finite.size, len(groups)))
            width[:, number] = sign * scales[number]
            widths.append(width)
            lower.append(edge[finite] if sign > 0 else np.full(finite.size, -np.inf))
            upper.append(edge[finite] if sign < 0 else np.full(finite.size, np.inf))
    place, width = np.concatenate(places), sp.csc_array(np.concatenate(widths))
    chosen = sp.csc_array(
        (np.ones(place.size), (np.arange(place.size), place)), (place.size, rest + n)
    )
    of_rows, of_columns, wide = (dm(part) for part in (chosen[:, :rest], chosen[:, rest:], width))
    x = casadi.MX.sym("x", n + len(groups))
    original, slack = x[:n], x[n:]
    duals, scale = casadi.MX.sym("lam_g", place.size), casadi.MX.sym("lam_f")
    constrained = of_rows @ program.function(original)[1] + of_columns @ original + wide @ slack
    first = casadi.horzcat(of_rows @ program.first_order(original)[1] + of_columns, wide)
    distance = (original - program.guess) / program.column_scale
    cost = casadi.sum1(slack) + 0.5 * NEAR * casadi.sumsqr(distance)
    gradient = casadi.vertcat(
        NEAR * distance / program.column_scale, casadi.MX(casadi.DM.ones(len(groups)))
    )
    curved = program.second_order(original, 0.0, casadi.densify(of_rows.T @ duals))
    curved = curved + scale * casadi.diag(casadi.DM(NEAR / program.column_scale**2))
    hessian = casadi.diagcat(curved, casadi.MX(len(groups), len(groups)))
    is_relaxed = np.isin(np.arange(n), np.concatenate([*relaxed, np.empty(0)]) - rest)
    # Initial slacks, which make the guess feasible.
    values = program.values(program.guess)[1]
    violation = np.nan_to_num(np.maximum(low[:rest] - values, values - high[:rest]), posinf=1.0)
    needed = np.array(
        [violation[indices].max(initial=0.0) for indices in relaxed[: len(rows)]]
        + [0.0] * len(columns)
    )
    needed = needed / scales + 0.1
    elastic_program = NonlinearProgram(
        name=f"{program.name}, with limits that give",
        function=casadi.Function(
            "elastic", [x], [cost, casadi.densify(constrained)], ["x"], ["f", "g"]
        ),
        row_lower=np.concatenate(lower),
        row_upper=np.concatenate(upper),
        column_lower=np.concatenate(
            [np.where(is_relaxed, -np.inf, low[rest:]), np.zeros(len(groups))]
        ),
        column_upper=np.append(
            np.where(is_relaxed, np.inf, high[rest:]), np.full(len(groups), np.inf)
        ),
        guess=np.concatenate([program.guess, needed]),
        column_scale=np.concatenate([program.column_scale, np.ones(len(groups))]),
        derivatives=casadi.Function("first", [x], [gradient, first], ["x"], ["grad_f", "jac_g"]),
        hessian=casadi.Function(
            "second", [x, scale, duals], [casadi.triu(hessian)], ["x", "lam_f", "lam_g"], ["hess"]
        ),
    )
    return elastic_program, scales
