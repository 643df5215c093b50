"""Figure of a trajectory: its path, and its derivatives over time with their limits.

The left half shows the path through its waypoints, coloured by speed, in the corridor. The right
half has one panel per derivative and one line per axis. Dashed lines are limits. If the plan
violates a condition, a red ring marks the largest violation on both sides.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...plots import kit
from ..bounds import derivative_name, derivative_unit
from ..trajectory import Trajectory
from .data import Scene, Violation, given_times
from .path import draw_path, line_by_speed
from .vehicle import pin_limits, vehicle_panels

if TYPE_CHECKING:
    from matplotlib.collections import Collection

__all__ = ["animate_flight", "draw"]

#: Share of the figure's width for the path if derivatives are drawn.
_LEFT = 0.53
#: Highest order of a derivative that can be drawn.
_HIGHEST = 15


@kit.documented
def draw(
    model: Any,
    plan: Trajectory | None = None,
    *,
    axes: tuple[int, ...] | None = None,
    derivatives: int | tuple[int, ...] | None = None,
    names: tuple[str, ...] | None = None,
    labels: bool | None = None,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the waypoints and the corridor of `model`, and `plan` with its derivatives.

    Parameters
    ----------
    model : MinimumDerivative
        Model, or any other model with ``waypoints``. A model without ``times`` uses those of the
        plan.
    plan : Trajectory, optional
        Trajectory with the model's segments, feasible or not. Red rings mark the largest violation
        of each condition. None draws the data only.
    axes : tuple of int, optional
        Axes of the path: three for space, two for a plane, one for the position over time. By
        default the first three, or all if there are fewer.
    derivatives : int or tuple of int, optional
        Derivatives over time: all up to this order, or a tuple of orders. By default up to the order
        of the model, or up to the velocity if the model has a vehicle. An empty tuple draws the path
        alone. The limited quantities of a vehicle follow the derivatives.
    names : tuple of str, optional
        Names of the axes, by default x, y, z, and numbers if there are more than three.
    labels : bool, optional
        Whether to number the waypoints, by default if they are few enough to be legible.
    """
    scene = Scene(model, plan, names)
    shown = _shown(axes, scene.dimensions)
    orders = _orders(derivatives, scene)
    kit.check_flags(optional=True, labels=labels)
    text = kit.title_of(model, _words(scene), scene.verification, title)
    limited = vehicle_panels(scene) if orders else []
    rows = len(orders) + len(limited)
    default = (12.5, max(5.8, 1.25 + 1.2 * rows)) if orders else (6.9, 5.8)
    sheet = kit.Scene(text, scene.verification, size, default)
    left, right = sheet.halves(_LEFT, 1 - _LEFT) if orders else (sheet, sheet)
    _draw_left(scene, shown, orders, left, labels)
    if orders:
        panels = [*(_panel(scene, order) for order in orders), *limited]
        places = kit.draw_panels(
            right.figure, panels, [_span(scene)], title=text, wrong=False, label="time (s)",
            ruled=True,
        )  # fmt: skip
        for mark in scene.pins:
            if mark.order in orders:
                kit.pin(places[orders.index(mark.order)], mark.check, mark.time, mark.value)
        pin_limits(scene, limited, list(places))
    return sheet.figure


def _shown(axes: Any, dimensions: int) -> tuple[int, ...]:
    if axes is None:
        return tuple(range(min(dimensions, 3)))
    allowed = f"hold 1 to 3 different axes from 0 to {dimensions - 1}"
    good = partial(kit.is_whole, low=0, high=dimensions - 1)
    return tuple(kit.check_list("axes", axes, good, allowed, most=3))


def _orders(derivatives: Any, scene: Scene) -> list[int]:
    if derivatives is None:
        # With one axis, the left half already shows the position over time.
        first = 1 if scene.dimensions == 1 else 0
        # The quantities of a vehicle take the place of the higher derivatives.
        most = 1 if getattr(scene.model, "vehicle", None) else int(getattr(scene.model, "order", 4))
        orders = list(range(first, most + 1))
    elif kit.is_whole(derivatives, 0, _HIGHEST):
        orders = list(range(int(derivatives) + 1))
    else:
        allowed = f"be a whole number from 0 to {_HIGHEST}, or different ones in a tuple"
        good = partial(kit.is_whole, low=0, high=_HIGHEST)
        orders = kit.check_list("derivatives", derivatives, good, allowed, least=0)
    return [] if scene.plan is None else orders


