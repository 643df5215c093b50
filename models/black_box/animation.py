"""Picture of a waypoint path on its map, and an animation of the search for it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import InvalidData
from ..fields import required, show
from ..plots import kit
from .model import BlackBoxMinimisation
from .waypoints import WaypointPath

__all__ = ["animate_search", "blocked_part", "box_of", "draw_field", "path_function"]

#: Number of points per segment at which a path is tested for blocked cells.
_POINTS = 2001
#: Number of earlier paths shown by an animation.
_EARLIER = 5


def path_function(model: BlackBoxMinimisation) -> WaypointPath:
    """Return the function of `model`, or raise if it is not the length of a path."""
    return required("function", model.function, WaypointPath)


def box_of(function: WaypointPath, lines: kit.Floats) -> tuple[kit.Floats, kit.Floats]:
    """Return the corners of the visible box, m: the map, and paths near it."""
    return kit.box_near(*kit.corners_of(function.map), [lines.reshape(-1, 2)])


def draw_field(axes: Any, function: WaypointPath, scale: float) -> list[Any]:
    """Draw the map with start and goal, and return the entries of a legend."""
    kit.draw_cells(axes, function.map, scale)
    ends = kit.draw_ends(axes, function.start[None] * scale, function.goal[None] * scale)
    return [*ends, kit.key("blocked", marker="s", mfc=kit.BLOCKED, mec=kit.BLOCKED, ms=7)]


def blocked_part(function: WaypointPath, line: kit.Floats) -> kit.Floats:
    """Return points along a path, shape (n, 2), with NaN at free points."""
    share = np.linspace(0, 1, _POINTS)[:, None]
    parts = [a + share * (b - a) for a, b in itertools.pairwise(line)]
    path = np.concatenate(parts)
    # A point on the side of a blocked cell is free, so its four neighbours are tested as well.
    shift = 1e-6 * function.map.cell
    around = [path + np.array([x, y]) * shift for x in (-1, 1) for y in (-1, 1)]
    near = (function.map.cells_of(np.clip(points, -1e15, 1e15)) for points in around)
    free = np.any([function.map.holds(cells) for cells in near], axis=0)
    return np.where(free[:, None], np.nan, path)


@kit.documented
def animate_search(
    model: BlackBoxMinimisation,
    incumbents: Sequence[Any],
    *,
    frames: int = 120,
    interval: float = 120.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Return an animation of the incumbents of a search, from one improvement to the next.

    Parameters
    ----------
    model : BlackBoxMinimisation
        Model whose function is a :class:`~crosstrack.models.black_box.WaypointPath`.
    incumbents : sequence of Incumbent or Event
        Incumbents in order: ``met`` after ``solve(model, "iafsa", on_event=met.append)``.
    frames : int
        Largest number of frames, at least 2; if there are more improvements, some are omitted.
    """
    function = path_function(required("model", model, BlackBoxMinimisation))
    stage = kit.Stage(model, title, size, frames, interval)
    plain = isinstance(incumbents, list | tuple)
    if plain:  # other events have no incumbent
        parts = [getattr(item, "incumbent", item) for item in incumbents]
        incumbents = [part for part in parts if part is not None]
    if not plain or not incumbents or not all(hasattr(line, "plan") for line in incumbents):
        raise InvalidData(
            "incumbents must be a list of at least one, as on_event receives them, got "
            f"{show(incumbents)}",
            field="incumbents",
        )
    selected = np.unique(np.linspace(0, len(incumbents) - 1, frames).round().astype(int))
    steps = [incumbents[k] for k in selected]
    lines = function.polylines(np.array([model.as_plan(line.plan).x for line in steps]))
    axes, scale = stage.map(*box_of(function, lines))
    draw_field(axes, function, scale)
    look, grey = kit.axis_style(0), {"lw": 0.8, "color": kit.GREY}
    earlier = [
        axes.plot([], [], alpha=0.7 * 0.7**k, zorder=3, gid="earlier path", **grey)[0]
        for k in range(_EARLIER)
    ]
    (path,) = axes.plot([], [], lw=2.0, zorder=5, marker="o", ms=3.5, gid="path", **look)
    (within,) = axes.plot(
        [], [], lw=2.4, color=kit.RED, zorder=6, gid="path through what is blocked"
    )
    keys = [kit.key("best so far", lw=2.0, **look), kit.key("before", **grey)]
    stage.legend_above(axes, [*keys, kit.key("blocked", lw=2.4, color=kit.RED)])

    def show_frame(frame: int) -> str:
        frame = min(frame, len(lines) - 1)
        path.set_data(*(lines[frame] * scale).T)
        within.set_data(*(blocked_part(function, lines[frame]) * scale).T)
        for k, line in enumerate(earlier):
            index = frame - 1 - k
            line.set_data(*(lines[index] * scale).T if index >= 0 else ([], []))
        return f"value {kit.number(steps[frame].objective)} after {steps[frame].seconds:.2f} s"

    return stage.play(show_frame, len(lines))
