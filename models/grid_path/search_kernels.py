"""Shortest paths along neighbouring cells: kernels on a flat map with a blocked frame.

A step along a row or column costs :data:`STRAIGHT` and a diagonal step :data:`DIAGONAL`, integers
whose ratio is a convergent of the continued fraction of √2. No fraction with a smaller denominator is
between the ratio and √2, so sums of up to STRAIGHT steps have the same order and ties as the true
lengths. Divided by STRAIGHT, they equal the lengths in cells to the last digit of a float.

The map has a frame of blocked cells. The cell in row r and column c has the number
``(r + 1) * width + c + 1``, where width is the number of columns plus 2. The kernels store the
remainder :data:`CEILING` minus the cost for each cell, so that 0 marks an unvisited cell.
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
    "sweep_in",
    "trace",
    "trace_in",
]

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

#: Costs of a step. A path has at most 2**26 steps, and the sum of their costs is exact as a float, too.
STRAIGHT, DIAGONAL = 93_222_358, 131_836_323
#: Upper limit on the cost of a path.
CEILING = 2**60
#: Status of a search.
DONE, STOPPED = 1, -1

#: Bits of the state of a cell.
_BLOCKED, _WAITING, _GOAL = 1, 2, 4
#: A bucket holds the costs between two multiples of 2**_SHIFT, a third of a cell. A step raises a guided
#: cost by 0 or at least 2 - √2 cells, more than a bucket, so few cells improve within their bucket. A
#: step raises it by at most 2 √2 cells, so _RING buckets suffice for the queue.
_SHIFT, _RING = 25, 16


@kernel
def ahead(row: int, column: int, box: Ints, diagonal: bool) -> int:
    """Return the cost from a cell to the rectangle `box` on a map without blocked cells.

    Row and column include the frame. `box` is the first and last row, and the first and last column.
    """
    down = max(box[0] - row, row - box[1], 0)
    across = max(box[2] - column, column - box[3], 0)
    if not diagonal:
        return int((down + across) * STRAIGHT)
    return int(abs(down - across) * STRAIGHT + min(down, across) * DIAGONAL)


@kernel
def steps_of(width: int, diagonal: bool) -> Ints:
    """Return the change of the cell number, the cost, the rows and the columns of each step, shape (n, 4)."""
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
    """Return the first and last row, and the first and last column of cells, shape (4,)."""
    rows, columns = numbers // width, numbers % width
    return np.array([rows.min(), rows.max(), columns.min(), columns.max()])


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
) -> tuple[int, Ints, int, int]:
    """Return CEILING minus the cost for each cell, exact at the goals and along the paths to them.

    The queue is a ring of buckets, each last in, first out. It is 3 to 5 times as fast as a heap on a
    map of a million cells, see :func:`crosstrack.solvers.grid_path.heap_kernels.weighted`. Costs within
    a bucket are unordered, so an improved cell enters the queue again. The search ends when no queued
    cell can improve a goal.

    Start and goals are numbers of free cells of the flat map `walls` of `width` cells per row with a
    frame. The search reaches all goals if `every`, otherwise the nearest. If `diagonal`, steps may be
    diagonal, without cutting corners. If `guided`, cells are ordered by their cost plus :func:`ahead`
    (A*), otherwise by their cost (Dijkstra). A nonzero `flag` stops the search.

    The result is the status, the remainders, which are 0 for unreached cells, the number of expanded
    cells and, if stopped, a lower bound on the cost of every goal whose cost may decrease.
    """
    left = np.zeros(walls.size, np.int64)
    status, expanded, least = sweep_in(
        walls.copy(), left, CEILING, width, start, goals, every, diagonal, guided, flag
    )
    return status, left, expanded, least


@kernel(shared=True)
def sweep_in(
    state: Bytes, left: Ints, ceiling: int, width: int, start: int, goals: Ints, every: bool,
    diagonal: bool, guided: bool, flag: NDArray[np.int8],
) -> tuple[int, int, int]:  # fmt: skip
    """Search like :func:`sweep` in given arrays, so that many searches on a map share them.

    `state` is the map, and is the map again afterwards. `left` receives `ceiling` minus the cost of each
    reached cell. Its former entries must be less than every remainder of this search.
    """
    steps = steps_of(width, diagonal)
    box = box_around(goals, width)
    missing = 0
    for goal in goals:
        missing += 1 if state[goal] == 0 else 0
        state[goal] |= _GOAL
    if not every:
        missing = 1
    ring = np.empty((_RING, 256), np.int64)
    sizes = np.zeros(_RING, np.int64)
    at = 0
    if guided:
        at = ahead(start // width, start % width, box, diagonal) >> _SHIFT
    ring[at % _RING, 0] = start
    sizes[at % _RING] = 1
    left[start] = ceiling
    state[start] |= _WAITING
    waiting, expanded, status = 1, 0, DONE
    # Remainder at the farthest of the goals to reach. Paths with no larger remainder are useless.
    limit = 0
    while waiting > 0:
        if flag[0] != 0:
            status = STOPPED
            break
        while sizes[at % _RING] == 0:
            at += 1
        if ceiling - (at << _SHIFT) <= limit:
            break
        bucket = at % _RING
        sizes[bucket] -= 1
        waiting -= 1
        cell = ring[bucket, sizes[bucket]]
        if state[cell] & _WAITING == 0:
            continue  # expanded before, from a lower bucket
        here = left[cell]
        order, row, column = here, 0, 0
        if guided:
            row = cell // width
            column = cell - row * width
            order -= ahead(row, column, box, diagonal)
        if order <= limit:
            state[cell] &= _GOAL
            continue
        if state[cell] & _GOAL:
            missing -= 1
            if missing <= 0:
                limit = here
                for goal in goals:
                    limit = min(limit, left[goal]) if every else max(limit, left[goal])
        state[cell] = 0
        expanded += 1
        for turn in range(len(steps)):
            to = cell + steps[turn, 0]
            remainder = here - steps[turn, 1]
            if remainder <= left[to] or state[to] & _BLOCKED:
                continue
            down, across = steps[turn, 2], steps[turn, 3]
            if (state[cell + down * width] | state[cell + across]) & _BLOCKED:
                continue
            order = remainder
            if guided:
                order -= ahead(row + down, column + across, box, diagonal)
            if order <= limit:
                continue
            left[to] = remainder
            state[to] |= _WAITING
            bucket = ((ceiling - order) >> _SHIFT) % _RING
            if sizes[bucket] == ring.shape[1]:
                ring = np.hstack((ring, np.empty_like(ring)))
            ring[bucket, sizes[bucket]] = to
            sizes[bucket] += 1
            waiting += 1
    for bucket in range(_RING):
        for k in range(sizes[bucket]):
            state[ring[bucket, k]] = 0
    for goal in goals:
        state[goal] &= _BLOCKED
    return status, expanded, at << _SHIFT


@kernel
def before(walls: Bytes, width: int, steps: Ints, left: Ints, cell: int) -> int:
    """Return the predecessor of `cell` on its path."""
    for turn in range(len(steps)):
        other = cell + steps[turn, 0]
        corners = walls[cell + steps[turn, 2] * width] | walls[cell + steps[turn, 3]]
        if left[other] == left[cell] + steps[turn, 1] and corners == 0:
            return int(other)
    return cell


@kernel(interpretable=True)
def trace(walls: Bytes, width: int, left: Ints, goal: int, diagonal: bool) -> Ints:
    """Return the cells of a shortest path from the start to `goal` by the remainders of :func:`sweep`."""
    return trace_in(walls, width, left, CEILING, goal, diagonal)


@kernel(shared=True)
def trace_in(walls: Bytes, width: int, left: Ints, ceiling: int, goal: int, diagonal: bool) -> Ints:
    """Return the cells of a shortest path from the start to `goal` by the remainders of :func:`sweep_in`."""
    steps = steps_of(width, diagonal)
    count, cell = 1, goal
    while left[cell] != ceiling:
        cell = before(walls, width, steps, left, cell)
        count += 1
    path = np.empty(count, np.int64)
    path[count - 1] = goal
    for k in range(count - 2, -1, -1):
        path[k] = before(walls, width, steps, left, path[k + 1])
    return path
