"""What a problem declares of something that can be trained, and what trains it."""

from __future__ import annotations

import contextlib
import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from ..errors import BackendMissing, UnsupportedOption, suggestion
from .option import Option
from .weights import Weights

__all__ = ["Arrays", "Course", "Trainer", "Training", "one_thread"]

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Course:
    """What one training is asked for.

    Parameters
    ----------
    seed : int
        Of all that is drawn: the same course gives the same weights, on one kind of machine.
    epochs : int
        How many are planned.
    options : mapping
        The training's own, checked, defaults filled in.
    examples : object
        What draws the examples to learn from, see :func:`train`.
    """

    seed: int
    epochs: int
    options: Mapping[str, Any]
    examples: Any = None


class Trainer(ABC):
    """What learns, epoch by epoch; all it knows is in its state."""

    @abstractmethod
    def run_epoch(self, number: int, tick: Callable[[], None]) -> Mapping[str, float]:
        """Learn for one epoch, and return its figures; ``"score"`` says which epoch is the best.

        Parameters
        ----------
        number : int
            0 and so on. All that an epoch draws follows from the seed and this number.
        tick : callable
            To be called between batches; raises where the time is used up.
        """

    @abstractmethod
    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything that a later epoch depends on."""

    @abstractmethod
    def restore(self, state: Arrays) -> None:
        """Go on from a state; ``InvalidData`` where it is of another network."""

    @abstractmethod
    def weights(self) -> Weights:
        """Return the weights as they are, without saying how they were made."""


@dataclass(frozen=True)
class Training:
    """What can be trained, and how.

    Parameters
    ----------
    name : str
        The name people type, that of the backend.
    summary : str
        One line for lists.
    run : str or callable
        ``"module:function"`` or a function that returns the :class:`Trainer` of a :class:`Course`.
    epochs : int
        How many by default.
    minutes : float
        About how long these take on one core.
    options : mapping of str to Option
        The training's own options.
    dtype : {"float32", "float16"}
        What the weights are stored as.
    requires : tuple of str
        Import names of the packages it needs.
    extra : str
        The extra that brings them.
    use : str
        How ``crosstrack solve`` is told to read the weights, ``{name}`` and ``{path}`` filled in.
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
        """Raise :class:`~crosstrack.errors.BackendMissing`, saying what to install, unless all is there."""
        missing = [name for name in self.requires if importlib.util.find_spec(name) is None]
        if missing:
            raise BackendMissing(
                f"training {self.name!r} needs {', '.join(missing)}: pip install "
                f"'crosstrack[{self.extra}]'"
            )

    def checked_options(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all options with `given` filled in; raise on an unknown name or value."""
        owner = f"training {self.name!r}"
        for name in given:
            if name not in self.options:
                known = ", ".join(sorted(self.options)) or "none"
                raise UnsupportedOption(
                    f"{owner} has no option {name!r}; {suggestion(name, self.options)}its options: {known}"
                )
        return {
            name: option.check(owner, name, given[name]) if name in given else option.default
            for name, option in self.options.items()
        }


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let PyTorch compute with one thread, so that sums have one order: same seed, same bits."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
