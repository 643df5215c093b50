"""``minco``: native trajectories of minimum time through gates, within the limits of a vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.minimum_snap.motion import extended, heading_jumps
from ...models.minimum_snap.time_allocation import Minimise, TimeAllocation
from ...models.minimum_snap.trajectory import Trajectory
from ...models.minimum_snap.vehicle_checks import yaw_of
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Option,
    Request,
    Termination,
)

__all__ = ["Minco", "first_points"]

Floats = NDArray[np.float64]

#: Share of a limit that is regarded as reached, and least share of the time at limits on fast paths.
NEAR, FEW = 0.95, 0.5


class Minco(Backend):
    """L-BFGS on durations and knots between which the path is a spline of minimum effort.

    Limits of the vehicle, corridors and polytopes enter as an augmented Lagrangian at instants. The
    motion is then stretched in time until the proven extremes of all quantities keep their limits, so
    that the plan is feasible and close to a local optimum, which is not certified. Without free knots
    between the gates, the spline limits the accelerations that the path can use: more free knots per
    segment give shorter times.
    """

    name = "minco"
    accepts = TimeAllocation
    single_threaded = True
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.WARM_START, Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "steps": Option(4000, "Most evaluations of the objective.", int, lower=1),
    }
    summary = "minimum time through gates and polytopes within a vehicle's limits; ours"

    def refuses(self, problem: TimeAllocation) -> str:
        """Return the unsupported features of `problem`, or an empty string."""
        inner = np.isfinite(problem.conditions[1:-1, 1:])
        if problem.total_time is not None:
            return problem.beyond_times or "a given total time: take time-gradient"
        if problem.order < 2:
            return "the order 1"
        if problem.unit.fixes_order:
            return f"fixed derivatives of order {problem.order} or above"
        if problem.continuity > (problem.order - 1 if inner.any() else 2 * problem.order - 2):
            return f"continuity {problem.continuity}"
        if problem.periodic and np.isfinite(problem.conditions[[0, -1], 1:]).any():
            return "fixed derivatives at the joint of a lap"
        return ""

    def run(self, problem: TimeAllocation, request: Request) -> Answer:
        """Search from the waypoints and the centres of the gates, or from the warm start."""
        from .minco import fastest, limits_of

        self.require_support(problem)
        begin = clock()
        points, durations = first_points(problem), None
        if request.warm_start is not None:
            ends = request.warm_start.at_ends()
            points = np.concatenate([ends[0], ends[1][-1:]])
            durations = np.array(request.warm_start.durations)
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean()) or 1.0
        weighted = problem.minimise is Minimise.WEIGHTED
        result = fastest(
            points,
            limits_of(problem.vehicle),
            regions=_regions(problem, points, length),
            jets=np.array(problem.unit.jets),
            rows=_rows(problem, length),
            weights=np.array(problem.order_weights),
            time_weight=problem.time_weight if weighted else None,
            periodic=problem.periodic,
            durations=durations,
            exact=lambda durations, powers: _excess(
                problem, _plan(problem, durations, powers), request.tolerance
            ),
            evaluations=request.options.get("steps", 4000),
            flag=request.control.flag,
            seed=request.seed or 0,
        )
        statistics: dict[str, Any] = {
            "iterations": result.iterations,
            "evaluations": result.evaluations,
            "converged": "yes" if result.settled else "no",
        }
        seconds, limit = {"solve": clock() - begin}, request.control.limit
        plan = _plan(problem, result.durations, result.coefficients)
        # The verification takes longer than the search, and is repeated for each answer.
        kept, worst = result.excess <= 0.0, result.worst
        if not kept and plan is not None:
            violated = problem.verify(plan, tolerance=request.tolerance).violated
            kept, worst = not violated, violated[0].name if violated else worst
        before = request.warm_start
        if before is not None and problem.verify(before, tolerance=request.tolerance).ok:
            if plan is None or not kept or problem.objective(before) < problem.objective(plan):
                plan, kept = before, True
        if plan is None or not kept:
            return Answer(
                Termination.NO_SOLUTION, limit, seconds=seconds, statistics=statistics,
                message=f"no path within the limits was found (nearest: {worst} violated, relative excess "
                f"{result.excess:.2g}); this is no proof that none exists",
            )  # fmt: skip
        message = ""
        if not weighted and (share := _pressed(problem, plan)) < FEW:
            message = (
                f"limits are reached during {share:.0%} of the time only: with more free knots (None) "
                "between the waypoints, the path may be faster"
            )
        return Answer(
            Termination.FEASIBLE, limit, plan, problem.objective(plan), seconds=seconds,
            statistics=statistics, message=message,
        )  # fmt: skip


def _plan(problem: TimeAllocation, durations: Floats, powers: Floats) -> Trajectory | None:
    times = problem.times(durations)
    if not (np.isfinite(powers).all() and np.all(np.diff(times) > 0)):
        return None
    plan = Trajectory(times, powers)
    return problem.at(times).with_yaw(plan) if problem.yaw is not None else plan


def _excess(problem: TimeAllocation, plan: Trajectory | None, tolerance: float) -> float:
    """Return the largest proven excess of a limit, relative to it; infinite if the heading jumps."""
    if plan is None:
        return np.inf
    follows = problem.vehicle is not None and problem.vehicle.follows_path
    if (follows or isinstance(problem.yaw, str)) and (heading_jumps(plan) > tolerance).any():
        return np.inf
    excess = problem.stretch(plan) - 1.0
    if problem.vehicle is not None:
        yaw = yaw_of(problem.unit, plan)
        for extreme in problem.vehicle.check_curve(plan, yaw, exact=False):
            excess = max(excess, extreme.amount / extreme.limit)
    return excess


@np.errstate(all="ignore")  # undefined quantities reach no limit
def _pressed(problem: TimeAllocation, plan: Trajectory) -> float:
    """Return the share of the time at a limit, from instants of each segment."""
    segment, number = (part.ravel() for part in np.indices((plan.segments, 16)))
    s = (number + 0.5) / 16
    near = np.zeros(s.size, bool)
    for bound in problem.bounds:
        if bound.derivative:
            value = plan(plan.times[segment] + s * plan.durations[segment], bound.derivative)
            at = np.maximum(value / bound.upper[segment], value / bound.lower[segment])
            near |= (at > NEAR).any(axis=1)
    vehicle = problem.vehicle
    if vehicle is not None:
        yaw = yaw_of(problem.unit, plan)
        motion = extended(plan, yaw, vehicle.follows_path).on(segment, s, 4)
        for measure in vehicle.measures:
            value = measure.value(measure.function(motion).terms[0])
            share = value / measure.limit if measure.is_upper else measure.limit / value
            near |= share > NEAR
    return float(near @ plan.durations[segment] / plan.durations[segment].sum())


def first_points(problem: TimeAllocation) -> Floats:
    """Return waypoints, centres of gates, and points between them for free coordinates.

    Parameters
    ----------
    problem : TimeAllocation
        Problem with free times.

    Returns
    -------
    ndarray, shape (knots, dimensions)
        Finite positions, m.
    """
    points = np.array(problem.waypoints)
    for gate in problem.gates:
        points[gate.knot] = gate.frame.centre
    if problem.periodic:
        for one, other in ((0, -1), (-1, 0)):
            points[one] = np.where(np.isfinite(points[one]), points[one], points[other])
    knots = np.arange(len(points), dtype=float)
    low, high = problem.unit.reach
    for axis, column in enumerate(points.T):
        known = np.isfinite(column)
        if known.any():
            column[:] = np.interp(knots, knots[known], column[known])
        else:
            both = [side[axis] for side in (low, high) if np.isfinite(side[axis])]
            column[:] = np.mean(both) if both else 0.0
    return points


def _regions(problem: TimeAllocation, points: Floats, length: float) -> list[Any]:
    """Return the region of each knot: its gate, or its waypoint with free coordinates."""
    from .minco import Region

    gates = {gate.knot: gate for gate in problem.gates}
    free = ~np.isfinite(problem.waypoints)
    last = problem.segments
    if problem.periodic:
        free[0] = free[-1] = free[0] & free[-1]
        if last in gates and free[0].all():
            gates.setdefault(0, gates[last])
    regions = []
    for knot, point in enumerate(points):
        gate = gates.get(knot)
        if gate is None:
            centre = np.where(free[knot], 0.0, point)
            regions.append(Region("affine", centre, length * np.eye(len(point))[free[knot]]))
        elif gate.radius is None:
            regions.append(Region("hull", np.zeros(len(point)), np.array(gate.polygon)))
        else:
            reach = gate.radius * np.array(gate.frame.axes)
            regions.append(Region("ball", np.array(gate.frame.centre), reach))
    return regions


def _rows(problem: TimeAllocation, length: float) -> Any:
    """Return corridor, limits of components and polytopes as linear rows."""
    from .minco import SIZE, Rows

    parts = []
    for bound in problem.bounds:
        for side, edge in ((-1.0, -bound.lower), (1.0, bound.upper)):
            segment, axis = np.nonzero(np.isfinite(edge))
            offset = edge[segment, axis]
            size = np.full(segment.size, SIZE * length)
            if bound.derivative:
                size = np.maximum(np.abs(offset), 1e-6 * np.abs(offset).max(initial=0.0))
                size[size == 0.0] = 1.0
            order = np.full(segment.size, bound.derivative)
            parts.append(
                Rows(segment, order, side * np.eye(problem.dimensions)[axis], offset, size)
            )
    spaces = problem.halfspaces
    if spaces is not None:
        size = np.full(spaces.segments.size, SIZE * length)
        order = np.zeros(spaces.segments.size, np.int64)
        parts.append(Rows(spaces.segments, order, spaces.normals, spaces.offsets, size))
    return Rows(*(np.concatenate(part) for part in zip(*parts, strict=True))) if parts else None
