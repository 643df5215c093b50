"""Animations of finished pictures: markers that move along what is drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from .options import check_frames, documented
from .scene import Frame, Stage
from .style import BLACK, DARK, colour_of, number

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

__all__ = ["Mover", "animated", "curve_movers", "follow", "route_movers", "unit_of"]

_Markers = Callable[[Any, Any, Any], Any]


def animated(
    draw: Callable[..., Figure], kind: type
) -> Callable[[_Markers], Callable[..., FuncAnimation]]:
    """Return a decorator that makes an animation of the picture `draw` from a function of its markers.

    The function accepts the model, a plan of type `kind` and the picture. It returns the markers, and the name and
    the unit of the clock, which is in the upper right corner.
    """

    def decorate(markers: _Markers) -> Callable[..., FuncAnimation]:
        def animate(
            model: Any, plan: Any, *, frames: int = 120, interval: float = 60.0, title: str | None = None,
            size: tuple[float, float] | None = None,
        ) -> FuncAnimation:  # fmt: skip
            check_frames(frames, interval)
            plan = required("plan", model.as_plan(plan), kind)
            stage = Stage.__new__(Stage)
            text = (model.name or model.outline()) if title is None else title
            Frame.__init__(stage, draw(model, plan, title=text, size=size))
            stage.frames, stage.interval = frames, interval
            place = (1 - 0.1 / stage.broad, 1 - 0.1 / stage.tall)
            look: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 8, "color": DARK}
            stage.clock = stage.figure.text(*place, "", **look)
            return follow(stage, *markers(model, plan, stage.figure))

        for name in ("__module__", "__name__", "__qualname__", "__doc__"):
            setattr(animate, name, getattr(markers, name))
        animate.__annotations__ |= {
            name: markers.__annotations__[name] for name in ("model", "plan")
        }
        return documented(animate)

    return decorate


class Mover(NamedTuple):
    """Marker that follows `places`, shape (k, 2) or (k, 3), at ascending values `at` of a clock, shape (k,).

    It is hidden outside of these values. A line leads from the marker along `steps`, such as a velocity.
    """

    axes: Any
    at: NDArray[np.float64]
    places: NDArray[np.float64]
    colour: str = BLACK
    steps: NDArray[np.float64] | None = None


def curve_movers(figure: Any) -> list[Mover]:
    """Return a marker for each curve over time in the panels of a picture."""
    return [
        Mover(axes, times, np.column_stack([times, line.get_ydata()]), line.get_color())
        for axes in figure.axes
        for line in axes.lines
        if str(line.get_gid()).startswith("curve ") and len(times := np.asarray(line.get_xdata()))
    ]


def route_movers(axes: Any, lines: Sequence[NDArray[np.float64]]) -> list[Mover]:
    """Return a marker for each polyline, shape (k, 2), that moves at a speed of 1 and then waits at the end."""
    along = [np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T))) for line in lines]
    far = max((at[-1] for line, at in zip(lines, along, strict=True) if len(line)), default=0.0)
    return [
        Mover(axes, np.append(at, far), np.concatenate([line, line[-1:]]), colour_of(k))
        for k, (line, at) in enumerate(zip(lines, along, strict=True))
        if len(line)
    ]


def unit_of(axes: Any) -> str:
    """Return the unit in the label of the x axis."""
    return str(axes.get_xlabel()).rpartition("(")[2].rstrip(")")


def follow(stage: Stage, movers: Sequence[Mover], name: str, unit: str) -> FuncAnimation:
    """Return the animation of markers along lines; `name` and `unit` are those of the clock."""
    low, high = min(mover.at[0] for mover in movers), max(mover.at[-1] for mover in movers)
    clock, slack = np.linspace(low, high, stage.frames), 1e-9 * (high - low)
    drawn = []
    for axes, _, places, colour, steps in movers:
        nowhere = [[np.nan]] * places.shape[1]
        look: dict[str, Any] = {"color": colour, "zorder": 22, "clip_on": len(nowhere) < 3}
        artists = axes.plot(*nowhere, "o", ms=7.5, mec="white", gid="mover", **look)
        if steps is not None:
            artists += axes.plot(*nowhere, lw=1.8, gid="velocity", **look)
        drawn.append(artists)

    def show(frame: int) -> str:
        now = float(clock[frame])
        for (_, at, places, _, steps), artists in zip(movers, drawn, strict=True):
            table = places if steps is None else np.hstack([places, places + steps])
            inside = at[0] - slack <= now <= at[-1] + slack
            row = [np.interp(now, at, column) if inside else np.nan for column in table.T]
            ends = np.reshape(row, (-1, places.shape[1]))
            for artist, line in zip(artists, (ends[:1], ends), strict=False):
                (artist.set_data_3d if ends.shape[1] == 3 else artist.set_data)(*line.T)
        return f"{name} {number(now, 4)} of {number(float(high), 4)} {unit}".rstrip()

    return stage.play(show)
