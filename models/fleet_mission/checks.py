"""Independent check of a mission: the curves over time against the polygons.

The check uses no grid, corridor or result of a planner. Distances are computed by shapely. Each property is
proven for the whole curve by convex hulls of pieces, which are bisected until decided. Planners may use the
same distances to test their curves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..fleet.checks import objective_of
from ..fleet.data import Objective
from ..minimum_snap.bounds import derivative_name, derivative_unit
from ..minimum_snap.polynomials import factorials
from ..minimum_snap.trajectory import Trajectory
from ..verification import Check, Verification, check_entries, check_tolerance
from .collision import deepest
from .curves import lengths_of, nearest, pieces_of
from .data import MissionData, MissionObjective
from .plan import MissionPlan

__all__ = ["verify_mission"]

Floats = NDArray[np.float64]

#: Relative rounding error of positions.
DIGITS = 1e-13
#: Accuracy of the search for the least distance, as a share of the distance tolerance.
SEARCH_SHARE = 0.01
#: Relative rounding error of a derivative at a knot, with respect to its terms.
ULPS = 16 * float(np.finfo(float).eps)
#: Largest derivatives of the unit rest-to-rest step, a polynomial of degree 7 on a unit of time.
STEPS = (1.0, 35.0 / 16.0, 7.52, 52.5)


#: Robots under way: number and trajectory.
Flights = list[tuple[int, Trajectory]]


def verify_mission(model: MissionData, plan: MissionPlan, tolerance: float) -> Verification:
    """Compute the objective of `plan` and check every constraint of `model`."""
    check_tolerance(tolerance)
    required("plan", plan, MissionPlan)
    for k, route in enumerate(plan.routes):
        check_entries(f"routes[{k}]", route, 0, len(model.nodes) - 1, "routes")
    flights = [(k, entry) for k, entry in enumerate(plan.trajectories) if entry is not None]
    checks = [
        *_counts(model, plan),
        *_places(model, plan, flights, tolerance),
        *_knots(model, flights, tolerance),
        *_limits(model, flights, tolerance),
        _inside(model, flights, tolerance),
        _collision(model, flights, tolerance),
        _separation(model, flights, tolerance),
        *_moving(model, flights, tolerance),
        *_departures(model, flights, tolerance),
    ]
    if len(plan.routes) != model.vehicles:
        return Verification(None, tuple(checks))
    loads = np.zeros(model.vehicles)
    for k, entry in flights:
        loads[k] = lengths_of(entry).sum()
    # The range of nearly equal lengths is almost 0: compare it with the mean length instead.
    scale = float(loads.mean()) if model.objective == "range" else 0.0
    if model.objective is MissionObjective.MAKESPAN:
        return Verification(plan.end, tuple(checks))
    lengths: Any = SimpleNamespace(
        objective=Objective(model.objective), q=model.q, deviation=model.deviation
    )
    return Verification(objective_of(lengths, loads), tuple(checks), scale=scale)


def _counts(model: MissionData, plan: MissionPlan) -> Iterator[Check]:
    visits = np.bincount(
        np.array([node for route in plan.routes for node in route], int), minlength=len(model.nodes)
    )
    wrong = [f"node {model.label(int(k))}" for k in np.flatnonzero(visits != 1)]
    idle = [f"robot {k}" for k, route in enumerate(plan.routes) if not route]
    pairs = enumerate(zip(plan.routes, plan.trajectories, strict=True))
    lacking = [f"robot {k}" for k, (route, entry) in pairs if bool(route) == (entry is None)]
    yield Check.count("one route for each robot", abs(len(plan.routes) - model.vehicles))
    yield Check.count("each node visited once", wrong)
    yield Check.count("every robot used", idle)
    yield Check.count("a trajectory for each route", lacking)


def _digits(model: MissionData) -> float:
    """Return the rounding error of a position, m."""
    return DIGITS * float(np.abs(model.bounds).max())


def _worst(
    name: str, unit: str, tolerance: float, robots: Iterable[tuple[Any, ...]], equation: str = "",
    limit: float | None = None,
) -> Check:  # fmt: skip
    """Return the worst check over `robots`: violations, scale, place and noise of each."""
    checks = (
        Check.largest(
            name, values, scale, unit, where, tolerance, equation=equation, noise=noise, limit=limit
        )
        for values, scale, where, noise in robots
    )
    return Check.worst_of(checks, Check.scaled(name, equation, 0.0, unit, "", tolerance, 0.0))


def _places(
    model: MissionData, plan: MissionPlan, flights: Flights, tolerance: float
) -> Iterator[Check]:
    """Yield the checks of visit times and positions, and of both ends."""
    digits = _digits(model)
    # Time scale: one cell at the velocity scale of the other checks.
    pause = _scale(model, 0) / _scale(model, 1)

    def distance_to_nodes(k: int, curve: Trajectory) -> tuple[Any, ...]:
        times, nodes = plan.visits[k], np.array(plan.routes[k], int)
        positions = curve(np.clip(times, curve.times[0], curve.times[-1]))

        def place(stop: int) -> str:
            return f"robot {k}, node {model.label(int(nodes[stop]))} (t = {times[stop]:.6g} s)"

        return np.hypot(*(positions - model.nodes[nodes]).T), model.cell, place, digits

    def waits(k: int, curve: Trajectory) -> tuple[Any, ...]:
        stops = np.concatenate([curve.times[:1], plan.visits[k], curve.times[-1:]])
        noise = ULPS * float(np.abs(curve.times).max())
        return -np.diff(stops), pause, lambda stop: f"robot {k}, stop {stop}", noise

    def name_end(k: int) -> Callable[[int], str]:
        return lambda end: f"robot {k}, {('start', 'end')[end]}"

    def distance_to_depot(k: int, curve: Trajectory) -> tuple[Any, ...]:
        begins, ends = curve.at_ends()
        gaps = np.hypot(*(np.stack([begins[0], ends[-1]]) - model.depot).T)
        return gaps, model.cell, name_end(k), digits

    def derivative_at_ends(k: int, curve: Trajectory, order: int) -> tuple[Any, ...]:
        begins, ends = curve.at_ends(order)
        errors = _noise(curve, order)
        values = np.abs(np.stack([begins[0], ends[-1]])).max(axis=1)
        return (
            values,
            _scale(model, order),
            name_end(k),
            np.stack([errors[0], errors[-1]]).max(axis=1),
        )

    stops = [distance_to_nodes(k, curve) for k, curve in flights]
    yield _worst("nodes passed at their times", "m", tolerance, stops, "24")
    yield _worst("visits in order", "s", tolerance, [waits(k, curve) for k, curve in flights])
    gaps = [distance_to_depot(k, curve) for k, curve in flights]
    yield _worst("begins and ends at the depot", "m", tolerance, gaps)
    for order in range(1, model.continuity + 1):
        name, unit = f"{derivative_name(order)} 0 at both ends", derivative_unit(order)
        robots = [derivative_at_ends(k, curve, order) for k, curve in flights]
        yield _worst(name, unit, tolerance, robots, _equation_number("23", order))


def _equation_number(equation: str, order: int) -> str:
    """Return the equation number, empty for the jerk, which the paper does not constrain."""
    return equation if order <= 2 else ""


def _scale(model: MissionData, order: int) -> float:
    """Return the scale of a derivative: cell, velocity limit, acceleration limit, or derived jerk."""
    speed, push = float(model.velocity_limit.min()), float(model.acceleration_limit.min())
    return (model.cell, speed, push, push * push / speed)[order]


def _noise(curve: Trajectory, order: int) -> Floats:
    """Return the rounding error of a derivative at knots, shape (segments, 2)."""
    if order > curve.degree:
        return np.zeros((curve.segments, 2))
    sizes = np.einsum(
        "p,kpd->kd", factorials(curve.degree, order), np.abs(curve.coefficients[:, order:])
    )
    # Rounding steps in positions cause derivatives of smooth curves.
    sizes += STEPS[order] * np.abs(curve.coefficients[:, 0])
    return np.asarray(ULPS * sizes * (curve.durations**-order)[:, None])


def _knots(model: MissionData, flights: Flights, tolerance: float) -> Iterator[Check]:
    """Yield the checks of jumps at knots, from the position to the derivative `continuity`."""

    def jumps(k: int, curve: Trajectory, order: int) -> tuple[Any, ...]:
        begin, end = curve.at_ends(order)
        errors = _noise(curve, order)
        scale: Any = _scale(model, order)
        if order == 3:
            # Jerk has no limit: its scale is the value at the knot, and 1 % of the largest value.
            at_knot = np.maximum(np.abs(end[:-1]), np.abs(begin[1:]))
            scale = np.maximum(at_knot, 1e-2 * np.abs(begin).max(axis=0))
            scale = np.minimum(scale, _scale(model, 3) * 1e3)

        def place(knot: int, axis: int) -> str:
            return f"robot {k}, knot {knot + 1} (t = {curve.times[knot + 1]:.6g} s)"

        noise = errors[:-1] + errors[1:] + (_digits(model) if order == 0 else 0.0)
        return np.abs(end[:-1] - begin[1:]), scale, place, noise

    for order in range(model.continuity + 1):
        name, unit = f"continuity of {derivative_name(order)}", derivative_unit(order)
        robots = [jumps(k, curve, order) for k, curve in flights]
        yield _worst(name, unit, tolerance, robots, _equation_number("25", order))


def _limits(model: MissionData, flights: Flights, tolerance: float) -> Iterator[Check]:
    """Yield the checks of the velocity and acceleration limits at exact extremes."""

    def check(name: str, unit: str, k: int, curve: Trajectory, order: int, limits: Floats) -> Check:
        extremes = curve.extremes(order)
        sizes = np.maximum(-extremes.least, extremes.largest)
        late = extremes.largest >= -extremes.least
        times = np.where(late, extremes.largest_time, extremes.least_time)

        def place(segment: int, axis: int) -> str:
            return f"robot {k}, axis {axis} (t = {times[segment, axis]:.6g} s)"

        return Check.within(name, sizes, limits, unit, place, tolerance)

    for order, limits in ((1, model.velocity_limit), (2, model.acceleration_limit)):
        name, unit = f"{derivative_name(order)} within its limit", derivative_unit(order)
        checks = [check(name, unit, k, curve, order, limits) for k, curve in flights]
        yield Check.worst_of(checks, Check.scaled(name, "", 0.0, unit, "", tolerance, 0.0))


def _inside(model: MissionData, flights: Flights, tolerance: float) -> Check:
    """Return the check that the curves stay inside the bounds, at exact extremes."""
    low, high = model.bounds[:2], model.bounds[2:]

    def overshoot(k: int, curve: Trajectory) -> tuple[Any, ...]:
        extremes = curve.extremes(0)
        excess = np.maximum(low - extremes.least, extremes.largest - high)
        return excess, model.cell, lambda s, axis: f"robot {k}, segment {s}", _digits(model)

    return _worst(
        "inside the bounds", "m", tolerance, [overshoot(k, curve) for k, curve in flights]
    )


def _collision(model: MissionData, flights: Flights, tolerance: float) -> Check:
    """Return the check of the distance between curves and obstacles."""
    name = "radius away from obstacles"
    slack = tolerance * model.cell + _digits(model)
    if not flights:
        return _worst(name, "m", tolerance, [])
    depth, robot, time, place = deepest(
        [pieces_of(entry, k) for k, entry in flights], model.solids, model.radius, slack, model.cell
    )
    where = (
        f"robot {robot} (t = {time:.6g} s), x {place[0]:.6g}, y {place[1]:.6g} m"
        if depth > 0
        else ""
    )
    robots = [(depth, model.cell, where, _digits(model))]
    return _worst(name, "m", tolerance, robots, limit=model.radius)


def _separation(model: MissionData, flights: Flights, tolerance: float) -> Check:
    """Return the check of the distance between robots under way; a report only for separation 0.

    Before its departure and after its return a robot waits in the depot's queue, off the map. This
    is the only exemption.
    """
    name = "distance between robots" if model.separation > 0 else "separation not required"
    # The search error adds to the tolerance, so it must be much smaller.
    slack = SEARCH_SHARE * (tolerance * model.cell + _digits(model))
    closest = nearest([entry for _, entry in flights], slack)
    where = "never two under way at one time"
    if np.isfinite(closest.distance):
        a, b = (flights[k][0] for k in closest.pair)
        where = f"robots {a} and {b} (t = {closest.time:.6g} s), {closest.distance:.6g} m apart"
    where += "; before departure and after return robots wait in the depot's queue"
    robots = [(model.separation - closest.distance, model.cell, where, 2 * _digits(model))]
    return _worst(name, "m", tolerance, robots, limit=model.separation)


def _moving(model: MissionData, flights: Flights, tolerance: float) -> Iterator[Check]:
    """Yield the check of the distance between robots and moving obstacles, if there are any."""
    if not model.moving:
        return
    slack = SEARCH_SHARE * (tolerance * model.cell + _digits(model))
    robots: list[tuple[Any, ...]] = []
    begin = min((float(entry.times[0]) for _, entry in flights), default=0.0)
    end = max((float(entry.times[-1]) for _, entry in flights), default=1.0)
    for k, obstacle in enumerate(model.moving):
        curves = [obstacle.during(begin, end), *(entry for _, entry in flights)]
        pairs = np.array([[0, row] for row in range(1, len(curves))], int).reshape(-1, 2)
        closest = nearest(curves, slack, pairs)
        if np.isfinite(closest.distance):
            where = f"robot {flights[closest.pair[1] - 1][0]} and moving obstacle {k} "
            where += f"(t = {closest.time:.6g} s), {closest.distance:.6g} m apart"
            needed = model.radius + obstacle.radius
            # Rounding at that time, as the obstacle may be far away at other times.
            motion = curves[0]
            terms = Trajectory(motion.times, np.abs(motion.coefficients))(closest.time)
            noise = 2 * max(_digits(model), DIGITS * float(terms.max()))
            robots.append((needed - closest.distance, model.cell, where, noise))
    yield _worst("distance to moving obstacles", "m", tolerance, robots)


def _departures(model: MissionData, flights: Flights, tolerance: float) -> Iterator[Check]:
    """Yield the check that no robot departs before time 0, if the clock matters."""
    if not model.moving and model.objective is not MissionObjective.MAKESPAN:
        return
    pause = _scale(model, 0) / _scale(model, 1)
    robots = [(-entry.times[0], pause, f"robot {k}", 0.0) for k, entry in flights]
    yield _worst("departures at time 0 or later", "s", tolerance, robots)
