"""Vehicles that a path passes on the way to others, found on pieces of the path."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import WORDS, advance
from .chain import Scene, Stops, end_time, leg, where

__all__ = ["CLOSEST", "GAP", "LEG", "PIECE", "PIECES", "TIME", "passes", "trace"]

Floats = NDArray[np.float64]

#: Largest angle of a piece of an arc, in rad.
CUT = 0.6
#: Distance of an arc of that angle from its chord, relative to its radius.
BULGE = 1.0 - math.cos(0.5 * CUT)
#: Number of columns of a piece: x, y, heading and time at its beginning, duration, sign of the
#: curvature, leg, and x and y at its end.
PIECE = 9
#: Maximum number of pieces of a leg: a straight line and two arcs.
PIECES = 2 * (int(2.0 * math.pi / CUT) + 2) + 1
#: Number of nearest legs stored per vehicle, and their columns after the pose of the UAV relative to
#: the vehicle: time, number of the leg, distance minus the radius.
CLOSEST, TIME, LEG, GAP = 3, 3, 4, 5


@kernel(interpretable=True, in_place=True)
def trace(stops: Stops, count: int, scene: Scene, pieces: Floats) -> int:
    """Fill `pieces` with the path of a chain; return the number of pieces."""
    order, times, poses, nodes = stops.order, stops.times, stops.poses, scene.nodes
    speed, r = scene.speed, scene.r
    # The start is a piece of length 0.
    pieces[0, 0], pieces[0, 1], pieces[0, 2] = where(nodes[order[0]], poses[order[0]], 0.0)
    pieces[0, 3], pieces[0, 4], pieces[0, 5], pieces[0, 6] = 0.0, 0.0, 0.0, 1.0
    pieces[0, 7], pieces[0, 8] = pieces[0, 0], pieces[0, 1]
    size = 1
    home = end_time(stops, count, scene)
    for k in range(1, count + scene.closed):
        i, t = order[k - 1], times[k - 1]
        x, y, h = where(nodes[i], poses[i], t)
        j = order[k] if k < count else order[0]
        until = times[k] if k < count else home
        ex, ey, eh = where(nodes[j], poses[j], until)
        length = speed * (until - t) if until > 0.0 else 0.0
        a, b, c, word = leg(x, y, h, ex, ey, eh, r, length)
        for part in range(3):
            length = a if part == 0 else b if part == 1 else c
            sign = WORDS[word, part]
            if length <= 0.0:
                continue
            if sign == 0 and r == 0.0:
                h = math.atan2(ey - y, ex - x)
            cuts = 1 if sign == 0 else int(length / (CUT * r)) + 1
            step = length / cuts
            for _ in range(cuts):
                piece = pieces[size]
                piece[0], piece[1], piece[2], piece[3], piece[4] = x, y, h, t, step / speed
                piece[5], piece[6] = sign, k
                x, y, h = advance(x, y, h, step, sign, r)
                piece[7], piece[8] = x, y
                t += step / speed
                size += 1
    return size


@kernel(interpretable=True, in_place=True)
def passes(
    node: Floats, pieces: Floats, count: int, rim: bool, speed: float, r: float, near: Floats
) -> bool:
    """Return whether a path comes within the radius of a node; ``near[0]`` describes the encounter.

    `node` is a row of :attr:`.chain.Scene.nodes`; if `rim`, the encounter must be on the boundary.
    `near`, shape (3, 6), is filled with the nearest legs in order: pose of the UAV relative to the
    node, time, number of the leg, and distance minus the radius (m), which is inf for unused rows.
    """
    for j in range(CLOSEST):
        near[j, LEG], near[j, GAP] = 0.0, math.inf
    outside = False
    for p in range(count):
        piece = pieces[p]
        t, duration = piece[3], piece[4]
        dx = node[0] + node[2] * t - piece[0]
        dy = node[1] + node[3] * t - piece[1]
        # Closest approach of the node to the chord of the piece.
        wx, wy = node[2], node[3]
        if duration > 0.0:
            wx -= (piece[7] - piece[0]) / duration
            wy -= (piece[8] - piece[1]) / duration
        square = wx * wx + wy * wy
        s = min(max(-(dx * wx + dy * wy) / square, 0.0), duration) if square > 0.0 else 0.0
        outside = outside or dx * dx + dy * dy >= node[4] * node[4]
        ox, oy, eh = -dx - wx * s, -dy - wy * s, piece[2]
        gap = math.sqrt(ox * ox + oy * oy) - node[4]
        if gap - BULGE * r >= near[CLOSEST - 1, GAP]:
            continue
        if piece[5] != 0.0:
            ex, ey, eh = advance(piece[0], piece[1], eh, speed * s, int(piece[5]), r)
            ox, oy = ex - node[0] - node[2] * (t + s), ey - node[1] - node[3] * (t + s)
            gap = math.sqrt(ox * ox + oy * oy) - node[4]
        # The row of this leg, or the last one.
        row = 0
        while row < CLOSEST - 1 and near[row, LEG] != piece[6]:
            row += 1
        if gap >= near[row, GAP]:
            continue
        while row > 0 and gap < near[row - 1, GAP]:
            for j in range(GAP + 1):
                near[row, j] = near[row - 1, j]
            row -= 1
        near[row, 0], near[row, 1], near[row, 2] = ox, oy, eh
        near[row, TIME], near[row, LEG], near[row, GAP] = t + s, piece[6], gap
        if gap <= 0.0 and not rim:
            return True
    if count:
        piece = pieces[count - 1]
        t = piece[3] + piece[4]
        dx, dy = node[0] + node[2] * t - piece[7], node[1] + node[3] * t - piece[8]
        outside = outside or dx * dx + dy * dy >= node[4] * node[4]
    return near[0, GAP] <= 0.0 and (outside or not rim)
