"""Figure of a fleet's routes: a map with one colour per route, and their lengths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from ..fields import required
from ..grid_path import trail
from ..plots.labels import write_names
from ..plots.loads import draw_loads
from ..plots.maps import BLOCKED, draw_cells, dress_map, length_unit, point_ways
from ..plots.options import check_flags, check_list, check_option
from ..plots.routes import draw_routes, draw_stops, name_vehicles
from ..plots.style import (
    BLACK,
    axis_style,
    headline,
    key,
    legend_row,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .checks import deviation_of, loads_of
from .data import Metric, Objective
from .drawn import places_of, stops_of, wrong_nodes
from .model import FleetRouting
from .plan import FleetPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw"]

Floats = NDArray[np.float64]

#: Largest number of nodes that are named by default.
_MOST_NAMES = 40
#: Shortest segment with an arrow on asymmetric routes, as a share of the map's width.
_LONG = 0.04
_PARTS = ("routes", "loads")


def draw(
    model: FleetRouting,
    plan: FleetPlan | None = None,
    *,
    parts: Sequence[str] | None = None,
    legs: str | None = None,
    labels: bool | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the nodes of `model`, and the routes of `plan` with their lengths.

    Parameters
    ----------
    model : FleetRouting
        The model. Costs without points are embedded in a plane (multidimensional scaling), up to
        1500 nodes.
    plan : FleetPlan, optional
        A plan for the model, feasible or not. Nodes not visited exactly once and lengths beyond the
        battery are marked in red. None draws nodes only.
    parts : sequence of {"routes", "loads"}, optional
        What to draw: the routes on a map, the lengths of all routes as bars, or both.
    legs : {"paths", "straight"}, optional
        Whether legs follow the shortest paths on the model's map or are straight. The default is
        "paths" for the metric "grid" and "straight" otherwise.
    labels : bool, optional
        Whether to name the nodes; by default, up to 40 nodes are named.
    tolerance : float
        Largest accepted relative violation, used for the title and the marks.
    title : str, optional
        Title; by default the name, the size and the objective.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The figure, with one panel per part.

    Raises
    ------
    InvalidData
        The plan names a node that does not exist.
    UnsupportedOption
        An option has an invalid value, or the model or plan lacks the data that it needs.
    """
    shown = _parts(model, plan, parts)
    check_option("legs", legs, legs in (None, "paths", "straight"), "be 'paths' or 'straight'")
    if legs == "paths" and model.map is None:
        raise UnsupportedOption("legs can be 'paths' only if the model has a map")
    if labels is not None:
        check_flags(labels=labels)
    check_tolerance(tolerance)
    verification = None
    if plan is not None:
        verification = model.verify(required("plan", plan, FleetPlan), tolerance=tolerance)
    text = _title(model, plan, verification) if title is None else title
    bars = 0 if plan is None else len(plan.routes)
    high = {"routes": 6.0, "loads": min(6.0, 1.5 + 0.3 * bars)}
    wide = {"routes": 6.6, "loads": 4.2}
    figure = sheet(size, (sum(map(wide.__getitem__, shown)), max(map(high.__getitem__, shown))))
    broad, tall = figure.get_size_inches()
    head = 0.46 + 0.17 * text.count("\n")
    unit = broad / sum(map(wide.__getitem__, shown))
    left = 0.0
    for part in shown:
        across = wide[part] * unit
        start, foot = left + (0.74 if part == "routes" else 0.84), 0.9
        where = (start, foot, left + across - 0.12 - start, tall - head - foot)
        axes = figure.add_axes(tuple(np.divide(where, (broad, tall, broad, tall)).tolist()))
        if part == "routes":
            keys = _draw_map(model, plan, axes, legs, labels, named="loads" not in shown)
        else:
            assert plan is not None
            keys = _draw_bars(model, plan, axes, tolerance)
        middle = (left + 0.5 * across) / broad
        legend_row(figure, keys, "lower center", (middle, 0.06 / tall), rows=1 + (len(keys) > 4))
        left += across
    headline(figure, text, wrong=verification is not None and not verification.ok)
    return figure


