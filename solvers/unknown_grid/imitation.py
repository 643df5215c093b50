"""Imitation learning: runs in random scenes, with the expert's actions as labels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.unknown_grid.plan import STEPS
from ..contract.option import Option
from ..learning.gradient import GradientTrainer
from .memory import Memory, Observation

if TYPE_CHECKING:
    import torch

__all__ = [
    "IMITATION",
    "TASKS",
    "Examples",
    "Recurrence",
    "Scenes",
    "StepTrainer",
    "Task",
    "Walk",
    "best_actions",
    "choose_actions",
    "draw_scenes",
    "first_of",
    "imitation_loss",
    "judge_network",
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
    """Task of the paper.

    Parameters
    ----------
    shape, view : tuple of int
        Numbers of rows and columns of the maps and of the views.
    """

    shape: tuple[int, int]
    view: tuple[int, int]


#: Tasks of the paper.
TASKS = (Task((17, 17), (11, 11)), Task((17, 17), (9, 9)), Task((15, 15), (9, 9)))


class Scenes(NamedTuple):
    """Random scenes.

    Parameters
    ----------
    blocked : ndarray of bool, shape (n, rows, columns)
        Maps, true if blocked.
    starts, targets : ndarray of int, shape (n, 2)
        Row and column in each scene.
    """

    blocked: Truths
    starts: Ints
    targets: Ints


#: Function that draws solvable scenes: ``(law, shape, obstacles, scenes, generator)``.
Examples = Callable[..., tuple[Truths, Ints, Ints]]


def draw_scenes(
    examples: Examples | None, law: str, shape: tuple[int, int], obstacles: Any, scenes: int,
    generator: np.random.Generator,
) -> Scenes:  # fmt: skip
    """Return random scenes.

    Parameters
    ----------
    examples : callable or None
        Function that draws solvable scenes.
    law : str
        Law of the scenes.
    shape : tuple of int
        Numbers of rows and columns.
    obstacles : int or (int, int)
        Number of obstacles, or its limits.
    scenes : int
        Number of scenes.
    generator : numpy.random.Generator
        Source of random numbers.

    Raises
    ------
    InvalidData
        `examples` is None.
    """
    if examples is None:
        raise InvalidData(
            "examples must be a function that draws scenes, such as "
            "crosstrack.instances.unknown_grid.draw_scene_arrays, got None",
            field="examples",
        )
    return Scenes(*examples(law, shape, obstacles, scenes, generator))


def shortest_ways(blocked: Truths, targets: Ints) -> Lengths:
    """Return the fewest steps to the target from every cell, shape (n, rows, columns).

    The entries of cells without a path are :data:`NEVER`. A breadth-first search treats all maps at once,
    with one sweep over all cells per step.

    Parameters
    ----------
    blocked : ndarray of bool, shape (n, rows, columns)
        Maps, true if blocked.
    targets : ndarray of int, shape (n, 2)
        Row and column of each target.
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

    Parameters
    ----------
    ways : ndarray of int32, shape (n, rows, columns)
        Steps to the target, see :func:`shortest_ways`.
    positions : ndarray of int, shape (n, 2)
        Row and column of the vehicles.
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
    """Vectorised simulation of many scenes, with the rules of :class:`~crosstrack.models.unknown_grid.World`.

    Parameters
    ----------
    scenes : Scenes
        Scenes of equal shape.
    view : tuple of int
        Numbers of rows and columns of the view, odd.
    steps : int, default 40
        Maximum number of actions per run.
    follow : bool, default False
        Whether the UAV follows the vehicle after the target was seen. Otherwise it hovers.
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

    A call takes the inputs of the active scenes and their ascending indices, which are among those of the
    previous call. It returns the logits.

    Parameters
    ----------
    network : callable
        Function of inputs and state that returns logits and the new state, see :mod:`~.networks`.
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

    Parameters
    ----------
    logits : ndarray, shape (n, 4)
        Logits of the actions.
    """
    wrong = ~np.isfinite(logits)
    return np.where(wrong, -np.inf, logits).argmax(axis=1), wrong.sum(axis=1)


def imitation_loss(logits: torch.Tensor, best: torch.Tensor) -> torch.Tensor:
    """Return the negative logarithm of the total probability of the best actions, shape (n,).

    Parameters
    ----------
    logits : Tensor, shape (n, 4)
        Logits of the policy.
    best : Tensor of bool, shape (n, 4)
        True for each action that begins a shortest path; at least one per row.
    """
    import torch

    chosen = logits.masked_fill(~best, -torch.inf)
    return torch.logsumexp(logits, dim=1) - torch.logsumexp(chosen, dim=1)


