"""The picture of a trajectory: where it flies, and its derivatives over time against their limits.

On the left the path through its waypoints, coloured by speed, in the corridor; on the right one
panel a derivative, one line an axis. Dashed lines are limits, and where the plan breaks a condition
the worst place is ringed in red on both sides.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ....errors import InvalidData
from ...fields import show
from ...plots.style import BLACK, RED, number
from ..bounds import derivative_name
from .data import Scene, given_times, pretty_unit, scene_of
from .panels import draw_panel, panel_handles, title_of, told
from .path import draw_path

if TYPE_CHECKING:
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

    from ..trajectory import Trajectory

__all__ = ["draw"]

#: The share of the path in the width, where derivatives stand beside it.
_LEFT = 0.53
#: The highest derivative that can be drawn.
_HIGHEST = 15
#: Conditions named in the title; more are counted.
_MOST_NAMED = 2


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
        The plan is no trajectory of the model's shape, or an option has a value that is not
        allowed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene = scene_of(model, plan, names)
    shown = _shown(axes, scene.dimensions)
    orders = _orders(derivatives, scene, shown)
    if labels is not None and not isinstance(labels, bool):
        raise InvalidData(f"labels must be True, False or None, got {show(labels)}", field="labels")
    figure = Figure(figsize=_size(size, len(orders)), dpi=150)
    FigureCanvasAgg(figure)
    if orders:
        halves: Any = figure.subfigures(1, 2, width_ratios=[_LEFT, 1 - _LEFT], wspace=0.0)
        left, right = halves
    else:
        left = figure
    broad, tall = (float(edge) for edge in figure.get_size_inches())
    _left(scene, shown, orders, left, (broad * (_LEFT if orders else 1), tall), labels)
    if orders:
        _right(scene, orders, right, (broad * (1 - _LEFT), tall))
    text = _title(scene) if title is None else title
    figure.suptitle(
        text, fontsize=11, y=1 - 0.13 / tall, va="top", color=RED if scene.violated else BLACK
    )
    return figure


# -- options -------------------------------------------------------------------------------------


def _whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _listed(value: Any) -> list[Any] | None:
    """Return the entries of `value`, None where it is no list of them."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return None
    return list(value)


def _shown(axes: Any, dimensions: int) -> tuple[int, ...]:
    if axes is None:
        return tuple(range(min(dimensions, 3)))
    listed = _listed(axes)
    if (
        listed is None
        or not 1 <= len(listed) <= 3
        or not all(_whole(axis) and 0 <= axis < dimensions for axis in listed)
        or len(set(listed)) < len(listed)
    ):
        raise InvalidData(
            f"axes must hold 1 to 3 different axes from 0 to {dimensions - 1}, got {show(axes)}",
            field="axes",
        )
    return tuple(int(axis) for axis in listed)


def _orders(derivatives: Any, scene: Scene, shown: tuple[int, ...]) -> list[int]:
    if derivatives is None:
        # With one axis, the position over time stands on the left already.
        first = 1 if scene.dimensions == 1 else 0
        found = list(range(first, int(getattr(scene.model, "order", 4)) + 1))
    elif _whole(derivatives) and 0 <= derivatives <= _HIGHEST:
        found = list(range(int(derivatives) + 1))
    else:
        listed = _listed(derivatives)
        if (
            listed is None
            or not all(_whole(order) and 0 <= order <= _HIGHEST for order in listed)
            or len(set(listed)) < len(listed)
        ):
            raise InvalidData(
                f"derivatives must be a whole number from 0 to {_HIGHEST}, or different ones in a "
                f"tuple, got {show(derivatives)}",
                field="derivatives",
            )
        found = [int(order) for order in listed]
    return [] if scene.plan is None else found


def _size(size: Any, panels: int) -> tuple[float, float]:
    if size is None:
        return (12.5, max(5.8, 1.25 + 1.2 * panels)) if panels else (6.9, 5.8)
    try:
        width, height = (float(edge) for edge in size)
    except (TypeError, ValueError):
        width = height = 0.0
    if not (0 < width <= 100 and 0 < height <= 100):
        raise InvalidData(
            f"size must be width and height in inches, each > 0 and <= 100, got {show(size)}",
            field="size",
        )
    return width, height


