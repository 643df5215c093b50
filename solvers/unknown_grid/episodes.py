"""Training by imitation: of the best actions in single steps, and of A* in whole episodes as in the paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contract.option import Option
from ..learning.gradient import GradientTrainer
from ..learning.trainer import Course
from ..learning.weights import Weights
from .imitation import (
    TASKS,
    Lengths,
    Recurrence,
    Scenes,
    Task,
    best_actions,
    choose_actions,
    draw_scenes,
    first_of,
    shortest_ways,
    walk_through,
)
from .memory import Observation

if TYPE_CHECKING:
    import torch

__all__ = [
    "EPISODES",
    "IMITATION",
    "Episodes",
    "ImitationTrainer",
    "lead",
]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Options of all trainings by imitation.
IMITATION: Mapping[str, Option] = {
    "law": Option(
        "walls", "the law that scenes are drawn from, or several, separated by commas", str
    ),
    "scenes": Option(192, "scenes of each task that an epoch is drawn from", int, lower=1),
    "batches": Option(40, "steps of Adam in an epoch", int, lower=1),
    "batch": Option(
        256, "decisions of a batch, or episodes of a network with memory", int, lower=1
    ),
    "rate": Option(0.01, "the first learning rate", float, lower=0.0, upper=1.0),
    "judged": Option(128, "scenes of each task that an epoch is judged by", int, lower=1),
}
_PAPER = {"law": "paper", "batches": 200, "batch": 64, "rate": 1e-4, "judged": 64}
#: Options of the trainings of the paper. The defaults are the values of Table II.
EPISODES = {name: replace(IMITATION[name], default=value) for name, value in _PAPER.items()}
#: Entries of an array above which it is rounded.
_LARGE = 10_000


class Episodes(NamedTuple):
    """Runs of a policy, one row per step and run, in the order of the steps.

    The fields are the observations before each step, whether each action begins a shortest path, shape (n, 4),
    and the indices of the run and of the step.
    """

    observed: Observation
    best: Truths
    runs: Ints
    steps: Ints

    @property
    def actions(self) -> Ints:
        """Actions of A* on the true map. Ties go to up, down, left, right in this order."""
        return first_of(self.best)

    def take(self, rows: Any) -> Episodes:
        """Return the steps at `rows`."""
        observed = Observation._make(array[rows] for array in self.observed)
        return Episodes(observed, self.best[rows], self.runs[rows], self.steps[rows])


def lead(
    scenes: Scenes, task: Task, choose: Callable[[Observation, Ints], Ints] | None = None
) -> Episodes:
    """Return the runs of a policy, or of A* on the true maps if `choose` is None."""
    ways = shortest_ways(scenes.blocked, scenes.targets)
    records: list[tuple[Observation, Truths, Ints, Ints]] = []

    def step(observed: Observation, rows: Ints) -> Ints:
        best = best_actions(ways[rows], observed.positions)
        records.append((observed, best, rows, np.full(len(rows), len(records))))
        return choose(observed, rows) if choose else first_of(best)

    walk_through(scenes, task.view, step)
    looks, *others = zip(*records, strict=True)
    observed = Observation(*map(np.concatenate, zip(*looks, strict=True)))
    return Episodes(observed, *map(np.concatenate, others))


class ImitationTrainer(GradientTrainer):
    """Trainer of all policies, by imitation of A* on the true map. The batches alternate between the paper's tasks.

    Parameters
    ----------
    course, kind, network, architecture
        See :class:`~..learning.gradient.GradientTrainer`.
    part : {0, 1, 2}
        Steps that are learned and judged: 1 those before the target was in the view, on O_g, 2 those after it, on
        O_p, and 0 all, on O_g. The expert decides the other steps of a validation run.
    recurrent : bool
        Whether the network has a memory. An example is then an episode, and the gradient passes through its steps.
        Otherwise it is a decision.
    mixed : bool
        Whether the examples are drawn once per epoch, and the expert decides in half of the scenes and the current
        network in the other half, so that the examples cover the states that the network's errors lead to (S. Ross,
        G. Gordon, D. Bagnell, "DAgger", AISTATS 2011). Every action that begins a shortest path is then correct.
        Otherwise each batch has new runs of A*, and its action is the only correct one.
    """

    _groups: list[Episodes]

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int],
        *, part: int = 0, recurrent: bool = False, mixed: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(course, kind, network, architecture)
        self.part, self.recurrent, self.mixed = part, recurrent, mixed

    def draw_scenes(self, task: Task, count: int, generator: np.random.Generator) -> Scenes:
        """Return random scenes of a task."""
        law = self.course.options["law"]
        return draw_scenes(self.course.examples, law, task.shape, (2, 5), count, generator)

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        if not self.mixed:
            return
        import torch

        self._groups = []
        for task in TASKS:
            scenes = self.draw_scenes(task, self.course.options["scenes"], generator)
            ways = shortest_ways(scenes.blocked, scenes.targets)
            by_expert = generator.random(len(ways)) < 0.5
            with torch.inference_mode():
                episodes = lead(scenes, task, self._policy(ways, by_expert))
            self._groups.append(episodes.take(episodes.best.any(axis=1)))

    def draw(self, batch: int, generator: np.random.Generator) -> Episodes:
        """Return the steps of a batch. Each episode of a network with memory has at least one step."""
        options, task = self.course.options, TASKS[batch % len(TASKS)]
        size = options["batch"]
        if self.mixed:
            group = self._groups[batch % len(TASKS)]
            return group.take(generator.integers(0, len(group.best), size))
        while True:
            scenes = self.draw_scenes(task, 2 * size if self.part else size, generator)
            episodes = lead(scenes, task)
            if self.part:
                episodes = episodes.take(episodes.observed.seen == (self.part == 2))
            if len(episodes.best):
                break
        episodes = episodes.take(np.isin(episodes.runs, np.unique(episodes.runs)[:size]))
        if self.recurrent:
            return episodes
        return episodes.take(generator.permutation(len(episodes.best))[:size])

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Return the mean negative logarithm of the total probability of the correct actions."""
        import torch

        episodes = self.draw(batch, generator)
        observed, best = self._inputs(episodes.observed), episodes.best
        if self.recurrent:
            inputs, decide = self.network.read(observed), Recurrence(self.network.decide)
            steps = (np.flatnonzero(episodes.steps == step) for step in np.unique(episodes.steps))
            logits = torch.cat(
                [decide(inputs[torch.from_numpy(rows)], episodes.runs[rows]) for rows in steps]
            )
        else:
            logits, _ = self.network(observed, None)
        if not self.mixed:
            best = np.arange(best.shape[1]) == episodes.actions[:, None]
        correct = logits.masked_fill(~torch.from_numpy(best), -torch.inf)
        return (torch.logsumexp(logits, dim=1) - torch.logsumexp(correct, dim=1)).mean()

    def _inputs(self, observed: Observation) -> Observation:
        return observed.tensors().in_view() if self.part == 2 else observed.tensors()

    def _policy(
        self, ways: Lengths, by_expert: Truths | None = None
    ) -> Callable[[Observation, Ints], Ints]:
        """Return the policy of the network and, in the scenes `by_expert` or outside its part, of the expert."""
        network = Recurrence(self.network)

        def choose(observed: Observation, rows: Ints) -> Ints:
            logits = network(self._inputs(observed), rows)
            expert = first_of(best_actions(ways[rows], observed.positions))
            if by_expert is None:
                led = (self.part > 0) & (observed.seen != (self.part == 2))
            else:
                led = by_expert[rows]
            return np.where(led, expert, choose_actions(logits.numpy())[0])

        return choose

    def judge(self) -> Mapping[str, float]:
        """Return the performance in the validation scenes.

        ``score`` is the share of targets reached, percent, ``collisions`` the mean number of collisions per scene,
        and ``ratio`` the mean ratio of steps to fewest steps. The scenes depend only on the seed of the course, and
        are disjoint from the training scenes.
        """
        reached, collisions, ratios = [], [], []
        for number, task in enumerate(TASKS):
            generator = np.random.default_rng([self.course.seed, 2**32 - 1, number])
            scenes = self.draw_scenes(task, self.course.options["judged"], generator)
            ways = shortest_ways(scenes.blocked, scenes.targets)
            world = walk_through(scenes, task.view, self._policy(ways))
            fewest = ways[np.arange(len(ways)), *scenes.starts.T]
            reached.append((world.positions == scenes.targets).all(axis=1))
            collisions.append(world.collisions)
            ratios.append((world.taken / fewest)[reached[-1]])
        ratio = np.concatenate(ratios)
        return {
            "score": 100.0 * float(np.mean(reached)),
            "collisions": float(np.mean(collisions)),
            "ratio": float(ratio.mean()) if len(ratio) else float("nan"),
        }

    def weights(self) -> Weights:
        """Return the weights. Large arrays are rounded to about 25 values, which keeps the file small."""
        exact = super().weights()
        arrays = {name: _rounded(array) for name, array in exact.arrays.items()}
        return Weights(exact.kind, arrays, exact.architecture)


def _rounded(weights: Any) -> Any:
    """Return an array rounded to multiples of at most a quarter of its standard deviation."""
    if weights.size < _LARGE or not 0.0 < weights.std() < np.inf:
        return weights
    step = 2.0 ** (np.floor(np.log2(weights.std())) - 2.0)
    return (np.round(weights / step) * step).astype(weights.dtype)
