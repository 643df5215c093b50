"""The names of points, written so that they hide neither one another nor the route."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["place_labels", "write_names"]

Floats = NDArray[np.float64]

#: Directions to try, nearest to "above" first: ties go to the first.
_TURNS = np.deg2rad([90, -90, 45, 135, -45, -135, 0, 180, 68, 112, -68, -112])
#: Distances of a label's nearest edge from its point, in heights of a line.
_GAPS = (0.55, 1.3, 2.1)
_FAR = np.repeat(_GAPS, len(_TURNS))
#: How wide a character and how high a line is, in sizes of the font.
_CHARACTER, _LINE = 0.62, 1.07


def write_names(
    axes: Any, places: Floats, names: Sequence[str], *, size: float, colour: str, route: bool = True
) -> None:
    """Write names beside places of a plane or of space, each where it hides least.

    Parameters
    ----------
    axes : matplotlib axes
        Plane or space; limits and place are final.
    places : ndarray, shape (k, 2) or (k, 3)
        The places, in the order of the route.
    names : sequence of str, length k
        Their names; an empty one only tells where the route runs.
    size : float
        Size of the font (point).
    colour : str
        Colour of the names.
    route : bool
        Whether a line runs through the places, which names should not hide.
    """
    from matplotlib.patheffects import withStroke

    axes.apply_aspect()
    flat = places
    if places.shape[1] == 3:
        seen = np.column_stack([places, np.ones(len(places))]) @ axes.get_proj().T
        flat = seen[:, :2] / seen[:, 3:]
    # In points of print, the unit of font sizes.
    paper = axes.transData.transform(flat) * 72 / axes.figure.dpi
    widths = [_CHARACTER * size * len(name) for name in names]
    offsets = place_labels(paper, widths, height=_LINE * size, route=route)
    halo = [withStroke(linewidth=2.0, foreground="white")]
    for name, at, offset in zip(names, flat, offsets, strict=True):
        if name:
            axes.annotate(
                name, at, offset, textcoords="offset points", fontsize=size, color=colour,
                ha="center", va="center_baseline", path_effects=halo, zorder=20,
                annotation_clip=False,
            )  # fmt: skip


def place_labels(
    points: NDArray[np.float64],
    widths: list[float],
    *,
    height: float = 8.0,
    route: bool = True,
) -> NDArray[np.float64]:
    """Return the offset of each label's centre from its point, chosen greedily.

    Parameters
    ----------
    points : ndarray, shape (k, 2)
        The points in the plane of the paper, in the order of the route.
    widths : list of float, length k
        Widths of the labels, in the unit of `points`; 0 where there is none.
    height : float
        Height of a label.
    route : bool
        Whether a line runs through the points, which labels should not hide.

    Returns
    -------
    ndarray, shape (k, 2)
        Same input, same offsets.
    """
    obstacles = _along(points, height / 2) if route else points
    ways = np.column_stack([np.cos(_TURNS), np.sin(_TURNS)])
    offsets = np.zeros((len(points), 2))
    lows, highs = np.zeros((2, 0, 2))
    for k, (point, width) in enumerate(zip(points, widths, strict=True)):
        if not width:
            continue
        half = np.array([width, height]) / 2
        tried = np.concatenate([ways * (half * np.abs(ways) + gap * height) for gap in _GAPS])
        low, high = (point + tried + side * half for side in (-1, 1))
        # To hide another label is worst, a marker or the line bad, far away a little.
        apart = np.minimum(high[:, None], highs) - np.maximum(low[:, None], lows)
        inside = (obstacles > low[:, None]) & (obstacles < high[:, None])
        hidden, covered = (hit.all(axis=2).sum(axis=1) for hit in (apart > 0, inside))
        best = int((50.0 * hidden + 3.0 * covered + 2.0 * _FAR).argmin())
        offsets[k] = tried[best]
        lows, highs = np.vstack([lows, low[best]]), np.vstack([highs, high[best]])
    return offsets


def _along(points: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return `points` and places on the lines between them, at most `step` apart."""
    parts = [points]
    for here, there in itertools.pairwise(points):
        count = min(int(np.hypot(*(there - here)) / step), 500)
        parts.append(here + (there - here) * np.linspace(0, 1, count + 2)[1:-1, None])
    return np.concatenate(parts)
