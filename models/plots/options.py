"""Options of pictures: their checks, which raise ``UnsupportedOption``, and their common description."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from ...errors import UnsupportedOption
from ..fields import show

__all__ = [
    "check_choice", "check_flags", "check_frames", "check_list", "check_option", "check_size",
    "check_whole", "check_words", "documented", "is_number", "is_whole",
]  # fmt: skip

_Function = TypeVar("_Function", bound=Callable[..., Any])

#: Descriptions of the parameters that all pictures or all animations share.
_SHARED = {
    "frames": "int\n    Number of frames, at least 2.",
    "interval": "float\n    Duration of a frame, ms.",
    "tolerance": "float\n    Largest accepted relative violation, for the title and the red marks.",
    "title": "str, optional\n    Title; by default the name of the model and the main figures of the plan.",
    "size": "(float, float), optional\n    Width and height (inch).",
}
_PLAN = "Plan of the model, valid or not."
#: Description of the title of an animation, which :class:`.scene.Stage` writes.
_STAGE_TITLE = "str, optional\n    Title; by default the name of the model, or its size."
_PARAMETERS = "\n\nParameters\n----------\n"
#: Sections of docstrings after the parameters, of pictures, of animations and of both.
_FIGURE = """
Returns
-------
matplotlib.figure.Figure
    Figure without a window or pyplot state."""
_ANIMATION = """
Returns
-------
matplotlib.animation.FuncAnimation
    Animation without a window: ``{name}(model, …).save("{name}.gif", writer="pillow", dpi=80)`` writes
    a file, and ``to_jshtml()`` returns a page."""
_RAISES = """

Raises
------
InvalidData
    The plan or another argument does not fit the model.
UnsupportedOption
    The value of an option is not allowed, or needs data that the model or the plan lacks."""


def documented(function: _Function) -> _Function:
    """Complete the docstring of a picture: shared parameters, result and exceptions.

    The docstring ends with its section Parameters, which describes the others in any order. Without
    docstrings (``python -OO``), the function is unchanged.
    """
    if function.__doc__ is None:
        return function
    summary, _, section = inspect.cleandoc(function.__doc__).partition(_PARAMETERS)
    entries = [entry.partition(" : ") for entry in re.split(r"\n(?=\w)", section) if entry]
    names = inspect.signature(function).parameters
    model, plan = (str(function.__annotations__.get(name)) for name in ("model", "plan"))
    kind, _, other = plan.partition(" | ")
    described = {
        **_SHARED,
        "model": f"{model}\n    Model to draw.",
        "plan": f"{kind}{', optional' if other == 'None' else ' or Solution'}\n    {_PLAN}",
    }
    if "frames" in names:
        described["title"] = _STAGE_TITLE
    described |= {name: text for name, _, text in entries}
    parameters = "\n".join(f"{name} : {described[name]}" for name in names)
    result = _ANIMATION.format(name=function.__name__) if "frames" in names else _FIGURE
    function.__doc__ = f"{summary}{_PARAMETERS}{parameters}\n{result}{_RAISES}"
    return function


def check_option(name: str, value: Any, good: bool, allowed: str) -> None:
    """Raise :class:`UnsupportedOption` unless `good`: ``"<name> must <allowed>, got <value>"``."""
    if not good:
        raise UnsupportedOption(f"{name} must {allowed}, got {show(value)}")


def check_choice(name: str, value: Any, *words: str) -> None:
    """Raise unless `value` is one of two or three `words`."""
    *first, last = map(repr, words)
    allowed = f"be {', '.join(first)} or {last}"
    check_option(name, value, isinstance(value, str) and value in words, allowed)


def check_words(name: str, value: Any, words: Sequence[str]) -> list[str]:
    """Return `value` as a list of distinct entries of `words`, at least one."""
    allowed = f"hold some of {', '.join(map(repr, words))}"
    return check_list(name, value, words.__contains__, allowed)


def check_size(size: Any, default: tuple[float, float]) -> tuple[float, float]:
    """Return width and height (inch), `default` for None."""
    if size is None:
        return default
    try:
        width, height = (float(edge) for edge in size)
    except (TypeError, ValueError):
        width = height = 0.0
    good = 0 < width <= 100 and 0 < height <= 100
    check_option("size", size, good, "be width and height in inches, each > 0 and <= 100")
    return width, height


def check_flags(*, optional: bool = False, **flags: Any) -> None:
    """Raise if one of the options is neither True nor False, nor None if it is `optional`."""
    for name, value in flags.items():
        good = isinstance(value, bool) or (optional and value is None)
        check_option(name, value, good, "be True or False")


def check_frames(frames: Any, interval: Any) -> None:
    """Raise unless the number of `frames` and their `interval` in ms are allowed."""
    check_whole("frames", frames, 2, 10_000)
    finite = is_number(interval) and 0 < interval < np.inf
    check_option("interval", interval, finite, "be a finite number > 0")


def check_whole(name: str, value: Any, low: int, high: int) -> None:
    """Raise unless `value` is an integer from `low` to `high`."""
    good = is_whole(value, low, high)
    check_option(name, value, good, f"be a whole number from {low} to {high}")


def check_list(
    name: str, value: Any, one: Callable[[Any], bool], allowed: str, *, most: int | None = None,
    least: int = 1,
) -> list[Any]:  # fmt: skip
    """Return `value` as a list of `least` to `most` distinct entries that satisfy `one`."""
    plain = isinstance(value, Iterable) and not isinstance(value, str | bytes)
    listed = list(value) if plain else []
    good = plain and len(listed) >= least and (most is None or len(listed) <= most)
    good = good and all(map(one, listed)) and len(set(listed)) == len(listed)
    check_option(name, value, good, allowed)
    return listed


def is_number(value: Any) -> bool:
    """Return whether `value` is a number other than a Boolean."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def is_whole(value: Any, low: int, high: int) -> bool:
    """Return whether `value` is an integer from `low` to `high`."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and bool(low <= value <= high)
