"""Paths of a given length to a point with free final heading, and the lengths that no path has.

The target is at (u, v) in the start's frame with v >= 0, after mirroring if necessary. The *near*
circle is the left turning circle, the *far* circle the right one. Two families of paths cover all
attainable lengths. The length is non-decreasing along each family; its slope is 1 minus the cosine
of the last turn:

- S(s) L S, and S(s) R S: a straight line of any length s >= 0 before the turn;
- R(α) L S: a turn by α away from the target before the turn towards it.

The following was derived here and compared with local searches over paths of 16 arcs of any
curvature:

1. Outside the near circle and not ahead (u <= 0), or with v >= 2 r, S L S attains every length from
   the shortest one on.
2. Otherwise R L S attains every length up to ``far``, the length of RS, and S R S every length from
   ``far`` on. For a target straight ahead ``far`` includes a full circle: u + 2 π r.
3. R L S covers all α if the target is farther than 3 r from the far circle's centre. Within that
   distance the angles α for which the target is inside the turned left circle are excluded. At the
   ends of the excluded interval the path is RL, with a last turn of less than half a circle (length
   ``low``) or more (length ``high``).
4. Inside the near circle the shortest path is RL with a turn of more than half a circle, and every
   longer length is attained.
5. Ahead, outside the near circle and within 3 r of the far circle's centre no path of bounded
   curvature has a length between ``low`` and ``high``. ``high`` is less than ``far``, so some
   lengths below ``far`` exist. At the start itself the gap is (0, 2 π r). LR, which turns towards
   the target first, attains no length beyond ``low``.

Z. Chen, K. Wang and Y. Lu, arXiv 2109.02125, solve the problem with given headings at both ends.
"""

from __future__ import annotations

import math

from ...jit import kernel
from .dubins import FULL, NO_TURN, L, R, S, local, outside, relaxed_local, right_left, tangent

__all__ = ["elongated", "gap_local", "has_gap", "left_straight_whole", "reachable"]

#: Families of paths by their first part: S then L, S then R, R then L.
TOWARDS, AWAY, FIRST_AWAY = 0, 1, 2
#: Maximum number of steps of the search. Bisection alone needs about 60.
STEPS = 200

Piece = tuple[float, float, float, float]


@kernel
def left_straight_whole(u: float, v: float, r: float) -> tuple[float, float, float]:
    """Return turn (rad) and line (m) of LS to a point not inside the left circle, and the cosine.

    Unlike :func:`.dubins.left_straight`, it returns a full circle if rounding yields one.
    """
    b = math.sqrt(max(u * u + v * v - 2.0 * r * v, 0.0))
    rise, run = tangent(u, v, b, r)
    angle = math.atan2(rise, run)
    size = math.sqrt(rise * rise + run * run)
    return angle if angle >= 0.0 else angle + FULL, b, run / size if size > 0.0 else 1.0


@kernel
def far_turn(u: float, v: float, r: float) -> tuple[float, float, float]:
    """Return turn, line and cosine of RS to a point with `v` >= 0; the turn is at least π."""
    angle, b, cos = left_straight_whole(u, -v, r)
    # An angle of 0 represents a full circle.
    return angle if angle > 1.0 or r == 0.0 else angle + FULL, b, cos


@kernel
def member(family: int, x: float, u: float, v: float, r: float) -> Piece:
    """Return turn, line, length and slope of the length for member `x` (m or rad) of a family."""
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
    """Return the member of a family with length `d`, by Newton's method with bisection: x, turn and line."""
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
    """Return True if no path to (`u`, `v`), `v` >= 0, attains some length above the shortest."""
    square = u * u + v * v
    return (
        r > 0.0
        and u >= -slack
        and outside(u, v, r, slack) >= 0.0
        and square + 2.0 * r * v < 8.0 * r * r
    )


@kernel
def gap_local(u: float, v: float, r: float, slack: float) -> tuple[float, float]:
    """Return the open interval of lengths above the shortest that no path to (`u`, `v`) attains.

    The path begins at the origin with heading 0. The ends are inf if every length is attained.
    """
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
    """Return True if a path of length `d` from the origin with heading 0 to (`u`, `v`) exists."""
    first, second, _ = relaxed_local(u, v, r, slack)
    low, high = gap_local(u, v, r, slack)
    slight = NO_TURN * (d + r) + slack
    return d >= first + second - slight and (d <= low + slight or d >= high - slight)


@kernel(interpretable=True)
def elongated(
    x0: float, y0: float, h0: float, x1: float, y1: float, r: float, d: float
) -> tuple[float, float, float, int, int, int, bool]:
    """Return a path of length `d` (m) to a point with free final heading.

    The path begins at (x0, y0, h0) and ends at (x1, y1), in m and rad. With a turning radius `r` (m) of 0 it is a
    straight line along the heading, followed by one to the target. The result is the lengths (m) of three
    primitives, the signs of their curvatures, and whether the path exists; otherwise the lengths are 0.
    Lengths that miss an attainable length by rounding alone are accepted.
    """
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    side = L if v >= 0.0 else R
    first, second, word = relaxed_local(u, v, r, slack)
    shortest = first + second
    v = abs(v)
    slight = NO_TURN * (d + r) + slack
    if not d < math.inf or d < shortest - slight:
        return 0.0, 0.0, 0.0, S, S, S, False
    if d <= shortest + slack:
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
