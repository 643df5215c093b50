"""Options of a backend's own: declared, so that a wrong name or value is refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UnsupportedOption
from ..models.fields import required, show

__all__ = ["Option"]


@dataclass(frozen=True)
class Option:
    """One option of a backend's own.

    Parameters
    ----------
    default : object
        The value when nothing is given.
    help : str
        One sentence: what it does, and its unit.
    kind : type
        The type that a value must have (``float`` takes integers too).
    choices : tuple
        The values allowed; empty when any is.
    lower, upper : float, optional
        The closed range allowed, for numbers.
    file : bool
        Whether the value names a file that the answer depends on, such as the weights of a learned
        policy. It must exist, and its SHA-256 is recorded with the answer. Training writes such a
        file by a command of its own; a backend only reads it.
    """

    default: Any
    help: str
    kind: type = float
    choices: tuple[Any, ...] = ()
    lower: float | None = None
    upper: float | None = None
    file: bool = False

    def check(self, owner: str, name: str, value: Any) -> Any:
        """Return `value` coerced to :attr:`kind`, or raise :class:`UnsupportedOption`."""
        owner, name = required("owner", owner, str), required("name", name, str)
        if value is None and self.default is None:
            return None
        wrong = isinstance(value, bool) is not (self.kind is bool)
        if self.kind is float and isinstance(value, int | float | np.number) and not wrong:
            value = float(value)
        elif self.kind is int and isinstance(value, np.integer):
            value = int(value)
        if wrong or not isinstance(value, self.kind):
            raise UnsupportedOption(
                f"{owner}: option {name!r} must be a {self.kind.__name__}, got {show(value)}"
            )
        if self.choices and value not in self.choices:
            allowed = ", ".join(map(repr, self.choices))
            raise UnsupportedOption(
                f"{owner}: option {name!r} must be one of {allowed}, got {show(value)}"
            )
        if self.file and not Path(str(value)).is_file():
            raise UnsupportedOption(f"{owner}: option {name!r}: there is no file {show(value)}")
        number: Any = value
        low = self.lower is not None and not number >= self.lower
        high = self.upper is not None and not number <= self.upper
        if low or high:
            raise UnsupportedOption(
                f"{owner}: option {name!r} must lie in [{self.lower}, {self.upper}], got {show(value)}"
            )
        return value
