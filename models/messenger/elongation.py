"""Paths of a wanted length to a point with free end heading, and the lengths that no path has.

The target lies at (u, v) in the start's frame, v >= 0, else all is mirrored. The *near* circle is
the left turning circle, the *far* one the right one. Two families of paths fill what can be had, both
with a length that never falls along the family, its slope being 1 less the cosine of the last turn:

- S(s) L S, and S(s) R S: straight on before the turn, by s from 0 to any length;
- R(α) L S: a turn away before the turn towards the target, by an angle α.

What follows was derived anew and compared with local searches over paths of 16 arcs of any curvature:

1. Outside the near circle and not ahead (u <= 0), or with v >= 2 r, S L S gives every length from
   the shortest one on.
2. Else R L S gives every length up to ``far``, that of RS, and S R S every one from there on. ``far``
   has a turn of a full circle for a target straight ahead: u + 2 π r.
3. R L S is whole where the target is farther than 3 r from the far circle's centre. Within that the
   angles α for which the target lies in the turned left circle are left out: they end where the path
   is RL, with a last turn below half a circle (length ``low``) or beyond (length ``high``).
4. Inside the near circle RL with the turn beyond half a circle is the shortest path, and nothing is
   missing from there on.
5. Ahead, outside the near circle and within 3 r of the far circle's centre no path of bounded
   curvature has a length between ``low`` and ``high``. ``high`` lies below ``far``, so that not
   all lengths below ``far`` are missing. At the start itself the gap is (0, 2 π r). Turning towards
   the target first, LR, gives no length beyond ``low``.

For both ends given the question is answered by Z. Chen, K. Wang and Y. Lu, arXiv 2109.02125.
"""

from __future__ import annotations

import math

from ...jit import kernel
from .dubins import FULL, NO_TURN, L, R, S, local, outside, relaxed_local, right_left

__all__ = ["elongated", "gap"]

#: Families of paths, by what is done before the last turn and the straight line.
TOWARDS, AWAY, FIRST_AWAY = 0, 1, 2
#: Steps of a search at most; halving alone needs about 60.
STEPS = 200

Piece = tuple[float, float, float, float]


@kernel
def left_straight_whole(u: float, v: float, r: float) -> tuple[float, float, float]:
    """Return turn (rad) and line (m) of LS to a point not inside the left circle, and the cosine.

    Unlike that of a shortest path, a turn is a full circle where rounding says so.
    """
    b = math.sqrt(max(u * u + v * v - 2.0 * r * v, 0.0))
    rise = r * (u - b) + v * b
    if u > 0.0:
        rise = r * min(v * (2.0 * r - v) / (u + b), u) + v * b
    run = u * b + r * (r - v)
    angle = math.atan2(rise, run)
    size = math.sqrt(rise * rise + run * run)
    return angle if angle >= 0.0 else angle + FULL, b, run / size if size > 0.0 else 1.0


@kernel
def far_turn(u: float, v: float, r: float) -> tuple[float, float, float]:
    """Return turn, line and cosine of RS to a point with `v` >= 0: at least half a circle."""
    angle, b, cos = left_straight_whole(u, -v, r)
    # 0 stands for a full circle.
    return angle if angle > 1.0 or r == 0.0 else angle + FULL, b, cos


@kernel
def member(family: int, x: float, u: float, v: float, r: float) -> Piece:
    """Return turn, line, length and its slope for the member `x` (m, or rad) of a family."""
    if family == TOWARDS:
        angle, b, cos = left_straight_whole(u - x, v, r)
        return angle, b, x + r * angle + b, 1.0 - cos
    if family == AWAY:
        angle, b, cos = far_turn(u - x, v, r)
        return angle, b, x + r * angle + b, 1.0 - cos
    sin, cos, half = math.sin(x), math.cos(x), math.sin(0.5 * x)
    angle, b, cosine = left_straight_whole(
        u * cos - v * sin - r * sin, u * sin + v * cos - 2.0 * r * half * half, r
    )
    return angle, b, r * (x + angle) + b, 2.0 * r * (1.0 - cosine)


@kernel
def search(
    family: int, low: float, high: float, u: float, v: float, r: float, d: float
) -> tuple[float, float, float]:
    """Return the member of a family between `low` and `high` that is `d` long: x, turn and line.

    Newton's method, and halving where that leaves the interval or does not shorten it enough.
    """
    exact = 1e-15 * (d + r)
    x = low
    width = high - low
    angle, b, length, slope = member(family, x, u, v, r)
    for step in range(STEPS):
        error = length - d
        if abs(error) <= exact:
            break
        if error < 0.0:
            low = x
        else:
            high = x
        following = x - error / slope if slope > 0.0 else high
        if not low < following < high or (step % 3 == 2 and high - low > 0.5 * width):
            following = 0.5 * (low + high)
        if step % 3 == 2:
            width = high - low
        if following == x or not low < following < high:
            break
        x = following
        angle, b, length, slope = member(family, x, u, v, r)
    return x, angle, b