# -- what stands around --------------------------------------------------------------------------


def _title(scene: Scene) -> str:
    model = scene.model
    name = getattr(model, "name", "")
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
    text = f"{name}  ·  {', '.join(parts)}" if name else ", ".join(parts)
    if scene.violated:
        broken = [check.name for check in scene.violated]
        more = len(broken) - _MOST_NAMED
        listed = ", ".join(broken[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
        text += f"\nNOT VALID: {listed}"
    return text


def _what(model: Any) -> str:
    order = int(getattr(model, "order", 4))
    weights = getattr(model, "weights", None)
    orders = [order] if weights is None else [k for k, w in enumerate(weights, 1) if w]
    words = "minimum " + " + ".join(derivative_name(k) for k in orders)
    return words if given_times(model) is not None else f"{words}, times chosen"


def _left(
    scene: Scene, shown: tuple[int, ...], orders: list[int], figure: Any,
    inches: tuple[float, float], labels: bool | None,
) -> None:  # fmt: skip
    broad, tall = inches
    space, planned = len(shown) == 3, scene.plan is not None
    low, high = _margins(tall, 0.98 + (0.1 if planned else -0.3) * space, 0.66)
    begin, end = _margins(broad, *((0.0, 0.65) if space else (0.65, 1.2 if planned else 0.25)))
    place = (begin, low, end - begin, high - low)
    notes: list[str] = []
    if len(shown) == 1:
        axes = figure.add_axes(place)
        coloured = draw_panel(scene, 0, axes, only=shown, coloured=True)
        axes.set_ylabel(f"{scene.names[shown[0]]} (m)", fontsize=8.5)
        axes.set_xlabel("time (s)" if scene.timed else "knot", fontsize=8.5)
        handles = panel_handles(scene, [axes])
    else:
        # In space the order of drawing is ours: matplotlib would put far markers behind the path.
        kind = {"projection": "3d", "computed_zorder": False} if space else {}
        axes = figure.add_axes(place, **kind)
        coloured, handles, notes = draw_path(scene, shown, axes, labels=labels)
    if coloured is not None:
        # The frame of space needs the width, so the bar lies below it.
        across = (0.27, 0.85 / tall, 0.4, 0.09 / tall)
        upright = (end + 0.22 / broad, low + 0.15 * (high - low), 0.13 / broad, 0.7 * (high - low))
        _speed_bar(scene, shown, figure, coloured, across if space else upright)
    if handles:
        figure.legend(
            handles=handles, loc="lower center", bbox_to_anchor=(0.47, 0.08 / tall),
            ncols=len(handles), fontsize=7.5, frameon=False, handletextpad=0.3, columnspacing=1.2,
        )  # fmt: skip
    # What no panel tells.
    broken = [told(mark) for mark in scene.marks if mark.axis < 0 or mark.order not in orders]
    for text, colour, line in (("; ".join(broken), RED, 0.02), ("; ".join(notes), "#505050", 0.16)):
        if text:
            figure.text(0.02, high + line / tall, text, fontsize=7.5, color=colour, va="bottom")


def _margins(length: float, before: float, after: float) -> tuple[float, float]:
    """Return where a frame begins and ends, with these margins (inch) where there is room."""
    return min(before / length, 0.35), max(1 - after / length, 0.55)


def _right(scene: Scene, orders: list[int], figure: Any, inches: tuple[float, float]) -> None:
    broad, tall = inches
    panels = list(figure.subplots(len(orders), 1, sharex=True, squeeze=False)[:, 0])
    low, high = _margins(tall, 0.5, 0.92)
    begin, end = _margins(broad, 0.78, 0.15)
    figure.subplots_adjust(left=begin, right=end, bottom=low, top=high, hspace=0.22)
    for order, axes in zip(orders, panels, strict=True):
        draw_panel(scene, order, axes)
        axes.set_ylabel(title_of(order), fontsize=8)
    panels[-1].set_xlabel("time (s)", fontsize=8.5)
    figure.align_ylabels(panels)
    handles = [h for h in panel_handles(scene, panels) if h.get_label() != "worst violation"]
    figure.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.55, 1 - 0.50 / tall),
        ncols=len(handles), fontsize=7.5, frameon=False, handletextpad=0.4, columnspacing=1.2,
    )  # fmt: skip


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
