"""Kernels of the bounds: the bound that given leg directions prove, and the cost of another stop.

The dual of the relaxation for a given order (see :mod:`...models.messenger.relaxation`) has one
vector
u_k per leg. With g_k = u_k - u_{k+1} (u_{L+1} = 0), the Lagrangian is bounded from below if::

    lambda_L = 1 + g_L . W_L,   lambda_k = lambda_{k+1} + g_k . W_k,   |u_k| <= lambda_k

Then ``sum g_k . P_k - |g_k| r_k`` is a lower bound on every path's length. With u_k = lambda_k d_k
the conditions become ``lambda_k (1 - d_k . W_k) = lambda_{k+1} (1 - d_{k+1} . W_k)`` and |d_k| <=
1. Vehicles are slower than the UAV, so any directions d_k in the unit disc prove a bound. The
directions of the legs of a shortest path prove its length.

:mod:`.turn_kernels` derives the additional terms of the curvature limit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .splice_kernels import spliced, tabulated
from .turn_kernels import between, corner, turned

__all__ = ["ascended", "insertions", "misses", "omissions", "proven"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bound on the relative rounding error of a bound, per leg, relative to the sum of absolute terms.
ROUNDING = 1e-12
#: Same for a bound assembled from parts of another one, with a larger safety factor.
SPLICED = 1e-10
#: Step lengths towards new directions. At a disc, a full step may overshoot.
STEPS = (1.0, 0.5, 0.2)
#: Number of sweeps of the coordinate ascent over the directions.
SWEEPS = 6


@kernel(interpretable=True)
def proven(
    centres: Floats, velocities: Floats, radii: Floats, gaps: Floats, turn: Floats,
    stops: Indices, directions: Floats,
) -> float:  # fmt: skip
    """Return the length that `directions` prove for every path over `stops`, minus the rounding error.

    Parameters
    ----------
    centres, velocities : ndarray, shape (n + 1, 2)
        P and W of the field.
    radii : ndarray, shape (n + 1,)
        r of the field.
    gaps : ndarray, shape (n + 1, n + 1)
        Least lengths of legs between stops.
    turn : ndarray, shape (3,)
        Turning radius in the field's unit, or 0 to ignore the curvature limit; 1 if the heading at
        the start is fixed, otherwise 0; that heading, in rad.
    stops : ndarray of int64, shape (L + 1,)
        Start, stops and end of the path. If the path starts and ends at the same vehicle, both are
        one stop at one point.
    directions : ndarray, shape (L, 2)
        d_k; vectors longer than 1 are normalised.

    Returns
    -------
    float
        Lower bound, at least 0, in the field's unit.
    """
    legs = stops.size - 1
    total, size = 0.0, 0.0
    weight = 1.0
    lastx, lasty = 0.0, 0.0  # u_{k+1}
    endx, endy = 0.0, 0.0  # u_L
    round_trip = stops[0] == stops[legs]
    dx, dy = 0.0, 0.0
    curved = turn[0] > 0.0 and legs > 0
    headed = turn[1] > 0.0
    startx, starty = math.cos(turn[2]), math.sin(turn[2])
    heavy, half, end_heavy, end_half = 0.0, 0.0, 0.0, 0.0
    for k in range(legs, 0, -1):
        b, a = stops[k], stops[k - 1]
        wx, wy = velocities[b, 0], velocities[b, 1]
        over = 1.0 - dx * wx - dy * wy
        dx, dy = directions[k - 1, 0], directions[k - 1, 1]
        long = math.sqrt(dx * dx + dy * dy) * (1.0 + 1e-15)
        if not long <= 1.0:
            dx, dy = dx / long, dy / long
        if k == legs:
            over = 1.0
        weight *= over / (1.0 - dx * wx - dy * wy)
        ux, uy = weight * dx, weight * dy
        alongx = ux * (centres[b, 0] - centres[a, 0])
        alongy = uy * (centres[b, 1] - centres[a, 1])
        total += alongx + alongy
        size += abs(alongx) + abs(alongy)
        if k == legs and round_trip:
            endx, endy = ux, uy
        else:
            lost = math.sqrt((ux - lastx) ** 2 + (uy - lasty) ** 2) * radii[b]
            total -= lost
            size += lost
        if curved:
            after, second = heavy, half
            heavy = weight * math.sqrt(dx * dx + dy * dy)
            half = 0.5 * gaps[a, b] / turn[0]
            if k < legs:
                angle = between(ux, uy, lastx, lasty)
                total += turn[0] * corner(angle, heavy, half, after, second)
                size += turn[0] * (heavy + after)
            else:
                end_heavy, end_half = heavy, half
                if round_trip and headed:
                    total += turn[0] * heavy * turned(between(ux, uy, startx, starty), half)
        lastx, lasty = ux, uy
    if curved:
        size += 4.0 * turn[0] * (heavy + end_heavy)
    if curved and headed:
        total += turn[0] * heavy * turned(between(lastx, lasty, startx, starty), half)
    elif curved and round_trip:
        angle = between(endx, endy, lastx, lasty)
        total += turn[0] * corner(angle, end_heavy, end_half, heavy, half)
    lost = math.sqrt((endx - lastx) ** 2 + (endy - lasty) ** 2) * radii[stops[0]]
    total -= lost
    size += lost
    total -= ROUNDING * legs * size
    if total > 0.0:
        return float(total)
    return 0.0


@kernel(interpretable=True)
def insertions(
    centres: Floats, velocities: Floats, radii: Floats, gaps: Floats, turn: Floats,
    stops: Indices, directions: Floats, points: Floats, times: Floats, vehicle: int,
    bounds: Floats,
) -> None:  # fmt: skip
    """Fill `bounds` with lower bounds for the paths with `vehicle` inserted into each leg.

    The directions are those of the path, except for the two legs that replace a leg. Entry k is the
    bound for the leg to stop k + 1. An entry L is the bound for `vehicle` after the last stop.

    Parameters
    ----------
    centres, velocities, radii, gaps, turn, stops, directions
        As in :func:`proven`.
    points : ndarray, shape (L + 1, 2)
        Q, the points of the path's encounters.
    times : ndarray, shape (L + 1,)
        s at the encounters.
    vehicle : int
        Index of the inserted vehicle.
    bounds : ndarray, shape (L,) or (L + 1,)
        Overwritten with the bounds.
    """
    legs = stops.size - 1
    table = np.empty((legs, 6))
    size = tabulated(centres, velocities, radii, gaps, turn, stops, directions, table)
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
            value = spliced(
                centres, velocities, radii, gaps, turn, stops, table, place,
                legs if last else place + 1, more, tried,
            )  # fmt: skip
            best = max(best, value)
        # Double the size to cover the new legs, whose weights are bounded by those of other legs.
        best -= SPLICED * (legs + 2) * (size + abs(best))
        bounds[place] = best


@kernel(interpretable=True)
def omissions(
    centres: Floats, velocities: Floats, radii: Floats, gaps: Floats, turn: Floats,
    stops: Indices, directions: Floats, bounds: Floats,
) -> None:  # fmt: skip
    """Fill `bounds` with approximate bounds for the paths without one of the stops.

    A bound may increase: a path of short legs need not turn as much as one long leg must.

    Parameters
    ----------
    centres, velocities, radii, gaps, turn, stops, directions
        As in :func:`proven`.
    bounds : ndarray, shape (L,)
        Overwritten; entry k belongs to stop k + 1. If the path begins and ends at one place, the
        last stop cannot be omitted, and its entry is 0.
    """
    legs = stops.size - 1
    table = np.empty((legs, 6))
    tabulated(centres, velocities, radii, gaps, turn, stops, directions, table)
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
                    one, other = directions[k, axis], directions[k + 1, axis]
                    tried[0, axis] = one + step * (other - one)
            value = spliced(
                centres, velocities, radii, gaps, turn, stops, table, k, min(k + 2, legs), more,
                tried,
            )  # fmt: skip
            bounds[k] = max(bounds[k], value)


@kernel(interpretable=True)
def ascended(
    centres: Floats, velocities: Floats, radii: Floats, gaps: Floats, turn: Floats,
    stops: Indices, directions: Floats, found: Floats,
) -> float:  # fmt: skip
    """Increase the bound by coordinate ascent over the directions; return it and fill `found`.

    Each sweep rotates every direction in turn, and halves the step.

    Parameters
    ----------
    centres, velocities, radii, gaps, turn, stops, directions
        As in :func:`proven`.
    found : ndarray, shape (L, 2)
        Overwritten with the directions that prove the returned bound.

    Returns
    -------
    float
        Lower bound, at least that of `directions`, in the field's unit.
    """
    legs = stops.size - 1
    for k in range(legs):
        found[k, 0], found[k, 1] = directions[k, 0], directions[k, 1]
    # Per direction: one step to either side, then the maximum of the parabola through the three
    # values.
    table, tried = np.empty((legs, 6)), np.empty((1, 2))
    tabulated(centres, velocities, radii, gaps, turn, stops, found, table)
    step = 0.2
    for _ in range(SWEEPS):
        step *= 0.5
        for k in range(legs):
            more = stops[k : k + 2]
            x, y = found[k, 0], found[k, 1]
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
                value = spliced(
                    centres, velocities, radii, gaps, turn, stops, table, k, k + 1, more, tried
                )
                if trial == 0:
                    best = value
                elif trial == 1:
                    left = value
                elif trial == 2:
                    right = value
                elif value > best:
                    found[k, 0], found[k, 1] = tried[0, 0], tried[0, 1]
                    tabulated(centres, velocities, radii, gaps, turn, stops, found, table)
    best = proven(centres, velocities, radii, gaps, turn, stops, found)
    before = proven(centres, velocities, radii, gaps, turn, stops, directions)
    if before > best:
        for k in range(legs):
            found[k, 0], found[k, 1] = directions[k, 0], directions[k, 1]
        return before
    return best


@kernel(interpretable=True)
def misses(
    centres: Floats, velocities: Floats, radii: Floats, points: Floats, times: Floats,
    found: Floats, where: Floats,
) -> None:  # fmt: skip
    """Fill in the distance of a path to every vehicle's disc, and the place of the closest approach.

    Parameters
    ----------
    centres, velocities, radii
        Data of the vehicles, as in :func:`proven`.
    points, times : ndarray, shapes (L + 1, 2) and (L + 1,)
        The path, linear between its points.
    found : ndarray, shape (n,)
        Overwritten with the least distance minus the radius.
    where : ndarray, shape (n,)
        Overwritten with the leg plus the share of it flown at the closest approach.
    """
    for i in range(found.size):
        found[i] = math.inf
        for k in range(max(times.size - 1, 1)):
            nx, ny, end = points[k, 0], points[k, 1], times[k]
            if k + 1 < times.size:
                nx, ny, end = points[k + 1, 0], points[k + 1, 1], times[k + 1]
            ax = points[k, 0] - centres[i, 0] - velocities[i, 0] * times[k]
            ay = points[k, 1] - centres[i, 1] - velocities[i, 1] * times[k]
            mx = nx - centres[i, 0] - velocities[i, 0] * end - ax
            my = ny - centres[i, 1] - velocities[i, 1] * end - ay
            span = mx * mx + my * my
            share = 0.0
            if span > 0.0:
                share = min(max(-(ax * mx + ay * my) / span, 0.0), 1.0)
            away = math.sqrt((ax + share * mx) ** 2 + (ay + share * my) ** 2) - radii[i]
            if away < found[i]:
                found[i], where[i] = away, k + share
