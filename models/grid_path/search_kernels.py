"""Shortest paths among the neighbours of cells: loops on a flat map with a blocked frame.

A step along a row or column costs :data:`STRAIGHT` and a diagonal one :data:`DIAGONAL`, whole numbers
whose ratio is a convergent of the continued fraction of √2. No fraction with a smaller denominator
lies between the two, so sums of up to STRAIGHT steps compare as the true lengths do, ties included.
Divided by STRAIGHT they are the lengths in cells, to the last digit of a float.

A map is flat, with one blocked cell around it: the cell in row r and column c of the map is number
``(r + 1) * width + c + 1``, where width is the number of columns plus 2. What is left of
:data:`CEILING` at a cell stands for its cost, so that 0 means a cell that was never met.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["CEILING", "DIAGONAL", "DONE", "STOPPED", "STRAIGHT", "ahead", "sweep", "trace"]

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

#: Costs of a step. Every sum of 2**26 of them, the most that a path has, is exact as a float too.
STRAIGHT, DIAGONAL = 93_222_358, 131_836_323
#: Above every cost of a path.
CEILING = 2**60
#: How a search ends.
DONE, STOPPED = 1, -1

#: What is kept of a cell beside whether it is blocked.
_BLOCKED, _WAITING, _GOAL = 1, 2, 4
#: Costs from one multiple of 2**_SHIFT to the next share a bucket. The width is below 2 - √2 cells,
#: the least by which a step can raise a guided cost at all; no step raises it by more than 2 √2
#: cells, so that _RING buckets hold all that waits.
_SHIFT, _RING = 25, 16


@kernel
def ahead(row: int, column: int, box: Ints, diagonal: bool) -> int:
    """Return the cost from a cell to the nearest of the rectangle `box` were no cell blocked.

    Parameters
    ----------
    row, column : int
        The cell, in the frame.
    box : ndarray of int64, shape (4,)
        Least row, most row, least column and most column.
    diagonal : bool
        Whether steps may be diagonal.
    """
    down = max(box[0] - row, row - box[1], 0)
    across = max(box[2] - column, column - box[3], 0)
    if not diagonal:
        return (down + across) * STRAIGHT
    return abs(down - across) * STRAIGHT + min(down, across) * DIAGONAL


@kernel(interpretable=True)
def sweep(
    walls: Bytes,
    width: int,
    start: int,
    goals: Ints,
    every: bool,
    diagonal: bool,
    guided: bool,
    flag: NDArray[np.int8],
) -> tuple[int, Ints, int]:
    """Return what is left of CEILING at each cell, right at the goals and along the ways to them.

    Cells wait in a ring of buckets and the latest of a bucket leaves first. Within a bucket costs may
    come in any order, so a cell that gets cheaper waits again; the search ends when no cell that waits
    can improve a goal.

    Parameters
    ----------
    walls : ndarray of uint8, shape (cells,)
        1 where blocked.
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
        Whether cells are ordered by the cost of the way there plus :func:`ahead` (A*), else by the
        former alone (Dijkstra).
    flag : ndarray of int8, shape (1,)
        Nonzero stops the search.

    Returns
    -------
    status : int
        ``DONE`` or ``STOPPED``.
    left : ndarray of int64, shape (cells,)
        CEILING minus the cost; 0 where no way was found.
    expanded : int
        How often the neighbours of a cell were looked at.
    """
    state = walls.copy()
    left = np.zeros(walls.size, np.int64)
    box = np.zeros(4, np.int64)
    box[0] = box[2] = walls.size
    missing = 0
    for goal in goals:
        row, column = goal // width, goal % width
        box[0], box[1] = min(box[0], row), max(box[1], row)
        box[2], box[3] = min(box[2], column), max(box[3], column)
        if state[goal] & _GOAL == 0:
            state[goal] |= _GOAL
            missing += 1
    if not every:
        missing = 1
    ring = np.empty((_RING, 256), np.int64)
    sizes = np.zeros(_RING, np.int64)
    waiting, expanded = 1, 0
    # The least that is left at a wanted goal: a way that leaves no more is of no use.
    least = 0
    left[start] = CEILING
    state[start] |= _WAITING
    if state[start] & _GOAL:
        missing -= 1
        if missing == 0:
            least = CEILING
    at = 0
    if guided:
        at = ahead(start // width, start % width, box, diagonal) >> _SHIFT
    ring[at % _RING, 0] = start
    sizes[at % _RING] = 1
    while waiting > 0:
        if flag[0] != 0:
            return STOPPED, left, expanded
        while sizes[at % _RING] == 0:
            at += 1
        if CEILING - (at << _SHIFT) <= least:
            break
        bucket = at % _RING
        sizes[bucket] -= 1
        waiting -= 1
        cell = ring[bucket, sizes[bucket]]
        if state[cell] & _WAITING == 0:
            continue  # it left before, from a lower bucket
        state[cell] &= ~_WAITING & 255
        here = left[cell]
        row, column = 0, 0
        if guided:
            row = cell // width
            column = cell - row * width
            if here - ahead(row, column, box, diagonal) <= least:
                continue
        elif here <= least:
            continue
        expanded += 1
        for turn in range(8 if diagonal else 4):
            down, across = 0, 0
            cost = STRAIGHT
            if turn < 4:
                if turn < 2:
                    across = 2 * turn - 1
                else:
                    down = 2 * turn - 5
            else:
                down, across = 2 * (turn % 2) - 1, 2 * (turn // 6) - 1
                cost = DIAGONAL
            to = cell + down * width + across
            then = here - cost
            if state[to] & _BLOCKED or then <= left[to]:
                continue
            if turn >= 4 and (state[cell + down * width] | state[cell + across]) & _BLOCKED:
                continue
            order = then
            if guided:
                order = then - ahead(row + down, column + across, box, diagonal)
            if order <= least:
                continue
            known = left[to] > 0
            left[to] = then
            if state[to] & _GOAL:
                if not known:
                    missing -= 1
                if not every:
                    least = then
                elif missing <= 0:
                    least = CEILING
                    for goal in goals:
                        least = min(least, left[goal])
            state[to] |= _WAITING
            bucket = ((CEILING - order) >> _SHIFT) % _RING
            if sizes[bucket] == ring.shape[1]:
                larger = np.empty((_RING, 2 * ring.shape[1]), np.int64)
                for k in range(_RING):
                    for i in range(sizes[k]):
                        larger[k, i] = ring[k, i]
                ring = larger
            ring[bucket, sizes[bucket]] = to
            sizes[bucket] += 1
            waiting += 1
    return DONE, left, expanded


@kernel(interpretable=True)
def trace(walls: Bytes, width: int, left: Ints, goal: int, diagonal: bool) -> Ints:
    """Return the cells of a shortest path to `goal`, given what :func:`sweep` left at each cell."""
    count, cell = 1, goal
    path = np.empty(256, np.int64)
    path[0] = goal
    while left[cell] != CEILING:
        found = -1
        for turn in range(8 if diagonal else 4):
            down, across = 0, 0
            cost = STRAIGHT
            if turn < 4:
                if turn < 2:
                    across = 2 * turn - 1
                else:
                    down = 2 * turn - 5
            else:
                down, across = 2 * (turn % 2) - 1, 2 * (turn // 6) - 1
                cost = DIAGONAL
            before = cell + down * width + across
            if left[before] != left[cell] + cost:
                continue
            if turn >= 4 and walls[cell + down * width] | walls[cell + across]:
                continue
            found = before
            break
        if found < 0:
            return path[:0]  # never, for every cost on the way was settled
        cell = found
        if count == path.size:
            longer = np.empty(2 * count, np.int64)
            for i in range(count):
                longer[i] = path[i]
            path = longer
        path[count] = cell
        count += 1
    return path[:count][::-1].copy()
