"""Kernels of the bounds: replacement of a leg of a path in constant time.

A bound (see :mod:`.bound_kernels`) is a sum with one part per leg and one per stop. If a leg is
replaced, the later parts are unchanged, and the earlier ones change by a common factor of the
weights.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .turn_kernels import between, corner, turned

__all__ = ["spliced", "tabulated"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Relative weight of a leg above which the rounding error of the parts is no longer negligible.
HEAVY = 1e3


@kernel
def _clip(x: float, y: float) -> tuple[float, float]:
    """Return a direction, normalised if it is longer than 1."""
    long = math.sqrt(x * x + y * y) * (1.0 + 1e-15)
    if not long <= 1.0:
        return x / long, y / long
    return x, y


@kernel
def _stop_terms(
    ux: float, uy: float, before: float, first: float, vx: float, vy: float, after: float,
    second: float, radius: float, turn: float,
) -> float:  # fmt: skip
    """Return a stop's contribution to the bound, between legs with u and v: radius and turn."""
    value = -radius * math.sqrt((ux - vx) ** 2 + (uy - vy) ** 2)
    if turn > 0.0:
        value += turn * corner(between(ux, uy, vx, vy), before, first, after, second)
    return value


@kernel
def _end_terms(
    radii: Floats, turn: Floats, begin: int, end: int, ux: float, uy: float, first: float,
    vx: float, vy: float, last: float,
) -> float:  # fmt: skip
    """Return the contribution of a path's ends to the bound; u is of the first leg, v of the last."""
    before, after = math.sqrt(vx * vx + vy * vy), math.sqrt(ux * ux + uy * uy)
    headed = turn[0] > 0.0 and turn[1] > 0.0
    if begin == end and not headed:
        return _stop_terms(vx, vy, before, last, ux, uy, after, first, radii[begin], turn[0])
    value = 0.0
    if begin != end:
        value -= radii[end] * before
    if headed:
        x, y = math.cos(turn[2]), math.sin(turn[2])
        value += turn[0] * after * turned(between(ux, uy, x, y), first)
        if begin == end:
            value += turn[0] * before * turned(between(vx, vy, x, y), last)
    return value


@kernel
def tabulated(
    centres: Floats, velocities: Floats, radii: Floats, gaps: Floats, turn: Floats,
    stops: Indices, directions: Floats, table: Floats,
) -> float:  # fmt: skip
    """Fill `table` with the parts of the bound that `directions` prove; return the sum of their sizes.

    Columns, with one row per leg: direction (2); weight lambda; half its least length divided by
    the turning radius; sum of the parts of this and all later legs; sum of those of this and all
    earlier legs.
    """
    legs = stops.size - 1
    size, weight = 0.0, 1.0
    for k in range(legs - 1, -1, -1):
        a, b = stops[k], stops[k + 1]
        dx, dy = _clip(directions[k, 0], directions[k, 1])
        if k + 1 < legs:
            weight *= 1.0 - table[k + 1, 0] * velocities[b, 0] - table[k + 1, 1] * velocities[b, 1]
        weight /= 1.0 - dx * velocities[b, 0] - dy * velocities[b, 1]
        half = 0.5 * gaps[a, b] / turn[0] if turn[0] > 0.0 else 0.0
        table[k, 0], table[k, 1], table[k, 2], table[k, 3] = dx, dy, weight, half
        size += weight * (
            abs(dx * (centres[b, 0] - centres[a, 0])) + abs(dy * (centres[b, 1] - centres[a, 1]))
            + 2.0 * (radii[a] + radii[b]) + 4.0 * turn[0]
        )  # fmt: skip
    before = 0.0
    for k in range(legs):
        a, b = stops[k], stops[k + 1]
        ux, uy = table[k, 2] * table[k, 0], table[k, 2] * table[k, 1]
        along = ux * (centres[b, 0] - centres[a, 0]) + uy * (centres[b, 1] - centres[a, 1])
        table[k, 5] = before + along
        table[k, 4] = along
        if k + 1 < legs:
            vx, vy = table[k + 1, 2] * table[k + 1, 0], table[k + 1, 2] * table[k + 1, 1]
            table[k, 4] += _stop_terms(
                ux, uy, math.sqrt(ux * ux + uy * uy), table[k, 3],
                vx, vy, math.sqrt(vx * vx + vy * vy), table[k + 1, 3], radii[b], turn[0],
            )  # fmt: skip
        before += table[k, 4]
    for k in range(legs - 2, -1, -1):
        table[k, 4] += table[k + 1, 4]
    return size


