"""Courses of a flight: a polyline, a corridor of polytopes along it, and first times of its knots."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.flight.corridors import corridor
from ...models.flight.model import Flight
from ...models.minimum_snap.trajectory import Trajectory
from .ways import is_safe

__all__ = [
    "Course",
    "course_of",
    "excess",
    "resting",
    "stretched",
    "times_along",
    "top_speed",
    "typical",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Polytope = tuple[Floats, Floats]

#: From 0 to 1 in a unit of time with velocity, acceleration and jerk 0 at both ends.
REST = np.array([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
#: Inset of the polytopes in cells, for violations within the tolerance of a solver.
INSET = 1e-3
#: Largest first and second derivative of REST.
PEAKS = 2.1875, 7.5132
#: Relative accuracy of a stretched time, that of a segment from rest to rest, and the largest factor.
FINE, COARSE, MOST = 1e-4, 0.02, 1e9


class Course(NamedTuple):
    """Corridor of a flight.

    Parameters
    ----------
    path : ndarray, shape (n, axes)
        Polyline from the start to the goal, m.
    polytopes : list of (normals, offsets)
        Polytope ``normals @ x <= offsets`` of each segment, m.
    knots : ndarray, shape (segments + 1, axes)
        Points of the polyline between consecutive polytopes, m.
    stops : ndarray of int, shape (k + 2,)
        Knots of the start, the waypoints and the goal.
    """

    path: Floats
    polytopes: list[Polytope]
    knots: Floats
    stops: Ints

    def divided(self, pieces: int) -> Course:
        """Return the course with each segment divided into equal parts."""
        shares = np.arange(pieces)[:, None] / pieces
        parts = self.knots[:-1, None] + shares * np.diff(self.knots, axis=0)[:, None]
        knots = np.concatenate([parts.reshape(-1, self.knots.shape[1]), self.knots[-1:]])
        polytopes = [polytope for polytope in self.polytopes for _ in range(pieces)]
        return Course(self.path, polytopes, knots, self.stops * pieces)

    def narrowed(self, model: Flight, inset: float) -> Course:
        """Return the course with faces moved inward by `inset` cells, but not beyond a place of the flight."""
        fixed = dict(zip(self.stops.tolist(), model.places, strict=True))
        smaller = []
        for k, (normals, offsets) in enumerate(self.polytopes):
            near = [fixed[knot] for knot in (k, k + 1) if knot in fixed]
            floor = np.max([normals @ place for place in near], axis=0, initial=-np.inf)
            smaller.append((normals, np.maximum(offsets - inset * model.cell, floor)))
        return self._replace(polytopes=smaller)


def course_of(
    model: Flight, path: Floats, stops: Ints, inset: float = INSET, pause: Any = bool
) -> Course:
    """Return the course along a polyline over free cells, m, with its points at the start, the waypoints and the goal.

    The polytopes have an inset in cells. `pause` is called before each polytope. InvalidData: the corridor has no
    interior.
    """
    polytopes: list[Polytope] = []
    knots, marks = [path[0]], [0]
    for first, last in itertools.pairwise(stops.tolist()):
        if first == last:
            marks.append(len(knots) - 1)
            continue
        leg = corridor(
            model.map,
            path[first : last + 1],
            radius=model.radius,
            bounds=_limits(model),
            pause=pause,
        )
        polytopes += leg.polytopes
        knots += list(leg.knots[1:])
        marks.append(len(knots) - 1)
    return Course(path, polytopes, np.array(knots), np.array(marks)).narrowed(model, inset)


def _limits(model: Flight) -> Any:
    """Return the bounds of the vehicle's centre for the corridor; None if they are infinite."""
    bounds = model.space.bounds
    return bounds.ravel() if np.isfinite(bounds).all() else None


