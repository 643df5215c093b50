"""The picture of paths on a map: its cells as an image, with what the paths break."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..plots.maps import dress_map, length_unit
from ..plots.options import check_option
from ..plots.progress import draw_progress
from ..plots.space import dots
from ..plots.style import (
    BLACK,
    RED,
    RING,
    axis_style,
    headline,
    key,
    legend_below,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .gridmap import GridMap
from .model import GridPath
from .plan import GridPlan
from .polygons import Polygon, Polygons

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw", "draw_progress"]

Floats = NDArray[np.float64]

#: Blocked cells, and what lies outside of the map.
WALL, OUTSIDE = "#4d4d4d", "#b3b3b3"
OUTLINE = axis_style(4)["color"]
#: More cells than this along a side are not told apart by lines, more points no dots.
_MOST_LINES, _MOST_DOTS = 60, 80
#: Plans that are drawn at the most beside the first.
_MOST_OTHERS = 12
#: Farther away nothing is drawn: an invalid plan may lead anywhere.
_FAR = 1e100
#: From what ratio of weights on their shades are told apart by their logarithms.
_RATIO = 20.0
#: Letters of a line of the legend on an inch of the figure.
_LETTERS = 15.0
_PLACE = re.compile(
    r"path (\d+)(?:, (segment|point|step) (\d+)|, x (\S+), y (\S+) cells)?(?: cuts a corner)?"
)


@np.errstate(all="ignore")  # an invalid plan may lead beyond the range of numbers
def draw(
    model: GridPath,
    plan: GridPlan | None = None,
    *,
    others: Mapping[str, Any] | None = None,
    obstacles: Any = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the map of `model`, and the paths of `plan`.

    Parameters
    ----------
    model : GridPath
        The model; weights are shades of free cells.
    plan : GridPlan, optional
        A plan for it, valid or not; the worst place of each rule that it breaks is ringed in red.
    others : dict of str to plan, optional
        Further plans for the same model by what the legend calls them, such as the path before it was
        smoothed: plans, their JSON data or solutions.
    obstacles : list, optional
        Polygons whose outlines are drawn above the cells, in any form that
        :class:`~crosstrack.models.grid_path.Polygons` takes.
    tolerance : float
        Largest violation accepted, relative, for what the title says and what is ringed.
    title : str, optional
        Instead of the name and the length.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        With one map, and the scale of the weights where there are some.

    Raises
    ------
    InvalidData
        A plan is none of this model, or the obstacles are no polygons.
    UnsupportedOption
        An option has a value that is not allowed.

    See Also
    --------
    draw_progress : How solutions came about.
    """
    check_tolerance(tolerance)
    named = {} if others is None else others
    good = isinstance(named, Mapping) and all(isinstance(name, str) for name in named)
    few = good and len(named) <= _MOST_OTHERS
    check_option("others", others, few, f"be at most {_MOST_OTHERS} plans by their names")
    found = None
    drawn: list[tuple[str, GridPlan, Verification]] = []
    if plan is not None:
        found = model.verify(required("plan", plan, GridPlan), tolerance=tolerance)
        drawn.append(("path", plan, found))
    for name, other in named.items():
        held = model.as_plan(other)
        drawn.append((name, held, model.verify(held, tolerance=tolerance)))
    outlines = () if obstacles is None else Polygons().coerce("obstacles", obstacles, {})
    text = _title(model, found) if title is None else title
    low, high = _box(model.map, [one for _, one, _ in drawn])
    span = high - low
    broad, tall = _size(span, weighted=model.weights is not None)
    figure = sheet(size, (broad, tall))
    keys = _keys(model, drawn, found, outlined=bool(outlines))
    broad, tall = figure.get_size_inches()
    letters = sum(6 + len(one.get_label()) for one in keys)
    rows = min(len(keys), 1 + int(letters / (_LETTERS * broad)))
    below, right = 0.6 + 0.17 * rows, (1.0 if model.weights is not None else 0.15)
    head = 0.42 + 0.17 * text.count("\n")
    place = (0.72 / broad, below / tall, 1 - (0.72 + right) / broad, 1 - (below + head) / tall)
    axes = figure.add_axes(place)
    scale, unit = length_unit(float(span.max()))
    dress_map(axes, low * scale, high * scale, unit)
    axes.grid(visible=False)
    if not model.map.upward:
        axes.invert_yaxis()
    image = _draw_cells(model, axes, scale)
    if model.weights is not None:
        beside = figure.add_axes((1 - 0.85 / broad, place[1], 0.14 / broad, place[3]))
        bar = _draw_scale(figure, image, beside)
        bar.set_label("cost of a metre", fontsize=8.5)
        bar.ax.tick_params(labelsize=8)
        bar.outline.set_visible(False)
    _draw_outlines(outlines, axes, scale)
    for k in reversed(range(len(drawn))):
        _draw_paths(model, drawn[k][1], axes, scale, k + (plan is None))
    _draw_ends(model, axes, scale)
    places = [] if plan is None or found is None else _broken(model, plan, found)
    if len(places):
        dots(
            axes, np.clip(places, -_FAR, _FAR) * scale, "o", "none", size=150, edge=RED, width=1.8,
            zorder=21, gid="worst violation",
        )  # fmt: skip
    legend_below(figure, keys, rows=rows)
    headline(figure, text, wrong=found is not None and not found.ok)
    return figure


