"""Labels of points, placed so that they hide neither one another nor the route."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from .curves import Floats

__all__ = ["place_labels", "write_names"]

#: Directions to try; the first of equally good ones is chosen.
_TURNS = np.deg2rad([90, -90, 45, 135, -45, -135, 0, 180, 68, 112, -68, -112])
#: Distances of a label's nearest edge from its point, in line heights.
_GAPS = (0.55, 1.3, 2.1)
_FAR = np.repeat(_GAPS, len(_TURNS))
#: Width of a character and height of a line, relative to the font size.
_CHARACTER, _LINE = 0.62, 1.07


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
    for name, place, offset in zip(names, flat, offsets, strict=True):
        if name:
            axes.annotate(
                name, place, offset, textcoords="offset points", fontsize=size, color=colour,
                ha="center", va="center_baseline", path_effects=halo, zorder=20,
                annotation_clip=False,
            )  # fmt: skip


def place_labels(
    points: Floats,
    widths: list[float],
    *,
    height: float = 8.0,
    route: bool = True,
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
        candidates = np.concatenate(
            [directions * (half * np.abs(directions) + gap * height) for gap in _GAPS]
        )
        low, high = (point + candidates + side * half for side in (-1, 1))
        # Cost: 50 per hidden label, 3 per covered marker or piece of line, 2 per line of distance.
        overlap = np.minimum(high[:, None], highs) - np.maximum(low[:, None], lows)
        inside = (obstacles > low[:, None]) & (obstacles < high[:, None])
        hidden, covered = (hit.all(axis=2).sum(axis=1) for hit in (overlap > 0, inside))
        best = int((50.0 * hidden + 3.0 * covered + 2.0 * _FAR).argmin())
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
