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

__all__ = [
    "CEILING",
    "DIAGONAL",
    "DONE",
    "STOPPED",
    "STRAIGHT",
    "ahead",
    "box_around",
    "steps_of",
    "sweep",
    "trace",
]

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
#: Costs from one multiple of 2**_SHIFT to the next share a bucket, a third of a cell: less than 2 - √2
#: cells, by which a step raises a guided cost if at all, so that few cells get cheaper within their
#: bucket. No step raises it by more than 2 √2 cells, so that _RING buckets hold all that waits.
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
        return int((down + across) * STRAIGHT)
    return int(abs(down - across) * STRAIGHT + min(down, across) * DIAGONAL)


@kernel
def steps_of(width: int, diagonal: bool) -> Ints:
    """Return for each step how the number of the cell changes, its cost, its rows and its columns."""
    steps = np.empty((8 if diagonal else 4, 4), np.int64)
    turn = 0
    for parity in range(1, 3 if diagonal else 2):
        for down in range(-1, 2):
            for across in range(-1, 2):
                if abs(down) + abs(across) == parity:
                    steps[turn, 0] = down * width + across
                    steps[turn, 1] = STRAIGHT if parity == 1 else DIAGONAL
                    steps[turn, 2], steps[turn, 3] = down, across
                    turn += 1
    return steps


@kernel
def box_around(numbers: Ints, width: int) -> Ints:
    """Return least row, most row, least column and most column of cells."""
    box = np.zeros(4, np.int64)
    box[0], box[2] = 2**62, width
    for number in numbers:
        row, column = number // width, number % width
        box[0], box[1] = min(box[0], row), max(box[1], row)
        box[2], box[3] = min(box[2], column), max(box[3], column)
    return box


@kernel
def larger(ring: Ints, sizes: Ints) -> Ints:
    """Return `ring` with twice the room."""
    found = np.empty((len(ring), 2 * ring.shape[1]), np.int64)
    for k in range(len(ring)):
        for i in range(sizes[k]):
            found[k, i] = ring[k, i]
    return found


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
    steps = steps_of(width, diagonal)
    state = walls.copy()
    left = np.zeros(walls.size, np.int64)
    box = box_around(goals, width)
    missing = 0
    for goal in goals:
        missing += 1 if state[goal] == 0 else 0
        state[goal] = _GOAL
    if not every:
        missing = 1
    ring = np.empty((_RING, 256), np.int64)
    sizes = np.zeros(_RING, np.int64)
    at = 0
    if guided:
        at = ahead(start // width, start % width, box, diagonal) >> _SHIFT
    ring[at % _RING, 0] = start
    sizes[at % _RING] = 1
    left[start] = CEILING
    state[start] |= _WAITING
    waiting, expanded = 1, 0
    # What is left at the worst of the goals that are wanted: a way that leaves no more is of no use.
    least = 0
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
        here = left[cell]
        order, row, column = here, 0, 0
        if guided:
            row = cell // width
            column = cell - row * width
            order -= ahead(row, column, box, diagonal)
        if order <= least:
            continue
        if state[cell] & _GOAL:
            missing -= 1
            if missing <= 0:
                least = here
                for goal in goals:
                    least = min(least, left[goal]) if every else max(least, left[goal])
        state[cell] = 0
        expanded += 1
        for turn in range(len(steps)):
            to = cell + steps[turn, 0]
            then = here - steps[turn, 1]
            if then <= left[to] or state[to] & _BLOCKED:
                continue
            down, across = steps[turn, 2], steps[turn, 3]
            if (state[cell + down * width] | state[cell + across]) & _BLOCKED:
                continue
            order = then
            if guided:
                order -= ahead(row + down, column + across, box, diagonal)
            if order <= least:
                continue
            left[to] = then
            state[to] |= _WAITING
            bucket = ((CEILING - order) >> _SHIFT) % _RING
            if sizes[bucket] == ring.shape[1]:
                ring = larger(ring, sizes)
            ring[bucket, sizes[bucket]] = to
            sizes[bucket] += 1
            waiting += 1
    return DONE, left, expanded


@kernel
def before(walls: Bytes, width: int, steps: Ints, left: Ints, cell: int) -> int:
    """Return the cell from which the way to `cell` came."""
    for turn in range(len(steps)):
        other = cell + steps[turn, 0]
        corners = walls[cell + steps[turn, 2] * width] | walls[cell + steps[turn, 3]]
        if left[other] == left[cell] + steps[turn, 1] and corners == 0:
            return int(other)
    return cell


@kernel(interpretable=True)
def trace(walls: Bytes, width: int, left: Ints, goal: int, diagonal: bool) -> Ints:
    """Return the cells of a shortest path to `goal`, given what :func:`sweep` left at each cell."""
    steps = steps_of(width, diagonal)
    count, cell = 1, goal
    while left[cell] != CEILING:
        cell = before(walls, width, steps, left, cell)
        count += 1
    path = np.empty(count, np.int64)
    path[count - 1] = goal
    for k in range(count - 2, -1, -1):
        path[k] = before(walls, width, steps, left, path[k + 1])
    return path