@kernel
def spliced(
    centres: Floats, velocities: Floats, radii: Floats, gaps: Floats, turn: Floats,
    stops: Indices, table: Floats, place: int, until: int, more: Indices, tried: Floats,
) -> float:  # fmt: skip
    """Return the bound with the legs from `place` to before `until` replaced, up to rounding.

    The bound is -inf if weights grow so much that rounding matters. The directions of earlier legs
    are unchanged, and their parts change by a common factor.

    Parameters
    ----------
    centres, velocities, radii, gaps, turn, stops
        As in :func:`proven`, for the original path.
    table : ndarray, shape (L, 6)
        Table filled by :func:`tabulated`.
    place, until : int
        Range of the legs to replace.
    more : ndarray of int64, shape (m + 1,)
        Stops of the m new legs.
    tried : ndarray, shape (m, 2)
        Directions of the new legs.
    """
    legs = stops.size - 1
    value, weight, heaviest = 0.0, 1.0, 0.0
    nx, ny, nw, nhalf = 0.0, 0.0, 0.0, 0.0  # u of the leg after, its length and its half
    dx, dy = 0.0, 0.0
    ends = legs == until
    lastx, lasty, last = 0.0, 0.0, 0.0
    if not ends:
        value, weight = table[until, 4], table[until, 2]
        dx, dy, nhalf = table[until, 0], table[until, 1], table[until, 3]
        nx, ny = weight * dx, weight * dy
        lastx = table[legs - 1, 2] * table[legs - 1, 0]
        lasty = table[legs - 1, 2] * table[legs - 1, 1]
        last = table[legs - 1, 3]
    for row in range(more.size - 2, -2, -1):
        if row >= 0:
            b, a = more[row + 1], more[row]
            x, y = _clip(tried[row, 0], tried[row, 1])
            half = 0.5 * gaps[a, b] / turn[0] if turn[0] > 0.0 else 0.0
        elif place > 0:
            b, a = stops[place], stops[place - 1]
            x, y, half = table[place - 1, 0], table[place - 1, 1], table[place - 1, 3]
        else:
            break
        if not ends:
            weight *= 1.0 - dx * velocities[b, 0] - dy * velocities[b, 1]
        weight /= 1.0 - x * velocities[b, 0] - y * velocities[b, 1]
        heaviest = max(heaviest, weight)
        ux, uy = weight * x, weight * y
        uw = math.sqrt(ux * ux + uy * uy)
        if ends:
            lastx, lasty, last = ux, uy, half
            ends = False
        else:
            nw = math.sqrt(nx * nx + ny * ny)
            value += _stop_terms(ux, uy, uw, half, nx, ny, nw, nhalf, radii[b], turn[0])
        if row >= 0:
            value += ux * (centres[b, 0] - centres[a, 0]) + uy * (centres[b, 1] - centres[a, 1])
        dx, dy, nx, ny, nhalf = x, y, ux, uy, half
    if legs > 0 and heaviest > HEAVY * table[min(place, legs - 1), 2]:
        return -math.inf
    if place > 0:
        factor = weight / table[place - 1, 2]
        value += factor * table[place - 1, 5]
        nx = factor * table[0, 2] * table[0, 0]
        ny = factor * table[0, 2] * table[0, 1]
        nhalf = table[0, 3]
    end = more[-1] if until == legs else stops[legs]
    return value + _end_terms(radii, turn, stops[0], end, nx, ny, nhalf, lastx, lasty, last)
