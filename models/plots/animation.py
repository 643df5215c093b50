"""Animations on a map: the figure, its clock, and the frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from .maps import dress_map, length_unit
from .style import DARK, headline, sheet

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Stage", "play", "stage_of"]


class Stage(NamedTuple):
    """Map with a clock below it.

    Parameters
    ----------
    figure, axes
        Matplotlib figure and axes.
    scale : float
        Factor from metres to the unit of the axes.
    clock
        Text below the map, set with ``clock.set_text``.
    """

    figure: Figure
    axes: Axes
    scale: float
    clock: Any


def stage_of(low: NDArray[Any], high: NDArray[Any], *, title: str, size: Any) -> Stage:
    """Return an empty map of the box from `low` to `high`, shape (2,), m; `size` in inches."""
    figure = sheet(size, (6.4, 6.0))
    broad, tall = figure.get_size_inches()
    axes = figure.add_axes((0.72 / broad, 0.72 / tall, 1 - 0.9 / broad, 1 - 1.14 / tall))
    scale, unit = length_unit(float((high - low).max()))
    dress_map(axes, low * scale, high * scale, unit)
    headline(figure, title, wrong=False)
    clock = figure.text(0.5, 0.1 / tall, "", ha="center", fontsize=9, color=DARK)
    return Stage(figure, axes, scale, clock)


def play(
    stage: Stage, update: Callable[[int], list[Any]], frames: int, interval: float
) -> FuncAnimation:
    """Return the animation; `update` draws a frame, and `interval` is its duration in ms."""
    from matplotlib.animation import FuncAnimation

    # Draw the first frame at once, so that the figure is complete even if it is never played.
    update(0)
    return FuncAnimation(stage.figure, update, frames=frames, interval=interval, blit=False)
