"""Layers of maps in a plane and in space: cells, polygons, routes, points, discs, headings and labels.

Layers leave the limits of the axes unchanged, which :func:`dress_map` sets. Positions are in the unit of the
axes, unless stated otherwise.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .curves import Floats
from .style import BLACK, DARK, RED, RING, axis_style, bare, colour_of, inches, key, label_axes

__all__ = [
    "BLOCKED", "FAR", "box_near", "circles", "corners_of", "dots", "draw_box", "draw_cells", "draw_circles", "draw_ends",
    "draw_lines", "draw_polygons", "draw_routes", "draw_shaded_line", "draw_stops", "dress_map",
    "dress_space", "heading_marker", "length_unit", "name_vehicles", "place_labels", "point_ways", "ring",
    "scale_of", "space_axes", "turn_down", "write_names",
]  # fmt: skip

#: Space for tick labels and the label of an axis to the left and right of a box in space (inch).
_BESIDE = (0.3, 0.6)
#: Units of length: smallest extent (m), factor from metres, and name.
_UNITS = ((2000.0, 1e-3, "km"), (0.5, 1.0, "m"), (0.0, 1e3, "mm"))
#: Margin around the content of a map, relative to its extent.
_MARGIN = 0.06
#: Colour of blocked cells.
BLOCKED = "#c4c4c4"
#: Largest coordinate that is drawn: an invalid plan may have any coordinates.
FAR = 1e100
#: Largest number of nodes with large dots, and of vehicles with names.
_MOST_LARGE, _MOST_NAMES = 150, 7
#: Directions to try; the first of equally good ones is chosen.
_TURNS = np.deg2rad([90, -90, 45, 135, -45, -135, 0, 180, 68, 112, -68, -112])
#: Distances of a label's nearest edge from its point, in line heights.
_GAPS = (0.55, 1.3, 2.1)
_DISTANCES = np.repeat(_GAPS, len(_TURNS))
#: Width of a character and height of a line, relative to the font size.
_CHARACTER, _LINE = 0.62, 1.07


# -- maps ----------------------------------------------------------------------------------------


def length_unit(extent: float) -> tuple[float, str]:
    """Return factor and name of the length unit for an extent in metres."""
    return next((factor, unit) for least, factor, unit in _UNITS if extent >= least or not least)


def scale_of(axes: Any) -> float:
    """Return the factor from metres to the unit of length in the label of the x axis."""
    return next(factor for _, factor, unit in _UNITS if f"({unit})" in axes.get_xlabel())


def dress_map(
    axes: Any, low: NDArray[Any], high: NDArray[Any], labels: tuple[str, str] | None = None
) -> float:
    """Set the limits of a map of a box (m), with equal scales that fill the axes.

    Returns the factor from metres to the unit of the axes. If the box has another unit, `labels` are the labels
    of the axes, and the factor is 1.
    """
    scale = 1.0
    if labels is None:
        scale, unit = length_unit(float((high - low).max()))
        labels = f"x ({unit})", f"y ({unit})"
    low, high = low * scale, high * scale
    span = high - low
    # A side without extent uses the scale of the other.
    around = _MARGIN * (float(span.max()) or max(1.0, float(np.abs(low).max())))
    broad, tall = axes.get_position().size * inches(axes.figure)
    wide, long = span + 2 * around
    half = 0.5 * max(wide / broad, long / tall) * np.array([broad, tall])
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal")
    label_axes(axes, *labels)
    bare(axes)
    return scale


def box_near(low: Floats, high: Floats, points: Iterable[Floats]) -> tuple[Floats, Floats]:
    """Return the corners of a box and of points outside of it, up to the size of the box."""
    near = np.clip(np.concatenate([low[None], high[None], *points]), 2 * low - high, 2 * high - low)
    return near.min(axis=0), near.max(axis=0)


def corners_of(grid: Any) -> tuple[Floats, Floats]:
    """Return the corners of a grid map with the smallest and the largest coordinates (m)."""
    return grid.origin, grid.origin + np.array(grid.shape[::-1]) * grid.cell


def draw_cells(axes: Any, grid: Any, scale: float, *, colour: str = BLOCKED) -> None:
    """Draw the blocked cells of a grid map as one image, and its edge; y points as in the grid."""
    from matplotlib.colors import ListedColormap

    low, high = (corner * scale for corner in corners_of(grid))
    limits = axes.axis()
    axes.imshow(
        grid.blocked, cmap=ListedColormap(["none", colour]), vmin=0, vmax=1, origin="lower", zorder=0.7,
        extent=(low[0], high[0], low[1], high[1]), interpolation="nearest", gid="blocked",
    )  # fmt: skip
    axes.axis(limits)
    draw_box(axes, low, high, fc="none", ec=colour, lw=1.0, zorder=0.7, gid="edge")
    if not grid.upward:
        turn_down(axes)


def turn_down(axes: Any) -> None:
    """Turn the y axis of a map downward, as in text and images, and state it in the label."""
    axes.invert_yaxis()
    label_axes(axes, y=axes.get_ylabel().replace(")", ", downward)"))


def draw_box(axes: Any, low: Any, high: Any, **look: Any) -> None:
    """Draw a rectangle between its lower left and upper right corner."""
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((low[0], low[1]), high[0] - low[0], high[1] - low[1], **look))


def draw_polygons(axes: Any, polygons: Iterable[Any], scale: float, **look: Any) -> None:
    """Draw shapely polygons (m) with their holes; `look` are options of a matplotlib collection."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path
    from shapely.geometry.polygon import orient

    paths = []
    for polygon in polygons:
        # Matplotlib recognises holes by their opposite orientation.
        turned = orient(polygon)
        rings = [np.asarray(ring.coords) for ring in (turned.exterior, *turned.interiors)]
        paths.append(Path.make_compound_path(*(Path(scale * r, closed=True) for r in rings)))
    axes.add_collection(PathCollection(paths, **look), autolim=False)


