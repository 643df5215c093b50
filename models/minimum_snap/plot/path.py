"""Left half of a trajectory figure: path, waypoints and corridor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...plots.labels import write_names
from ...plots.space import dots, dress_space
from ...plots.style import BLACK, DARK, GREY, MOST_KNOTS, RED, bare, inches
from .data import Scene
from .regions import regions

if TYPE_CHECKING:
    from matplotlib.collections import Collection

__all__ = ["draw_path", "line_by_speed"]

Floats = NDArray[np.float64]

_CORRIDOR, _EDGE = "#dfe9f1", "#8fabc2"
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
#: Styles that draw all edges first and all faces over them, so that the union's outline remains.
_UNION: list[tuple[Any, Any, float]] = [
    (_EDGE, _EDGE, 1.6),
    (_CORRIDOR, _CORRIDOR, 0.4),
]
#: Minimum length of a side of the 3-D box, as a share of the longest side. Scales remain equal.
_FLATTEST = 0.3


def draw_path(
    scene: Scene, shown: tuple[int, ...], axes: Any, *, labels: bool | None = None
) -> tuple[Collection | None, list[Any], list[str]]:
    """Draw the path along two or three axes.

    Parameters
    ----------
    scene : Scene
        Model and plan.
    shown : tuple of int
        Indices of the axes, two for a plane and three for space.
    axes : matplotlib axes
        2-D or 3-D axes.
    labels : bool, optional
        Whether to number the waypoints, by default if they are few.

    Returns
    -------
    Collection or None
        Path coloured by speed.
    list of artists
        Handles for a legend.
    list of str
        Notes on omitted elements.
    """
    low, high = _extent(scene)
    space = len(shown) == 3
    handles, notes = _corridor(scene, shown, axes, low, high)
    own = list(shown)
    places, known = _places(scene, own)
    coloured: Collection | None = None
    if scene.plan is not None:
        way = scene.samples(0)[:, own]
        if space:
            floor = _window(low, high, shown)[0][2]
            axes.plot(way[:, 0], way[:, 1], floor, color=GREY, lw=0.8, alpha=0.55, zorder=1)
        speed = np.linalg.norm(scene.samples(1)[:, own], axis=1)
        coloured = line_by_speed(way, speed, axes)
    else:
        axes.plot(*places[known].T, color=GREY, lw=0.9, ls=(0, (2, 2)), zorder=3)
    handles = _waypoints(scene, axes, places, known) + handles
    if scene.marks:
        worst = np.array([one.position[own] for one in scene.marks])
        look: dict[str, Any] = {"size": 120, "edge": RED, "width": 1.6, "zorder": 21}
        handles.append(dots(axes, worst, "o", "none", label="worst violation", **look))
    _frame(scene, shown, axes, low, high)
    if labels or (labels is None and len(places) <= _MOST_NUMBERS):
        _numbers(scene, own, axes, places)
    return coloured, handles, notes


def _extent(scene: Scene) -> tuple[Floats, Floats]:
    """Return the lower and upper corner of a box around the drawn elements, over all axes."""
    waypoints = scene.waypoints
    parts = [np.where(np.isfinite(waypoints), waypoints, np.nan)]
    if scene.plan is not None:
        parts.append(scene.samples(0))
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


def _places(scene: Scene, own: list[int]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the position of each waypoint (NaN: not drawn), and which components are fixed."""
    wanted = scene.waypoints[:, own]
    known = np.isfinite(wanted)
    places = np.where(known, wanted, np.nan)
    if scene.plan is not None:
        # Free coordinates follow the plan. Knots without a fixed coordinate are not drawn.
        chosen = scene.plan(np.clip(scene.times, scene.plan.times[0], scene.plan.times[-1]))
        partly = ~_whole(~known)[:, None] & ~known
        places = np.where(partly, chosen[:, own], places)
    return places, _whole(known)


# -- the corridor --------------------------------------------------------------------------------


def _corridor(
    scene: Scene, shown: tuple[int, ...], axes: Any, low: Floats, high: Floats
) -> tuple[list[Any], list[str]]:
    from matplotlib.patches import Patch

    space = len(shown) == 3
    # Unbounded regions extend beyond a plane figure. In 3-D they end at the box of the figure.
    far = 0.0 if space else 4.0 * float((high - low).max())
    window = _window(low, high, tuple(range(scene.dimensions))) if space else (low, high)
    found, total, omitted = regions(
        scene, shown, window[0] - far, window[1] + far, _MOST_BODIES if space else None
    )
    notes = ["tilted half-spaces left out"] if omitted else []
    if not found:
        return [], notes
    _faces(found, axes, space)
    label = "corridor"
    if space and total > _MOST_BODIES:
        label += f" ({_MOST_BODIES} of {total} drawn)"
    return [Patch(facecolor=_CORRIDOR, edgecolor=_EDGE, lw=0.8, label=label)], notes


