"""Figure of a flight: the curve among the obstacles, and the vehicle's quantities over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..grid_path import as_shapely
from ..grid_path.gridmap import GridMap
from ..minimum_snap.trajectory import Trajectory
from ..plots import kit
from ..verification import Check, Verification
from .model import Flight
from .plan import FlightPlan
from .voxels import VoxelMap

__all__ = ["animate_flight", "draw"]

#: Number of samples of a curve, and largest numbers of faces of voxels and of points that are drawn.
_SAMPLES, _FACES, _POINTS = 1201, 6000, 4000
_WALL, _EDGE = "#b9b4ad", "#8f8a82"
#: Columns of quantities that have several, by the name of the limit.
_COLUMNS = {
    "left wheel speed": ("wheel_speeds", 0),
    "right wheel speed": ("wheel_speeds", 1),
    "left wheel acceleration": ("wheel_accelerations", 0),
    "right wheel acceleration": ("wheel_accelerations", 1),
}


@kit.documented
@np.errstate(all="ignore")  # an infeasible plan may overflow
def draw(
    model: Flight,
    plan: FlightPlan | None = None,
    *,
    path: bool = True,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the map of `model`, and the curve of `plan` with the limited quantities of the vehicle.

    Parameters
    ----------
    model : Flight
        Model with a map in two or three dimensions.
    plan : FlightPlan, optional
        Plan of the model, feasible or not. Red rings mark the largest violations. None draws the map.
    path : bool
        Whether to draw the polyline of the planner.
    """
    kit.check_flags(path=path)
    result = kit.verified_plan(model, plan, FlightPlan, tolerance)
    parts = [model.describe()]
    if plan is not None and result is not None and result.objective is not None:
        unit = kit.pretty_unit(model.objective_unit)
        parts = [model.vehicle.kind, f"{model.objective} {kit.number(result.objective)} {unit}"]
    text = kit.title_of(model, parts, result, title)
    panels = [] if plan is None else [panel for panel, _ in _panels(model, plan, tolerance)]
    default = (12.0, max(5.6, 1.3 + 1.3 * len(panels))) if panels else (6.6, 5.8)
    scene = kit.Scene(text, result, size, default)
    left, right = scene.halves(6.4, 5.6) if panels else (scene, scene)
    _draw_map(model, plan, result, left, path)
    if panels:
        assert plan is not None
        ends = float(plan.trajectory.times[0]), float(plan.trajectory.times[-1])
        places = kit.draw_panels(
            right.figure, panels, [kit.Span("", *ends, plan.trajectory.times)], title=text,
            wrong=scene.wrong, label="time (s)",
        )  # fmt: skip
        kit.pin_curves(result, lambda check: _curve_of(check, places, panels))
    return scene.figure


def _times(curve: Trajectory) -> kit.Floats:
    """Return the sampling times of a curve, s, including its knots."""
    return np.unique(
        np.concatenate([np.linspace(curve.times[0], curve.times[-1], _SAMPLES), curve.times])
    )


def _panels(model: Flight, plan: FlightPlan, tolerance: float) -> Iterator[tuple[kit.Panel, str]]:
    """Yield one panel per limited quantity, with lower and upper limits in the same panel."""
    curve = plan.trajectory
    times = _times(curve)
    ends = np.array([times[0], times[-1]])
    values = model.vehicle.quantities(curve, times)
    measures = {measure.name: measure for measure in model.vehicle.measures}
    for name, measure in measures.items():
        if name.startswith("lowest "):
            continue
        key, column = _COLUMNS.get(name, (name.replace(" ", "_"), None))
        line = values[key] if column is None else values[key][:, column]
        floor = measures.get(f"lowest {name}")
        low = -np.inf if floor is None else floor.limit
        low = -measure.limit if name in _COLUMNS else low
        limit = kit.Limit(ends, low, measure.limit, tolerance=tolerance * measure.limit)
        yield kit.Panel(name, measure.unit, [kit.Curve(name, 0, times, line, 1.2)], [limit]), name


def _curve_of(
    check: Check, places: Any, panels: list[kit.Panel]
) -> tuple[Any, kit.Curve, float] | None:
    """Return axes, curve and time of a check of a limit; None for other checks."""
    time = kit.time_of(check)
    for axes, panel in zip(places, panels, strict=True):
        if time is not None and check.name.removeprefix("lowest ").startswith(f"{panel.title} "):
            return axes, panel.curves[0], time
    return None


