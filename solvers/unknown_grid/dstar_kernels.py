"""Shortest paths from the target backwards on a flat map: A* from scratch, and D* Lite.

The map has a frame of blocked cells. The cell in row r and column c has the number
``(r + 1) * width + c + 1``, where width is the number of columns plus 2. Every step costs 1. The
lower bound of both searches is the Manhattan distance to the vehicle.

Source: S. Koenig and M. Likhachev, "D* Lite", AAAI 2002, the optimised version.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.unknown_grid.moving import FAR, is_open

__all__ = ["STUCK", "repair", "search"]

Ints = NDArray[np.int64]
Steps = NDArray[np.int32]
Bytes = NDArray[np.uint8]
Flag = NDArray[np.int8]

#: Action of :func:`descend` if no path exists.
STUCK = -1
#: Indices in the tally: number of queued cells, sum of the vehicle's moves (k_m), cell at the last search.
_COUNT, _MOVED, _LAST = 0, 1, 2
#: A key packs two integers into one; the second is below 2**_SHIFT.
_SHIFT = 31


@kernel
def apart(width: int, one: int, other: int, diagonal: bool = False) -> int:
    """Return the Manhattan distance of two cells, with diagonal steps the Chebyshev distance."""
    down = abs(one // width - other // width)
    across = abs(one % width - other % width)
    return max(down, across) if diagonal else down + across


@kernel(interpretable=True)
def search(walls: Bytes, width: int, start: int, target: int, flag: Flag) -> Steps:
    """Return the steps to the target from the cells on shortest paths that :func:`descend` needs at the start, by A*.

    A step towards the start keeps the sum of steps and lower bound, and any other step raises it by 2.
    Two stacks (last in, first out) therefore suffice as a priority queue.

    A nonzero `flag` stops the search. The result is exact on these paths, an upper bound elsewhere, and
    ``FAR`` for unvisited cells.
    """
    steps = np.full(walls.size, FAR, np.int32)
    now, later = np.empty(walls.size, np.int64), np.empty(walls.size, np.int64)
    steps[target] = 0
    now[0] = target
    waiting, deferred = 1, 0
    order = apart(width, start, target)
    first = -1  # preferred neighbour of the start if a path passes it
    while waiting > 0:
        while waiting > 0 and flag[0] == 0:
            waiting -= 1
            cell = now[waiting]
            left = order - steps[cell]
            if apart(width, start, cell) != left:
                continue  # expanded before, on a shorter path
            cost = steps[cell] + 1
            for move in (-width, width, -1, 1):
                to = cell + move
                if walls[to] != 0 or steps[to] <= cost:
                    continue
                steps[to] = cost
                if apart(width, start, to) < left:
                    now[waiting] = to
                    waiting += 1
                else:
                    later[deferred] = to
                    deferred += 1
            if steps[start] <= order:
                if first < 0:
                    for move in (1, -1, width, -width):
                        to = start + move
                        if walls[to] == 0 and apart(width, to, target) < order:
                            first = to
                if steps[first] < order:
                    return steps
        if steps[start] <= order or flag[0] != 0:
            return steps
        now, later = later, now
        waiting, deferred = deferred, 0
        order += 2
    return steps


@kernel
def rise(heap: Ints, where: Steps, keys: Ints, at: int) -> None:
    """Sift the entry at index `at` up the heap."""
    cell = heap[at]
    while at > 0:
        above = (at - 1) // 2
        if keys[heap[above]] <= keys[cell]:
            break
        heap[at] = heap[above]
        where[heap[at]] = at + 1
        at = above
    heap[at] = cell
    where[cell] = at + 1


@kernel
def sink(heap: Ints, where: Steps, keys: Ints, count: int, at: int) -> None:
    """Sift the entry at index `at` down the heap."""
    cell = heap[at]
    while 2 * at + 1 < count:
        below = 2 * at + 1
        if below + 1 < count and keys[heap[below + 1]] < keys[heap[below]]:
            below += 1
        if keys[heap[below]] >= keys[cell]:
            break
        heap[at] = heap[below]
        where[heap[at]] = at + 1
        at = below
    heap[at] = cell
    where[cell] = at + 1


@kernel
def place(
    cell: int, key: int, here: bool, heap: Ints, where: Steps, keys: Ints, tally: Ints
) -> None:
    """Insert a cell into the queue, update its key, or remove it."""
    at = where[cell] - 1
    if here and at < 0:
        at = tally[_COUNT]
        tally[_COUNT] += 1
        heap[at] = cell
        keys[cell] = key
        rise(heap, where, keys, at)
    elif here:
        before, keys[cell] = keys[cell], key
        if key < before:
            rise(heap, where, keys, at)
        elif key > before:
            sink(heap, where, keys, tally[_COUNT], at)
    elif at >= 0:
        where[cell] = 0
        tally[_COUNT] -= 1
        other = heap[tally[_COUNT]]
        if other != cell:
            heap[at] = other
            rise(heap, where, keys, at)
            sink(heap, where, keys, tally[_COUNT], where[other] - 1)


@kernel
def key_of(
    cell: int, width: int, start: int, g: Steps, rhs: Steps, tally: Ints, diagonal: bool
) -> int:
    """Return the key of a cell: the sum of steps and lower bound, then the steps."""
    steps = min(g[cell], rhs[cell])
    return int(((steps + apart(width, start, cell, diagonal) + tally[_MOVED]) << _SHIFT) | steps)


@kernel
def foresee(
    walls: Bytes, width: int, target: int, cell: int, g: Steps, rhs: Steps, moves: Ints, sides: int
) -> None:
    """Compute the one-step lookahead value of a cell (rhs)."""
    if cell == target:
        rhs[cell] = 0
        return
    best = FAR
    if walls[cell] == 0:
        for action in range(len(moves)):
            to = cell + moves[action]
            if g[to] + 1 < best and is_open(walls, width, cell, action, moves[action], sides):
                best = g[to] + 1
    rhs[cell] = best


@kernel
def repair(
    walls: Bytes,
    width: int,
    start: int,
    target: int,
    changed: Steps,
    g: Steps,
    rhs: Steps,
    heap: Ints,
    where: Steps,
    keys: Ints,
    tally: Ints,
    flag: Flag,
    moves: Ints,
    sides: int,
) -> bool:
    """Update `g` on all shortest paths from the start by D* Lite; return False if `flag` stopped the search.

    `walls` is the current map, and `start` the cell of the vehicle. `changed` are the cells blocked or
    freed since the previous call; the first call also includes the target. `g` and `rhs` are the steps
    to the target and their one-step lookahead values, initially ``FAR``. `heap` is the binary heap
    of the inconsistent cells, whose g and rhs differ, `where` the index of each cell in it plus 1,
    initially 0, and `keys` their keys. `tally` is the state between calls, initially ``(0, 0, start)``.
    `moves` are the changes of the cell number by 4 or 8 actions, see :func:`~.moving.spread`.
    """
    diagonal = len(moves) > 4
    tally[_MOVED] += apart(width, tally[_LAST], start, diagonal)
    tally[_LAST] = start
    for cell in changed:
        # A cell beside a diagonal step changes the step between two of its neighbours.
        for action in range(-1, len(moves)):
            near = cell + (moves[action] if action >= 0 else 0)
            foresee(walls, width, target, near, g, rhs, moves, sides)
            key = key_of(near, width, start, g, rhs, tally, diagonal)
            place(near, key, g[near] != rhs[near], heap, where, keys, tally)
    while tally[_COUNT] > 0:
        if flag[0] != 0:
            return False
        cell = heap[0]
        smallest = keys[cell]
        # If the smallest key reaches the key of the start, no queued cell is on a shortest path.
        if (
            smallest >= key_of(start, width, start, g, rhs, tally, diagonal)
            and rhs[start] <= g[start]
        ):
            break
        key = key_of(cell, width, start, g, rhs, tally, diagonal)
        if smallest < key:  # outdated, because the vehicle has moved
            place(cell, key, True, heap, where, keys, tally)
            continue
        before = g[cell]
        if before > rhs[cell]:
            g[cell] = rhs[cell]
            place(cell, key, False, heap, where, keys, tally)
        else:
            g[cell] = FAR
            place(cell, key_of(cell, width, start, g, rhs, tally, diagonal), g[cell] != rhs[cell],
                  heap, where, keys, tally)  # fmt: skip
        for action in range(len(moves)):
            near = cell + moves[action]
            if near == target or not is_open(walls, width, cell, action, moves[action], sides):
                continue
            if g[cell] < FAR:
                if rhs[near] <= g[cell] + 1:
                    continue
                rhs[near] = g[cell] + 1
            elif rhs[near] == before + 1:
                foresee(walls, width, target, near, g, rhs, moves, sides)
            else:
                continue
            key = key_of(near, width, start, g, rhs, tally, diagonal)
            place(near, key, g[near] != rhs[near], heap, where, keys, tally)
    return True
