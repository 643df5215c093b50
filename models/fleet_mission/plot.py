"""Figure of a mission: curves among obstacles, their lengths, and limited quantities over time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...errors import UnsupportedOption
from ..fields import required
from ..fleet import Deviation
from ..grid_path import as_shapely, trail
from ..plots import kit
from ..verification import Check, Verification
from .curves import lengths_of
from .model import FleetMission
from .panels import curve_of, panels_of, sample_times
from .plan import MissionPlan

__all__ = ["animate_mission", "draw"]

#: Parts of the figure: on the left, and over time on the right.
_LEFT, _RIGHT = ("map", "loads"), ("timeline", "velocity", "acceleration", "distance")
_PARTS = (*_LEFT, *_RIGHT)
#: Layers of the map: label and dashes.
_LAYERS: dict[str, tuple[str, Any]] = {
    "cells": ("blocked cell", None),
    "grid": ("path on the grid", (0, (1, 1))),
    "smoothed": ("shortened by lines of sight", (0, (5, 2))),
    "curve": ("curve that is flown", None),
}
#: Largest number of nodes that are named by default.
_MOST_NAMES = 40
#: Colour of blocked cells, beside that of obstacles.
_CELL = "#f0d9b5"
#: Largest extension of the map beyond the bounds, as a share of their size.
_BEYOND = 0.25
#: Patterns of the robots and of a part of a curve in the text of a check.
_WHO = re.compile(r"robots? (\d+)(?: and (\d+))?")
_PART = re.compile(r", (segment|stop) (\d+)$")


@kit.documented
@np.errstate(all="ignore")  # an infeasible plan may overflow
def draw(
    model: FleetMission,
    plan: MissionPlan | None = None,
    *,
    parts: Sequence[str] | None = None,
    layers: Sequence[str] = ("curve",),
    labels: bool | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw obstacles and nodes of `model`, and the curves of `plan` with limited quantities.

    The map and the bars are on the left, panels over time on the right. :func:`animate_mission` shows
    the same plan in motion.

    Parameters
    ----------
    plan : MissionPlan, optional
        A plan for the model, feasible or not. Nodes not visited exactly once and the largest
        violations are ringed in red. None draws obstacles and nodes only.
    parts : sequence of {"map", "loads", "timeline", "velocity", "acceleration", "distance"}, optional
        What to draw: the map, the lengths of the curves as bars, and over time the distance of each
        robot from the depot, the components of velocity and acceleration with their limits, and the
        least distance of two robots under way. All parts but the timeline by default.
    layers : sequence of {"cells", "grid", "smoothed", "curve"}
        What to draw on the map: the blocked cells of the model's map; shortest paths over its cells
        for the plan's routes; these paths shortened by lines of sight (Algorithm 4); and the curves.
        The paths are recomputed for the figure, independently of the planner.
    labels : bool, optional
        Whether to name the nodes; by default, up to 40 nodes are named.
    """
    shown = [part for part in _PARTS if part != "timeline"] if plan is not None else ["map"]
    if parts is not None:
        shown = kit.check_words("parts", parts, _PARTS)
        if plan is None and shown != ["map"]:
            raise UnsupportedOption("parts can hold more than 'map' only with a plan")
    drawn_layers = kit.check_words("layers", layers, tuple(_LAYERS))
    kit.check_flags(optional=True, labels=labels)
    result = kit.verified_plan(model, plan, MissionPlan, tolerance)
    text = kit.title_of(model, _words(model, plan, result), result, title)
    left, right = ([part for part in side if part in shown] for side in (_LEFT, _RIGHT))
    panels = []
    if plan is not None and right:
        panels = list(panels_of(model, plan, right, tolerance, named=not left))
    bars = min(2.6, 0.5 + 0.24 * len(plan.routes)) if plan is not None and "loads" in left else 0.0
    below = bars + 0.9 * bool(bars)
    tall = below + 6.4 * ("map" in left) + 0.5 * (left == ["loads"])
    widths = [6.6] * bool(left) + [5.8] * bool(right)
    scene = kit.Scene(text, result, size, (sum(widths), max(tall, 1.4 + 1.3 * len(panels))))
    sides: Sequence[kit.Frame] = scene.halves(*widths) if len(widths) > 1 else [scene]
    foot = 0.0
    if plan is not None and "loads" in left:
        high = bars if "map" in left else scene.tall - scene.head - 0.8
        _draw_bars(model, plan, sides[0], high)
        foot = high + 0.9
    if "map" in left:
        rows = 2 if drawn_layers == ["curve"] else 3
        axes = sides[0].axes(0.74, foot + 0.56 + kit.LINE * rows, 0.16, scene.head)
        keys = _draw_map(model, plan, result, axes, drawn_layers, labels)
        if plan is not None and not foot:
            keys += kit.name_vehicles(len(plan.routes), "robot")
        sides[0].legend(keys, rows if len(keys) > 5 else 1, y=foot + 0.06)
    if panels:
        assert plan is not None
        places = kit.draw_panels(
            sides[-1].figure, panels, [kit.Span("", 0.0, plan.end or 1.0)], title=text,
            wrong=scene.wrong, label="time (s)", mesh=False,
        )  # fmt: skip
        kit.pin_curves(result, lambda check: curve_of(check, places, panels))
    return scene.figure


