"""Plot of paths on a map, with the cells as an image and the violated constraints."""

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

#: Colours of blocked cells and of the region outside the map.
WALL, OUTSIDE = "#4d4d4d", "#b3b3b3"
OUTLINE = axis_style(4)["color"]
#: Maximum number of cells along a side with lines between them, and of corners drawn as dots.
_MOST_LINES, _MOST_DOTS = 60, 80
#: Maximum number of plans beside the first.
_MOST_OTHERS = 12
#: Limit on drawn coordinates, because an invalid plan may have any coordinates.
_FAR = 1e100
#: Ratio of weights above which the colour scale is logarithmic.
_RATIO = 20.0
#: Letters of the legend per inch of the figure's width.
_LETTERS = 15.0
_PLACE = re.compile(
    r"path (\d+)(?:, (segment|point|step) (\d+)|, x (\S+), y (\S+) cells)?(?: cuts a corner)?"
)


@np.errstate(all="ignore")  # the coordinates of an invalid plan may overflow
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
        Model. Weights appear as shades of the free cells.
    plan : GridPlan, optional
        Plan of the model, valid or not. A red ring marks the largest violation of each violated check.
    others : dict of str to plan, optional
        At most 12 further plans of the same model, their JSON data or solutions, such as the path before
        smoothing. The keys are the names in the legend.
    obstacles : list, optional
        Polygons whose outlines are drawn above the cells, in any form that
        :class:`~crosstrack.models.grid_path.Polygons` accepts.
    tolerance : float, default 1e-6
        Largest relative violation accepted for the verdict in the title and the rings.
    title : str, optional
        Title that replaces the name and the length.
    size : (float, float), optional
        Width and height of the figure, inches.

    Returns
    -------
    matplotlib.figure.Figure
        Figure with the map and, if the model has weights, their colour scale.

    Raises
    ------
    InvalidData
        A plan does not fit the model, or the obstacles are not valid polygons.
    UnsupportedOption
        An option is outside its allowed range.

    See Also
    --------
    draw_progress : Progress of solutions over time.
    """
    check_tolerance(tolerance)
    named = {} if others is None else others
    good = isinstance(named, Mapping) and all(isinstance(name, str) for name in named)
    few = good and len(named) <= _MOST_OTHERS
    check_option("others", others, few, f"be at most {_MOST_OTHERS} plans by their names")
    verification = None
    entries: list[tuple[str, GridPlan, Verification]] = []
    if plan is not None:
        verification = model.verify(required("plan", plan, GridPlan), tolerance=tolerance)
        entries.append(("path", plan, verification))
    for name, other in named.items():
        entry = model.as_plan(other)
        entries.append((name, entry, model.verify(entry, tolerance=tolerance)))
    outlines = () if obstacles is None else Polygons().coerce("obstacles", obstacles, {})
    text = _title(model, verification) if title is None else title
    low, high = _box(model.map, [path for _, path, _ in entries])
    span = high - low
    broad, tall = _size(span, weighted=model.weights is not None)
    figure = sheet(size, (broad, tall))
    keys = _keys(model, entries, verification, outlined=bool(outlines))
    broad, tall = figure.get_size_inches()
    letters = sum(6 + len(handle.get_label()) for handle in keys)
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
    for k in reversed(range(len(entries))):
        _draw_paths(model, entries[k][1], axes, scale, k + (plan is None))
    _draw_ends(model, axes, scale)
    places = [] if plan is None or verification is None else _broken(model, plan, verification)
    if len(places):
        dots(
            axes, np.clip(places, -_FAR, _FAR) * scale, "o", "none", size=150, edge=RED, width=1.8,
            zorder=21, gid="worst violation",
        )  # fmt: skip
    legend_below(figure, keys, rows=rows)
    headline(figure, text, wrong=verification is not None and not verification.ok)
    return figure


def _title(model: GridPath, verification: Verification | None) -> str:
    parts = [model.describe()]
    if verification is not None and verification.objective is not None:
        parts.append(f"{number(verification.objective)} m")
    return title_of(model.name, parts, verification)


def _box(grid: GridMap, plans: list[GridPlan]) -> tuple[Floats, Floats]:
    """Return the corners of the visible region, m: the map, and paths outside it up to the map's size."""
    low = grid.origin
    high = low + np.array(grid.shape[::-1]) * grid.cell
    points = [path for plan in plans for path in plan.paths]
    near = np.clip(np.concatenate([low[None], high[None], *points]), 2 * low - high, 2 * high - low)
    return near.min(axis=0), near.max(axis=0)


