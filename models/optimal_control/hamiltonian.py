"""Hamiltonian along a plan with costates: a numerical test of a necessary optimality condition."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..fields import Whole
from .algebraic import algebraic_entries, solved_controls
from .definition import Definition
from .plan import ControlPlan
from .sampling import Course, courses, endpoint

__all__ = [
    "HamiltonianReport", "MinimumReport", "hamiltonian_gains", "hamiltonian_spread", "minimum_principle",
    "misplaced_switches",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Accepted violation of a path constraint by a sampled control, relative to the constraint's size.
MARGIN = 1e-6
#: Smallest jump of a control at a knot that is a switch, relative to its size, and number of places in an
#: interval at which the switching function is evaluated.
JUMP, PLACES = 0.05, 41
#: Distance of the place at which an interval is cut for a misplaced switch, in distances of the zero from the knot,
#: and the largest one, in lengths of the interval. With cuts at the zeros, a pendulum with bounded torque needed
#: four examinations. The gain of each was a third of the one before.
BEYOND, FARTHEST = 2.0, 0.9


@dataclass(frozen=True)
class HamiltonianReport:
    """Hamiltonian H = λ·f + w·g along one phase of a plan.

    λ are the costates, the derivatives of the optimal objective with respect to the state. f are
    the rates, g the integrands, and w the derivatives of the objective with respect to their
    integrals. On an optimal plan the control minimises H, see :func:`minimum_principle`. H is constant
    if the phase does not depend on time explicitly. At a free end time on which no boundary constraint
    depends, it is the negative derivative of the objective with respect to this time.

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
    required_end : float, optional
        Value that H must have at the end (transversality); None if the end time is fixed or a boundary
        constraint depends on it.
    """

    phase: str
    autonomous: bool
    mean: float
    spread: float
    relative: float
    time: float
    end: float
    vanishing: bool
    required_end: float | None = None


@dataclass(frozen=True)
class MinimumReport:
    """Sampled test of the minimum principle along one phase: evidence, not a verification.

    Parameters
    ----------
    phase : str
        Name of the phase.
    excess : float
        Largest difference between H of the plan and H of a sampled control, at the nodes; at most 0 if
        no sample is better.
    relative : float
        `excess` relative to the largest sum of the magnitudes of the terms of H.
    time : float
        Time of the largest difference.
    better : tuple of float
        Sampled control with the smallest H at that time.
    samples : int
        Number of sampled controls per node, including those that violate a path constraint.
    """

    phase: str
    excess: float
    relative: float
    time: float
    better: tuple[float, ...]
    samples: int


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


def minimum_principle(
    problem: Any, plan: ControlPlan, *, samples: int = 64, seed: int = 0
) -> tuple[MinimumReport, ...]:
    """Return the sampled test whether the control minimises the Hamiltonian at the nodes.

    At each node of the controls, H is evaluated for random controls between their bounds. Without bounds
    they are drawn from the range along the plan, extended by its size on both sides. Half of the samples
    change a single control. Algebraic variables solve their equations for the sampled controls. Samples that
    violate a path constraint or a bound of an algebraic variable are ignored. H includes the costates,
    which are inaccurate near jumps of the control and ends of constraint arcs.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        Problem.
    plan : ControlPlan
        Plan; a phase without costates or controls has no report.
    samples : int
        Number of sampled controls per node.
    seed : int
        Seed of the samples.

    Returns
    -------
    tuple of MinimumReport
        One report per phase with costates and controls.

    Raises
    ------
    InvalidData
        The plan does not fit the problem, or an argument is not allowed.
    """
    definition: Definition = getattr(problem, "definition", problem)
    number = Whole(1, 100_000).coerce("samples", samples, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    with np.errstate(all="ignore"):
        phases = courses(definition, plan)
        return tuple(
            _minimum(course, running, number, rng)
            for course, _, running in _running(definition, phases)
            if course.plan.costates is not None and course.plan.controls.size
        )


def _minimum(
    course: Course, running: Floats, samples: int, rng: np.random.Generator
) -> MinimumReport:
    plan, phase = course.plan, course.phase
    assert plan.costates is not None
    counts, solved = [nodes.size for nodes in plan.controls.nodes], solved_controls(phase)
    algebraic = algebraic_entries(phase.controls)
    at = course.at(np.repeat(np.arange(len(counts)), counts), np.concatenate(plan.controls.nodes))
    multipliers = plan.costates.at(at.interval, at.tau)

    def terms(values: Mapping[str, Floats]) -> Floats:
        return np.concatenate([multipliers * values["rate"], running * values["integrand"]], axis=1)

    low, high = phase.bounds("controls")
    size = course.sizes.controls
    edges = (at.controls.min(axis=0) - size, at.controls.max(axis=0) + size)
    lowest, highest = (
        np.where(np.isfinite(x), x, y) for x, y in zip((low, high), edges, strict=True)
    )
    path_low, path_high = phase.bounds("paths")
    slack = MARGIN * np.maximum(course.sizes.paths, 1e-300)
    current = terms(course.values(at))
    best, chosen = np.full(at.times.size, np.inf), at.controls.copy()
    for number in range(samples):
        controls = rng.uniform(lowest, highest, at.controls.shape)
        if number % 2:
            single = np.arange(low.size) == number // 2 % low.size
            edge = rng.choice([0.0, 0.5, 1.0], (at.times.size, 1))
            controls = np.where(edge == 0.5, controls, lowest + edge * (highest - lowest))
            controls = np.where(single, controls, at.controls)
        if solved is not None:
            controls[:, algebraic] = at.controls[:, algebraic]  # the start of Newton's method
            controls = solved(at.times[None], at.states.T, controls.T, course.parameters).full().T
        values = course.values(at._replace(controls=controls))
        path = values["path"]
        allowed = ((path >= path_low - slack) & (path <= path_high + slack)).all(axis=1)
        inside = (controls >= low - MARGIN * size) & (controls <= high + MARGIN * size)
        allowed &= inside.all(axis=1)
        level = np.where(allowed, terms(values).sum(axis=1), np.inf)
        better = level < best
        best[better], chosen[better] = level[better], controls[better]
    excess = current.sum(axis=1) - best
    row = int(np.argmax(excess))
    scale = float(np.abs(current).sum(axis=1).max())
    return MinimumReport(
        phase=phase.name, excess=float(excess[row]),
        relative=float(excess[row]) / scale if scale > 0 else 0.0, time=float(at.times[row]),
        better=tuple(chosen[row].tolist()), samples=samples,
    )  # fmt: skip


def hamiltonian_gains(problem: Any, plan: ControlPlan) -> tuple[Floats | None, ...]:
    """Return the potential decrease of the objective per interval, estimated from the Hamiltonian.

    To first order, the objective exceeds its optimum by the integral over time of the difference between
    the Hamiltonian and its minimum over the controls. In a phase without explicit time, the optimum has a
    constant Hamiltonian. The integral of the distance from the median then estimates the excess, which is
    distributed in proportion to its changes over the intervals. Other phases, and those without costates,
    have None.
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
    return changes * (excess / total if total > 0.0 else 0.0)


