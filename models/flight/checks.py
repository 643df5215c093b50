"""Independent check of a flight: the curve over time against the map and the vehicle.

The check calls no code of the solvers and uses neither paths nor corridors. Each property is proven for
the whole curve.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..fleet_mission.collision import deepest
from ..fleet_mission.curves import nearest, pieces_of
from ..minimum_snap.bounds import derivative_name, derivative_unit
from ..minimum_snap.motion import heading_jumps
from ..minimum_snap.polynomials import factorials
from ..minimum_snap.trajectory import Trajectory
from ..verification import Check, Verification, check_tolerance
from .data import FlightData
from .plan import FlightPlan

__all__ = ["verify_flight"]

Floats = NDArray[np.float64]

#: Relative rounding error of positions, and of a derivative with respect to its terms.
DIGITS, ULPS = 1e-13, 16 * float(np.finfo(float).eps)
#: Accuracy of the search for the least distance, as a share of the distance tolerance.
SEARCH_SHARE = 0.01


def verify_flight(model: FlightData, plan: FlightPlan, tolerance: float) -> Verification:
    """Compute the objective of `plan` and check every constraint of `model`."""
    check_tolerance(tolerance)
    curve = required("plan", plan, FlightPlan).trajectory
    if curve.dimensions != model.dimensions:
        raise InvalidData(
            f"plan must have {model.dimensions} dimensions, as the model, got {curve.dimensions}",
            field="plan",
        )
    checks = [
        *_ends(model, curve, tolerance),
        *_knots(model, curve, tolerance),
        *_waypoints(model, plan, tolerance),
        _inside(model, curve, tolerance),
        _collision(model, curve, tolerance),
        *_moving(model, curve, tolerance),
        *_vehicle(model, curve, tolerance),
    ]
    objective = curve.duration
    if model.objective == "weighted":
        objective *= model.time_weight
        objective += float(curve.integral_of_square(model.order).sum())
    return Verification(objective, tuple(checks))


def _digits(model: FlightData) -> float:
    """Return the rounding error of a position, m."""
    return DIGITS * float(np.abs(model.places).max())


def _scale(model: FlightData, curve: Trajectory, order: int) -> float:
    """Return the scale of a derivative: a cell, or the largest value on the curve."""
    if order == 0:
        return model.cell
    extremes = curve.extremes(order)
    peak = float(np.maximum(-extremes.least, extremes.largest).max())
    return max(peak, model.cell * curve.duration**-order)


def _noise(curve: Trajectory, order: int) -> Floats:
    """Return the rounding error of a derivative on each segment, shape (segments, axes)."""
    if order > curve.degree:
        return np.zeros((curve.segments, curve.dimensions))
    terms = np.abs(curve.coefficients[:, order:])
    sizes = np.einsum("p,kpd->kd", factorials(curve.degree, order), terms)
    return np.asarray(ULPS * sizes * (curve.durations ** -float(order))[:, None])


def _ends(model: FlightData, curve: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of position, velocity and acceleration at both ends."""
    wanted = (
        (model.start, model.goal),
        (model.start_velocity, model.goal_velocity),
        (model.start_acceleration, model.goal_acceleration),
    )
    for order, pair in enumerate(wanted):
        begins, ends = curve.at_ends(order)
        gaps = np.linalg.norm(np.stack([begins[0], ends[-1]]) - np.stack(pair), axis=1)
        noise = np.linalg.norm(_noise(curve, order)[[0, -1]], axis=1)
        noise += _digits(model) if order == 0 else 0.0
        yield Check.largest(
            f"{derivative_name(order)} at both ends", gaps, _scale(model, curve, order),
            derivative_unit(order), lambda end: ("start", "goal")[end], tolerance, noise=noise,
        )  # fmt: skip


