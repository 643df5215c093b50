"""The last leg of an open tour: the heading at its end is free, and the disc is met at its rim.

The shortest paths of a bounded curvature to a point, with any heading there, are an arc and a line,
or two arcs if the point is within a turning circle (Boissonnat and Bui, "Accessibility region for
a car that only moves forwards along optimal paths", INRIA 2181, 1994). A line ends
with the disc's centre straight ahead; a second arc ends such that the centre is on its chord;
a single arc ends as it enters the disc. A vehicle
that moves is met as soon as such a path is as long as the distance flown by then.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.dubins import advance
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import SIGNS, Primitive, TourPlan

__all__ = ["shorten_last_leg", "shortest_to_disc"]

Floats = NDArray[np.float64]

#: Times at which the sign of path minus flight is looked at, and places on an arc.
SAMPLES = 1500
#: Share of the radius that the path goes inside the rim, so that rounding keeps it within.
MARGIN = 1e-10
#: Least gain of a leg, relative to the tour.
GAIN = 1e-13


class Disc(NamedTuple):
    """A disc that moves: centre (m), velocity (m/s) and radius (m), as the UAV begins its leg."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float


def shorten_last_leg(problem: MessengerTour, plan: TourPlan) -> TourPlan | None:
    """Return `plan` with the shortest last leg from its beginning; None if that gains nothing."""
    if problem.closed or problem.turning_radius == 0 or not plan.order:
        return None
    last = len(plan.order) - 1
    before = [one for one in plan.primitives if one.leg < last]
    flown = float(sum(one.length for one in before))
    pose = (float(plan.start[0]), float(plan.start[1]), float(plan.start[2]))
    for one in before:
        pose = advance(*pose, one.length, int(SIGNS[one.turn]), problem.turning_radius)
    vehicle = plan.order[last]
    place = problem.where(vehicle, flown / problem.speed)
    radius = float(problem.radius[vehicle]) * (1.0 - MARGIN)
    px, py = place.tolist()
    vx, vy = problem.velocities[vehicle].tolist()
    disc = Disc(px, py, vx, vy, radius)
    most = plan.length - flown
    path = shortest_to_disc(pose, disc, problem.speed, problem.turning_radius, most)
    length = sum(part for _, part in path or ())
    if path is None or length >= most - GAIN * plan.length:
        return None
    pieces, (x, y, heading) = list(before), pose
    for sign, part in path:
        if part > 0.0:
            pieces.append(Primitive(last, "RSL"[sign + 1], part, heading))
            x, y, heading = advance(x, y, heading, part, sign, problem.turning_radius)
    times, points = plan.times.copy(), plan.points.copy()
    times[last], points[last] = (flown + length) / problem.speed, (x, y)
    return TourPlan(plan.order, times, points, plan.start, tuple(pieces))


def shortest_to_disc(
    pose: tuple[float, float, float], disc: Disc, speed: float, turning: float, most: float
) -> list[tuple[int, float]] | None:
    """Return the signs and lengths (m) of the arcs and lines of the shortest path to a disc.

    Parameters
    ----------
    pose : tuple of 3 float
        x, y (m), heading (rad) at the beginning.
    disc : Disc
        The disc to reach.
    speed : float
        Of the UAV, m/s.
    turning : float
        Least turning radius, m.
    most : float
        Length beyond which no path is looked for, m.

    Returns
    -------
    list of (int, float) or None
        Nothing to fly where the UAV is in the disc; None if no path is shorter than `most`.
    """
    x, y, heading = pose
    if math.hypot(disc.x - x, disc.y - y) <= disc.radius:
        return []
    if not 0.0 < most < math.inf:
        return None
    best: list[tuple[int, float]] | None = None
    for path in _candidates(x, y, heading, disc, speed, turning, most):
        length = sum(part for _, part in path)
        if length <= most:
            best, most = path, length
    return best


