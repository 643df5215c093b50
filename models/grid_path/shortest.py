"""Shortest paths and their lengths on a map along neighbouring cells, and paths through several points."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Array, show
from .gridmap import GridMap
from .sight import Sight, farthest

__all__ = ["distances", "path_between", "trail"]

Floats = NDArray[np.float64]


def distances(grid: GridMap, cells: ArrayLike, *, diagonal: bool = True) -> NDArray[np.float64]:
    """Return the lengths of shortest paths between all pairs of cells, along neighbours.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.
    cells : array-like of int, shape (n, 2)
        Rows and columns of free cells, possibly with duplicates.
    diagonal : bool, default True
        Whether steps may be diagonal, without cutting corners.

    Returns
    -------
    ndarray, shape (n, n)
        Symmetric matrix of lengths, m. The length is infinite if no path exists.

    Raises
    ------
    InvalidData
        A cell is blocked or outside the map. The message names the cell.
    """
    from .search_kernels import CEILING, STRAIGHT, sweep

    checked = _free(grid, "cells", cells)
    places, back = np.unique(grid.numbers_of(checked), return_inverse=True)
    left = np.full((places.size, places.size), CEILING)
    for k in range(places.size - 1):
        others = places[k + 1 :]
        _, remainders, _, _ = sweep(
            grid.walls, grid.shape[1] + 2, places[k], others, True, diagonal, False,
            np.zeros(1, np.int8),
        )  # fmt: skip
        left[k, k + 1 :] = left[k + 1 :, k] = remainders[others]
    lengths = np.where(left > 0, (CEILING - left) / STRAIGHT * grid.cell, np.inf)
    return np.asarray(lengths[np.ix_(back, back)])


def path_between(
    grid: GridMap, start: ArrayLike, goal: ArrayLike, *, diagonal: bool = True
) -> NDArray[np.int64]:
    """Return the cells of a shortest path between two cells, along neighbours.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.
    start, goal : array-like of int, shape (2,)
        Row and column of a free cell.
    diagonal : bool, default True
        Whether steps may be diagonal, without cutting corners.

    Returns
    -------
    ndarray of int, shape (k, 2)
        Rows and columns from `start` to `goal`; k = 0 if no path exists.

    Raises
    ------
    InvalidData
        A cell is blocked or outside the map. The message names the cell.
    """
    from .search_kernels import sweep, trace

    ends = [_free(grid, name, [cell])[0] for name, cell in (("start", start), ("goal", goal))]
    first, last = grid.numbers_of(ends)
    width = grid.shape[1] + 2
    _, left, _, _ = sweep(
        grid.walls, width, first, np.array([last]), False, diagonal, True, np.zeros(1, np.int8)
    )
    if left[last] == 0:
        return np.empty((0, 2), np.int64)
    return grid.cells_at(trace(grid.walls, width, left, last, diagonal))


def _free(grid: GridMap, name: str, cells: Any) -> NDArray[np.int64]:
    """Return rows and columns as an array, or raise if a cell is not free."""
    at: NDArray[np.int64] = Array(("n", 2), int).coerce(name, cells, {})
    bad = np.flatnonzero(~grid.holds(at))
    if bad.size:
        raise InvalidData(
            f"{name} must be free cells (row, column), got {show(at[bad[0]].tolist())} in row "
            f"{bad[0]}, which is blocked or lies outside of the map",
            field=name,
        )
    return at


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
        if straightened:
            flag = np.zeros(1, np.int8)
            way = way[farthest(sight.blocked, sight.cells(way), sight.slack, flag)]
        parts.append(way[1:])
    return np.concatenate(parts)