def _knots(model: FlightData, curve: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of jumps at knots, from the position to the derivative of order r - 1."""
    for order in range(model.order):
        begin, end = curve.at_ends(order)
        noise = _noise(curve, order)
        noise = noise[:-1] + noise[1:] + (_digits(model) if order == 0 else 0.0)
        yield Check.largest(
            f"continuity of {derivative_name(order)}", np.abs(end[:-1] - begin[1:]),
            _scale(model, curve, order), derivative_unit(order),
            lambda knot, axis: f"knot {knot + 1} (t = {curve.times[knot + 1]:.6g} s), axis {axis}",
            tolerance, noise=noise,
        )  # fmt: skip


def _waypoints(model: FlightData, plan: FlightPlan, tolerance: float) -> Iterator[Check]:
    """Yield the checks that the curve passes the waypoints in order at the times of the plan."""
    curve, visits = plan.trajectory, plan.visits
    yield Check.count("a visit for each waypoint", abs(len(visits) - len(model.waypoints)))
    if not len(visits) or len(visits) != len(model.waypoints):
        return
    times = np.concatenate([curve.times[:1], visits, curve.times[-1:]])
    yield Check.largest(
        "visits in order", -np.diff(times), curve.duration, "s", lambda k: f"visit {k}", tolerance
    )
    gaps = curve(np.clip(visits, curve.times[0], curve.times[-1])) - model.waypoints
    yield Check.largest(
        "waypoints passed", np.linalg.norm(gaps, axis=1), model.cell, "m",
        lambda k: f"waypoint {k} (t = {visits[k]:.6g} s)", tolerance, noise=_digits(model),
    )  # fmt: skip


def _inside(model: FlightData, curve: Trajectory, tolerance: float) -> Check:
    """Return the check that the curve stays inside the bounds, at exact extremes."""
    low, high = model.space.bounds
    extremes = curve.extremes(0)
    excess = np.maximum(low - extremes.least, extremes.largest - high)
    return Check.largest(
        "inside the bounds", excess, model.cell, "m", lambda s, axis: f"segment {s}, axis {axis}",
        tolerance, noise=_digits(model),
    )  # fmt: skip


def _collision(model: FlightData, curve: Trajectory, tolerance: float) -> Check:
    """Return the check of the distance between the curve and the obstacles."""
    slack = tolerance * model.cell + _digits(model)
    depth, _, time, place = deepest(
        [pieces_of(curve)], model.space.solids, model.radius, slack, model.cell
    )
    at = ", ".join(f"{axis} {x:.6g}" for axis, x in zip("xyz", place, strict=False))
    where = f"t = {time:.6g} s, {at} m" if depth > 0 else ""
    return Check.scaled(
        "radius away from obstacles", "", depth, "m", where, tolerance, model.cell,
        noise=_digits(model), limit=model.radius,
    )  # fmt: skip


def _moving(model: FlightData, curve: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks against moving obstacles: the start at time 0, and the distances."""
    if not model.moving:
        return
    yield Check.scaled(
        "begins at time 0", "", abs(float(curve.times[0])), "s", "start", tolerance, curve.duration
    )
    digits = max(
        _digits(model),
        *(DIGITS * float(np.abs(entry.trajectory.coefficients).max()) for entry in model.moving),
    )
    slack = SEARCH_SHARE * (tolerance * model.cell + digits)
    checks = []
    for k, obstacle in enumerate(model.moving):
        motion = obstacle.during(float(curve.times[0]), float(curve.times[-1]))
        closest = nearest([motion, curve], slack)
        needed = model.radius + obstacle.radius
        checks.append(
            Check.scaled(
                "distance to moving obstacles", "", max(needed - closest.distance, 0.0), "m",
                f"moving[{k}] (t = {closest.time:.6g} s), {closest.distance:.6g} m apart", tolerance,
                model.cell, noise=2 * digits, limit=needed,
            )
        )  # fmt: skip
    yield Check.worst_of(checks, checks[0])


def _vehicle(model: FlightData, curve: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of the vehicle's limits, and of the heading of one that follows its path."""
    if model.vehicle.follows_path:
        yield Check.largest(
            "continuity of heading", heading_jumps(curve), 1.0, "rad",
            lambda knot: f"knot {knot + 1} (t = {curve.times[knot + 1]:.6g} s)", tolerance,
        )  # fmt: skip
    for extreme in model.vehicle.check_curve(curve, exact=False):
        yield Check.scaled(
            f"{extreme.name} within its limit", extreme.equation, max(extreme.amount, 0.0),
            extreme.unit, f"t = {extreme.time:.6g} s", tolerance, abs(extreme.limit),
            limit=extreme.limit,
        )  # fmt: skip
