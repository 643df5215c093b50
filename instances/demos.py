"""Demonstrations: what each problem shows of itself on the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import UnknownName, UnsupportedOption, suggestion
from ..models.model import Model
from ..models.problems import loadable
from .catalogue import entry

__all__ = ["Demo", "DemoOption", "build_demo", "demos"]


@dataclass(frozen=True)
class DemoOption:
    """One option of a demonstration.

    Parameters
    ----------
    help : str
        What it is, in a few words.
    default : object
        Its value where it is not given.
    type : type
        Of its value: ``str``, ``float`` or ``int``.
    metavar : str, optional
        What stands for its value in the help.
    """

    help: str
    default: Any = None
    type: type = str
    metavar: str | None = None


@dataclass(frozen=True)
class Demo:
    """What is solved to show a problem.

    Parameters
    ----------
    instance : str
        The catalogue instance that is solved where nothing else is asked.
    options : mapping of str to DemoOption
        What a user may give instead; the first is the file with the data, without which the others
        mean nothing.
    build : callable, optional
        Takes all options by name and returns the user's model.
    """

    instance: str
    options: Mapping[str, DemoOption] = field(default_factory=dict)
    build: Callable[..., Model[Any]] | None = None


def demos() -> dict[str, Demo]:
    """Return the demonstrations of all problems by name."""
    return dict(loadable(__package__, "DEMOS"))


def build_demo(problem: str, given: Mapping[str, Any]) -> Model[Any]:
    """Return the model that the demonstration of `problem` solves.

    Parameters
    ----------
    problem : str
        The demonstration's name, such as ``"error-correction"``.
    given : mapping
        The options that a user gave.

    Raises
    ------
    UnknownName
        No problem declares such a demonstration.
    UnsupportedOption
        It has no such option, or options were given without the file that they belong to.
    InvalidData
        The file or an option's value is bad.
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
