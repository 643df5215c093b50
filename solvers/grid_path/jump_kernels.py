"""Jump point search: straight and diagonal runs over cells that never enter the queue.

The search considers only shortest paths with diagonal steps as early as possible. This prunes most
neighbours of a cell, and a run continues to the next jump point, a cell at which a path may turn. Without
cutting corners, a path leaves a straight run only behind a blocked cell.

Source: D. Harabor and A. Grastien, "Online Graph Pruning for Pathfinding on Grid Maps", AAAI 2011,
and "The JPS Pathfinding System", SoCS 2012, for paths that cut no corners.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.search_kernels import (
    CEILING,
    DIAGONAL,
    DONE,
    STOPPED,
    STRAIGHT,
    ahead,
    box_around,
)
from .heap_kernels import back

__all__ = ["jump", "jump_in", "unroll"]

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

#: Bits of the state of a cell.
_BLOCKED, _GOAL = 1, 2
#: Bits of the eight directions, in the order of their angles. Even numbers are straight.
_ALL = 255


@kernel
def along(state: Bytes, cell: int, step: int, side: int) -> int:
    """Return the first cell on a straight run from `cell` at which a path may turn or end, or -1.

    `step` and `side` are the changes of the cell number along the run and across it.
    """
    left, right = state[cell + side] & _BLOCKED, state[cell - side] & _BLOCKED
    while True:
        cell += step
        here = state[cell]
        if here != 0:
            return -1 if here & _BLOCKED else cell
        beside, other = state[cell + side] & _BLOCKED, state[cell - side] & _BLOCKED
        if beside < left or other < right:
            return cell
        left, right = beside, other


@kernel
def slanted(state: Bytes, cell: int, down: int, across: int, width: int) -> int:
    """Return the first cell on a diagonal run at which a path may turn or end, or -1."""
    step = down + across
    while (state[cell + down] | state[cell + across] | state[cell + step]) & _BLOCKED == 0:
        cell += step
        if state[cell] & _GOAL:
            return cell
        if along(state, cell, down, 1) >= 0 or along(state, cell, across, width) >= 0:
            return cell
    return -1


@kernel
def ways_on(state: Bytes, cell: int, way: int, moves: Ints) -> int:
    """Return the directions, one bit each, to leave a cell after an arrival in direction `way`."""
    if way % 2 == 1:
        return (1 << way) | (1 << (way - 1)) | (1 << ((way + 1) % 8))
    ways = 1 << way
    for turn in (1, 7):
        # Diagonal and perpendicular directions on one side.
        side = (way + 2 * turn) % 8
        free = state[cell + moves[side]] & _BLOCKED == 0
        if free and state[cell - moves[way] + moves[side]] & _BLOCKED:
            ways |= (1 << side) | (1 << ((way + turn) % 8))
    return ways


@kernel(interpretable=True)
def jump(
    walls: Bytes, width: int, start: int, goals: Ints, flag: NDArray[np.int8]
) -> tuple[int, int, int, Ints, int]:
    """Return the nearest goal, its cost, and the previous jump point of each cell.

    A cell reached again at the same cost keeps the directions of both paths, so no shortest path is
    lost. The arguments are those of :func:`crosstrack.models.grid_path.search_kernels.sweep`.

    The result is the status, the goal, -1 if none is reachable, the cost of the path to it or, if
    stopped, a lower bound on it, the previous jump points, and the number of expanded cells. The start
    is its own jump point.
    """
    left = np.zeros(walls.size, np.int64)
    parents = np.empty(walls.size, np.int64)
    ways = np.zeros((2, walls.size), np.uint8)
    status, goal, cost, expanded = jump_in(
        walls.copy(), left, parents, ways, CEILING, width, start, goals, flag
    )
    return status, goal, cost, parents, expanded


@kernel(shared=True)
def jump_in(
    state: Bytes, left: Ints, parents: Ints, ways_at: Bytes, ceiling: int, width: int, start: int,
    goals: Ints, flag: NDArray[np.int8],
) -> tuple[int, int, int, int]:  # fmt: skip
    """Search like :func:`jump` in given arrays, so that many searches on a map share them.

    `state` and `left` are those of :func:`crosstrack.models.grid_path.search_kernels.sweep_in`. `parents`
    receives the previous jump points. `ways_at`, shape (2, cells), is a work array.
    """
    moves = np.array([1, width + 1, width, width - 1, -1, -width - 1, -width, -width + 1])
    for goal in goals:
        state[goal] |= _GOAL
    box = box_around(goals, width)
    # Directions queued for a cell, and directions already expanded.
    waiting, tried = ways_at[0], ways_at[1]
    left[start] = ceiling
    parents[start] = start
    waiting[start], tried[start] = _ALL, 0
    # Ties go to the cell with the greater cost.
    heap = [(ahead(start // width, start % width, box, True), ceiling, start)]
    expanded = 0
    status, nearest, cost = DONE, -1, 0
    while len(heap) > 0:
        if flag[0] != 0:
            status, cost = STOPPED, heap[0][0]
            break
        _, here, cell = heappop(heap)
        if here < left[cell] or waiting[cell] == 0:
            continue
        if state[cell] & _GOAL:
            nearest, cost = cell, ceiling - here
            break
        expanded += 1
        ways = int(waiting[cell])
        waiting[cell] = 0
        tried[cell] |= ways
        row = cell // width
        column = cell - row * width
        for way in range(8):
            if ways >> way & 1 == 0:
                continue
            cost = STRAIGHT
            if way % 2 == 1:
                to = slanted(
                    state, cell, moves[(way // 4) * 4 + 2], moves[((way + 1) // 4 % 2) * 4], width
                )
                cost = DIAGONAL
            else:
                to = along(state, cell, moves[way], width if way % 4 == 0 else 1)
            if to < 0:
                continue
            down = to // width - row
            across = to - (row + down) * width - column
            then = here - max(abs(down), abs(across)) * cost
            if then < left[to]:
                continue
            on = ways_on(state, to, way, moves)
            if then > left[to]:
                left[to] = then
                parents[to] = cell
                waiting[to] = tried[to] = 0
            more = on & ~(int(waiting[to]) | int(tried[to]))
            if more == 0:
                continue
            waiting[to] |= more
            order = ceiling - then + ahead(row + down, column + across, box, True)
            heappush(heap, (order, then, to))
    for goal in goals:
        state[goal] &= _BLOCKED
    return status, nearest, cost, expanded


def unroll(parents: Ints, width: int, goal: int) -> Ints:
    """Return all cells from the start to `goal`, including those between the jump points of :func:`jump`."""
    turns = back(parents, goal)
    counts = np.maximum(np.abs(np.diff(turns // width)), np.abs(np.diff(turns % width)))
    steps = np.repeat(np.diff(turns) // counts, counts)
    return np.concatenate([turns[:1], turns[0] + np.cumsum(steps)])
