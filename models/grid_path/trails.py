"""Paths through several points on a map, for plots."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .gridmap import GridMap
from .shortest import path_between
from .sight import Sight

__all__ = ["trail"]

Floats = NDArray[np.float64]


def trail(grid: GridMap, stops: ArrayLike, *, straightened: bool = False) -> Floats:
    """Return a polyline through points along shortest paths on the map.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.
    stops : array-like, shape (k, 2)
        Points x, y, m. If a point is not in a free cell, or no path exists, the segment is straight.
    straightened : bool, default False
        Whether to shorten each path by lines of sight (Algorithm 4): every point connects to the last
        visible point of the path.

    Returns
    -------
    ndarray, shape (n, 2)
        Points x, y, m: the stops, and between them the centres of the cells of the paths.
    """
    places = np.asarray(stops, float).reshape(-1, 2)
    cells = grid.cells_of(places)
    sight = Sight(grid)
    parts = [places[:1]]
    for (here, there), ends in zip(
        itertools.pairwise(cells), itertools.pairwise(places), strict=True
    ):
        between = np.empty((0, 2))
        if grid.holds([here, there]).all():
            between = grid.centres(path_between(grid, here, there)).reshape(-1, 2)
        way = np.concatenate([ends[:1], between, ends[1:]])
        parts.append((_straightened(sight, way) if straightened else way)[1:])
    return np.concatenate(parts)


def _straightened(sight: Sight, way: Floats) -> Floats:
    chosen = [0]
    while chosen[-1] < len(way) - 1:
        here = chosen[-1]
        visible = (k for k in range(len(way) - 1, here + 1, -1) if sight.between(way[here], way[k]))
        chosen.append(next(visible, here + 1))
    return way[chosen]
