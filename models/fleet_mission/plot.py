"""Figure of a mission: curves among obstacles, their lengths, and limited quantities over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from ..fields import required
from ..fleet import Deviation
from ..grid_path import trail
from ..plots.curves import Curve, Limit, Panel, Span
from ..plots.labels import write_names
from ..plots.loads import draw_loads
from ..plots.maps import draw_cells, dress_map, length_unit
from ..plots.options import check_flags, check_list
from ..plots.panels import draw_panels
from ..plots.routes import draw_routes, draw_stops, name_vehicles, ring
from ..plots.style import (
    BLACK,
    DARK,
    headline,
    inches,
    key,
    legend_row,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .animation import animate_mission, draw_field
from .curves import lengths_of
from .drawn import (
    FAR,
    apart_of,
    broken_places,
    missed_nodes,
    owners_of,
    sample_times,
    stops_of,
)
from .model import FleetMission
from .plan import MissionPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["animate_mission", "draw"]

Floats = NDArray[np.float64]

#: Parts of the figure: on the left, and over time on the right.
_LEFT, _RIGHT = ("map", "loads"), ("velocity", "acceleration", "distance")
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


@np.errstate(all="ignore")  # an infeasible plan may overflow
def draw(
    model: FleetMission,
    plan: MissionPlan | None = None,
    *,
    parts: Sequence[str] | None = None,
    layers: Sequence[str] = ("curve",),
    labels: bool | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw obstacles and nodes of `model`, and the curves of `plan` with limited quantities.

    Parameters
    ----------
    model : FleetMission
        The model.
    plan : MissionPlan, optional
        A plan for the model, feasible or not. Nodes not visited exactly once and the largest
        violations are ringed in red. None draws obstacles and nodes only.
    parts : sequence of {"map", "loads", "velocity", "acceleration", "distance"}, optional
        What to draw: the map, the lengths of the curves as bars, and over time the components of
        velocity and acceleration with their limits, and the least distance of two robots under way.
        All parts by default.
    layers : sequence of {"cells", "grid", "smoothed", "curve"}
        What to draw on the map: the blocked cells of the model's map; shortest paths over its cells
        for the plan's routes; these paths shortened by lines of sight (Algorithm 4); and the curves.
        The paths are recomputed for the figure, independently of the planner.
    labels : bool, optional
        Whether to name the nodes; by default, up to 40 nodes are named.
    tolerance : float
        Largest accepted relative violation, used for the title and the rings.
    title : str, optional
        Title; by default the name, the size, the objective and the end time.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The map and the bars on the left, panels over time on the right.

    Raises
    ------
    InvalidData
        The plan names a node that does not exist.
    UnsupportedOption
        An option has an invalid value or needs a plan.

    See Also
    --------
    animate_mission : Animation of the plan.
    """
    shown = _select_parts(plan, parts)
    drawn_layers = check_list(
        "layers", layers, _LAYERS.__contains__, f"hold some of {', '.join(map(repr, _LAYERS))}"
    )
    if labels is not None:
        check_flags(labels=labels)
    check_tolerance(tolerance)
    found = None
    if plan is not None:
        found = model.verify(required("plan", plan, MissionPlan), tolerance=tolerance)
    text = _title(model, plan, found) if title is None else title
    left, right = ([part for part in side if part in shown] for side in (_LEFT, _RIGHT))
    panels = []
    if plan is not None and right:
        panels = list(_panels(model, plan, right, tolerance, named=not left))
    bars = min(2.6, 0.5 + 0.24 * len(plan.routes)) if plan is not None and "loads" in left else 0.0
    below = bars + 0.9 * bool(bars)
    tall = below + 6.4 * ("map" in left) + 0.5 * (left == ["loads"])
    widths = [6.6] * bool(left) + [5.8] * bool(right)
    figure = sheet(size, (sum(widths), max(tall, 1.4 + 1.3 * len(panels))))
    sides: Any = [figure]
    if len(widths) > 1:
        sides = figure.subfigures(1, 2, width_ratios=widths, wspace=0.0)
    head = 0.46 + 0.17 * text.count("\n")
    if left:
        _draw_left(model, plan, found, sides[0], left, drawn_layers, labels, (head, bars))
    if panels:
        assert plan is not None
        draw_panels(
            sides[-1], panels, [Span("", 0.0, plan.end or 1.0, np.empty(0))], title=text,
            wrong=found is not None and not found.ok, label="time (s)", mesh=False,
        )  # fmt: skip
    headline(figure, text, wrong=found is not None and not found.ok)
    return figure