def _title(model: GridPath, found: Verification | None) -> str:
    parts = [model.describe()]
    if found is not None and found.objective is not None:
        parts.append(f"{number(found.objective)} m")
    return title_of(model.name, parts, found)


def _box(grid: GridMap, plans: list[GridPlan]) -> tuple[Floats, Floats]:
    """Return the corners of what is shown, m: the map, and paths that leave it by less than its size."""
    low = grid.origin
    high = low + np.array(grid.shape[::-1]) * grid.cell
    points = [path for plan in plans for path in plan.paths]
    near = np.clip(np.concatenate([low[None], high[None], *points]), 2 * low - high, 2 * high - low)
    return near.min(axis=0), near.max(axis=0)


def _size(span: Floats, *, weighted: bool) -> tuple[float, float]:
    """Return width and height (inch) of a figure for a map of this extent."""
    broad, tall = span * 5.6 / span.max()
    beside = 1.6 if weighted else 0.9
    return max(4.8, broad + beside), max(2.6, tall + 1.3)


# -- the map -------------------------------------------------------------------------------------


def _draw_cells(model: GridPath, axes: Any, scale: float) -> Any:
    """Draw the cells, and return the image."""
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    grid = model.map
    rows, columns = grid.shape
    # The image's first line is at the least y, whichever way that is drawn.
    left, foot = grid.origin * scale
    side = grid.cell * scale
    where: dict[str, Any] = {
        "extent": (left, left + columns * side, foot, foot + rows * side), "origin": "lower",
        "interpolation": "none" if max(rows, columns) <= 500 else "auto", "zorder": 0.5,
        "aspect": "equal", "gid": "cells",
    }  # fmt: skip
    # Setting an image moves the limits, which are final.
    limits = axes.get_xlim(), axes.get_ylim()
    axes.set_facecolor(OUTSIDE)
    if model.weights is None:
        image = axes.imshow(
            grid.blocked, cmap=ListedColormap(["white", WALL]), vmin=0, vmax=1, **where
        )
    else:
        from matplotlib import colormaps

        weights = np.clip(model.weights, 1 / _FAR, _FAR)
        free = weights[~grid.blocked]
        least, most = float(free.min()), float(free.max())
        norm = LogNorm if most > _RATIO * least else Normalize
        # What is darker is not told from walls.
        light = ListedColormap(colormaps["YlOrBr"](np.linspace(0.0, 0.75, 256)))
        shades = light.with_extremes(bad=WALL)
        shown = np.ma.masked_array(weights, grid.blocked)
        image = axes.imshow(shown, cmap=shades, norm=norm(least, most), **where)
    if max(rows, columns) <= _MOST_LINES:
        look: dict[str, Any] = {"color": "#9a9a9a", "lw": 0.35, "zorder": 0.6}
        across = left + side * np.arange(columns + 1)
        along = foot + side * np.arange(rows + 1)
        axes.vlines(across, along[0], along[-1], **look)
        axes.hlines(along, across[0], across[-1], **look)
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])
    return image