def _words(scene: Scene) -> list[str]:
    """Return the parts of the title."""
    model = scene.model
    if scene.plan is None:
        return [model.describe()]
    timed, order = given_times(model) is not None, int(getattr(model, "order", 4))
    weights = getattr(model, "weights", None)
    orders = [order] if weights is None else [k for k, w in enumerate(weights, 1) if w]
    what = "minimum " + " + ".join(derivative_name(k) for k in orders)
    parts = [what if timed else f"{what}, times chosen", kit.many(scene.segments, "segment")]
    result = scene.verification
    if result is not None and result.objective is not None:
        value = f"{kit.number(result.objective)} {kit.pretty_unit(model.objective_unit)}".rstrip()
        parts.append(f"{'J' if timed else 'objective'} = {value}")
    return [*parts, f"{kit.number(scene.plan.duration, 5)} s"]


def _draw_left(
    scene: Scene, shown: tuple[int, ...], orders: list[int], frame: kit.Frame, labels: bool | None
) -> None:
    broad, tall, figure = frame.broad, frame.tall, frame.figure
    space, planned = len(shown) == 3, scene.plan is not None
    low, high = _margins(tall, 0.98 + (0.1 if planned else -0.3) * space, 0.66)
    begin, end = _margins(broad, *((0.0, 0.65) if space else (0.65, 1.2 if planned else 0.25)))
    place = (begin, low, end - begin, high - low)
    notes: list[str] = []
    coloured: Collection | None = None
    if len(shown) == 1:
        axes = figure.add_axes(place)
        panel = _panel(scene, 0, shown)
        kit.draw_panel(panel, axes, [_span(scene)], wrong=False, ruled=True)
        for line in [line for line in axes.lines if str(line.get_gid()).startswith("curve")]:
            speed = np.abs(scene.samples(1)[:, shown[0]])
            coloured = line_by_speed(np.column_stack(line.get_data()), speed, axes)
            line.remove()
        kit.label_axes(
            axes, "time (s)" if scene.timed else "knot (number)", f"{scene.names[shown[0]]} (m)"
        )
        handles = kit.keys_of([panel], [axes])
        for mark in scene.pins:
            kit.pin(axes, mark.check, mark.time, mark.position[shown[0]])
    else:
        axes = kit.space_axes(figure, place) if space else figure.add_axes(place)
        coloured, handles, notes = draw_path(scene, shown, axes, labels=labels)
    if coloured is not None:
        # 3-D axes need the full width, so the colour bar is below them.
        across = (0.27, 0.85 / tall, 0.4, 0.09 / tall)
        upright = (end + 0.22 / broad, low + 0.15 * (high - low), 0.13 / broad, 0.7 * (high - low))
        whole = len(shown) == scene.dimensions
        along = "" if whole else " along " + ", ".join(scene.names[axis] for axis in shown)
        way = "horizontal" if space else "vertical"
        bar = figure.add_axes(across if space else upright)
        kit.color_bar(figure, coloured, bar, f"speed{along} (m/s)", orientation=way)
        bar.tick_params(labelsize=7.5, pad=2)
    frame.legend(handles, 1, x=0.47 * broad)
    # Violations that no panel shows are listed as text.
    broken = [_describe(mark) for mark in scene.marks if mark.axis < 0 or mark.order not in orders]
    for text, colour, line in (
        ("; ".join(broken), kit.RED, 0.02),
        ("; ".join(notes), "#505050", 0.16),
    ):
        if text:
            figure.text(0.02, high + line / tall, text, fontsize=7.5, color=colour, va="bottom")


def _margins(length: float, before: float, after: float) -> tuple[float, float]:
    """Return start and end of a frame as shares of `length`, with margins in inches if they fit."""
    return min(before / length, 0.35), max(1 - after / length, 0.55)


