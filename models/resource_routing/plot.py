"""Figure of a route with resources: a map, and the level of each resource.

The left panel shows the points by kind, the route, and listed arcs up to a limit. The right panels show
the level of each resource against the length of the route. A level rises along an arc and may fall at
its head; a bar at each stop marks the limit.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..plots import kit
from .checks import Visit, walk_route
from .model import ResourceRouting
from .route import Route

__all__ = ["animate_route", "draw"]

#: Largest numbers of names and of arcs that are drawn, and of kinds with different markers.
_MOST_LABELS, _MOST_ARCS, _MOST_KINDS = 45, 3000, 8
_MARKERS = ("o", "^", "s", "D", "v", "P", "X", "*")


@kit.documented
def draw(
    model: ResourceRouting,
    plan: Route | None = None,
    *,
    labels: bool | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
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
    """
    result = kit.verified_plan(model, plan, Route, tolerance)
    visits: list[Visit] = [] if plan is None else walk_route(model, plan)[0]
    if labels is None:
        labels = (len(visits) or len(model.kinds)) <= _MOST_LABELS
    kit.check_flags(labels=labels)
    allowed = model.limits * (1.0 + tolerance)
    over = np.array([np.array(v.arrival) > allowed[model.codes[v.point]] for v in visits])
    over = over.reshape(len(visits), len(model.resources))
    over[:1] = False
    where = places_of(model)
    names = [f"point {model.label(point)}" for point in range(len(model.kinds))]
    parts = [model.describe()]
    if result is not None:
        length = result.objective
        parts = ["no length" if length is None else f"length {kit.number(length)}"]
    text = kit.title_of(model, parts, result, title)
    panels = bool(len(visits) > 1 and model.resources and np.isfinite(visits[-1].distance))
    wide = 6.2 * (where is not None or not panels) + 5.4 * panels
    tall = max(4.8, 1.2 + 1.5 * len(model.resources) * panels)
    scene = kit.Scene(text, result, size, (wide, tall))
    beside = panels and where is not None
    left, right = scene.halves(1.15, 1.0) if beside else (scene, scene)
    if panels:
        kit.draw_levels(
            right.figure, np.array([visit.distance for visit in visits]),
            _levels(model, visits, over), label="length of the route (–)", limit="limit there",
            broken="limit exceeded", title=text, wrong=scene.wrong, result=result,
            stops=[names[visit.point] for visit in visits],
        )  # fmt: skip
    if where is not None:
        axes = _draw_map(model, visits, np.asarray(over.any(axis=1)), where, left, labels)
        places = dict(zip(names, where, strict=True))
        for a, b in itertools.pairwise(visit.point for visit in visits):
            places[f"{names[a]}-{model.label(b)}"] = 0.5 * (where[a] + where[b])
        kit.pin_places(axes, result, places)
    elif not panels:
        axes = scene.figure.add_axes((0.1, 0.1, 0.8, 0.7))
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no coordinates and no levels to draw", ha="center", color=kit.DARK)
    return scene.figure


def places_of(model: ResourceRouting) -> kit.Floats | None:
    """Return the drawing positions of the points, shape (n, 2); None without coordinates."""
    if model.points is None or not model.points.shape[1]:
        return None
    flat = np.zeros((len(model.points), 2))
    columns = min(model.points.shape[1], 2)
    flat[:, :columns] = model.points[:, :columns]
    return flat


def _draw_map(
    model: ResourceRouting, visits: list[Visit], bad: NDArray[np.bool_], where: kit.Floats, frame: kit.Frame,
    labels: bool,
) -> Any:  # fmt: skip
    """Draw points, arcs and route, and return the axes."""
    axes = frame.figure.add_axes((0.11, 0.17, 0.85, 0.7))
    kit.dress_map(axes, where.min(axis=0), where.max(axis=0), ("x (–)", "y (–)"))
    if model.arcs is not None and len(model.arcs) <= _MOST_ARCS:
        kit.draw_lines(axes, where[model.arcs], colors="#dcdcdc", lw=0.7, zorder=1)
    visited = [visit.point for visit in visits]
    ends = {model.start: ("start", ">"), model.end: ("end", "s")}
    inner = np.ones(len(where), bool)
    inner[list(ends)] = False
    crowded = len(where) > 60
    white: dict[str, Any] = {"edge": "white", "width": 0.6}
    keys = [kit.key(word, marker=mark, color=kit.BLACK, ms=6) for word, mark in ends.values()]
    for code, word in enumerate(model.words):
        these = np.flatnonzero((model.codes == code) & inner)
        if not these.size:
            continue
        mark, colour = _MARKERS[code % _MOST_KINDS], kit.colour_of(code)
        faint = 0.35 if crowded and visits else 0.8
        kit.dots(axes, where[these], mark, colour, size=9 if crowded else 20, alpha=faint, zorder=2)
        on = these[np.isin(these, visited)]
        kit.dots(axes, where[on], mark, colour, size=42, zorder=5, **white)
        keys.append(kit.key(word, marker=mark, color=colour, ms=5))
    if visits:
        axes.plot(*where[visited].T, color=kit.BLACK, lw=1.5, zorder=4)
    for point, (_, mark) in ends.items():
        kit.dots(axes, where[[point]], mark, kit.BLACK, size=44, zorder=6, **white)
    keys += kit.ring(axes, where[np.array(visited, int)[bad]], "limit exceeded")
    if labels:
        named = list(dict.fromkeys(visited)) or list(range(len(where)))
        texts = [model.label(point) for point in named]
        kit.write_names(axes, where[named], texts, size=7.5, colour=kit.BLACK, route=bool(visits))
    frame.legend(keys, 1 + (len(keys) > 6))
    return axes


def _levels(
    model: ResourceRouting, visits: list[Visit], over: NDArray[np.bool_]
) -> list[kit.Level]:
    """Return the level of each resource at the stops, with its limits."""
    distance = np.array([visit.distance for visit in visits])
    arrive = np.array([visit.arrival for visit in visits]).T
    leave = np.array([visit.leaving for visit in visits]).T
    limits = model.limits[model.codes[[visit.point for visit in visits]]].T
    look = {"marker": "o", "ms": 4, "zorder": 5}
    levels = []
    for row, resource in enumerate(model.resources):
        marks = [kit.Mark("on arrival", distance[1:], arrive[row, 1:], row, look)]
        values = arrive[row], leave[row], limits[row], over[:, row]
        levels.append(kit.Level(resource.name, resource.unit, row, *values, marks))
    return levels


@kit.animated(draw, Route)
def animate_route(model: ResourceRouting, plan: Route | Any, figure: Any) -> Any:
    """Animate the picture of a route: the vehicle on its way, and the levels of its resources.

    The model needs coordinates or resources, and each leg of the route an arc.
    """
    movers, where = kit.curve_movers(figure), places_of(model)
    visits = walk_route(model, plan)[0]
    far = np.array([visit.distance for visit in visits])
    if where is not None and len(far) and np.isfinite(far).all():
        way = where[[visit.point for visit in visits]]
        movers.append(kit.Mover(figure.axes[-1], far, way, kit.RED))
    kit.check_option("plan", plan, bool(movers), "have arcs and something to draw")
    return movers, "distance", ""
