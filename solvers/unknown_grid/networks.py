"""Networks and their weights.

A network is a module of this package with the following names:

``ARCHITECTURE``
    Default sizes as a mapping of names to integers.
``build_network(**architecture)``
    Function that returns the ``torch.nn.Module``. It imports PyTorch. The caller sets
    ``torch.manual_seed`` before.
``forward(observed, state)`` of the module
    `observed` is an :class:`~.memory.Observation` of tensors for n scenes. `state` is None at the first
    step, and the state of the previous step afterwards: a tuple of tensors whose first axis is the
    scenes, or None for networks without memory. It returns logits, shape (n, 4), and the new state.
``refuse_size(shape, view)``
    Function that returns the reason to refuse maps or views of a size, or ``""``. It is cheap and does
    not import PyTorch.
``TRAINING``
    Training that ``crosstrack train`` runs.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InvalidData
from ..learning.gradient import fill
from ..learning.weights import read_weights

if TYPE_CHECKING:
    import torch

__all__ = ["load_network", "shipped_weights"]


def shipped_weights(name: str) -> Path:
    """Return the path of the shipped weights of a network.

    Parameters
    ----------
    name : str
        Kind of the weights, such as "macn".
    """
    return Path(__file__).parent / "weights" / f"{name}.npz"


def load_network(name: str, module: Any, path: str | Path | None = None) -> torch.nn.Module:
    """Return a network with the weights of a file, in evaluation mode.

    Parameters
    ----------
    name : str
        Kind of the weights.
    module : module
        Network, with the interface in the docstring of this module.
    path : path-like, optional
        File of weights, by default the shipped weights.

    Raises
    ------
    InvalidData
        The file does not fit the network. The message names the file and the error.
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
