"""Shortest paths from the target backwards on a flat map: A* from scratch, and D* Lite.

The map has a frame of blocked cells. The cell in row r and column c has the number
``(r + 1) * width + c + 1``, where width is the number of columns plus 2. Every step costs 1. The
lower bound of both searches is the Manhattan distance to the vehicle.

Source: S. Koenig and M. Likhachev, "D* Lite", AAAI 2002, the optimised version.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.unknown_grid.moving import FAR, Grid, is_open

__all__ = ["STUCK", "Search", "repair", "search"]

Ints = NDArray[np.int64]
Steps = NDArray[np.int32]
Flag = NDArray[np.int8]

#: Action of :func:`descend` if no path exists.
STUCK = -1
#: Indices in the tally: number of queued cells, sum of the vehicle's moves (k_m), cell at the last search.
_COUNT, _MOVED, _LAST = 0, 1, 2
#: A key packs two integers into one; the second is below 2**_SHIFT.
_SHIFT = 31


class Search(NamedTuple):
    """State of D* Lite between calls.

    `g` and `rhs` are the steps to the target and their one-step lookahead values, initially ``FAR``. `heap` is the
    binary heap of the inconsistent cells, whose g and rhs differ, `where` the index of each cell in it plus 1, initially
    0, and `keys` their keys. `tally` is initially ``(0, 0, start)``.
    """

    g: Steps
    rhs: Steps
    heap: Ints
    where: Steps
    keys: Ints
    tally: Ints


@kernel(allocates=False)
def apart(width: int, one: int, other: int, diagonal: bool = False) -> int:
    """Return the Manhattan distance of two cells, with diagonal steps the Chebyshev distance."""
    down = abs(one // width - other // width)
    across = abs(one % width - other % width)
    return max(down, across) if diagonal else down + across


@kernel(interpretable=True)
def search(grid: Grid, start: int, target: int, flag: Flag) -> Steps:
    """Return the steps to the target from the cells on shortest paths that :func:`descend` needs at the start, by A*.

    A step towards the start keeps the sum of steps and lower bound, and any other step raises it by 2.
    Two stacks (last in, first out) therefore suffice as a priority queue.

    A nonzero `flag` stops the search. The result is exact on these paths, an upper bound elsewhere, and
    ``FAR`` for unvisited cells.
    """
    walls, width = grid.walls, grid.width
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


@kernel(allocates=False)
def rise(state: Search, at: int) -> None:
    """Sift the entry at index `at` up the heap."""
    heap, where, keys = state.heap, state.where, state.keys
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


@kernel(allocates=False)
def sink(state: Search, at: int) -> None:
    """Sift the entry at index `at` down the heap."""
    heap, where, keys, count = state.heap, state.where, state.keys, state.tally[_COUNT]
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


@kernel(allocates=False)
def place(state: Search, cell: int, key: int) -> None:
    """Insert an inconsistent cell into the queue or update its key, and remove a consistent one."""
    heap, keys, tally = state.heap, state.keys, state.tally
    at = state.where[cell] - 1
    if state.g[cell] == state.rhs[cell]:
        if at >= 0:
            state.where[cell] = 0
            tally[_COUNT] -= 1
            other = heap[tally[_COUNT]]
            if other != cell:
                heap[at] = other
                rise(state, at)
                sink(state, state.where[other] - 1)
    elif at < 0:
        at = tally[_COUNT]
        tally[_COUNT] += 1
        heap[at] = cell
        keys[cell] = key
        rise(state, at)
    else:
        before, keys[cell] = keys[cell], key
        if key < before:
            rise(state, at)
        elif key > before:
            sink(state, at)


@kernel(allocates=False)
def key_of(grid: Grid, state: Search, cell: int, start: int) -> int:
    """Return the key of a cell: the sum of steps and lower bound, then the steps."""
    steps = min(state.g[cell], state.rhs[cell])
    bound = apart(grid.width, start, cell, len(grid.moves) > 4)
    return int(((steps + bound + state.tally[_MOVED]) << _SHIFT) | steps)


@kernel(allocates=False)
def foresee(grid: Grid, state: Search, cell: int, target: int) -> None:
    """Compute the one-step lookahead value of a cell (rhs)."""
    best = 0 if cell == target else FAR
    if cell != target and grid.walls[cell] == 0:
        for action in range(len(grid.moves)):
            steps = state.g[cell + grid.moves[action]] + 1
            if steps < best and is_open(grid, cell, action):
                best = steps
    state.rhs[cell] = best


@kernel(allocates=False)
def repair(grid: Grid, start: int, target: int, changed: Steps, state: Search, flag: Flag) -> bool:
    """Update `g` on all shortest paths from the start by D* Lite; return False if `flag` stopped the search.

    `grid` is the current map, and `start` the cell of the vehicle. `changed` are the cells blocked or
    freed since the previous call; the first call also includes the target.
    """
    g, rhs, tally = state.g, state.rhs, state.tally
    tally[_MOVED] += apart(grid.width, tally[_LAST], start, len(grid.moves) > 4)
    tally[_LAST] = start
    for cell in changed:
        # A cell beside a diagonal step changes the step between two of its neighbours.
        for action in range(-1, len(grid.moves)):
            near = cell + (grid.moves[action] if action >= 0 else 0)
            foresee(grid, state, near, target)
            place(state, near, key_of(grid, state, near, start))
    while tally[_COUNT] > 0:
        if flag[0] != 0:
            return False
        cell = state.heap[0]
        smallest = state.keys[cell]
        # If the smallest key reaches the key of the start, no queued cell is on a shortest path.
        if smallest >= key_of(grid, state, start, start) and rhs[start] <= g[start]:
            break
        key = key_of(grid, state, cell, start)
        if smallest < key:  # outdated, because the vehicle has moved
            place(state, cell, key)
            continue
        before = g[cell]
        g[cell] = rhs[cell] if before > rhs[cell] else FAR
        place(state, cell, key_of(grid, state, cell, start))
        for action in range(len(grid.moves)):
            near = cell + grid.moves[action]
            if near == target or not is_open(grid, cell, action):
                continue
            if g[cell] < FAR:
                if rhs[near] <= g[cell] + 1:
                    continue
                rhs[near] = g[cell] + 1
            elif rhs[near] == before + 1:
                foresee(grid, state, near, target)
            else:
                continue
            place(state, near, key_of(grid, state, near, start))
    return True
