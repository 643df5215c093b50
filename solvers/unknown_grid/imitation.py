"""Runs in random scenes for imitation learning, and the expert's actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.unknown_grid.plan import STEPS
from .memory import Memory, Observation

if TYPE_CHECKING:
    import torch

__all__ = [
    "TASKS",
    "Examples",
    "Recurrence",
    "Scenes",
    "Task",
    "Walk",
    "best_actions",
    "choose_actions",
    "draw_scenes",
    "first_of",
    "shortest_ways",
    "walk_through",
]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]
Lengths = NDArray[np.int32]

_MOVES = np.array(STEPS)
#: Number of steps of a cell without a path.
NEVER = 2**30


class Task(NamedTuple):
    """Task of the paper: numbers of rows and columns of the maps and of the views."""

    shape: tuple[int, int]
    view: tuple[int, int]


#: Tasks of the paper.
TASKS = (Task((17, 17), (11, 11)), Task((17, 17), (9, 9)), Task((15, 15), (9, 9)))


class Scenes(NamedTuple):
    """Random scenes: maps, true if blocked, and the cells of start and target, shape (n, 2)."""

    blocked: Truths
    starts: Ints
    targets: Ints


#: Function that draws solvable scenes: ``(law, shape, obstacles, scenes, generator)``.
Examples = Callable[..., tuple[Truths, Ints, Ints]]


def draw_scenes(
    examples: Examples | None, law: str, shape: tuple[int, int], obstacles: Any, scenes: int,
    generator: np.random.Generator,
) -> Scenes:  # fmt: skip
    """Return random scenes drawn by `examples`, or raise :class:`InvalidData` if it is None."""
    if examples is None:
        raise InvalidData(
            "examples must be a function that draws scenes, such as "
            "crosstrack.instances.unknown_grid.draw_scene_arrays, got None",
            field="examples",
        )
    return Scenes(*examples(law, shape, obstacles, scenes, generator))


def shortest_ways(blocked: Truths, targets: Ints) -> Lengths:
    """Return the fewest steps to the target from every cell, shape (n, rows, columns).

    The entries of cells without a path are :data:`NEVER`. A breadth-first search treats all maps at
    once, with one sweep over all cells per step.
    """
    count, rows, columns = blocked.shape
    steps = np.full((count, rows + 2, columns + 2), NEVER, np.int32)
    inner = steps[:, 1:-1, 1:-1]
    inner[np.arange(count), targets[:, 0], targets[:, 1]] = 0
    while True:
        nearest = np.minimum(steps[:, :-2, 1:-1], steps[:, 2:, 1:-1])
        np.minimum(nearest, steps[:, 1:-1, :-2], out=nearest)
        np.minimum(nearest, steps[:, 1:-1, 2:], out=nearest)
        nearest += 1
        nearest[blocked] = NEVER
        if not (nearest < inner).any():
            return inner.copy()
        np.minimum(inner, nearest, out=inner)


def best_actions(ways: Lengths, positions: Ints) -> Truths:
    """Return whether each action begins a shortest path, shape (n, 4); all false without a path.

    `ways` are the steps of :func:`shortest_ways`, and `positions`, shape (n, 2), the cells of the
    vehicles.
    """
    rows, columns = ways.shape[1:]
    cells = positions[:, None] + _MOVES
    inside = ((cells >= 0) & (cells < (rows, columns))).all(axis=2)
    cells = np.where(inside[..., None], cells, 0)
    scenes = np.arange(len(ways))
    after = np.where(inside, ways[scenes[:, None], cells[..., 0], cells[..., 1]], NEVER)
    here = ways[scenes, positions[:, 0], positions[:, 1]]
    best: Truths = (after < here[:, None]) & (here[:, None] < NEVER)
    return best


def first_of(best: Truths) -> Ints:
    """Return the first best action in the order up, down, left, right; 0 if none is marked."""
    actions: Ints = best.argmax(axis=1)
    return actions


class Walk:
    """Vectorised simulation of scenes, with the rules of :class:`~crosstrack.models.unknown_grid.World`.

    A run has at most `steps` actions. If `follow`, the UAV follows the vehicle after the target was
    seen; otherwise it hovers.
    """

    def __init__(
        self, scenes: Scenes, view: tuple[int, int], *, steps: int = 40, follow: bool = False
    ) -> None:
        self.scenes, self.steps, self.follow = scenes, steps, follow
        count, *shape = scenes.blocked.shape
        self._view = np.array(view)
        self._half = self._view // 2
        down, across = self._half.tolist()
        walls = ((0, 0), (down, down), (across, across))
        self._padded = np.pad(scenes.blocked, walls, constant_values=True).astype(np.int8)
        self.memory = Memory(np.array(shape), self._view, scenes.targets)
        self.positions = scenes.starts.copy()
        self._centres = scenes.starts.copy()
        self._hovers = np.zeros(count, bool)
        self.taken = 0
        self.collisions = np.zeros(count, np.int64)
        self.reached = np.zeros(count, bool)
        #: Number of steps of each run.
        self.lengths = np.zeros(count, np.int64)

    @property
    def going(self) -> Ints:
        """Indices of the scenes with an active run."""
        return np.flatnonzero(~self.reached) if self.taken < self.steps else np.zeros(0, np.int64)

    def look(self, rows: Ints) -> Observation:
        """Return the observations of the scenes `rows`."""
        away = np.abs(self.scenes.targets[rows] - self.positions[rows])
        moves = rows[~self._hovers[rows]]
        self._centres[moves] = self.positions[moves]
        self._hovers[rows] |= ~np.bool_(self.follow) & (away <= self._half).all(axis=1)
        centres = self._centres[rows]
        windows = sliding_window_view(self._padded, tuple(self._view.tolist()), axis=(1, 2))
        return self.memory.look(
            rows, self.positions[rows], centres - self._half, windows[rows, *centres.T]
        )

    def act(self, rows: Ints, actions: Ints) -> None:
        """Execute one action in each of the scenes `rows`, which must be all active scenes."""
        self.memory.act(rows, actions)
        cells = self.positions[rows] + _MOVES[actions]
        free = ((cells >= 0) & (cells < self.scenes.blocked.shape[1:])).all(axis=1)
        free[free] = ~self.scenes.blocked[rows[free], *cells[free].T]
        self.collisions[rows] += ~free
        self.positions[rows[free]] = cells[free]
        self.taken += 1
        self.lengths[rows] += 1
        self.reached[rows] = (self.positions[rows] == self.scenes.targets[rows]).all(axis=1)


def walk_through(walk: Walk, choose: Callable[[Observation, Ints], Any]) -> None:
    """Run all scenes until they end; ``choose(observation, rows)`` returns the actions."""
    while len(rows := walk.going):
        walk.act(rows, np.asarray(choose(walk.look(rows), rows)))


class Recurrence:
    """Network with the states of the active scenes.

    A call takes the inputs of the active scenes and their ascending indices, which are among those of
    the previous call. It returns the logits. See :mod:`~.networks` for the interface of the network.
    """

    def __init__(self, network: Callable[[Any, Any], tuple[torch.Tensor, Any]]) -> None:
        self._network, self._state = network, None
        self._rows: Ints = np.zeros(0, np.int64)

    def __call__(self, inputs: Any, rows: Ints) -> torch.Tensor:
        if self._state is not None:
            active = np.searchsorted(self._rows, rows)
            self._state = tuple(array[active] for array in self._state)
        logits, self._state = self._network(inputs, self._state)
        self._rows = rows
        return logits


def choose_actions(logits: Any) -> tuple[Ints, Ints]:
    """Return the best actions, shape (n,), and the number of non-finite logits per scene, shape (n,).

    Non-finite logits are ignored. Ties go to up, down, left, right in this order. If no logit is finite,
    the action is up.
    """
    wrong = ~np.isfinite(logits)
    return np.where(wrong, -np.inf, logits).argmax(axis=1), wrong.sum(axis=1)
