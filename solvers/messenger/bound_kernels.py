"""Kernels of the bounds: the bound that given leg directions prove, and the cost of another stop.

The dual of the relaxation for a given order (see :mod:`...models.messenger.relaxation`) has one
vector u_k per leg. With g_k = u_k - u_{k+1} (u_{L+1} = 0), the Lagrangian is bounded from below if::

    lambda_L = 1 + g_L . W_L,   lambda_k = lambda_{k+1} + g_k . W_k,   |u_k| <= lambda_k

Then ``sum g_k . P_k - |g_k| r_k`` is a lower bound on every path's length. With u_k = lambda_k d_k
the conditions become ``lambda_k (1 - d_k . W_k) = lambda_{k+1} (1 - d_{k+1} . W_k)`` and |d_k| <=
1. Vehicles are slower than the UAV, so any directions d_k in the unit disc prove a bound. The
directions of the legs of a shortest path prove its length.

A bound is a sum with one part per leg and one per stop. If a leg is replaced, the later parts are
unchanged, and the earlier ones change by a common factor of the weights. :mod:`.turn_kernels` derives
the additional terms of the curvature limit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import copy_pairs
from .turn_kernels import between, corner, turn_loss

__all__ = ["Data", "ascend", "insertions", "omissions", "prove_length", "splice", "tabulate"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bound on the relative rounding error of a bound, per leg, relative to the sum of absolute terms.
ROUNDING = 1e-12
#: Same for a bound assembled from parts of another one, with a larger safety factor.
SPLICED = 1e-10
#: Relative weight of a leg above which the rounding error of the parts is no longer negligible.
HEAVY = 1e3
#: Smallest factor 1 - d . W of a bound assembled from parts, and share of the reciprocals of these
#: factors that enlarges the rounding error. Vehicles almost as fast as the UAV leave few digits.
THIN, NARROW = 1e-5, 1e-3
#: Step lengths towards new directions. At a disc, a full step may overshoot.
STEPS = (1.0, 0.5, 0.2)
#: Number of sweeps of the coordinate ascent over the directions.
SWEEPS = 6


class Data(NamedTuple):
    """Field and curvature limit, in the field's unit.

    `centres` (n + 1, 2), `velocities` (n + 1, 2) and `radii` (n + 1,) are P, W and r of the field, and `gaps` (n + 1,
    n + 1) the least lengths of legs between stops. `r` is the turning radius, 0 to ignore the curvature limit. If
    `headed`, the heading at the start is `heading` (rad).

    The kernels also receive `stops`, shape (L + 1,): start, stops and end of a path, which are one
    stop at one point if the path starts and ends at the same vehicle; and `directions`, shape
    (L, 2): d_k, where vectors longer than 1 are normalised.
    """

    centres: Floats
    velocities: Floats
    radii: Floats
    gaps: Floats
    r: float
    headed: bool
    heading: float


@kernel
def _clip(x: float, y: float) -> tuple[float, float]:
    """Return a direction, normalised if it is longer than 1."""
    long = math.sqrt(x * x + y * y) * (1.0 + 1e-15)
    if not long <= 1.0:
        return x / long, y / long
    return x, y


@kernel
def _stop_terms(
    ux: float, uy: float, first: float, vx: float, vy: float, second: float, radius: float, r: float
) -> float:
    """Return a stop's contribution to the bound, between legs with u and v: radius and turn."""
    value = -radius * math.sqrt((ux - vx) ** 2 + (uy - vy) ** 2)
    if r > 0.0:
        before, after = math.sqrt(ux * ux + uy * uy), math.sqrt(vx * vx + vy * vy)
        value += r * corner(between(ux, uy, vx, vy), before, first, after, second)
    return value