# -- points --------------------------------------------------------------------------------------


def dots(
    axes: Any, places: Floats, marker: str, face: Any, *, size: float, zorder: float,
    edge: str = "none", width: float = 1.0, **more: Any,
) -> Any:  # fmt: skip
    """Draw markers at `places` of a plane or of space, (k, 2) or (k, 3), and return them.

    `size` is the area of a marker (square points), and `width` that of its edge (points).
    """
    depth = {"depthshade": False} if places.shape[1] == 3 else {}
    return axes.scatter(
        *places.T, marker=marker, s=size, facecolors=face, edgecolors=edge, zorder=zorder,
        linewidths=0 if edge == "none" else width, **depth, **more,
    )  # fmt: skip


def ring(axes: Any, places: Any, label: str) -> list[Any]:
    """Draw a red ring around each of `places`, and return its legend entry; empty without places."""
    if not len(places):
        return []
    where = np.clip(places, -FAR, FAR)
    look: dict[str, Any] = {"size": 150, "edge": RED, "width": 1.8, "zorder": 21}
    dots(axes, where, "o", "none", gid=label, label=label, **look)
    return [key(label, **RING)]


def draw_ends(axes: Any, start: Floats, goals: Floats) -> list[Any]:
    """Draw a start and goals, shapes (1, 2) and (k, 2), and return their legend entries."""
    dots(axes, goals, "*", "white", size=110, edge=BLACK, width=1.0, zorder=8, gid="goal")
    dots(axes, start, "o", "white", size=42, edge=BLACK, width=1.2, zorder=9, gid="start")
    goal = "goals" if len(goals) > 1 else "goal"
    return [
        key("start", marker="o", mfc="white", mec=BLACK, ms=6),
        key(goal, marker="*", mfc="white", mec=BLACK, ms=9),
    ]


def draw_stops(
    axes: Any, nodes: Floats, owners: NDArray[np.int64], depots: Floats, missed: Floats
) -> list[Any]:
    """Draw nodes in the colours of their vehicles (-1: none), depots, and rings around missed nodes.

    Returns the entries of a legend.
    """
    faces = [DARK if owner < 0 else colour_of(owner) for owner in owners.tolist()]
    dots(
        axes, nodes, "o", faces or DARK, size=26 if len(nodes) <= _MOST_LARGE else 8, edge="white",
        width=0.6, zorder=7, gid="node",
    )  # fmt: skip
    dots(axes, depots, "s", "white", size=52, edge=BLACK, width=1.5, zorder=8, gid="depot")
    keys = [key("depot", marker="s", mfc="white", mec=BLACK, mew=1.4, ms=6)]
    keys.append(key("node", marker="o", color=DARK, ms=5))
    return keys + ring(axes, missed, "not visited once")


