"""Data of a fleet's figure: positions of nodes and sequences of stops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .data import FleetData
from .plan import FleetPlan

__all__ = ["places_of", "stops_of", "wrong_nodes"]

Floats = NDArray[np.float64]

#: Largest number of nodes for which costs are embedded in a plane.
_MOST_SCALED = 1500


def places_of(model: FleetData) -> Floats | None:
    """Return the positions at which nodes are drawn, shape (n, 2); None for costs of many nodes.

    Costs are embedded in a plane by classical multidimensional scaling, after averaging both
    directions.
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
    places = np.zeros((count, 2))
    axes = min(2, count)
    values, vectors = eigh(0.5 * (centred + centred.T), subset_by_index=[count - axes, count - 1])
    places[:, :axes] = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1]
    # The sign of an eigenvector is arbitrary: make the largest entry positive.
    places *= np.where(places[np.abs(places).argmax(axis=0), [0, 1]] < 0, -1.0, 1.0)
    return scale * places


def stops_of(model: FleetData, plan: FleetPlan) -> list[list[int]]:
    """Return the nodes of every route with its depot at both ends; an empty route stays empty."""
    last = model.vehicles - 1
    homes = [int(model.homes[min(k, last)]) for k in range(len(plan.routes))]
    return [
        [home, *route, home] if route else []
        for home, route in zip(homes, plan.routes, strict=True)
    ]


def wrong_nodes(model: FleetData, plan: FleetPlan) -> NDArray[np.int64]:
    """Return the customers not visited exactly once, and the depots within a route."""
    visited = np.bincount(
        np.array([node for route in plan.routes for node in route], int), minlength=model.size
    )
    customers = np.isin(np.arange(model.size), model.customers)
    return np.flatnonzero(visited != customers)
