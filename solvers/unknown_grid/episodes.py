"""The paper's training: imitation of A* on the true map, one action per step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contract.option import Option
from ..learning.gradient import GradientTrainer
from ..learning.trainer import Course
from ..learning.weights import Weights
from .imitation import (
    IMITATION,
    TASKS,
    Recurrence,
    Scenes,
    Task,
    Walk,
    best_actions,
    draw_scenes,
    first_of,
    judge_network,
    shortest_ways,
    walk_through,
)
from .memory import Observation

if TYPE_CHECKING:
    import torch

__all__ = ["EPISODES", "DecisionTrainer", "Episodes", "RunTrainer"]

Ints = NDArray[np.int64]

#: Options of the trainings. The defaults are the values of Table II.
EPISODES: Mapping[str, Option] = {
    "law": replace(IMITATION["law"], default="paper"),
    "batches": replace(IMITATION["batches"], default=200),
    "batch": Option(64, "episodes of a batch", int, lower=1),
    "rate": replace(IMITATION["rate"], default=1e-4),
    "judged": replace(IMITATION["judged"], default=64),
}
#: Entries of an array above which it is rounded.
_LARGE = 10_000


class Episodes(NamedTuple):
    """Runs of the expert, one row per step and run.

    Parameters
    ----------
    observed : Observation
        Observations before each step, as arrays in the order of the steps.
    actions : ndarray of int, shape (k,)
        Actions of the expert.
    runs, steps : ndarray of int, shape (k,)
        Indices of the run and of the step.
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


class _EpisodeTrainer(GradientTrainer):
    """Base of trainers on batches of A* episodes in new scenes. The batches alternate between the tasks.

    Parameters
    ----------
    course, kind, network, architecture
        Parameters of :class:`~..gradient.GradientTrainer`.
    part : {0, 1, 2}
        1 selects the steps before the target was in the view, 2 the steps after it on O_p, and 0 all
        steps on O_g.
    """

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
            scenes = draw_scenes(
                self.course.examples, options["law"], task.shape, (2, 5), count, generator
            )
            episodes = lead_expert(scenes, task)
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

    def judge(self) -> Mapping[str, float]:
        options = self.course.options
        return judge_network(
            self.network, self.course.examples, options["law"], self.course.seed, options["judged"],
            part=self.part,
        )  # fmt: skip


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
