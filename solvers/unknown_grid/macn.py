"""The memory augmented control network (MACN): values of the view, features, and a differentiable memory.

Source: A. Khan, C. Zhang, N. Atanasov, K. Karydis, V. Kumar, D. D. Lee, "Memory Augmented Control Networks",
ICLR 2018, arXiv 1709.05706. It plans on what is seen now with value iteration, and a neural computer makes
a sequence of decisions of these plans. Sizes are those that the paper on unknown grids uses for its own
network: 30 iterations, an LSTM of 256 units, a memory of 32 words of 8 numbers, 4 read heads, 1 write head.

Our reading:

* The observation is the view in its own frame, with a ring of cells around it: unknown ones, or obstacles where
  they lie off the map. A second plane shows the goal: the target where it is in sight, and else the cell of the
  ring that lies nearest to it. Smaller views lie in the middle of a canvas for views of 11 × 11.
* The ConvNet has two layers of 3 × 3; the second gives the rewards and the features. Rewards begin as -1 a cell, 0
  at the goal and -30 at obstacles. A vehicle that has left a view that stands still is taken to the nearest cell of
  the ring.
* The computer is given the values of the actions at the vehicle's cell, features of the 5 × 5 cells around it, and how
  it moved since the last step; it is told neither the place on the map nor the distance of the target. Its four
  outputs are the decision, and nothing is added to them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trainer import Course, Trainer, Training
from .run_training import RUNS, RunTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "TRAINING", "build_network", "refuse_size"]

#: Rows and columns of the largest view, channels of the ConvNet, features of a cell, and what the computer reads.
ARCHITECTURE = {
    "side": 11, "channels": 12, "features": 4, "encoded": 32, "iterations": 30, "units": 256,
    "words": 32, "width": 8, "heads": 4,
}  # fmt: skip
#: Cells around the vehicle in each direction that are read.
_HALF = 2


def refuse_size(shape: tuple[int, int], view: tuple[int, int]) -> str:
    """Return why views of a size cannot be taken, else ``""``; maps may have any."""
    side = ARCHITECTURE["side"]
    if max(view) > side:
        return f"views must have at most {side} × {side} cells, got {view[0]} × {view[1]}"
    return ""


def build_network(
    side: int, channels: int, features: int, encoded: int, iterations: int, units: int, words: int,
    width: int, heads: int,
) -> torch.nn.Module:  # fmt: skip
    """Return the network with its first weights; the sizes are those of :data:`ARCHITECTURE`."""
    import torch
    from torch import nn
    from torch.nn import functional

    from .dnc import Record, build_computer
    from .value_iteration import (
        OBSTACLE,
        SLOWNESS,
        advantages,
        build_planner,
        crop,
        indicate,
        moved,
    )

    class Macn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.reading = nn.Conv2d(4, channels, 3, padding=1)
            self.meaning = nn.Conv2d(channels, 1 + features, 3, padding=1)
            self.reward = nn.Conv2d(4, 1, 1, bias=False)
            self.planning = build_planner(iterations)
            self.encoding = nn.Linear((2 + features) * (2 * _HALF + 1) ** 2, encoded)
            self.computer = build_computer(
                encoded + 7, 4, units=units, words=words, width=width, heads=heads
            )
            with torch.no_grad():
                self.reward.weight[0, :, 0, 0] = torch.tensor([-1.0, -1.0, -OBSTACLE, 0.0])

        def forward(
            self, observed: Observation, state: tuple[torch.Tensor, ...] | None
        ) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
            planes, places = _canvas(observed)
            meant = self.meaning(functional.relu(self.reading(planes)))
            worth, _ = self.planning(self.reward(planes) + SLOWNESS * meant[:, :1])
            here = advantages(worth, places).clamp(min=-4.0)
            around = crop(torch.cat([planes[:, [0, 2]], meant[:, 1:]], dim=1), places, _HALF)
            encoded = functional.relu(self.encoding(around.flatten(1)))
            told = torch.cat([encoded, here, moved(observed, state)], dim=1)
            record = self.computer.start(len(told)) if state is None else Record(*state[:-1])
            logits, record = self.computer(told, record)
            return logits, (*record, observed.positions.to(torch.float32))

    def _canvas(observed: Observation) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the planes of view, ring and frame, with the goal, and the vehicle's cell."""
        count, *shape = observed.current.shape
        size = torch.tensor(observed.view.shape[1:])
        across, down = [(side - int(one)) // 2 for one in size.flip(0)]
        spare = side - observed.view.shape[2] - across, side - observed.view.shape[1] - down
        cells = functional.pad(observed.view.clamp(max=1.0), (1, 1, 1, 1), value=-1.0)
        # What of the ring lies off the map is known: the vehicle knows where it is.
        for axis, limit in enumerate(shape):
            place = observed.corners[:, axis, None] - 1 + torch.arange(cells.shape[1 + axis])
            off = (place < 0) | (place >= limit)
            cells = torch.where(off[:, :, None] if axis == 0 else off[:, None], 1.0, cells)
        every = torch.arange(count)
        ends = [
            torch.minimum((one - observed.corners + 1).clamp(min=0), size + 1)
            for one in (observed.targets, observed.positions)
        ]
        cells = cells.index_put((every, *ends[1].T), torch.tensor(0.0))
        cells = cells.index_put((every, *ends[0].T), torch.tensor(2.0))
        frame = (across + 1, spare[0] + 1, down + 1, spare[1] + 1)
        planes = indicate(functional.pad(cells, frame, value=1.0))
        return planes, ends[1] + torch.tensor([down + 1, across + 1])

    return Macn()


def _trainer(course: Course) -> Trainer:
    """Return what trains the network."""
    import torch

    torch.manual_seed(course.seed)
    return RunTrainer(course, "macn", build_network(**ARCHITECTURE), ARCHITECTURE)


TRAINING = Training(
    "macn", "a neural computer on the values of the view, by imitation along whole runs", _trainer,
    epochs=24, minutes=20, options=RUNS, dtype="float16",
)  # fmt: skip
