"""What a UAV has flown beyond the length that it needs to meet a moving point, and where that is 0.

The kernels of :mod:`.interception`, which says why the steps here are safe.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...jit import kernel
from .dubins import FULL, norm, right_left, word_local
from .elongation import left_straight_whole

__all__ = ["AHEAD", "EDGES", "LINE", "MAJOR", "Chase", "crossings", "excess", "rising", "stepping"]

#: What is asked besides the words 0 to 5: LS, LS to a point ahead, the longer RL, an edge of the gap.
LINE, AHEAD, MAJOR, EDGES = -1, -2, -3, -4
#: Smallest step by what it may change, in turning radii, for edges and words; and its growth, so that
#: steps end.
FINEST, COARSE, GROWTH = 1e-7, 2e-2, 1.05
#: Smallest step likewise where a word's length is off by full circles.
JUMP = 0.3
#: Error of a length, relative to itself and the radius, that no more steps improve.
ROUNDING = 1e-15
#: Steps of a search for a root between bounds, at most.
STEPS = 100


class Chase(NamedTuple):
    """The point's position and velocity in the frame of the UAV at its start.

    Attributes
    ----------
    u, v, du, dv : float
        Ahead and to the left (m, m/s) at the start.
    speed, r : float
        The UAV's (m/s), and its turning radius (m).
    phi, sin, lift : float
        Heading at the end, its sine, and 1 less its cosine.
    slack : float
        Rounding of coordinates (m).
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
    """Return what the UAV has flown at `t` beyond a length (m): negative where it is not yet there."""
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
    """Return a time in [`low`, `high`] where the excess, `below` and `above` there, changes its sign.

    The secant between the bounds; a bound that stays counts half (the Illinois rule).
    """
    last = 0
    for _ in range(STEPS):
        x = high - above * (high - low) / (above - below)
        if not low < x < high:
            return low if x <= low else high
        found = excess(kind, x, c)
        if abs(found) <= ROUNDING * (c.speed * x + c.r):
            return x
        if (found < 0.0) == (below < 0.0):
            low, below = x, found
            above *= 0.5 if last < 0 else 1.0
            last = -1
        else:
            high, above = x, found
            below *= 0.5 if last > 0 else 1.0
            last = 1
    return high


@kernel
def rising(kind: int, low: float, high: float, c: Chase) -> float:
    """Return the root of an excess that rises at least by the speeds' difference; inf without one.

    Where the point has been within reach of LS from the beginning, that is `low`.
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
    """Return the first time in [`low`, `high`] with an excess of 0 or above; inf without one.

    Parameters
    ----------
    kind : int
        What is asked.
    low, high : float
        Times (s) between which the point is within the circle.
    x, y, circle : float
        Where the point is at time 0 seen from the circle's centre, and the circle's radius (m).
    rate : float
        Most that the length asked for changes by with σ (m).
    c : Chase
        Who moves how. A word counts modulo full circles on the way, and in earnest at its end.
    """
    pace = norm(c.du, c.dv)
    aside = (x * c.dv - y * c.du) / pace
    half = math.sqrt(max(circle * circle - aside * aside, 0.0)) / pace
    middle = -(x * c.du + y * c.dv) / (pace * pace)
    t = low
    near = max((t - middle + half) * (middle + half - t), 0.0)
    sigma = math.atan2(math.sqrt(near), middle - t)
    found = excess(kind, t, c)
    least = (FINEST if kind < 0 else COARSE) * c.r
    while t < high:
        if found >= 0.0 and kind < 0:
            return t
        distance = abs(found)
        if kind >= 0:
            if not distance < math.inf:
                return math.inf
            distance -= FULL * c.r * math.floor(distance / (FULL * c.r))
            distance = min(distance, FULL * c.r - distance)
            if abs(found) > math.pi * c.r:  # only a jump may make this a root
                distance = max(distance, JUMP * c.r)
        distance = max(distance, least)
        least *= GROWTH
        # The step that may change the excess by the distance, and the time that it takes.
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
        if (found < 0.0) != (after < 0.0) and (kind < 0 or abs(after - found) < math.pi * c.r):
            return root(kind, t, found, following, after, c)
        t, found = following, after
    return math.inf


@kernel
def crossings(x: float, y: float, circle: float, c: Chase) -> tuple[float, float]:
    """Return when the point, at (`x`, `y`) from a circle's centre at time 0, is on it; inf if never."""
    pace = norm(c.du, c.dv)
    aside = (x * c.dv - y * c.du) / pace
    square = circle * circle - aside * aside
    if not square > 0.0:
        return math.inf, math.inf
    half = math.sqrt(square) / pace
    middle = -(x * c.du + y * c.dv) / (pace * pace)
    return middle - half, middle + half
