"""A small value iteration network on the remembered map, which begins as value iteration itself.

To enter a cell costs what a network of two layers reads from the 7 × 7 cells around it; the costs are
positive, and an obstacle that was seen is never entered. Value iteration follows, without discount and
until nothing changes: the value of a cell is the largest of its neighbours' values, less the cost of
entering it. With the first weights every cell costs 1, known or not, so the best action begins a
shortest way on which unknown cells count as free. Learning adds what the seen part of a map
tells of the part that is not seen, such as how walls go on.

Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016,
arXiv 1602.02867. It differs in that the moves are known and not learned, and that the number of
iterations follows the map.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...models.unknown_grid.world import BLOCKED, FREE, TARGET, UNKNOWN
from ..trainer import Course, Trainer, Training
from .imitation import IMITATION, StepTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "TRAINING", "build_network", "refuse_size"]

#: Channels of the first layer, and rows and columns of what it reads.
ARCHITECTURE = {"channels": 12, "window": 5}
#: Cells of a map at the most: an iteration is a sweep over all of them, and a way may wind through half.
LARGEST = 256 * 256
#: Less than the value of any cell with a way.
_LOWEST = -1e9
#: Sweeps between two looks at whether anything changes.
_ROUND = 8


def refuse_size(shape: tuple[int, int], view: tuple[int, int]) -> str:
    """Return why maps of a shape cannot be taken, else ``""``."""
    if shape[0] * shape[1] > LARGEST:
        return f"maps must have at most {LARGEST} cells, got {shape[0]} × {shape[1]}"
    return ""


def build_network(channels: int = 12, window: int = 5) -> torch.nn.Module:
    """Return the network with its first weights."""
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
                # Almost nothing of what is read counts, and softplus(0.5413) = 1.
                self.cost.weight.mul_(0.01)
                self.cost.bias.fill_(0.5413)

        def forward(self, observed: Observation, state: None = None) -> tuple[torch.Tensor, None]:
            holds = [observed.known == one for one in (BLOCKED, FREE, UNKNOWN, TARGET)]
            planes = torch.stack(holds, dim=1).to(torch.float32)
            costs = functional.softplus(self.cost(functional.relu(self.reading(planes))))[:, 0]
            values = functional.pad(_values(costs, *holds[::3]), (1, 1, 1, 1), value=_LOWEST)
            every, (down, across) = torch.arange(len(values)), observed.positions.T
            worth = [
                (down, across + 1),
                (down + 2, across + 1),
                (down + 1, across),
                (down + 1, across + 2),
            ]
            after = torch.stack([values[every, *place] for place in worth], dim=1)
            return self.sharpness * (after - after.amax(dim=1, keepdim=True)), None

    def _values(costs: torch.Tensor, blocked: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
        """Return the value of entering each cell, the lowest where there is no way."""
        least = torch.full_like(costs, _LOWEST)
        values = least.masked_fill(target, 0.0)
        for sweep in range(1, costs[0].numel() + _ROUND):
            before = values
            held = functional.pad(values, (1, 1, 1, 1), value=_LOWEST)
            best = torch.maximum(
                torch.maximum(held[:, :-2, 1:-1], held[:, 2:, 1:-1]),
                torch.maximum(held[:, 1:-1, :-2], held[:, 1:-1, 2:]),
            )
            values = torch.where(blocked, least, (best - costs).clamp(min=_LOWEST))
            values = values.masked_fill(target, 0.0)
            if sweep % _ROUND == 0 and torch.equal(values, before):
                break
        return values

    return SmallVin()


def _trainer(course: Course) -> Trainer:
    import torch

    torch.manual_seed(course.seed)
    return StepTrainer(course, "small-vin", build_network(**ARCHITECTURE), ARCHITECTURE)


TRAINING = Training(
    "small-vin",
    "value iteration on the remembered map with learned costs, by imitation of the shortest way",
    _trainer,
    epochs=12,
    minutes=3,
    options=IMITATION,
)
