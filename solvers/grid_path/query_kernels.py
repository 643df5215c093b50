"""Kernels of prepared maps: points of a path, and repair of distances after changes of cells."""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.search_kernels import steps_of

__all__ = ["points_along", "repair"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]


@kernel(interpretable=True)
def points_along(turns: Ints, width: int, cell: float, corner: Floats) -> Floats:
    """Return the centres of all cells along straight and diagonal runs between turns, m, shape (k, 2).

    `turns` are numbers of cells of a framed map of `width` cells per row.
    """
    count = 1
    for k in range(1, len(turns)):
        down = abs(turns[k] // width - turns[k - 1] // width)
        count += max(down, abs(turns[k] % width - turns[k - 1] % width))
    points = np.empty((count, 2))
    at, row, column = 0, turns[0] // width, turns[0] % width
    for k in range(len(turns)):
        down, across = turns[k] // width - row, turns[k] % width - column
        for _ in range(max(1 if k == 0 else abs(down), abs(across))):
            row += np.sign(down)
            column += np.sign(across)
            points[at, 0] = corner[0] + (column - 0.5) * cell
            points[at, 1] = corner[1] + (row - 0.5) * cell
            at += 1
    return points


@kernel
def is_step(walls: Bytes, width: int, cell: int, step: Ints) -> bool:
    """Return whether a step from a free cell leads to a free cell and cuts no corner."""
    sides = walls[cell + step[2] * width] | walls[cell + step[3]]
    return bool((sides | walls[cell + step[0]]) == 0)


@kernel(interpretable=True, in_place=True)
def repair(
    walls: Bytes, width: int, left: Ints, changed: Ints, root: int, diagonal: bool, most: int
) -> int:
    """Update the remainders of all cells after changes of the map, and return how many cells lost theirs.

    `left` are remainders of a search from `root` for all cells, see
    :func:`crosstrack.models.grid_path.search_kernels.sweep`, and `changed` the numbers of all cells that
    may have changed since. If more than `most` cells lose their remainder, the result is -1 and the
    remainders are undefined.

    Source: G. Ramalingam and T. Reps, "An incremental algorithm for a generalization of the shortest-path
    problem", Journal of Algorithms 21 (1996), for several changes at once.
    """
    steps = steps_of(width, diagonal)
    around = np.array([0, 1, width, width + 1, -1, -width, -width - 1, width - 1, 1 - width])
    lost = np.zeros(walls.size, np.uint8)
    heap = [(0, -1)]
    heap.pop()
    seeds = np.empty(9 * len(changed), np.int64)
    count = 0
    for cell in changed:
        for offset in around:
            seeds[count] = cell + offset
            if left[cell + offset] > 0:
                heappush(heap, (-left[cell + offset], cell + offset))
            count += 1
    losses = [-1]
    losses.pop()
    # In the order of costs, a cell without a remaining predecessor is lost.
    while len(heap) > 0:
        _, cell = heappop(heap)
        if lost[cell] != 0 or cell == root:
            continue
        supported = False
        if walls[cell] == 0:
            for turn in range(len(steps)):
                other = cell + steps[turn, 0]
                if left[other] == left[cell] + steps[turn, 1] and lost[other] == 0:
                    supported = supported or is_step(walls, width, cell, steps[turn])
        if supported:
            continue
        lost[cell] = 1
        losses.append(cell)
        if len(losses) > most:
            return -1
        for turn in range(len(steps)):
            other = cell + steps[turn, 0]
            if left[other] > 0 and left[other] == left[cell] - steps[turn, 1]:
                heappush(heap, (-left[other], other))
    for cell in losses:
        left[cell] = 0
    # Every new or lost step joins two of these cells, so they take the best of their neighbours.
    for k in range(len(seeds) + len(losses)):
        cell = seeds[k] if k < len(seeds) else losses[k - len(seeds)]
        if walls[cell] != 0:
            continue
        best = left[cell]
        for turn in range(len(steps)):
            other = cell + steps[turn, 0]
            if left[other] - steps[turn, 1] > best and is_step(walls, width, cell, steps[turn]):
                best = left[other] - steps[turn, 1]
        if best > left[cell]:
            left[cell] = best
            heappush(heap, (-best, cell))
    while len(heap) > 0:
        minus, cell = heappop(heap)
        if -minus < left[cell]:
            continue
        for turn in range(len(steps)):
            other = cell + steps[turn, 0]
            remainder = left[cell] - steps[turn, 1]
            if remainder > left[other] and is_step(walls, width, cell, steps[turn]):
                left[other] = remainder
                heappush(heap, (-remainder, other))
    return len(losses)
