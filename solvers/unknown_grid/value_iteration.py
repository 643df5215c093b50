"""What the networks with a memory share: planes, windows and value iteration by convolutions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...models.unknown_grid.world import BLOCKED, FREE, TARGET, UNKNOWN
from .memory import Observation

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["OBSTACLE", "SLOWNESS", "advantages", "build_planner", "crop", "indicate", "moved"]

#: What entering an obstacle costs at first: more than any way that the iterations find.
OBSTACLE = 30.0
#: What changes of the planner count: a step of Adam that is small for a layer is large for 30 iterations.
SLOWNESS = 0.02
#: Iterations that have a gradient: near the end all are alike, and the others cost as much again.
_TRACED = 4
#: Row and column of stay, up, down, left, right in a kernel of 3 × 3.
_KERNEL = ((1, 1), (0, 1), (2, 1), (1, 0), (1, 2))


def indicate(cells: Tensor) -> Tensor:
    """Return planes that say where each value is, shape (n, 4, rows, columns), of cells of -1, 0, 1 and 2."""
    import torch

    return torch.stack([cells == one for one in (UNKNOWN, FREE, BLOCKED, TARGET)], dim=1).to(
        torch.float32
    )


def crop(planes: Tensor, places: Tensor, half: int) -> Tensor:
    """Return windows of (2·half + 1)² cells around places, shape (n, c, size, size); zero beyond the edge.

    Parameters
    ----------
    planes : Tensor, shape (n, c, rows, columns)
    places : Tensor of int, shape (n, 2)
    """
    import torch
    from torch.nn import functional

    padded = functional.pad(planes, (half,) * 4)
    count, channels, _, columns = padded.shape
    span = torch.arange(2 * half + 1)
    down = places[:, 0, None, None] + span[:, None]
    across = places[:, 1, None, None] + span
    at = (down * columns + across).reshape(count, 1, -1).expand(-1, channels, -1)
    return padded.flatten(2).gather(2, at).reshape(count, channels, len(span), len(span))


def build_planner(iterations: int) -> nn.Module:
    """Return value iteration by convolutions of rewards and values, and the largest over actions.

    Of rewards, shape (n, 1, rows, columns), it returns what each of five actions is worth, shape (n, 5, rows,
    columns), and the values, shape (n, 1, rows, columns). By its first weights one action stays and four go to
    a neighbour.

    Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016, arXiv
    1602.02867.
    """
    import torch
    from torch import nn
    from torch.nn import functional

    def worth_of(fixed: Tensor, values: Tensor, kernel: Tensor) -> Tensor:
        return fixed + functional.conv2d(values, kernel, padding=1)

    class ValueIteration(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            reward, value = torch.zeros(2, 5, 1, 3, 3)
            reward[:, 0, 1, 1] = 1.0
            for action, (row, column) in enumerate(_KERNEL):
                value[action, 0, row, column] = 1.0
            self.register_buffer("first", torch.stack([reward, value]))
            self.change = nn.Parameter(torch.zeros(2, 5, 1, 3, 3))

        def forward(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
            reward, value = self.first + SLOWNESS * self.change
            fixed = functional.conv2d(rewards, reward, padding=1)
            with torch.no_grad():
                values = torch.zeros_like(rewards)
                for _ in range(iterations - _TRACED):
                    values = worth_of(fixed, values, value).amax(dim=1, keepdim=True)
            for _ in range(min(_TRACED, iterations)):
                worth = worth_of(fixed, values, value)
                values = worth.amax(dim=1, keepdim=True)
            return worth, values

    return ValueIteration()


def moved(observed: Observation, state: tuple[Tensor, ...] | None) -> Tensor:
    """Return the change of row and column since the last step, and whether there was one, shape (n, 3).

    The last entry of the state is where the vehicles were.
    """
    import torch

    places = observed.positions.to(torch.float32)
    if state is None:
        return torch.zeros(len(places), 3)
    return torch.cat([places - state[-1], torch.ones(len(places), 1)], dim=1)


def advantages(worth: Tensor, places: Tensor) -> Tensor:
    """Return how much less than the best each action but to stay is worth at places, shape (n, 4)."""
    here = crop(worth[:, 1:], places, 0)[..., 0, 0]
    return here - here.amax(dim=1, keepdim=True)
