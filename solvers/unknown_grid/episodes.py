"""The paper's training: A* on the true map leads, and the network learns the action of each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gradient import GradientTrainer
from ..option import Option
from ..trainer import Course
from ..weights import Weights
from .imitation import (
    IMITATION,
    TASKS,
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

#: The options of the trainings, by default the values of Table II.
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
        Arrays of what is known before each step, steps in order.
    actions : ndarray of int, shape (k,)
        The expert's.
    runs, steps : ndarray of int, shape (k,)
        Number of the run and of the step.
    """

    observed: Observation
    actions: Ints
    runs: Ints
    steps: Ints

    def take(self, rows: Any) -> Episodes:
        """Return the steps at `rows`."""
        observed = Observation._make(one[rows] for one in self.observed)
        return Episodes(observed, self.actions[rows], self.runs[rows], self.steps[rows])


def lead_expert(scenes: Scenes, task: Task, steps: int = 40) -> Episodes:
    """Return the runs of A* on the true maps; of equal actions the first of up, down, left and right."""
    ways = shortest_ways(scenes.blocked, scenes.targets)
    looks: list[Observation] = []
    actions: list[Ints] = []
    runs: list[Ints] = []
    times: list[Ints] = []

    def choose(observed: Observation, rows: Ints) -> Ints:
        chosen = first_of(best_actions(ways[rows], observed.positions))
        looks.append(observed)
        actions.append(chosen)
        runs.append(rows)
        times.append(np.full(len(rows), len(times)))
        return chosen

    walk_through(Walk(scenes, task.view, steps=steps), choose)
    observed = Observation(*map(np.concatenate, zip(*looks, strict=True)))
    return Episodes(observed, *map(np.concatenate, (actions, runs, times)))


class _EpisodeTrainer(GradientTrainer):
    """Base: each batch holds episodes of A* in new scenes of one of the tasks, which take turns.

    Parameters
    ----------
    course, kind, network, architecture
        As for the base.
    part : {0, 1, 2}
        1: only steps before the target was in the view; 2: only those after, on O_p; 0: all steps on O_g.
    """

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int],
        *, part: int = 0,
    ) -> None:  # fmt: skip
        self.part = part
        asked = course.options
        super().__init__(
            course, kind, network, architecture, batches=asked["batches"], rate=asked["rate"]
        )

    def draw(self, batch: int, generator: np.random.Generator) -> Episodes:
        """Return the steps to learn from; each episode has at least one."""
        asked, task = self.course.options, TASKS[batch % len(TASKS)]
        count = 2 * asked["batch"] if self.part else asked["batch"]
        while True:
            scenes = draw_scenes(
                self.course.examples, asked["law"], task.shape, (2, 5), count, generator
            )
            found = lead_expert(scenes, task)
            if self.part:
                found = found.take(found.observed.seen == (self.part == 2))
            if len(found.actions):
                first = np.unique(found.runs)[: asked["batch"]]
                return found.take(np.isin(found.runs, first))

    def weights(self) -> Weights:
        """Return the weights, large arrays rounded to about 25 values, so that their file is small."""
        found = super().weights()
        arrays = {name: _rounded(one) for name, one in found.arrays.items()}
        return Weights(found.kind, arrays, found.architecture)

    def judge(self) -> Mapping[str, float]:
        asked = self.course.options
        return judge_network(
            self.network, self.course.examples, asked["law"], self.course.seed, asked["judged"],
            part=self.part,
        )  # fmt: skip


def _rounded(weights: Any) -> Any:
    """Return an array rounded to multiples of a quarter of its standard deviation, or less."""
    if weights.size < _LARGE or not 0.0 < weights.std() < np.inf:
        return weights
    step = 2.0 ** (np.floor(np.log2(weights.std())) - 2.0)
    return (np.round(weights / step) * step).astype(weights.dtype)


class DecisionTrainer(_EpisodeTrainer):
    """For networks without memory: a batch holds as many decisions as :class:`RunTrainer` takes episodes."""

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        import torch
        from torch.nn import functional

        found = self.draw(batch, generator)
        rows = generator.permutation(len(found.actions))[: self.course.options["batch"]]
        some = found.take(rows)
        observed = some.observed.tensors()
        if self.part == 2:
            observed = observed.in_view()
        logits, _ = self.network(observed, None)
        return functional.cross_entropy(logits, torch.from_numpy(some.actions))


class RunTrainer(_EpisodeTrainer):
    """For networks with memory: the gradient passes through all steps of an episode."""

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        import torch
        from torch.nn import functional

        found = self.draw(batch, generator)
        inputs = self.network.read(found.observed.tensors())
        state: Any = None
        before: Ints = np.zeros(0, np.int64)
        logits = []
        for step in range(int(found.steps.max()) + 1):
            rows = np.flatnonzero(found.steps == step)
            runs = found.runs[rows]
            if state is not None:
                kept = torch.from_numpy(np.searchsorted(before, runs))
                state = tuple(one[kept] for one in state)
            out, state = self.network.decide(inputs[torch.from_numpy(rows)], state)
            before = runs
            logits.append(out)
        return functional.cross_entropy(torch.cat(logits), torch.from_numpy(found.actions))
