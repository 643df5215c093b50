"""Shortest paths of bounded curvature in the plane, after Dubins.

Coordinates, lengths and the turning radius are in m, headings in rad, counter-clockwise from the x
axis. A path is a sequence of primitives with their lengths: left turn, straight line or right turn.
The length of a turn is the radius times the angle. With radius 0 a turn has length 0 and leads to
any heading, so paths are straight lines.

If rounding alone decides whether a turn is 0 or a full circle, it is 0. This moves the end of the
path by at most the rounding error of its coordinates.

Sources: L. E. Dubins, American Journal of Mathematics 79 (1957) 497-516, for the six words;
E. J. Cockayne and G. W. C. Hall, SIAM Journal on Control 13 (1975) 197-220, for paths with free
final heading. The formulas use the centres of the turning circles.
"""

from __future__ import annotations

import math

import numpy as np

from ...jit import kernel

__all__ = [
    "RELAXED_WORDS",
    "WORDS",
    "L",
    "R",
    "S",
    "advance",
    "relaxed",
    "relaxed_length",
    "shortest",
    "word_lengths",
]

#: Primitives by the sign of their curvature: left turn, straight line, right turn.
L, S, R = 1, 0, -1
#: Primitives of the six words by code: LSL, RSR, LSR, RSL, RLR, LRL; shape (6, 3).
WORDS = np.array([[L, S, L], [R, S, R], [L, S, R], [R, S, L], [R, L, R], [L, R, L]])
#: Primitives of the words with free final heading by code: LS, RS, LR, RL; shape (4, 2).
RELAXED_WORDS = np.array([[L, S], [R, S], [L, R], [R, L]])

FULL = 2.0 * math.pi
#: Relative rounding error of values computed from coordinates.
ROUNDING = 4e-15
#: Tolerance below a full circle, in rad, within which a turn is set to 0.
NO_TURN = 1e-12

Length3 = tuple[float, float, float]


@kernel
def turn(angle: float, tolerance: float) -> float:
    """Return `angle` modulo a full circle, or 0 if the result is within `tolerance` of a full circle."""
    rest = angle - FULL * math.floor(angle / FULL)
    return 0.0 if rest >= FULL - tolerance else rest


@kernel
def norm(x: float, y: float) -> float:
    """Return the Euclidean norm; bit-identical in interpreted and compiled code."""
    return math.sqrt(x * x + y * y)


@kernel
def local(x0: float, y0: float, h0: float, x1: float, y1: float, r: float) -> Length3:
    """Return the target ahead and to the left of the start, and the rounding error (m)."""
    dx, dy = x1 - x0, y1 - y0
    cos, sin = math.cos(h0), math.sin(h0)
    slack = ROUNDING * (abs(x0) + abs(y0) + abs(x1) + abs(y1) + r)
    return dx * cos + dy * sin, dy * cos - dx * sin, slack


@kernel
def _same(
    u: float, v: float, phi: float, sin: float, lift: float, r: float, slack: float, most: float
) -> Length3:
    """Return the lengths of LSL to (`u`, `v`) with heading `phi`, from the origin with heading 0.

    `sin` is that of `phi`, `lift` 1 minus its cosine. The lengths are inf if the path is at least `most` long.
    """
    x, y = u - r * sin, v - r * lift
    b = norm(x, y)
    if b <= slack:
        return r * turn(phi, NO_TURN), 0.0, 0.0
    if b >= most:
        return math.inf, math.inf, math.inf
    tolerance = NO_TURN + slack / b
    theta = turn(math.atan2(y, x), tolerance)
    return r * theta, b, r * turn(phi - theta, tolerance)


