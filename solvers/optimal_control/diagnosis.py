"""Diagnosis of infeasible optimal control problems: the smallest relaxation of limits that gives a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...models.model import Model
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Answer, Request, Termination
from ..contract.registry import find_backend
from ..run.diagnosis import Diagnosis, Finding
from .elastic import Elastic, elastic

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
    written = general.formulate(
        "radau", intervals=INTERVALS, degree=DEGREE, refine=False, dependent="drop"
    )
    program = written.program
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
    if alone:
        summary = "no motion near the search satisfies all limits; relaxing one of these is enough:"
        findings = tuple(
            widening.finding for widening in sorted(alone, key=lambda widening: widening.share)
        )
    else:
        summary = "no motion near the search satisfies all limits, and relaxing one is not enough:"
        findings = tuple(
            widening.finding for widening in sorted(needed, key=lambda widening: -widening.share)
        )
    return Diagnosis(model.name, False, method, summary, findings)


@dataclass(frozen=True)
class _Relaxation:
    """Relaxation of a limit: as a share of its typical size, and as a finding."""

    share: float
    finding: Finding


def _relax(
    whole: Request, program: NonlinearProgram, rows: list[Block], columns: list[Block], most: int
) -> tuple[Answer, list[_Relaxation]]:
    """Return the answer of the search for the smallest relaxation, and the relaxed limits."""
    relaxed = elastic(program, rows, columns)
    answer = whole.within(find_backend("ipopt"), relaxed.program, options={"max_iter": most})
    if answer.point is None:
        return answer, []
    slack = np.asarray(answer.point)[program.size :]
    return answer, _relaxations(relaxed, program, len(rows), slack)


def _violated_implications(model: OptimalControlProblem, point: Vector) -> tuple[Finding, ...]:
    """Return the conditions that the program omitted as implied, and that the motion violates."""
    program = model.formulate(
        "radau", intervals=INTERVALS, degree=DEGREE, refine=False, dependent="keep"
    ).program
    result = []
    for check in program.verify(point, tolerance=MISSED).violated:
        unit = f" {check.unit}" if check.unit else ""
        result.append(
            Finding(
                f"{check.name} at {check.where or 'its place'} is violated by {check.worst:.4g}{unit}, "
                "and no free quantity changes it",
                check.equation,
                check.name,
                {"block": check.name, "by": check.worst, "unit": check.unit},
            )
        )
    return tuple(result)


def _relaxable_blocks(
    model: OptimalControlProblem, program: NonlinearProgram
) -> tuple[list[Block], list[Block]]:
    """Return the blocks of rows and of columns whose limits may be relaxed.

    Final values are columns inside of a state's block; each becomes a block of its own.
    """
    fixed = ("dynamics of ", "definition of integral ", "time goes forward", "calm controls")
    rows = [block for block in program.rows if not block.name.startswith(fixed)]
    columns: list[Block] = []
    states = {name for phase in model.definition.phases for name in phase.state_names}
    several = len(model.definition.phases) > 1
    names = {
        f"{name} of {phase.name}" if several else name
        for phase in model.definition.phases
        for name in phase.state_names
    } | states
    low, high = program.column_lower, program.column_upper
    for block in program.columns:
        bounded = np.isfinite(low[block.slice]) | np.isfinite(high[block.slice])
        if block.name in names:
            inner = Block(block.name, "", block.start + 1, block.size - 2, unit=block.unit)
            last = Block(
                f"final value of {block.name}", "", block.start + block.size - 1, 1, unit=block.unit
            )
            if inner.size > 0 and bounded[1:-1].any():
                columns.append(inner)
            if bounded[-1]:
                columns.append(last)
        elif bounded.any() and not block.name.startswith(("integral ", "start time")):
            columns.append(block)
    # Times and final values first: they matter most, and the search may run out of time.
    first = ("end time", "final value")
    return rows, sorted(columns, key=lambda block: not block.name.startswith(first))


def _relaxations(
    relaxed: Elastic, program: NonlinearProgram, rows: int, slack: Vector
) -> list[_Relaxation]:
    """Return the limits with a positive slack."""
    result = []
    for number in np.flatnonzero(slack > KEPT):
        block, amount = relaxed.groups[number], float(slack[number] * relaxed.scales[number])
        unit = f" {block.unit}" if block.unit else ""
        on_rows = number < rows
        low = (program.row_lower if on_rows else program.column_lower)[block.slice]
        high = (program.row_upper if on_rows else program.column_upper)[block.slice]
        finding = Finding(
            f"{block.title}: {_limits(low, high)}{unit} would have to give by {amount:.4g}{unit}",
            block.equation,
            block.name,
            {"block": block.name, "by": amount, "unit": block.unit},
        )
        result.append(_Relaxation(float(slack[number]), finding))
    return result


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