def _words(model: FleetMission, plan: MissionPlan | None, result: Verification | None) -> list[str]:
    """Return the parts of the title."""
    if plan is None or result is None or result.objective is None:
        return [model.describe()]
    what = str(model.objective)
    if what.startswith("sum-"):
        what = f"sum + {kit.number(model.q, 4)} × {what.partition('-')[2]}"
    parts = [kit.many(model.vehicles, "robot"), kit.many(len(model.nodes), "node")]
    value = f"{what} {kit.number(result.objective)} {model.objective_unit}"
    return [*parts, value, f"{kit.number(plan.end, 5)} s"][: 3 if what == "makespan" else None]


# -- the map and the bars ------------------------------------------------------------------------


def _draw_bars(model: FleetMission, plan: MissionPlan, frame: kit.Frame, high: float) -> None:
    """Draw the lengths of the curves as bars of the height `high` (inch)."""
    axes = frame.box(0.84, 0.74, frame.broad - 1.0, high)
    lengths = [0.0 if item is None else lengths_of(item).sum() for item in plan.trajectories]
    loads, spread = np.array(lengths), None
    if len(loads) > 1:
        spread = float(np.std(loads, ddof=int(model.deviation is Deviation.SAMPLE)))
    names = [f"robot {k}" for k in range(len(loads))]
    keys = kit.draw_loads(axes, loads, "length of curve (m)", names=names, deviation=spread)
    frame.legend(keys, 1, y=0.06)


def _draw_map(
    model: FleetMission, plan: MissionPlan | None, result: Verification | None, axes: Any,
    layers: list[str], labels: bool | None,
) -> list[Any]:  # fmt: skip
    """Draw obstacles, layers and nodes, and return the entries of the legend."""
    curves: list[kit.Floats] = []
    if plan is not None:
        times = ((item, sample_times(item)) for item in plan.trajectories)
        curves = [np.empty((0, 2)) if item is None else item(at) for item, at in times]
        curves = [np.clip(np.nan_to_num(curve), -kit.FAR, kit.FAR) for curve in curves]
    low, high = model.bounds[:2], model.bounds[2:]
    flown = np.concatenate([model.bounds.reshape(2, 2), *curves])
    far = _BEYOND * (high - low)
    low = np.maximum(np.minimum(low, flown.min(axis=0)), low - far)
    high = np.minimum(np.maximum(high, flown.max(axis=0)), high + far)
    scale = kit.dress_map(axes, low, high)
    keys = draw_field(axes, model, scale)
    if "cells" in layers:
        kit.draw_cells(axes, model.map, scale, colour=_CELL)
        keys.append(kit.key("blocked cell", marker="s", color=_CELL, ms=7))
    owners = np.full(len(model.nodes), -1)
    missed = np.empty((0, 2))
    if plan is not None:
        for k, route in enumerate(plan.routes):
            owners[list(route)] = k
        visits = [node for route in plan.routes for node in route]
        missed = model.nodes[np.bincount(visits, minlength=len(model.nodes)) != 1]
        ways = [name for name in ("grid", "smoothed", "curve") if name in layers]
        for name in ways:
            label, dashes = _LAYERS[name]
            lines, look = curves, {"lw": 1.7}
            if name != "curve":
                lines = [_trail(model, route, name == "smoothed") for route in plan.routes]
                dotted: dict[str, Any] = {"lw": 1.1, "linestyles": [dashes] * len(lines)}
                look = dotted if len(ways) > 1 else {}
            kit.draw_routes(axes, [line * scale for line in lines], gid=label, **look)
            if ways != ["curve"]:
                width = look.get("lw", 1.6)
                keys.append(kit.key(label, color=kit.DARK, lw=width, ls=dashes or "-"))
    keys += _draw_moving(axes, model, scale, discs=True)
    home, nodes = model.depot[None] * scale, model.nodes * scale
    keys += kit.draw_stops(axes, nodes, owners, home, missed * scale)
    if plan is not None and result is not None:
        keys += kit.ring(axes, _broken_places(model, plan, result) * scale, "worst violation")
        kit.pin_places(axes, result, lambda check: [*_places_of(model, plan, check)] or None, scale)
    if labels if labels is not None else len(model.nodes) <= _MOST_NAMES:
        names = [model.label(node) for node in range(len(model.nodes))]
        kit.write_names(axes, nodes, names, size=7.5, colour=kit.BLACK, route=False)
    return keys


