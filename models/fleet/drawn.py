"""The plain data of a fleet's picture: where nodes stand, and which way routes lead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .data import FleetData
from .plan import FleetPlan

__all__ = ["places_of", "stops_of", "wrong_nodes"]

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


def wrong_nodes(model: FleetData, plan: FleetPlan) -> NDArray[np.int64]:
    """Return the nodes that are visited more often, or more seldom, than they should be."""
    visited = np.bincount(
        np.array([node for route in plan.routes for node in route], int), minlength=model.size
    )
    wanted = np.isin(np.arange(model.size), model.customers)
    return np.flatnonzero(visited != wanted)
