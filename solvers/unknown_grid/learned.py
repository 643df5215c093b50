"""Learned policies: a network says what each action is worth, and the best one is taken.

See :mod:`~.networks` for what a network is.
"""

from __future__ import annotations

import copy
import importlib
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import Looks
from ..backend import Answer, Request
from ..option import Option
from ..trainer import one_thread
from .imitation import choose_actions
from .memory import Memory
from .native import PERCEPTION, NavigationBackend
from .networks import load_network

if TYPE_CHECKING:
    import torch

__all__ = ["LearnedPolicy", "Macn", "Mcgn", "SmallVin", "Vin"]

Ints = NDArray[np.int64]
State = tuple[Any, ...] | None

_WEIGHTS: Mapping[str, Option] = {
    "weights": Option(
        None, "a file of weights from 'crosstrack train'; those that are shipped", str, file=True
    )
}


class LearnedPolicy:
    """A network that is asked step by step in some scenes, with the masked map of each.

    Parameters
    ----------
    problem : UnknownGridNavigation
        Blinded.
    scenes : ndarray of int
        The scenes, in a row.
    network : torch.nn.Module
        With its weights.
    """

    def __init__(
        self, problem: UnknownGridNavigation, scenes: Ints, network: torch.nn.Module
    ) -> None:
        self.network = network
        self.first = int(scenes[0])
        self.memory = Memory(problem.shape, problem.view, problem.targets[scenes])
        #: Decisions with a logit that was not finite.
        self.faults = 0
        self._state: State = None
        self._rows = scenes - self.first

    def decide(self, looks: Looks) -> Ints:
        """Return the best action in each scene."""
        rows = looks.scenes - self.first
        observed = self.memory.look(rows, looks.positions, looks.corners, looks.view)
        state = self._state
        if state is not None:  # of the scenes that have not ended since
            kept = np.searchsorted(self._rows, rows)
            state = tuple(one[kept] for one in state)
        logits, self._state = self.network(observed.tensors(), state)
        self._rows = rows
        actions, wrong = choose_actions(logits.numpy())
        self.faults += int((wrong > 0).sum())
        self.memory.act(rows, actions)
        return actions


class _Learned(NavigationBackend):
    """Base of the learned policies; a subclass says which module holds its network."""

    requires = ("torch",)
    extra = "learn"
    options = {**PERCEPTION, **_WEIGHTS}
    together = 256
    module: ClassVar[str]

    _policies: list[LearnedPolicy]

    def refuses(self, problem: Any) -> str:
        shape, view = tuple(problem.shape.tolist()), tuple(problem.view.tolist())
        return str(self._load().refuse_size(shape, view))

    def policy(
        self, problem: UnknownGridNavigation, scenes: Ints, request: Request
    ) -> LearnedPolicy:
        network = load_network(self.name, self._load(), request.options["weights"])
        self._policies.append(LearnedPolicy(problem, scenes, network))
        return self._policies[-1]

    def run(self, problem: UnknownGridNavigation, request: Request) -> Answer:
        """Lead the vehicles; decisions that the weights left open are counted."""
        import torch

        if reason := self.refuses(problem):
            raise UnsupportedFormulation(f"backend {self.name!r}: {reason}")
        running = copy.copy(self)  # runs in other threads have policies of their own
        running._policies = []
        with one_thread(), torch.inference_mode():
            answer = super(_Learned, running).run(problem, request)
        faults = sum(one.faults for one in running._policies)
        if not faults:
            return answer
        return replace(answer, statistics={**answer.statistics, "decisions not finite": faults})

    def _load(self) -> Any:
        return importlib.import_module(f".{self.module}", __package__)


class SmallVin(_Learned):
    """Value iteration on the remembered map, whose costs and moves are learned."""

    name = "small-vin"
    module = "small_vin"
    summary = (
        "a small value iteration network on the remembered map, begun as value iteration itself"
    )


class Vin(_Learned):
    """A value iteration network that sees the current view alone."""

    name = "vin"
    module = "vin"
    summary = "value iteration network of Tamar et al. (2016) on the current view, 30 iterations"


class Macn(_Learned):
    """Values of the current view, and a differentiable memory."""

    name = "macn"
    module = "macn"
    summary = "memory augmented control network of Khan et al. (2018): a VIN and a neural computer"


class Mcgn(_Learned):
    """The paper's network: values of the masked map, attention, and a differentiable memory."""

    name = "mcgn"
    module = "mcgn"
    summary = (
        "the paper's network on the masked global map, with attention once the target was seen"
    )
