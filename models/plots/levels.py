"""Panels of levels along a route: they rise on the way, fall at stops, and have a limit at each stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .curves import Curve, Mark, Panel, Span
from .panels import draw_panels
from .style import DARK, GREY, RED, RING, colour_of, key

__all__ = ["Level", "draw_levels"]

Floats = NDArray[np.float64]

#: Half the width of the bar of a limit, relative to the length of the route.
_HALF = 0.011


class Level(NamedTuple):
    """Level of a quantity at the stops of a route; arrays have the shape (stops,).

    `arrive` and `leave` are the levels before and after each stop, `limits` the largest ones on arrival, infinite
    for none, and `wrong` marks those that are exceeded.
    """

    name: str
    unit: str
    colour: int
    arrive: Floats
    leave: Floats
    limits: Floats
    wrong: NDArray[np.bool_]
    marks: Sequence[Mark]


def draw_levels(
    figure: Any, distance: Floats, levels: Sequence[Level], *, label: str, limit: str, broken: str,
    title: str, wrong: bool,
) -> None:  # fmt: skip
    """Draw a panel per level over the distance of the stops from the start, with bars at the limits.

    `label` is that of the distance, `limit` and `broken` are legend entries of limits and of exceeded ones.
    `title` and `wrong` are those of :func:`.panels.draw_panels`.
    """
    flown = np.repeat(distance, 2)
    panels, curves = [], []
    for level in levels:
        values = np.stack([level.arrive, level.leave], axis=1).ravel()
        curves.append(values)
        marks = list(level.marks)
        if level.wrong.any():
            marks.append(Mark(broken, distance[level.wrong], level.arrive[level.wrong], 0, RING))
        curve = Curve(level.name, level.colour, flown, values, 1.5)
        panels.append(Panel(level.name, level.unit, [curve], marks=marks))
    total = float(distance[-1]) or 1.0
    places = draw_panels(
        figure, panels, [Span("", 0.0, total)], title=title, wrong=wrong, label=label,
        keys=[key(limit, marker="_", mew=1.6, ms=9, color=DARK)],
    )  # fmt: skip
    for axes, level, values in zip(places, levels, curves, strict=True):
        axes.fill_between(flown, values, color=colour_of(level.colour), alpha=0.12, lw=0)
        bounded = np.isfinite(level.limits) & (np.arange(len(distance)) > 0)
        at, most, red = distance[bounded], level.limits[bounded], level.wrong[bounded]
        bars, stems = ([RED if bad else calm for bad in red] for calm in (DARK, GREY))
        axes.hlines(most, at - _HALF * total, at + _HALF * total, colors=bars, lw=1.6, gid=limit)
        widths = np.where(red, 1.4, 0.6).tolist()
        axes.vlines(at, level.arrive[bounded], most, colors=stems, lw=widths, ls=":")
        axes.set_ylim(0, 1.12 * float(np.append(values, most).max(initial=0.0)) or 1.0)