@kernel
def _end_terms(
    data: Data, begin: int, end: int, ux: float, uy: float, first: float, vx: float, vy: float,
    last: float,
) -> float:  # fmt: skip
    """Return the contribution of a path's ends to the bound; u is of the first leg, v of the last."""
    headed = data.r > 0.0 and data.headed
    if begin == end and not headed:
        return _stop_terms(vx, vy, last, ux, uy, first, data.radii[begin], data.r)
    before, after = math.sqrt(vx * vx + vy * vy), math.sqrt(ux * ux + uy * uy)
    value = 0.0
    if begin != end:
        value -= data.radii[end] * before
    if headed:
        x, y = math.cos(data.heading), math.sin(data.heading)
        value += data.r * after * turn_loss(between(ux, uy, x, y), first)
        if begin == end:
            value += data.r * before * turn_loss(between(vx, vy, x, y), last)
    return value


@kernel(interpretable=True, in_place=True)
def tabulate(data: Data, stops: Indices, directions: Floats, table: Floats) -> float:
    """Fill `table` with the parts of the bound that `directions` prove; return the sum of their sizes.

    The sizes include the cancellation in the weights.

    Columns, with one row per leg: direction (2); weight lambda; half its least length divided by
    the turning radius; sum of the parts of this and all later legs; sum of those of this and all
    earlier legs.
    """
    legs = stops.size - 1
    centres, velocities, radii = data.centres, data.velocities, data.radii
    size, weight, lost = 0.0, 1.0, 0.0
    for k in range(legs - 1, -1, -1):
        a, b = stops[k], stops[k + 1]
        dx, dy = _clip(directions[k, 0], directions[k, 1])
        after, over = 1.0, 1.0 - dx * velocities[b, 0] - dy * velocities[b, 1]
        if k + 1 < legs:
            after = 1.0 - table[k + 1, 0] * velocities[b, 0] - table[k + 1, 1] * velocities[b, 1]
        weight = weight * after / over
        lost += 1.0 / max(over, 1e-300) + 1.0 / max(after, 1e-300)
        half = 0.5 * data.gaps[a, b] / data.r if data.r > 0.0 else 0.0
        table[k, 0], table[k, 1], table[k, 2], table[k, 3] = dx, dy, weight, half
        size += abs(weight) * max(1.0, NARROW * lost) * (
            abs(dx * (centres[b, 0] - centres[a, 0])) + abs(dy * (centres[b, 1] - centres[a, 1]))
            + 2.0 * (radii[a] + radii[b]) + 4.0 * data.r
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
                ux, uy, table[k, 3], vx, vy, table[k + 1, 3], radii[b], data.r
            )
        before += table[k, 4]
    for k in range(legs - 2, -1, -1):
        table[k, 4] += table[k + 1, 4]
    return size


@kernel
def splice(
    data: Data, stops: Indices, table: Floats, place: int, until: int, more: Indices, tried: Floats
) -> float:
    """Return the bound with the legs from `place` to before `until` replaced, up to rounding.

    The bound is -inf if weights grow or cancel so much that rounding matters. The directions of
    earlier legs are unchanged, and their parts change by a common factor.
    `table` of the original path is filled by :func:`tabulate`. `more`, shape (m + 1,), and
    `tried`, shape (m, 2), are the stops and directions of the m new legs.
    """
    legs = stops.size - 1
    value, weight, heaviest, thinnest = 0.0, 1.0, 0.0, 1.0
    centres, velocities, radii = data.centres, data.velocities, data.radii
    nx, ny, nhalf = 0.0, 0.0, 0.0  # u of the leg after, and its half
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
            half = 0.5 * data.gaps[a, b] / data.r if data.r > 0.0 else 0.0
        elif place > 0:
            b, a = stops[place], stops[place - 1]
            x, y, half = table[place - 1, 0], table[place - 1, 1], table[place - 1, 3]
        else:
            break
        after = 1.0 if ends else 1.0 - dx * velocities[b, 0] - dy * velocities[b, 1]
        over = 1.0 - x * velocities[b, 0] - y * velocities[b, 1]
        weight = weight * after / over
        thinnest = min(thinnest, min(after, over))
        heaviest = max(heaviest, weight)
        ux, uy = weight * x, weight * y
        if ends:
            lastx, lasty, last = ux, uy, half
            ends = False
        else:
            value += _stop_terms(ux, uy, half, nx, ny, nhalf, radii[b], data.r)
        if row >= 0:
            value += ux * (centres[b, 0] - centres[a, 0]) + uy * (centres[b, 1] - centres[a, 1])
        dx, dy, nx, ny, nhalf = x, y, ux, uy, half
    if thinnest < THIN or (legs > 0 and heaviest > HEAVY * table[min(place, legs - 1), 2]):
        return -math.inf
    if place > 0:
        factor = weight / table[place - 1, 2]
        value += factor * table[place - 1, 5]
        nx = factor * table[0, 2] * table[0, 0]
        ny = factor * table[0, 2] * table[0, 1]
        nhalf = table[0, 3]
    end = more[-1] if until == legs else stops[legs]
    return value + _end_terms(data, stops[0], end, nx, ny, nhalf, lastx, lasty, last)


