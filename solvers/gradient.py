"""Learning by gradients: what every trainer of a PyTorch network shares."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData
from .trainer import Course, Trainer
from .weights import Weights

if TYPE_CHECKING:
    import torch

__all__ = ["GradientTrainer", "arrays_of", "fill"]


def arrays_of(network: torch.nn.Module) -> dict[str, NDArray[Any]]:
    """Return the parameters and buffers of a network by name; whole numbers, which only count, are left out."""
    held = network.state_dict().items()
    return {name: one.detach().numpy().copy() for name, one in held if one.is_floating_point()}


def fill(network: torch.nn.Module, weights: Weights) -> None:
    """Give a network weights, after a check of their names, shapes and types."""
    import torch

    found = weights.fit({name: one.shape for name, one in arrays_of(network).items()})
    network.load_state_dict(
        {name: torch.from_numpy(one) for name, one in found.items()}, strict=False
    )


class GradientTrainer(Trainer):
    """Adam, with a rate that falls as half a cosine; a subclass draws batches and gives their loss.

    Parameters
    ----------
    course : Course
        What is asked for.
    kind : str
        The name of the network's weights.
    network : torch.nn.Module
        Built with its first weights, which follow from the course's seed: build it after
        ``torch.manual_seed``. All of its parameters are float32.
    architecture : mapping of str to int
        What it was built with.
    batches : int
        Steps of an epoch.
    rate : float
        The first rate.
    clip : float
        The norm to which a gradient is cut.
    """

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int],
        *, batches: int, rate: float, clip: float = 1.0,
    ) -> None:  # fmt: skip
        import torch

        self.course, self.kind, self.network = course, kind, network
        self.architecture, self.batches, self.rate, self.clip = architecture, batches, rate, clip
        self.optimiser = torch.optim.Adam(network.parameters(), lr=rate)

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        """Do what an epoch begins with, such as to draw its examples; nothing of it may last longer."""

    @abstractmethod
    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Return the mean loss of a batch, 0 and so on within the epoch."""

    @abstractmethod
    def judge(self) -> Mapping[str, float]:
        """Return figures of the network as it is, among them ``"score"``, the higher the better."""

    def run_epoch(self, number: int, tick: Callable[[], None]) -> Mapping[str, float]:
        """Learn from an epoch's batches; a batch whose gradient is not finite is left out."""
        import torch

        generator = np.random.default_rng([self.course.seed, number])
        torch.manual_seed(int(generator.integers(2**63)))
        self.prepare(number, generator)
        losses, skipped = [], 0
        for batch in range(self.batches):
            tick()
            done = (number + batch / self.batches) / self.course.epochs
            for group in self.optimiser.param_groups:
                group["lr"] = self.rate * (0.02 + 0.98 * (1.0 + math.cos(math.pi * done)) / 2.0)
            self.network.train()
            self.optimiser.zero_grad()
            loss = self.loss(batch, generator)
            loss.backward()
            norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.clip)
            if not bool(torch.isfinite(norm)):
                skipped += 1
                continue
            self.optimiser.step()
            losses.append(float(loss.detach()))
        self.network.eval()
        with torch.inference_mode():
            judged = self.judge()
        mean = float(np.mean(losses)) if losses else math.nan
        return {"loss": mean, **judged, **({"batches left out": skipped} if skipped else {})}

    def weights(self) -> Weights:
        return Weights(self.kind, arrays_of(self.network), dict(self.architecture))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return parameters and buffers, and what Adam remembers of each parameter."""
        found = {f"network.{name}": one for name, one in arrays_of(self.network).items()}
        for number, held in self.optimiser.state_dict()["state"].items():
            for name, one in held.items():
                found[f"adam.{number}.{name}"] = one.numpy().copy()
        return found

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        import torch

        network = {
            name.removeprefix("network."): one
            for name, one in state.items()
            if name.startswith("network.")
        }
        fill(self.network, Weights(self.kind, network))
        parameters = list(self.network.parameters())
        adam: dict[int, dict[str, torch.Tensor]] = {}
        for name, one in state.items():
            part, _, rest = name.partition(".")
            number, _, what = rest.partition(".")
            if part != "adam":
                continue
            known = number.isdecimal() and int(number) < len(parameters)
            wanted = tuple(parameters[int(number)].shape) if known and what != "step" else ()
            if not known or what not in ("step", "exp_avg", "exp_avg_sq") or one.shape != wanted:
                raise InvalidData(
                    f"checkpoint of {self.kind}: {name} fits no parameter", field=name
                )
            adam.setdefault(int(number), {})[what] = torch.from_numpy(np.array(one, np.float32))
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": adam, "param_groups": groups})
