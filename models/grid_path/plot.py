"""Plot of paths on a map, with the cells as an image and the violated constraints."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..plots import kit
from ..plots.progress import draw_progress
from ..verification import Check
from .gridmap import GridMap
from .model import GridPath
from .plan import GridPlan
from .polygons import Polygons, as_shapely

__all__ = ["animate_paths", "draw", "draw_progress"]

#: Colours of blocked cells, of the region outside the map and of outlines.
WALL, OUTSIDE, OUTLINE = "#4d4d4d", "#b3b3b3", kit.colour_of(4)
#: Maximum number of cells along a side with lines between them, and of corners drawn as dots.
_MOST_LINES, _MOST_DOTS = 60, 80
#: Maximum number of plans beside the first.
_MOST_OTHERS = 12
#: Ratio of weights above which the colour scale is logarithmic.
_RATIO = 20.0
_PLACE = re.compile(
    r"path (\d+)(?:, (segment|point|step) (\d+)|, x (\S+), y (\S+) cells)?(?: cuts a corner)?"
)


@kit.documented
@np.errstate(all="ignore")  # the coordinates of an invalid plan may overflow
def draw(
    model: GridPath,
    plan: GridPlan | None = None,
    *,
    others: Mapping[str, Any] | None = None,
    obstacles: Any = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the map of `model`, and the paths of `plan`; :func:`draw_progress` draws the convergence of solutions.

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
    """
    plans = kit.name_plans(
        model, plan, others, GridPlan, name="path", most=_MOST_OTHERS, tolerance=tolerance
    )
    verification = None if plan is None else plans[0].result
    outlines = () if obstacles is None else Polygons().coerce("obstacles", obstacles, {})
    parts = [model.describe()]
    if verification is not None and verification.objective is not None:
        parts.append(f"{kit.number(verification.objective)} m")
    text = kit.title_of(model, parts, verification, title)
    grid, weighted = model.map, model.weights is not None
    points = [path for entry in plans for path in entry.plan.paths]
    low, high = kit.box_near(*kit.corners_of(grid), points)
    broad, tall = (high - low) * 5.6 / (high - low).max()
    default = max(4.8, broad + (1.6 if weighted else 0.9)), max(2.6, tall + 1.3)
    scene = kit.Scene(text, verification, size, default)
    # The number of rows of the legend, which is written last, determines the height of the map.
    keys = [kit.key("blocked", marker="s", mfc=WALL, mec=WALL, ms=7)]
    keys += [kit.key("obstacle", color=OUTLINE, lw=1.0)] * bool(outlines)
    looks = [_look(k + (plan is None)) for k in range(len(plans))]
    keys += [
        kit.key(label, **look)
        for label, look in zip(kit.label_plans(plans, plan, unit=" m"), looks, strict=True)
    ]
    keys += [kit.key("worst violation", **kit.RING)] * scene.wrong
    ends = [kit.key("start"), kit.key("goals" if len(model.goals) > 1 else "goal")]
    rows = kit.legend_rows([*ends, *keys], scene.broad)
    right, foot = 1.0 if weighted else 0.15, 0.6 + kit.LINE * rows
    axes = scene.axes(0.72, foot, right, scene.head)
    scale = kit.dress_map(axes, low, high)
    axes.grid(visible=False)
    if not grid.upward:
        kit.turn_down(axes)
    image = _draw_cells(model, axes, scale)
    if weighted:
        beside = scene.axes(scene.broad - 0.85, foot, 0.71, scene.head)
        _draw_scale(scene.figure, image, beside)
    if outlines:
        look: dict[str, Any] = {"fc": "none", "ec": OUTLINE, "lw": 1.0, "zorder": 1.5}
        kit.draw_polygons(axes, as_shapely(outlines), scale, gid="obstacle", **look)
    for k in reversed(range(len(plans))):
        _draw_paths(model, plans[k].plan, axes, scale, k + (plan is None))
    start, goals = (grid.centres(cells) * scale for cells in (model.start[None], model.goals))
    keys = kit.draw_ends(axes, start, goals) + keys
    if plan is not None and verification is not None:
        kit.pin_places(axes, verification, lambda check: _place(grid, plan, check), scale)
        places = [_place(grid, plan, check) for check in verification.violated]
        kit.ring(axes, [place * scale for place in places if place is not None], "worst violation")
    scene.legend(keys, rows)
    return scene.figure


