"""MACN: value iteration and a differentiable memory, and MCGN, the paper's Motion Command Generation Network.

A ConvNet and 30 iterations plan on the masked map O_g. The controller of a neural computer reads two maps, and
its output is linear in output vector and read vectors. MACN reads R and V. MCGN-I is the same network, but reads O_g
and V. MCGN applies MCGN-I until the target is in the view, then MCGN-II, the network of :mod:`~.value_iteration` on the
partial map O_p. As in the paper, both parts are trained separately and used in parallel.

Source: A. Khan, C. Zhang, N. Atanasov, K. Karydis, V. Kumar, D. D. Lee, "Memory Augmented Control Networks",
ICLR 2018, arXiv 1709.05706. The paper on unknown grids names MACN as its baseline without describing it. Its Table II
repeats the names and most values of the settings of a public implementation (github.com/didibear/macn-gym-pathfinding).
The controller reads R and V as in that implementation.

Maps of fewer than 17 × 17 cells are centred on a canvas of that size and surrounded by obstacles, because the
controller has one input per cell.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from ...models.unknown_grid.world import BLOCKED
from . import value_iteration

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "First", "build_network", "combine"]

#: Side of the canvas in cells, and the sizes of Table II.
ARCHITECTURE: dict[str, Any] = {
    "side": 17, "hidden": 150, "iterations": 30, "units": 256, "words": 32, "width": 8, "heads": 4,
}  # fmt: skip


def build_network(
    side: int, hidden: int, iterations: int, units: int, words: int, width: int, heads: int,
    *, reads_map: bool = False,
) -> torch.nn.Module:  # fmt: skip
    """Return the network with its initial weights. :data:`ARCHITECTURE` has the default sizes.

    The controller reads R and V (MACN) or, if `reads_map`, O_g and V (MCGN-I).
    """
    import torch
    from torch import nn
    from torch.nn import functional

    from .dnc import Record, build_computer

    class Macn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.planner = value_iteration.build_planner(hidden, iterations)
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
            down, across = observed.targets.T
            targets = torch.stack([down + up, across + left], dim=1)
            rewards, values, _ = self.planner(maps, targets)
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


class First:
    """MCGN-I."""

    ARCHITECTURE = ARCHITECTURE
    build_network = staticmethod(partial(build_network, reads_map=True))


def combine(first: torch.nn.Module, second: torch.nn.Module) -> torch.nn.Module:
    """Return the network that uses MCGN-I until the target was seen, and MCGN-II afterwards."""
    import torch
    from torch import nn

    class Mcgn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.first, self.second = first, second

        def forward(self, observed: Observation, state: Any) -> tuple[torch.Tensor, Any]:
            before, state = self.first(observed, state)
            after, _ = self.second(observed.in_view(), None)
            return torch.where(observed.seen[:, None], after, before), state

    return Mcgn().eval()