def _trail(model: FleetMission, route: Sequence[int], straightened: bool) -> kit.Floats:
    """Return the shortest path over the map for a route with the depot at both ends, m."""
    if not len(route):
        return np.empty((0, 2))
    stops = np.concatenate([model.depot[None], model.nodes[list(route)], model.depot[None]])
    return trail(model.map, stops, straightened=straightened)


def _broken_places(model: FleetMission, plan: MissionPlan, result: Verification) -> kit.Floats:
    """Return the positions of the robots at the largest violation of each check, m, shape (k, 2)."""
    places = [place for check in result.violated for place in _places_of(model, plan, check)]
    broken = np.array(places).reshape(-1, 2)
    return broken[(np.abs(broken) < kit.FAR).all(axis=1)]


def _places_of(model: FleetMission, plan: MissionPlan, check: Check) -> Iterator[kit.Floats]:
    """Yield the node that a check names, or the positions of its robots at its time or at their ends."""
    names = [f"node {model.label(node)}" for node in range(len(model.nodes))]
    if check.where in names:
        yield model.nodes[names.index(check.where)]
    who, time = _WHO.search(check.where), kit.time_of(check)
    part = _PART.search(check.where)
    for robot in map(int, filter(None, who.groups() if who else ())):
        entry = plan.trajectories[robot] if robot < len(plan.trajectories) else None
        if entry is None:
            continue
        if part is not None and time is None:
            # The middle of a segment, or the beginning of the way to the next stop.
            stops = np.concatenate([entry.times[:1], plan.visits[robot], entry.times[-1:]])
            middles = entry.times[:-1] + 0.5 * entry.durations
            times = stops if part[1] == "stop" else middles
            time = float(times[min(int(part[2]), len(times) - 1)])
        if time is not None:
            yield entry(np.clip(time, entry.times[0], entry.times[-1]))
        elif check.where.endswith((", start", ", end")):
            yield entry(entry.times[0 if check.where.endswith("start") else -1])


# -- obstacles, and the mission in motion --------------------------------------------------------

#: Colours of the area closer to an obstacle than a robot's radius, and of moving obstacles.
_NEAR, _MOVING = "#ececec", "#b8b8b8"


def draw_field(axes: Any, model: FleetMission, scale: float) -> list[Any]:
    """Draw the obstacles, their safety margin and the bounds; return legend entries."""
    import shapely

    keys = []
    if model.radius > 0 and len(model.solids.parts):
        grown = shapely.union_all(shapely.buffer(model.solids.parts, model.radius))
        near = {"fc": _NEAR, "ec": "none", "zorder": 0.6, "gid": "too near"}
        kit.draw_polygons(axes, shapely.get_parts(grown), scale, **near)
        keys.append(kit.key("nearer than the radius", marker="s", color=_NEAR, ms=7))
    look = {"fc": kit.BLOCKED, "ec": kit.GREY, "lw": 0.7, "zorder": 0.8, "gid": "obstacle"}
    kit.draw_polygons(axes, as_shapely(model.obstacles), scale, **look)
    low, high = (model.bounds * scale).reshape(2, 2)
    kit.draw_box(axes, low, high, fc="none", ec=kit.GREY, lw=0.8, zorder=0.9, gid="bounds")
    return [kit.key("obstacle", marker="s", mfc=kit.BLOCKED, mec=kit.GREY, ms=7), *keys]