def _parts(
    model: FleetRouting, plan: FleetPlan | None, parts: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the names of the panels to draw."""
    if parts is None:
        shown = _PARTS if plan is not None else _PARTS[:1]
        if plan is not None and places_of(model) is None:
            shown = _PARTS[1:]
    else:
        shown = tuple(
            check_list("parts", parts, _PARTS.__contains__, "hold some of 'routes', 'loads'")
        )
    if "loads" in shown and plan is None:
        raise UnsupportedOption("parts can hold 'loads' only with a plan")
    if "routes" in shown and places_of(model) is None:
        raise UnsupportedOption(
            f"parts can hold 'routes' only with points, or costs of up to 1500 nodes, got "
            f"{model.size}"
        )
    return shown


def _title(model: FleetRouting, plan: FleetPlan | None, verification: Verification | None) -> str:
    if plan is None or verification is None or verification.objective is None:
        return title_of(model.name, [model.describe()], verification)
    what = str(model.objective)
    if model.objective in (Objective.VARIANCE, Objective.DEVIATION):
        what = f"sum + {number(model.q, 4)} × {what.partition('-')[2]}"
    unit = f" {model.length_unit}" if model.length_unit else ""
    several = f"{model.vehicles} vehicle{'s' * (model.vehicles > 1)}"
    parts = [
        several,
        f"{len(model.customers)} nodes",
        f"{what} {number(verification.objective)}{unit}",
    ]
    if model.objective is not Objective.SUM:
        parts.append(f"sum {number(float(loads_of(model, plan).sum()))}{unit}")
    return title_of(model.name, parts, verification)


# -- the map -------------------------------------------------------------------------------------


def _draw_map(
    model: FleetRouting, plan: FleetPlan | None, axes: Any, legs: str | None, labels: bool | None, *,
    named: bool,
) -> list[Any]:  # fmt: skip
    """Draw blocked cells, routes and nodes, and return the entries of the legend."""
    places = places_of(model)
    assert places is not None
    low, high = places.min(axis=0), places.max(axis=0)
    grid = model.map
    if grid is not None:
        corner = grid.origin + grid.cell * np.array(grid.shape[::-1])
        low, high = np.minimum(low, grid.origin), np.maximum(high, corner)
    scale, unit = length_unit(float((high - low).max())) if model.points is not None else (1.0, "")
    dress_map(axes, low * scale, high * scale, unit)
    if model.points is None:
        axes.set_xlabel("costs scaled to a plane, axis 1", fontsize=8.5)
        axes.set_ylabel("costs scaled to a plane, axis 2", fontsize=8.5)
    keys = []
    if grid is not None:
        draw_cells(axes, grid.blocked, grid.origin * scale, corner * scale)
        keys.append(key("blocked", marker="s", color=BLOCKED, ms=7))
        if not grid.upward:
            axes.invert_yaxis()
    stops = [] if plan is None else stops_of(model, plan)
    follow = grid if legs == "paths" or (legs is None and model.metric is Metric.GRID) else None
    paths = [places[one] if follow is None else trail(follow, places[one]) for one in stops]
    lines = [way * scale for way in paths]
    draw_routes(axes, lines, gid="route")
    # The tolerance hides differences due to rounding.
    if not np.allclose(model.distances, model.distances.T, rtol=1e-9):
        _draw_ways(axes, lines)
    owners = np.full(model.size, -1)
    for k, route in enumerate(stops):
        owners[route] = k
    rest, homes = model.customers, np.unique(model.depots)
    violated = np.empty(0, int) if plan is None else wrong_nodes(model, plan)
    shown = (places[some] * scale for some in (homes, violated))
    keys += draw_stops(axes, places[rest] * scale, owners[rest], *shown)
    keys += name_vehicles(len(stops), "vehicle") if named else []
    if labels if labels is not None else model.size <= _MOST_NAMES:
        names = [model.label(node) for node in range(model.size)]
        write_names(axes, places * scale, names, size=7.5, colour=BLACK, route=False)
    return keys


def _draw_ways(axes: Any, lines: list[Floats]) -> None:
    """Draw arrows on the long segments of routes."""
    for k, line in enumerate(lines):
        steps = np.diff(line, axis=0)
        far = np.hypot(*steps.T) > _LONG * abs(np.subtract(*axes.get_xlim()))
        middles, headings = (line[:-1] + 0.5 * steps)[far], np.arctan2(*steps[far].T[::-1])
        point_ways(axes, middles, headings, axis_style(k)["color"], 6.5)


# -- the bars ------------------------------------------------------------------------------------


def _draw_bars(model: FleetRouting, plan: FleetPlan, axes: Any, tolerance: float) -> list[Any]:
    """Draw the length of every route, and return the entries of the legend."""
    loads = loads_of(model, plan)
    unit = model.length_unit
    whole = len(loads) == model.vehicles
    wrong: list[int] = []
    if whole and model.battery is not None:
        wrong = np.flatnonzero(loads - model.battery > tolerance * model.battery).tolist()
    return draw_loads(
        axes, loads, f"length of route ({unit})" if unit else "cost of route",
        names=[f"vehicle {k}" for k in range(len(loads))],
        deviation=deviation_of(model, loads) if len(loads) > 1 else None,
        limits=model.battery if whole else None, wrong=wrong,
    )  # fmt: skip
