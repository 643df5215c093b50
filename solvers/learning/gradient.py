"""Gradient-based training: base class of the trainers of PyTorch networks."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from .trainer import Course, Trainer
from .weights import Weights

if TYPE_CHECKING:
    import torch

__all__ = ["GradientTrainer", "GraphReplay", "arrays_of", "epoch_generator", "fill", "find_device"]

#: Largest norm of a gradient; longer ones are scaled down.
_LONGEST = 1.0


def arrays_of(network: torch.nn.Module) -> dict[str, NDArray[Any]]:
    """Return copies of the parameters and buffers of a network, by name.

    Integer buffers are omitted, because they only count.

    Parameters
    ----------
    network : torch.nn.Module
        The network.
    """
    entries = network.state_dict().items()
    return {
        name: tensor.detach().cpu().numpy().copy()
        for name, tensor in entries
        if tensor.is_floating_point()
    }


def fill(network: torch.nn.Module, weights: Weights) -> None:
    """Load weights into a network after checking their names, shapes and types.

    Parameters
    ----------
    network : torch.nn.Module
        The network, changed in place.
    weights : Weights
        The weights.

    Raises
    ------
    InvalidData
        The weights do not fit the network.
    """
    import torch

    arrays = weights.fit({name: array.shape for name, array in arrays_of(network).items()})
    network.load_state_dict(
        {name: torch.from_numpy(array) for name, array in arrays.items()}, strict=False
    )


def find_device(name: str) -> torch.device:
    """Return the PyTorch device "cpu" or "gpu".

    Raises
    ------
    UnsupportedOption
        The name is "gpu", and PyTorch has no CUDA device.
    """
    import torch

    if name == "gpu" and not torch.cuda.is_available():
        raise UnsupportedOption(
            "option device='gpu' needs a CUDA device, and torch finds none: use 'cpu'"
        )
    return torch.device("cuda" if name == "gpu" else "cpu")


def epoch_generator(seed: int, number: int) -> tuple[np.random.Generator, int]:
    """Return the generator of an epoch of a course with a seed, and the seed of PyTorch in this epoch."""
    generator = np.random.default_rng([seed, number])
    return generator, int(generator.integers(2**63))


class GraphReplay:
    """Function of arrays that a CUDA device replays: one graph is captured per combination of shapes.

    The graph of an unrolled network has thousands of short kernels, and its replay starts them without Python.

    Parameters
    ----------
    function : callable
        Function of tensors that returns a tensor. It must neither read a value back to the processor nor depend on
        anything but its arguments and tensors that stay at their addresses.
    device : torch.device
        Device of the tensors. On the processor the function is called directly.
    """

    def __init__(self, function: Callable[..., torch.Tensor], device: torch.device) -> None:
        self._function, self._device = function, device
        self._pool: Any = None
        self._stream: Any = None
        self._graphs: dict[Any, tuple[torch.cuda.CUDAGraph, list[torch.Tensor], torch.Tensor]] = {}

    def __call__(self, *arrays: NDArray[Any]) -> torch.Tensor:
        """Return the function's value."""
        import torch

        tensors = [torch.from_numpy(array) for array in arrays]
        if self._device.type == "cpu":
            return self._function(*tensors)
        key = tuple(array.shape for array in arrays)
        if key not in self._graphs:
            self._graphs[key] = self._capture(tensors)
        graph, inputs, output = self._graphs[key]
        for place, tensor in zip(inputs, tensors, strict=True):
            place.copy_(tensor)
        graph.replay()
        return output.clone()

    def _capture(self, tensors: list[torch.Tensor]) -> Any:
        import torch

        inputs = [tensor.to(self._device) for tensor in tensors]
        # One graph runs at a time, so all share their memory, which belongs to a stream.
        if self._pool is None:
            self._pool, self._stream = torch.cuda.graph_pool_handle(), torch.cuda.Stream()
        stream = self._stream
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(2):  # libraries allocate their workspaces in the first calls
                self._function(*inputs)
        torch.cuda.current_stream().wait_stream(stream)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, self._pool, stream, "thread_local"):
            output = self._function(*inputs)
        return graph, inputs, output


