"""Demonstrations of the problems on the command line."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import BackendBroken, UnknownName, UnsupportedOption, suggestion
from ..models.model import Model
from ..models.problems import resolve, table
from .catalogue import entry

__all__ = ["Demo", "DemoOption", "build_demo", "demos"]

log = logging.getLogger("crosstrack")


@dataclass(frozen=True)
class DemoOption:
    """Option of a demonstration.

    Parameters
    ----------
    help : str
        Description in a few words.
    default : object
        Default value.
    type : type
        Type of the value: ``str``, ``float`` or ``int``.
    metavar : str, optional
        Placeholder of the value in the help.
    """

    help: str
    default: Any = None
    type: type = str
    metavar: str | None = None


@dataclass(frozen=True)
class Demo:
    """Demonstration of a problem.

    Parameters
    ----------
    instance : str
        Catalogue instance that is solved by default.
    options : mapping of str to DemoOption
        Options for the user's data. The first is the data file, which the others require.
    build : callable, optional
        Function from all options by name to the user's model.
    """

    instance: str
    options: Mapping[str, DemoOption] = field(default_factory=dict)
    build: Callable[..., Model[Any]] | None = None


def demos() -> dict[str, Demo]:
    """Return the demonstrations of all problems by name.

    A problem declares a :class:`Demo`, or only the name of an instance in the catalogue.
    """
    result = {}
    for name, target in table(__package__, "DEMOS").items():
        try:
            plain = isinstance(target, str) and ":" not in target
            result[name] = Demo(target) if plain else resolve(target)
        except BackendBroken as error:  # a broken third-party entry must not hide the others
            log.warning("DEMOS %r: %s", name, error)
    return result


def build_demo(problem: str, given: Mapping[str, Any]) -> Model[Any]:
    """Return the model of the demonstration of `problem`.

    Parameters
    ----------
    problem : str
        Name of the demonstration, such as ``"error-correction"``.
    given : mapping
        Options given by the user.

    Returns
    -------
    Model
        The default instance, or the model of the user's data.

    Raises
    ------
    UnknownName
        No problem declares this demonstration.
    UnsupportedOption
        An option is unknown, or requires the file that is missing.
    InvalidData
        The file or the value of an option is invalid.
    """
    known = demos()
    if problem not in known:
        raise UnknownName("demonstration", problem, known)
    demo = known[problem]
    for name in given:
        if name not in demo.options:
            raise UnsupportedOption(
                f"the demonstration of {problem!r} has no option {name!r}; "
                f"{suggestion(name, demo.options)}"
                f"its options: {', '.join(demo.options) or 'none'}"
            )
    if demo.build is None or not given:
        return entry(demo.instance).build()
    file = next(iter(demo.options))
    if file not in given:
        raise UnsupportedOption(f"{', '.join(given)} must be given together with {file}")
    defaults = {name: option.default for name, option in demo.options.items()}
    return demo.build(**{**defaults, **given})
