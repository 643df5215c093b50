"""Ways over a map through several places, as pictures draw them."""

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
    """Return a way that leads through places one after another, along shortest paths on the map.

    Parameters
    ----------
    grid : GridMap
        The map.
    stops : array-like, shape (k, 2)
        x, y (m). Where a stop is not in a free cell, or there is no path, the way is straight.
    straightened : bool
        Whether each path is shortened by lines of sight (Algorithm 4): from each point the way
        leads to the last one that is seen from there.

    Returns
    -------
    ndarray, shape (n, 2)
        x, y (m): the stops, and between them the centres of the cells on the way.
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
    kept = [0]
    while kept[-1] < len(way) - 1:
        here = kept[-1]
        seen = (k for k in range(len(way) - 1, here + 1, -1) if sight.between(way[here], way[k]))
        kept.append(next(seen, here + 1))
    return way[kept]