def misplaced_switches(
    problem: Any, plan: ControlPlan
) -> tuple[list[tuple[int, float, float]], ...]:
    """Return interval, place in [-1, 1] and gain of the switches that should not be at their knots.

    At a switch of a control, H is equal for its values before and after. If the difference, the switching
    function φ, vanishes between a knot and the next node instead, the program does not see that one of the values
    is wrong until there, and every interval is accurate all the same. Moving the switch decreases the objective
    by the integral of abs(φ), about half the product of its value at the knot and the distance. The place is
    :data:`BEYOND` as far from the knot as the zero, because the zeros of several switches move together. Values that
    violate a path constraint before the zero, and phases without costates or with algebraic variables, have no entries.
    """
    definition: Definition = getattr(problem, "definition", problem)
    with np.errstate(all="ignore"):
        phases = courses(definition, plan)
        return tuple(
            list(_misplaced(course, running)) for course, _, running in _running(definition, phases)
        )


def _misplaced(course: Course, running: Floats) -> Iterator[tuple[int, float, float]]:
    controls, costates = course.plan.controls, course.plan.costates
    if costates is None or not controls.size or algebraic_entries(course.phase.controls).size:
        return
    tau = np.linspace(-1.0, 1.0, PLACES)
    low, high = course.phase.bounds("paths")
    slack = MARGIN * np.maximum(course.sizes.paths, 1e-300)

    def advantage(interval: int, control: int, before: float, after: float) -> Floats:
        """Return φ, the difference of H for the values after and before the knot; NaN if a value is not allowed."""
        at = course.at(np.full(PLACES, interval), tau)
        multipliers, levels = costates.at(at.interval, at.tau), []
        for value in (before, after):
            u = at.controls.copy()
            u[:, control] = value
            values = course.values(at._replace(controls=u))
            terms = multipliers * values["rate"], running * values["integrand"]
            level, path = np.concatenate(terms, axis=1).sum(axis=1), values["path"]
            allowed = ((path >= low - slack) & (path <= high + slack)).all(axis=1)
            levels.append(np.where(allowed & np.isfinite(level), level, np.nan))
        difference: Floats = levels[1] - levels[0]
        return difference

    for k in range(controls.intervals - 1):
        before, after = controls.on(k, [1.0])[0], controls.on(k + 1, [-1.0])[0]
        for c in np.flatnonzero(np.abs(after - before) > JUMP * course.sizes.controls).tolist():
            # Positive before the switch and negative after it.
            later = advantage(k + 1, c, before[c], after[c])
            former = -advantage(k, c, before[c], after[c])[::-1]
            for interval, sign, phi in ((k + 1, 1.0, later), (k, -1.0, former)):
                # The first place without a positive value: a zero, unless the value there is NaN.
                j = int((~(phi > 0.0)).argmax())
                if j > 0 and phi[j] <= 0.0:
                    place = tau[j - 1] + (tau[j] - tau[j - 1]) * phi[j - 1] / (phi[j - 1] - phi[j])
                    share = 0.5 * float(place + 1.0)
                    gain = 0.5 * float(phi[0] * share * np.diff(controls.knots)[interval])
                    yield interval, sign * (2.0 * min(BEYOND * share, FARTHEST) - 1.0), gain


