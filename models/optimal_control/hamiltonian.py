"""The Hamiltonian along a plan with costates: a necessary condition of optimality, measured."""

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
    """The Hamiltonian H = λ·f + w·g along one phase of a plan.

    λ are the costates, the derivatives of the least objective by the state; f are the rates, g the
    integrands, and w the derivatives of the objective by their integrals. On an optimal plan the
    control minimises H, H is constant where the phase does not speak of time, and it is 0 at an
    end time that is free and that neither objective nor boundary constraints speak of.

    Parameters
    ----------
    phase : str
        Name of the phase.
    autonomous : bool
        Whether rates, integrands and path constraints leave time out: H must be constant.
    mean : float
        Its mean over time.
    spread : float
        Largest distance from its median.
    relative : float
        The same over the size of its terms, the largest sum of their magnitudes.
    time : float
        Where the spread is reached.
    end : float
        Its value at the end of the phase.
    vanishing : bool
        Whether it must be 0 at the end.
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
    """Return how constant the Hamiltonian is along each phase of a plan that has costates.

    It is a necessary condition of optimality, not of feasibility, and costates of a discrete
    problem are rough beside jumps of the control: a report, not a check.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        The problem.
    plan : ControlPlan
        The plan; a phase without costates has no report.

    Raises
    ------
    InvalidData
        The plan does not fit the problem.
    """
    definition: Definition = getattr(problem, "definition", problem)
    with np.errstate(all="ignore"):
        return tuple(_reports(definition, courses(definition, plan)))


def hamiltonian_gains(problem: Any, plan: ControlPlan) -> tuple[Floats | None, ...]:
    """Return what a better control would gain, an interval each, as the Hamiltonian tells.

    To first order, the objective exceeds its optimum by the integral over time of the Hamiltonian
    less its minimum over the controls. Where the phase does not speak of time, the Hamiltonian of the
    optimum is constant: the integral of its distance from its median estimates the excess, and is
    shared out to where it changes.

    Parameters
    ----------
    problem, plan
        As in :func:`hamiltonian_spread`.

    Returns
    -------
    tuple of ndarray, shape (intervals,)
        In the unit of the objective, one a phase; None for one that speaks of time, or without costates.
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
    off = np.abs(level - np.median(level))
    steps = np.abs(np.diff(level))
    # A jump at a knot counts half for each side.
    left, right = grid.interval[:-1], grid.interval[1:]
    changes = np.bincount(left, 0.5 * steps, course.plan.states.intervals)
    changes += np.bincount(right, 0.5 * steps, course.plan.states.intervals)
    whole = changes.sum()
    excess = float((0.5 * (off[1:] + off[:-1]) * np.diff(grid.times)).sum())
    gains: Floats = changes * (excess / whole if whole > 0.0 else 0.0)
    return gains


def _terms(definition: Definition, phases: tuple[Course, ...]) -> Iterator[Floats | None]:
    """Yield the terms of the Hamiltonian on each phase's dense grid, None without costates."""
    known = any(one.plan.costates is not None for one in phases)
    weights = _weights(definition, phases) if known else np.zeros(0)
    at = 0
    for course in phases:
        phase, costates = course.phase, course.plan.costates
        at += phase.end_size
        if costates is None:
            yield None
            continue
        values = course.dense_values
        multipliers = np.concatenate([costates.on(k, tau) for k, tau in enumerate(course.places)])
        own = weights[at - phase.integrals : at] * values["integrand"]
        yield np.concatenate([multipliers * values["rate"], own], axis=1)


def _autonomous(course: Course) -> bool:
    """Return whether rates, integrands and path constraints leave time out."""
    function = course.phase.function
    return not any(
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
        off = np.abs(level - np.median(level))
        row = int(off.argmax())
        size = float(np.abs(terms).sum(axis=1).max())
        # Trapezoids between the points of the grid; a knot counts twice, with no width between.
        width = np.diff(grid.times)
        mean = float((0.5 * (level[1:] + level[:-1]) * width).sum() / width.sum())
        free = phase.end_lower < course.plan.end < phase.end_upper
        yield HamiltonianReport(
            phase=phase.name,
            autonomous=_autonomous(course),
            mean=mean,
            spread=float(off[row]),
            relative=float(off[row]) / size if size > 0 else 0.0,
            time=float(grid.times[row]),
            end=float(level[-1]),
            vanishing=bool(free and not _speaks_of(definition, first + 1)),
        )


def _weights(definition: Definition, phases: tuple[Course, ...]) -> Floats:
    """Return the derivatives of the objective by all that it is a function of, at the plan."""
    function = definition.endpoint
    e, p = (casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in())
    slope = casadi.Function("slope", [e, p], [casadi.gradient(function(e, p)[0], e)])
    found: Floats = slope(endpoint(phases), phases[0].parameters).full().ravel()
    return found


def _speaks_of(definition: Definition, entry: int) -> bool:
    """Return whether objective or boundary constraints are functions of one entry of the ends."""
    function = definition.endpoint
    return any(entry in function.jac_sparsity(k, 0).get_col() for k in range(function.n_out()))
