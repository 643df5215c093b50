"""What learned policies learn from: runs in drawn scenes, and what an expert would do at each step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.unknown_grid.plan import STEPS
from ..gradient import GradientTrainer
from ..option import Option
from ..trainer import Course
from .memory import Memory, Observation

if TYPE_CHECKING:
    import torch

__all__ = [
    "IMITATION",
    "TASKS",
    "Examples",
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
#: The length of a way that there is not.
NEVER = 2**30


class Task(NamedTuple):
    """Sizes of maps and views that scenes are drawn with."""

    shape: tuple[int, int]
    view: tuple[int, int]


#: The three tasks of the paper.
TASKS = (Task((17, 17), (11, 11)), Task((17, 17), (9, 9)), Task((15, 15), (9, 9)))


class Scenes(NamedTuple):
    """Drawn scenes: maps, shape (n, rows, columns), true where blocked; starts and targets, shape (n, 2)."""

    blocked: Truths
    starts: Ints
    targets: Ints


#: What draws scenes, each with a way: ``(law, shape, obstacles, scenes, generator)``.
Examples = Callable[..., tuple[Truths, Ints, Ints]]


def draw_scenes(
    examples: Examples | None, law: str, shape: tuple[int, int], obstacles: Any, scenes: int,
    generator: np.random.Generator,
) -> Scenes:  # fmt: skip
    """Return scenes that `examples` draws; ``InvalidData`` where there is nothing that draws."""
    if examples is None:
        raise InvalidData(
            "examples must be a function that draws scenes, such as "
            "crosstrack.instances.unknown_grid.draw_scene_arrays, got None",
            field="examples",
        )
    return Scenes(*examples(law, shape, obstacles, scenes, generator))


def shortest_ways(blocked: Truths, targets: Ints) -> Lengths:
    """Return the fewest steps to the target from every cell, :data:`NEVER` where there is no way.

    All maps are searched at once, breadth first: a sweep over all cells a step.

    Parameters
    ----------
    blocked : ndarray of bool, shape (n, rows, columns)
        True where blocked.
    targets : ndarray of int, shape (n, 2)
        Row and column.
    """
    count, rows, columns = blocked.shape
    found = np.full((count, rows + 2, columns + 2), NEVER, np.int32)
    inner = found[:, 1:-1, 1:-1]
    inner[np.arange(count), targets[:, 0], targets[:, 1]] = 0
    while True:
        nearest = np.minimum(found[:, :-2, 1:-1], found[:, 2:, 1:-1])
        np.minimum(nearest, found[:, 1:-1, :-2], out=nearest)
        np.minimum(nearest, found[:, 1:-1, 2:], out=nearest)
        nearest += 1
        nearest[blocked] = NEVER
        if not (nearest < inner).any():
            return inner.copy()
        np.minimum(inner, nearest, out=inner)


def best_actions(ways: Lengths, positions: Ints) -> Truths:
    """Return which actions begin a shortest way, shape (n, 4); none where there is no way."""
    rows, columns = ways.shape[1:]
    to = positions[:, None] + _MOVES
    inside = ((to >= 0) & (to < (rows, columns))).all(axis=2)
    to = np.where(inside[..., None], to, 0)
    every = np.arange(len(ways))
    after = np.where(inside, ways[every[:, None], to[..., 0], to[..., 1]], NEVER)
    here = ways[every, positions[:, 0], positions[:, 1]]
    best: Truths = (after < here[:, None]) & (here[:, None] < NEVER)
    return best


def first_of(best: Truths) -> Ints:
    """Return the first of the best actions in the order up, down, left, right; 0 where there is none."""
    found: Ints = best.argmax(axis=1)
    return found


class Walk:
    """Vehicles in scenes whose maps are known to the teacher: the rules of the model's `World`, all at once.

    Parameters
    ----------
    scenes : Scenes
        Of equal shape.
    view : tuple of int
        Rows and columns, odd.
    steps : int
        Actions that a run may use.
    follow : bool
        Whether the UAV goes on above the vehicle once the target was seen.
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
        #: Steps that each run took.
        self.lengths = np.zeros(count, np.int64)

    @property
    def going(self) -> Ints:
        """The scenes whose runs go on."""
        return np.flatnonzero(~self.reached) if self.taken < self.steps else np.zeros(0, np.int64)

    def look(self, rows: Ints) -> Observation:
        """Return what is known in the scenes `rows`."""
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
        """Take one step in the scenes `rows`, all that go on."""
        self.memory.act(rows, actions)
        to = self.positions[rows] + _MOVES[actions]
        free = ((to >= 0) & (to < self.scenes.blocked.shape[1:])).all(axis=1)
        free[free] = ~self.scenes.blocked[rows[free], *to[free].T]
        self.collisions[rows] += ~free
        self.positions[rows[free]] = to[free]
        self.taken += 1
        self.lengths[rows] += 1
        self.reached[rows] = (self.positions[rows] == self.scenes.targets[rows]).all(axis=1)


def walk_through(walk: Walk, choose: Callable[[Observation, Ints], Any]) -> None:
    """Lead all vehicles to their ends; ``choose(observation, rows)`` returns the actions."""
    while len(rows := walk.going):
        walk.act(rows, np.asarray(choose(walk.look(rows), rows)))


