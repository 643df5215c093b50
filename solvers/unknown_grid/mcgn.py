"""The paper's network (MCGN): values of the masked global map, attention, and a differentiable memory.

What is said of it: its input is the masked global matrix O_g (-1 unknown, 0 free, 1 obstacle, 2 target), and it
has a ConvNet, value iteration of 30 iterations, and a neural computer whose controller is an LSTM of
256 units, with a memory of 32 words of 8 numbers, 4 read heads and 1 write head. MCGN-I decides
before the target was seen, MCGN-II, which has attention, after.

The rest is our reading; the paper's Table I was not to be had:

* The matrix shows what the view shows now, and of what was seen before only cells that stopped a step: to
  remember is what the computer is for. The target, whose place is known, is always in it. The map lies on a
  canvas of 17 × 17 cells, and all around it are obstacles, so smaller maps fit as well.
* The ConvNet has two layers of 3 × 3: the first reads planes that say where each value is, the second
  gives the rewards and the features. Rewards begin as -1 a cell, 0 at the target and -30 at obstacles, so that the
  first values are minus the steps of the shortest way.
* MCGN-I: as long as the UAV flies above the vehicle, the vehicle is in the middle of the view, and a layer reads
  values, obstacles and unknown cells of the 9 × 9 around it. MCGN-II: the view stands still and
  the vehicle moves in it, so attention picks the values of the vehicle's cell and what is around it, with
  a layer of its own. Either gives 32 numbers to the computer.
* The computer is also given how the vehicle moved since the last step, where it is, and where the target is.
* Its four outputs are added to the values of the four actions at the vehicle's cell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trainer import Course, Trainer, Training
from .run_training import RUNS, RunTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["ARCHITECTURE", "TRAINING", "build_network", "refuse_size"]

#: Rows and columns of the canvas, channels of the ConvNet, features of the map, and what the computer reads.
ARCHITECTURE = {
    "side": 17, "channels": 12, "features": 4, "encoded": 32, "iterations": 30, "units": 256,
    "words": 32, "width": 8, "heads": 4,
}  # fmt: skip
#: Cells around the vehicle in each direction that are read.
_HALF = 4


def refuse_size(shape: tuple[int, int], view: tuple[int, int]) -> str:
    """Return why maps of a shape cannot be taken, else ``""``."""
    side = ARCHITECTURE["side"]
    if max(shape) > side:
        return f"maps must have at most {side} × {side} cells, got {shape[0]} × {shape[1]}"
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

    class Mcgn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.reading = nn.Conv2d(4, channels, 3, padding=1)
            self.meaning = nn.Conv2d(channels, 1 + features, 3, padding=1)
            self.reward = nn.Conv2d(4, 1, 1, bias=False)
            self.planning = build_planner(iterations)
            read = (3 + features) * (2 * _HALF + 1) ** 2
            self.before_seen = nn.Linear(read, encoded)
            self.after_seen = nn.Linear(read, encoded)
            self.computer = build_computer(
                encoded + 12, 4, units=units, words=words, width=width, heads=heads
            )
            self.sharpness = nn.Parameter(torch.tensor(2.0))
            with torch.no_grad():
                self.reward.weight[0, :, 0, 0] = torch.tensor([-1.0, -1.0, -OBSTACLE, 0.0])
                self.computer.output.weight *= 0.02

        def forward(
            self, observed: Observation, state: tuple[torch.Tensor, ...] | None
        ) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
            rows, columns = observed.current.shape[1:]
            frame = (1, side - columns + 1, 1, side - rows + 1)
            planes = indicate(functional.pad(observed.current, frame, value=1.0))
            meant = self.meaning(functional.relu(self.reading(planes)))
            worth, values = self.planning(self.reward(planes) + SLOWNESS * meant[:, :1])
            places = observed.positions + 1
            here = advantages(worth, places)
            around = crop(
                torch.cat([planes[:, [0, 2]], values, meant[:, 1:]], dim=1), places, _HALF
            )
            middle = around[:, 2, _HALF, _HALF, None, None]
            around[:, 2] = ((around[:, 2] - middle) / 4.0).clamp(-2.0, 2.0)
            around = around.flatten(1)
            seen = observed.seen[:, None]
            encoded = torch.where(seen, self.after_seen(around), self.before_seen(around))
            size = torch.tensor([rows, columns], dtype=torch.float32)
            told = torch.cat(
                [
                    functional.relu(encoded), here.clamp(min=-4.0), moved(observed, state),
                    observed.positions / size, (observed.targets - observed.positions) / size,
                    seen.to(torch.float32),
                ], dim=1,
            )  # fmt: skip
            record = self.computer.start(len(told)) if state is None else Record(*state[:-1])
            out, record = self.computer(told, record)
            logits = out + self.sharpness * here.clamp(min=-8.0)
            return logits, (*record, observed.positions.to(torch.float32))

    return Mcgn()


def _trainer(course: Course) -> Trainer:
    """Return what trains the network."""
    import torch

    torch.manual_seed(course.seed)
    return RunTrainer(course, "mcgn", build_network(**ARCHITECTURE), ARCHITECTURE)


TRAINING = Training(
    "mcgn", "the paper's network, by imitation along whole runs", _trainer, epochs=24, minutes=20,
    options=RUNS, dtype="float16",
)  # fmt: skip