def _candidates(
    x: float, y: float, heading: float, disc: Disc, speed: float, turning: float, most: float
) -> Iterator[list[tuple[int, float]]]:
    """Yield paths to the disc: of an arc and a line, of two arcs, and of one arc, for both turns."""
    for sign in (1, -1):
        centre = x - sign * turning * math.sin(heading), y + sign * turning * math.cos(heading)

        def line(t: Floats, sign: int = sign, centre: Any = centre) -> Floats:
            """Return arc and line to the rim of the disc as it is at `t`, m, shape (2, n)."""
            u, v = disc.x + disc.vx * t - centre[0], disc.y + disc.vy * t - centre[1]
            ahead = np.sqrt(np.maximum(u * u + v * v - turning * turning, 0.0))
            # Where the line leaves the circle, seen from its centre.
            angle = np.arctan2(v, u) - sign * np.arctan2(ahead, turning)
            arc = np.mod(sign * (angle - heading) + 0.5 * np.pi, 2.0 * np.pi)
            possible = (ahead >= disc.radius) & (np.hypot(u, v) >= turning)
            return np.where(possible, np.stack([turning * arc, ahead - disc.radius]), np.inf)

        def arcs(t: Floats, sign: int = sign, centre: Any = centre) -> Floats:
            """Return both arcs to the rim of the disc as it is at `t`, m, shape (2, n).

            The second arc is longer than half a circle. The costate is constant: it points from the
            end of the path to the place of the switch and, as the end is free on the rim, to the
            disc's centre. Angles are seen from the centre of the first circle, mirrored so that it
            turns left, and relative to the heading.
            """
            u, v = disc.x + disc.vx * t - centre[0], disc.y + disc.vy * t - centre[1]
            r, reach = turning, disc.radius
            # |centre|^2 = 8 r^2 s^2 - 6 r reach s + r^2 + reach^2 with s the sine of half the arc.
            root = 36.0 * (r * reach) ** 2 - 32.0 * r * r * (r * r + reach**2 - u * u - v * v)
            with np.errstate(all="ignore"):
                s = (np.sqrt(root) + 6.0 * r * reach) / (16.0 * r * r)
            half = np.pi - np.arcsin(np.clip(np.nan_to_num(s), 0.0, 1.0))
            chord = 2.0 * r * np.sin(half) - reach
            switch = sign * (np.arctan2(v, u) - heading) - np.arctan2(
                chord * np.cos(half), r + chord * np.sin(half)
            )
            first = np.mod(switch + 0.5 * np.pi, 2.0 * np.pi)
            possible = (s > 0.0) & (s <= 1.0)
            return np.where(possible, r * np.stack([first, 2.0 * half]), np.inf)

        shapes = ((line, 0), (arcs, -sign))
        for shape, second in shapes:
            parts = _met(shape, most / speed, speed)
            if parts is not None:
                yield [(sign, parts[0]), (second, parts[1])]
        turned = _entered(x, y, heading, sign, disc, speed, turning, most)
        if turned is not None:
            yield [(sign, turned)]


def _met(
    shape: Callable[[Floats], Floats], most: float, speed: float
) -> tuple[float, float] | None:
    """Return the parts of the path at the first time at which the flight is as long as the path."""
    from scipy.optimize import brentq

    def excess(t: Floats) -> Floats:
        return np.asarray(shape(t).sum(axis=0) - speed * t)

    times = np.linspace(0.0, most * (1.0 + 1e-9), SAMPLES)
    over = excess(times)
    for k in np.flatnonzero((over[:-1] > 0) & np.isfinite(over[:-1]) & (over[1:] <= 0)).tolist():
        low, high = float(times[k]), float(times[k + 1])
        t = brentq(lambda t: float(excess(np.array([t]))[0]), low, high, xtol=1e-300, rtol=1e-15)
        first, second = shape(np.array([t]))[:, 0].tolist()
        # At a jump of the length the path does not exist.
        if abs(first + second - speed * t) <= 1e-9 * max(speed * t, 1e-300):
            return first, second
    return None


def _entered(
    x: float, y: float, heading: float, sign: int, disc: Disc, speed: float, turning: float, most: float
) -> float | None:  # fmt: skip
    """Return the length of the arc that enters the disc, m; None if it does not within a circle."""
    from scipy.optimize import brentq

    def outside(arc: Floats) -> Floats:
        turned = heading + sign * arc / turning
        px = x + sign * turning * (np.sin(turned) - math.sin(heading))
        py = y - sign * turning * (np.cos(turned) - math.cos(heading))
        t = arc / speed
        apart = np.hypot(disc.x + disc.vx * t - px, disc.y + disc.vy * t - py)
        return np.asarray(apart - disc.radius)

    lengths = np.linspace(0.0, min(most, 2.0 * math.pi * turning), SAMPLES)
    within = np.flatnonzero(outside(lengths) <= 0.0)
    if not within.size or within[0] == 0:
        return None
    low, high = lengths[within[0] - 1], lengths[within[0]]
    found = brentq(
        lambda arc: float(outside(np.array([arc]))[0]), low, high, xtol=1e-300, rtol=1e-15
    )
    # The end of the bracket that is inside.
    return (
        float(found)
        if float(outside(np.array([found]))[0]) <= 0
        else float(np.nextafter(found, high))
    )
