"""Shortest paths among the neighbours of cells that have weights."""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.search_kernels import DONE, STOPPED, box_around

__all__ = ["back", "weighted"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_DIAGONAL = math.sqrt(2.0)


@kernel
def bound(row: int, column: int, box: Ints, diagonal: bool) -> float:
    """Return the distance in cells to the nearest of the rectangle `box` were no cell blocked."""
    down = max(box[0] - row, row - box[1], 0)
    across = max(box[2] - column, column - box[3], 0)
    if not diagonal:
        return float(down + across)
    return float(abs(down - across) + min(down, across) * _DIAGONAL)


@kernel(interpretable=True)
def weighted(
    walls: Bytes,
    weights: Floats,
    width: int,
    start: int,
    goals: Ints,
    every: bool,
    diagonal: bool,
    guided: bool,
    flag: NDArray[np.int8],
) -> tuple[int, Floats, Ints, int]:
    """Return the cost at each cell, right at the goals, and the cell before it.

    Of equal orders the cell with the greater cost leaves first, then that with the least number.

    Parameters
    ----------
    walls : ndarray of uint8, shape (cells,)
        1 where blocked; see :mod:`crosstrack.models.grid_path.search_kernels`.
    weights : ndarray, shape (cells,)
        A step costs its length in cells times the mean weight of its two cells.
    width : int
        Cells of a row, the frame included.
    start : int
        Number of a free cell.
    goals : ndarray of int64
        Numbers of free cells.
    every : bool
        Whether all goals are wanted, else the nearest.
    diagonal : bool
        Whether steps may be diagonal; they never cut corners.
    guided : bool
        Whether a lower bound on the rest is added to the order.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the search.

    Returns
    -------
    status : int
        ``DONE`` or ``STOPPED``.
    costs : ndarray, shape (cells,)
        Infinite where no way was found.
    parents : ndarray of int64, shape (cells,)
        The start is its own.
    expanded : int
        How often the neighbours of a cell were looked at.
    """
    costs = np.full(walls.size, np.inf)
    parents = np.full(walls.size, -1)
    done = np.zeros(walls.size, np.uint8)
    wanted = np.zeros(walls.size, np.uint8)
    box = box_around(goals, width)
    missing = 0
    for goal in goals:
        missing += 1 - wanted[goal]
        wanted[goal] = 1
    if not every:
        missing = 1
    least = 0.0
    if guided:
        least = np.inf
        for k in range(walls.size):
            if walls[k] == 0:
                least = min(least, weights[k])
    costs[start] = 0.0
    parents[start] = start
    heap = [(0.0, 0.0, start)]
    expanded = 0
    while len(heap) > 0:
        if flag[0] != 0:
            return STOPPED, costs, parents, expanded
        _, minus, cell = heappop(heap)
        here = costs[cell]
        if done[cell] != 0 or -minus > here:
            continue
        done[cell] = 1
        if wanted[cell] != 0:
            wanted[cell] = 0
            missing -= 1
            if missing == 0:
                break
        expanded += 1
        row = cell // width
        column = cell - row * width
        for down in range(-1, 2):
            for across in range(-1, 2):
                turned = down != 0 and across != 0
                to = cell + down * width + across
                if walls[to] != 0 or (turned and not diagonal):
                    continue
                if turned and (walls[cell + down * width] | walls[cell + across]) != 0:
                    continue
                step = 0.5 * (weights[cell] + weights[to])
                then = here + (step * _DIAGONAL if turned else step)
                if then >= costs[to]:
                    continue
                costs[to] = then
                parents[to] = cell
                done[to] = 0  # rounding may make the bound a little inconsistent
                order = then
                if guided:
                    order += least * bound(row + down, column + across, box, diagonal)
                heappush(heap, (order, -then, to))
    return DONE, costs, parents, expanded


@kernel(interpretable=True)
def back(parents: Ints, goal: int) -> Ints:
    """Return the cells from the start to `goal`."""
    count, cell = 1, goal
    while parents[cell] != cell:
        cell = parents[cell]
        count += 1
    path = np.empty(count, np.int64)
    cell = goal
    for k in range(count - 1, -1, -1):
        path[k] = cell
        cell = parents[cell]
    return path
