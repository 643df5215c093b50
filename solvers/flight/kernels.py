"""Kernels on maps of cells with up to three axes: A* over 26 neighbours, and lines of sight.

The maps are flat arrays with a frame of blocked cells. A 2-D map has one layer of cells along z.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["sees", "shortened", "walk"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_FACE, _EDGE, _CORNER = 1.0, math.sqrt(2.0), math.sqrt(3.0)
#: Distance between samples of a line of sight, in cells; its margin is at least as large.
SPACING = 0.2


@kernel
def _ahead(across: int, along: int, up: int) -> float:
    """Return the length of a shortest path of cells between free cells, in cells (octile distance)."""
    a, b, c = abs(across), abs(along), abs(up)
    most, least = max(a, b, c), min(a, b, c)
    middle = a + b + c - most - least
    return (most - middle) * _FACE + (middle - least) * _EDGE + least * _CORNER


@kernel(interpretable=True)
def walk(
    walls: Bytes, rows: int, layers: int, start: int, goal: int, flag: NDArray[np.int8]
) -> Ints:
    """Return the cells of a shortest path over 26 neighbours from goal to start; empty without one.

    A step requires that all cells of the box that it crosses are free, so that it cuts no corner. The
    cell (i, j, k) of the framed map has the number ``(i * rows + j) * layers + k``. A nonzero `flag`
    stops the search.
    """
    parents = np.full(walls.size, -1, np.int64)
    costs = np.full(walls.size, np.inf)
    done = np.zeros(walls.size, np.uint8)
    plane = rows * layers
    gx, gy, gz = goal // plane, goal // layers % rows, goal % layers
    costs[start] = 0.0
    parents[start] = start
    heap = [(0.0, start)]
    while len(heap) > 0 and flag[0] == 0:
        _, cell = heappop(heap)
        if cell == goal:
            break
        if done[cell] != 0:
            continue
        done[cell] = 1
        x, y, z = cell // plane, cell // layers % rows, cell % layers
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    to = cell + dx * plane + dy * layers + dz
                    if walls[to] != 0 or done[to] != 0:
                        continue
                    # The faces and edges beside a diagonal step.
                    beside = walls[cell + dx * plane] | walls[cell + dy * layers] | walls[cell + dz]
                    beside |= walls[cell + dx * plane + dy * layers] | walls[cell + dx * plane + dz]
                    if (beside | walls[cell + dy * layers + dz]) != 0:
                        continue
                    cost = costs[cell] + math.sqrt(float(dx * dx + dy * dy + dz * dz))
                    if cost < costs[to]:
                        costs[to] = cost
                        parents[to] = cell
                        heappush(heap, (cost + _ahead(gx - x - dx, gy - y - dy, gz - z - dz), to))
    count = 1
    at = goal
    while parents[at] >= 0 and at != start:
        at = parents[at]
        count += 1
    if at != start:
        return np.empty(0, np.int64)
    path = np.empty(count, np.int64)
    at = goal
    for k in range(count):
        path[k] = at
        at = parents[at]
    return path


@kernel
def sees(walls: Bytes, rows: int, layers: int, a: Floats, b: Floats, margin: Floats) -> bool:
    """Return whether a segment, in cells of the framed map, keeps `margin` per axis from blocked cells."""
    long = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    count = math.ceil(long / SPACING) + 1
    for n in range(count + 1):
        share = n / count
        for i in range(-1, 2, 2):
            x = math.floor(a[0] + share * (b[0] - a[0]) + i * margin[0])
            for j in range(-1, 2, 2):
                y = math.floor(a[1] + share * (b[1] - a[1]) + j * margin[1])
                for k in range(-1, 2, 2):
                    z = math.floor(a[2] + share * (b[2] - a[2]) + k * margin[2])
                    if walls[(x * rows + y) * layers + z] != 0:
                        return False
    return True


@kernel(interpretable=True)
def shortened(walls: Bytes, rows: int, layers: int, path: Floats, margin: Floats) -> Ints:
    """Return the indices of the points of a path that remain if lines of sight replace detours."""
    kept = np.empty(len(path), np.int64)
    kept[0] = 0
    count, at = 1, 0
    while at < len(path) - 1:
        to = at + 1
        while to + 1 < len(path) and sees(walls, rows, layers, path[at], path[to + 1], margin):
            to += 1
        kept[count] = to
        count += 1
        at = to
    return kept[:count]