def choose_actions(logits: Any) -> tuple[Ints, Ints]:
    """Return the best actions, shape (n,), and how many logits of each scene are not finite.

    What is not finite is never chosen; of equal logits the first is taken, in the order up, down, left,
    right, and so is up where none is finite.
    """
    wrong = ~np.isfinite(logits)
    return np.where(wrong, -np.inf, logits).argmax(axis=1), wrong.sum(axis=1)


def imitation_loss(logits: torch.Tensor, best: torch.Tensor) -> torch.Tensor:
    """Return minus the logarithm of the probability of the best actions together, shape (n,).

    Parameters
    ----------
    logits : Tensor, shape (n, 4)
        Of the policy.
    best : Tensor of bool, shape (n, 4)
        Which actions begin a shortest way; at least one.
    """
    import torch

    chosen = logits.masked_fill(~best, -torch.inf)
    return torch.logsumexp(logits, dim=1) - torch.logsumexp(chosen, dim=1)


def judge_network(
    network: torch.nn.Module, examples: Any, law: str, seed: int, count: int = 128, *, part: int = 0
) -> dict[str, float]:
    """Return the figures of a network that leads vehicles through scenes of the paper's three tasks.

    ``score`` is the share of targets reached, percent, ``collisions`` are those in a scene, and ``ratio`` is
    that of steps to the fewest. The `count` scenes of each task are always the same, none of those that are learned from. The
    network may remember: its state is passed on as :mod:`~.learned` says. With `part` 1 or 2 the network leads only before or
    after the target was in the view, on O_g or O_p, and the expert leads the rest.
    """
    reached, collisions, ratios = [], [], []
    for number, task in enumerate(TASKS):
        generator = np.random.default_rng([seed, 2**32 - 1, number])
        scenes = draw_scenes(examples, law, task.shape, (2, 5), count, generator)
        walk = Walk(scenes, task.view)
        state: Any = None
        before = walk.going

        ways = shortest_ways(scenes.blocked, scenes.targets)

        def choose(observed: Observation, rows: Ints, ways: Lengths = ways) -> Ints:
            nonlocal state, before
            if state is not None:
                kept = np.searchsorted(before, rows)
                state = tuple(one[kept] for one in state)
            given = observed.tensors()
            logits, state = network(given.in_view() if part == 2 else given, state)
            before = rows
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


#: The options of all trainings that imitate.
IMITATION: Mapping[str, Option] = {
    "law": Option("walls", "the law that scenes are drawn from", str),
    "scenes": Option(192, "scenes of each task that an epoch is drawn from", int, lower=1),
    "batches": Option(40, "steps of Adam in an epoch", int, lower=1),
    "batch": Option(256, "decisions of a batch", int, lower=1),
    "rate": Option(0.01, "the first learning rate", float, lower=0.0, upper=1.0),
    "judged": Option(128, "scenes of each task that an epoch is judged by", int, lower=1),
}


class StepTrainer(GradientTrainer):
    """Imitation for networks that remember nothing: each decision is an example of its own.

    An epoch draws scenes, and leads the vehicles through them half by the expert and half by the network as
    it is, so that it learns what to do where its own errors lead (S. Ross, G. Gordon, D. Bagnell,
    "DAgger", AISTATS 2011). The expert labels every decision.
    """

    _groups: list[tuple[Observation, torch.Tensor]]

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int]
    ) -> None:
        asked = course.options
        super().__init__(
            course, kind, network, architecture, batches=asked["batches"], rate=asked["rate"]
        )

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        import torch

        asked, self._groups = self.course.options, []
        self.network.eval()
        for task in TASKS:
            scenes = draw_scenes(
                self.course.examples, asked["law"], task.shape, (2, 5), asked["scenes"], generator
            )
            looks, labels = self._run(scenes, task, generator)
            observed = Observation(*map(np.concatenate, zip(*looks, strict=True)))
            best = np.concatenate(labels)
            told = best.any(axis=1)
            kept = Observation._make(one[told] for one in observed)
            self._groups.append((kept.tensors(), torch.from_numpy(best[told])))

    def _run(
        self, scenes: Scenes, task: Task, generator: np.random.Generator
    ) -> tuple[list[Observation], list[Truths]]:
        """Return what was seen in some scenes, and which actions were best there."""
        import torch

        looks: list[Observation] = []
        labels: list[Truths] = []
        ways = shortest_ways(scenes.blocked, scenes.targets)
        led = generator.random(len(scenes.starts)) < 0.5

        def choose(observed: Observation, rows: Ints) -> Ints:
            best = best_actions(ways[rows], observed.positions)
            looks.append(observed)
            labels.append(best)
            with torch.inference_mode():
                logits, _ = self.network(observed.tensors(), None)
            return np.where(led[rows], first_of(best), choose_actions(logits.numpy())[0])

        walk_through(Walk(scenes, task.view), choose)
        return looks, labels

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        observed, best = self._groups[batch % len(self._groups)]
        rows = generator.integers(0, len(best), self.course.options["batch"])
        logits, _ = self.network(Observation._make(one[rows] for one in observed), None)
        return imitation_loss(logits, best[rows]).mean()

    def judge(self) -> Mapping[str, float]:
        asked = self.course.options
        return judge_network(
            self.network, self.course.examples, asked["law"], self.course.seed, asked["judged"]
        )
