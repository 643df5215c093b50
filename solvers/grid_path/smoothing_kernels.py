"""Kernels of :mod:`.smoothing`, with coordinates in cells of the padded map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.sight import sees

__all__ = ["farthest", "first_hidden", "shortest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]
Flag = NDArray[np.int8]

#: Minimum relative gain of an improvement.
GAIN = 1e-12
#: Number of consecutive hidden points after which the scan stops.
LOST = 300


@kernel(interpretable=True)
def first_hidden(blocked: Truths, path: Floats, slack: float) -> int:
    """Return the index of the first segment of `path` that enters a blocked cell, or the number of segments."""
    for k in range(len(path) - 1):
        if not sees(blocked, path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1], slack):
            return k
    return max(len(path) - 1, 0)


@kernel(interpretable=True)
def farthest(blocked: Truths, path: Floats, slack: float, flag: Flag) -> Ints:
    """Return the indices of points that remain if each connects to its farthest visible point.

    Parameters
    ----------
    blocked : ndarray of bool, shape (rows + 2, columns + 2)
        Padded map.
    path : ndarray, shape (n, 2)
        Points x, y of a path through free cells.
    slack : float
        Distance, in cells, below which a segment passes through a corner.
    flag : ndarray of int8, shape (1,)
        If nonzero, the remaining points stay.
    """
    n = len(path)
    chosen = np.empty(n, np.int64)
    size, here = 1, 0
    chosen[0] = 0
    while here < n - 1:
        x, y = path[here, 0], path[here, 1]
        there = n - 1 if flag[0] == 0 else here + 1
        while there > here + 1 and not sees(blocked, x, y, path[there, 0], path[there, 1], slack):
            there -= 1
        here = there
        chosen[size] = here
        size += 1
    return chosen[:size]


@kernel(interpretable=True)
def shortest(blocked: Truths, points: Floats, slack: float, flag: Flag) -> Ints:
    """Return the indices of a shortest path from first to last point along forward lines of sight.

    The result is empty if `flag` stopped the search.

    Parameters
    ----------
    blocked, slack
        See :func:`farthest`.
    points : ndarray, shape (n, 2)
        Points x, y in the order of the path.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the search.
    """
    n = len(points)
    length = np.full(n, np.inf)
    before = np.full(n, -1, np.int64)
    length[0] = 0.0
    for here in range(n - 1):
        if flag[0] != 0:
            return np.empty(0, np.int64)
        x, y = points[here, 0], points[here, 1]
        hidden = 0
        for there in range(here + 1, n):
            tx, ty = points[there, 0], points[there, 1]
            total = length[here] + math.sqrt((tx - x) ** 2 + (ty - y) ** 2)
            if total >= length[there] * (1.0 - GAIN):
                continue
            if sees(blocked, x, y, tx, ty, slack):
                length[there], before[there] = total, here
                hidden = 0
            else:
                hidden += 1
                if hidden > LOST:
                    break
    path = np.empty(n, np.int64)
    path[0], size = n - 1, 1
    while path[size - 1] > 0:
        path[size] = before[path[size - 1]]
        size += 1
    return path[:size][::-1].copy()
