"""Kinds of networks, their weights and their trainings.

A network is a module or class with the following names:

``ARCHITECTURE``
    Default sizes as a mapping of names to integers.
``build_network(**architecture)``
    Function that returns the ``torch.nn.Module``. It imports PyTorch. The caller sets
    ``torch.manual_seed`` before.
``forward(observed, state)`` of the module
    `observed` is an :class:`~.memory.Observation` of tensors for n scenes. `state` is None at the first
    step, and the state of the previous step afterwards: a tuple of tensors whose first axis is the
    scenes, or None for networks without memory. It returns logits, shape (n, 4), and the new state.
    (The network ``gmgn`` reads images instead.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import BackendMissing, InvalidData
from ..contract.option import Option
from ..learning.gradient import fill
from ..learning.trainer import Course, Trainer, Training
from ..learning.weights import read_weights
from . import gmgn, macn, small_vin, value_iteration
from .episodes import EPISODES, IMITATION, ImitationTrainer

if TYPE_CHECKING:
    import torch

__all__ = ["NETWORKS", "load_network", "shipped_weights"]

#: Networks by the kind of their weights.
NETWORKS: dict[str, Any] = {
    "small-vin": small_vin,
    "vin": value_iteration,
    "macn": macn,
    "mcgn-1": macn.First,
    "mcgn-2": value_iteration,
    "gmgn": gmgn,
}


def shipped_weights(kind: str) -> Path:
    """Return the path of the shipped weights of a network in :data:`NETWORKS`.

    They are in this folder of a checkout, otherwise in the package ``crosstrack_weights``. If neither exists,
    raise :class:`BackendMissing`.
    """
    folder = Path(__file__).parent / "weights"
    if not folder.is_dir():
        spec = find_spec("crosstrack_weights")
        if spec is None or not spec.submodule_search_locations:
            raise BackendMissing(
                f"the weights of {kind} are not installed: pip install 'crosstrack[learn]', or pass weights "
                "from 'crosstrack train' as an option"
            )
        folder = Path(spec.submodule_search_locations[0])
    return folder / f"{kind}.npz"


def load_network(kind: str, path: str | Path | None = None) -> torch.nn.Module:
    """Return a network of a kind in :data:`NETWORKS` with the weights of a file, in evaluation mode.

    The shipped weights are the default. The attribute ``law`` is the law of the training scenes, or ``""`` if the
    file does not contain it. Raise :class:`InvalidData` with the name of the file if it does not fit the network.
    """
    file = shipped_weights(kind) if path is None else path
    weights, module = read_weights(file, kind), NETWORKS[kind]
    if set(weights.architecture) != set(module.ARCHITECTURE):
        raise InvalidData(
            f"{file}: architecture must name {', '.join(sorted(module.ARCHITECTURE)) or 'nothing'}, got "
            f"{', '.join(sorted(weights.architecture)) or 'nothing'}"
        )
    network: torch.nn.Module = module.build_network(**weights.architecture)
    fill(network, weights)
    network.law = weights.made.get("law", "")
    return network.eval()


def _training(
    kind: str, summary: str, trainer: Callable[..., Trainer] = ImitationTrainer, *,
    epochs: int = 120, options: Mapping[str, Option] = EPISODES, dtype: str = "float32",
    minutes: float, use: str = Training.use, **how: Any,
) -> Training:  # fmt: skip
    """Return the training of a kind of networks whose initial weights follow from the course's seed.

    `how` contains further arguments of `trainer`.
    """

    def run(course: Course) -> Trainer:
        import torch

        torch.manual_seed(course.seed)
        sizes = NETWORKS[kind].ARCHITECTURE
        return trainer(course, kind, NETWORKS[kind].build_network(**sizes), sizes, **how)

    return Training(
        kind, summary, run, epochs=epochs, minutes=minutes, options=options, dtype=dtype, use=use
    )


SMALL_VIN = _training(
    "small-vin", "value iteration on the remembered map with learned costs, by imitation of the shortest way",
    epochs=12, minutes=3, options=IMITATION, mixed=True,
)  # fmt: skip
VIN = _training(
    "vin", "the paper's value iteration network on the masked map, by imitation of A*", minutes=60
)
MACN = _training(
    "macn",
    "MACN on the masked map, by imitation of A*",
    minutes=240,
    dtype="float16",
    recurrent=True,
)
MCGN_1 = _training(
    "mcgn-1", "MCGN-I, before the target is in the view, by imitation of A*",
    minutes=120, dtype="float16", use="--backend mcgn --option weights={path}", part=1, recurrent=True,
)  # fmt: skip
MCGN_2 = _training(
    "mcgn-2", "MCGN-II, once the target is in the view, by imitation of A*",
    minutes=30, use="--backend mcgn --option weights_2={path}", part=2,
)  # fmt: skip
GMGN = _training(
    "gmgn", "cells of a view from its image, by drawn images of scenes",
    gmgn.GmgnTrainer, epochs=10, minutes=3, dtype="float16",
    use="--option perception=gmgn --option perception_weights={path}",
    options={
        "images": Option(4, "images of a batch", int, lower=1),
        "batches": Option(40, "batches of an epoch", int, lower=1),
        "rate": Option(3e-3, "first rate of Adam", lower=0.0),
    },
)  # fmt: skip
