"""Planner of the paper's networks: ConvNet of Table I and the value iteration module of equations 1-2.

With attention to the vehicle's cell the planner is a network of its own. As MCGN-II it plans on the partial map O_p once
the target is in the view. As the policy ``vin`` it plans on the masked map O_g in every step without memory, which
isolates the contribution of the values.

Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016,
arXiv 1602.02867: attention takes the four action values at the vehicle's cell, a linear layer turns them into logits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor, nn

    from .memory import Observation

__all__ = ["ARCHITECTURE", "GOAL", "build_network", "build_planner"]

#: Channels of the first layer and iterations (Table II).
ARCHITECTURE = {"hidden": 150, "iterations": 30}
#: Value of the target's cell in the initial reward map. The other cells are 0.
GOAL = 10.0
#: Standard deviation of the initial weights, which the paper omits. The value is from the implementation of MACN
#: that Table II follows, see :mod:`~.macn`.
_SPREAD = 0.01


def weigh(values: Tensor, fixed: Tensor, moves: Tensor) -> Tensor:
    """Return Q of V, actions first; this takes half the time of a convolution of one channel.

    `values` has shape (n, rows, columns), `fixed` is the part of Q that does not depend on V, shape (4, n, rows,
    columns), and `moves` are the kernels W^P, shape (4, 9).
    """
    import torch
    from torch.nn import functional

    padded, (rows, columns) = functional.pad(values, (1, 1, 1, 1)), values.shape[1:]
    shifted = [padded[:, i // 3 :, i % 3 :][:, :rows, :columns] for i in range(9)]
    return fixed + torch.tensordot(moves, torch.stack(shifted), dims=1)


def iterate(values: Tensor, fixed: Tensor, moves: Tensor) -> Tensor:
    """Return V after an iteration, see :func:`weigh`."""
    return weigh(values, fixed, moves).max(dim=0).values


def build_planner(hidden: int = 150, iterations: int = 30) -> nn.Module:
    """Return the ConvNet with `hidden` channels and the value iteration module with K = `iterations`.

    The call ``planner(maps, targets)`` takes maps, shape (n, rows, columns), and the row and column of
    each target, shape (n, 2). It returns the reward map R and the final value map V, shapes (n, 1, rows,
    columns), and the final action values Q, shape (n, 4, rows, columns).

    Table I has no activation, so its first two layers are computed as one convolution from map and
    reward map to R. The padding is 0.
    """
    import torch
    from torch import nn
    from torch.nn import functional

    class Planner(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            #: An iteration, which a trainer may replace by compiled code.
            self.iterate = iterate
            self.reading = nn.Conv2d(2, hidden, 3, padding=1)
            self.pooling = nn.Conv2d(hidden, 1, 1, bias=False)
            self.rewarding = nn.Conv2d(1, 4, 3, padding=1, bias=False)
            self.moving = nn.Conv2d(1, 4, 3, padding=1, bias=False)
            with torch.no_grad():
                self.reading.bias.zero_()
                for layer in (self.reading, self.pooling, self.rewarding, self.moving):
                    layer.weight.normal_(0.0, _SPREAD)

        def forward(self, maps: Tensor, targets: Tensor) -> tuple[Tensor, Tensor, Tensor]:
            cells = targets[:, :1] * maps.shape[2] + targets[:, 1:]
            goals = torch.zeros_like(maps).flatten(1).scatter(1, cells, GOAL).view_as(maps)
            pooling = self.pooling.weight[0, :, 0, 0]
            kernel = torch.einsum("h,hcij->cij", pooling, self.reading.weight)[None]
            bias = (pooling @ self.reading.bias)[None]
            rewards = functional.conv2d(torch.stack([maps, goals], dim=1), kernel, bias, padding=1)
            fixed = self.rewarding(rewards).transpose(0, 1)
            moves = self.moving.weight.reshape(4, 9)
            values = fixed.max(dim=0).values
            for _ in range(iterations):
                values = self.iterate(values, fixed, moves)
            return rewards, values[:, None], weigh(values, fixed, moves).transpose(0, 1)

    return Planner()


def build_network(hidden: int = 150, iterations: int = 30) -> nn.Module:
    """Return the planner with attention to the vehicle's cell, and its initial weights."""
    import torch
    from torch import nn

    class Vin(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.planner = build_planner(hidden, iterations)
            self.output = nn.Linear(4, 4, bias=False)

        def forward(self, observed: Observation, state: None = None) -> tuple[Tensor, None]:
            _, _, worth = self.planner(observed.current, observed.targets)
            # A vehicle outside the view is moved to the nearest cell of the view.
            sides = zip(observed.positions.T, worth.shape[2:], strict=True)
            rows, columns = (cells.clamp(0, side - 1) for cells, side in sides)
            every = torch.arange(len(worth), device=worth.device)
            return self.output(worth[every, :, rows, columns]), None

    return Vin()
