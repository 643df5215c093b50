"""The left half of a trajectory's picture: the path, its waypoints and its corridor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...plots.labels import place_labels
from ...plots.style import BLACK, CORRIDOR, CORRIDOR_EDGE, GREY, MOST_KNOTS, RED, bare, speed_map
from .data import Scene
from .regions import Region, regions

if TYPE_CHECKING:
    from matplotlib.collections import Collection

__all__ = ["draw_path", "speeds"]

Floats = NDArray[np.float64]

#: More regions than this are drawn as their union, without the edges between them.
_MOST_OUTLINES = 40
#: More bodies than this are not drawn.
_MOST_BODIES = 400
#: More waypoints than this would hide the path.
_MOST_WAYPOINTS = 150
#: More waypoints than this are not numbered.
_MOST_NUMBERS = 25
#: Places on a segment that tell the way of its line.
_BETWEEN = 6
#: All edges first and all faces over them: what is left is the outline of the union.
_UNION: list[tuple[Any, Any, float]] = [
    (CORRIDOR_EDGE, CORRIDOR_EDGE, 1.6),
    (CORRIDOR, CORRIDOR, 0.4),
]
#: Size of the numbers, and how wide a digit and how high a line of it are (point).
_FONT, _CHARACTER, _LINE = 7.0, 4.4, 7.5
#: A side of the space shorter than this part of the longest is widened, at the same scale.
_FLATTEST = 0.3


def speeds(scene: Scene, shown: tuple[int, ...]) -> Floats:
    """Return the speed along the shown axes at every sample."""
    found: Floats = np.linalg.norm(scene.samples(1)[:, list(shown)], axis=1)
    return found


def draw_path(
    scene: Scene, shown: tuple[int, ...], axes: Any, *, labels: bool | None = None
) -> tuple[Collection | None, list[Any], list[str]]:
    """Draw the path along two or three axes.

    Parameters
    ----------
    scene : Scene
        Model and plan.
    shown : tuple of int
        The axes, two for a plane and three for space.
    axes : matplotlib axes
        Plane or space alike.
    labels : bool, optional
        Whether to number the waypoints, by default where they are few.

    Returns
    -------
    Collection or None
        What is coloured by speed.
    list of artists
        For a legend.
    list of str
        Notes on what is not shown.
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
        coloured = _coloured(way, speeds(scene, shown), axes)
    else:
        axes.plot(*places[known].T, color=GREY, lw=0.9, ls=(0, (2, 2)), zorder=3)
    handles = _waypoints(scene, axes, places, known) + handles
    handles += _marks(scene, own, axes)
    _frame(scene, shown, axes, low, high)
    if labels or (labels is None and len(places) <= _MOST_NUMBERS):
        _numbers(scene, own, axes, places)
    return coloured, handles, notes


def _extent(scene: Scene) -> tuple[Floats, Floats]:
    """Return the corners of a box around what is drawn, over all axes."""
    waypoints = scene.waypoints
    parts = [np.where(np.isfinite(waypoints), waypoints, np.nan)]
    if scene.plan is not None:
        parts.append(scene.samples(0))
    points = np.vstack([*parts, np.full((1, scene.dimensions), np.nan)])
    free = np.isnan(points).all(axis=0)
    points[-1, free] = 0.0
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    # A corridor is shown as far as it does not dwarf the path.
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
    """Return where to draw each waypoint (not a number: nowhere), and which are fixed there."""
    wanted = scene.waypoints[:, own]
    known = np.isfinite(wanted)
    places = np.where(known, wanted, np.nan)
    if scene.plan is not None:
        # A coordinate that is free is where the plan has put it; with none fixed, there is none.
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
    # Where a region has no end it runs out of the picture; in space it ends with the picture.
    far = 0.0 if space else 4.0 * float((high - low).max())
    window = _window(low, high, tuple(range(scene.dimensions))) if space else (low, high)
    found, total, omitted = regions(
        scene, shown, window[0] - far, window[1] + far, _MOST_BODIES if space else None
    )
    notes = ["tilted half-spaces left out"] if omitted else []
    if not found:
        return [], notes
    if space:
        _bodies(found, axes)
    else:
        _polygons(found, axes)
    label = "corridor"
    if space and total > _MOST_BODIES:
        label += f" ({_MOST_BODIES} of {total} drawn)"
    return [Patch(facecolor=CORRIDOR, edgecolor=CORRIDOR_EDGE, lw=0.8, label=label)], notes


