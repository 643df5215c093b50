"""Moving obstacles, and runs with the fewest steps among them and along diagonals.

The moving obstacles have the size of a cell and do not react to the vehicle or to one another. In every step
they move together with the vehicle. The vehicle collides if it and an obstacle would be at the same point at
the end or in the middle of the step: it enters the same cell, exchanges cells, or crosses the same corner. It
then remains in its cell. An obstacle that enters the cell of a waiting vehicle causes a collision as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .plan import LETTERS, MOVES
from .scenes import Corners, Scenes, actions_of

__all__ = ["FAR", "Grid", "descend", "fewest_run", "is_open", "meets", "obstacle_tracks", "spread"]

Bytes = NDArray[np.uint8]
Cells = NDArray[np.int8]
Ints = NDArray[np.int64]
Steps = NDArray[np.int32] | NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Number of steps of a cell that was not reached.
FAR = 2**30


def obstacle_tracks(model: Scenes) -> Ints:
    """Return the cells of the moving obstacles after 0 … `steps` steps, shape (k, moving, steps + 1, 2).

    On a declared track of n cells an obstacle moves to and fro. Otherwise it begins in a random free cell other
    than the start, and in every step it chooses one of the four directions or its own cell with equal
    probabilities. It remains in its cell if the chosen cell is blocked or outside the map.
    """
    blocked, count, steps = model.blocked, len(model.starts), model.steps
    if model.tracks is not None:
        last = model.tracks.shape[2] - 1
        turns = np.arange(steps + 1) % max(2 * last, 1)
        return np.asarray(
            model.tracks[:, :, np.minimum(turns, 2 * last - turns) if last else turns]
        )
    cells = np.zeros((count, model.moving, steps + 1, 2), np.int64)
    if not model.moving:
        return cells
    draws = np.empty((steps, count, model.moving), np.int64)
    for k in range(count):
        stream = np.random.default_rng(np.random.SeedSequence(model.world_seed, spawn_key=(k,)))
        free = np.argwhere(~blocked[k])
        free = free[(free != model.starts[k]).any(axis=1)]
        cells[k, :, 0] = free[stream.integers(0, len(free), model.moving)]
        draws[:, k] = stream.integers(0, 5, (model.moving, steps)).T
    walls = np.pad(blocked, ((0, 0), (1, 1), (1, 1)), constant_values=True)
    # Numbers of the cells in all padded maps, so that a step takes three operations.
    size = walls.shape
    moves = np.array([*MOVES[:4], MOVES[8]]) @ [size[2], 1]
    at = np.ravel_multi_index(
        (np.arange(count)[:, None], *(cells[:, :, 0] + 1).transpose(2, 0, 1)), size
    )
    flat, numbers = walls.reshape(-1), moves[draws]
    for t in range(steps):
        to = at + numbers[t]
        numbers[t] = at = np.where(flat[to], at, to)
    cells[:, :, 1:] = (
        np.stack(np.unravel_index(numbers, size)[1:], axis=-1).transpose(1, 2, 0, 3) - 1
    )
    return cells


def meets(before: Ints, after: Ints, cells: Ints, to: Ints) -> Truths:
    """Return whether steps of vehicles collide with moving obstacles, shape (n,).

    `before` and `after` are the cells of the obstacles, shape (n, moving, 2), and `cells` and `to` those of the
    vehicles, shape (n, 2), at the begin and at the end of the step.
    """
    same_end = (after == to[:, None]).all(axis=-1)
    same_middle = (before + after == (cells + to)[:, None]).all(axis=-1)
    return np.asarray((same_end | same_middle).any(axis=1))


class Grid(NamedTuple):
    """Map for searches: flat, with a frame of blocked cells.

    `walls` is nonzero for blocked cells, and `width` the number of cells per row. `moves` are the changes of the cell
    number by each action, and `sides` is the number of blocked cells that a diagonal step may pass.
    """

    walls: Bytes
    width: int
    moves: Ints
    sides: int


@kernel(allocates=False)
def is_open(grid: Grid, cell: int, action: int) -> bool:
    """Return whether a step leads to a free cell, with at most `sides` blocked cells beside a diagonal."""
    walls, move = grid.walls, grid.moves[action]
    if walls[cell + move] != 0:
        return False
    down = -grid.width if action < 6 else grid.width
    return bool(action < 4 or walls[cell + down] + walls[cell + move - down] <= grid.sides)


@kernel(interpretable=True)
def spread(grid: Grid, goals: Ints) -> Ints:
    """Return the steps from all cells to the nearest of the cells `goals`, breadth first, or :data:`FAR`."""
    steps, queue = np.full(grid.walls.size, FAR), np.empty(grid.walls.size, np.int64)
    count = 0
    for cell in goals:
        steps[cell], queue[count] = 0, cell
        count += 1
    at = 0
    while at < count:
        cell = queue[at]
        at += 1
        for action in range(len(grid.moves)):
            to = cell + grid.moves[action]
            if steps[to] == FAR and is_open(grid, cell, action):
                steps[to], queue[count] = steps[cell] + 1, to
                count += 1
    return steps


@kernel(interpretable=True, allocates=False)
def descend(grid: Grid, steps: Steps, cell: int) -> int:
    """Return the action to the neighbour with the fewest steps, the first of several, or -1."""
    best, chosen = FAR, -1
    for action in range(len(grid.moves)):
        to = cell + grid.moves[action]
        if steps[to] < best and is_open(grid, cell, action):
            best, chosen = steps[to], action
    return chosen


@kernel(interpretable=True)
def spread_in_time(grid: Grid, tracks: Ints, start: int, target: int, taken: Cells) -> int:
    """Return the fewest steps to the target past moving obstacles, or -1.

    The last of `moves` waits. `tracks`, shape (n + 1, moving), has the cells of the obstacles, in a map of twice
    the width. `taken`, shape (n, cells), is filled with the latest action to each cell after each step, of the
    runs with the fewest collisions.
    """
    width, moves, size = grid.width, grid.moves, grid.walls.size
    hits = np.full(size, FAR)
    hits[start] = 0
    for t in range(len(taken)):
        after = np.full(size, FAR)
        for cell in range(size):
            for action in range(len(moves) if hits[cell] < FAR else 0):
                to = cell + moves[action]
                waits = moves[action] == 0
                collides = not waits and not is_open(grid, cell, action)
                here, there = cell + cell // width * width, to + to // width * width
                for m in range(tracks.shape[1]):
                    same_middle = tracks[t, m] + tracks[t + 1, m] == here + there
                    collides = collides or same_middle or tracks[t + 1, m] == there
                # Waiting ends in the same cell as a step with a collision, and has at most one collision.
                if (waits or not collides) and hits[cell] + collides < after[to]:
                    after[to], taken[t, to] = hits[cell] + collides, action
        hits = after
        if hits[target] < FAR:
            return t + 1
    return -1


def fewest_run(model: Scenes, scene: int, tracks: Ints | None = None) -> str | None:
    """Return the actions of a run with the fewest steps, and the fewest collisions of these, or None.

    With moving obstacles, the search covers all cells after each number of steps up to the limit on the steps.
    `tracks` are those of the scene, shape (moving, steps + 1, 2). None ignores the moving obstacles.
    """
    walls = np.pad(model.blocked[scene], 1, constant_values=True).astype(np.uint8)
    width, flat = walls.shape[1], walls.reshape(-1)
    actions = [LETTERS.index(letter) for letter in actions_of(model)]
    moves = np.array(MOVES)[actions] @ [width, 1]
    grid = Grid(flat, width, moves, list(Corners).index(model.corners))
    cell, target = (int((end[scene] + 1) @ [width, 1]) for end in (model.starts, model.targets))
    letters = []
    if tracks is None or not model.moving:
        steps = spread(grid, np.array([target]))
        if steps[cell] == FAR:
            return None
        while cell != target:
            letters.append(descend(grid, steps, cell))
            cell += moves[letters[-1]]
    else:
        taken = np.empty((model.steps, flat.size), np.int8)
        doubled = np.ascontiguousarray(((tracks + 1) @ [2 * width, 1]).T)
        count = spread_in_time(grid, doubled, cell, target, taken)
        if count < 0:
            return None
        for t in range(count)[::-1]:
            letters.append(int(taken[t, target]))
            target -= moves[letters[-1]]
        letters.reverse()
    return "".join(LETTERS[actions[action]] for action in letters)
