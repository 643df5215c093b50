"""Declaration of backend options, so that wrong names and values raise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import UnsupportedOption, suggestion
from ...models.fields import required, show

__all__ = ["Option", "check_options"]


@dataclass(frozen=True)
class Option:
    """Option of a backend.

    Parameters
    ----------
    default : object
        Default value.
    help : str
        Effect and unit in one sentence.
    kind : type
        Required type (``float`` accepts integers).
    choices : tuple
        Allowed values; empty for no restriction.
    lower, upper : float, optional
        Closed range of allowed numbers.
    file : bool
        Whether the value is the name of a file that the answer depends on, such as the weights of
        a learned policy. The file must exist. Its SHA-256 digest is recorded with the answer. A
        backend only reads such a file; a separate command trains and writes it.
    """

    default: Any
    help: str
    kind: type = float
    choices: tuple[Any, ...] = ()
    lower: float | None = None
    upper: float | None = None
    file: bool = False

    def check(self, owner: str, name: str, value: Any) -> Any:
        """Return `value` coerced to :attr:`kind`.

        Parameters
        ----------
        owner, name : str
            Names of the backend and the option, for messages.
        value : object
            The value.

        Raises
        ------
        UnsupportedOption
            The type or value is not allowed.
        """
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
            raise UnsupportedOption(f"{owner}: option {name!r}: file {show(value)} does not exist")
        number: Any = value
        below = self.lower is not None and not number >= self.lower
        above = self.upper is not None and not number <= self.upper
        if below or above:
            raise UnsupportedOption(
                f"{owner}: option {name!r} must lie in [{self.lower}, {self.upper}], got {show(value)}"
            )
        return value


def check_options(
    owner: str, options: Mapping[str, Option], values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return all options, with `values` validated and defaults filled in.

    Parameters
    ----------
    owner : str
        Owner of the options, such as ``"backend 'highs'"``, for messages.
    options : mapping of str to Option
        The options by name.
    values : mapping of str to object
        Values by option name.

    Raises
    ------
    UnsupportedOption
        A name is unknown or a value is not allowed.
    """
    for name in values:
        if name not in options:
            known = ", ".join(sorted(options)) or "none"
            raise UnsupportedOption(
                f"{owner} has no option {name!r}; {suggestion(name, options)}its own options: {known}"
            )
    return {
        name: option.check(owner, name, values[name]) if name in values else option.default
        for name, option in options.items()
    }
