"""Declaration of trainings by a problem, and base class of the trainers."""

from __future__ import annotations

import contextlib
import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from numpy.typing import NDArray

from ...errors import BackendMissing
from ..contract.option import Option, check_options
from .weights import Weights

__all__ = ["Arrays", "Course", "Trainer", "Training", "one_thread"]

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Course:
    """Settings of one training.

    Parameters
    ----------
    seed : int
        Random seed. The same course gives the same weights on one kind of machine.
    epochs : int
        Number of planned epochs.
    options : mapping
        Options of the training, validated, with defaults filled in.
    examples : object
        Source of training examples, see :func:`train`.
    """

    seed: int
    epochs: int
    options: Mapping[str, Any]
    examples: Any = None


class Trainer(ABC):
    """Base class of trainers, which train epoch by epoch and keep everything in their state."""

    #: Options that do not change the weights. A resumed training may have other values of them.
    free_options: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def run_epoch(self, number: int, tick: Callable[[], None]) -> Mapping[str, float]:
        """Train for one epoch and return its measures.

        Parameters
        ----------
        number : int
            Number of the epoch, from 0. Random numbers of an epoch depend on the seed and this
            number only.
        tick : callable
            Function to call between batches. It raises an exception if the time is used up.

        Returns
        -------
        mapping of str to float
            Measures. ``"score"`` selects the best epoch; higher is better.
        """

    @abstractmethod
    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that later epochs depend on."""

    @abstractmethod
    def restore(self, state: Arrays) -> None:
        """Continue from a state of :meth:`state`; raise ``InvalidData`` if it does not fit."""

    @abstractmethod
    def weights(self) -> Weights:
        """Return the current weights without information about their origin."""

    def close(self) -> None:
        """End the processes of the trainer, if it has any."""


@dataclass(frozen=True)
class Training:
    """Declaration of a training.

    Parameters
    ----------
    name : str
        Name that users pass, equal to that of the backend.
    summary : str
        Description of one line for lists.
    run : str or callable
        ``"module:function"`` or a function that returns the :class:`Trainer` of a :class:`Course`.
    epochs : int
        Default number of epochs.
    minutes : float
        Approximate minutes for this number of epochs on one core.
    options : mapping of str to Option
        Options of this training.
    dtype : {"float32", "float16"}
        Type of the stored weights.
    requires : tuple of str
        Import names of the required packages.
    extra : str
        Extra that installs the packages.
    use : str
        Arguments with which ``crosstrack solve`` reads the weights; ``{name}`` and ``{path}`` are
        replaced.
    """

    name: str
    summary: str
    run: str | Callable[[Course], Trainer]
    epochs: int = 10
    minutes: float = 1.0
    options: Mapping[str, Option] = field(default_factory=dict)
    dtype: str = "float32"
    requires: tuple[str, ...] = ("torch",)
    extra: str = "learn"
    use: str = "--backend {name} --option weights={path}"

    def require(self) -> None:
        """Raise :class:`~crosstrack.errors.BackendMissing` if a required package is missing."""
        missing = [name for name in self.requires if importlib.util.find_spec(name) is None]
        if missing:
            raise BackendMissing(
                f"training {self.name!r} needs {', '.join(missing)}: pip install "
                f"'crosstrack[{self.extra}]'"
            )

    def checked_options(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all options of this training, with `given` validated and defaults filled in.

        Parameters
        ----------
        given : mapping of str to object
            Values by option name.

        Raises
        ------
        UnsupportedOption
            A name is unknown or a value is not allowed.
        """
        return check_options(f"training {self.name!r}", self.options, given)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Restrict PyTorch to one thread, so that sums have a fixed order and a seed fixes all bits."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