def _panel(scene: Scene, order: int, only: tuple[int, ...] = ()) -> kit.Panel:
    """Return the panel of one derivative for the axes `only`, or for all axes."""
    axes = list(only) or list(range(scene.dimensions))
    curves: list[kit.Curve] = []
    if scene.plan is not None:
        values, times = scene.samples(order), scene.sample_times
        # Thick lines of a noisy curve would merge into a solid bar.
        width = 0.6 if order and scene.segments > 2 * kit.MOST_KNOTS else 1.4
        curves = [kit.Curve(scene.names[k], k, times, values[:, k], width) for k in axes]
    marks = _fixed(scene, order, axes, "waypoint" if only else "fixed value")
    for mark in scene.marks:
        if mark.order == order and mark.axis in axes:
            place = np.array([mark.time]), np.array([mark.value])
            marks.append(kit.Mark("worst violation", *place, note=_describe(mark)))
    limits, unit = _limits(scene, order, axes), derivative_unit(order)
    return kit.Panel(derivative_name(order), unit, curves, limits, marks)


def _span(scene: Scene) -> kit.Span:
    """Return the time span of the model and the plan, and the model's knots."""
    ends = np.concatenate([scene.times, scene.flown])
    return kit.Span("", float(ends.min()), float(ends.max()), scene.times)


def _describe(mark: Violation) -> str:
    """Return a note such as ``"velocity limit violated by 0.462 m/s at 1.026 s"``."""
    by = f"{kit.number(mark.check.worst, 3)} {kit.pretty_unit(mark.check.unit)}"
    return f"{mark.check.name} violated by {by} at {kit.number(mark.time, 4)} s"


def _fixed(scene: Scene, order: int, axes: list[int], kind: str) -> list[kit.Mark]:
    """Return marks of the fixed values at the knots, or no marks if the knots are too many."""
    crowd = scene.plan is not None and len(scene.times) > kit.MOST_KNOTS
    if crowd or order >= scene.conditions.shape[1]:
        return []
    tables = [(axis, scene.conditions[:, order, axis]) for axis in axes]
    known = [(axis, values, np.isfinite(values)) for axis, values in tables]
    return [kit.Mark(kind, scene.times[at], values[at], k) for k, values, at in known if at.any()]


def _limits(scene: Scene, order: int, axes: list[int]) -> list[kit.Limit]:
    """Return the bounds on a derivative per segment, merged for axes with equal bounds."""
    times = np.repeat(scene.flown, 2)[1:-1]
    result = []
    for bound in scene.bounds_of(order):
        groups: dict[bytes, list[int]] = {}
        for axis in axes:
            same = bound.lower[:, axis].tobytes() + bound.upper[:, axis].tobytes()
            groups.setdefault(same, []).append(axis)
        for group in groups.values():
            lower, upper = (np.repeat(side[:, group[0]], 2) for side in (bound.lower, bound.upper))
            if np.isfinite(lower).any() or np.isfinite(upper).any():
                whose = tuple(group) if len(groups) > 1 else ()
                band = "corridor of an axis" if whose and not order else ""
                result.append(kit.Limit(times, lower, upper, whose, band=band))
    return result


@kit.animated(draw, Trajectory)
def animate_flight(model: Any, plan: Trajectory | Any, figure: Any) -> Any:
    """Animate the picture of a trajectory: the vehicle with its velocity, and markers on every curve.

    A line from the vehicle shows its velocity. At the highest speed, it is a quarter as long as the path is wide.

    Parameters
    ----------
    model : MinimumDerivative
        Model, or any other model with ``waypoints``.
    """
    scene, axes = Scene(model, plan, None), figure.axes[0]
    chosen = list(_shown(None, scene.dimensions))
    places, steps = (scene.samples(order)[:, chosen] for order in (0, 1))
    if len(chosen) == 1:
        places = np.insert(places, 0, scene.sample_times, axis=1)
        steps = np.insert(steps, 0, 1.0, axis=1)
    steps *= 0.25 * np.ptp(places, axis=0).max() / (np.linalg.norm(steps, axis=1).max() or 1.0)
    vehicle = kit.Mover(axes, scene.sample_times, places, kit.RED, steps)
    return [*kit.curve_movers(figure), vehicle], "t =", "s"
