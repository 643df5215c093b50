"""Learned policies: a network computes a logit per action, and the policy takes the best action.

See :mod:`~.networks` for the interface of a network.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import Looks
from ..contract.backend import Answer, Request
from ..contract.option import Option
from ..learning.trainer import one_thread
from . import macn
from .imitation import Recurrence, choose_actions
from .memory import Memory
from .native import PERCEPTION, NavigationBackend
from .networks import load_network
from .training_laws import outside_law, statement

if TYPE_CHECKING:
    import torch

__all__ = ["LearnedPolicy", "Macn", "Mcgn", "SmallVin", "Vin"]

Ints = NDArray[np.int64]

#: Largest number of cells of a map. An iteration sweeps over all cells, and a path may visit half of them.
LARGEST = 256 * 256
_FILE = Option(
    None, "a file of weights from 'crosstrack train'; those that are shipped", str, file=True
)
_WITHOUT = Option(
    "nothing",
    "part of the network that is left out: values (V is 0 for the controller) or memory (emptied before each step)",
    str,
    ("nothing", "values", "memory"),
)


class LearnedPolicy:
    """Policy of consecutive scenes that evaluates a network on their masked maps."""

    def __init__(
        self, problem: UnknownGridNavigation, scenes: Ints, network: torch.nn.Module
    ) -> None:
        self.network, self.law = Recurrence(network), str(getattr(network, "law", ""))
        self.first = int(scenes[0])
        self.memory = Memory(problem.shape, problem.view, problem.targets[scenes])
        #: Number of decisions with a non-finite logit.
        self.faults = 0

    def decide(self, looks: Looks) -> Ints:
        """Return the best action in each scene."""
        rows = looks.scenes - self.first
        observed = self.memory.look(rows, looks.positions, looks.corners, looks.view)
        logits = self.network(observed.tensors(), rows)
        actions, wrong = choose_actions(logits.numpy())
        self.faults += int((wrong > 0).sum())
        self.memory.act(rows, actions)
        return actions

    def seen(self) -> NDArray[np.int8]:
        """Return the cells seen so far, shape (n, rows, columns), see :class:`~.memory.Observation`."""
        return self.memory.known(np.arange(len(self.memory.targets)))


class _Learned(NavigationBackend):
    """Base of the learned policies."""

    requires = ("torch",)
    extra = "learn"
    options = {**PERCEPTION, "weights": _FILE}
    together = 256

    _policies: list[LearnedPolicy]

    def refuses(self, problem: UnknownGridNavigation) -> str:
        rows, columns = problem.shape.tolist()
        if rows * columns > LARGEST:
            return f"maps of {rows} × {columns} cells, only of at most {LARGEST} cells"
        return super().refuses(problem)

    def policy(
        self, problem: UnknownGridNavigation, scenes: Ints, request: Request
    ) -> LearnedPolicy:
        self._policies.append(LearnedPolicy(problem, scenes, self.network(request.options)))
        return self._policies[-1]

    def network(self, options: Mapping[str, Any]) -> torch.nn.Module:
        """Return the network with the weights that `options` selects."""
        return load_network(self.name, options["weights"])

    def run(self, problem: UnknownGridNavigation, request: Request) -> Answer:
        """Run the policy, and count decisions with non-finite logits and scenes outside the law of the training."""
        import torch

        self.require_support(problem)
        running = copy.copy(self)  # concurrent runs must not share policies
        running._policies = []
        with one_thread(), torch.inference_mode():
            answer = super(_Learned, running).run(problem, request)
        policies = running._policies
        if not policies:
            return answer
        statistics, message = dict(answer.statistics), answer.message
        if faults := sum(policy.faults for policy in policies):
            statistics["decisions not finite"] = faults
        law = policies[0].law
        outside, reason = outside_law(problem, law, (policy.seen() for policy in policies))
        if outside is not None:
            count = statistics["scenes outside the law"] = int(outside.sum())
            shipped = not any(request.options[name] for name in self.options if "weights" in name)
            text = statement(count, problem.scenes, law, reason, self.name if shipped else "")
            message = "; ".join(filter(None, (message, text)))
        return replace(answer, statistics=statistics, message=message)


class SmallVin(_Learned):
    """Value iteration on the remembered map with learned costs of cells."""

    name = "small-vin"
    summary = "a small value iteration network on the remembered map, begun as value iteration"


class Vin(_Learned):
    """The paper's value iteration network without memory, applied in every step."""

    name = "vin"
    summary = "the paper's value iteration network on the masked map of the current view"


class Macn(_Learned):
    """MACN: a value iteration network and a differentiable memory."""

    name = "macn"
    summary = "memory augmented control network of Khan et al. (2018) on the masked map"
    options = {**_Learned.options, "without": _WITHOUT}

    def refuses(self, problem: UnknownGridNavigation) -> str:
        """Return the reason to refuse maps that are larger than the canvas, or ``""``."""
        side, (rows, columns) = macn.ARCHITECTURE["side"], problem.shape.tolist()
        if max(rows, columns) > side:
            return f"maps of {rows} × {columns} cells, only of at most {side} × {side} cells"
        return super().refuses(problem)

    def network(self, options: Mapping[str, Any]) -> torch.nn.Module:
        network = super().network(options)
        network.without = options["without"]
        return network


class Mcgn(Macn):
    """The paper's network: MCGN-I until the target is in the view, then MCGN-II."""

    name = "mcgn"
    summary = "the paper's network: MCGN-I until the target is in the view, then MCGN-II"
    options = {**Macn.options, "weights_2": _FILE}

    def network(self, options: Mapping[str, Any]) -> torch.nn.Module:
        first = load_network("mcgn-1", options["weights"])
        first.without = options["without"]
        network = macn.combine(first, load_network("mcgn-2", options["weights_2"]))
        network.law = first.law
        return network
