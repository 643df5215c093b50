"""Hamiltonian along a plan with costates: a numerical test of a necessary optimality condition."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from .definition import Definition
from .plan import ControlPlan
from .sampling import Course, courses, endpoint

__all__ = ["HamiltonianReport", "hamiltonian_gains", "hamiltonian_spread"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HamiltonianReport:
    """Hamiltonian H = λ·f + w·g along one phase of a plan.

    λ are the costates, the derivatives of the optimal objective with respect to the state. f are
    the rates, g the integrands, and w the derivatives of the objective with respect to their
    integrals. On an optimal plan the control minimises H. H is constant if the phase does not depend
    on time explicitly. It is 0 at a free end time on which neither the objective nor a boundary
    constraint depends.

    Parameters
    ----------
    phase : str
        Name of the phase.
    autonomous : bool
        Whether rates, integrands and path constraints are independent of time, so that H is
        constant.
    mean : float
        Mean of H over time.
    spread : float
        Largest distance of H from its median.
    relative : float
        `spread` relative to the largest sum of the magnitudes of the terms of H.
    time : float
        Time at which `spread` is attained.
    end : float
        H at the end of the phase.
    vanishing : bool
        Whether H must be 0 at the end.
    """

    phase: str
    autonomous: bool
    mean: float
    spread: float
    relative: float
    time: float
    end: float
    vanishing: bool


def hamiltonian_spread(problem: Any, plan: ControlPlan) -> tuple[HamiltonianReport, ...]:
    """Return how constant the Hamiltonian is along each phase of a plan with costates.

    The condition is necessary for optimality, not for feasibility, and the costates of a
    transcription are inaccurate near jumps of the control. The result is therefore a report and not
    a check.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        Problem.
    plan : ControlPlan
        Plan; a phase without costates has no report.

    Returns
    -------
    tuple of HamiltonianReport
        One report per phase with costates.

    Raises
    ------
    InvalidData
        The plan does not fit the problem.
    """
    definition: Definition = getattr(problem, "definition", problem)
    with np.errstate(all="ignore"):
        return tuple(_reports(definition, courses(definition, plan)))


def hamiltonian_gains(problem: Any, plan: ControlPlan) -> tuple[Floats | None, ...]:
    """Return the potential decrease of the objective per interval, estimated from the Hamiltonian.

    To first order, the objective exceeds its optimum by the integral over time of the difference
    between the Hamiltonian and its minimum over the controls. If the phase does not depend on time
    explicitly, the Hamiltonian of the optimum is constant. The integral of its distance from its
    median then estimates the excess, which is distributed over the intervals in proportion to its
    changes.

    The result has one array per phase, shape (intervals,), in the unit of the objective. It is None for
    a phase that depends on time explicitly or has no costates.
    """
    definition: Definition = getattr(problem, "definition", problem)
    with np.errstate(all="ignore"):
        phases = courses(definition, plan)
        return tuple(
            None if terms is None or not _autonomous(course) else _gains(course, terms.sum(axis=1))
            for course, terms in zip(phases, _terms(definition, phases), strict=True)
        )


def _gains(course: Course, level: Floats) -> Floats:
    grid = course.dense
    distance = np.abs(level - np.median(level))
    steps = np.abs(np.diff(level))
    # A jump at a knot is split equally between its two intervals.
    left, right = grid.interval[:-1], grid.interval[1:]
    changes = np.bincount(left, 0.5 * steps, course.plan.states.intervals)
    changes += np.bincount(right, 0.5 * steps, course.plan.states.intervals)
    total = changes.sum()
    excess = float((0.5 * (distance[1:] + distance[:-1]) * np.diff(grid.times)).sum())
    gains: Floats = changes * (excess / total if total > 0.0 else 0.0)
    return gains


def _terms(definition: Definition, phases: tuple[Course, ...]) -> Iterator[Floats | None]:
    """Yield the terms of the Hamiltonian on each phase's dense grid; None without costates."""
    known = any(part.plan.costates is not None for part in phases)
    weights = _weights(definition, phases) if known else np.zeros(0)
    end = 0
    for course in phases:
        phase, costates = course.phase, course.plan.costates
        end += phase.end_size
        if costates is None:
            yield None
            continue
        values = course.dense_values
        multipliers = costates.at(course.dense.interval, course.dense.tau)
        last = end - len(phase.instants) * len(phase.state_names)
        running = weights[last - phase.integrals : last] * values["integrand"]
        yield np.concatenate([multipliers * values["rate"], running], axis=1)


def _autonomous(course: Course) -> bool:
    """Return whether rates, integrands and path constraints are independent of time.

    Costs at interior instants depend on time: the costates jump there.
    """
    function = course.phase.function
    return not course.phase.instants and not any(
        function.jac_sparsity(k, 0).nnz()
        for k, name in enumerate(function.name_out())
        if name != "invariant"
    )


def _reports(definition: Definition, phases: tuple[Course, ...]) -> Iterator[HamiltonianReport]:
    begin = 0
    for course, terms in zip(phases, _terms(definition, phases), strict=True):
        phase, grid, first = course.phase, course.dense, begin
        begin += phase.end_size
        if terms is None:
            continue
        level = terms.sum(axis=1)
        distance = np.abs(level - np.median(level))
        row = int(distance.argmax())
        size = float(np.abs(terms).sum(axis=1).max())
        # Trapezoidal rule on the grid; the two points at a knot enclose no width.
        width = np.diff(grid.times)
        mean = float((0.5 * (level[1:] + level[:-1]) * width).sum() / width.sum())
        free = phase.end_lower < course.plan.end < phase.end_upper
        yield HamiltonianReport(
            phase=phase.name,
            autonomous=_autonomous(course),
            mean=mean,
            spread=float(distance[row]),
            relative=float(distance[row]) / size if size > 0 else 0.0,
            time=float(grid.times[row]),
            end=float(level[-1]),
            vanishing=bool(free and not _speaks_of(definition, first + 1)),
        )


def _weights(definition: Definition, phases: tuple[Course, ...]) -> Floats:
    """Return the derivatives of the objective with respect to the endpoint vector at the plan."""
    function = definition.endpoint
    e, p = (casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in())
    slope = casadi.Function("slope", [e, p], [casadi.gradient(function(e, p)[0], e)])
    result: Floats = slope(endpoint(phases), phases[0].parameters).full().ravel()
    return result


def _speaks_of(definition: Definition, entry: int) -> bool:
    """Return whether the objective or a boundary constraint depends on one entry of the endpoint vector."""
    function = definition.endpoint
    return any(entry in function.jac_sparsity(k, 0).get_col() for k in range(function.n_out()))
