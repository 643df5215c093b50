"""The exceptions of crosstrack, one tree.

::

    CrosstrackError
    ├── InvalidData            a model, plan or file holds a value that is not allowed
    ├── UnknownName            no model, instance, backend or formulation bears this name
    ├── BackendMissing         the backend's package is not installed
    ├── BackendBroken          the package is installed, yet cannot be used
    ├── UnsupportedOption      the backend or formulation does not know the option or its value
    ├── UnsupportedFormulation the formulation does not cover what the model asks for
    ├── HiddenData             a backend asks for what the model hides from backends
    ├── NoDerivative           a solution is no differentiable function of its data
    └── WorkerFailure          what ran in a process of its own has ended that process, or hung

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


#: Names above which an error does not list them all.
MOST = 48


def show(value: Any) -> str:
    """Return `value` for an error message, cut to a readable length."""
    try:
        text = repr(value)
        text.encode()
    except Exception:  # too deep, too many digits, no UTF-8, or a stranger's own fault
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return ``"did you mean …? "`` with the names nearest to `name`, empty where none is near."""
    if not isinstance(name, str):
        return ""
    folded = {one.casefold(): one for one in known}
    near = difflib.get_close_matches(name.casefold(), folded, n=3)
    return f"did you mean {' or '.join(repr(folded[one]) for one in near)}? " if near else ""


class CrosstrackError(Exception):
    """Base of every exception that crosstrack raises on purpose."""


class InvalidData(CrosstrackError, ValueError):
    """A model, a plan or a file holds a value that is not allowed.

    Parameters
    ----------
    message : str
        Field, value and what is allowed.
    field : str, optional
        The field at fault, for programs that want to point at it.
    """

    def __init__(self, message: str, *, field: str | None = None) -> None:
        super().__init__(message)
        self.field = field


class UnknownName(CrosstrackError, LookupError):
    """No model, instance, backend or formulation bears this name.

    Parameters
    ----------
    what : str
        The kind of thing that was looked up, such as ``"backend"``.
    name : str
        The name that was not found.
    known : iterable of str
        The names that exist; the nearest are suggested.
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
    """The backend's package is not installed; the message says what to install."""


class BackendBroken(CrosstrackError, RuntimeError):
    """The backend's package is installed, yet it cannot be used; the message gives the cause."""


class UnsupportedOption(CrosstrackError, ValueError):
    """The backend or formulation does not know the option, or not this value of it."""


class UnsupportedFormulation(CrosstrackError, ValueError):
    """The formulation does not cover what the model asks for."""


class HiddenData(CrosstrackError, AttributeError):
    """A field that the model hides from backends was read where only a backend's view of it is."""


class NoDerivative(CrosstrackError, ArithmeticError):
    """A solution is no differentiable function of its data; the message says which condition fails."""


class WorkerFailure(CrosstrackError, RuntimeError):
    """A function called in a worker raised, killed its process, or passed its deadline."""
