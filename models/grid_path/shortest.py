"""True distances between places on a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .gridmap import GridMap

__all__ = ["distances"]


def distances(grid: GridMap, cells: ArrayLike, *, diagonal: bool = True) -> NDArray[np.float64]:
    """Return the lengths of shortest paths between all pairs of cells, along neighbours.

    Parameters
    ----------
    grid : GridMap
        The map.
    cells : array-like of int, shape (n, 2)
        Rows and columns of free cells.
    diagonal : bool
        Whether steps may be diagonal, without cutting corners.

    Returns
    -------
    ndarray, shape (n, n)
        m; infinite where there is no path.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    free = ~grid.blocked
    number = np.arange(free.size).reshape(free.shape)
    tails, heads, costs = [], [], []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        if row and column and not diagonal:
            continue
        rows, columns = free.shape
        a = (slice(0, rows - row), slice(max(0, -column), columns - max(0, column)))
        b = (slice(row, rows), slice(max(0, column), columns + min(0, column)))
        open_ = free[a] & free[b]
        if row and column:
            open_ &= free[a[0], b[1]] & free[b[0], a[1]]
        tails.append(number[a][open_])
        heads.append(number[b][open_])
        costs.append(np.full(tails[-1].size, np.hypot(row, column) * grid.cell))
    shape = (free.size, free.size)
    graph = coo_array(
        (np.concatenate(costs), (np.concatenate(tails), np.concatenate(heads))), shape
    )
    at = np.asarray(cells, np.int64)
    places = number[at[:, 0], at[:, 1]]
    unique, back = np.unique(places, return_inverse=True)
    found = dijkstra(graph.tocsr(), directed=False, indices=unique)[:, unique]
    return np.asarray(found[np.ix_(back, back)])
