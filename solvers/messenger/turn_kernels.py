"""Kernels of the bounds: additional length due to turns of a curvature-limited flight.

For a flight of length L_k from stop to stop, with headings theta(s),
``lambda_k L_k = u_k . (Q_k - Q_{k-1}) + integral of lambda_k - u_k . e(theta(s)) ds``. The dual of
:mod:`.bound_kernels` bounds the sum of the first terms, and uses only the sign of the integrals.
These are at least ``lambda_k |d_k|`` times the integral of 1 - cos of the angle between theta(s)
and d_k. Headings change by at most s / r_min over a length s. If the angle is a at one end of the
leg, and the
leg is at least l long, the integral over its half at that end is at least, in units of r_min::

    f(a) = integral of 1 - cos(max(0, a - s)) for s from 0 to l / 2
         = F(a) - F(max(0, a - l / 2)),    F(a) = a - sin a

At a stop, the two angles between its heading and the directions before and after sum up to at least
the angle between these directions. f is increasing, so the least sum over all headings is the least
sum over all divisions of this angle. The bound therefore needs no headings, and it holds for moving
vehicles. It is exact for a flight of long legs between fixed points, if each leg is straight except
for a turn of at most half a circle at either end.
"""

from __future__ import annotations

import math

from ...jit import kernel

__all__ = ["between", "corner", "turn_loss"]


@kernel
def turn_loss(angle: float, half: float) -> float:
    """Return f, a lower bound on the loss on half a leg whose heading is off by `angle` at its end."""
    lost = angle - math.sin(angle)
    if angle > half:
        lost -= angle - half - math.sin(angle - half)
    return lost


@kernel
def _steepness(angle: float, half: float) -> float:
    """Return the derivative of :func:`turn_loss` with respect to the angle."""
    return math.cos(max(angle - half, 0.0)) - math.cos(angle)


@kernel
def corner(angle: float, before: float, first: float, after: float, second: float) -> float:
    """Return a lower bound, at least 0, on the minimum of ``before f(x) + after f(angle - x)`` over x.

    `angle` is that between the directions of two legs (rad, at most π), `before` and `after` are the
    weights of the legs, and `first` and `second` half their least lengths in turning radii.
    """
    if angle <= 0.0:
        return 0.0
    if angle <= min(first, second):
        # x with equal slopes 2 before sin²(x / 2) and 2 after sin²((angle - x) / 2).
        root, other = math.sqrt(before), math.sqrt(after)
        y, x = other * math.sin(0.5 * angle), root + other * math.cos(0.5 * angle)
        if x <= 0.0:
            return 0.0
        low = 2.0 * math.atan2(y, x)
        slope = before * _steepness(low, first) - after * _steepness(angle - low, second)
        value = before * turn_loss(low, first) + after * turn_loss(angle - low, second)
        return max(value - abs(slope) * angle, 0.0)
    if angle > 0.5 * (math.pi + min(first, second)):
        # f is concave beyond this angle. Minimise over cells, with a lower bound of both parts per
        # cell.
        cells = 128
        least = math.inf
        for k in range(cells):
            low, rest = angle * k / cells, angle * (cells - 1 - k) / cells
            least = min(least, before * turn_loss(low, first) + after * turn_loss(rest, second))
        return least
    low, high = 0.0, angle
    for _ in range(9):
        x = 0.5 * (low + high)
        if before * _steepness(x, first) < after * _steepness(angle - x, second):
            low = x
        else:
            high = x
    # A convex function is at least its tangent.
    slope = before * _steepness(low, first) - after * _steepness(angle - low, second)
    value = before * turn_loss(low, first) + after * turn_loss(angle - low, second)
    return max(value + min(slope, 0.0) * (high - low), 0.0)


@kernel
def between(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the angle between two vectors, rad, in [0, π]."""
    return abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
