"""Earliest interception by a UAV of a point that moves along a line with constant velocity.

The frame is that of the UAV at its start, mirrored so that the point is on the left. Time is
divided at the moments when the point crosses the line ahead or a circle of radius r or 3 r about
the centre of a turning circle. Between two of these the point stays in one of three regions (see
:mod:`.elongation`):

- Outside the turning circle and without a gap, it is met once LS is short enough. The slope of that
  length along the point's path is at most the point's speed, so the length flown minus the path
  length increases: it has at most one root, which is bracketed.
- With a gap, it is met when LS is short enough, or later at the edges of the gap.
- Inside the turning circle, it is met when RL is short enough.

The lengths of RL at the edges change by at most √8 r / √(9 r² - D²) times the point's displacement,
where D is the distance from the far circle's centre. This is unbounded towards D = 3 r. Along σ
with t = middle - half cos σ, where t runs from one crossing of the circle of radius 3 r to the
other, they change by at most √8 r dσ. This bounds a step in σ that cannot skip a root, so stepping
finds the first root. The two families of edges join the shortest length continuously where the
point crosses the turning circle, so that crossing needs no special case.

With a given final heading the same holds for each of the six words. Between the times at which one
of its turns is 0, the length of C S C has a slope of at most the point's speed. The length of C C C
changes by at most 4 r dσ, modulo 2 π r, for σ between crossings of the circle of radius 4 r.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...jit import kernel
from .dubins import FULL, local, norm, outside, relaxed_local, right_left, sine_and_lift, word_local
from .elongation import has_gap, left_straight_whole, reachable

__all__ = ["intercept", "intercept_heading"]

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
#: Distance from a jump of a word's length at which the length is evaluated, relative to the time.
MARGIN = 1e-9
#: Error of a length, relative to itself plus the radius, up to which a root of a word is accepted.
EXACT = 1e-11


class Chase(NamedTuple):
    """Point at (u, v) with velocity (du, dv), ahead and to the left of the UAV at its start, in m and m/s.

    The UAV has `speed` (m/s) and turning radius `r` (m). `phi` is the heading at the end, `sin` its sine, `lift` 1
    minus its cosine, and `slack` the rounding error of the coordinates (m).
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
    """Return a time in [`low`, `high`] at which the excess, `below` and `above` there, changes its sign.

    The Illinois method is a secant method that halves the value at a bound which is retained.
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
    """Return the root of an excess that rises with the difference of the speeds; `low` within reach of LS."""
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
def pass_circle(x: float, y: float, circle: float, c: Chase) -> tuple[float, float]:
    """Return the time of the closest approach to a centre, and half the time within a circle."""
    pace = norm(c.du, c.dv)
    aside = (x * c.dv - y * c.du) / pace
    half = math.sqrt(max(circle * circle - aside * aside, 0.0)) / pace
    return -(x * c.du + y * c.dv) / (pace * pace), half


@kernel
def stepping(
    kind: int, low: float, high: float, x: float, y: float, circle: float, rate: float, c: Chase
) -> float:
    """Return the first time in [`low`, `high`] with a non-negative excess, or inf.

    Until then the point, (`x`, `y`) from the centre at time 0, is within the radius `circle`, and the length changes
    by at most `rate` (m) with σ. Words are compared modulo full circles in the steps, and exactly at the root.
    """
    middle, half = pass_circle(x, y, circle, c)
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
    middle, half = pass_circle(x, y, circle, c)
    if not half > 0.0:
        return math.inf, math.inf
    return middle - half, middle + half


@kernel
def sooner(t: float, candidate: float, best: float) -> float:
    """Return the candidate if it is between `t` and the current best, otherwise the current best."""
    return candidate if t < candidate < best else best


@kernel
def next_cut(t: float, c: Chase) -> float:
    """Return the next time after `t` at which the point enters or leaves a region, or inf."""
    best = math.inf
    if c.dv != 0.0:
        best = sooner(t, -c.v / c.dv, best)
    if c.du != 0.0:
        best = sooner(t, -c.u / c.du, best)
    for side in (-1.0, 1.0):
        for size in (1.0, 3.0):
            first, second = crossings(c.u, c.v - side * c.r, size * c.r, c)
            best = sooner(t, second, sooner(t, first, best))
    return best


@kernel(interpretable=True)
def intercept(
    x0: float, y0: float, h0: float, t0: float, px: float, py: float, vx: float, vy: float,
    speed: float, r: float,
) -> float:  # fmt: skip
    """Return the earliest time (s) at which the UAV can meet a moving point with any heading.

    A path of length ``speed * (t - t0)`` to the point at time ``t`` exists, and none exists
    earlier. Exception: the length flown exceeds the edge of a gap by less than 1e-7 r for a short
    time. The result is at least `t0`, and inf if the point is at least as fast as the UAV.

    The UAV starts at (x0, y0, h0), in m and rad, at time `t0` (s), with `speed` (m/s) and turning radius `r` (m). The
    point is at (px, py) at time 0 and has the velocity (vx, vy), in m/s.
    """
    u, v, slack = local(x0, y0, h0, px + vx * t0, py + vy * t0, r)
    du, dv, _ = local(0.0, 0.0, h0, vx, vy, 0.0)
    first, second, _ = relaxed_local(u, v, r, slack)
    pace = norm(du, dv)
    if first + second <= slack:
        return t0
    if pace == 0.0 or pace >= speed:
        return t0 + (first + second) / speed if pace < speed else math.inf
    still = Chase(u, v, du, dv, speed, r, 0.0, 0.0, 0.0, slack)
    rate = math.sqrt(8.0) * r
    t = 0.0
    while t < math.inf:
        cut = next_cut(t, still)
        middle = 0.5 * (t + cut)
        if not cut < math.inf:
            middle = 2.0 * t + (norm(u, v) + r) / speed
        side = 1.0 if v + dv * middle >= 0.0 else -1.0
        c = Chase(u, side * v, du, side * dv, speed, r, 0.0, 0.0, 0.0, slack)
        there_u, there_v = u + du * middle, abs(v + dv * middle)
        kind = LINE
        if outside(there_u, there_v, r, 0.0) < 0.0:
            kind = MAJOR
        elif has_gap(there_u, there_v, r, slack):
            kind = AHEAD if excess(AHEAD, t, c) < 0.0 else EDGES
        if kind >= AHEAD:
            root = rising(kind, t, cut, c)
        else:
            root = stepping(kind, t, cut, c.u, c.v + r, 3.0 * r, rate, c)
        if root < math.inf and reachable(u + du * root, v + dv * root, r, speed * root, slack):
            return t0 + root
        # The root is a jump without a path, at which the point passes the start.
        t = root if t < root < cut else cut
    return math.inf


@kernel
def next_turn(word: int, t: float, c: Chase) -> float:
    """Return the next time at which a turn of a C S C word is 0 or the word appears or vanishes."""
    mirror = -1.0 if word == 1 or word == 3 else 1.0
    sin, cos = mirror * c.sin, 1.0 - c.lift
    y, dy = mirror * c.v, mirror * c.dv
    best = math.inf
    if word < 2:
        x, y, offset = c.u - c.r * sin, y - c.r * c.lift, 0.0
    else:
        x, y, offset = c.u + c.r * sin, y + c.r * c.lift, 2.0 * c.r * c.lift
        first, second = crossings(x, mirror * (y - 2.0 * c.r), 2.0 * c.r, c)
        best = sooner(t, second, sooner(t, first, best))
    if dy != 0.0:
        best = sooner(t, -y / dy, best)
    slope = dy * cos - c.du * sin
    if slope != 0.0:
        best = sooner(t, (x * sin - y * cos - offset) / slope, best)
    return best


@kernel
def earliest(word: int, t: float, end: float, c: Chase) -> float:
    """Return the first time in [`t`, `end`] at which word and flight are equally long, or inf."""
    if word >= 4:
        mirror = 1.0 if word == 4 else -1.0
        x, y = c.u + mirror * c.r * c.sin, c.v + mirror * c.r * c.lift
        first, second = crossings(x, y, 4.0 * c.r, c)
        low, high = max(t, first, math.pi * c.r / c.speed), min(end, second)
        if not low < high:
            return math.inf
        return stepping(word, low, high, x, y, 4.0 * c.r, 4.0 * c.r, c)
    root = math.inf
    while t < end and not root < math.inf:
        cut = min(next_turn(word, t, c), end)
        margin = MARGIN * min(cut - t, t + (norm(c.u, c.v) + c.r) / c.speed)
        root = rising(word, t + margin, cut - margin, c)
        t = cut
    return root


@kernel(interpretable=True)
def intercept_heading(
    x0: float, y0: float, h0: float, t0: float, px: float, py: float, vx: float, vy: float,
    h1: float, speed: float, r: float,
) -> tuple[float, int]:  # fmt: skip
    """Return the earliest time (s) at which the UAV can meet a moving point with a given heading, and the word.

    The arguments are those of :func:`intercept`, and the final heading `h1` (rad). The time is the earliest at
    which one of the six words, a row of ``dubins.WORDS``, is as long as the length flown; inf if the search finds
    none. It may miss roots within 1e-9 of the time from a jump of a word's length, and a C C C word that is
    feasible for less than 0.3 r of the length flown.
    """
    u, v, slack = local(x0, y0, h0, px + vx * t0, py + vy * t0, r)
    du, dv, _ = local(0.0, 0.0, h0, vx, vy, 0.0)
    phi = h1 - h0
    sin, lift = sine_and_lift(phi)
    pace = norm(du, dv)
    best, best_word = math.inf, 0
    if not pace < speed:
        return best, best_word
    c = Chase(u, v, du, dv, speed, r, phi, sin, lift, slack)
    begin = norm(u, v) / (speed + pace)
    close = pace == 0.0 or norm(u, v) <= slack
    for word in range(6):
        length = -excess(word, 0.0, c) if close else math.inf
        if pace == 0.0 or length <= slack:
            root = length / speed
        else:
            root = earliest(word, begin, best, c)
            if root < math.inf and abs(excess(word, root, c)) > EXACT * (speed * root + r):
                root = math.inf
        if root < best:
            best, best_word = root, word
    return t0 + best, best_word
