"""Searches along neighbouring cells with a heap: shortest paths with weights, and a quick first path."""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.search_kernels import DONE, STOPPED, ahead, box_around, steps_of

__all__ = ["back", "greedy", "weighted"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_DIAGONAL = math.sqrt(2.0)


@kernel
def remaining(row: int, column: int, box: Ints, diagonal: bool) -> float:
    """Return the distance, in cells, to the rectangle `box` on a map without blocked cells."""
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
) -> tuple[int, Floats, Ints, int, float]:
    """Return the cost of each cell, exact at the goals, and its predecessor.

    A step costs its length in cells times the mean weight of its two cells. The other arguments are
    those of :func:`crosstrack.models.grid_path.search_kernels.sweep`. Ties go to the cell with the
    greater cost, then to the lower number.

    The result is the status, the costs, infinite for unreached cells, the predecessors, -1 for unreached
    cells and the start itself for the start, the number of expansions, as a cell may be expanded more
    than once, and, if stopped, a lower bound on the cost of every goal whose cost may decrease.
    """
    costs = np.full(walls.size, np.inf)
    parents = np.full(walls.size, -1)
    done = np.zeros(walls.size, np.uint8)
    is_goal = np.zeros(walls.size, np.uint8)
    box = box_around(goals, width)
    missing = 0
    for goal in goals:
        missing += 1 - is_goal[goal]
        is_goal[goal] = 1
    if not every:
        missing = 1
    lightest = 0.0
    if guided:
        lightest = np.inf
        for k in range(walls.size):
            if walls[k] == 0:
                lightest = min(lightest, weights[k])
    costs[start] = 0.0
    parents[start] = start
    heap = [(0.0, 0.0, start)]
    expanded = 0
    bound = 0.0
    while len(heap) > 0:
        bound = heap[0][0]
        if flag[0] != 0:
            return STOPPED, costs, parents, expanded, bound
        _, minus, cell = heappop(heap)
        here = costs[cell]
        if done[cell] != 0 or -minus > here:
            continue
        done[cell] = 1
        if is_goal[cell] != 0:
            is_goal[cell] = 0
            missing -= 1
            if missing == 0:
                break
        expanded += 1
        row = cell // width
        column = cell - row * width
        for down in range(-1, 2):
            for across in range(-1, 2):
                turned = down != 0 and across != 0
                neighbour = cell + down * width + across
                if walls[neighbour] != 0 or (turned and not diagonal):
                    continue
                if turned and (walls[cell + down * width] | walls[cell + across]) != 0:
                    continue
                step = 0.5 * (weights[cell] + weights[neighbour])
                total = here + (step * _DIAGONAL if turned else step)
                if total >= costs[neighbour]:
                    continue
                costs[neighbour] = total
                parents[neighbour] = cell
                done[neighbour] = 0  # rounding may make the bound a little inconsistent
                order = total
                if guided:
                    order += lightest * remaining(row + down, column + across, box, diagonal)
                heappush(heap, (order, -total, neighbour))
    return DONE, costs, parents, expanded, bound


@kernel(interpretable=True)
def greedy(
    walls: Bytes, width: int, start: int, goals: Ints, diagonal: bool, flag: NDArray[np.int8]
) -> tuple[int, int, Ints]:
    """Return a path to one of the goals, by greedy best-first search.

    The search expands the cell with the lowest bound on the remaining cost, and each cell once. Its path
    is the first plan of an exact search with a time limit. The arguments are those of :func:`weighted`.

    The result is the status, the goal that the search reached, or -1, and the predecessors of the
    visited cells; the start is its own.
    """
    steps = steps_of(width, diagonal)
    box = box_around(goals, width)
    parents = np.empty(walls.size, np.int64)
    seen = walls.copy()
    is_goal = np.zeros(walls.size, np.uint8)
    for goal in goals:
        is_goal[goal] = 1
    seen[start] = 1
    parents[start] = start
    heap = [(0, start)]
    while len(heap) > 0:
        if flag[0] != 0:
            return STOPPED, -1, parents
        _, cell = heappop(heap)
        if is_goal[cell] != 0:
            return DONE, cell, parents
        row = cell // width
        column = cell - row * width
        for turn in range(len(steps)):
            down, across = steps[turn, 2], steps[turn, 3]
            to = cell + steps[turn, 0]
            if seen[to] != 0 or (walls[cell + down * width] | walls[cell + across]) != 0:
                continue
            seen[to] = 1
            parents[to] = cell
            heappush(heap, (ahead(row + down, column + across, box, diagonal), to))
    return DONE, -1, parents


@kernel(interpretable=True)
def back(parents: Ints, goal: int) -> Ints:
    """Return the cells from the start to `goal` by the predecessor of each cell; the start is its own."""
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