@kernel(interpretable=True)
def prove_length(data: Data, stops: Indices, directions: Floats) -> float:
    """Return the length that `directions` prove for every path over `stops`, minus the rounding error."""
    legs = stops.size - 1
    if legs == 0:
        return 0.0
    table = np.empty((legs, 6))
    # Double the size to cover the terms of the ends.
    size = 2.0 * tabulate(data, stops, directions, table)
    last = table[legs - 1]
    ux, uy = table[0, 2] * table[0, 0], table[0, 2] * table[0, 1]
    vx, vy = last[2] * last[0], last[2] * last[1]
    total = table[0, 4]
    total += _end_terms(data, stops[0], stops[legs], ux, uy, table[0, 3], vx, vy, last[3])
    total -= ROUNDING * legs * size
    if total > 0.0:
        return float(total)
    return 0.0


@kernel(interpretable=True)
def insertions(
    data: Data, stops: Indices, directions: Floats, points: Floats, times: Floats, vehicle: int,
    bounds: Floats,
) -> None:  # fmt: skip
    """Fill `bounds` with lower bounds for the paths with `vehicle` inserted into each leg.

    The directions are those of the path, except for the two legs that replace a leg. Entry k is the
    bound for the leg to stop k + 1. An entry L is the bound for `vehicle` after the last stop.
    `points`, shape (L + 1, 2), and `times`, shape (L + 1,), are Q and s at the path's encounters.
    """
    legs = stops.size - 1
    centres, velocities, radii = data.centres, data.velocities, data.radii
    table = np.empty((legs, 6))
    size = tabulate(data, stops, directions, table)
    for place in range(bounds.size):
        last = place == legs
        more = np.empty(2 if last else 3, np.int64)
        more[0], more[1] = stops[place], vehicle
        if not last:
            more[2] = stops[place + 1]
        tried = np.empty((more.size - 1, 2))
        qx, qy, begin = points[place, 0], points[place, 1], times[place]
        if last:
            zx, zy, end = qx, qy, begin
        else:
            zx, zy, end = points[place + 1, 0], points[place + 1, 1], times[place + 1]
        span = (zx - qx) ** 2 + (zy - qy) ** 2
        now, x, y = begin, qx, qy
        for _ in range(4):
            px = centres[vehicle, 0] + velocities[vehicle, 0] * now
            py = centres[vehicle, 1] + velocities[vehicle, 1] * now
            share = 0.0
            if span > 0.0:
                share = ((px - qx) * (zx - qx) + (py - qy) * (zy - qy)) / span
                share = min(max(share, 0.0), 1.0)
            x, y = qx + share * (zx - qx), qy + share * (zy - qy)
            away = math.sqrt((px - x) ** 2 + (py - y) ** 2)
            if away > radii[vehicle]:
                part = 1.0 - radii[vehicle] / away
                x, y = x + part * (px - x), y + part * (py - y)
            now = begin + math.sqrt((x - qx) ** 2 + (y - qy) ** 2)
        first = max(now - begin, 1e-300)
        second = math.sqrt((zx - x) ** 2 + (zy - y) ** 2)
        if not last:
            late = max(now + second - end, 0.0)
            zx += velocities[stops[place + 1], 0] * late
            zy += velocities[stops[place + 1], 1] * late
            second = max(math.sqrt((zx - x) ** 2 + (zy - y) ** 2), 1e-300)
        best = 0.0
        for step in STEPS:
            ox, oy = 0.0, 0.0
            if not last:
                ox, oy = directions[place, 0], directions[place, 1]
                tried[1, 0] = ox + step * ((zx - x) / second - ox)
                tried[1, 1] = oy + step * ((zy - y) / second - oy)
            tried[0, 0] = ox + step * ((x - qx) / first - ox)
            tried[0, 1] = oy + step * ((y - qy) / first - oy)
            value = splice(data, stops, table, place, legs if last else place + 1, more, tried)
            best = max(best, value)
        # Double the size to cover the new legs, whose weights are bounded by those of other legs.
        best -= SPLICED * (legs + 2) * (size + abs(best))
        bounds[place] = best