def _terms(definition: Definition, phases: tuple[Course, ...]) -> Iterator[Floats | None]:
    """Yield the terms of the Hamiltonian on each phase's dense grid; None without costates."""
    for course, _, running in _running(definition, phases):
        costates, values = course.plan.costates, course.dense_values
        if costates is None:
            yield None
            continue
        multipliers = costates.at(course.dense.interval, course.dense.tau)
        yield np.concatenate([multipliers * values["rate"], running * values["integrand"]], axis=1)


def _running(
    definition: Definition, phases: tuple[Course, ...]
) -> Iterator[tuple[Course, float, Floats]]:
    """Yield each phase with the derivatives of the objective by its end time and by its integrals."""
    known = any(course.plan.costates is not None for course in phases)
    weights = _weights(definition, phases) if known else np.zeros(0)
    begin = 0
    for course in phases:
        first = begin + 2 + 2 * len(course.phase.state_names)
        slope = float(weights[begin + 1]) if known else np.nan
        yield course, slope, weights[first : first + course.phase.integrals]
        begin += course.phase.end_size


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
    pairs = zip(_running(definition, phases), _terms(definition, phases), strict=True)
    for (course, slope, _), terms in pairs:
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
        is_free = phase.end_lower < course.plan.end < phase.end_upper
        # Whether the objective and the boundary constraints depend on the end time.
        depends = [first + 1 in definition.endpoint.jac_sparsity(k, 0).get_col() for k in (0, 1)]
        yield HamiltonianReport(
            phase=phase.name,
            autonomous=_autonomous(course),
            mean=mean,
            spread=float(distance[row]),
            relative=float(distance[row]) / size if size > 0 else 0.0,
            time=float(grid.times[row]),
            end=float(level[-1]),
            vanishing=is_free and not any(depends),
            required_end=0.0 - slope if is_free and not depends[1] else None,
        )


def _weights(definition: Definition, phases: tuple[Course, ...]) -> Floats:
    """Return the derivatives of the objective with respect to the endpoint vector at the plan."""
    function = definition.endpoint
    e, p = (casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in())
    slope = casadi.Function("slope", [e, p], [casadi.gradient(function(e, p)[0], e)])
    result: Floats = slope(endpoint(phases), phases[0].parameters).full().ravel()
    return result
