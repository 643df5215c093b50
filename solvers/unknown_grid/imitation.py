"""Runs in random scenes for imitation learning, and the expert's actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.moving import FAR, Grid, spread
from ...models.unknown_grid.plan import STEPS
from ...models.unknown_grid.scenes import Hover
from ...models.unknown_grid.world import GOING, LOOK, Looks, World
from .memory import Memory, Observation

if TYPE_CHECKING:
    import torch

__all__ = [
    "Examples",
    "Recurrence",
    "Scenes",
    "best_actions",
    "choose_actions",
    "draw_scenes",
    "first_of",
    "shortest_ways",
    "walk_through",
]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]
Lengths = NDArray[np.int64]

_MOVES = np.array(STEPS)


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
    """Return random scenes drawn by `examples`, or raise :class:`InvalidData` if it is None.

    `law` is one law or several, separated by commas. The scenes of several laws have equal numbers up to
    one, and a law with no scene is left out.
    """
    if examples is None:
        raise InvalidData(
            "examples must be a function that draws scenes, such as "
            "crosstrack.instances.unknown_grid.draw_scene_arrays, got None",
            field="examples",
        )
    laws = law.split(",")
    counts = np.bincount(np.arange(scenes) * len(laws) // scenes, minlength=len(laws))
    parts = [
        examples(name.strip(), shape, obstacles, count, generator)
        for name, count in zip(laws, counts.tolist(), strict=True)
        if count
    ]
    return Scenes(*map(np.concatenate, zip(*parts, strict=True)))


def shortest_ways(blocked: Truths, targets: Ints) -> Lengths:
    """Return the fewest steps to the target from every cell, shape (n, rows, columns).

    The entries of cells without a path are :data:`~crosstrack.models.unknown_grid.moving.FAR`.
    """
    # The frames separate the maps, so that one search treats them all.
    walls = np.pad(blocked, ((0, 0), (1, 1), (1, 1)), constant_values=True).astype(np.uint8)
    _, rows, width = walls.shape
    goals = np.arange(len(walls)) * rows * width + (targets + 1) @ [width, 1]
    ways = spread(Grid(walls.reshape(-1), width, _MOVES @ [width, 1], 0), goals)
    return np.reshape(ways, walls.shape)[:, 1:-1, 1:-1]


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
    after = np.where(inside, ways[scenes[:, None], cells[..., 0], cells[..., 1]], FAR)
    here = ways[scenes, positions[:, 0], positions[:, 1]]
    best: Truths = (after < here[:, None]) & (here[:, None] < FAR)
    return best


def first_of(best: Truths) -> Ints:
    """Return the first best action in the order up, down, left, right; 0 if none is marked."""
    actions: Ints = best.argmax(axis=1)
    return actions


def walk_through(
    scenes: Scenes,
    view: tuple[int, int],
    choose: Callable[[Observation, Ints], Any],
    *,
    steps: int = 40,
    uav: Hover = Hover.PAPER,
) -> World:
    """Run all scenes until they end, and return the world after the last step.

    ``choose(observation, rows)`` returns the actions in the active scenes `rows`. `view`, `steps` and `uav` are
    the fields of the model.
    """
    shape = np.array(scenes.blocked.shape[1:])
    model = UnknownGridNavigation(*scenes, shape, view=view, steps=steps, uav=uav)
    world, memory = World(model), Memory(model.shape, model.view, model.targets)
    rows = np.arange(model.scenes)
    chosen = np.full(len(rows), LOOK)
    while True:
        looks = Looks.read(model, rows, world(np.column_stack([rows, chosen]).astype(float)))
        looks = Looks._make(array[looks.states == GOING] for array in looks)
        rows = looks.scenes
        if not len(rows):
            return world
        observed = memory.look(rows, looks.positions, looks.corners, looks.view)
        chosen = np.asarray(choose(observed, rows))
        memory.act(rows, chosen)


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