@kernel(interpretable=True)
def omissions(data: Data, stops: Indices, directions: Floats, bounds: Floats) -> None:
    """Fill `bounds` with approximate bounds for the paths without one of the stops.

    A bound may increase: a path of short legs need not turn as much as one long leg must. Entry k
    belongs to stop k + 1. If the path begins and ends at one place, the last stop cannot be
    omitted, and its entry is 0.
    """
    legs = stops.size - 1
    table = np.empty((legs, 6))
    tabulate(data, stops, directions, table)
    for k in range(legs):
        last = k == legs - 1
        bounds[k] = 0.0
        if last and stops[0] == stops[legs]:
            continue
        more, tried = np.empty(1 if last else 2, np.int64), np.zeros((0 if last else 1, 2))
        more[0] = stops[k]
        if not last:
            more[1] = stops[k + 2]
        for step in (0.0, 0.5, 1.0):
            if not last:
                for axis in range(2):
                    first, second = directions[k, axis], directions[k + 1, axis]
                    tried[0, axis] = first + step * (second - first)
            value = splice(data, stops, table, k, min(k + 2, legs), more, tried)
            bounds[k] = max(bounds[k], value)


@kernel(interpretable=True)
def ascend(data: Data, stops: Indices, directions: Floats, best_directions: Floats) -> float:
    """Increase the bound by coordinate ascent over the directions; return it and the directions.

    Each sweep rotates every direction in turn, and halves the step. The bound is at least that of
    `directions`; `best_directions` is filled with the directions that prove it.
    """
    legs = stops.size - 1
    copy_pairs(directions, best_directions)
    # Per direction: one step to either side, then the maximum of the parabola through the three
    # values.
    table, tried = np.empty((legs, 6)), np.empty((1, 2))
    tabulate(data, stops, best_directions, table)
    step = 0.2
    for _ in range(SWEEPS):
        step *= 0.5
        for k in range(legs):
            more = stops[k : k + 2]
            x, y = best_directions[k, 0], best_directions[k, 1]
            best, left, right = 0.0, 0.0, 0.0
            for trial in range(4):
                angle = 0.0
                if trial == 1:
                    angle = step
                elif trial == 2:
                    angle = -step
                elif trial == 3:
                    bend = 2.0 * best - left - right
                    angle = step if left > right else -step
                    if bend > 0.0:
                        angle = min(max(0.5 * (left - right) / bend, -3.0), 3.0) * step
                c, s = math.cos(angle), math.sin(angle)
                tried[0, 0], tried[0, 1] = c * x - s * y, s * x + c * y
                value = splice(data, stops, table, k, k + 1, more, tried)
                if trial == 0:
                    best = value
                elif trial == 1:
                    left = value
                elif trial == 2:
                    right = value
                elif value > best:
                    best_directions[k, 0], best_directions[k, 1] = tried[0, 0], tried[0, 1]
                    tabulate(data, stops, best_directions, table)
    best = prove_length(data, stops, best_directions)
    before = prove_length(data, stops, directions)
    if before > best:
        copy_pairs(directions, best_directions)
        return before
    return best
