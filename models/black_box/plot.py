"""Pictures of black boxes: a curve, a contour map, cross-sections through a point, or a path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..plots.curves import Curve, Mark, Panel, Span
from ..plots.maps import dress_map, length_unit
from ..plots.options import check_option, is_whole
from ..plots.panels import draw_panel, keys_of
from ..plots.progress import draw_progress
from ..plots.space import dots
from ..plots.style import (
    BLACK,
    DARK,
    RED,
    axis_style,
    bare,
    headline,
    inches,
    key,
    legend_below,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .animation import animate_search, blocked_part, box_of, draw_ends, path_function
from .functions import BlackBoxFunction
from .model import BlackBoxMinimisation
from .plan import BlackBoxPoint
from .waypoints import WaypointPath

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["animate_search", "draw", "draw_progress"]

Floats = NDArray[np.float64]

#: Largest number of cross-sections, and of plans in addition to the first.
_MOST, _MOST_OTHERS = 12, 12
#: Number of values of a single curve per value of a section.
_FINER = 4
#: Number of levels of a contour map, and their smallest difference relative to the range of values.
_LEVELS, _APART = 14, 1e-3
#: Ratio of distance from 0 to width above which the ticks of an axis have an offset.
_NARROW = 1e4
#: Colour of points without a value.
_NONE = "#d9d9d9"
#: Number of letters of a legend's line per inch of the figure.
_LETTERS = 15.0


class _Point(NamedTuple):
    """Point to draw, with its verification."""

    name: str
    x: Floats
    found: Verification


@np.errstate(all="ignore")  # overflow gives inf or NaN, which is no value
def draw(
    model: BlackBoxMinimisation,
    plan: BlackBoxPoint | None = None,
    *,
    others: Mapping[str, Any] | None = None,
    view: str = "map",
    points: int = 101,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the function of `model`, and the point of `plan`.

    A function of one variable is a curve, and one of two variables a contour map, whose levels have
    equal shares of the area if the values are uneven. Of more variables, the first twelve have one
    cross-section each, through the point or the middle of the bounds. A waypoint path is drawn on
    its map. Fixed variables are ignored. Points without a value, or at which the function raises,
    are gaps.

    Parameters
    ----------
    model : BlackBoxMinimisation
        Model. The picture evaluates its function without using the budget.
    plan : BlackBoxPoint, optional
        Point of the model, within the bounds or not.
    others : dict of str to plan, optional
        Further points of the model by their label in the legend: plans, their JSON data or
        solutions.
    view : {"map", "values"}
        Whether a path is drawn on its map, or as a function of its variables.
    points : int
        Number of values along each axis, from 2 to 2001; a single curve has four times as many.
    tolerance : float
        Largest accepted relative violation, for the title.
    title : str, optional
        Title; by default the name and the value.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        One map, or one panel per cross-section.

    Raises
    ------
    InvalidData
        A plan does not fit the model, or the function raises at one of the plans.
    UnsupportedOption
        The value of an option is not allowed.

    See Also
    --------
    animate_search : Animation of the search for a path.
    draw_progress : Convergence of solutions.
    """
    check_tolerance(tolerance)
    check_option("view", view, view in ("map", "values"), "be 'map' or 'values'")
    check_option("points", points, is_whole(points, 2, 2001), "be a whole number from 2 to 2001")
    named = {} if others is None else others
    is_mapping = isinstance(named, Mapping) and all(isinstance(name, str) for name in named)
    few = is_mapping and len(named) <= _MOST_OTHERS
    check_option("others", others, few, f"be at most {_MOST_OTHERS} plans by their names")
    path = isinstance(model.function, WaypointPath) and view == "map"
    first = {} if plan is None else {"path" if path else "point": plan}
    drawn = [
        _verify_point(model, name, required("plan", model.as_plan(item), BlackBoxPoint), tolerance)
        for name, item in [*first.items(), *named.items()]
    ]
    verification = None if plan is None else drawn[0].found
    text = _title(model, drawn, verification) if title is None else title
    free = np.flatnonzero(model.highs > model.lows)
    if path:
        figure = _draw_path(model, drawn, text, size, main=plan is not None)
    elif len(free) == 2:
        figure = _draw_levels(model, drawn, free, text, size, points, main=plan is not None)
    else:
        figure = _draw_sections(model, drawn, free, text, size, points, main=plan is not None)
    headline(figure, text, wrong=verification is not None and not verification.ok)
    return figure


