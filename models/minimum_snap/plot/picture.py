"""The picture of a trajectory: where it flies, and its derivatives over time against their limits.

On the left the path through its waypoints, coloured by speed, in the corridor; on the right one
panel a derivative, one line an axis. Dashed lines are limits, and where the plan breaks a condition
the worst place is ringed in red on both sides.
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
from .panels import panel_of, span_of, told
from .path import draw_path, line_by_speed

if TYPE_CHECKING:
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

    from ..trajectory import Trajectory

__all__ = ["draw"]

#: The share of the path in the width, where derivatives stand beside it.
_LEFT = 0.53
#: The highest derivative that can be drawn.
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
        The model, or any other with ``waypoints``; without ``times`` of its own, those of the plan
        count.
    plan : Trajectory, optional
        A trajectory with as many segments, valid or not; where it breaks a condition, the worst
        place is ringed in red. None draws the data only.
    axes : tuple of int, optional
        The axes of the path's picture: three for space, two for a plane, one for its position
        over time. By default the first three, or as many as there are.
    derivatives : int or tuple of int, optional
        The derivatives over time: up to this one, or these. By default up to the order of the
        model; an empty tuple draws the path alone.
    names : tuple of str, optional
        Names of the axes, by default x, y, z, and numbers for more.
    labels : bool, optional
        Whether to number the waypoints, by default where they are few enough to be read.
    title : str, optional
        Instead of the instance's name, what is minimised, its value and the duration.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The path's axes, the colour bar of its speed, then one for each derivative.

    Raises
    ------
    InvalidData
        The plan is no trajectory of the model's shape.
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
    return tuple(check_list("axes", axes, lambda one: is_whole(one, 0, last), allowed, most=3))


def _orders(derivatives: Any, scene: Scene) -> list[int]:
    if derivatives is None:
        # With one axis, the position over time stands on the left already.
        first = 1 if scene.dimensions == 1 else 0
        found = list(range(first, int(getattr(scene.model, "order", 4)) + 1))
    elif is_whole(derivatives, 0, _HIGHEST):
        found = list(range(int(derivatives) + 1))
    else:
        allowed = f"be a whole number from 0 to {_HIGHEST}, or different ones in a tuple"
        found = check_list(
            "derivatives", derivatives, lambda one: is_whole(one, 0, _HIGHEST), allowed, least=0
        )
    return [] if scene.plan is None else found


def _title(scene: Scene) -> str:
    model = scene.model
    if scene.plan is None:
        parts = [model.describe()]
    else:
        count = scene.segments
        parts = [_what(model), f"{count} segment{'' if count == 1 else 's'}"]
        found = scene.verification
        if found is not None and found.objective is not None:
            unit = pretty_unit(model.objective_unit)
            letter = "J" if given_times(model) is not None else "objective"
            parts.append(f"{letter} = {number(found.objective)} {unit}".rstrip())
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
        # The frame of space needs the width, so the bar lies below it.
        across = (0.27, 0.85 / tall, 0.4, 0.09 / tall)
        upright = (end + 0.22 / broad, low + 0.15 * (high - low), 0.13 / broad, 0.7 * (high - low))
        _speed_bar(scene, shown, figure, coloured, across if space else upright)
    legend_below(figure, handles, 0.47)
    # What no panel tells.
    broken = [told(one) for one in scene.marks if one.axis < 0 or one.order not in orders]
    for text, colour, line in (("; ".join(broken), RED, 0.02), ("; ".join(notes), "#505050", 0.16)):
        if text:
            figure.text(0.02, high + line / tall, text, fontsize=7.5, color=colour, va="bottom")


def _margins(length: float, before: float, after: float) -> tuple[float, float]:
    """Return where a frame begins and ends, with these margins (inch) where there is room."""
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