def circles(middles: Floats, radius: Iterable[float]) -> list[Any]:
    """Return one circle per place."""
    from matplotlib.patches import Circle

    return [Circle((x, y), r) for (x, y), r in zip(middles, radius, strict=True)]


def draw_circles(axes: Any, middles: Floats, radius: Iterable[float], **look: Any) -> Any:
    """Draw circles in their true size and return their collection."""
    from matplotlib.collections import PatchCollection

    patches = PatchCollection(circles(middles, radius), **look)
    axes.add_collection(patches, autolim=False)
    return patches


# -- lines ---------------------------------------------------------------------------------------


def draw_lines(axes: Any, lines: Iterable[Any], **look: Any) -> Any:
    """Draw polylines, each of shape (k, 2), and return their collection."""
    from matplotlib.collections import LineCollection

    drawn = LineCollection([np.clip(line, -FAR, FAR) for line in lines], **look)
    axes.add_collection(drawn, autolim=False)
    return drawn


def draw_routes(axes: Any, lines: Sequence[Floats], *, gid: str, **look: Any) -> None:
    """Draw one polyline per vehicle; `look` are options of a collection instead of the usual ones."""
    looks = [axis_style(k) for k in range(len(lines))]
    full: dict[str, Any] = {
        "colors": [style["color"] for style in looks], "linestyles": [style["ls"] for style in looks],
        "lw": 1.6, "zorder": 3, "capstyle": "round", "joinstyle": "round",
    }  # fmt: skip
    draw_lines(axes, lines, gid=gid, **full | look)


def draw_shaded_line(axes: Any, line: Floats, values: Floats | None, **look: Any) -> Any:
    """Draw a polyline of a plane or of space, coloured by the value of each segment, and return it.

    `look` are options of a matplotlib collection.
    """
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    pieces = np.clip(np.stack([line[:-1], line[1:]], axis=1), -FAR, FAR)
    # The brightest yellow is invisible on white.
    shades = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)))
    kind: Any = Line3DCollection if line.shape[1] == 3 else LineCollection
    drawn = kind(list(pieces), array=values, cmap=shades, capstyle="round", **look)
    (axes.add_collection if line.shape[1] == 2 else axes.add_collection3d)(drawn, autolim=False)
    return drawn


def heading_marker(heading: float) -> tuple[int, int, float]:
    """Return the marker of a triangle that points in the direction of `heading` (rad)."""
    return 3, 0, float(np.rad2deg(heading)) - 90


def point_ways(
    axes: Any, places: Floats, headings: Floats, colour: str, size: float, **look: Any
) -> None:
    """Draw triangles of `size` points at places, shape (k, 2), which show headings (rad)."""
    look = {"mec": "white", "mew": 0.4, "zorder": 5, "gid": "way", **look}
    for (x, y), heading in zip(places, headings, strict=True):
        axes.plot(x, y, ls="", marker=heading_marker(heading), ms=size, mfc=colour, **look)


def name_vehicles(count: int, word: str) -> list[Any]:
    """Return the legend entries for `count` vehicles, named by `word` and a number."""
    keys = [key(f"{word} {k}", lw=1.6, **axis_style(k)) for k in range(min(count, _MOST_NAMES))]
    return keys + [key(f"… {count} in all", ls="")] * (count > _MOST_NAMES)


# -- labels, placed so that they hide neither one another nor the route --------------------------


def write_names(
    axes: Any, places: Floats, names: Sequence[str], *, size: float, colour: str, route: bool = True
) -> None:
    """Write names beside places, (k, 2) or (k, 3), with the least overlap.

    The axes must have their final limits. Empty names belong to places that only define the `route`, a line
    through the places in this order, which names should not hide. `size` is in points.
    """
    from matplotlib.patheffects import withStroke

    axes.apply_aspect()
    flat = places
    if places.shape[1] == 3:
        homogeneous = np.column_stack([places, np.ones(len(places))]) @ axes.get_proj().T
        flat = homogeneous[:, :2] / homogeneous[:, 3:]
    # In points, the unit of font sizes.
    paper = axes.transData.transform(flat) * 72 / axes.figure.dpi
    widths = [_CHARACTER * size * len(name) for name in names]
    offsets = place_labels(paper, widths, height=_LINE * size, route=route)
    halo = [withStroke(linewidth=2.0, foreground="white")]
    for name, spot, place, offset in zip(names, places.tolist(), flat, offsets, strict=True):
        if name:
            label = axes.annotate(
                name, place, offset, textcoords="offset points", fontsize=size, color=colour,
                ha="center", va="center_baseline", path_effects=halo, zorder=20,
                annotation_clip=False,
            )  # fmt: skip
            if len(spot) == 3:  # for pages that turn the axes
                label.place = spot


