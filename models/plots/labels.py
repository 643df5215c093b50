"""Where to write the names of points, so that they hide neither one another nor the route."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

__all__ = ["place_labels"]

#: Directions to try, nearest to "above" first: ties go to the first.
_TURNS = np.deg2rad([90, -90, 45, 135, -45, -135, 0, 180, 68, 112, -68, -112])
#: Distances of a label's nearest edge from its point, in heights of a line.
_GAPS = (0.55, 1.3, 2.1)


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
        Widths of the labels, in the unit of `points`.
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
    offsets = np.zeros((len(points), 2))
    boxes = np.zeros((0, 4))
    for k, (point, width) in enumerate(zip(points, widths, strict=True)):
        half = np.array([width, height]) / 2
        best = np.inf
        for gap in _GAPS:
            for turn in _TURNS:
                way = np.array([np.cos(turn), np.sin(turn)])
                offset = way * (half * np.abs(way) + gap * height)
                low, high = point + offset - half, point + offset + half
                # To hide another label is worst, a marker or the line bad, far away a little.
                overlap = np.minimum(high, boxes[:, 2:]) - np.maximum(low, boxes[:, :2])
                hidden = (overlap > 0).all(axis=1).sum()
                covered = ((obstacles > low) & (obstacles < high)).all(axis=1).sum()
                cost = 50.0 * hidden + 3.0 * covered + 2.0 * gap
                if cost < best:
                    best, offsets[k], box = cost, offset, np.concatenate([low, high])
        boxes = np.vstack([boxes, box])
    return offsets


def _along(points: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return `points` and places on the lines between them, at most `step` apart."""
    parts = [points]
    for here, there in itertools.pairwise(points):
        count = min(int(np.hypot(*(there - here)) / step), 500)
        parts.append(here + (there - here) * np.linspace(0, 1, count + 2)[1:-1, None])
    return np.concatenate(parts)