@kernel
def _cross(
    u: float, v: float, phi: float, sin: float, lift: float, r: float, slack: float, most: float
) -> Length3:
    """Return the lengths of LSR to (`u`, `v`) with heading `phi`; inf if LSR does not exist."""
    # The second centre is at (x, w - 2 r) from the first; b² is their distance² minus (2 r)².
    x, w = u + r * sin, v + r * lift
    square = u * u + v * v + 2.0 * r * (u * sin - v * (2.0 - lift)) - 2.0 * r * r * lift
    if square < -4.0 * slack * r or (square < 0.0 and r == 0.0):
        return math.inf, math.inf, math.inf
    b = math.sqrt(max(square, 0.0))
    if b >= most:
        return math.inf, math.inf, math.inf
    rise = 2.0 * r * (x - b) + w * b
    if x > 0.0:  # without cancellation: x² - b² = w (4 r - w)
        rise = 2.0 * r * min(w * (4.0 * r - w) / (x + b), x) + w * b
    tolerance = NO_TURN + slack / (b + 2.0 * r) if b + r > 0.0 else NO_TURN
    theta = turn(math.atan2(rise, x * b + 2.0 * r * (2.0 * r - w)), tolerance)
    return r * theta, b, r * turn(theta - phi, tolerance)


@kernel
def _arcs(
    u: float, v: float, phi: float, sin: float, lift: float, r: float, slack: float, most: float
) -> Length3:
    """Return the lengths of LRL, with the middle arc above half a circle; inf if LRL does not exist."""
    x, y = u - r * sin, v - r * lift
    d = norm(x, y)
    if r == 0.0 or d > 4.0 * r + slack or math.pi * r >= most:
        return math.inf, math.inf, math.inf
    gamma = 2.0 * math.asin(min(0.25 * d / r, 1.0))
    tolerance = NO_TURN + slack / max(d, r)
    a = turn(math.atan2(y, x) + math.pi - 0.5 * gamma, tolerance)
    return r * a, r * (FULL - gamma), r * turn(phi - a - gamma, tolerance)


@kernel
def word_local(
    u: float, v: float, phi: float, sin: float, lift: float, r: float, slack: float, word: int,
    most: float = math.inf,
) -> Length3:  # fmt: skip
    """Return the lengths of `word` to (`u`, `v`) with heading `phi` from the origin with heading 0."""
    if word == 1 or word == 3 or word == 4:  # the word begins with R: use the mirror image
        v, phi, sin = -v, -phi, -sin
    if word < 2:
        return _same(u, v, phi, sin, lift, r, slack, most)
    if word < 4:
        return _cross(u, v, phi, sin, lift, r, slack, most)
    return _arcs(u, v, phi, sin, lift, r, slack, most)


@kernel
def sine_and_lift(phi: float) -> tuple[float, float]:
    """Return the sine of `phi` and 1 minus its cosine."""
    half = math.sin(0.5 * phi)
    return math.sin(phi), 2.0 * half * half


@kernel(interpretable=True)
def word_lengths(
    x0: float, y0: float, h0: float, x1: float, y1: float, h1: float, r: float, word: int
) -> Length3:
    """Return the lengths (m) of the three primitives of a word between two configurations.

    They are inf if the word does not exist. `word` is a row of :data:`WORDS`; the other parameters
    are those of :func:`shortest`.
    """
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    sin, lift = sine_and_lift(h1 - h0)
    return word_local(u, v, h1 - h0, sin, lift, r, slack, word)


@kernel(interpretable=True)
def shortest(
    x0: float, y0: float, h0: float, x1: float, y1: float, h1: float, r: float
) -> tuple[float, float, float, int]:
    """Return the lengths (m) of the shortest path between two configurations, and its word.

    Ties are resolved in favour of the first word.

    Parameters
    ----------
    x0, y0, h0, x1, y1, h1 : float
        Start and end: coordinates (m) and heading (rad).
    r : float
        Turning radius (m), at least 0.

    Returns
    -------
    a, b, c : float
        Lengths (m) of the three primitives.
    word : int
        Row of :data:`WORDS`.
    """
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    phi = h1 - h0
    sin, lift = sine_and_lift(phi)
    best, best_word = (math.inf, math.inf, math.inf), 0
    best_length = math.inf
    for word in range(6):
        lengths = word_local(u, v, phi, sin, lift, r, slack, word, best_length)
        length = lengths[0] + lengths[1] + lengths[2]
        if length < best_length:
            best_length, best, best_word = length, lengths, word
    return best[0], best[1], best[2], best_word