def _verify_point(
    model: BlackBoxMinimisation, name: str, plan: BlackBoxPoint, tolerance: float
) -> _Point:
    verification = model.verify(plan, tolerance=tolerance)
    return _Point(name, np.array(plan.x), verification)


def _title(
    model: BlackBoxMinimisation, drawn: list[_Point], verification: Verification | None
) -> str:
    parts = [model.describe()]
    if verification is not None and verification.objective is not None:
        parts.append(f"value {number(verification.objective)}")
        if isinstance(model.function, WaypointPath):
            line = model.function.polylines(drawn[0].x[None])[0]
            length = float(np.hypot(*np.diff(line, axis=0).T).sum())
            if verification.objective > length * (1 + 1e-12):
                parts.append(
                    f"of which {number(verification.objective - length)} for what is blocked"
                )
    return title_of(model.name, parts, verification)


def _values(function: BlackBoxFunction, points: Floats) -> Floats:
    """Return the values at `points`, with NaN for no value or an exception."""
    try:
        values = function.values(points)
    except InvalidData:
        values = np.array([_value(function, point) for point in points])
    return np.where(np.isfinite(values), values, np.nan)


def _value(function: BlackBoxFunction, point: Floats) -> float:
    try:
        return float(function.values(point[None])[0])
    except InvalidData:  # becomes a gap in the picture
        return np.nan


def _visible_range(model: BlackBoxMinimisation, drawn: list[_Point], k: int) -> tuple[float, float]:
    """Return the visible range of a variable: the bounds, and points near them."""
    low, high = model.bounds[k].tolist()
    width = (high - low) or 0.5 * (abs(high) or 1.0)
    places = [float(np.clip(point.x[k], low - width, high + width)) for point in drawn]
    lowest, highest = min([low, *places]), max([high, *places])
    return (lowest, highest) if highest > lowest else (low - width, high + width)


def _look(k: int, main: bool) -> dict[str, Any]:
    """Return the marker of point number `k`; the plan's is white."""
    if k == 0 and main:
        return {"marker": "o", "mfc": "white", "mec": BLACK, "ms": 7.0, "mew": 1.3}
    return {"marker": "D", "mfc": axis_style(k)["color"], "mec": "white", "ms": 6.0, "mew": 0.8}


def _name(point: _Point, *, alone: bool) -> str:
    if alone:
        return point.name
    value = point.found.objective
    validity = "" if point.found.ok else ", NOT VALID"
    return f"{point.name}{'' if value is None else f', {number(value)}'}{validity}"


# -- cross-sections ------------------------------------------------------------------------------