def judge_network(
    network: torch.nn.Module, examples: Any, law: str, seed: int, count: int = 128, *, part: int = 0
) -> dict[str, float]:
    """Return the performance of a network in validation scenes of the paper's three tasks.

    ``score`` is the share of targets reached, percent, ``collisions`` the mean number of collisions per scene, and
    ``ratio`` the mean ratio of steps to fewest steps. The `count` scenes of each task depend only on `seed` and are
    disjoint from the training scenes. The network may have a state, see :mod:`~.networks`. If `part` is 1 or 2, the
    network decides only before or after the target was in the view, on O_g or O_p, and the expert decides the rest.

    Parameters
    ----------
    network : torch.nn.Module
        Network in evaluation mode.
    examples : callable
        Function that draws solvable scenes.
    law : str
        Law of the scenes.
    seed : int
        Seed of the scenes.
    count : int, default 128
        Number of scenes per task.
    part : {0, 1, 2}, default 0
        Part of the runs in which the network decides; 0 is the whole run.
    """
    reached, collisions, ratios = [], [], []
    for number, task in enumerate(TASKS):
        generator = np.random.default_rng([seed, 2**32 - 1, number])
        scenes = draw_scenes(examples, law, task.shape, (2, 5), count, generator)
        walk = Walk(scenes, task.view)
        ways = shortest_ways(scenes.blocked, scenes.targets)
        recurrence = Recurrence(network)

        def choose(
            observed: Observation,
            rows: Ints,
            ways: Lengths = ways,
            network: Recurrence = recurrence,
        ) -> Ints:
            inputs = observed.tensors()
            logits = network(inputs.in_view() if part == 2 else inputs, rows)
            actions = choose_actions(logits.numpy())[0]
            if not part:
                return actions
            expert = first_of(best_actions(ways[rows], observed.positions))
            return np.where(observed.seen == (part == 2), actions, expert)

        walk_through(walk, choose)
        fewest = ways[np.arange(len(ways)), *scenes.starts.T]
        reached.append(walk.reached)
        collisions.append(walk.collisions)
        ratios.append((walk.lengths / fewest)[walk.reached])
    ratio = np.concatenate(ratios)
    return {
        "score": 100.0 * float(np.mean(reached)),
        "collisions": float(np.mean(collisions)),
        "ratio": float(ratio.mean()) if len(ratio) else float("nan"),
    }


#: Options of all trainings by imitation.
IMITATION: Mapping[str, Option] = {
    "law": Option("walls", "the law that scenes are drawn from", str),
    "scenes": Option(192, "scenes of each task that an epoch is drawn from", int, lower=1),
    "batches": Option(40, "steps of Adam in an epoch", int, lower=1),
    "batch": Option(256, "decisions of a batch", int, lower=1),
    "rate": Option(0.01, "the first learning rate", float, lower=0.0, upper=1.0),
    "judged": Option(128, "scenes of each task that an epoch is judged by", int, lower=1),
}


class StepTrainer(GradientTrainer):
    """Imitation trainer of networks without memory. Every decision is an independent example.

    An epoch draws scenes. The expert decides in half of them and the current network in the other half, so
    that the examples cover the states that the network's errors lead to (S. Ross, G. Gordon, D. Bagnell,
    "DAgger", AISTATS 2011). The expert labels every decision.
    """

    _groups: list[tuple[Observation, torch.Tensor]]

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        import torch

        options, self._groups = self.course.options, []
        self.network.eval()
        for task in TASKS:
            scenes = draw_scenes(
                self.course.examples,
                options["law"],
                task.shape,
                (2, 5),
                options["scenes"],
                generator,
            )
            looks, labels = self._run(scenes, task, generator)
            observed = Observation(*map(np.concatenate, zip(*looks, strict=True)))
            best = np.concatenate(labels)
            labelled = best.any(axis=1)
            examples = Observation._make(array[labelled] for array in observed)
            self._groups.append((examples.tensors(), torch.from_numpy(best[labelled])))

    def _run(
        self, scenes: Scenes, task: Task, generator: np.random.Generator
    ) -> tuple[list[Observation], list[Truths]]:
        """Return the observations in some scenes, and the best actions of each."""
        import torch

        looks: list[Observation] = []
        labels: list[Truths] = []
        ways = shortest_ways(scenes.blocked, scenes.targets)
        by_expert = generator.random(len(scenes.starts)) < 0.5

        def choose(observed: Observation, rows: Ints) -> Ints:
            best = best_actions(ways[rows], observed.positions)
            looks.append(observed)
            labels.append(best)
            with torch.inference_mode():
                logits, _ = self.network(observed.tensors(), None)
            return np.where(by_expert[rows], first_of(best), choose_actions(logits.numpy())[0])

        walk_through(Walk(scenes, task.view), choose)
        return looks, labels

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        observed, best = self._groups[batch % len(self._groups)]
        rows = generator.integers(0, len(best), self.course.options["batch"])
        logits, _ = self.network(Observation._make(array[rows] for array in observed), None)
        return imitation_loss(logits, best[rows]).mean()

    def judge(self) -> Mapping[str, float]:
        options = self.course.options
        return judge_network(
            self.network, self.course.examples, options["law"], self.course.seed, options["judged"]
        )
