"""The paper's value iteration network: ConvNet, 30 iterations, and attention to the vehicle's cell.

As MCGN-II it plans on the partial map O_p once the target is in the view. As the policy ``vin`` it plans on the
masked map O_g in every step without memory, which isolates the contribution of the values.

Source: A. Tamar, Y. Wu, G. Thomas, S. Levine, P. Abbeel, "Value Iteration Networks", NeurIPS 2016,
arXiv 1602.02867: attention takes the four action values at the vehicle's cell, a linear layer turns them into logits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..learning.trainer import Course, Trainer, Training
from .episodes import EPISODES, DecisionTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "TRAINING", "build_network", "refuse_size"]

#: Channels of the first layer and iterations (Table II).
ARCHITECTURE = {"hidden": 150, "iterations": 30}
#: Largest number of cells of a map.
LARGEST = 256 * 256


def refuse_size(shape: tuple[int, int], view: tuple[int, int]) -> str:
    """Return the reason to refuse maps of a shape, or ``""``.

    Parameters
    ----------
    shape, view : tuple of int
        Numbers of rows and columns of the maps and of the view.
    """
    if shape[0] * shape[1] > LARGEST:
        return f"maps must have at most {LARGEST} cells, got {shape[0]} × {shape[1]}"
    return ""


def build_network(hidden: int = 150, iterations: int = 30) -> torch.nn.Module:
    """Return the network with its initial weights.

    Parameters
    ----------
    hidden, iterations : int, default 150 and 30
        Channels of the first layer, and number of iterations.
    """
    import torch
    from torch import nn

    from .value_iteration import build_planner

    class Vin(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.planner = build_planner(hidden, iterations)
            self.output = nn.Linear(4, 4, bias=False)

        def forward(self, observed: Observation, state: None = None) -> tuple[torch.Tensor, None]:
            _, _, worth = self.planner(observed.current, observed.targets)
            limits = torch.tensor(worth.shape[2:]) - 1
            # A vehicle outside the view is moved to the nearest cell of the view.
            rows, columns = torch.minimum(observed.positions.clamp(min=0), limits).T
            return self.output(worth[torch.arange(len(worth)), :, rows, columns]), None

    return Vin()


def _trainer(course: Course) -> Trainer:
    import torch

    torch.manual_seed(course.seed)
    return DecisionTrainer(course, "vin", build_network(**ARCHITECTURE), ARCHITECTURE)


TRAINING = Training(
    "vin", "the paper's value iteration network on the masked map, by imitation of A*", _trainer,
    epochs=120, minutes=60, options=EPISODES,
)  # fmt: skip