def _draw_moving(axes: Any, model: FleetMission, scale: float, *, discs: bool) -> list[Any]:
    """Draw the ways of moving obstacles and, if required, their discs at time 0; return legend entries."""
    if not model.moving:
        return []
    lines = [item(sample_times(item.trajectory)) * scale for item in model.moving]
    kit.draw_lines(axes, lines, colors=kit.DARK, lw=0.9, linestyles="dashed", zorder=2.6)
    look: dict[str, Any] = {"lw": 0.8, "zorder": 2.7, "gid": "moving obstacle"}
    if discs:
        kit.draw_circles(axes, *_moving_discs(model, 0.0, scale), fc=_MOVING, ec=kit.DARK, **look)
    label = "moving obstacle at 0 s" if discs else "moving obstacle"
    return [kit.key(label, marker="o", color=kit.DARK, mfc=_MOVING, ms=7, ls="--", lw=0.9)]


def _moving_discs(model: FleetMission, time: float, scale: float) -> tuple[kit.Floats, list[float]]:
    """Return centres and radii of moving obstacles."""
    places = np.array([item(time) for item in model.moving]).reshape(-1, 2)
    return places * scale, [item.radius * scale for item in model.moving]


@kit.documented
def animate_mission(
    model: FleetMission,
    plan: MissionPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Animate a mission: the robots to scale, and their paths so far."""
    stage = kit.Stage(model, title, size, frames, interval)
    plan = required("plan", model.as_plan(plan), MissionPlan)
    model.verify(plan)  # raises for nodes that do not exist
    robots = [(k, item) for k, item in enumerate(plan.trajectories) if item is not None]
    flown, looks = [item for _, item in robots], [kit.colour_of(k) for k, _ in robots]
    curves = [(sample_times(item), item(sample_times(item))) for item in flown]
    times = np.linspace(0.0, plan.end, frames)
    visited = np.full(len(model.nodes), np.inf)
    faces = [kit.DARK] * len(model.nodes)
    for k, (route, when) in enumerate(zip(plan.routes, plan.visits, strict=True)):
        visited[list(route)] = when
        for node in route:
            faces[node] = kit.colour_of(k)

    everything = np.concatenate([model.bounds.reshape(2, 2), *(curve for _, curve in curves)])
    axes, scale = stage.map(everything.min(axis=0), everything.max(axis=0))
    keys = draw_field(axes, model, scale)
    lines = [curve * scale for _, curve in curves]
    thin: dict[str, Any] = {"lw": 0.6, "linestyles": "dotted", "alpha": 0.7}
    kit.draw_routes(axes, lines, gid="planned", colors=looks, **thin)
    ways = [axes.plot([], [], lw=1.8, color=look, zorder=4, gid="path")[0] for look in looks]
    white: dict[str, Any] = {"edge": kit.BLACK, "width": 0.8, "zorder": 6, "gid": "node"}
    nodes = kit.dots(axes, model.nodes * scale, "o", "white", size=24, **white)
    depot: dict[str, Any] = {"size": 46, "edge": kit.BLACK, "width": 1.4, "zorder": 5}
    kit.dots(axes, model.depot[None] * scale, "s", "white", **depot)
    body: dict[str, Any] = {"edgecolors": kit.BLACK, "lw": 0.8, "zorder": 8, "gid": "robot"}
    bodies = kit.draw_circles(axes, np.empty((0, 2)), [], facecolors=looks, **body)
    keys += _draw_moving(axes, model, scale, discs=False)
    body |= {"gid": "moving obstacle", "zorder": 7}
    movers = kit.draw_circles(axes, np.empty((0, 2)), [], facecolors=_MOVING, **body)
    # Smaller discs would be invisible.
    reach = max(model.radius * scale, 0.011 * float(np.ptp(axes.get_xlim())))
    keys += [kit.key("to visit", marker="o", mfc="white", mec=kit.BLACK, ms=5)]
    stage.legend_above(axes, [*keys, kit.key("visited", marker="o", color=kit.DARK, ms=5)])

    def show(frame: int) -> str:
        time = float(times[frame])
        places = [item(np.clip(time, item.times[0], item.times[-1])) for item in flown]
        for item, way, here, (instants, curve) in zip(flown, ways, places, curves, strict=True):
            done = np.concatenate([curve[instants <= time], here[None]])
            way.set_data(*(done * scale).T if time >= item.times[0] else ([], []))
        bodies.set_paths(kit.circles(np.reshape(places, (-1, 2)) * scale, [reach] * len(places)))
        movers.set_paths(kit.circles(*_moving_discs(model, time, scale)))
        # The tolerance absorbs rounding of frame times at a visit.
        met = visited <= time + 1e-9 * plan.end
        nodes.set_facecolor(np.where(met, faces, "white").tolist())
        count = f"{int(met.sum())} of {len(model.nodes)} nodes visited"
        return f"t = {time:.2f} s of {plan.end:.2f} s, {count}"

    return stage.play(show)
