"""Maps with equal scales on both axes and a suitable unit; cells, polygons and headings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .style import bare, inches

__all__ = ["BLOCKED", "draw_cells", "draw_polygons", "dress_map", "length_unit", "point_ways"]

#: Units of length: smallest extent (m), factor from metres, and name.
_UNITS = ((2000.0, 1e-3, "km"), (0.5, 1.0, "m"), (0.0, 1e3, "mm"))
#: Margin around the content, relative to its extent.
_MARGIN = 0.06
#: Colour of blocked cells.
BLOCKED = "#c4c4c4"


def length_unit(extent: float) -> tuple[float, str]:
    """Return factor and name of the length unit for an extent in metres."""
    return next((factor, unit) for least, factor, unit in _UNITS if extent >= least or not least)


def dress_map(axes: Any, low: NDArray[Any], high: NDArray[Any], unit: str) -> None:
    """Set the limits of a map, with equal scales that fill the axes.

    Parameters
    ----------
    axes : matplotlib axes
        Axes.
    low, high : ndarray, shape (2,)
        Bounding box of the content, in the axes' unit.
    unit : str
        Name of the unit.
    """
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
    axes.set_xlabel(f"x ({unit})", fontsize=8.5)
    axes.set_ylabel(f"y ({unit})", fontsize=8.5)
    bare(axes)


def draw_cells(
    axes: Any, blocked: NDArray[np.bool_], low: NDArray[Any], high: NDArray[Any], *,
    colour: str = BLOCKED,
) -> None:  # fmt: skip
    """Draw the blocked cells of a map as one image, and its edge.

    Parameters
    ----------
    axes : matplotlib axes
        Axes; the limits stay unchanged.
    blocked : ndarray of bool, shape (rows, columns)
        Blocked cells; row 0 is at ``low[1]``.
    low, high : ndarray, shape (2,)
        Corners of the map, in the axes' unit.
    colour : str
        Colour of blocked cells.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Rectangle

    limits = axes.axis()
    axes.imshow(
        blocked, cmap=ListedColormap(["none", colour]), vmin=0, vmax=1, origin="lower", zorder=0.7,
        extent=(low[0], high[0], low[1], high[1]), interpolation="nearest", gid="blocked",
    )  # fmt: skip
    axes.axis(limits)
    edge = Rectangle(
        (low[0], low[1]), *(high - low), fc="none", ec=colour, lw=1.0, zorder=0.7, gid="edge"
    )
    axes.add_patch(edge)


def draw_polygons(axes: Any, polygons: Iterable[Any], scale: float, **look: Any) -> None:
    """Draw shapely polygons with their holes, without changing the limits of the axes.

    Parameters
    ----------
    axes : matplotlib axes
        Axes.
    polygons : iterable of shapely.Polygon
        Polygons (m).
    scale : float
        Factor from metres to the axes' unit.
    **look
        Options of a matplotlib collection.
    """
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


def point_ways(
    axes: Any, places: NDArray[Any], headings: NDArray[Any], colour: str, size: float
) -> None:
    """Draw small triangles that show headings.

    Parameters
    ----------
    axes : matplotlib axes
        Axes.
    places : ndarray, shape (k, 2)
        Positions, in the axes' unit.
    headings : ndarray, shape (k,)
        Headings (rad).
    colour : str
        Colour of the triangles.
    size : float
        Size of the triangles (point).
    """
    for (x, y), heading in zip(places, headings, strict=True):
        axes.plot(
            x, y, ls="", marker=(3, 0, np.rad2deg(heading) - 90), ms=size, mfc=colour, mec="white",
            mew=0.4, zorder=5, gid="way",
        )  # fmt: skip
