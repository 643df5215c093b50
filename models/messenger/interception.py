"""When a UAV can meet a point that moves along a line with constant velocity.

All is seen from the UAV's start, in its frame, mirrored so that the point is on the left. Time is cut
where the point crosses the line ahead or a circle of radius r or 3 r about the centre of a turning
circle. In between the point stays in one of three regions (see :mod:`.elongation`):

- outside the turning circle and where no length is missing, it is met once LS is short enough. The
  slope of that length along the point's way is at most its speed, so what the UAV has flown beyond it
  only grows: there is one root at most, and a bracket for it;
- where lengths are missing, it is met when LS is short enough or, later than that, at the edges of
  the gap;
- inside the turning circle, it is met when RL is short enough.

The lengths of RL at the edges change at most by √8 r / √(9 r² - D²) times the point's way, D being the
distance from the far circle's centre: beyond every bound towards D = 3 r. Along σ with
t = middle - half cos σ, where t runs from one crossing of the circle of radius 3 r to the other, they
change at most by √8 r dσ. So a step in σ that cannot jump over a root is known everywhere, and
the first root is found by stepping. The two families of edges meet the shortest length without a jump
where the point crosses the turning circle: that jump needs no care of its own.

With the heading at the end given, the same holds for each of the six words: between the times where
one of its turns is 0, the length of C S C has a slope of at most the point's speed, and that of C C C
changes at most by 4 r dσ, modulo 2 π r, for σ between crossings of the circle of radius 4 r.
"""

from __future__ import annotations

import math

from ...jit import kernel
from .chase import AHEAD, EDGES, LINE, MAJOR, Chase, crossings, excess, rising, stepping
from .dubins import local, norm, outside, relaxed_local, sine_and_lift
from .elongation import has_gap, reachable

__all__ = ["intercept", "intercept_heading"]

#: Distance from the jumps of a word's length at which it is evaluated, as a part of the time.
MARGIN = 1e-9
#: Error of a length, relative to itself and the radius, within which a word counts as found.
EXACT = 1e-11


@kernel
def sooner(t: float, candidate: float, best: float) -> float:
    """Return the candidate if it lies between `t` and the best so far, else that."""
    return candidate if t < candidate < best else best


@kernel
def next_cut(t: float, c: Chase) -> float:
    """Return when the point next enters or leaves a region after `t`; inf where it never does."""
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
    x0: float,
    y0: float,
    h0: float,
    t0: float,
    px: float,
    py: float,
    vx: float,
    vy: float,
    speed: float,
    r: float,
) -> float:
    """Return the first time at which the UAV can meet a moving point with any heading.

    A path of length ``speed * (t - t0)`` to where the point is at ``t`` exists then, and at no time
    before, but where the way flown passes the edge of a gap by less than 1e-7 r and falls back.

    Parameters
    ----------
    x0, y0, h0, t0 : float
        Where the UAV starts, m and rad, and when, s.
    px, py : float
        Where the point is at time 0 (m).
    vx, vy : float
        The point's velocity (m/s).
    speed : float
        The UAV's (m/s).
    r : float
        Turning radius (m), 0 or above.

    Returns
    -------
    float
        Time (s), `t0` or later; inf where the point is as fast as the UAV or faster.
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
            found = rising(kind, t, cut, c)
        else:
            found = stepping(kind, t, cut, c.u, c.v + r, 3.0 * r, rate, c)
        if found < math.inf and reachable(u + du * found, v + dv * found, r, speed * found, slack):
            return t0 + found
        # What was found is no path but a jump, where the point passes the start.
        t = found if t < found < cut else cut
    return math.inf


@kernel
def next_turn(word: int, t: float, c: Chase) -> float:
    """Return when next after `t` a turn of a word C S C is 0, or the word begins or ends to exist."""
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
    """Return a time between `t` and `end` at which a word is as long as the way flown; inf if none."""
    if word >= 4:
        mirror = 1.0 if word == 4 else -1.0
        x, y = c.u + mirror * c.r * c.sin, c.v + mirror * c.r * c.lift
        first, second = crossings(x, y, 4.0 * c.r, c)
        low, high = max(t, first, math.pi * c.r / c.speed), min(end, second)
        if not low < high:
            return math.inf
        return stepping(word, low, high, x, y, 4.0 * c.r, 4.0 * c.r, c)
    found = math.inf
    while t < end and not found < math.inf:
        cut = min(next_turn(word, t, c), end)
        margin = MARGIN * min(cut - t, t + (norm(c.u, c.v) + c.r) / c.speed)
        found = rising(word, t + margin, cut - margin, c)
        t = cut
    return found


@kernel(interpretable=True)
def intercept_heading(
    x0: float,
    y0: float,
    h0: float,
    t0: float,
    px: float,
    py: float,
    vx: float,
    vy: float,
    h1: float,
    speed: float,
    r: float,
) -> tuple[float, int]:
    """Return a time at which the UAV can meet a moving point with a given heading, and by which word.

    The earliest time at which one of the six words is as long as the way flown, however late. Missed
    may be what lies within 1e-9 of the time next to a jump of a word's length, and a C C C that is in
    reach for less than 0.3 r of way.

    Parameters
    ----------
    x0, y0, h0, t0, px, py, vx, vy, speed, r : float
        As for :func:`intercept`.
    h1 : float
        Heading at the end (rad).

    Returns
    -------
    float, int
        Time (s) and row of ``dubins.WORDS``; inf where no time was found, or where the point is as
        fast as the UAV or faster.
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
            found = length / speed
        else:
            found = earliest(word, begin, best, c)
            if found < math.inf and abs(excess(word, found, c)) > EXACT * (speed * found + r):
                found = math.inf
        if found < best:
            best, best_word = found, word
    return t0 + best, best_word
