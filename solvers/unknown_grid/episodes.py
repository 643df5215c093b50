"""Trainings by imitation: of the best actions in single steps, and of A* in whole episodes as in the paper."""

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
    Walk,
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
    "DecisionTrainer",
    "Episodes",
    "RunTrainer",
    "StepTrainer",
    "lead_expert",
]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Options of all trainings by imitation.
IMITATION: Mapping[str, Option] = {
    "law": Option("walls", "the law that scenes are drawn from", str),
    "scenes": Option(192, "scenes of each task that an epoch is drawn from", int, lower=1),
    "batches": Option(40, "steps of Adam in an epoch", int, lower=1),
    "batch": Option(256, "decisions of a batch", int, lower=1),
    "rate": Option(0.01, "the first learning rate", float, lower=0.0, upper=1.0),
    "judged": Option(128, "scenes of each task that an epoch is judged by", int, lower=1),
}
#: Options of the trainings of the paper. The defaults are the values of Table II.
EPISODES: Mapping[str, Option] = {
    "law": replace(IMITATION["law"], default="paper"),
    "batches": replace(IMITATION["batches"], default=200),
    "batch": Option(64, "episodes of a batch", int, lower=1),
    "rate": replace(IMITATION["rate"], default=1e-4),
    "judged": replace(IMITATION["judged"], default=64),
}
#: Entries of an array above which it is rounded.
_LARGE = 10_000


class _ImitationTrainer(GradientTrainer):
    """Base of trainers by imitation. It judges a network in validation scenes of the paper's three tasks."""

    #: Steps that are learned and judged: 1 those before the target was in the view, on O_g, 2 those after it, on O_p,
    #: and 0 all, on O_g. The expert decides the other steps of a validation run.
    part = 0

    def draw_scenes(self, task: Task, count: int, generator: np.random.Generator) -> Scenes:
        """Return random scenes of a task."""
        law = self.course.options["law"]
        return draw_scenes(self.course.examples, law, task.shape, (2, 5), count, generator)

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
            walk = Walk(scenes, task.view)
            ways = shortest_ways(scenes.blocked, scenes.targets)
            walk_through(walk, self._policy(ways))
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

    def _policy(self, ways: Lengths) -> Callable[[Observation, Ints], Ints]:
        """Return the policy of the network and, for the other steps, of the expert."""
        network = Recurrence(self.network)

        def choose(observed: Observation, rows: Ints) -> Ints:
            inputs = observed.tensors()
            logits = network(inputs.in_view() if self.part == 2 else inputs, rows)
            actions = choose_actions(logits.numpy())[0]
            if not self.part:
                return actions
            expert = first_of(best_actions(ways[rows], observed.positions))
            return np.where(observed.seen == (self.part == 2), actions, expert)

        return choose


class StepTrainer(_ImitationTrainer):
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
            scenes = self.draw_scenes(task, options["scenes"], generator)
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
        import torch

        observed, best = self._groups[batch % len(self._groups)]
        rows = generator.integers(0, len(best), self.course.options["batch"])
        logits, _ = self.network(Observation._make(array[rows] for array in observed), None)
        # Negative logarithm of the total probability of the actions that begin a shortest path.
        chosen = logits.masked_fill(~best[rows], -torch.inf)
        return (torch.logsumexp(logits, dim=1) - torch.logsumexp(chosen, dim=1)).mean()


class Episodes(NamedTuple):
    """Runs of the expert, one row per step and run, in the order of the steps.

    The fields are the observations before each step, the actions, and the indices of the run and of the
    step.
    """

    observed: Observation
    actions: Ints
    runs: Ints
    steps: Ints

    def take(self, rows: Any) -> Episodes:
        """Return the steps at `rows`."""
        observed = Observation._make(array[rows] for array in self.observed)
        return Episodes(observed, self.actions[rows], self.runs[rows], self.steps[rows])


def lead_expert(scenes: Scenes, task: Task, steps: int = 40) -> Episodes:
    """Return the runs of A* on the true maps. Ties go to up, down, left, right in this order."""
    ways = shortest_ways(scenes.blocked, scenes.targets)
    looks: list[Observation] = []
    actions: list[Ints] = []
    runs: list[Ints] = []
    times: list[Ints] = []

    def choose(observed: Observation, rows: Ints) -> Ints:
        best = first_of(best_actions(ways[rows], observed.positions))
        looks.append(observed)
        actions.append(best)
        runs.append(rows)
        times.append(np.full(len(rows), len(times)))
        return best

    walk_through(Walk(scenes, task.view, steps=steps), choose)
    observed = Observation(*map(np.concatenate, zip(*looks, strict=True)))
    return Episodes(observed, *map(np.concatenate, (actions, runs, times)))


class _EpisodeTrainer(_ImitationTrainer):
    """Base of trainers on batches of A* episodes in new scenes. The batches alternate between the tasks."""

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int],
        *, part: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(course, kind, network, architecture)
        self.part = part

    def draw(self, batch: int, generator: np.random.Generator) -> Episodes:
        """Return the training steps of a batch; each episode has at least one step."""
        options, task = self.course.options, TASKS[batch % len(TASKS)]
        count = 2 * options["batch"] if self.part else options["batch"]
        while True:
            episodes = lead_expert(self.draw_scenes(task, count, generator), task)
            if self.part:
                episodes = episodes.take(episodes.observed.seen == (self.part == 2))
            if len(episodes.actions):
                chosen = np.unique(episodes.runs)[: options["batch"]]
                return episodes.take(np.isin(episodes.runs, chosen))

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


class DecisionTrainer(_EpisodeTrainer):
    """Trainer of networks without memory. Option ``batch`` is its number of decisions per batch."""

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        import torch
        from torch.nn import functional

        episodes = self.draw(batch, generator)
        rows = generator.permutation(len(episodes.actions))[: self.course.options["batch"]]
        sample = episodes.take(rows)
        observed = sample.observed.tensors()
        if self.part == 2:
            observed = observed.in_view()
        logits, _ = self.network(observed, None)
        return functional.cross_entropy(logits, torch.from_numpy(sample.actions))


class RunTrainer(_EpisodeTrainer):
    """Trainer of networks with memory. The gradient passes through all steps of an episode."""

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        import torch
        from torch.nn import functional

        episodes = self.draw(batch, generator)
        inputs = self.network.read(episodes.observed.tensors())
        decide, logits = Recurrence(self.network.decide), []
        for step in range(int(episodes.steps.max()) + 1):
            rows = np.flatnonzero(episodes.steps == step)
            logits.append(decide(inputs[torch.from_numpy(rows)], episodes.runs[rows]))
        return functional.cross_entropy(torch.cat(logits), torch.from_numpy(episodes.actions))
