"""Training along whole runs, of networks that remember."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.world import BLOCKED
from ..gradient import GradientTrainer
from ..option import Option
from ..trainer import Course
from .imitation import (
    IMITATION,
    TASKS,
    Scenes,
    Task,
    Walk,
    best_actions,
    choose_actions,
    draw_scenes,
    first_of,
    imitation_loss,
    judge_network,
    shortest_ways,
    walk_through,
)
from .memory import Observation

if TYPE_CHECKING:
    import torch

__all__ = ["RUNS", "RunTrainer"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: How often a vehicle does what the expert would, and what chance says, while the network learns.
_EXPERT, _CHANCE = 0.1, 0.05
#: Steps of the runs in the first half of the epochs, and in the second.
_SHORT, _LONG = 24, 40
#: The options of trainings along whole runs.
RUNS: Mapping[str, Option] = {
    "law": IMITATION["law"],
    "expert": replace(IMITATION["expert"], default="known"),
    "scenes": replace(IMITATION["scenes"], default=400),
    "batches": replace(IMITATION["batches"], default=30),
    "runs": Option(64, "runs of a batch", int, lower=1),
    "rate": replace(IMITATION["rate"], default=1e-3),
}


class RunTrainer(GradientTrainer):
    """Imitation along whole runs: the network leads, and an expert says at each step what it would do.

    Half of the runs are in scenes that ask for a memory: a planner that knows the current view alone fails
    there. Now and then the vehicle goes where the expert, or chance, would go. The gradient passes
    through all steps of a run.
    """

    _pools: list[tuple[Scenes, Truths]]
    _steps: int

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int]
    ) -> None:
        asked = course.options
        super().__init__(
            course, kind, network, architecture, batches=asked["batches"], rate=asked["rate"]
        )

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        self._pools = []
        self._steps = _SHORT if 2 * number < self.course.epochs else _LONG
        asked = self.course.options
        for task in TASKS:
            scenes = draw_scenes(
                self.course.examples, asked["law"], task.shape, (2, 5), asked["scenes"], generator
            )
            self._pools.append((scenes, _need_memory(scenes, task)))

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Return the mean loss of the decisions in runs of one of the tasks, which take turns."""
        import torch

        asked, task = self.course.options, TASKS[batch % len(TASKS)]
        pool, hard = self._pools[batch % len(TASKS)]
        share = np.where(hard, 0.5 / max(hard.sum(), 1), 0.5 / max((~hard).sum(), 1))
        chosen = generator.choice(len(hard), asked["runs"], p=share / share.sum())
        scenes = Scenes(*(one[chosen] for one in pool))
        ways = shortest_ways(scenes.blocked, scenes.targets)
        losses: list[torch.Tensor] = []
        state: Any = None
        walk = Walk(scenes, task.view, steps=self._steps)
        before = walk.going

        def choose(observed: Observation, rows: Ints) -> Ints:
            nonlocal state, before
            if state is not None:
                kept = torch.from_numpy(np.searchsorted(before, rows))
                state = tuple(one[kept] for one in state)
            logits, state = self.network(observed.tensors(), state)
            before = rows
            known = asked["expert"] == "known"
            here = (
                shortest_ways(observed.known == BLOCKED, observed.targets) if known else ways[rows]
            )
            best = best_actions(here, observed.positions)
            losses.append(imitation_loss(logits, torch.from_numpy(best)))
            actions = choose_actions(logits.detach().numpy())[0]
            drawn = generator.random(len(rows))
            actions = np.where(drawn < _EXPERT, first_of(best), actions)
            anywhere = generator.integers(0, 4, len(rows))
            return np.where(drawn > 1.0 - _CHANCE, anywhere, actions)

        walk_through(walk, choose)
        return torch.cat(losses).mean()

    def judge(self) -> Mapping[str, float]:
        return judge_network(
            self.network, self.course.examples, self.course.options["law"], self.course.seed
        )


def _need_memory(scenes: Scenes, task: Task) -> Truths:
    """Return in which scenes a shortest way on the current view, unknown cells free, leads nowhere."""
    walk = Walk(scenes, task.view)

    def choose(observed: Observation, rows: Ints) -> Ints:
        ways = shortest_ways(observed.current == BLOCKED, observed.targets)
        return first_of(best_actions(ways, observed.positions))

    walk_through(walk, choose)
    return ~walk.reached