def _size(span: Floats, *, weighted: bool) -> tuple[float, float]:
    """Return the width and height of a figure for a map of extent `span`, inches."""
    broad, tall = span * 5.6 / span.max()
    beside = 1.6 if weighted else 0.9
    return max(4.8, broad + beside), max(2.6, tall + 1.3)


# -- the map -------------------------------------------------------------------------------------


def _draw_cells(model: GridPath, axes: Any, scale: float) -> Any:
    """Draw the cells and return the image."""
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    grid = model.map
    rows, columns = grid.shape
    # The first line of the image is at the lowest y, even if the y axis is inverted.
    left, foot = grid.origin * scale
    side = grid.cell * scale
    where: dict[str, Any] = {
        "extent": (left, left + columns * side, foot, foot + rows * side), "origin": "lower",
        "interpolation": "none" if max(rows, columns) <= 500 else "auto", "zorder": 0.5,
        "aspect": "equal", "gid": "cells",
    }  # fmt: skip
    # Restore the limits after imshow, which changes them.
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
        lowest, highest = float(free.min()), float(free.max())
        norm = LogNorm if highest > _RATIO * lowest else Normalize
        # Darker shades would look like walls.
        light = ListedColormap(colormaps["YlOrBr"](np.linspace(0.0, 0.75, 256)))
        shades = light.with_extremes(bad=WALL)
        visible = np.ma.masked_array(weights, grid.blocked)
        image = axes.imshow(visible, cmap=shades, norm=norm(lowest, highest), **where)
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
    """Draw the colour scale of the weights and return it."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    if not isinstance(image.norm, LogNorm):
        return figure.colorbar(image, cax=axes)
    lowest, highest = image.get_clim()
    steps = (1.0, 2.0, 5.0) if highest < 1e3 * lowest else (1.0,)
    bar = figure.colorbar(image, cax=axes, ticks=LogLocator(subs=steps))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    return bar


def _draw_outlines(outlines: tuple[Polygon, ...], axes: Any, scale: float) -> None:
    from matplotlib.collections import PolyCollection

    rings = [ring * scale for polygon in outlines for ring in (polygon.shell, *polygon.holes)]
    if rings:
        axes.add_collection(
            PolyCollection(
                rings, facecolor="none", edgecolor=OUTLINE, lw=1.0, zorder=1.5, gid="obstacle"
            ),
            autolim=False,
        )


def _draw_paths(model: GridPath, plan: GridPlan, axes: Any, scale: float, place: int) -> None:
    """Draw the paths of plan number `place`; the first has the thickest line."""
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


# -- violations ----------------------------------------------------------------------------------


def _broken(model: GridPath, plan: GridPlan, verification: Verification) -> list[Floats]:
    """Return the point of the largest violation of every violated check, x, y (m)."""
    places = [_place(model.map, plan, check) for check in verification.violated]
    return [place for place in places if place is not None]


def _place(grid: GridMap, plan: GridPlan, check: Check) -> Floats | None:
    words = _PLACE.fullmatch(check.where)
    if words is None:
        return None
    path = plan.paths[int(words[1])]
    if words[4]:
        corner: Floats = grid.origin + np.array([float(words[4]), float(words[5])]) * grid.cell
        return corner
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
    model: GridPath, entries: list[tuple[str, GridPlan, Verification]], verification: Verification | None,
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
    alone = len(entries) == 1 and verification is not None
    for k, (name, _, checked) in enumerate(entries):
        cost = "" if alone or checked.objective is None else f", {number(checked.objective)} m"
        wrong = "" if checked.ok or alone else ", NOT VALID"
        keys.append(key(f"{name}{cost}{wrong}", **_look(k + (verification is None))))
    if verification is not None and not verification.ok:
        keys.append(key("worst violation", **RING))
    return keys