def _draw_map(
    model: Flight,
    plan: FlightPlan | None,
    result: Verification | None,
    frame: kit.Frame,
    path: bool,
) -> None:
    """Draw obstacles, path and curve in a plane or in space, and the legend."""
    lines: list[kit.Floats] = [model.places]
    if plan is not None:
        lines.append(np.clip(plan.trajectory(_times(plan.trajectory)), -kit.FAR, kit.FAR))
        if path and plan.path is not None and plan.path.shape[1] == model.dimensions:
            lines.append(plan.path)
    space = model.dimensions == 3
    low, high = model.space.bounds
    if not np.isfinite([low, high]).all():
        low, high = model.space.extent(model.places)
    low, high = kit.box_near(low, high, lines)
    foot = 0.6 + 2 * kit.LINE
    if space:
        share = (foot - 0.3) / frame.tall
        axes = kit.space_axes(frame.figure, (0.0, share, 0.95, 0.9 - share))
        scale = 1.0
        axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    else:
        axes = frame.axes(0.74, foot, 0.16, 0.7)
        scale = kit.dress_map(axes, low, high)
    keys = [kit.key("obstacle", marker="s", color=_WALL, ms=7)]
    _draw_obstacles(model, axes, scale)
    if len(lines) > 2:
        axes.plot(
            *(lines[2] * scale).T, color=kit.DARK, lw=1.0, ls=(0, (3, 2)), zorder=5, gid="path"
        )
        keys.append(kit.key("path", color=kit.DARK, lw=1.0, ls="--"))
    if len(lines) > 1:
        axes.plot(*(lines[1] * scale).T, color=kit.colour_of(0), lw=2.0, zorder=6, gid="curve")
        keys.append(kit.key("curve", color=kit.colour_of(0), lw=2.0))
    ends = [("start", model.places[:1], "o", 42), ("goal", model.places[-1:], "*", 110)]
    ends += [("waypoint", model.waypoints, "D", 26)] * bool(len(model.waypoints))
    for obstacle in model.moving:
        axes.plot(*(obstacle.trajectory(_times(obstacle.trajectory)) * scale).T, color=kit.RED,
                  lw=1.0, ls=":", zorder=4, gid="moving obstacle")  # fmt: skip
    keys += [kit.key("moving obstacle", color=kit.RED, lw=1.0, ls=":")] * bool(model.moving)
    for name, places, marker, area in ends:
        look: dict[str, Any] = {"size": area, "edge": kit.BLACK, "width": 1.1, "zorder": 8}
        kit.dots(axes, places * scale, marker, "white", gid=name, **look)
        keys.append(kit.key(name, marker=marker, mfc="white", mec=kit.BLACK, ms=6))
    if plan is not None and result is not None:
        keys += _draw_violations(plan, result, axes, scale)
    if space:
        kit.dress_space(axes, high - low)
    frame.legend(keys, 2, y=0.06)


def _draw_violations(plan: FlightPlan, result: Verification, axes: Any, scale: float) -> list[Any]:
    """Draw rings at the violations and pin the checks that have a time."""
    curve = plan.trajectory

    def place(check: Check) -> kit.Floats | None:
        time = kit.time_of(check)
        return None if time is None else curve(np.clip(time, curve.times[0], curve.times[-1]))

    kit.pin_places(axes, result, place, scale)
    wrong = [spot * scale for check in result.violated if (spot := place(check)) is not None]
    return kit.ring(axes, wrong, "worst violation")


def _draw_obstacles(model: Flight, axes: Any, scale: float) -> None:
    """Draw the obstacles of any map."""
    source = model.map
    if isinstance(source, GridMap):
        kit.draw_cells(axes, source, scale, colour=_WALL)
    elif isinstance(source, VoxelMap):
        _draw_voxels(axes, source)
    elif isinstance(source, tuple):
        kit.draw_polygons(
            axes, as_shapely(source), scale, fc=_WALL, ec=_EDGE, lw=0.6, gid="obstacle"
        )
    else:
        points = source[:: max(len(source) // _POINTS, 1)] * scale
        if model.dimensions == 2:
            radius = [model.radius * scale] * len(points)
            kit.draw_circles(axes, points, radius, fc=_WALL, ec="none", zorder=1, gid="obstacle")
        else:
            kit.dots(axes, points, "o", _EDGE, size=3, zorder=1, gid="obstacle")


def _draw_voxels(axes: Any, source: VoxelMap) -> None:
    """Draw the faces of blocked voxels, or of larger blocks if they are more than `_FACES`."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    blocked, cell = source.blocked, source.cell
    faces = _faces(blocked)
    while len(faces) > _FACES and min(blocked.shape) > 1:  # draw blocks of 8 voxels instead
        even = [(0, size % 2) for size in blocked.shape]
        parts = np.pad(blocked, even)
        shape = [part for size in parts.shape for part in (size // 2, 2)]
        blocked = parts.reshape(shape).mean(axis=(1, 3, 5)) >= 0.5
        faces, cell = _faces(blocked), 2.0 * cell
    if len(faces):
        axes.add_collection3d(
            Poly3DCollection(source.origin + faces * cell, facecolor=_WALL, edgecolor=_EDGE, lw=0.2,
                             alpha=0.3, zorder=1, gid="obstacle")
        )  # fmt: skip


def _faces(blocked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the faces of blocked voxels that border on free ones, shape (n, 4, 3), in voxels."""
    framed = np.pad(blocked, 1)
    cells = np.argwhere(blocked)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    faces = []
    for axis in range(3):
        for side in (0, 1):
            beside = cells + 1
            beside[:, axis] += 2 * side - 1
            shown = cells[~framed[tuple(beside.T)]]
            faces.append(shown[:, None] + np.insert(square, axis, side, axis=1))
    return np.concatenate(faces)


@kit.animated(draw, FlightPlan)
def animate_flight(model: Flight, plan: FlightPlan | Any, figure: Any) -> Any:
    """Animate the picture of a flight: the vehicle with its velocity, and markers on every curve.

    Parameters
    ----------
    model : Flight
        Model.
    """
    curve, axes = required("plan", plan, FlightPlan).trajectory, figure.axes[0]
    times = _times(curve)
    scale = kit.scale_of(axes)
    places, steps = (curve(times, order) * scale for order in (0, 1))
    steps *= 0.15 * np.ptp(places, axis=0).max() / (np.linalg.norm(steps, axis=1).max() or 1.0)
    movers = [kit.Mover(axes, times, places, kit.colour_of(0), steps)]
    movers += [kit.Mover(axes, times, entry(times) * scale, kit.RED) for entry in model.moving]
    return [*kit.curve_movers(figure), *movers], "t =", "s"
