"""Figure of a route with resources: a map, and the level of each resource.

The left panel shows the points by kind, the route, and listed arcs up to a limit. The right panels show
the level of each resource against the length of the route. A level rises along an arc and may fall at
its head; a bar at each stop marks the limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..plots.curves import Curve, Mark, Panel, Span
from ..plots.labels import write_names
from ..plots.maps import dress_map
from ..plots.options import check_flags
from ..plots.panels import draw_panels
from ..plots.space import dots
from ..plots.style import (
    BLACK,
    DARK,
    GREY,
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
from ..verification import TOLERANCE, check_tolerance
from .checks import Visit, walk_route
from .model import ResourceRouting
from .route import Route

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw"]

Floats = NDArray[np.float64]

#: Largest numbers of names and of arcs that are drawn, and of kinds with different markers.
_MOST_LABELS, _MOST_ARCS, _MOST_KINDS = 45, 3000, 8
_MARKERS = ("o", "^", "s", "D", "v", "P", "X", "*")


def draw(
    model: ResourceRouting,
    plan: Route | None = None,
    *,
    labels: bool | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the points of `model`, and `plan` with the levels of its resources.

    Parameters
    ----------
    model : ResourceRouting
        The model. The first two coordinates are drawn; without coordinates, only the levels are.
    plan : Route, optional
        A route, feasible or not; stops that exceed a limit have red rings. None draws the points
        only.
    labels : bool, optional
        Whether to write the names of the visited points, or of all points without a plan. By
        default, up to 45 names are written.
    tolerance : float
        Largest accepted relative violation, used for the title and the rings.
    title : str, optional
        Title; by default the name and the length.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The figure, with axes for the map, and with a plan one axes per resource.

    Raises
    ------
    InvalidData
        The plan is not a route, or names a point that does not exist.
    UnsupportedOption
        An option has an invalid value.
    """
    check_tolerance(tolerance)
    visits: list[Visit] = []
    verification = None
    if plan is not None:
        visits, _ = walk_route(model, required("plan", plan, Route))
        verification = model.verify(plan, tolerance=tolerance)
    if labels is None:
        labels = (len(visits) or len(model.kinds)) <= _MOST_LABELS
    check_flags(labels=labels)
    allowed = model.limits * (1.0 + tolerance)
    over = np.array([np.array(v.arrival) > allowed[model.codes[v.point]] for v in visits])
    over = over.reshape(len(visits), len(model.resources))
    over[:1] = False
    where = places_of(model)
    text = _title(model, verification) if title is None else title
    panels = bool(len(visits) > 1 and model.resources and np.isfinite(visits[-1].distance))
    wide = 6.2 * (where is not None or not panels) + 5.4 * panels
    figure = sheet(size, (wide, max(4.8, 1.2 + 1.5 * len(model.resources) * panels)))
    left: Any = figure
    wrong = verification is not None and not verification.ok
    if panels:
        right: Any = figure
        if where is not None:
            halves: Any = figure.subfigures(1, 2, width_ratios=[1.15, 1.0], wspace=0.0)
            left, right = halves
        _draw_levels(model, visits, over, right, text, wrong)
    if where is not None:
        _draw_map(model, visits, np.asarray(over.any(axis=1)), where, left, labels)
    elif not panels:
        axes: Any = figure.add_axes((0.1, 0.1, 0.8, 0.7))
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no coordinates and no levels to draw", ha="center", color=DARK)
    headline(figure, text, wrong=wrong)
    return figure


def places_of(model: ResourceRouting) -> Floats | None:
    """Return the drawing positions of the points, shape (n, 2); None without coordinates."""
    if model.points is None or not model.points.shape[1]:
        return None
    flat = np.zeros((len(model.points), 2))
    columns = min(model.points.shape[1], 2)
    flat[:, :columns] = model.points[:, :columns]
    return flat


def _title(model: ResourceRouting, found: Any) -> str:
    if found is None:
        return title_of(model.name, [model.describe()], None)
    length = "no length" if found.objective is None else f"length {number(found.objective)}"
    return title_of(model.name, [length], found)


