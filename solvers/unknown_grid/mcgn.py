"""The paper's Motion Command Generation Network: MCGN-I until the target is in the view, then MCGN-II.

MCGN-I is the network of :mod:`~.macn` whose controller reads O_g and V. MCGN-II is the network of
:mod:`~.vin` on the partial map O_p. As in the paper, they are trained separately and used in parallel.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from ..learning.trainer import Course, Trainer, Training
from . import macn, vin
from .episodes import EPISODES, DecisionTrainer, RunTrainer

if TYPE_CHECKING:
    import torch

    from .memory import Observation

__all__ = ["TRAINING_1", "TRAINING_2", "First", "Second", "combine", "refuse_size"]

refuse_size = macn.refuse_size


class First:
    """MCGN-I."""

    ARCHITECTURE = macn.ARCHITECTURE
    build_network = staticmethod(partial(macn.build_network, reads_map=True))


class Second:
    """MCGN-II."""

    ARCHITECTURE = vin.ARCHITECTURE
    build_network = staticmethod(vin.build_network)


def combine(first: torch.nn.Module, second: torch.nn.Module) -> torch.nn.Module:
    """Return the network that uses `first` until the target was seen, and `second` afterwards.

    Parameters
    ----------
    first, second : torch.nn.Module
        MCGN-I and MCGN-II with their weights.
    """
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


def _train_first(course: Course) -> Trainer:
    import torch

    torch.manual_seed(course.seed)
    network = First.build_network(**First.ARCHITECTURE)
    return RunTrainer(course, "mcgn-1", network, First.ARCHITECTURE, part=1)


def _train_second(course: Course) -> Trainer:
    import torch

    torch.manual_seed(course.seed)
    network = Second.build_network(**Second.ARCHITECTURE)
    return DecisionTrainer(course, "mcgn-2", network, Second.ARCHITECTURE, part=2)


TRAINING_1 = Training(
    "mcgn-1", "MCGN-I, before the target is in the view, by imitation of A*", _train_first,
    epochs=120, minutes=120, options=EPISODES, dtype="float16",
    use="--backend mcgn --option weights={path}",
)  # fmt: skip
TRAINING_2 = Training(
    "mcgn-2", "MCGN-II, once the target is in the view, by imitation of A*", _train_second,
    epochs=120, minutes=30, options=EPISODES, use="--backend mcgn --option weights_2={path}",
)  # fmt: skip
