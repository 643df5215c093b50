"""Excess of the length flown over the length of a path to a moving point, and its roots.

Kernels of :mod:`.interception`, which derives the bounds on the steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...jit import kernel
from .dubins import FULL, norm, right_left, word_local
from .elongation import left_straight_whole

__all__ = ["AHEAD", "EDGES", "LINE", "MAJOR", "Chase", "crossings", "excess", "rising", "stepping"]

#: Additional kinds to the words 0 to 5: LS, LS to a point ahead, the longer RL, an edge of the gap.
LINE, AHEAD, MAJOR, EDGES = -1, -2, -3, -4
#: Smallest steps, in turning radii of change, for edges and for words. Their growth factor ensures
#: that the steps terminate.
FINEST, COARSE, GROWTH = 1e-7, 2e-2, 1.05
#: Smallest step if a word's length is off by full circles, in turning radii.
JUMP = 0.3
#: Error of a length, relative to itself plus the radius, at which the root search stops.
ROUNDING = 1e-15
#: Maximum number of steps of the root search.
STEPS = 100


class Chase(NamedTuple):
    """Position and velocity of the point in the frame of the UAV at its start.

    Attributes
    ----------
    u, v : float
        Coordinates of the point at the start, ahead and to the left, in m.
    du, dv : float
        Velocity of the point, ahead and to the left, in m/s.
    speed, r : float
        Speed (m/s) and turning radius (m) of the UAV.
    phi, sin, lift : float
        Heading at the end, its sine, and 1 minus its cosine.
    slack : float
        Rounding error of the coordinates, in m.
    """

    u: float
    v: float
    du: float
    dv: float
    speed: float
    r: float
    phi: float
    sin: float
    lift: float
    slack: float


@kernel
def excess(kind: int, t: float, c: Chase) -> float:
    """Return the length flown at `t` minus the path length, in m: negative before the encounter."""
    u, v, flown = c.u + c.du * t, c.v + c.dv * t, c.speed * t
    if kind >= 0:
        first, second, third = word_local(u, v, c.phi, c.sin, c.lift, c.r, c.slack, kind)
        return flown - (first + second + third)
    v = max(v, 0.0)
    if kind == AHEAD:
        u = max(u, 0.0)
    if kind >= AHEAD:
        angle, b, _ = left_straight_whole(u, v, c.r)
        return flown - c.r * angle - b
    first, second = right_left(u, v, c.r, True)
    beyond = flown - c.r * (first + second)
    if kind == EDGES:
        first, second = right_left(u, v, c.r, False)
        beyond = max(beyond, c.r * (first + second) - flown)
    return beyond


@kernel
def root(kind: int, low: float, below: float, high: float, above: float, c: Chase) -> float:
    """Return a time in [`low`, `high`] at which the excess changes its sign.

    The excess is `below` at `low` and `above` at `high`. Uses the Illinois method, a secant method
    that halves the value at a bound which is retained.
    """
    last = 0
    for _ in range(STEPS):
        x = high - above * (high - low) / (above - below)
        if not low < x < high:
            return low if x <= low else high
        value = excess(kind, x, c)
        if abs(value) <= ROUNDING * (c.speed * x + c.r):
            return x
        if (value < 0.0) == (below < 0.0):
            low, below = x, value
            above *= 0.5 if last < 0 else 1.0
            last = -1
        else:
            high, above = x, value
            below *= 0.5 if last > 0 else 1.0
            last = 1
    return high


@kernel
def rising(kind: int, low: float, high: float, c: Chase) -> float:
    """Return the root of an excess whose slope is at least the difference of the speeds, or inf.

    The root is `low` if the point is within reach of LS from the beginning.
    """
    below = excess(kind, low, c)
    if not below < 0.0:
        return low if below == 0.0 or kind < 0 else math.inf
    pace = norm(c.du, c.dv)
    if low - below / (c.speed + pace) > high:
        return math.inf
    rounding = 1e-14 * (c.speed * low + c.r) + c.slack
    top = low + (1.0 + 1e-9) * (rounding - below) / (c.speed - pace)
    high = min(high, top)
    above = excess(kind, high, c)
    if above < 0.0 or not low < high:
        return math.inf
    return root(kind, low, below, high, above, c)


@kernel
def stepping(
    kind: int, low: float, high: float, x: float, y: float, circle: float, rate: float, c: Chase
) -> float:
    """Return the first time in [`low`, `high`] with a non-negative excess, or inf.

    Parameters
    ----------
    kind : int
        Word 0 to 5, or one of the kinds of this module.
    low, high : float
        Times (s) between which the point is within the circle.
    x, y, circle : float
        Position of the point at time 0 relative to the centre of the circle, and the radius of the
        circle, all in m.
    rate : float
        Upper bound on the change of the path length with σ, in m.
    c : Chase
        Motion of the point and of the UAV. The excess of a word is compared modulo full circles
        during the steps, and exactly at the root.
    """
    pace = norm(c.du, c.dv)
    aside = (x * c.dv - y * c.du) / pace
    half = math.sqrt(max(circle * circle - aside * aside, 0.0)) / pace
    middle = -(x * c.du + y * c.dv) / (pace * pace)
    t = low
    near = max((t - middle + half) * (middle + half - t), 0.0)
    sigma = math.atan2(math.sqrt(near), middle - t)
    value = excess(kind, t, c)
    floor = (FINEST if kind < 0 else COARSE) * c.r
    while t < high:
        if value >= 0.0 and kind < 0:
            return t
        distance = abs(value)
        if kind >= 0:
            if not distance < math.inf:
                return math.inf
            distance -= FULL * c.r * math.floor(distance / (FULL * c.r))
            distance = min(distance, FULL * c.r - distance)
            if abs(value) > math.pi * c.r:  # only a jump can make this a root
                distance = max(distance, JUMP * c.r)
        distance = max(distance, floor)
        floor *= GROWTH
        # Step that can change the excess by at most the distance, and its duration.
        flown = c.speed * half
        change = flown * math.sin(sigma) + rate
        step = 2.0 * distance / (change + math.sqrt(change * change + 2.0 * flown * distance))
        following = t + 2.0 * half * math.sin(min(sigma + 0.5 * step, math.pi)) * math.sin(
            0.5 * step
        )
        sigma += step
        if not t < following < high or sigma >= math.pi:
            following = high
        after = excess(kind, following, c)
        if (value < 0.0) != (after < 0.0) and (kind < 0 or abs(after - value) < math.pi * c.r):
            return root(kind, t, value, following, after, c)
        t, value = following, after
    return math.inf


@kernel
def crossings(x: float, y: float, circle: float, c: Chase) -> tuple[float, float]:
    """Return both times at which the point, (`x`, `y`) from the centre at 0, is on a circle, or inf."""
    pace = norm(c.du, c.dv)
    aside = (x * c.dv - y * c.du) / pace
    square = circle * circle - aside * aside
    if not square > 0.0:
        return math.inf, math.inf
    half = math.sqrt(square) / pace
    middle = -(x * c.du + y * c.dv) / (pace * pace)
    return middle - half, middle + half
