"""The plain data of a fleet's picture: where nodes stand, and which way routes lead."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .data import FleetData
from .plan import FleetPlan

if TYPE_CHECKING:
    from ..grid_path import GridMap

__all__ = ["leads_through", "places_of", "stops_of", "wrong_nodes"]

Floats = NDArray[np.float64]

#: Nodes up to which costs are scaled to places in a plane.
_MOST_SCALED = 1500


def places_of(model: FleetData) -> Floats | None:
    """Return where nodes are drawn, shape (n, 2): None for costs between too many nodes.

    Costs are scaled to places whose distances fit them (classical multidimensional scaling), those of
    both ways by their mean.
    """
    if model.points is not None:
        return model.points
    if model.size > _MOST_SCALED:
        return None
    from scipy.linalg import eigh

    count = model.size
    scale = float(model.distances.max()) or 1.0
    squares = (0.5 * (model.distances + model.distances.T) / scale) ** 2
    centred = squares - squares.mean(axis=0)
    centred = -0.5 * (centred - centred.mean(axis=1)[:, None])
    found = np.zeros((count, 2))
    kept = min(2, count)
    values, vectors = eigh(0.5 * (centred + centred.T), subset_by_index=[count - kept, count - 1])
    found[:, :kept] = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1]
    # An eigenvector has no sign of its own.
    found *= np.where(found[np.abs(found).argmax(axis=0), [0, 1]] < 0, -1.0, 1.0)
    return scale * found


def stops_of(model: FleetData, plan: FleetPlan) -> list[list[int]]:
    """Return the nodes of every route with its depot at both ends; an empty route has none."""
    last = model.vehicles - 1
    homes = [int(model.homes[min(k, last)]) for k in range(len(plan.routes))]
    return [
        [home, *route, home] if route else []
        for home, route in zip(homes, plan.routes, strict=True)
    ]


def leads_through(grid: GridMap | None, places: Floats, stops: list[int]) -> Floats:
    """Return the polyline of a route, shape (k, 2): on a map along its shortest paths.

    Where there is no path between two stops the line is straight.
    """
    if grid is None:
        return places[stops]
    cells = grid.cells_of(places)
    parts = []
    for here, there in itertools.pairwise(stops):
        parts.append(places[[here]])
        if grid.holds(cells[[here, there]]).all():
            parts.append(grid.centres(path_between(grid, cells[here], cells[there])))
    return np.concatenate([*parts, places[stops[-1:]]])


def wrong_nodes(model: FleetData, plan: FleetPlan) -> NDArray[np.int64]:
    """Return the nodes that are visited more often, or more seldom, than they should be."""
    visited = np.bincount(
        np.array([node for route in plan.routes for node in route], int), minlength=model.size
    )
    wanted = np.isin(np.arange(model.size), model.customers)
    return np.flatnonzero(visited != wanted)


def path_between(grid: GridMap, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    free = ~grid.blocked
    number = np.arange(free.size).reshape(free.shape)
    tails, heads, costs = [], [], []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        rows, columns = free.shape
        p = (slice(0, rows - row), slice(max(0, -column), columns - max(0, column)))
        q = (slice(row, rows), slice(max(0, column), columns + min(0, column)))
        open_ = free[p] & free[q]
        if row and column:
            open_ &= free[p[0], q[1]] & free[q[0], p[1]]
        tails.append(number[p][open_])
        heads.append(number[q][open_])
        costs.append(np.full(tails[-1].size, np.hypot(row, column)))
    graph = coo_array(
        (np.concatenate(costs), (np.concatenate(tails), np.concatenate(heads))), (free.size,) * 2
    )
    _, before = dijkstra(
        graph.tocsr(), directed=False, indices=number[tuple(a)], return_predecessors=True
    )
    node, found = int(number[tuple(b)]), []
    while node >= 0:
        found.append(node)
        node = int(before[node])
    return np.stack(np.unravel_index(found[::-1], free.shape), axis=1)
