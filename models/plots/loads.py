"""Panels of loads: one bar per vehicle with limits, and levels along a route with limits at its stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..verification import Verification
from .curves import Curve, Floats, Mark, Panel, Span
from .layers import draw_lines
from .panels import draw_panels
from .pins import pin
from .style import BLACK, DARK, GREY, RED, RING, bare, colour_of, key, label_axes, number

__all__ = ["MOST_BARS", "Level", "draw_levels", "draw_loads"]

#: Largest number of bars that have names and numbers.
MOST_BARS = 24
#: Height of a bar at a spacing of 1, height if there are few, and room for numbers to the right.
_HEIGHT, _THIN, _ROOM = 0.66, 0.44, 1.22


def draw_loads(
    axes: Any, loads: Floats, label: str, *, names: Sequence[str], deviation: float | None = None,
    limits: Floats | None = None, wrong: Sequence[int] = (),
) -> list[Any]:  # fmt: skip
    """Draw a bar for each of `loads` from the top, in the colour of the vehicle's route on the map.

    Loads that are not finite are omitted. `label` is that of the axis, with its unit; `deviation` is half the width
    of a band around the line at the mean; `limits` are upper limits of the bars, and `wrong` are the indices of
    bars that violate one, which are framed in red. Returns the entries of a legend.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba
    from matplotlib.patheffects import withStroke

    rows = np.arange(len(loads))
    finite = np.where(np.isfinite(loads), loads, 0.0)
    corners = np.array([[0, -0.5], [1, -0.5], [1, 0.5], [0, 0.5]])
    thick = _HEIGHT if len(loads) > 4 else _THIN
    boxes = corners * [1, thick] * np.stack([finite, np.ones(len(loads))], axis=1)[:, None]
    boxes[..., 1] += rows[:, None]
    bars = PolyCollection(
        list(boxes), facecolors=[to_rgba(colour_of(k), 0.85) for k in range(len(loads))], gid="load",
        edgecolors=[RED if k in wrong else "none" for k in rows], linewidths=2.0, zorder=3,
    )  # fmt: skip
    axes.add_collection(bars, autolim=False)
    keys = [key("mean", color=BLACK, lw=1.2, ls="--")]
    mean = float(finite.mean()) if len(finite) else 0.0
    axes.axvline(mean, color=BLACK, lw=1.2, ls="--", zorder=4, gid="mean")
    ends = [float(finite.max(initial=0.0))]
    if deviation is not None and np.isfinite(deviation):
        from matplotlib.patches import Patch

        axes.axvspan(
            mean - deviation, mean + deviation, color=DARK, alpha=0.15, lw=0, zorder=1,
            gid="deviation",
        )  # fmt: skip
        keys.append(Patch(facecolor=DARK, alpha=0.15, label=f"± deviation, {number(deviation, 4)}"))
        ends.append(mean + deviation)
    top = max(ends) or 1.0
    if limits is not None:
        near = np.flatnonzero(np.isfinite(limits) & (limits <= 2.0 * top))
        ticks = np.stack([limits[near], near - 0.45, limits[near], near + 0.45], axis=1)
        if len(near):
            top = max(top, float(limits[near].max()))
            ends_of = ticks.reshape(-1, 2, 2)
            draw_lines(axes, ends_of, color=RED, lw=1.4, zorder=5, gid="limit")
            keys.append(key("limit", color=RED, lw=1.4))
        far = np.setdiff1d(rows[np.isfinite(limits)], near)
        if far.size:
            smallest = number(float(limits[far].min()), 4)
            text = f"limit {smallest}" if np.ptp(limits[far]) == 0 else f"limits from {smallest}"
            keys.append(key(f"{text}, out of sight", ls=""))
    if len(wrong):
        keys.append(key("limit broken", marker="s", mfc="none", mec=RED, mew=1.6, ms=RING["ms"]))
    axes.set_xlim(0.0, top * (_ROOM if len(loads) <= MOST_BARS else 1.05))
    axes.set_ylim(max(len(loads), 1) - 0.5, -0.5)
    label_axes(axes, label)
    bare(axes)
    axes.grid(visible=False, axis="y")
    if len(loads) <= MOST_BARS:
        axes.set_yticks(rows, list(names))
        for row, load, place in zip(rows, loads, finite, strict=True):
            axes.annotate(
                number(float(load), 5), (place, row), (4, 0), textcoords="offset points", va="center",
                fontsize=7.5, color=RED if row in wrong else DARK, zorder=6, annotation_clip=False,
                path_effects=[withStroke(linewidth=2.0, foreground="white")],
            )  # fmt: skip
    else:
        label_axes(axes, y="vehicle (number)")
    return keys


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
    title: str, wrong: bool, result: Verification | None = None, stops: Sequence[str] = (),
) -> None:  # fmt: skip
    """Draw a panel per level over the distance of the stops from the start, with bars at the limits.

    `label` is that of the distance, `limit` and `broken` are legend entries of limits and of exceeded ones.
    `title` and `wrong` are those of :func:`.panels.draw_panels`. Checks of `result` called ``"<level> at …"`` are
    pinned at the highest level on arrival among the stops with their text; `stops` are the texts.
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
        for check in () if result is None else result.checks:
            rows = [k for k, stop in enumerate(stops) if k and stop == check.where]
            if rows and check.name.startswith(f"{level.name} at "):
                row = max(rows, key=level.arrive.__getitem__)
                pin(axes, check, distance[row], level.arrive[row])
