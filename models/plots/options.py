"""The options that pictures of controls share, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import InvalidData
from ..fields import show

__all__ = ["check_flags", "check_size", "check_tolerance"]


def check_size(size: Any, default: tuple[float, float]) -> tuple[float, float]:
    """Return width and height (inch), or raise :class:`InvalidData`."""
    if size is None:
        return default
    try:
        width, height = (float(edge) for edge in size)
    except (TypeError, ValueError):
        width = height = 0.0
    if not (0 < width <= 100 and 0 < height <= 100):
        raise InvalidData(
            f"size must be width and height in inches, each > 0 and <= 100, got {show(size)}",
            field="size",
        )
    return width, height


def check_flags(**flags: Any) -> None:
    """Raise :class:`InvalidData` where one of the options is neither True nor False."""
    for name, value in flags.items():
        if not isinstance(value, bool):
            raise InvalidData(f"{name} must be True or False, got {show(value)}", field=name)


def check_tolerance(tolerance: Any) -> None:
    """Raise :class:`InvalidData` where the tolerance is no number above 0."""
    number = isinstance(tolerance, int | float | np.number) and not isinstance(tolerance, bool)
    if not (number and tolerance > 0):
        raise InvalidData(
            f"tolerance must be a number > 0, got {show(tolerance)}", field="tolerance"
        )