@kernel
def outside(u: float, v: float, r: float, slack: float) -> float:
    """Return the tangent length from (`u`, `v`) to the left circle; -1 if the point is inside."""
    power = u * u + v * v - 2.0 * r * v
    if power < 0.0 and (power < -2.0 * r * slack or r == 0.0):
        return -1.0
    return math.sqrt(max(power, 0.0))


@kernel
def tangent(u: float, v: float, b: float, r: float) -> tuple[float, float]:
    """Return sine and cosine, up to a factor, of the turn of LS to (`u`, `v`) with a line of length `b`."""
    rise = r * (u - b) + v * b
    if u > 0.0:  # without cancellation: u² - b² = v (2 r - v)
        rise = r * min(v * (2.0 * r - v) / (u + b), u) + v * b
    return rise, u * b + r * (r - v)


@kernel
def left_straight(u: float, v: float, b: float, r: float, slack: float) -> float:
    """Return the turning angle of LS to (`u`, `v`); `b` is the length of the straight line."""
    rise, run = tangent(u, v, b, r)
    tolerance = NO_TURN + slack / (b + r) if b + r > 0.0 else NO_TURN
    return turn(math.atan2(rise, run), tolerance)


@kernel
def right_left(u: float, v: float, r: float, major: bool) -> tuple[float, float]:
    """Return the angles of RL to (`u`, `v`), `v` >= 0, at most 3 r from the right circle's centre.

    `major` selects a second turn above half a circle. Otherwise the point is ahead and outside the left circle.
    The triangle of both centres and the point has sides 2 r and r.
    """
    power = u * u + v * v + 2.0 * r * v  # the third side² minus r²
    area = math.sqrt(max((8.0 * r * r - power) * power, 0.0))
    ahead = math.atan2(u, v + r)
    beta = math.atan2(area, 4.0 * r * r + power)
    delta = math.atan2(area, 4.0 * r * r - power)
    if major:
        return max(ahead + beta, 0.0), FULL - delta
    return max(ahead - beta, 0.0), delta


@kernel
def relaxed_local(u: float, v: float, r: float, slack: float) -> tuple[float, float, int]:
    """Return :func:`relaxed` to (`u`, `v`) from the origin with heading 0."""
    mirrored = v < 0.0
    v = abs(v)
    b = outside(u, v, r, slack)
    if b >= 0.0:
        return r * left_straight(u, v, b, r, slack), b, 1 if mirrored else 0
    first, second = right_left(u, v, r, True)
    return r * first, r * second, 2 if mirrored else 3


@kernel(interpretable=True)
def relaxed(
    x0: float, y0: float, h0: float, x1: float, y1: float, r: float
) -> tuple[float, float, int]:
    """Return the lengths (m) of the shortest path to a point with free final heading, and its word.

    To a point on the left the path is LS. If the point is inside the left turning circle, the path
    is RL with a second turn of more than half a circle. Points on the right use the mirror image.
    The parameters are those of :func:`shortest`; the word is a row of :data:`RELAXED_WORDS`.
    """
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    return relaxed_local(u, v, r, slack)


@kernel(interpretable=True)
def relaxed_length(x0: float, y0: float, h0: float, x1: float, y1: float, r: float) -> float:
    """Return the total length (m) of :func:`relaxed`, which has the same parameters."""
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    a, b, _ = relaxed_local(u, v, r, slack)
    return a + b


@kernel(interpretable=True)
def advance(x: float, y: float, h: float, s: float, sign: int, r: float) -> Length3:
    """Return coordinates (m) and heading (rad, not wrapped) after a primitive of length `s` (m).

    `sign` is the sign of its curvature. With a turning radius `r` (m) of 0, a turn keeps position and heading:
    its length does not determine its angle.
    """
    if sign == 0:
        return x + s * math.cos(h), y + s * math.sin(h), h
    if r == 0.0:
        return x, y, h
    half = 0.5 * sign * s / r
    chord = 2.0 * r * math.sin(0.5 * s / r)
    return x + chord * math.cos(h + half), y + chord * math.sin(h + half), h + 2.0 * half