def _draw_scale(figure: Figure, image: Any, axes: Any) -> Any:
    """Draw the scale of the weights, and return it."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    if not isinstance(image.norm, LogNorm):
        return figure.colorbar(image, cax=axes)
    least, most = image.get_clim()
    steps = (1.0, 2.0, 5.0) if most < 1e3 * least else (1.0,)
    bar = figure.colorbar(image, cax=axes, ticks=LogLocator(subs=steps))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    return bar


def _draw_outlines(outlines: tuple[Polygon, ...], axes: Any, scale: float) -> None:
    from matplotlib.collections import PolyCollection

    rings = [ring * scale for one in outlines for ring in (one.shell, *one.holes)]
    if rings:
        axes.add_collection(
            PolyCollection(
                rings, facecolor="none", edgecolor=OUTLINE, lw=1.0, zorder=1.5, gid="obstacle"
            ),
            autolim=False,
        )


def _draw_paths(model: GridPath, plan: GridPlan, axes: Any, scale: float, place: int) -> None:
    """Draw the paths of the plan number `place`; the first is the broadest."""
    look = {**_look(place), "solid_capstyle": "round", "zorder": 6 - 0.1 * place}
    for path in plan.paths:
        points = np.clip(path * scale, -_FAR, _FAR)
        axes.plot(*points.T, gid="path" if not place else "other path", **look)
        steps = np.diff(points, axis=0)
        along, across = (
            (steps[1:] * steps[:-1]).sum(axis=1),
            steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0],
        )
        corners = points[1:-1][(np.abs(across) > 1e-9 * np.abs(along)) | (along < 0)]
        if model.connectivity == "any" and 0 < len(corners) <= _MOST_DOTS:
            dots(
                axes, corners, "o", look["color"], size=14 if not place else 8, edge="white",
                width=0.5, zorder=look["zorder"] + 0.05, gid="corner",
            )  # fmt: skip


def _look(place: int) -> dict[str, Any]:
    return {**axis_style(place), "lw": 2.0 if not place else 1.4}


def _draw_ends(model: GridPath, axes: Any, scale: float) -> None:
    start = model.map.centres(model.start)[None] * scale
    goals = model.map.centres(model.goals) * scale
    dots(axes, goals, "*", "white", size=110, edge=BLACK, width=1.0, zorder=8, gid="goal")
    dots(axes, start, "o", "white", size=42, edge=BLACK, width=1.2, zorder=9, gid="start")


# -- what is broken ------------------------------------------------------------------------------


def _broken(model: GridPath, plan: GridPlan, found: Verification) -> list[Floats]:
    """Return the worst place of every rule that is broken, x, y (m)."""
    places = [_place(model.map, plan, check) for check in found.violated]
    return [place for place in places if place is not None]


def _place(grid: GridMap, plan: GridPlan, check: Check) -> Floats | None:
    words = _PLACE.fullmatch(check.where)
    if words is None:
        return None
    path = plan.paths[int(words[1])]
    if words[4]:
        found: Floats = grid.origin + np.array([float(words[4]), float(words[5])]) * grid.cell
        return found
    if not words[2]:
        return np.asarray(path[-1 if check.name.startswith("ends") else 0])
    k = int(words[3])
    if words[2] == "point" or k + 1 >= len(path):
        return np.asarray(path[min(k, len(path) - 1)])
    way = path[k] + np.linspace(0, 1, 1001)[:, None] * (path[k + 1] - path[k])
    inside = np.flatnonzero(~grid.holds(grid.cells_of(np.clip(way, -1e15, 1e15))))
    return np.asarray(way[inside[len(inside) // 2] if inside.size else 500])


# -- words ---------------------------------------------------------------------------------------


def _keys(
    model: GridPath, drawn: list[tuple[str, GridPlan, Verification]], found: Verification | None,
    *, outlined: bool,
) -> list[Any]:  # fmt: skip
    several = len(model.goals) > 1
    keys = [
        key("start", marker="o", mfc="white", mec=BLACK, ms=6),
        key("goals" if several else "goal", marker="*", mfc="white", mec=BLACK, ms=9),
        key("blocked", marker="s", mfc=WALL, mec=WALL, ms=7),
    ]
    if outlined:
        keys.append(key("obstacle", color=OUTLINE, lw=1.0))
    alone = len(drawn) == 1 and found is not None
    for k, (name, _, held) in enumerate(drawn):
        cost = "" if alone or held.objective is None else f", {number(held.objective)} m"
        wrong = "" if held.ok or alone else ", NOT VALID"
        keys.append(key(f"{name}{cost}{wrong}", **_look(k + (found is None))))
    if found is not None and not found.ok:
        keys.append(key("worst violation", **RING))
    return keys