def place_labels(
    points: Floats, widths: list[float], *, height: float = 8.0, route: bool = True
) -> Floats:
    """Return the offset of each label's centre from its point, shape (k, 2), chosen greedily.

    `points` have the shape (k, 2) in the plane of the paper, in the order of the route; `widths` are those of the
    labels in the same unit, 0 for no label. A line through the points should not be hidden if it is a `route`.
    """
    obstacles = _along(points, height / 2) if route else points
    directions = np.column_stack([np.cos(_TURNS), np.sin(_TURNS)])
    offsets = np.zeros((len(points), 2))
    lows, highs = np.zeros((2, 0, 2))
    for k, (point, width) in enumerate(zip(points, widths, strict=True)):
        if not width:
            continue
        half = np.array([width, height]) / 2
        rings = [directions * (half * np.abs(directions) + gap * height) for gap in _GAPS]
        candidates = np.concatenate(rings)
        low, high = (point + candidates + side * half for side in (-1, 1))
        # Cost: 50 per hidden label, 3 per covered marker or piece of line, 2 per line of distance.
        overlap = np.minimum(high[:, None], highs) - np.maximum(low[:, None], lows)
        inside = (obstacles > low[:, None]) & (obstacles < high[:, None])
        hidden, covered = (hit.all(axis=2).sum(axis=1) for hit in (overlap > 0, inside))
        best = int((50.0 * hidden + 3.0 * covered + 2.0 * _DISTANCES).argmin())
        offsets[k] = candidates[best]
        lows, highs = np.vstack([lows, low[best]]), np.vstack([highs, high[best]])
    return offsets


def _along(points: Floats, step: float) -> Floats:
    """Return `points` and places on the lines between them, at most `step` apart."""
    parts = [points]
    for here, there in itertools.pairwise(points):
        count = min(int(np.hypot(*(there - here)) / step), 500)
        parts.append(here + (there - here) * np.linspace(0, 1, count + 2)[1:-1, None])
    return np.concatenate(parts)


# -- space ---------------------------------------------------------------------------------------


def space_axes(figure: Any, place: tuple[float, float, float, float]) -> Any:
    """Return axes in space that draw by ``zorder``; otherwise lines could hide nearer markers."""
    return figure.add_axes(place, projection="3d", computed_zorder=False)


def dress_space(
    axes: Any, sides: Any = None, *, zoom: float = 1.0, above: float = 28
) -> None:  # fmt: skip
    """Set the point of view, `above` the floor (degrees), and draw a faint box.

    `sides` are the lengths of the box. Its size `zoom` is reduced if the box is too wide for the figure or the part of
    it. Call it after everything else is drawn: it disables clipping at the square around the box.
    """
    from matplotlib.ticker import MaxNLocator

    axes.tick_params(labelsize=7.5, pad=0)
    axes.view_init(elev=above, azim=-62)
    if sides is not None:
        axes.set_box_aspect(sides, zoom=zoom)
        axes.set_box_aspect(sides, zoom=zoom * _room(axes))
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.pane.set_facecolor("white")
        pane.pane.set_edgecolor("#d0d0d0")
        pane._axinfo["grid"].update(color="#e6e6e6", linewidth=0.6)
        pane.set_major_locator(MaxNLocator(nbins=5))
    for artist in (*axes.collections, *axes.lines):
        artist.set_clip_on(False)


def _room(axes: Any) -> float:
    """Return the available width relative to that of a box in space, at most 1."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    axes.apply_aspect()
    corners = itertools.product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())
    x, y, _ = proj_transform(*zip(*corners, strict=True), axes.get_proj())
    pixels = axes.transData.transform(np.column_stack([x, y]))[:, 0]
    middle, frame = (axes.bbox.x0 + axes.bbox.x1) / 2, axes.get_figure(root=False)
    left, right = (inch * frame.dpi for inch in _BESIDE)
    rooms = (middle - frame.bbox.x0 - left, frame.bbox.x1 - right - middle)
    halves = (middle - pixels.min(), pixels.max() - middle)
    return float(np.clip(np.divide(rooms, halves).min(), 0.3, 1.0))
