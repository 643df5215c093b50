"""Maps: equal scales on both axes, in a unit that suits what is drawn; cells, and which way things go."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .style import bare, inches

__all__ = ["BLOCKED", "draw_cells", "draw_polygons", "dress_map", "length_unit", "point_ways"]

#: Units of length: from what extent on (m), the factor from metres, and the name.
_UNITS = ((2000.0, 1e-3, "km"), (0.5, 1.0, "m"), (0.0, 1e3, "mm"))
#: Room around what is drawn, as a part of its extent.
_MARGIN = 0.06
#: Colour of what nobody can enter.
BLOCKED = "#c4c4c4"


def length_unit(extent: float) -> tuple[float, str]:
    """Return the factor from metres to the unit for what is as large as `extent` (m), and the unit."""
    return next((factor, unit) for least, factor, unit in _UNITS if extent >= least or not least)


def dress_map(axes: Any, low: NDArray[Any], high: NDArray[Any], unit: str) -> None:
    """Set the limits of a map, and equal scales that fill the axes.

    Parameters
    ----------
    axes : matplotlib axes
        The axes.
    low, high : ndarray, shape (2,)
        The box around what is drawn, in the axes' unit.
    unit : str
        Its name.
    """
    span = high - low
    # A side without any extent has no scale of its own: it gets that of the other.
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
        Where; its limits stay as they are.
    blocked : ndarray of bool, shape (rows, columns)
        Row 0 lies at ``low[1]``.
    low, high : ndarray, shape (2,)
        Corners of the map, in the axes' unit.
    colour : str
        Of blocked cells.
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
    """Draw shapely's polygons, holes and all, the limits of the axes as they are.

    Parameters
    ----------
    axes : matplotlib axes
        Where.
    polygons : iterable of shapely.Polygon
        m.
    scale : float
        Factor from metres to the axes' unit.
    **look
        How they look: options of a collection of matplotlib.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path
    from shapely.geometry.polygon import orient

    paths = []
    for polygon in polygons:
        # Holes run the other way round, which is how a path knows them.
        turned = orient(polygon)
        rings = [np.asarray(ring.coords) for ring in (turned.exterior, *turned.interiors)]
        paths.append(Path.make_compound_path(*(Path(scale * r, closed=True) for r in rings)))
    axes.add_collection(PathCollection(paths, **look), autolim=False)


def point_ways(
    axes: Any, places: NDArray[Any], headings: NDArray[Any], colour: str, size: float
) -> None:
    """Draw small triangles that point where things go.

    Parameters
    ----------
    axes : matplotlib axes
        Where.
    places : ndarray, shape (k, 2)
        Where they stand.
    headings : ndarray, shape (k,)
        Where they point to, rad.
    colour : str
        Their colour.
    size : float
        Their size (points).
    """
    for (x, y), heading in zip(places, headings, strict=True):
        axes.plot(
            x, y, ls="", marker=(3, 0, np.rad2deg(heading) - 90), ms=size, mfc=colour, mec="white",
            mew=0.4, zorder=5, gid="way",
        )  # fmt: skip
