"""Networks with their weights.

A network is a module of this folder that holds

``ARCHITECTURE``
    The sizes that it is built with by default, names and whole numbers.
``build_network(**architecture)``
    Returns the ``torch.nn.Module``, built after ``torch.manual_seed``. PyTorch is imported there.
``forward(observed, state)`` of it
    `observed` is an :class:`~.memory.Observation` of tensors for n scenes. `state` is None at the first
    step, and then what the step before returned for these scenes: a tuple of tensors whose first
    axis is the scenes, or None for networks that remember nothing. It returns logits, shape (n, 4), and
    the new state.
``refuse_size(shape, view)``
    Why maps or views of a size cannot be taken, else ``""``; cheap, without PyTorch.
``TRAINING``
    What ``crosstrack train`` runs.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InvalidData
from ..gradient import fill
from ..weights import read_weights

if TYPE_CHECKING:
    import torch

__all__ = ["load_network", "shipped_weights"]


def shipped_weights(name: str) -> Path:
    """Return the file of weights that is shipped for a network."""
    return Path(__file__).parent / "weights" / f"{name}.npz"


def load_network(name: str, module: Any, path: str | Path | None = None) -> torch.nn.Module:
    """Return a network with the weights in a file, ready to be asked.

    Parameters
    ----------
    name : str
        The kind of the weights.
    module : module
        As the docstring above says.
    path : path-like, optional
        By default the weights that are shipped.

    Raises
    ------
    InvalidData
        Naming the file, and what of it is wrong.
    """
    file = shipped_weights(name) if path is None else path
    weights = read_weights(file, name)
    if set(weights.architecture) != set(module.ARCHITECTURE):
        raise InvalidData(
            f"{file}: architecture must name {', '.join(sorted(module.ARCHITECTURE)) or 'nothing'}, got "
            f"{', '.join(sorted(weights.architecture)) or 'nothing'}"
        )
    network: torch.nn.Module = module.build_network(**weights.architecture)
    fill(network, weights)
    return network.eval()