def _draw_sections(
    model: BlackBoxMinimisation, drawn: list[_Point], free: NDArray[np.int64], text: str, size: Any,
    points: int, *, main: bool,
) -> Figure:  # fmt: skip
    """Draw the values along each variable through the first point, or the middle of the bounds."""
    from matplotlib.ticker import ScalarFormatter

    chosen = (free if free.size else np.arange(1))[:_MOST].tolist()
    single = len(chosen) == 1
    columns = 1 if single else 2 if len(chosen) <= 4 else 3
    rows = -(-len(chosen) // columns)
    wide, tall = (5.6, 2.9) if single else (2.9 * columns, 1.75 * rows)
    head, foot = 0.48 + 0.17 * text.count("\n"), 0.9
    figure = sheet(size, (wide + 0.4, tall + head + foot))
    broad, tall = figure.get_size_inches()
    figure.subplots_adjust(
        left=min(0.85 / broad, 0.3), right=max(1 - 0.15 / broad, 0.8), wspace=0.42, hspace=0.5,
        bottom=min(foot / tall, 0.4), top=max(1 - head / tall, 0.6),
    )  # fmt: skip
    through = drawn[0].x if drawn else 0.5 * model.lows + 0.5 * model.highs
    panels, places = [], []
    for number_, k in enumerate(chosen):
        axes = figure.add_subplot(rows, columns, number_ + 1)
        panel = _section(model, drawn, k, through, points * (_FINER if single else 1), main=main)
        first, last = _visible_range(model, drawn, k)
        draw_panel(panel, axes, [Span("", first, last, np.empty(0))], wrong=False)
        for bound in model.bounds[k]:
            axes.axvline(bound, color=DARK, ls="--", lw=0.9, zorder=1, gid="bound")
        if max(abs(first), abs(last)) > _NARROW * (last - first):
            axes.xaxis.set_major_formatter(
                ScalarFormatter()
            )  # writes the common part of all ticks once
        axes.set_xlabel(f"x[{k}]", fontsize=8.5)
        if number_ % columns:
            axes.set_ylabel("")
        panels.append(panel)
        places.append(axes)
    keys = [key("bound", color=DARK, ls="--", lw=0.9), *keys_of(panels, places)]
    _legend(figure, keys)
    return figure


def _section(
    model: BlackBoxMinimisation, drawn: list[_Point], k: int, through: Floats, points: int, *,
    main: bool,
) -> Panel:  # fmt: skip
    low, high = model.bounds[k].tolist()
    # Add the point itself, because its well may be narrower than a step.
    along = np.append(np.linspace(low, high, points), np.clip(through[k], low, high))
    along = np.unique(along)
    sample = np.repeat(np.clip(through, model.lows, model.highs)[None], along.size, axis=0)
    sample[:, k] = along
    curve = Curve("value", 0, along, _values(model.function, sample))
    first, last = _visible_range(model, drawn, k)
    marks = []
    for number_, point in enumerate(drawn):
        value = np.nan if point.found.objective is None else point.found.objective
        place = np.clip(point.x[k : k + 1], first, last)
        label = _name(point, alone=len(drawn) == 1 and main)
        marks.append(Mark(label, place, np.array([value]), number_, _look(number_, main)))
    return Panel("value", "", [curve], marks=marks)


# -- maps of levels ------------------------------------------------------------------------------


def _draw_levels(
    model: BlackBoxMinimisation, drawn: list[_Point], free: NDArray[np.int64], text: str, size: Any,
    points: int, *, main: bool,
) -> Figure:  # fmt: skip
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    a, b = free.tolist()
    head, foot = 0.48 + 0.17 * text.count("\n"), 0.95
    figure = sheet(size, (6.0, 4.6 + head + foot - 0.9))
    broad, tall = figure.get_size_inches()
    place = (0.85 / broad, foot / tall, 1 - 2.05 / broad, 1 - (foot + head) / tall)
    axes = figure.add_axes(place)
    along, across = np.linspace(model.lows[[a, b]], model.highs[[a, b]], points).T
    through = drawn[0].x if drawn else model.lows
    sample = np.repeat(np.clip(through, model.lows, model.highs)[None], points * points, axis=0)
    sample[:, a], sample[:, b] = np.tile(along, points), np.repeat(across, points)
    values = _values(model.function, sample).reshape(points, points)
    finite = values[np.isfinite(values)]
    keys = []
    corner, sides = (along[0], across[0]), (along[-1] - along[0], across[-1] - across[0])
    axes.add_patch(Rectangle(corner, *sides, fc=_NONE, ec="none", zorder=0.5, gid="no value"))
    edge = Rectangle(corner, *sides, fc="none", ec=DARK, ls="--", lw=0.9, zorder=1, gid="bound")
    axes.add_patch(edge)
    levels = _levels(finite)
    if levels.size > 1:
        shades = colormaps["YlGnBu_r"](np.linspace(0.05, 0.95, levels.size - 1))
        filled = axes.contourf(along, across, values, levels, colors=shades, zorder=0.7)
        axes.contour(
            along, across, values, levels[1:-1], colors="white", linewidths=0.4, zorder=0.8
        )
        beside = figure.add_axes((1 - 1.05 / broad, place[1], 0.15 / broad, place[3]))
        bar = figure.colorbar(filled, cax=beside, ticks=levels, spacing="uniform")
        bar.ax.set_yticklabels([number(level, 4) for level in levels.tolist()], fontsize=7.5)
        bar.set_label("value", fontsize=8.5)
    elif finite.size:  # the same value everywhere
        axes.contourf(
            along, across, values, [finite[0] - 1, finite[0] + 1], colors=["#c7e9b4"], zorder=0.7
        )
        keys.append(key(f"value {number(float(finite[0]))}", marker="s", color="#c7e9b4", ms=7))
    if finite.size < values.size:
        keys.append(key("no value", marker="s", color=_NONE, ms=7))
    for number_, point in reversed(list(enumerate(drawn))):
        limits = np.array([_visible_range(model, drawn, k) for k in (a, b)])
        spot = np.clip(point.x[[a, b]], limits[:, 0], limits[:, 1])
        axes.plot(
            *spot[:, None], ls="", zorder=9, clip_on=False, gid=point.name, **_look(number_, main)
        )
    for k, limit in ((a, axes.set_xlim), (b, axes.set_ylim)):
        first, last = _visible_range(model, drawn, k)
        limit(first - 0.015 * (last - first), last + 0.015 * (last - first))
    axes.set_xlabel(f"x[{a}]", fontsize=8.5)
    axes.set_ylabel(f"x[{b}]", fontsize=8.5)
    bare(axes)
    axes.grid(visible=False)
    alone = len(drawn) == 1 and main
    keys += [key(_name(point, alone=alone), **_look(k, main)) for k, point in enumerate(drawn)]
    _legend(figure, [key("bound", color=DARK, ls="--", lw=0.9), *keys])
    return figure


def _levels(values: Floats) -> Floats:
    """Return the increasing ends of the levels: equal shares of the values, or equal steps."""
    if not values.size or values.min() == values.max():
        return np.empty(0)
    low, high = float(values.min()), float(values.max())
    shares = np.quantile(values, np.linspace(0, 1, _LEVELS + 1))
    bounds = [low]
    for level in shares[1:-1].tolist():
        if min(level - bounds[-1], high - level) > _APART * (high - low):
            bounds.append(level)
    # Equal shares are uninformative for flat functions with a narrow well or spike.
    result = (
        np.array([*bounds, high])
        if len(bounds) > _LEVELS // 2
        else np.linspace(low, high, _LEVELS // 2 + 1)
    )
    return np.unique(result)


# -- paths ---------------------------------------------------------------------------------------


def _draw_path(
    model: BlackBoxMinimisation, drawn: list[_Point], text: str, size: Any, *, main: bool
) -> Figure:
    """Draw the paths on their map, with the blocked part of the first one in red."""
    function = path_function(model)
    lines = function.polylines(np.array([point.x for point in drawn]).reshape(-1, model.dimension))
    low, high = box_of(function, lines)
    span = high - low
    broad, tall = span * 5.0 / span.max()
    figure = sheet(size, (max(4.8, broad + 0.9), max(2.6, tall + 1.3)))
    broad, tall = figure.get_size_inches()
    scale, unit = length_unit(float(span.max()))
    head, foot = 0.42 + 0.17 * text.count("\n"), 1.0
    axes = figure.add_axes((0.72 / broad, foot / tall, 1 - 0.87 / broad, 1 - (foot + head) / tall))
    dress_map(axes, low * scale, high * scale, unit)
    keys = draw_ends(axes, function, scale)
    alone = len(drawn) == 1 and main
    for k in reversed(range(len(drawn))):
        first = k == 0
        look = {**axis_style(k), "lw": 2.0 if first else 1.3, "zorder": 6 - 0.1 * k}
        line = np.clip(lines[k] * scale, -1e100, 1e100)
        axes.plot(*line.T, gid="path" if first else "other path", **look)
        turns: dict[str, Any] = {"size": 20 if first else 10, "edge": "white", "width": 0.6}
        dots(axes, line[1:-1], "o", look["color"], zorder=7 - 0.1 * k, gid="waypoint", **turns)
    for k, point in enumerate(drawn):
        keys.append(key(_name(point, alone=alone), lw=1.6, **axis_style(k)))
    blocked = blocked_part(function, lines[0]) if drawn else np.full((1, 2), np.nan)
    if np.isfinite(blocked).any():
        axes.plot(*(blocked * scale).T, color=RED, lw=2.4, zorder=6.5, gid="blocked path")
        keys.append(key("through what is blocked", color=RED, lw=2.4))
    _legend(figure, keys)
    return figure


def _legend(figure: Figure, keys: Sequence[Any]) -> None:
    """Write the legend below everything, in as many rows as needed."""
    letters = sum(6 + len(entry.get_label()) for entry in keys)
    legend_below(
        figure, keys, rows=min(len(keys), 1 + int(letters / (_LETTERS * inches(figure)[0])))
    )
