"""Exceptions of crosstrack.

::

    CrosstrackError
    ├── InvalidData            a model, plan or file contains a value that is not allowed
    ├── UnknownName            no model, instance, backend or formulation has this name
    ├── BackendMissing         the backend's package is not installed
    ├── BackendBroken          the package is installed but cannot be used
    ├── UnsupportedOption      the backend or formulation does not accept the option or its value
    ├── UnsupportedFormulation the formulation does not cover a feature of the model
    ├── HiddenData             a backend reads a field that the model hides from backends
    ├── NoDerivative           the solution is not a differentiable function of its data
    └── WorkerFailure          a call in a worker process raised, crashed or timed out

Every message names the field, the value and what is allowed.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

__all__ = [
    "BackendBroken",
    "BackendMissing",
    "CrosstrackError",
    "HiddenData",
    "InvalidData",
    "NoDerivative",
    "UnknownName",
    "UnsupportedFormulation",
    "UnsupportedOption",
    "WorkerFailure",
    "show",
    "suggestion",
]


#: Largest number of names that an error message lists in full.
MOST = 48


def show(value: Any) -> str:
    """Return the representation of `value` for an error message.

    Parameters
    ----------
    value : object
        Any value, including one whose ``repr`` raises.

    Returns
    -------
    str
        ``repr(value)``, cut to 60 characters.
    """
    try:
        text = repr(value)
        text.encode()
    except Exception:  # nested too deeply, too many digits, invalid UTF-8, or a bug in __repr__
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return ``"did you mean …? "`` with up to three names similar to `name` or containing it, or ``""``.

    Parameters
    ----------
    name : object
        The unknown name; any value other than a string gives ``""``.
    known : iterable of str
        The valid names.

    Returns
    -------
    str
        The question with a trailing space; empty if no name is similar.
    """
    if not isinstance(name, str):
        return ""
    folded = {item.casefold(): item for item in known}
    word = name.casefold()
    near = difflib.get_close_matches(word, folded, n=3)
    if not near and len(word) > 2:  # a part of a name, such as fleet of fleet-routing
        near = [item for item in folded if word in item][:3]
    return f"did you mean {' or '.join(repr(folded[item]) for item in near)}? " if near else ""


class CrosstrackError(Exception):
    """Base class of all exceptions that crosstrack raises deliberately."""


class InvalidData(CrosstrackError, ValueError):
    """A model, a plan or a file contains a value that is not allowed.

    Parameters
    ----------
    message : str
        Field, value and what is allowed.
    field : str, optional
        Name of the invalid field, for programs that highlight it.
    """

    def __init__(self, message: str, *, field: str | None = None) -> None:
        super().__init__(message)
        self.field = field


class UnknownName(CrosstrackError, LookupError):
    """No model, instance, backend or formulation has this name.

    Parameters
    ----------
    what : str
        Kind of the object, such as ``"backend"``.
    name : str
        The unknown name.
    known : iterable of str
        The valid names. The message suggests those most similar to `name`.
    """

    def __init__(self, what: str, name: Any, known: Iterable[str]) -> None:
        names = sorted(known)
        listed = ", ".join(names) if names else "none"
        if len(names) > MOST:
            listed = f"{', '.join(names[:3])} … ({len(names)} in all)"
        super().__init__(f"unknown {what} {show(name)}: {suggestion(name, names)}known: {listed}")
        self.what = what
        self.name = name


class BackendMissing(CrosstrackError, ImportError):
    """The backend's package is not installed; the message names the package to install."""


class BackendBroken(CrosstrackError, RuntimeError):
    """The backend's package is installed but cannot be used; the message gives the cause."""


class UnsupportedOption(CrosstrackError, ValueError):
    """The backend or formulation does not accept the option or its value."""


class UnsupportedFormulation(CrosstrackError, ValueError):
    """The formulation does not cover a feature of the model."""


class HiddenData(CrosstrackError, AttributeError):
    """A hidden field of the model was read from the view that backends receive."""


class NoDerivative(CrosstrackError, ArithmeticError):
    """The solution is not a differentiable function of its data; the message names the condition that fails."""


class WorkerFailure(CrosstrackError, RuntimeError):
    """A function called in a worker process raised, ended its process or exceeded its deadline."""
