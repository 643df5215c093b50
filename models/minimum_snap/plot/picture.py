"""Figure of a trajectory: its path, and its derivatives over time with their limits.

The left half shows the path through its waypoints, coloured by speed, in the corridor. The right
half has one panel per derivative and one line per axis. Dashed lines are limits. If the plan
violates a condition, a red ring marks the largest violation on both sides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...plots.options import check_flags, check_list, is_whole
from ...plots.panels import draw_panel, draw_panels, keys_of
from ...plots.space import space_axes
from ...plots.style import (
    RED,
    headline,
    inches,
    legend_below,
    number,
    pretty_unit,
    sheet,
    title_of,
)
from ..bounds import derivative_name
from .data import Scene, given_times, scene_of
from .panels import describe_violation, panel_of, span_of
from .path import draw_path, line_by_speed

if TYPE_CHECKING:
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

    from ..trajectory import Trajectory

__all__ = ["draw"]

#: Share of the figure's width for the path if derivatives are drawn.
_LEFT = 0.53
#: Highest order of a derivative that can be drawn.
_HIGHEST = 15


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
) -> Figure:
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
        of the model. An empty tuple draws the path alone.
    names : tuple of str, optional
        Names of the axes, by default x, y, z, and numbers if there are more than three.
    labels : bool, optional
        Whether to number the waypoints, by default if they are few enough to be legible.
    title : str, optional
        Title of the figure. By default the instance's name, the objective, its value and the
        duration.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        Figure with the axes of the path, the colour bar of its speed, and one panel per derivative.

    Raises
    ------
    InvalidData
        `plan` is not a trajectory of the model's shape.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    scene = scene_of(model, plan, names)
    shown = _shown(axes, scene.dimensions)
    orders = _orders(derivatives, scene)
    if labels is not None:
        check_flags(labels=labels)
    count = len(orders)
    figure = sheet(size, (12.5, max(5.8, 1.25 + 1.2 * count)) if count else (6.9, 5.8))
    text = _title(scene) if title is None else title
    left: Any = figure
    if orders:
        halves: Any = figure.subfigures(1, 2, width_ratios=[_LEFT, 1 - _LEFT], wspace=0.0)
        left, right = halves
    _left(scene, shown, orders, left, labels)
    if orders:
        draw_panels(
            right, [panel_of(scene, order) for order in orders], [span_of(scene)], title=text,
            wrong=False, label="time (s)", ruled=True,
        )  # fmt: skip
    headline(figure, text, wrong=bool(scene.violated))
    return figure


def _shown(axes: Any, dimensions: int) -> tuple[int, ...]:
    if axes is None:
        return tuple(range(min(dimensions, 3)))
    last = dimensions - 1
    allowed = f"hold 1 to 3 different axes from 0 to {last}"
    return tuple(check_list("axes", axes, lambda item: is_whole(item, 0, last), allowed, most=3))


def _orders(derivatives: Any, scene: Scene) -> list[int]:
    if derivatives is None:
        # With one axis, the left half already shows the position over time.
        first = 1 if scene.dimensions == 1 else 0
        orders = list(range(first, int(getattr(scene.model, "order", 4)) + 1))
    elif is_whole(derivatives, 0, _HIGHEST):
        orders = list(range(int(derivatives) + 1))
    else:
        allowed = f"be a whole number from 0 to {_HIGHEST}, or different ones in a tuple"
        orders = check_list(
            "derivatives", derivatives, lambda item: is_whole(item, 0, _HIGHEST), allowed, least=0
        )
    return [] if scene.plan is None else orders


def _title(scene: Scene) -> str:
    model = scene.model
    if scene.plan is None:
        parts = [model.describe()]
    else:
        count = scene.segments
        parts = [_what(model), f"{count} segment{'' if count == 1 else 's'}"]
        verification = scene.verification
        if verification is not None and verification.objective is not None:
            unit = pretty_unit(model.objective_unit)
            letter = "J" if given_times(model) is not None else "objective"
            parts.append(f"{letter} = {number(verification.objective)} {unit}".rstrip())
        parts.append(f"{number(scene.plan.duration, 5)} s")
    return title_of(getattr(model, "name", ""), parts, scene.verification)


def _what(model: Any) -> str:
    order = int(getattr(model, "order", 4))
    weights = getattr(model, "weights", None)
    orders = [order] if weights is None else [k for k, w in enumerate(weights, 1) if w]
    words = "minimum " + " + ".join(derivative_name(k) for k in orders)
    return words if given_times(model) is not None else f"{words}, times chosen"


def _left(
    scene: Scene, shown: tuple[int, ...], orders: list[int], figure: Any, labels: bool | None
) -> None:
    broad, tall = inches(figure)
    space, planned = len(shown) == 3, scene.plan is not None
    low, high = _margins(tall, 0.98 + (0.1 if planned else -0.3) * space, 0.66)
    begin, end = _margins(broad, *((0.0, 0.65) if space else (0.65, 1.2 if planned else 0.25)))
    place = (begin, low, end - begin, high - low)
    notes: list[str] = []
    coloured: Collection | None = None
    if len(shown) == 1:
        axes = figure.add_axes(place)
        panel = panel_of(scene, 0, shown)
        draw_panel(panel, axes, [span_of(scene)], wrong=False, ruled=True)
        for line in [line for line in axes.lines if str(line.get_gid()).startswith("curve")]:
            speed = np.abs(scene.samples(1)[:, shown[0]])
            coloured = line_by_speed(np.column_stack(line.get_data()), speed, axes)
            line.remove()
        axes.set_ylabel(f"{scene.names[shown[0]]} (m)", fontsize=8.5)
        axes.set_xlabel("time (s)" if scene.timed else "knot", fontsize=8.5)
        handles = keys_of([panel], [axes])
    else:
        axes = space_axes(figure, place) if space else figure.add_axes(place)
        coloured, handles, notes = draw_path(scene, shown, axes, labels=labels)
    if coloured is not None:
        # 3-D axes need the full width, so the colour bar is below them.
        across = (0.27, 0.85 / tall, 0.4, 0.09 / tall)
        upright = (end + 0.22 / broad, low + 0.15 * (high - low), 0.13 / broad, 0.7 * (high - low))
        _speed_bar(scene, shown, figure, coloured, across if space else upright)
    legend_below(figure, handles, 0.47)
    # Violations that no panel shows are listed as text.
    broken = [
        describe_violation(mark)
        for mark in scene.marks
        if mark.axis < 0 or mark.order not in orders
    ]
    for text, colour, line in (("; ".join(broken), RED, 0.02), ("; ".join(notes), "#505050", 0.16)):
        if text:
            figure.text(0.02, high + line / tall, text, fontsize=7.5, color=colour, va="bottom")


def _margins(length: float, before: float, after: float) -> tuple[float, float]:
    """Return start and end of a frame as shares of `length`, with margins in inches if they fit."""
    return min(before / length, 0.35), max(1 - after / length, 0.55)


def _speed_bar(
    scene: Scene, shown: tuple[int, ...], figure: Any, coloured: Collection,
    place: tuple[float, float, float, float],
) -> None:  # fmt: skip
    whole = len(shown) == scene.dimensions
    along = "" if whole else " along " + ", ".join(scene.names[axis] for axis in shown)
    way = "horizontal" if len(shown) == 3 else "vertical"
    bar = figure.colorbar(coloured, cax=figure.add_axes(place), orientation=way)
    bar.set_label(f"speed{along} (m/s)", fontsize=8, labelpad=2)
    bar.ax.tick_params(labelsize=7.5, pad=2)
    bar.outline.set_visible(False)
