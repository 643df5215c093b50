"""Kernels of the bound for few vehicles: shortest flights between sets of poses.

A set contains the poses whose places have at most a given distance from a point and whose headings
differ by at most a given angle from a heading. The shortest path between two poses is one of the six
words of :mod:`...models.messenger.dubins`; the bound is the least one of their bounds.

For a word with a line, the derivatives of the length are the direction of the line with respect to a
place and r (1 - cos τ) with respect to a heading with the turn τ beside it. The length of the word is
extended continuously to turns below 0, which never makes it longer. The mean value theorem then bounds
it on a set. If the line may vanish, and for words of three turns, the bound is the sum of the least
lengths of the parts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import FULL

__all__ = [
    "HIGH",
    "LOW",
    "PHI",
    "PHI_HALF",
    "THETA",
    "THETA_HALF",
    "arrivals",
    "least_flight",
    "tails",
]

Floats = NDArray[np.float64]

#: Columns of a cell: angle on the boundary of the disc and its half-width, heading and its half-width
#: (rad; π: free), first and last length flown (m).
PHI, PHI_HALF, THETA, THETA_HALF, LOW, HIGH = range(6)
#: Largest angle below 0 (rad) that is rounding, and not a full circle.
NO_TURN = 1e-9


class Rims(NamedTuple):
    """Arcs of the places at both ends: longest chord from the middle (m), its normal, half-width (rad)."""

    chord: float
    normal: float
    half: float
    end_chord: float
    end_normal: float
    end_half: float


@kernel
def _along(way: float, spread: float, mirror: float, rims: Rims) -> float:
    """Return by how much less than the chords the places of both ends differ in the direction of a line."""
    first = abs(math.sin(mirror * way - rims.normal)) + spread + 0.5 * rims.half
    last = abs(math.sin(mirror * way - rims.end_normal)) + spread + 0.5 * rims.end_half
    return rims.chord * max(1.0 - first, 0.0) + rims.end_chord * max(1.0 - last, 0.0)


@kernel
def _least_turn(angle: float, spread: float) -> float:
    """Return the angle modulo a full circle, from -`spread` on, up to rounding."""
    return angle - FULL * math.floor((angle + spread + NO_TURN) / FULL)


@kernel
def _steepest(turn: float, spread: float) -> float:
    """Return the maximum of 1 - cos over the angles that differ from `turn` by at most `spread`."""
    if spread >= 0.5 * math.pi or abs(turn - math.pi) <= spread:
        return 2.0
    return 1.0 - min(math.cos(turn - spread), math.cos(turn + spread))


@kernel
def _with_line(
    x: float, y: float, near: float, a: float, da: float, b: float, db: float, r: float, kind: int,
    mirror: float, rims: Rims,
) -> float:  # fmt: skip
    """Return the bound of LSL (`kind` 0), LSR (1) or LS (2)."""
    cx, cy, blur = x + r * math.sin(a), y - r * math.cos(a), near + 2.0 * r * math.sin(0.5 * da)
    if kind < 2:
        side = r if kind == 0 else -r
        cx, cy = cx - side * math.sin(b), cy + side * math.cos(b)
        blur += 2.0 * r * math.sin(0.5 * db)
    apart, offset = math.sqrt(cx * cx + cy * cy), kind * (3 - kind) * r / (1.0 if kind < 2 else 2.0)
    if apart + blur < offset:
        return math.inf
    if apart <= blur:  # the direction of the line is unknown
        if kind > 0:
            return 0.0
        return r * max(_least_turn(b - a, da + db) - da - db, 0.0)
    spread, tilt, straight = math.asin(blur / apart), 0.0, apart - blur > offset
    if straight and kind > 0:
        tilt = math.asin(offset / apart)
        spread += math.asin(offset / (apart - blur)) - tilt
    elif kind > 0:
        far = math.asin(min(offset / (apart + blur), 1.0))
        tilt = 0.5 * far + 0.25 * math.pi
        spread += 0.25 * math.pi - 0.5 * far
    way = math.atan2(cy, cx) + tilt
    turn = _least_turn(way - a, spread + da)
    parts, whole = r * max(turn - spread - da, 0.0), r * turn
    lost = near - _along(way, spread, mirror, rims) + r * da * _steepest(turn, spread + da)
    if kind < 2:
        turn = _least_turn(b - way if kind == 0 else way - b, spread + db)
        parts, whole = parts + r * max(turn - spread - db, 0.0), whole + r * turn
        lost += r * db * _steepest(turn, spread + db)
    if straight:
        parts += math.sqrt(max((apart - blur) ** 2 - offset * offset, 0.0))
        whole += math.sqrt(max(apart * apart - offset * offset, 0.0))
        return max(parts, whole - lost)
    return parts


@kernel
def _three_turns(
    x: float, y: float, near: float, a: float, da: float, b: float, db: float, r: float
) -> float:
    """Return the bound of LRL, with a middle turn of at least half a circle."""
    cx, cy = x + r * (math.sin(a) - math.sin(b)), y - r * (math.cos(a) - math.cos(b))
    blur = near + 2.0 * r * (math.sin(0.5 * da) + math.sin(0.5 * db))
    apart = math.sqrt(cx * cx + cy * cy)
    if apart - blur > 4.0 * r:
        return math.inf
    most = 2.0 * math.asin(min((apart + blur) / (4.0 * r), 1.0))
    least = 2.0 * math.asin(max(apart - blur, 0.0) / (4.0 * r))
    parts = FULL - most
    if apart <= blur:
        return r * parts
    spread, opening = math.asin(blur / apart) + 0.25 * (most - least), 0.5 * (most + least)
    back = math.atan2(cy, cx) + math.pi
    first = _least_turn(back - 0.5 * opening - a, spread + da)
    third = _least_turn(b - back - 0.5 * opening, spread + db)
    parts += max(first - spread - da, 0.0) + max(third - spread - db, 0.0)
    return r * max(parts, first + third + FULL - opening - da - db - (most - least))


@kernel
def _two_turns(x: float, y: float, near: float, a: float, da: float, r: float) -> float:
    """Return the bound of RL to a point in the left circle, with a second turn above half a circle."""
    sin, cos, blur = r * math.sin(a), r * math.cos(a), near + 2.0 * r * math.sin(0.5 * da)
    apart = math.sqrt((x - sin) ** 2 + (y + cos) ** 2)
    if math.sqrt((x + sin) ** 2 + (y - cos) ** 2) - blur >= r or apart - blur > 3.0 * r:
        return math.inf
    low, high = min(max(apart - blur, r), 3.0 * r), min(max(apart + blur, r), 3.0 * r)
    parts = FULL - math.acos(min(max(1.25 - 0.25 * (high / r) ** 2, -1.0), 1.0))
    if apart <= blur:
        return r * parts
    first = math.acos(min((3.0 * r * r + low * low) / (4.0 * r * low), 1.0))
    last = math.acos(min((3.0 * r * r + high * high) / (4.0 * r * high), 1.0))
    most = math.pi / 6.0 if low < math.sqrt(3.0) * r < high else max(first, last)
    spread = math.asin(blur / apart) + 0.5 * (most - min(first, last)) + da
    ahead = a + 0.5 * math.pi - math.atan2(y + cos, x - sin) + 0.5 * (most + min(first, last))
    return r * (parts + max(_least_turn(ahead, spread) - spread, 0.0))


@kernel(interpretable=True)
def least_flight(
    x: float, y: float, near: float, a: float, da: float, b: float, db: float, r: float, rims: Rims
) -> float:
    """Return a lower bound on the length of all flights between two sets of poses, in m.

    Parameters
    ----------
    x, y, near : float
        Displacement, and the largest deviation from it (m).
    a, da, b, db : float
        Heading at the start and at the end, and their largest deviations (rad); π for a free one.
    r : float
        Turning radius (m), above 0.
    rims : Rims
        Parts of `near` that are arcs.
    """
    line = max(math.sqrt(x * x + y * y) - near, 0.0)
    if da >= math.pi and db >= math.pi:
        return line
    if da >= math.pi:  # fly backwards
        x, y, a, da, db = -x, -y, b + math.pi, db, math.pi
    best = math.inf
    for mirror in (1.0, -1.0):
        my, ma, mb = mirror * y, mirror * a, mirror * b
        kind = 2 if db >= math.pi else 0
        best = min(best, _with_line(x, my, near, ma, da, mb, db, r, kind, mirror, rims))
        if db >= math.pi:
            best = min(best, _two_turns(x, my, near, ma, da, r))
        else:
            best = min(best, _with_line(x, my, near, ma, da, mb, db, r, 1, mirror, rims))
            best = min(best, _three_turns(x, my, near, ma, da, mb, db, r))
    return max(line, best)


@kernel
def _place(cell: Floats, node: Floats) -> tuple[float, float, float, float]:
    """Return a point, the largest distance from it of the places of a cell, and the part due to its arc."""
    middle, driven = 0.5 * (cell[LOW] + cell[HIGH]), 0.5 * (cell[HIGH] - cell[LOW])
    x, y, radius = node[0] + node[2] * middle, node[1] + node[3] * middle, node[4]
    driven *= math.sqrt(node[2] ** 2 + node[3] ** 2)
    chord = 2.0 * math.sin(0.5 * cell[PHI_HALF])
    if chord < 1.0:
        x, y = x + radius * math.cos(cell[PHI]), y + radius * math.sin(cell[PHI])
        return x, y, driven + radius * chord, radius * chord
    return x, y, driven + radius, 0.0


@kernel
def _flight(
    cell: Floats, place: tuple[float, float, float, float], to: Floats,
    end: tuple[float, float, float, float], r: float, most: float,
) -> float:  # fmt: skip
    """Return the bound on flights from a cell to another, given :func:`_place` of both; inf if at least `most`."""
    x, y, near = end[0] - place[0], end[1] - place[1], place[2] + end[2]
    if not max(math.sqrt(x * x + y * y) - near, 0.0) < most:
        return math.inf
    rims = Rims(place[3], cell[PHI], cell[PHI_HALF], end[3], to[PHI], to[PHI_HALF])
    return least_flight(
        x, y, near, cell[THETA], cell[THETA_HALF], to[THETA], to[THETA_HALF], r, rims
    )


@kernel(interpretable=True)
def arrivals(
    cells: Floats, node: Floats, times: Floats, after: Floats, goal: Floats, r: float, met: Floats
) -> None:
    """Fill `met` with the least length flown at each cell of `after`; inf if none is possible.

    `times` are those of the `cells` before. `node` and `goal` are x, y (m), velocity relative to the
    speed of the UAV (2) and radius (m) of the vehicles of both.
    """
    for j in range(len(after)):
        to, best = after[j], math.inf
        end = _place(to, goal)
        for i in range(len(cells)):
            place = _place(cells[i], node)
            best = min(best, times[i] + _flight(cells[i], place, to, end, r, best - times[i]))
        best = max(best, to[LOW])
        met[j] = best if best <= to[HIGH] else math.inf


@kernel(interpretable=True)
def tails(
    cells: Floats, node: Floats, times: Floats, after: Floats, goal: Floats, rests: Floats, r: float,
    rest: Floats,
) -> None:  # fmt: skip
    """Fill `rest` with the least length flown after each cell; `rests` are those of the cells after."""
    for i in range(len(cells)):
        cell, best = cells[i], math.inf
        place = _place(cell, node)
        for j in range(len(after)):
            to = after[j]
            if not times[i] <= to[HIGH]:
                continue
            flight = _flight(cell, place, to, _place(to, goal), r, best - rests[j])
            if times[i] + flight <= to[HIGH]:
                best = min(best, flight + rests[j])
        rest[i] = best
