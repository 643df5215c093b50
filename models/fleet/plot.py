"""Figure of a fleet's routes: a map with one colour per route, and their lengths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import UnsupportedOption
from ..grid_path import trail
from ..plots import kit
from ..verification import Verification
from .checks import deviation_of, loads_of
from .data import FleetData, Metric, Objective
from .embedding import embed
from .model import FleetRouting
from .plan import FleetPlan
from .rich_checks import describe_visits, missing_times
from .timeline import draw_timeline, places_in_time

__all__ = ["animate_routes", "draw"]

#: Largest number of nodes that are named by default.
_MOST_NAMES = 40
#: Largest number of nodes for which costs are embedded in a plane.
_MOST_SCALED = 1500
#: Shortest segment with an arrow on asymmetric routes, as a share of the map's width.
_LONG = 0.04
_PARTS = ("routes", "loads", "timeline")
#: Width of each part, margin at its left and space at the foot (inch).
_WIDE = {"routes": 6.6, "loads": 4.2, "timeline": 7.2}
_LEFT, _FOOT = {"routes": 0.74, "loads": 0.84, "timeline": 0.84}, 0.9


@kit.documented
def draw(
    model: FleetRouting,
    plan: FleetPlan | None = None,
    *,
    parts: Sequence[str] | None = None,
    legs: str | None = None,
    labels: bool | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the nodes of `model`, and the routes of `plan` with their lengths.

    Parameters
    ----------
    model : FleetRouting
        The model. Costs without points are embedded in a plane (multidimensional scaling), up to
        1500 nodes.
    plan : FleetPlan, optional
        A plan for the model, feasible or not. Nodes not visited exactly once and lengths beyond the
        battery are marked in red. None draws nodes only.
    parts : sequence of {"routes", "loads", "timeline"}, optional
        What to draw: the routes on a map, the lengths of all routes as bars, and the timeline of all
        vehicles with travel, waiting, services and windows. All by default; the timeline needs a plan
        with times.
    legs : {"paths", "straight"}, optional
        Whether legs follow the shortest paths on the model's map or are straight. The default is
        "paths" for the metric "grid" and "straight" otherwise.
    labels : bool, optional
        Whether to name the nodes; by default, up to 40 nodes are named.
    """
    shown = _parts(model, plan, parts)
    kit.check_option("legs", legs, legs in (None, "paths", "straight"), "be 'paths' or 'straight'")
    if legs == "paths" and model.map is None:
        raise UnsupportedOption("legs can be 'paths' only if the model has a map")
    kit.check_flags(optional=True, labels=labels)
    result = kit.verified_plan(model, plan, FleetPlan, tolerance)
    text = kit.title_of(model, _words(model, plan, result), result, title)
    bars = 0 if plan is None else len(plan.routes)
    high = {"routes": 6.0, "loads": min(6.0, 1.5 + 0.3 * bars)}
    high["timeline"] = min(6.0, 2.0 + 0.4 * bars)
    whole = sum(_WIDE[part] for part in shown)
    scene = kit.Scene(text, result, size, (whole, max(high[part] for part in shown)))
    left = 0.0
    for part in shown:
        wide = _WIDE[part] * scene.broad / whole
        right = scene.broad - left - wide + 0.12
        axes = scene.axes(left + _LEFT[part], _FOOT, right, scene.head)
        if part == "routes":
            keys = _draw_map(model, plan, result, axes, legs, labels, named=shown == ("routes",))
        elif part == "timeline":
            assert plan is not None
            keys = draw_timeline(model, plan, axes, labels)
            kit.pin_places(axes, result, places_in_time(model, plan))
        else:
            assert plan is not None
            keys = _draw_bars(model, plan, axes, tolerance)
            ends = enumerate(loads_of(model, plan))
            kit.pin_places(axes, result, {f"vehicle {k}": (load, k) for k, load in ends})
        scene.legend(keys, 1 + (len(keys) > 4), x=left + 0.5 * wide, y=0.06)
        left += wide
    return scene.figure