def _polygons(found: list[Region], axes: Any) -> None:
    from matplotlib.collections import PolyCollection

    corners = [face for region in found for face in region.faces]
    if len(found) <= _MOST_OUTLINES:
        layers = [(CORRIDOR, "none", 0.0), ("none", CORRIDOR_EDGE, 0.7)]
    else:
        layers = _UNION
    for layer, (face, edge, width) in enumerate(layers):
        axes.add_collection(
            PolyCollection(
                corners,
                facecolors=face,
                edgecolors=edge,
                linewidths=width,
                zorder=0.5 + 0.1 * layer,
                gid="corridor",
            ),
            autolim=False,
        )


def _bodies(found: list[Region], axes: Any) -> None:
    from matplotlib.colors import to_rgba
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = [face for region in found for face in region.faces]
    if len(found) <= _MOST_OUTLINES:
        layers = [(to_rgba(CORRIDOR_EDGE, 0.05), to_rgba(CORRIDOR_EDGE, 0.7), 0.6)]
    else:
        layers = _UNION
    for layer, (face, edge, width) in enumerate(layers):
        body = Poly3DCollection(
            faces,
            facecolors=face,
            edgecolors=edge,
            linewidths=width,
            zorder=1.5 + 0.1 * layer,
            gid="corridor",
        )
        axes.add_collection3d(body, autolim=False)


# -- path and waypoints --------------------------------------------------------------------------


def _coloured(way: Floats, speed: Floats, axes: Any) -> Collection:
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    pieces = np.stack([way[:-1], way[1:]], axis=1)
    # Two samples stand at each knot.
    long = (pieces[:, 0] != pieces[:, 1]).any(axis=1)
    mean = (speed[:-1] + speed[1:])[long] / 2
    kind: Any = Line3DCollection if way.shape[1] == 3 else LineCollection
    found: Collection = kind(
        pieces[long],
        array=mean,
        cmap=speed_map(),
        norm=Normalize(0.0, float(speed.max()) or 1.0),
        linewidths=2.2,
        capstyle="round",
        zorder=3,
    )
    if way.shape[1] == 3:
        axes.add_collection3d(found, autolim=False)
    else:
        axes.add_collection(found, autolim=False)
    return found


def _waypoints(scene: Scene, axes: Any, places: Floats, known: NDArray[np.bool_]) -> list[Any]:
    space = places.shape[1] == 3
    depth = {"depthshade": False} if space else {}
    drawn = _whole(np.isfinite(places))
    inner = drawn.copy()
    inner[[0, -1]] = False
    crowd = len(places) > MOST_KNOTS
    # Many waypoints are dots: rings would hide the path.
    small = {"s": max(2.0, 10.0 * MOST_KNOTS / len(places)), "linewidths": 0}
    rings = {"s": 22, "linewidths": 1.0}
    handles = []
    if scene.plan is not None and len(places) > _MOST_WAYPOINTS:
        inner[:] = False
    for chosen, face, word in (
        (inner & known, "white", "waypoint"),
        (inner & ~known, "#c9c9c9", "waypoint, partly free"),
    ):
        if chosen.any():
            look: dict[str, Any] = (
                {"c": BLACK if face == "white" else GREY, **small}
                if crowd
                else {"facecolors": face, "edgecolors": BLACK, **rings}
            )
            marker = "o" if face == "white" else "D"
            handles.append(
                axes.scatter(
                    *places[chosen].T, marker=marker, zorder=5, label=word, **look, **depth
                )
            )
    # Where both are one place, the start is seen on the end.
    for knot, marker, word, size, face in (
        (0, ">", "start", 34, "white"),
        (-1, "s", "end", 52, BLACK),
    ):
        if drawn[knot]:
            handles.append(
                axes.scatter(
                    *places[[knot]].T, marker=marker, s=size, facecolors=face, edgecolors=BLACK,
                    linewidths=1.0, zorder=7 if knot == 0 else 6, label=word, **depth,
                )
            )  # fmt: skip
    return handles


