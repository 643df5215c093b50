"""Small value iteration network on the remembered map, initialised as exact value iteration.

A network of two layers computes the positive cost of entering a cell from the 7 × 7 cells around it. Known
obstacles cannot be entered. Undiscounted value iteration runs until convergence: the value of a cell is the
largest value of its neighbours minus the cost of entering it. With the initial weights every cell costs
about 1, known or not, so the best action begins a shortest path with unknown cells treated as free. Training
adds predictions of the unseen part of a map from the seen part, such as the continuation of walls.

Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016,
arXiv 1602.02867. Unlike there, the moves are known instead of learned, and the number of iterations
depends on the map.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...models.unknown_grid.world import BLOCKED, FREE, TARGET, UNKNOWN

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "build_network"]

#: Channels and side of the kernel of the first layer.
ARCHITECTURE = {"channels": 12, "window": 5}
#: Value below that of any cell with a path.
_LOWEST = -1e9
#: Number of sweeps between two tests of convergence.
_ROUND = 8


def build_network(channels: int = 12, window: int = 5) -> torch.nn.Module:
    """Return the network with its initial weights. :data:`ARCHITECTURE` has the default sizes."""
    import torch
    from torch import nn
    from torch.nn import functional

    class SmallVin(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.reading = nn.Conv2d(4, channels, window, padding="same")
            self.cost = nn.Conv2d(channels, 1, 3, padding="same")
            self.sharpness = nn.Parameter(torch.tensor(2.0))
            with torch.no_grad():
                # Small weights make all costs about 1 at first, because softplus(0.5413) = 1.
                self.cost.weight.mul_(0.01)
                self.cost.bias.fill_(0.5413)

        def forward(self, observed: Observation, state: None = None) -> tuple[torch.Tensor, None]:
            masks = [observed.known == state for state in (BLOCKED, FREE, UNKNOWN, TARGET)]
            planes = torch.stack(masks, dim=1).to(torch.float32)
            costs = functional.softplus(self.cost(functional.relu(self.reading(planes))))[:, 0]
            values = functional.pad(_values(costs, *masks[::3]), (1, 1, 1, 1), value=_LOWEST)
            every, (down, across) = torch.arange(len(values)), observed.positions.T
            worth = [values[every, down + 2 * side, across + 1] for side in (0, 1)]
            worth += [values[every, down + 1, across + 2 * side] for side in (0, 1)]
            after = torch.stack(worth, dim=1)
            return self.sharpness * (after - after.amax(dim=1, keepdim=True)), None

    def _values(costs: torch.Tensor, blocked: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
        """Return the value of entering each cell, `_LOWEST` for cells without a path."""
        lowest = torch.full_like(costs, _LOWEST)
        values = lowest.masked_fill(target, 0.0)
        for sweep in range(1, costs[0].numel() + _ROUND):
            before = values
            padded = functional.pad(values, (1, 1, 1, 1), value=_LOWEST)
            best = torch.maximum(
                torch.maximum(padded[:, :-2, 1:-1], padded[:, 2:, 1:-1]),
                torch.maximum(padded[:, 1:-1, :-2], padded[:, 1:-1, 2:]),
            )
            values = torch.where(blocked, lowest, (best - costs).clamp(min=_LOWEST))
            values = values.masked_fill(target, 0.0)
            if sweep % _ROUND == 0 and torch.equal(values, before):
                break
        return values

    return SmallVin()