class GradientTrainer(Trainer):
    """Trainer with Adam and a cosine learning rate; a subclass draws batches and computes the loss.

    Parameters
    ----------
    course : Course
        Settings of the training. Its options contain ``batches``, the steps per epoch, and ``rate``, the
        initial learning rate, which decreases along half a cosine to 2 % of this value. The option ``device``
        is "cpu" (the default) or "gpu", see :func:`find_device`.
    kind : str
        Name of the network's kind of weights.
    network : torch.nn.Module
        Network with its initial weights. Build it after ``torch.manual_seed`` with the course's
        seed. All parameters must be float32.
    architecture : mapping of str to int
        Sizes from which the network was built.
    """

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int]
    ) -> None:
        import torch

        self.course, self.kind = course, kind
        self.device = find_device(course.options.get("device", "cpu"))
        self.network, self.architecture = network.to(self.device), architecture
        self.batches, self.rate = course.options["batches"], course.options["rate"]
        self.optimiser = torch.optim.Adam(network.parameters(), lr=self.rate)

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        """Prepare an epoch, for example by drawing its examples. Longer work belongs to `loss`."""

    @abstractmethod
    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Return the mean loss of a batch; batches are numbered from 0 within the epoch."""

    @abstractmethod
    def judge(self) -> Mapping[str, float]:
        """Return measures of the current network, including ``"score"`` (higher is better)."""

    def gradient(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Replace the gradients of the parameters by those of the loss of a batch, and return the loss."""
        self.optimiser.zero_grad()
        loss = self.loss(batch, generator)
        loss.backward()
        return loss

    def run_epoch(self, number: int, tick: Callable[[], None]) -> Mapping[str, float]:
        """Train on the batches of an epoch. Batches with a gradient that is not finite are skipped."""
        import torch

        generator, seed = epoch_generator(self.course.seed, number)
        torch.manual_seed(seed)
        self.prepare(number, generator)
        losses, skipped = [], 0
        for batch in range(self.batches):
            tick()
            done = (number + batch / self.batches) / self.course.epochs
            for group in self.optimiser.param_groups:
                group["lr"] = self.rate * (0.02 + 0.98 * (1.0 + math.cos(math.pi * done)) / 2.0)
            self.network.train()
            loss = self.gradient(batch, generator)
            norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), _LONGEST)
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
        """Return the parameters and buffers, and the state of Adam for each parameter."""
        arrays = {f"network.{name}": tensor for name, tensor in arrays_of(self.network).items()}
        for number, values in self.optimiser.state_dict()["state"].items():
            for name, tensor in values.items():
                arrays[f"adam.{number}.{name}"] = tensor.cpu().numpy().copy()
        return arrays

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        import torch

        shapes = {f"network.{name}": array.shape for name, array in arrays_of(self.network).items()}
        for number, parameter in enumerate(self.network.parameters()):
            size = tuple(parameter.shape)
            adam = {f"adam.{number}.{name}": size for name in ("exp_avg", "exp_avg_sq")}
            # Adam has no state of a parameter that no epoch has trained.
            if not adam.keys().isdisjoint(state):
                shapes |= {**adam, f"adam.{number}.step": ()}
        arrays = Weights(self.kind, state).fit(shapes)
        parts: dict[str, dict[str, torch.Tensor]] = {"network": {}}
        for name, array in arrays.items():
            part, _, rest = name.partition(".")
            if part == "adam":
                part, _, rest = rest.partition(".")
            parts.setdefault(part, {})[rest] = torch.from_numpy(array).reshape(shapes[name])
        self.network.load_state_dict(parts.pop("network"), strict=False)
        groups = self.optimiser.state_dict()["param_groups"]
        moments = {int(number): values for number, values in parts.items()}
        self.optimiser.load_state_dict({"state": moments, "param_groups": groups})
