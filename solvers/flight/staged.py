"""``staged``: path, corridor, times, smoothest curve in the corridor, each stage after the other."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import OutOfTime, clock
from ...models.flight.model import Flight
from ...models.flight.plan import FlightPlan
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.trajectory import Trajectory
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Limit,
    Request,
    Termination,
)
from ..contract.registry import find_backend
from .course import Course, course_of, resting, stretched, times_along, typical
from .proofs import Separation, least_objective, separations
from .ways import lattice, way

__all__ = ["Staged", "StagedFlight"]

Floats = NDArray[np.float64]

#: Numbers of parts of a cell for which a way is searched, in turn. Odd ones have a cell in the middle of a gap.
PARTS = (1, 2, 3, 5)
#: Backend for the smoothest curve.
TRAJECTORIES = "interior-point"
#: Multiples of the estimated times for flights that do not begin and end at rest.
MULTIPLES = (1.0, 0.7, 1.4, 2.0, 3.0, 0.5, 5.0)
#: Waits before the departure per flight time, and their largest number.
DELAYS, MOST_DELAYS = 20, 400
#: Factors of the flight time, and samples of a flight to find moving obstacles.
SLOWER, SAMPLES = (1.0, 1.15, 1.35, 1.7, 2.2, 3.0, 4.0), 256
#: Statistic of a search that ended before the run because its kernels used up their time.
STOPPED = "search for a curve stopped"
#: Share of the time between two places at the same position, relative to the length scale.
HOVER = 1e-3


class StagedFlight(Backend):
    """Base of the backends: path and corridor, then the curve of :meth:`fly`.

    A claim of infeasibility is a proof: two places are in different components of a set that contains the
    free space.
    """

    accepts = Flight
    guarantee = Guarantee.RELAXATION
    features = frozenset({Feature.INCUMBENTS, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True

    def run(self, problem: Flight, request: Request) -> Answer:
        """Carry out the stages."""
        begin = clock()
        bound = least_objective(problem, request.tolerance)
        statistics: dict[str, Any] = {}
        plan, message, proof, control = None, "", list[Separation](), request.control
        for parts in PARTS:
            plan, message = self._planned(problem, request, parts, statistics)
            if plan is not None or control.stopped or message:
                break
            if parts == 1:  # a proof takes less time than a search on finer cells
                proof = separations(problem, request.tolerance)
            if proof or control.stopped:
                break
        common: dict[str, Any] = {"seconds": {"solve": clock() - begin}, "statistics": statistics}
        limit = control.limit or (Limit.TIME if STOPPED in statistics else None)
        if plan is not None:
            objective = problem.verify(plan, tolerance=request.tolerance).objective
            return Answer(Termination.FEASIBLE, limit, plan, objective, bound, **common)
        if proof:
            return Answer(Termination.INFEASIBLE, message=str(proof[0]), **common)
        if not message:
            message = "no way over cells was found, and none is excluded"
            message = "the search for a way over cells was stopped" if control.stopped else message
        return Answer(Termination.NO_SOLUTION, limit, dual_bound=bound, message=message, **common)

    def _planned(
        self, problem: Flight, request: Request, parts: int, statistics: dict[str, Any]
    ) -> tuple[FlightPlan | None, str]:
        """Return a verified plan along the way over cells divided into `parts`, or a reason."""
        begin = clock()
        cells = lattice(problem, parts)
        result = None
        if cells is not None and not request.control.stopped:
            result = way(problem, cells, request.control.flag)
        statistics["path seconds"] = statistics.get("path seconds", 0.0) + clock() - begin
        if result is None:
            return None, ""
        path, stops = result
        if len(path) < 2:
            still = "all places coincide, and the flight does not begin and end at rest"
            plan = hovering(problem)
            return plan, "" if plan is not None else still
        statistics["path length"] = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        begin = clock()
        course, reason = None, ""

        def pause() -> None:
            if request.control.stopped:
                raise OutOfTime

        try:
            course = course_of(problem, path, stops, pause=pause)
            statistics["polytopes"] = len(course.polytopes)
        except InvalidData as error:
            reason = f"corridor: {error}"
        except OutOfTime:
            reason = "the computation of the corridor was stopped"
        statistics["corridor seconds"] = clock() - begin
        begin = clock()
        best: FlightPlan | None = None
        if course is not None:
            try:
                best = self.fly(problem, course, request, statistics)
            except OutOfTime:
                statistics[STOPPED] = True
                reason = "the search for a curve was stopped"
        if best is None:  # a curve that rests at all points of the path fits
            curve = resting(problem, path, lambda: request.control.stopped)
            best = None if curve is None else FlightPlan(curve, curve.times[stops[1:-1]], path)
            statistics["rests at points of the path"] = best is not None
        statistics["curve seconds"] = clock() - begin
        if best is None:
            return None, reason or "no curve within the limits was found in the corridor"
        if problem.moving:
            best = delayed(problem, best, request)
            if best is None:
                return None, "no departure and speed within the search avoid the moving obstacles"
        result_check = problem.verify(best, tolerance=request.tolerance)
        return (best, "") if result_check.ok else (None, result_check.summary())

    @abstractmethod
    def fly(
        self, problem: Flight, course: Course, request: Request, statistics: dict[str, Any]
    ) -> FlightPlan | None:
        """Return a verified plan in the corridor of a course, or None."""


class Staged(StagedFlight):
    """Path by A*, corridor of convex polytopes, times by a trapezoid of speed, smoothest curve.

    From rest to rest the curve is stretched in time until the vehicle's limits hold. If that fails, a
    curve that rests at each point of the path always fits. Other flights try several times.
    """

    name = "staged"
    summary = "path, corridor, times and the smoothest curve, stretched to the limits; ours"

    def fly(
        self, problem: Flight, course: Course, request: Request, statistics: dict[str, Any]
    ) -> FlightPlan | None:
        """Return the smoothest curve that keeps the limits."""
        return smoothest(problem, course, request, statistics)


def smoothest(
    problem: Flight, course: Course, request: Request, statistics: dict[str, Any]
) -> FlightPlan | None:
    """Return a verified plan from one minimum-derivative problem per multiple of the estimated times."""
    solver = find_backend(TRAJECTORIES, problem="minimum_snap")
    durations = times_along(problem, course.knots)
    for multiple in MULTIPLES:
        if request.control.stopped:
            return None
        scaled = Scaled.of(problem, course, durations * multiple)
        answer = request.within(solver, scaled.model)
        statistics["trajectory problems"] = statistics.get("trajectory problems", 0) + 1
        if answer.point is None:
            continue
        curve: Trajectory | None = scaled.restored(answer.point)
        if scaled.rests:
            curve = stretched(problem.vehicle, scaled.restored(answer.point))
        if curve is not None:
            plan = FlightPlan(curve, curve.times[course.stops[1:-1]], course.path)
            if standing(problem).verify(plan, tolerance=request.tolerance).ok:
                return plan
        if scaled.rests:
            return None
    return None


@dataclass(frozen=True)
class Scaled:
    """Minimum-derivative problem of a course in units of length and time of its own.

    Parameters
    ----------
    model : MinimumDerivative
        The problem.
    origin : ndarray, shape (axes,)
        Origin of its positions, m.
    length, time : float
        Units in metres and seconds.
    rests : bool
        Whether it begins and ends at rest, so that its shape does not depend on the unit of time.
    """

    model: MinimumDerivative
    origin: Floats
    length: float
    time: float
    rests: bool

    @classmethod
    def of(cls, problem: Flight, course: Course, durations: Floats) -> Scaled:
        """Return the problem at given durations of the segments, s."""
        origin, count = course.path[0], len(durations)
        length = float(np.linalg.norm(np.diff(course.path, axis=0), axis=1).sum()) / count
        time = float(durations.sum()) / count
        points = np.full((count + 1, problem.dimensions), np.inf)
        points[course.stops] = (problem.places - origin) / length
        ends = []
        for side in ("start", "goal"):
            velocity = getattr(problem, f"{side}_velocity") * time / length
            push = getattr(problem, f"{side}_acceleration") * time**2 / length
            rest = np.zeros((problem.order - 3, problem.dimensions))
            ends.append(np.concatenate([velocity[None], push[None], rest]))
        segments = [np.full(len(b), k) for k, (_, b) in enumerate(course.polytopes)]
        offsets = [(b - a @ origin) / length for a, b in course.polytopes]
        model = MinimumDerivative(
            points, np.concatenate([[0.0], np.cumsum(durations / time)]), problem.order,
            start=ends[0], end=ends[1],
            polytope_segments=np.concatenate(segments),
            polytope_normals=np.concatenate([a for a, _ in course.polytopes]),
            polytope_offsets=np.concatenate(offsets),
        )  # fmt: skip
        rests = not any(end.any() for end in ends)
        return cls(model, origin, length, time, rests)

    def restored(self, curve: Trajectory) -> Trajectory:
        """Return a curve of the problem in metres and seconds."""
        coefficients = curve.coefficients * self.length
        coefficients[:, 0] += self.origin
        return Trajectory(curve.times * self.time, coefficients)


def standing(problem: Flight) -> Flight:
    """Return the flight without moving obstacles."""
    return replace(problem, moving=()) if problem.moving else problem


def delayed(problem: Flight, plan: FlightPlan, request: Request) -> FlightPlan | None:
    """Return the plan with the earliest tested arrival that avoids all moving obstacles.

    It waits at the start for multiples of a share of the flight time, and flies slower by a factor. Only a
    flight that begins at rest can wait, and only one between rests can be slower.
    """
    curve = plan.trajectory
    rests = not (problem.start_velocity.any() or problem.start_acceleration.any())
    stops = not (problem.goal_velocity.any() or problem.goal_acceleration.any())
    last = max(float(entry.trajectory.times[-1]) for entry in problem.moving) + curve.duration
    step = max(curve.duration / DELAYS, last / MOST_DELAYS)
    waits = np.arange(0.0, last if rests else 0.5 * step, step).tolist()
    factors = SLOWER if rests and stops else SLOWER[:1]
    tried = [(wait + factor * curve.duration, wait, factor) for wait in waits for factor in factors]
    for _, wait, factor in sorted(tried):
        if request.control.stopped:
            return None
        times, powers = factor * curve.times + wait, curve.coefficients
        if wait:
            still = np.zeros((1, *powers.shape[1:]))
            still[0, 0] = problem.start
            times, powers = np.append(0.0, times), np.concatenate([still, powers])
        later = FlightPlan(Trajectory(times, powers), factor * plan.visits + wait, plan.path)
        if _meets(problem, later.trajectory, request.tolerance):
            continue
        if problem.verify(later, tolerance=request.tolerance).ok:
            return later
    return None


def _meets(problem: Flight, curve: Trajectory, tolerance: float) -> bool:
    """Return whether a moving obstacle is too near at a sampled instant, which is faster than to verify."""
    times = np.linspace(curve.times[0], curve.times[-1], SAMPLES)
    places, slack = curve(times), 10.0 * tolerance * problem.cell
    return any(
        np.linalg.norm(places - entry(times), axis=1).min() < problem.radius + entry.radius - slack
        for entry in problem.moving
    )


def hovering(problem: Flight) -> FlightPlan | None:
    """Return the plan of a flight whose places coincide, or None if it does not rest at both ends.

    The objective has no minimum, as any duration > 0 is possible: the vehicle hovers for the time of a
    thousandth of a cell at its typical acceleration.
    """
    ends = ("start_velocity", "start_acceleration", "goal_velocity", "goal_acceleration")
    if any(getattr(problem, name).any() for name in ends):
        return None
    _, push = typical(problem.vehicle)
    duration = (HOVER * problem.cell / push) ** 0.5
    coefficients = np.zeros((1, 2 * problem.order, problem.dimensions))
    coefficients[0, 0] = problem.start
    curve = Trajectory(np.array([0.0, duration]), coefficients)
    return FlightPlan(curve, np.full(len(problem.waypoints), duration), problem.places)