@kernel
def has_gap(u: float, v: float, r: float, slack: float) -> bool:
    """Return whether lengths are missing for a target at (`u`, `v`), `v` >= 0."""
    square = u * u + v * v
    return (
        r > 0.0
        and u >= -slack
        and outside(u, v, r, slack) >= 0.0
        and square + 2.0 * r * v < 8.0 * r * r
    )


@kernel
def gap_local(u: float, v: float, r: float, slack: float) -> tuple[float, float]:
    """Return :func:`gap` from the origin with heading 0 to (`u`, `v`)."""
    v = abs(v)
    if not has_gap(u, v, r, slack):
        return math.inf, math.inf
    a, c = right_left(u, v, r, False)
    low = r * (a + c)
    a, c = right_left(u, v, r, True)
    high = r * (a + c)
    return (low, high) if low < high else (math.inf, math.inf)


@kernel
def reachable(u: float, v: float, r: float, d: float, slack: float) -> bool:
    """Return whether a path of length `d` leads from the origin with heading 0 to (`u`, `v`)."""
    first, second, _ = relaxed_local(u, v, r, slack)
    low, high = gap_local(u, v, r, slack)
    slight = NO_TURN * (d + r) + slack
    return d >= first + second - slight and (d <= low + slight or d >= high - slight)


@kernel(interpretable=True)
def gap(x0: float, y0: float, h0: float, x1: float, y1: float, r: float) -> tuple[float, float]:
    """Return the open interval of lengths (m) that no path to a point has, beyond the shortest one.

    Parameters
    ----------
    x0, y0, h0 : float
        Start: coordinates (m) and heading (rad).
    x1, y1 : float
        Target (m); the heading there is free.
    r : float
        Turning radius (m), 0 or above.

    Returns
    -------
    low, high : float
        inf where no length is missing.
    """
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    return gap_local(u, v, r, slack)


@kernel(interpretable=True)
def elongated(
    x0: float, y0: float, h0: float, x1: float, y1: float, r: float, d: float
) -> tuple[float, float, float, int, int, int, bool]:
    """Return a path of length `d` to a point with free end heading.

    Parameters
    ----------
    x0, y0, h0 : float
        Start: coordinates (m) and heading (rad).
    x1, y1 : float
        Target (m).
    r : float
        Turning radius (m), 0 or above. With 0 the path leads straight on along the heading, and
        from there straight to the target.
    d : float
        Length (m).

    Returns
    -------
    a, b, c : float
        Lengths (m) of the three primitives.
    s1, s2, s3 : int
        The signs of their curvatures.
    ok : bool
        Whether there is such a path; `a`, `b` and `c` are 0 where there is none. Lengths short of the
        possible ones by rounding alone are granted.
    """
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    side = L if v >= 0.0 else R
    first, second, word = relaxed_local(u, v, r, slack)
    least = first + second
    v = abs(v)
    slight = NO_TURN * (d + r) + slack
    if not d < math.inf or d < least - slight:
        return 0.0, 0.0, 0.0, S, S, S, False
    if d <= least + slack:
        if word < 2:
            return first, second, 0.0, side, S, S, True
        return first, second, 0.0, -side, side, S, True
    inside = outside(u, v, r, slack) < 0.0
    if not inside and (v >= 2.0 * r or u < -slack):
        x, angle, b = search(TOWARDS, 0.0, 0.5 * (d + u), u, v, r, d)
        return x, r * angle, b, S, side, S, True
    far, b, _ = far_turn(u, v, r)
    if d >= r * far + b:
        x, angle, b = search(AWAY, 0.0, 0.5 * (d + u), u, v, r, d)
        return x, r * angle, b, S, -side, S, True
    begin, end = 0.0, far
    if inside:
        begin, _ = right_left(u, v, r, True)
    elif has_gap(u, v, r, slack):
        a, c = right_left(u, v, r, False)
        if d <= r * (a + c) + slight:
            end = a
        else:
            begin, c = right_left(u, v, r, True)
            if d < r * (begin + c) - slight:
                return 0.0, 0.0, 0.0, S, S, S, False
    x, angle, b = search(FIRST_AWAY, begin, end, u, v, r, d)
    return r * x, r * angle, b, -side, side, S, True
