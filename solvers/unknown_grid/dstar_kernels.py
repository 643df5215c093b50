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
from ...models.unknown_grid.moving import FAR, descend, is_open

__all__ = ["plan", "repair", "replan", "search"]

Ints = NDArray[np.int64]
Steps = NDArray[np.int32]
Bytes = NDArray[np.uint8]
Flag = NDArray[np.int8]
Truths = NDArray[np.bool_]

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
    changed: Ints,
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


@kernel
def notice(
    walls: Bytes, sure: Bytes, width: int, expected: int, cell: int, corner: Ints,
    obstacles: Truths, changed: Ints,
) -> int:  # fmt: skip
    """Update a map with an observation and a possible collision; return the number of `changed` cells.

    `expected` is the cell of the vehicle if its last step caused no collision, and `cell` its cell. No view
    changes cells that are `sure`. `corner` is the row and column of the first of the `obstacles` of the view.
    """
    before, here = walls[expected], walls[cell]
    # The order matters: without a collision, both are the same cell, which is free.
    walls[expected] = 1
    walls[cell] = 0
    sure[expected] = sure[cell] = 1
    count = 0
    if walls[expected] != before:
        changed[count] = expected
        count += 1
    if here != 0:
        changed[count] = cell
        count += 1
    rows = walls.size // width
    for i in range(obstacles.shape[0]):
        row = corner[0] + 1 + i
        if row < 0 or row >= rows:
            continue
        for j in range(obstacles.shape[1]):
            column = corner[1] + 1 + j
            if column < 0 or column >= width:
                continue
            at = row * width + column
            if sure[at] == 0 and (walls[at] != 0) != obstacles[i, j]:
                walls[at] = 1 - walls[at]
                changed[count] = at
                count += 1
    return count


@kernel
def doubt(walls: Bytes, sure: Bytes, changed: Ints) -> int:
    """Free all obstacles known only from images; return the number of `changed` cells."""
    count = 0
    for cell in range(walls.size):
        if walls[cell] != 0 and sure[cell] == 0:
            walls[cell] = 0
            changed[count] = cell
            count += 1
    return count


@kernel(interpretable=True, in_place=True)
def plan(
    rows: Ints, cells: Ints, corners: Ints, obstacles: Truths, width: int, ends: Ints,
    doubts: bool, walls: Bytes, sure: Bytes, expected: Ints, changed: Ints, actions: Ints, flag: Flag,
) -> None:  # fmt: skip
    """Compute the `actions` of several scenes by A* on their known maps, :data:`STUCK` without a path.

    `rows` are the indices of the scenes in `ends`, `walls`, `sure` and `expected`. `cells`, `corners` and
    `obstacles` are their observations. If `doubts`, obstacles from images are discarded if they leave no path.
    """
    moves = np.array((-width, width, -1, 1))
    for index in range(len(rows)):
        row, cell = rows[index], cells[index]
        known, certain, target = walls[row], sure[row], ends[row, 1]
        notice(
            known, certain, width, expected[row], cell, corners[index], obstacles[index], changed
        )
        steps = search(known, width, cell, target, flag)
        action = descend(known, width, moves, 0, steps, cell)
        if action == STUCK and doubts:
            doubt(known, certain, changed)
            steps = search(known, width, cell, target, flag)
            action = descend(known, width, moves, 0, steps, cell)
        actions[index] = action
        if action != STUCK:
            expected[row] = cell + moves[action]


@kernel
def replan(
    rows: Ints, cells: Ints, corners: Ints, obstacles: Truths, width: int, ends: Ints, doubts: bool,
    walls: Bytes, sure: Bytes, expected: Ints, changed: Ints, actions: Ints, flag: Flag,
    g: Steps, rhs: Steps, heap: Ints, where: Steps, keys: Ints, tally: Ints,
) -> None:  # fmt: skip
    """Compute the `actions` of several scenes by D* Lite; see :func:`plan` and :func:`repair`."""
    moves = np.array((-width, width, -1, 1))
    for index in range(len(rows)):
        row, cell = rows[index], cells[index]
        known, certain, target = walls[row], sure[row], ends[row, 1]
        count = notice(
            known, certain, width, expected[row], cell, corners[index], obstacles[index], changed
        )
        if rhs[row, target] == FAR:  # the first search
            changed[count] = target
            count += 1
        action = STUCK
        for attempt in range(2):
            if attempt == 1:
                count = doubt(known, certain, changed)
            repair(known, width, cell, target, changed[:count], g[row], rhs[row], heap[row],
                   where[row], keys[row], tally[row], flag, moves, 0)  # fmt: skip
            action = descend(known, width, moves, 0, g[row], cell)
            if action != STUCK or not doubts:
                break
        actions[index] = action
        if action != STUCK:
            expected[row] = cell + moves[action]