def _select_parts(plan: MissionPlan | None, parts: Sequence[str] | None) -> list[str]:
    if parts is None:
        return list(_PARTS if plan is not None else _PARTS[:1])
    words = f"hold some of {', '.join(map(repr, _PARTS))}"
    shown = check_list("parts", parts, _PARTS.__contains__, words)
    if plan is None and shown != ["map"]:
        raise UnsupportedOption("parts can hold more than 'map' only with a plan")
    return shown


def _title(model: FleetMission, plan: MissionPlan | None, verification: Verification | None) -> str:
    if plan is None or verification is None or verification.objective is None:
        return title_of(model.name, [model.describe()], verification)
    what = str(model.objective)
    if what.startswith("sum-"):
        what = f"sum + {number(model.q, 4)} × {what.partition('-')[2]}"
    several = f"{model.vehicles} robot{'s' * (model.vehicles > 1)}"
    parts = [several, f"{len(model.nodes)} node{'s' * (len(model.nodes) > 1)}"]
    parts += [f"{what} {number(verification.objective)} m", f"{number(plan.end, 5)} s"]
    return title_of(model.name, parts, verification)


# -- the map and the bars ------------------------------------------------------------------------


def _draw_left(
    model: FleetMission, plan: MissionPlan | None, found: Verification | None, figure: Any,
    parts: list[str], layers: list[str], labels: bool | None, heights: tuple[float, float],
) -> None:  # fmt: skip
    """Draw the map and the bars below it; `heights` are the heights of title and bars (inch)."""
    broad, tall = inches(figure)
    head, bars = heights
    low = 0.0
    if plan is not None and "loads" in parts:
        high = bars if "map" in parts else tall - head - 0.8
        where = np.divide((0.84, 0.74, broad - 1.0, high), (broad, tall, broad, tall))
        axes = figure.add_axes(tuple(where.tolist()))
        loads = np.array(
            [0.0 if one is None else lengths_of(one).sum() for one in plan.trajectories]
        )
        spread = None
        if len(loads) > 1:
            spread = float(np.std(loads, ddof=int(model.deviation is Deviation.SAMPLE)))
        names = [f"robot {k}" for k in range(len(loads))]
        keys = draw_loads(axes, loads, "length of curve (m)", names=names, deviation=spread)
        legend_row(figure, keys, "lower center", (0.5, 0.06 / tall))
        low = high + 0.9
    if "map" in parts:
        rows = 2 if layers == ["curve"] else 3
        foot = low + 0.56 + 0.17 * rows
        where = np.divide((0.74, foot, broad - 0.9, tall - head - foot), (broad, tall) * 2)
        axes = figure.add_axes(tuple(where.tolist()))
        keys = _draw_map(model, plan, found, axes, layers, labels)
        if plan is not None and not low:
            keys += name_vehicles(len(plan.routes), "robot")
        place = (0.5, (low + 0.06) / tall)
        legend_row(figure, keys, "lower center", place, rows=rows if len(keys) > 5 else 1)


