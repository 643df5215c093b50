"""MACN: value iteration and a differentiable memory. MCGN-I is the same network with another input.

A ConvNet and 30 iterations plan on the masked map O_g. The controller of a neural computer reads two maps, and
its output is linear in output vector and read vectors. MACN reads R and V, MCGN-I reads O_g and V.

Source: A. Khan, C. Zhang, N. Atanasov, K. Karydis, V. Kumar, D. D. Lee, "Memory Augmented Control Networks",
ICLR 2018, arXiv 1709.05706. The paper on unknown grids names MACN as its baseline without describing it. Its Table II
repeats the names and most values of the settings of a public implementation (github.com/didibear/macn-gym-pathfinding).
The controller reads R and V as in that implementation.

Maps of fewer than 17 × 17 cells are centred on a canvas of that size and surrounded by obstacles, because the
controller has one input per cell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...models.unknown_grid.world import BLOCKED
from ..learning.trainer import Course, Trainer, Training
from .episodes import EPISODES, RunTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "TRAINING", "build_network", "refuse_size"]

#: Side of the canvas in cells, and the sizes of Table II.
ARCHITECTURE: dict[str, Any] = {
    "side": 17, "hidden": 150, "iterations": 30, "units": 256, "words": 32, "width": 8, "heads": 4,
}  # fmt: skip


def refuse_size(shape: tuple[int, int], view: tuple[int, int]) -> str:
    """Return the reason to refuse maps of a shape, or ``""``.

    Parameters
    ----------
    shape, view : tuple of int
        Numbers of rows and columns of the maps and of the view.
    """
    side = ARCHITECTURE["side"]
    if max(shape) > side:
        return f"maps must have at most {side} × {side} cells, got {shape[0]} × {shape[1]}"
    return ""


def build_network(
    side: int, hidden: int, iterations: int, units: int, words: int, width: int, heads: int,
    *, reads_map: bool = False,
) -> torch.nn.Module:  # fmt: skip
    """Return the network with its initial weights. :data:`ARCHITECTURE` has the default sizes.

    Parameters
    ----------
    side, hidden, iterations, units, words, width, heads : int
        Side of the canvas, channels of the ConvNet, K, units of the LSTM, number and length of the
        memory's words, and number of read heads.
    reads_map : bool, default False
        Whether the controller reads O_g and V (MCGN-I) instead of R and V (MACN).
    """
    import torch
    from torch import nn
    from torch.nn import functional

    from .dnc import Record, build_computer
    from .value_iteration import build_planner

    class Macn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.planner = build_planner(hidden, iterations)
            self.computer = build_computer(
                2 * side * side, 4, units=units, words=words, width=width, heads=heads
            )
            self.without = "nothing"

        def read(self, observed: Observation) -> torch.Tensor:
            """Return the controller's input, shape (n, 2·side²)."""
            rows, columns = observed.current.shape[1:]
            up, left = (side - rows) // 2, (side - columns) // 2
            frame = (left, side - columns - left, up, side - rows - up)
            maps = functional.pad(observed.current, frame, value=float(BLOCKED))
            rewards, values, _ = self.planner(maps, observed.targets + torch.tensor([up, left]))
            other = maps if reads_map else rewards
            if self.without == "values":
                values = torch.zeros_like(values)
            return torch.cat([other.flatten(1), values.flatten(1)], dim=1)

        def decide(
            self, inputs: torch.Tensor, state: tuple[torch.Tensor, ...] | None
        ) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
            """Return the logits of one step, shape (n, 4), and the new state."""
            if state is None or self.without == "memory":
                record = self.computer.start(len(inputs))
            else:
                record = Record(*state)
            logits, record = self.computer(inputs, record)
            return logits, tuple(record)

        def forward(
            self, observed: Observation, state: tuple[torch.Tensor, ...] | None
        ) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
            return self.decide(self.read(observed), state)

    return Macn()


def _trainer(course: Course) -> Trainer:
    import torch

    torch.manual_seed(course.seed)
    return RunTrainer(course, "macn", build_network(**ARCHITECTURE), ARCHITECTURE)


TRAINING = Training(
    "macn", "MACN on the masked map, by imitation of A*", _trainer, epochs=120, minutes=240,
    options=EPISODES, dtype="float16",
)  # fmt: skip
