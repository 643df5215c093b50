"""Why an optimal control problem has no plan: the least widening of its limits that gives one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...models.model import Model
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram
from ..backend import Answer, Request, Termination
from ..diagnosis import Diagnosis, Finding
from ..registry import find_backend
from .elastic import Elastic, elastic

__all__ = ["diagnose_control"]

Vector = NDArray[np.float64]

#: Iterations of the first search at most, and of each that tries one limit alone.
MOST, ALONE = 1000, 450
#: Slack, in terms of a limit's typical size, below which it counts as kept.
KEPT = 1e-5
#: Relative violation above which an implied condition counts as missed, on so coarse a mesh.
MISSED = 1e-3
#: Intervals and nodes of the mesh that is tried: coarse, for a first answer.
INTERVALS, DEGREE = 12, 5


def diagnose_control(model: Model[ControlPlan], time_limit: float | None) -> Diagnosis:
    """Return the limits that must give for the motion to exist, and by how much.

    Dynamics and initial values are kept; limits of states, controls, paths, final values, boundary
    conditions and times may give. First all of them may: what they give, each in terms of its typical
    size, is least in sum. Where that is something, each is tried alone. The searches are local, on a
    mesh of one size.
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
    rows, columns = _giving(general, program)
    method = f"least widening of limits, {INTERVALS} Radau intervals of {DEGREE} nodes, with ipopt"
    whole = Request(time_limit=time_limit)
    answer, needed = _widen(whole, program, rows, columns, MOST)
    ended = answer.termination
    if ended is not Termination.LOCALLY_OPTIMAL:
        return Diagnosis(model.name, None, method, f"not settled: ipopt ended with {ended}")
    if not needed:
        assert answer.point is not None
        implied = _implied(general, np.asarray(answer.point)[: program.size])
        if implied:
            summary = (
                "no plan: what follows from the other conditions contradicts what is asked for"
            )
            return Diagnosis(model.name, False, method, summary, implied)
        return Diagnosis(
            model.name, True, method, "a motion that keeps all limits exists: nothing to explain"
        )
    # What all of them together gave is near what one of them alone gives.
    assert answer.point is not None
    program = replace(program, guess=np.asarray(answer.point)[: program.size])
    alone: list[_Widening] = []
    for number, block in enumerate([*rows, *columns]):
        if whole.left() == 0.0:
            break
        own = ([block], []) if number < len(rows) else ([], [block])
        answer, found = _widen(whole, program, *own, ALONE)
        if answer.termination is Termination.LOCALLY_OPTIMAL:
            alone += found
    if alone:
        summary = "no motion near the search keeps all limits; giving way in one of these would do:"
        findings = tuple(one.finding for one in sorted(alone, key=lambda one: one.share))
    else:
        summary = (
            "no motion near the search keeps all limits, and no one of them alone is at fault:"
        )
        findings = tuple(one.finding for one in sorted(needed, key=lambda one: -one.share))
    return Diagnosis(model.name, False, method, summary, findings)


@dataclass(frozen=True)
class _Widening:
    """By how much a limit gives: as a share of its typical size, and in words."""

    share: float
    finding: Finding


def _widen(
    whole: Request, program: NonlinearProgram, rows: list[Block], columns: list[Block], most: int
) -> tuple[Answer, list[_Widening]]:
    """Return how the search for the least widening ended, and the limits that give in it."""
    made = elastic(program, rows, columns)
    answer = whole.within(find_backend("ipopt"), made.program, options={"max_iter": most})
    if answer.point is None:
        return answer, []
    slack = np.asarray(answer.point)[program.size :]
    return answer, _gives(made, program, len(rows), slack)


def _implied(model: OptimalControlProblem, point: Vector) -> tuple[Finding, ...]:
    """Return the conditions that the program left out as implied, and that the motion does not meet."""
    whole = model.formulate(
        "radau", intervals=INTERVALS, degree=DEGREE, refine=False, dependent="keep"
    ).program
    found = []
    for check in whole.verify(point, tolerance=MISSED).violated:
        unit = f" {check.unit}" if check.unit else ""
        found.append(
            Finding(
                f"{check.name} at {check.where or 'its place'} is off by {check.worst:.4g}{unit}, and "
                "nothing that is free moves it",
                check.equation,
                check.name,
                {"block": check.name, "by": check.worst, "unit": check.unit},
            )
        )
    return tuple(found)


def _giving(
    model: OptimalControlProblem, program: NonlinearProgram
) -> tuple[list[Block], list[Block]]:
    """Return the blocks of rows and of columns whose limits may give.

    Final values are columns in the middle of a state's block: each becomes a block of its own.
    """
    kept = ("dynamics of ", "definition of integral ", "time goes forward", "calm controls")
    rows = [block for block in program.rows if not block.name.startswith(kept)]
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
    # Times and ends first: they are what people ask about, and the time for the search may end.
    first = ("end time", "final value")
    return rows, sorted(columns, key=lambda block: not block.name.startswith(first))


def _gives(made: Elastic, program: NonlinearProgram, rows: int, slack: Vector) -> list[_Widening]:
    """Return the limits whose slack is more than nothing."""
    found = []
    for number in np.flatnonzero(slack > KEPT):
        block, by = made.groups[number], float(slack[number] * made.scales[number])
        unit = f" {block.unit}" if block.unit else ""
        on_rows = number < rows
        low = (program.row_lower if on_rows else program.column_lower)[block.slice]
        high = (program.row_upper if on_rows else program.column_upper)[block.slice]
        finding = Finding(
            f"{block.title}: {_limits(low, high)}{unit} would have to give by {by:.4g}{unit}",
            block.equation,
            block.name,
            {"block": block.name, "by": by, "unit": block.unit},
        )
        found.append(_Widening(float(slack[number]), finding))
    return found


def _limits(low: Vector, high: Vector) -> str:
    """Return the bounds of a block in words."""
    least, most = float(low.min()), float(high.max())
    if least == most:
        return f"the value {least:g}"
    if not np.isfinite(least):
        return f"the limit {most:g}"
    if not np.isfinite(most):
        return f"the limit {least:g}"
    return f"the limits {least:g} to {most:g}"