def _draw_map(
    model: FleetMission, plan: MissionPlan | None, found: Verification | None, axes: Any,
    layers: list[str], labels: bool | None,
) -> list[Any]:  # fmt: skip
    """Draw obstacles, layers and nodes, and return the entries of the legend."""
    curves: list[Floats] = []
    if plan is not None:
        times = ((one, sample_times(one)) for one in plan.trajectories)
        curves = [np.empty((0, 2)) if one is None else one(at) for one, at in times]
        curves = [np.clip(np.nan_to_num(curve), -FAR, FAR) for curve in curves]
    low, high = model.bounds[:2], model.bounds[2:]
    flown = np.concatenate([model.bounds.reshape(2, 2), *curves])
    far = _BEYOND * (high - low)
    low = np.maximum(np.minimum(low, flown.min(axis=0)), low - far)
    high = np.minimum(np.maximum(high, flown.max(axis=0)), high + far)
    scale, unit = length_unit(float((high - low).max()))
    dress_map(axes, low * scale, high * scale, unit)
    keys = draw_field(axes, model, scale)
    if "cells" in layers:
        corner = model.map.origin + model.map.cell * np.array(model.map.shape[::-1])
        draw_cells(axes, model.map.blocked, model.map.origin * scale, corner * scale, colour=_CELL)
        keys.append(key("blocked cell", marker="s", color=_CELL, ms=7))
    owners = np.full(len(model.nodes), -1)
    missed = np.empty((0, 2))
    if plan is not None:
        owners, missed = owners_of(model, plan), missed_nodes(model, plan)
        ways = [name for name in ("grid", "smoothed", "curve") if name in layers]
        stops = stops_of(model, plan)
        for name in ways:
            label, dashes = _LAYERS[name]
            if name == "curve":
                lines = curves
                look: dict[str, Any] = {"lw": 1.7}
            else:
                lines = [_trail(model, one, straightened=name == "smoothed") for one in stops]
                look = {"lw": 1.1, "linestyles": [dashes] * len(lines)} if len(ways) > 1 else {}
            draw_routes(axes, [line * scale for line in lines], gid=label, **look)
            if ways != ["curve"]:
                keys.append(key(label, color=DARK, lw=look.get("lw", 1.6), ls=dashes or "-"))
    home = model.depot[None] * scale
    keys += draw_stops(axes, model.nodes * scale, owners, home, missed * scale)
    if plan is not None and found is not None:
        keys += ring(axes, broken_places(plan, found) * scale, "worst violation")
    if labels if labels is not None else len(model.nodes) <= _MOST_NAMES:
        names = [model.label(node) for node in range(len(model.nodes))]
        write_names(axes, model.nodes * scale, names, size=7.5, colour=BLACK, route=False)
    return keys


def _trail(model: FleetMission, stops: Floats, *, straightened: bool) -> Floats:
    return trail(model.map, stops, straightened=straightened) if len(stops) else stops


# -- over time -----------------------------------------------------------------------------------


def _panels(
    model: FleetMission, plan: MissionPlan, parts: list[str], tolerance: float, *, named: bool
) -> Iterable[Panel]:
    """Yield the panels; `named` labels the curves by robot for figures without a map."""
    ends = np.array([0.0, plan.end or 1.0])
    limits = {"velocity": model.velocity_limit, "acceleration": model.acceleration_limit}
    for order, (part, limit_values) in enumerate(limits.items(), start=1):
        if part not in parts:
            continue
        flown = [
            (k, sample_times(one), one(sample_times(one), order))
            for k, one in enumerate(plan.trajectories)
            if one is not None
        ]
        for axis, bound in enumerate(limit_values.tolist()):
            curves = [
                Curve(f"robot {k}" if named else part, k, times, values[:, axis], 1.1)
                for k, times, values in flown
            ]
            limit = Limit(ends, -bound, bound, tolerance=tolerance * bound)
            yield Panel(f"{part} {'xy'[axis]}", "m/s" if order == 1 else "m/s²", curves, [limit])
    if "distance" in parts:
        knots = [one.times for one in plan.trajectories if one is not None]
        times = np.unique(np.concatenate([np.linspace(ends[0], ends[1], 3001), *knots]))
        curve = Curve("least distance", 6, times, apart_of(model, plan, times))
        limits_ = []
        if model.separation > 0:
            limits_ = [Limit(ends, model.separation, np.inf, tolerance=tolerance * model.cell)]
        yield Panel("distance of robots", "m", [curve], limits_)
