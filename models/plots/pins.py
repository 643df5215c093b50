"""Pins: places of the checks of a verification in the axes of a picture.

A pin draws nothing. ``figure.crosstrack_pins`` lists them for interactive pages.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..verification import Check, Verification
from .curves import Curve

__all__ = ["Pin", "pin", "pin_curves", "pin_places", "time_of"]

#: Time in the text of a check.
_TIME = re.compile(r"\bt = (-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)(?![\w.])")


class Pin(NamedTuple):
    """Place of the worst violation or the smallest slack of a check, in data coordinates of `axes`."""

    axes: Any
    check: Check
    x: float
    y: float
    z: float | None = None


def pin(axes: Any, check: Check, *place: float) -> None:
    """Append a :class:`Pin` at x, y (and z) to ``crosstrack_pins`` of the root figure.

    The axes must have their final limits: a place beyond them is moved to the edge. NaN is ignored.
    """
    pins = vars(axes.get_figure(root=True)).setdefault("crosstrack_pins", [])
    limits = [sorted(getattr(axes, f"get_{name}lim")()) for name in "xyz"[: len(place)]]
    inside = [float(np.clip(value, *ends)) for value, ends in zip(place, limits, strict=True)]
    if np.isfinite(inside).all():
        pins.append(Pin(axes, check, *inside))


def pin_places(
    axes: Any, result: Verification | None, places: Mapping[str, Any] | Callable[[Check], Any],
    scale: float = 1.0,
) -> None:  # fmt: skip
    """Pin all checks of `result` that have a place in `axes`.

    `places` are the places by the text :attr:`.Check.where`, or a function that returns the place of a check,
    several places or None. They are multiplied by `scale`.
    """
    for check in () if result is None else result.checks:
        place = places(check) if callable(places) else places.get(check.where)
        for spot in () if place is None else np.atleast_2d(place):
            pin(axes, check, *np.multiply(spot, scale))


def time_of(check: Check) -> float | None:
    """Return the time in the text of a check, None without one."""
    match = _TIME.search(check.where)
    return None if match is None else float(match[1])


def pin_curves(
    result: Verification | None, find: Callable[[Check], tuple[Any, Curve, float] | None]
) -> None:
    """Pin checks on curves over time; `find` returns axes, curve and time of a check, None without one."""
    for check in () if result is None else result.checks:
        entry = find(check)
        if entry is not None:
            axes, curve, time = entry
            # A curve may be interrupted at the very place.
            known = np.isfinite(curve.values)
            if known.any():
                pin(axes, check, time, np.interp(time, curve.times[known], curve.values[known]))
