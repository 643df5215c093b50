"""A value iteration network that sees the current view alone, and remembers nothing.

Two layers read a reward for each cell from the masked map of the latest look, obstacles all around it. 30
iterations follow: the values of five abstract actions are a convolution of rewards and values, and the
value of a cell is the largest of them. The five values at the vehicle's cell give the logits of the four
actions. The first weights are value iteration: a reward is -1, 0 at the target and -60 on an obstacle,
one abstract action stays and four go to a neighbour.

Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016,
arXiv 1602.02867, with the 30 iterations of the paper that this problem is from. First weights and sizes
of layers are ours; with random ones 30 iterations did not learn within minutes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ...models.unknown_grid.plan import STEPS
from ...models.unknown_grid.world import BLOCKED, FREE, TARGET, UNKNOWN
from ..trainer import Course, Trainer, Training
from .imitation import IMITATION, StepTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "TRAINING", "build_network", "refuse_size"]

#: Channels of the reading layer, and iterations.
ARCHITECTURE = {"channels": 40, "iterations": 30}
#: Iterations that gradients go through: those before them cost as much, and tell little more.
_TRACED = 8
#: Cells of a map at the most.
LARGEST = 256 * 256


def refuse_size(shape: tuple[int, int], view: tuple[int, int]) -> str:
    """Return why maps of a shape cannot be taken, else ``""``."""
    if shape[0] * shape[1] > LARGEST:
        return f"maps must have at most {LARGEST} cells, got {shape[0]} × {shape[1]}"
    return ""


def build_network(channels: int = 40, iterations: int = 30) -> torch.nn.Module:
    """Return the network with its first weights."""
    import torch
    from torch import nn
    from torch.nn import functional

    untraced = iterations - _TRACED

    class Vin(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.reading = nn.Conv2d(4, channels, 3, padding="same")
            self.reward = nn.Conv2d(channels, 1, 3, padding="same", bias=False)
            self.move = nn.Conv2d(2, 5, 3, padding="same", bias=False)
            self.choice = nn.Linear(5, 4)
            with torch.no_grad():
                self.reward.weight.mul_(0.01)
                self.move.weight.zero_()
                self.choice.weight.zero_()
                # The first three channels tell what a cell holds: an obstacle, nothing known or free.
                self.reading.weight[:3].zero_()
                self.reading.bias[:3] = 0.0
                self.reward.weight[0, :3] = 0.0
                for channel, worth in enumerate((-60.0, -1.0, -1.0)):
                    self.reading.weight[channel, channel, 1, 1] = 1.0
                    self.reward.weight[0, channel, 1, 1] = worth
                self.move.weight[:, 0, 1, 1] = 1.0
                self.move.weight[4, 1, 1, 1] = 1.0
                for action, (down, across) in enumerate(STEPS):
                    self.move.weight[action, 1, 1 + down, 1 + across] = 1.0
                    self.choice.weight[action, action] = 2.0

        def forward(self, observed: Observation, state: None = None) -> tuple[torch.Tensor, None]:
            walled = functional.pad(observed.current, (1, 1, 1, 1), value=float(BLOCKED))
            holds = [walled == one for one in (BLOCKED, FREE, UNKNOWN, TARGET)]
            planes = torch.stack(holds, dim=1).to(torch.float32)
            rewards = self.reward(functional.relu(self.reading(planes)))
            at_once, later = self.move.weight[:, :1], self.move.weight[:, 1:]
            gained = functional.conv2d(rewards, at_once, padding=1)
            worth = gained
            for iteration in range(iterations):
                with torch.set_grad_enabled(torch.is_grad_enabled() and iteration >= untraced):
                    values = worth.amax(dim=1, keepdim=True)
                    worth = gained + functional.conv2d(values, later, padding=1)
            every, (down, across) = torch.arange(len(worth)), 1 + observed.positions.T
            return self.choice(worth[every, :, down, across]), None

    return Vin()


def _trainer(course: Course) -> Trainer:
    import torch

    torch.manual_seed(course.seed)
    return StepTrainer(course, "vin", build_network(**ARCHITECTURE), ARCHITECTURE, once=True)


TRAINING = Training(
    "vin",
    "a value iteration network on the current view, by imitation of the shortest way",
    _trainer,
    epochs=6,
    minutes=3,
    options={
        **IMITATION,
        # What the true map says is not to be known from one view, and would have it turn back and forth.
        "expert": replace(IMITATION["expert"], default="known"),
        "scenes": replace(IMITATION["scenes"], default=64),
        # Values of 30 steps change much with the kernel that each step goes through.
        "rate": replace(IMITATION["rate"], default=0.0001),
    },
)