def _faces(found: list[list[Floats]], axes: Any, space: bool) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    layers: list[tuple[Any, Any, float]] = [(_CORRIDOR, "none", 0.0), ("none", _EDGE, 0.7)]
    if len(found) > _MOST_OUTLINES:
        layers = _UNION
    elif space:
        layers = [(to_rgba(_EDGE, 0.05), to_rgba(_EDGE, 0.7), 0.6)]
    kind: Any = Poly3DCollection if space else PolyCollection
    faces = [face for region in found for face in region]
    for layer, (face, edge, width) in enumerate(layers):
        drawn = kind(
            faces, facecolors=face, edgecolors=edge, linewidths=width, gid="corridor",
            zorder=(1.5 if space else 0.5) + 0.1 * layer,
        )  # fmt: skip
        (axes.add_collection3d if space else axes.add_collection)(drawn, autolim=False)


# -- path and waypoints --------------------------------------------------------------------------


def line_by_speed(way: Floats, speed: Floats, axes: Any) -> Collection:
    """Draw a line through points, shape (samples, 2 or 3), coloured by speed (m/s)."""
    import matplotlib
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap, Normalize
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    space = way.shape[1] == 3
    pieces = np.stack([way[:-1], way[1:]], axis=1)
    # Each knot has two samples.
    long = (pieces[:, 0] != pieces[:, 1]).any(axis=1)
    whole = matplotlib.colormaps["viridis"]
    kind: Any = Line3DCollection if space else LineCollection
    found: Collection = kind(
        pieces[long], array=(speed[:-1] + speed[1:])[long] / 2,
        # The last part of viridis is too pale on white paper.
        cmap=ListedColormap([whole(k / 280) for k in range(256)], name="speed"),
        norm=Normalize(0.0, float(speed.max()) or 1.0), linewidths=2.2, capstyle="round", zorder=3,
    )  # fmt: skip
    (axes.add_collection3d if space else axes.add_collection)(found, autolim=False)
    return found


def _waypoints(scene: Scene, axes: Any, places: Floats, known: NDArray[np.bool_]) -> list[Any]:
    drawn = _whole(np.isfinite(places))
    knot = np.arange(len(places))
    first, last = drawn & (knot == 0), drawn & (knot == knot[-1])
    inner = drawn & ~first & ~last & (scene.plan is None or len(places) <= _MOST_WAYPOINTS)
    # Many waypoints are drawn as dots, because rings would hide the path.
    crowd = len(places) > MOST_KNOTS
    size, edge = (max(2.0, 10.0 * MOST_KNOTS / len(places)), "none") if crowd else (22, BLACK)
    partly = "waypoint, partly free"
    # The start is drawn last, so that it is visible if it coincides with the end.
    return [
        dots(axes, places[rows], marker, face, size=size, edge=edge, zorder=zorder, label=label)
        for rows, marker, face, size, edge, zorder, label in (
            (inner & known, "o", BLACK if crowd else "white", size, edge, 5, "waypoint"),
            (inner & ~known, "D", GREY if crowd else "#c9c9c9", size, edge, 5, partly),
            (first, ">", "white", 34, BLACK, 7, "start"),
            (last, "s", BLACK, 52, BLACK, 6, "end"),
        )
        if rows.any()
    ]


def _numbers(scene: Scene, own: list[int], axes: Any, places: Floats) -> None:
    """Draw the numbers of the knots at positions that hide the least of the figure."""
    knots = np.flatnonzero(_whole(np.isfinite(places)))
    at, texts = places[knots], [str(knot) for knot in knots]
    if scene.plan is not None:
        # Unlabelled points between the knots represent the curve, which labels must not hide.
        part = np.arange(_BETWEEN * scene.segments + 1) / _BETWEEN
        at = scene.plan(np.interp(part, np.arange(len(places)), scene.plan.times))[:, own]
        at[_BETWEEN * knots] = places[knots]
        texts = [""] * len(at)
        for knot in knots:
            texts[_BETWEEN * knot] = str(knot)
    write_names(axes, at, texts, size=7.0, colour=DARK)


def _whole(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows are true in all columns."""
    return np.asarray(known.all(axis=1), bool)


# -- the frame -----------------------------------------------------------------------------------


def _window(low: Floats, high: Floats, shown: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the limits of the shown axes, with flat sides widened."""
    own = list(shown)
    span = (high - low)[own]
    longest = float(span.max()) or 1.0
    half = np.maximum(1.08 * span, _FLATTEST * longest) / 2
    middle = ((low + high) / 2)[own]
    return middle - half, middle + half


def _frame(scene: Scene, shown: tuple[int, ...], axes: Any, low: Floats, high: Floats) -> None:
    begin, end = _window(low, high, shown)
    if len(shown) == 2:
        # For equal scales, widen the side with spare room.
        box = axes.get_position()
        paper = np.array([box.width, box.height]) * inches(axes.figure)
        half = paper * ((end - begin) / paper).max() / 2
        begin, end = (begin + end) / 2 - half, (begin + end) / 2 + half
    for name, axis, first, last in zip("xyz", shown, begin, end, strict=False):
        getattr(axes, f"set_{name}lim")(first, last)
        getattr(axes, f"set_{name}label")(f"{scene.names[axis]} (m)", fontsize=8.5, labelpad=2)
    if len(shown) == 2:
        axes.set_aspect("equal")
        bare(axes)
        return
    sides = end - begin
    # A tall box fills the frame down to the bottom, where the tick labels of the floor need room.
    axes.set_box_aspect(sides, zoom=1.0 if sides[2] <= sides[:2].max() else 0.86)
    dress_space(axes)