def times_along(model: Flight, knots: Floats) -> Floats:
    """Return durations of the segments along a polyline at a trapezoidal speed, s, shape (n,)."""
    vehicle: Any = model.vehicle
    apart = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    apart = np.maximum(apart, 1e-3 * max(float(apart.sum()), model.cell) / len(apart))
    total = float(apart.sum())
    speed, push = typical(vehicle)
    begin = float(np.linalg.norm(model.start_velocity))
    end = float(np.linalg.norm(model.goal_velocity))
    top = min(max(speed, begin, end), math.sqrt(push * total + 0.5 * (begin**2 + end**2)))
    along = np.concatenate([[0.0], np.cumsum(apart)])
    # Mean speeds of the segments from the squares of speed at their ends.
    squares = np.minimum(begin**2 + 2.0 * push * along, end**2 + 2.0 * push * (total - along))
    speeds = np.sqrt(np.minimum(np.maximum(squares, 0.0), top**2))
    middle = 0.5 * (along[1:] + along[:-1])
    inner = np.minimum(begin**2 + 2.0 * push * middle, end**2 + 2.0 * push * (total - middle))
    peak = np.sqrt(np.minimum(np.maximum(inner, 0.0), top**2))
    return np.asarray(apart / np.maximum((speeds[1:] + speeds[:-1] + peak) / 3.0, 1e-9 * top))


def top_speed(vehicle: Any) -> float:
    """Return the limit of a vehicle's speed along its path, m/s; infinite without one."""
    speeds = [getattr(vehicle, name, None) for name in ("speed", "wheel_speed")]
    return min([value for value in speeds if value is not None], default=math.inf)


def typical(vehicle: Any) -> tuple[float, float]:
    """Return a speed, infinite if it has no limit, and an acceleration within a vehicle's limits."""
    speed = top_speed(vehicle)
    pushes = [getattr(vehicle, name, None) for name in ("acceleration", "wheel_acceleration")]
    push = min([value for value in pushes if value is not None], default=math.inf)
    if getattr(vehicle, "thrust", None) is not None:
        low, high = vehicle.thrust[0] / vehicle.mass, vehicle.thrust[1] / vehicle.mass
        lateral = math.sqrt(high**2 - vehicle.gravity**2)
        if vehicle.tilt is not None:
            lateral = min(lateral, vehicle.gravity * math.tan(vehicle.tilt))
        push = min(push, lateral, high - vehicle.gravity, vehicle.gravity - low)
    if push == math.inf:
        push = 1.0 if speed == math.inf else speed
    return speed, 0.5 * push


def excess(vehicle: Any, curve: Trajectory) -> float:
    """Return the largest violation of the vehicle's limits, relative to the limit."""
    extremes = vehicle.check_curve(curve, exact=False)
    return max((extreme.amount / abs(extreme.limit) for extreme in extremes), default=0.0)


def stretched(
    vehicle: Any,
    curve: Trajectory,
    first: float = 1.0,
    fine: float = FINE,
    stopped: Callable[[], bool] = bool,
) -> Trajectory | None:
    """Return a curve from rest to rest in about the least multiple of its time within the limits.

    The search begins at the multiple `first`, ends at the relative accuracy `fine`, and returns its best multiple
    if `stopped`. None: no multiple is found. Without limits, it is the first one.
    """

    def at(factor: float) -> Trajectory:
        return Trajectory((curve.times - curve.times[0]) * factor, curve.coefficients)

    if not vehicle.limits:
        return at(first)
    low, high = 0.0, first
    while excess(vehicle, at(high)) > 0.0:
        low, high = high, 2.0 * high
        if high > MOST * first:
            return None
    while low == 0.0 and high > first / MOST and not stopped():
        if excess(vehicle, at(0.5 * high)) > 0.0:
            low = 0.5 * high
        else:
            high *= 0.5
    while low > 0.0 and high - low > fine * high and not stopped():
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(vehicle, at(middle)) > 0.0 else (low, middle)
    return at(high)


def resting(model: Flight, path: Floats, stopped: Callable[[], bool] = bool) -> Trajectory | None:
    """Return the curve that follows a polyline and rests at each of its points, if it is allowed."""
    if model.start_velocity.any() or model.goal_velocity.any():
        return None
    if model.start_acceleration.any() or model.goal_acceleration.any() or not is_safe(model, path):
        return None
    parts = []
    speed, push = typical(model.vehicle)
    for first, last in itertools.pairwise(path):
        apart = max(float(np.linalg.norm(last - first)), 1e-6 * model.cell)
        guess = max(PEAKS[0] * apart / speed, math.sqrt(PEAKS[1] * apart / push))
        powers = REST[:, None] * (last - first)
        powers[0] = first
        line = Trajectory(np.array([0.0, 1.0]), powers[None])
        part = stretched(model.vehicle, line, guess, COARSE, stopped)
        if part is None:
            return None
        parts.append(part)
    times = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])])
    return Trajectory(times, np.concatenate([part.coefficients for part in parts]))
