"""Left half of a trajectory figure: path, waypoints and corridor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...plots import kit
from .data import Scene, regions

if TYPE_CHECKING:
    from matplotlib.collections import Collection

    from ..gates import Gate

__all__ = ["draw_path", "line_by_speed"]

_CORRIDOR, _EDGE, _GATE = "#dfe9f1", "#8fabc2", "#7b3294"
#: Largest number of regions with their own edges. More regions are drawn as their union.
_MOST_OUTLINES = 40
#: Largest number of bodies drawn.
_MOST_BODIES = 400
#: Largest number of waypoints drawn. More would hide the path.
_MOST_WAYPOINTS = 150
#: Largest number of waypoints with numbers.
_MOST_NUMBERS = 25
#: Points per segment that represent its curve when labels are placed.
_BETWEEN = 6
#: Minimum length of a side of the 3-D box, as a share of the longest side. Scales remain equal.
_FLATTEST = 0.3


def draw_path(
    scene: Scene, shown: tuple[int, ...], axes: Any, *, labels: bool | None = None
) -> tuple[Collection | None, list[Any], list[str]]:
    """Draw the path along two axes on a plane, or along three in space.

    Returns the path coloured by speed, None without a plan, the entries of a legend, and notes on omitted
    elements. By default, the waypoints are numbered if they are few.
    """
    low, high = _extent(scene)
    chosen = list(shown)
    begin, end = _window(low, high, chosen)
    handles, notes = _corridor(scene, shown, axes, low, high)
    places, known = _places(scene, chosen)
    coloured: Collection | None = None
    if scene.plan is None:
        axes.plot(*places[known].T, color=kit.GREY, lw=0.9, ls=(0, (2, 2)), zorder=3)
    else:
        way = scene.samples(0)[:, chosen]
        if len(shown) == 3:
            axes.plot(way[:, 0], way[:, 1], begin[2], color=kit.GREY, lw=0.8, alpha=0.55, zorder=1)
        coloured = line_by_speed(way, np.linalg.norm(scene.samples(1)[:, chosen], axis=1), axes)
    handles = _waypoints(scene, axes, places, known) + _gates(scene, chosen, axes) + handles
    worst = np.array([mark.position[chosen] for mark in scene.marks])
    handles += kit.ring(axes, worst, "worst violation")
    _frame(scene, chosen, axes, begin, end)
    for mark in scene.pins:
        kit.pin(axes, mark.check, *mark.position[chosen])
    if labels or (labels is None and len(places) <= _MOST_NUMBERS):
        _numbers(scene, chosen, axes, places)
    return coloured, handles, notes


def _extent(scene: Scene) -> tuple[kit.Floats, kit.Floats]:
    """Return the lower and upper corner of a box around the drawn elements, over all axes."""
    waypoints = scene.waypoints
    parts = [np.where(np.isfinite(waypoints), waypoints, np.nan)]
    if scene.plan is not None:
        parts.append(scene.samples(0))
    parts += [line for gate in _gates_of(scene) for line in gate.outlines()]
    points = np.vstack([*parts, np.full((1, scene.dimensions), np.nan)])
    free = np.isnan(points).all(axis=0)
    points[-1, free] = 0.0
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    # A large corridor is cut, so that the path remains visible.
    reach = 0.35 * (float((high - low).max()) or 1.0)
    for box in scene.bounds_of(0):
        below = np.where(np.isfinite(box.lower), box.lower, np.inf).min(axis=0)
        above = np.where(np.isfinite(box.upper), box.upper, -np.inf).max(axis=0)
        low = np.minimum(low, np.maximum(below, low - reach))
        high = np.maximum(high, np.minimum(above, high + reach))
    if scene.halfspaces is not None:
        low, high = low - 0.3 * reach, high + 0.3 * reach
    return low, high


def _places(scene: Scene, chosen: list[int]) -> tuple[kit.Floats, NDArray[np.bool_]]:
    """Return the position of each waypoint (NaN: not drawn), and whether it is completely fixed."""
    wanted = scene.waypoints[:, chosen]
    known = np.isfinite(wanted)
    places = np.where(known, wanted, np.nan)
    if scene.plan is not None:
        # Free coordinates follow the plan. Knots without a fixed coordinate are not drawn.
        at = scene.plan(np.clip(scene.times, scene.plan.times[0], scene.plan.times[-1]))
        places = np.where(known.any(axis=1, keepdims=True) & ~known, at[:, chosen], places)
    return places, np.asarray(known.all(axis=1), bool)


def _corridor(
    scene: Scene, shown: tuple[int, ...], axes: Any, low: kit.Floats, high: kit.Floats
) -> tuple[list[Any], list[str]]:
    from matplotlib.patches import Patch

    # Unbounded regions extend beyond a plane figure. In 3-D they end at the box of the figure.
    far, most = 4.0 * float((high - low).max()), None
    if len(shown) == 3:
        low, high = _window(low, high, list(range(scene.dimensions)))
        far, most = 0.0, _MOST_BODIES
    result, total, omitted = regions(scene, shown, low - far, high + far, most)
    notes = ["tilted half-spaces left out"] if omitted else []
    if not result:
        return [], notes
    _faces(result, axes, len(shown) == 3)
    label = "corridor" + f" ({most} of {total} drawn)" * (most is not None and total > most)
    return [Patch(facecolor=_CORRIDOR, edgecolor=_EDGE, lw=0.8, label=label)], notes


def _faces(bodies: list[list[kit.Floats]], axes: Any, space: bool) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    layers: list[tuple[Any, Any, float]] = [(_CORRIDOR, "none", 0.0), ("none", _EDGE, 0.7)]
    if len(bodies) > _MOST_OUTLINES:
        # All edges first and all faces over them, so that the outline of the union remains.
        layers = [(_EDGE, _EDGE, 1.6), (_CORRIDOR, _CORRIDOR, 0.4)]
    elif space:
        layers = [(to_rgba(_EDGE, 0.05), to_rgba(_EDGE, 0.7), 0.6)]
    kind: Any = Poly3DCollection if space else PolyCollection
    faces = [face for region in bodies for face in region]
    for layer, (face, edge, width) in enumerate(layers):
        drawn = kind(
            faces, facecolors=face, edgecolors=edge, linewidths=width, gid="corridor",
            zorder=(1.5 if space else 0.5) + 0.1 * layer,
        )  # fmt: skip
        (axes.add_collection3d if space else axes.add_collection)(drawn, autolim=False)


def line_by_speed(way: kit.Floats, speed: kit.Floats, axes: Any) -> Collection:
    """Draw a line through points, shape (samples, 2 or 3), coloured by speed (m/s)."""
    # Each knot has two samples.
    moved = np.append(True, (way[1:] != way[:-1]).any(axis=1))
    values = (0.5 * (speed[:-1] + speed[1:]))[moved[1:]]
    line: Collection = kit.draw_shaded_line(axes, way[moved], values, linewidths=2.2, zorder=3)
    line.set_clim(0.0, float(speed.max()) or 1.0)
    return line


def _waypoints(scene: Scene, axes: Any, places: kit.Floats, known: NDArray[np.bool_]) -> list[Any]:
    drawn = np.isfinite(places).all(axis=1)
    knot = np.arange(len(places))
    first, last = drawn & (knot == 0), drawn & (knot == knot[-1])
    inner = drawn & ~first & ~last & (scene.plan is None or len(places) <= _MOST_WAYPOINTS)
    # Many waypoints are drawn as dots, because rings would hide the path.
    crowd = len(places) > kit.MOST_KNOTS
    size = max(2.0, 10.0 * kit.MOST_KNOTS / len(places)) if crowd else 22
    edge = "none" if crowd else kit.BLACK
    partly = "waypoint, partly free"
    # The start is drawn last, so that it is visible if it coincides with the end.
    return [
        kit.dots(axes, places[rows], marker, face, size=size, edge=edge, zorder=zorder, label=label)
        for rows, marker, face, size, edge, zorder, label in (
            (inner & known, "o", kit.BLACK if crowd else "white", size, edge, 5, "waypoint"),
            (inner & ~known, "D", kit.GREY if crowd else "#c9c9c9", size, edge, 5, partly),
            (first, ">", "white", 34, kit.BLACK, 7, "start"),
            (last, "s", kit.BLACK, 52, kit.BLACK, 6, "end"),
        )
        if rows.any()
    ]


def _gates_of(scene: Scene) -> tuple[Gate, ...]:
    """Return the gates of the model, if it can have any."""
    return tuple(getattr(scene.model, "gates", ()))


def _gates(scene: Scene, chosen: list[int], axes: Any) -> list[Any]:
    """Draw the gates as lines; return the entries of the legend."""
    lines = [line[:, chosen] for gate in _gates_of(scene) for line in gate.outlines()]
    for line in lines:
        (drawn,) = axes.plot(*line.T, color=_GATE, lw=1.6, zorder=4, gid="gate")
        drawn.set_label("gate")
    return [drawn] if lines else []


def _numbers(scene: Scene, chosen: list[int], axes: Any, places: kit.Floats) -> None:
    """Draw the numbers of the knots at positions that hide the least of the figure."""
    knots = np.flatnonzero(np.isfinite(places).all(axis=1)).tolist()
    at, texts = places[knots], [str(knot) for knot in knots]
    if scene.plan is not None:
        # Unlabelled points between the knots represent the curve, which labels must not hide.
        part = np.arange(_BETWEEN * scene.segments + 1) / _BETWEEN
        at = scene.plan(np.interp(part, np.arange(len(places)), scene.plan.times))[:, chosen]
        texts = [""] * len(at)
        for knot in knots:
            at[_BETWEEN * knot], texts[_BETWEEN * knot] = places[knot], str(knot)
    kit.write_names(axes, at, texts, size=7.0, colour=kit.DARK)


def _window(low: kit.Floats, high: kit.Floats, chosen: list[int]) -> tuple[kit.Floats, kit.Floats]:
    """Return the limits of the shown axes, with flat sides widened."""
    span = (high - low)[chosen]
    half = np.maximum(1.08 * span, _FLATTEST * (float(span.max()) or 1.0)) / 2
    middle = ((low + high) / 2)[chosen]
    return middle - half, middle + half


def _frame(scene: Scene, chosen: list[int], axes: Any, begin: kit.Floats, end: kit.Floats) -> None:
    plane = len(chosen) == 2
    if plane:
        # For equal scales, widen the side with spare room.
        paper = np.array(axes.get_position().size) * kit.inches(axes.figure)
        half = paper * ((end - begin) / paper).max() / 2
        begin, end = (begin + end) / 2 - half, (begin + end) / 2 + half
    for name, axis, first, last in zip("xyz", chosen, begin, end, strict=False):
        getattr(axes, f"set_{name}lim")(first, last)
        getattr(axes, f"set_{name}label")(f"{scene.names[axis]} (m)", fontsize=8.5, labelpad=2)
    if plane:
        axes.set_aspect("equal")
        kit.bare(axes)
        return
    sides = end - begin
    # A tall box fills the frame down to the bottom, where the tick labels of the floor need room.
    kit.dress_space(axes, sides, zoom=1.0 if sides[2] <= sides[:2].max() else 0.86)