def _parts(
    model: FleetRouting, plan: FleetPlan | None, parts: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the names of the panels to draw."""
    mapped = places_of(model) is not None
    timed = plan is not None and model.has_times and not missing_times(plan)
    if parts is None:
        drawn = {"routes": mapped or plan is None, "loads": plan is not None, "timeline": timed}
        return tuple(part for part in _PARTS if drawn[part])
    shown = tuple(kit.check_words("parts", parts, _PARTS))
    if "loads" in shown and plan is None:
        raise UnsupportedOption("parts can hold 'loads' only with a plan")
    if "timeline" in shown and not timed:
        raise UnsupportedOption("parts can hold 'timeline' only with a plan that has times")
    if "routes" in shown and not mapped:
        raise UnsupportedOption(
            f"parts can hold 'routes' only with points, or costs of up to {_MOST_SCALED} nodes, got "
            f"{model.size}"
        )
    return shown


def _words(model: FleetRouting, plan: FleetPlan | None, result: Verification | None) -> list[str]:
    """Return the parts of the title."""
    if plan is None or result is None or result.objective is None:
        return [model.describe()]
    what = str(model.objective)
    if model.objective in (Objective.VARIANCE, Objective.DEVIATION):
        what = f"sum + {kit.number(model.q, 4)} × {what.partition('-')[2]}"
    unit = f" {model.length_unit}" if model.length_unit else ""
    parts = [kit.many(model.vehicles, "vehicle"), f"{len(model.customers)} nodes"]
    rich = model.objective in (Objective.COST, Objective.MAKESPAN)
    own = f" {model.objective_unit}".rstrip() if rich else unit
    parts.append(f"{what} {kit.number(result.objective)}{own}")
    if model.objective is not Objective.SUM:
        parts.append(f"sum {kit.number(float(loads_of(model, plan).sum()))}{unit}")
    return parts


def places_of(model: FleetData) -> kit.Floats | None:
    """Return the positions at which nodes are drawn, shape (n, 2); None for costs of many nodes.

    Costs are embedded in a plane.
    """
    if model.points is not None:
        return model.points
    if model.size > _MOST_SCALED:
        return None
    return (0.5 * float((model.distances + model.distances.T).max()) or 1.0) * embed(
        model.distances
    )


def _draw_map(
    model: FleetRouting, plan: FleetPlan | None, result: Verification | None, axes: Any,
    legs: str | None, labels: bool | None, *, named: bool,
) -> list[Any]:  # fmt: skip
    """Draw blocked cells, routes and nodes, and return the entries of the legend."""
    places = places_of(model)
    assert places is not None
    low, high = places.min(axis=0), places.max(axis=0)
    grid = model.map
    if grid is not None:
        least, most = kit.corners_of(grid)
        low, high = np.minimum(low, least), np.maximum(high, most)
    words = "costs scaled to a plane, axis 1 (–)", "costs scaled to a plane, axis 2 (–)"
    scale = kit.dress_map(axes, low, high, words if model.points is None else None)
    keys = []
    if grid is not None:
        kit.draw_cells(axes, grid, scale)
        keys.append(kit.key("blocked", marker="s", color=kit.BLOCKED, ms=7))
    last = model.vehicles - 1
    routes = () if plan is None else plan.routes
    # An empty route stays without its depot, and an open one without an end.
    stops = [model.path_of(min(k, last), route) for k, route in enumerate(routes)]
    follow = grid if legs == "paths" or (legs is None and model.metric is Metric.GRID) else None
    paths = [places[route] if follow is None else trail(follow, places[route]) for route in stops]
    lines = [path * scale for path in paths]
    kit.draw_routes(axes, lines, gid="route")
    # The tolerance hides differences due to rounding.
    if not np.allclose(model.distances, model.distances.T, rtol=1e-9):
        _draw_ways(axes, lines)
    owners = np.full(model.size, -1)
    for k, route in enumerate(stops):
        owners[route] = k
    names = [model.label(node) for node in range(model.size)]
    # Customers not visited exactly once, and depots within a route.
    faults = set() if plan is None else set(describe_visits(model, plan))
    wrong = np.array([f"node {name}" in faults for name in names], bool)
    depots = places[np.unique(model.depots)] * scale
    at = places * scale
    keys += kit.draw_stops(axes, at[model.customers], owners[model.customers], depots, at[wrong])
    keys += kit.name_vehicles(len(stops), "vehicle") if named else []
    kit.pin_places(
        axes, result, {f"node {name}": place for name, place in zip(names, at, strict=True)}
    )
    if labels if labels is not None else model.size <= _MOST_NAMES:
        kit.write_names(axes, at, names, size=7.5, colour=kit.BLACK, route=False)
    return keys


def _draw_ways(axes: Any, lines: list[kit.Floats]) -> None:
    """Draw arrows on the long segments of routes."""
    for k, line in enumerate(lines):
        steps = np.diff(line, axis=0)
        far = np.hypot(*steps.T) > _LONG * abs(np.subtract(*axes.get_xlim()))
        middles, headings = (line[:-1] + 0.5 * steps)[far], np.arctan2(*steps[far].T[::-1])
        kit.point_ways(axes, middles, headings, kit.colour_of(k), 6.5)


def _draw_bars(model: FleetRouting, plan: FleetPlan, axes: Any, tolerance: float) -> list[Any]:
    """Draw the length of every route, and return the entries of the legend."""
    loads = loads_of(model, plan)
    unit = model.length_unit
    whole = len(loads) == model.vehicles
    wrong: list[int] = []
    whole = whole and not model.stations  # a battery then limits the parts of a route
    if whole and model.battery is not None:
        wrong = np.flatnonzero(loads - model.battery > tolerance * model.battery).tolist()
    return kit.draw_loads(
        axes, loads, kit.with_unit("length of route" if unit else "cost of route", unit),
        names=[f"vehicle {k}" for k in range(len(loads))],
        deviation=deviation_of(model, loads) if len(loads) > 1 else None,
        limits=model.battery if whole else None, wrong=wrong,
    )  # fmt: skip


@kit.animated(draw, FleetPlan)
def animate_routes(model: FleetRouting, plan: FleetPlan | Any, figure: Any) -> Any:
    """Animate the picture of a plan: the vehicles on their routes; the clock is the distance on the map."""
    axes: Any = figure.axes[0]
    routes = [c.get_paths() for c in axes.collections if c.get_gid() == "route"]
    kit.check_option("plan", plan, any(plan.routes) and bool(routes), "have routes on a map")
    paths = [path.vertices for path in routes[0]]
    return kit.route_movers(axes, paths), "distance", kit.unit_of(axes)
