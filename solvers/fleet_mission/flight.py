"""Trajectories through corridors: rounded polylines, or minimum snap, and what always fits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime
from ...models.fleet_mission.curves import lengths_of
from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.model import MinimumSnap
from ...models.minimum_snap.trajectory import Trajectory
from ..contract.backend import Answer, Backend, Request, Termination
from .corridor import Corridor
from .rounded import rounded_curve

__all__ = ["Flight", "fly", "programmed", "resting", "slowed", "times_along"]

Floats = NDArray[np.float64]

#: From 0 to 1 in a unit of time with velocity, acceleration and jerk 0 at both ends: powers, and the
#: greatest velocity and acceleration.
REST = np.array([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
REST_SPEED, REST_PUSH = 35.0 / 16.0, 84.0 / 5.0 / np.sqrt(5.0)
#: Share of the least acceleration limit with which times are estimated.
PUSH = 0.25
#: Shares of the time at first, between which the least is searched for, and how often.
LEAST, ROUNDS = 0.4, 4
#: Share by which times exceed what limits ask for, for rounding.
SPARE = 1e-9


class Flight(NamedTuple):
    """A robot's trajectory from time 0, and how it came about.

    `programs` is the number of minimum-snap problems that were solved. `rests` is true if the robot rests at
    every knot, because no better curve was found. `stops` are the knots at the depot, the nodes and the depot
    again.
    """

    trajectory: Trajectory
    programs: int
    rests: bool
    stops: NDArray[np.int64]


def resting(problem: FleetMission, way: Corridor) -> Trajectory:
    """Return the trajectory that goes straight from knot to knot, and rests at each.

    It stays in the boxes, for they are convex.
    """
    if len(way.knots) < 2:
        place = np.zeros((1, 8, 2))
        place[0, 0] = way.knots[0]
        return Trajectory(np.array([0.0, 1.0]), place)
    step = np.diff(way.knots, axis=0)
    coefficients = REST[None, :, None] * step[:, None]
    coefficients[:, 0] = way.knots[:-1]
    size = np.abs(step)
    seconds = np.maximum(
        (REST_SPEED * size / problem.velocity_limit).max(axis=1),
        np.sqrt(REST_PUSH * size / problem.acceleration_limit).max(axis=1),
    )
    # Knots that coincide want a time of their own, too.
    seconds = np.maximum(seconds, 1e-3 * max(float(seconds.max()), 1e-3)) * (1 + SPARE)
    return Trajectory(np.concatenate([[0.0], np.cumsum(seconds)]), coefficients)


def times_along(problem: FleetMission, way: Corridor) -> Floats:
    """Return the durations of the segments of a trapezoid's speed along the polyline of the knots.

    The speed at a knot is what a share of the acceleration allows on the arc that rounds the corner
    within half of the shorter segment beside it.
    """
    top = float(problem.velocity_limit.min())
    push = PUSH * float(problem.acceleration_limit.min())
    step = np.diff(way.knots, axis=0)
    long = np.hypot(*step.T) + 1e-2 * problem.cell
    direction = step / np.maximum(np.hypot(*step.T), 1e-300)[:, None]
    turn = np.arccos(np.clip((direction[:-1] * direction[1:]).sum(axis=1), -1.0, 1.0))
    near = np.minimum(long[:-1], long[1:])
    speed = np.zeros(len(way.knots))
    speed[1:-1] = np.minimum(
        top, np.sqrt(0.5 * push * near / np.maximum(np.tan(0.5 * turn), 1e-12))
    )
    for k in range(len(long)):
        speed[k + 1] = min(speed[k + 1], np.sqrt(speed[k] ** 2 + 2.0 * push * long[k]))
    for k in range(len(long) - 1, -1, -1):
        speed[k] = min(speed[k], np.sqrt(speed[k + 1] ** 2 + 2.0 * push * long[k]))
    before, after = speed[:-1], speed[1:]
    peak = np.minimum(top, np.sqrt(0.5 * (before**2 + after**2) + push * long))
    cruise = long - (2.0 * peak**2 - before**2 - after**2) / (2.0 * push)
    return np.asarray(
        (2.0 * peak - before - after) / push + np.maximum(cruise, 0.0) / np.maximum(peak, 1e-300)
    )


def slowed(problem: FleetMission, one: Trajectory, unit: float = 1.0) -> Trajectory:
    """Return the same curve in the least multiple of its time that keeps the limits.

    Its times are in units of `unit` s.
    """
    shares = []
    for order, limit in ((1, problem.velocity_limit), (2, problem.acceleration_limit)):
        result = one.extremes(order)
        most = np.maximum(-result.least, result.largest).max(axis=0)
        shares.append(float((most / limit).max()) ** (1.0 / order) / unit)
    share = max(*shares, 1e-12) * (1.0 + SPARE)
    return Trajectory(one.times[0] + (one.times - one.times[0]) * share, one.coefficients)


def programmed(backend: Backend, model: MinimumSnap, request: Request, threads: int) -> Answer:
    """Solve a minimum-snap problem as a stage, by a native backend or by a program that is refined."""
    kinds = backend.accepts if isinstance(backend.accepts, tuple) else (backend.accepts,)
    if any(isinstance(model, kind) for kind in kinds):
        return request.within(backend, model, threads=threads)
    written = model.formulate("legendre")
    while True:
        answer = request.within(backend, written.program, threads=None)
        if answer.point is None or answer.termination is not Termination.OPTIMAL:
            return Answer(answer.termination, answer.limit, message=answer.message)
        finer = written.refined(answer.point, request.tolerance)
        if finer is None:
            return Answer(answer.termination, point=written.decode(answer.point))
        written = finer


@np.errstate(all="ignore")  # what overflows is no limit, or refused where it counts
def fly(
    problem: FleetMission, way: Corridor, backend: Backend | None, request: Request, threads: int
) -> Flight:
    """Return a fast rounded curve or, with a backend, the shortest of several minimum-snap curves.

    Minimum snap without limits first, and slowed down until it keeps them; then with limits, and the
    time halved between what is feasible and what is not. Each has been checked by its own model.
    """
    best = Flight(resting(problem, way), 0, True, way.stops)
    if backend is None:
        rounded = rounded_curve(problem, way, request.options["detour"])
        if rounded is None:
            return best
        curve, stops, rests = rounded
        return Flight(slowed(problem, curve), 0, rests, stops)
    if len(way.knots) < 2:
        return best
    points = np.full_like(way.knots, np.inf)
    points[way.stops] = way.knots[way.stops]
    seconds = np.concatenate([[0.0], np.cumsum(times_along(problem, way))])
    # In a unit of time of its own, whatever the limits are.
    unit = seconds[-1] / len(way.lower)
    boxes: dict[str, Any] = {"corridor_lower": way.lower, "corridor_upper": way.upper}
    limits: dict[str, Any] = {
        "velocity_limit": problem.velocity_limit * unit,
        "acceleration_limit": problem.acceleration_limit * unit**2,
    }
    try:
        answer = programmed(backend, MinimumSnap(points, seconds / unit, **boxes), request, threads)
    except OutOfTime:  # its loops could not be compiled
        return best._replace(programs=1)
    if answer.point is None:
        return best._replace(programs=1)
    first = slowed(problem, answer.point, unit)
    low, high, programs, length = LEAST, 1.0, 1, np.inf
    share = 1.0
    for _ in range(ROUNDS):
        model = MinimumSnap(points, first.times * share, **boxes, **limits)
        result: Trajectory | None = first
        if share < 1.0:
            programs += 1
            try:
                result = programmed(backend, model, request, threads).point
            except OutOfTime:
                break
        if result is not None and model.verify(result, tolerance=request.tolerance).ok:
            high = share
            along = float(lengths_of(result, 1e-9).sum())
            if along < length:
                length = along
                curve = Trajectory(result.times * unit, result.coefficients)
                best = Flight(curve, programs, False, way.stops)
        else:
            low = share
        if request.control.stopped:
            break
        share = 0.5 * (low + high)
    return best._replace(programs=programs)