def _marks(scene: Scene, own: list[int], axes: Any) -> list[Any]:
    if not scene.marks:
        return []
    depth = {"depthshade": False} if len(own) == 3 else {}
    places = np.array([mark.position[own] for mark in scene.marks])
    return [
        axes.scatter(
            *places.T, marker="o", facecolors="none", edgecolors=RED, s=120, linewidths=1.6,
            zorder=21, label="worst violation", **depth,
        )
    ]  # fmt: skip


def _numbers(scene: Scene, own: list[int], axes: Any, places: Floats) -> None:
    """Write the numbers of the knots, each where it hides least."""
    from matplotlib.patheffects import withStroke

    drawn = _whole(np.isfinite(places))
    knots = np.flatnonzero(drawn)
    at, texts = places[knots], [str(knot) for knot in knots]
    if scene.plan is not None:
        # Nameless places between the knots tell the way of the line that is not to be hidden.
        part = np.arange(_BETWEEN * scene.segments + 1) / _BETWEEN
        at = scene.plan(np.interp(part, np.arange(len(places)), scene.plan.times))[:, own]
        texts = [""] * len(at)
        at[::_BETWEEN][drawn] = places[drawn]
        for knot in knots:
            texts[_BETWEEN * knot] = str(knot)
    axes.apply_aspect()
    if at.shape[1] == 3:
        seen = np.column_stack([at, np.ones(len(at))]) @ axes.get_proj().T
        at = seen[:, :2] / seen[:, 3:]
    # In points of print, the unit of font sizes.
    paper = axes.transData.transform(at) * 72 / axes.figure.dpi
    offsets = place_labels(paper, [_CHARACTER * len(t) for t in texts], height=_LINE)
    halo = [withStroke(linewidth=1.8, foreground="white")]
    for text, place, offset in zip(texts, at, offsets, strict=True):
        if text:
            axes.annotate(
                text, place, offset, textcoords="offset points", fontsize=_FONT, color="#404040",
                ha="center", va="center_baseline", path_effects=halo, zorder=20,
                annotation_clip=False,
            )  # fmt: skip


def _whole(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows are true throughout."""
    return np.asarray(known.all(axis=1), bool)


# -- the frame -----------------------------------------------------------------------------------


def _window(low: Floats, high: Floats, shown: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the limits of the shown axes, a flat side widened."""
    own = list(shown)
    span = (high - low)[own]
    longest = float(span.max()) or 1.0
    half = np.maximum(1.08 * span, _FLATTEST * longest) / 2
    middle = ((low + high) / 2)[own]
    return middle - half, middle + half


def _frame(scene: Scene, shown: tuple[int, ...], axes: Any, low: Floats, high: Floats) -> None:
    from matplotlib.ticker import MaxNLocator

    begin, end = _window(low, high, shown)
    if len(shown) == 2:
        # Equal scales: the side that has room to spare is widened.
        box, sheet = axes.get_position(), axes.figure.bbox
        paper = np.array([box.width * sheet.width, box.height * sheet.height])
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
    # A tall box fills the frame to its foot, where the labels of the floor want room as well.
    axes.set_box_aspect(sides, zoom=1.0 if sides[2] <= sides[:2].max() else 0.86)
    axes.tick_params(labelsize=7.5, pad=0)
    axes.view_init(elev=28, azim=-62)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.pane.set_facecolor("white")
        pane.pane.set_edgecolor("#d0d0d0")
        pane._axinfo["grid"].update(color="#e6e6e6", linewidth=0.6)
        pane.set_major_locator(MaxNLocator(nbins=5))
    # The box is wider than the square that matplotlib clips to.
    for artist in (*axes.collections, *axes.lines):
        artist.set_clip_on(False)
