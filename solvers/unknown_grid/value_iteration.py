"""Planner of the paper's networks: ConvNet of Table I and the value iteration module of equations 1-2.

With attention to the vehicle's cell the planner is a network of its own. As MCGN-II it plans on the partial map O_p once
the target is in the view. As the policy ``vin`` it plans on the masked map O_g in every step without memory, which
isolates the contribution of the values.

Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016,
arXiv 1602.02867: attention takes the four action values at the vehicle's cell, a linear layer turns them into logits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

if TYPE_CHECKING:
    from torch import Tensor, nn

    from .memory import Observation

__all__ = ["ARCHITECTURE", "GOAL", "build_network", "build_planner"]

Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]

#: Channels of the first layer and iterations (Table II).
ARCHITECTURE = {"hidden": 150, "iterations": 30}
#: Value of the target's cell in the initial reward map. The other cells are 0.
GOAL = 10.0
#: Standard deviation of the initial weights, which the paper omits. The value is from the implementation of MACN
#: that Table II follows, see :mod:`~.macn`.
_SPREAD = 0.01


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

    class Iteration(torch.autograd.Function):
        """V_K of R(s, a) and gamma P by compiled loops, whose gradient is faster than that of convolutions."""

        @staticmethod
        def forward(context: Any, fixed: Tensor, moves: Tensor) -> Tensor:
            count, _, rows, columns = fixed.shape
            values = np.zeros((iterations + 1, count, rows + 2, columns + 2), np.float32)
            best = np.empty((iterations + 1, count, rows, columns), np.uint8)
            kernel = moves.detach().numpy()[:, 0]
            iterate(fixed.detach().contiguous().numpy(), kernel, values, best)
            context.left = kernel, values, best
            return torch.from_numpy(values[-1, :, None, 1:-1, 1:-1].copy())

        @staticmethod
        def backward(context: Any, *gradients: Any) -> tuple[Tensor, Tensor]:
            kernel, values, best = context.left
            padded = functional.pad(gradients[0][:, 0], (1, 1, 1, 1)).numpy()
            fixed = np.zeros((best.shape[1], 4, *best.shape[2:]), np.float32)
            moved = np.zeros_like(kernel)
            pass_back(padded, kernel, values, best, fixed, moved)
            return torch.from_numpy(fixed), torch.from_numpy(moved[:, None])

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
                    layer.weight.normal_(0.0, _SPREAD)

        def forward(self, maps: Tensor, targets: Tensor) -> tuple[Tensor, Tensor, Tensor]:
            goals = torch.zeros_like(maps)
            goals[torch.arange(len(maps)), targets[:, 0], targets[:, 1]] = GOAL
            pooling = self.pooling.weight[0, :, 0, 0]
            kernel = torch.einsum("h,hcij->cij", pooling, self.reading.weight)[None]
            bias = (pooling @ self.reading.bias)[None]
            rewards = functional.conv2d(torch.stack([maps, goals], dim=1), kernel, bias, padding=1)
            fixed = self.rewarding(rewards)
            if torch.is_grad_enabled():
                values = Iteration.apply(fixed, self.moving.weight)
            else:
                values = fixed.amax(dim=1, keepdim=True)
                for _ in range(iterations):
                    values = (fixed + self.moving(values)).amax(dim=1, keepdim=True)
            return rewards, values, fixed + self.moving(values)

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
            limits = torch.tensor(worth.shape[2:]) - 1
            # A vehicle outside the view is moved to the nearest cell of the view.
            rows, columns = torch.minimum(observed.positions.clamp(min=0), limits).T
            return self.output(worth[torch.arange(len(worth)), :, rows, columns]), None

    return Vin()


# -- loops: they take an eighth of the time of convolutions of one channel ---------------------------


@kernel
def iterate(fixed: Singles, moves: Singles, values: Singles, best: Bytes) -> None:
    """Fill the values of each iteration and their maximising actions.

    `fixed` is R(s, a), shape (n, 4, rows, columns), and `moves` is gamma P, shape (4, 3, 3). Output:
    `values` V_1, V_2 and so on with a zero frame, shape (iterations + 1, n, rows + 2, columns + 2), and
    `best`, their maximising actions.
    """
    count, actions, rows, columns = fixed.shape
    worth = np.empty((4, columns), np.float32)
    for k in range(count):
        for turn in range(len(values)):
            for row in range(rows):
                for action in range(actions):
                    worth[action] = fixed[k, action, row]
                    if turn:
                        for down in range(3):
                            for across in range(3):
                                factor = moves[action, down, across]
                                line = values[turn - 1, k, row + down]
                                for column in range(columns):
                                    worth[action, column] += factor * line[column + across]
                for column in range(columns):
                    top = 0
                    for action in range(1, actions):
                        if worth[action, column] > worth[top, column]:
                            top = action
                    best[turn, k, row, column] = top
                    values[turn, k, row + 1, column + 1] = worth[top, column]


@kernel
def pass_back(
    gradient: Singles, moves: Singles, values: Singles, best: Bytes, fixed: Singles, moved: Singles
) -> None:
    """Add the gradients with respect to R(s, a) and gamma P to `fixed` and `moved`.

    `gradient`, shape (n, rows + 2, columns + 2), is that with respect to the last values. Its frame is
    ignored, and the function overwrites it. `moves`, `values` and `best` are the arguments of
    :func:`iterate`, after the call.
    """
    count, actions, rows, columns = fixed.shape
    before = np.empty((rows + 2, columns + 2), np.float32)
    part = np.empty(columns, np.float32)
    for k in range(count):
        for turn in range(len(values) - 1, -1, -1):
            before[:] = 0.0
            for row in range(rows):
                for action in range(actions):
                    for column in range(columns):
                        chosen = best[turn, k, row, column] == action
                        part[column] = gradient[k, row + 1, column + 1] if chosen else 0.0
                        fixed[k, action, row, column] += part[column]
                    if turn == 0:
                        continue
                    for down in range(3):
                        line = values[turn - 1, k, row + down]
                        into = before[row + down]
                        for across in range(3):
                            factor, total = moves[action, down, across], np.float32(0.0)
                            for column in range(columns):
                                into[column + across] += factor * part[column]
                                total += part[column] * line[column + across]
                            moved[action, down, across] += total
            gradient[k] = before