def _draw_cells(model: GridPath, axes: Any, scale: float) -> Any:
    """Draw the cells and return the image."""
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    grid = model.map
    rows, columns = grid.shape
    # The first line of the image is at the lowest y, even if the y axis is inverted.
    (left, foot), (right, top) = (corner * scale for corner in kit.corners_of(grid))
    where: dict[str, Any] = {
        "extent": (left, right, foot, top), "origin": "lower",
        "interpolation": "none" if max(rows, columns) <= 500 else "auto", "zorder": 0.5,
        "aspect": "equal", "gid": "cells",
    }  # fmt: skip
    # Restore the limits after imshow, which changes them.
    limits = axes.axis()
    axes.set_facecolor(OUTSIDE)
    if model.weights is None:
        image = axes.imshow(
            grid.blocked, cmap=ListedColormap(["white", WALL]), vmin=0, vmax=1, **where
        )
    else:
        from matplotlib import colormaps

        weights = np.clip(model.weights, 1 / kit.FAR, kit.FAR)
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
        axes.vlines(np.linspace(left, right, columns + 1), foot, top, **look)
        axes.hlines(np.linspace(foot, top, rows + 1), left, right, **look)
    axes.axis(limits)
    return image


def _draw_scale(figure: kit.Figure, image: Any, axes: Any) -> None:
    """Draw the colour scale of the weights."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    if not isinstance(image.norm, LogNorm):
        kit.color_bar(figure, image, axes, "cost of a metre (–)")
        return
    lowest, highest = image.get_clim()
    steps = (1.0, 2.0, 5.0) if highest < 1e3 * lowest else (1.0,)
    bar = kit.color_bar(figure, image, axes, "cost of a metre (–)", ticks=LogLocator(subs=steps))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))


def _draw_paths(model: GridPath, plan: GridPlan, axes: Any, scale: float, place: int) -> None:
    """Draw the paths of plan number `place`; the first has the thickest line."""
    look = {**_look(place), "solid_capstyle": "round", "zorder": 6 - 0.1 * place}
    for path in plan.paths:
        points = np.clip(path * scale, -kit.FAR, kit.FAR)
        axes.plot(*points.T, gid="path" if not place else "other path", **look)
        steps = np.diff(points, axis=0)
        along = (steps[1:] * steps[:-1]).sum(axis=1)
        across = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
        corners = points[1:-1][(np.abs(across) > 1e-9 * np.abs(along)) | (along < 0)]
        if model.connectivity == "any" and 0 < len(corners) <= _MOST_DOTS:
            kit.dots(
                axes, corners, "o", look["color"], size=14 if not place else 8, edge="white",
                width=0.5, zorder=look["zorder"] + 0.05, gid="corner",
            )  # fmt: skip


def _look(place: int) -> dict[str, Any]:
    return {**kit.axis_style(place), "lw": 2.0 if not place else 1.4}


def _place(grid: GridMap, plan: GridPlan, check: Check) -> kit.Floats | None:
    words = _PLACE.fullmatch(check.where)
    if words is None:
        return None
    path = plan.paths[int(words[1])]
    if words[4]:
        corner: kit.Floats = grid.origin + np.array([float(words[4]), float(words[5])]) * grid.cell
        return corner
    if not words[2]:
        return np.asarray(path[-1 if check.name.startswith("ends") else 0])
    k = int(words[3])
    if words[2] == "point" or k + 1 >= len(path):
        return np.asarray(path[min(k, len(path) - 1)])
    way = path[k] + np.linspace(0, 1, 1001)[:, None] * (path[k + 1] - path[k])
    inside = np.flatnonzero(~grid.holds(grid.cells_of(np.clip(way, -1e15, 1e15))))
    return np.asarray(way[inside[len(inside) // 2] if inside.size else 500])


@kit.animated(draw, GridPlan)
def animate_paths(model: GridPath, plan: GridPlan | Any, figure: Any) -> Any:
    """Animate the picture of a plan: an agent on each path, at the same speed."""
    axes: Any = figure.axes[0]
    paths = [line.get_xydata() for line in axes.lines if line.get_gid() == "path"]
    return kit.route_movers(axes, paths), "distance", kit.unit_of(axes)
