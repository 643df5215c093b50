"""The planning part of the paper's networks: ConvNet of Table I and the value iteration module of equations 1-2."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...models.unknown_grid.plan import STEPS

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["GOAL", "build_planner"]

#: Value of the target's cell in the initial reward map; the other cells are 0.
GOAL = 10.0
#: First weights: discount of a step, worth of the reward map and of an obstacle.
_DISCOUNT, _REWARD, _OBSTACLE = 0.95, 1.0, -4.7


def build_planner(hidden: int = 150, iterations: int = 30, preset: bool = True) -> nn.Module:
    """Return the ConvNet and the value iteration module.

    The call ``planner(maps, targets)`` takes maps, shape (n, rows, columns), and the row and column of each
    target, shape (n, 2). It returns the reward map R and the final value map V, shapes (n, 1, rows, columns), and the
    final action values Q, shape (n, 4, rows, columns).

    Table I has no activation, so its first two layers are one convolution from map and reward map to R; it is
    computed as one. Outside the map all is 0.

    Parameters
    ----------
    hidden : int
        Channels of the first layer.
    iterations : int
        K.
    preset : bool
        Whether the first weights are value iteration: four moves with a discount, a reward at the target, a penalty
        on obstacles. Otherwise they are normal with standard deviation 0.01.
    """
    import torch
    from torch import nn
    from torch.nn import functional

    class Planner(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.reading = nn.Conv2d(2, hidden, 3, padding=1)
            self.pooling = nn.Conv2d(hidden, 1, 1, bias=False)
            self.rewarding = nn.Conv2d(1, 4, 3, padding=1, bias=False)
            self.moving = nn.Conv2d(1, 4, 3, padding=1, bias=False)
            with torch.no_grad():
                self.reading.bias.zero_()
                for layer in (self.reading, self.pooling, self.rewarding, self.moving):
                    layer.weight.normal_(0.0, 0.01)
                if preset:
                    self.reading.weight[0] = 0.0
                    self.reading.weight[0, :, 1, 1] = torch.tensor([_OBSTACLE, _REWARD])
                    self.pooling.weight[0, 0] = 1.0
                    for action, (down, across) in enumerate(STEPS):
                        self.rewarding.weight[action, 0, 1, 1] += 1.0
                        self.moving.weight[action, 0, 1 + down, 1 + across] += _DISCOUNT

        def forward(self, maps: Tensor, targets: Tensor) -> tuple[Tensor, Tensor, Tensor]:
            goals = torch.zeros_like(maps)
            goals[torch.arange(len(maps)), targets[:, 0], targets[:, 1]] = GOAL
            pooling = self.pooling.weight[0, :, 0, 0]
            kernel = torch.einsum("h,hcij->cij", pooling, self.reading.weight)[None]
            bias = (pooling @ self.reading.bias)[None]
            rewards = functional.conv2d(torch.stack([maps, goals], dim=1), kernel, bias, padding=1)
            fixed = self.rewarding(rewards)
            worth = fixed
            for _ in range(iterations):
                worth = fixed + self.moving(worth.amax(dim=1, keepdim=True))
            values = worth.amax(dim=1, keepdim=True)
            return rewards, values, worth

    return Planner()