def _draw_map(
    model: ResourceRouting, visits: list[Visit], bad: NDArray[np.bool_], where: Floats, figure: Any,
    labels: bool,
) -> None:  # fmt: skip
    from matplotlib.collections import LineCollection

    axes = figure.add_axes((0.11, 0.17, 0.85, 0.7))
    dress_map(axes, where.min(axis=0), where.max(axis=0), "coordinate")
    axes.set_xlabel("x", fontsize=8.5)
    axes.set_ylabel("y", fontsize=8.5)
    if model.arcs is not None and len(model.arcs) <= _MOST_ARCS:
        lines: Any = where[model.arcs]
        axes.add_collection(
            LineCollection(lines, colors="#dcdcdc", lw=0.7, zorder=1), autolim=False
        )
    visited = [visit.point for visit in visits]
    ends = {model.start: ("start", ">"), model.end: ("end", "s")}
    inner = np.ones(len(where), bool)
    inner[list(ends)] = False
    crowded = len(where) > 60
    keys = [key(word, marker=mark, color=BLACK, ms=6) for word, mark in ends.values()]
    for code, word in enumerate(model.words):
        these = np.flatnonzero((model.codes == code) & inner)
        if not these.size:
            continue
        mark, colour = _MARKERS[code % _MOST_KINDS], axis_style(code)["color"]
        faint = 0.35 if crowded and visits else 0.8
        dots(axes, where[these], mark, colour, size=9 if crowded else 20, alpha=faint, zorder=2)
        on = these[np.isin(these, visited)]
        dots(axes, where[on], mark, colour, size=42, edge="white", width=0.6, zorder=5)
        keys.append(key(word, marker=mark, color=colour, ms=5))
    if visits:
        axes.plot(*where[visited].T, color=BLACK, lw=1.5, zorder=4)
    for point, (_, mark) in ends.items():
        dots(axes, where[[point]], mark, BLACK, size=44, edge="white", width=0.6, zorder=6)
    if bad.any():
        at = where[np.array(visited)[bad]]
        dots(axes, at, "o", "none", size=110, edge=RED, width=1.6, zorder=21)
        keys.append(key("limit exceeded", **RING))
    if labels:
        named = list(dict.fromkeys(visited)) or list(range(len(where)))
        texts = [model.label(point) for point in named]
        write_names(axes, where[named], texts, size=7.5, colour=BLACK, route=bool(visits))
    legend_below(figure, keys, rows=1 + (len(keys) > 6))


def _draw_levels(
    model: ResourceRouting, visits: list[Visit], over: NDArray[np.bool_], figure: Any, title: str,
    wrong: bool,
) -> None:  # fmt: skip
    """Draw the level of each resource along the route, with the limits at each stop."""
    distance = np.array([visit.distance for visit in visits])
    flown = np.repeat(distance, 2)
    arrive = np.array([visit.arrival for visit in visits]).T
    leave = np.array([visit.leaving for visit in visits]).T
    level = np.stack([arrive, leave], axis=2).reshape(len(arrive), -1)
    panels = []
    for row, resource in enumerate(model.resources):
        marks = [
            Mark(
                "on arrival",
                distance[1:],
                arrive[row, 1:],
                row,
                {"marker": "o", "ms": 4, "zorder": 5},
            )
        ]
        if over[:, row].any():
            at = over[:, row]
            marks.append(Mark("limit exceeded", distance[at], arrive[row, at], 0, RING))
        curve = Curve(resource.name, row, flown, level[row], 1.5)
        panels.append(Panel(resource.name, resource.unit, [curve], marks=marks))
    total = float(distance[-1]) or 1.0
    places = draw_panels(
        figure, panels, [Span("", 0.0, total, np.empty(0))], title=title, wrong=wrong,
        label="length of the route", keys=[key("limit there", marker="_", mew=1.6, ms=9, color=DARK)],
    )  # fmt: skip
    half = 0.011 * total
    limits = model.limits[model.codes[[visit.point for visit in visits]]].T
    for row, axes in enumerate(places):
        axes.fill_between(flown, level[row], color=axis_style(row)["color"], alpha=0.12, lw=0)
        held = np.isfinite(limits[row]) & (np.arange(len(visits)) > 0)
        at, most, red = distance[held], limits[row, held], over[held, row]
        bars, stems = ([RED if one else calm for one in red] for calm in (DARK, GREY))
        axes.hlines(most, at - half, at + half, colors=bars, lw=1.6, gid="limit there")
        axes.vlines(at, arrive[row, held], most, colors=stems, lw=0.6, ls=":")
        high = float(np.concatenate([level[row], most]).max(initial=0.0))
        axes.set_ylim(0, 1.12 * high or 1.0)
