"""Lower bound on the routes through many points, without distances between all of them."""

from __future__ import annotations

import numpy as np

from ...models.fleet import FleetRouting, Objective
from ...models.fleet.data import LEXICOGRAPHIC, Metric
from .bound import SAFE

__all__ = ["tree_bound"]


def tree_bound(model: FleetRouting) -> float:
    """Return a bound from the shortest spanning tree of many points, for their metric without a map.

    All routes together connect the points, and each tree of least Euclidean length consists of edges of the
    Delaunay triangulation, also if depots are connected before and lengths are rounded. Source: F. P.
    Preparata and M. I. Shamos, "Computational Geometry", 1985, section 5.3.
    """
    from scipy.cluster.hierarchy import DisjointSet
    from scipy.spatial import Delaunay, QhullError

    if model.objective is Objective.RANGE:
        return 0.0
    assert model.points is not None
    places, which = np.unique(model.points, axis=0, return_inverse=True)
    try:
        triangles = Delaunay(places)
    except (QhullError, ValueError):  # all points on a line, or few
        return 0.0
    if triangles.coplanar.size:  # points that it leaves out
        return 0.0
    corners = triangles.simplices
    edges = np.unique(
        np.sort(np.vstack([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])), axis=0
    )
    lengths = np.hypot(*(places[edges[:, 0]] - places[edges[:, 1]]).T)
    trees = DisjointSet(range(len(places)))
    depots = np.unique(which[model.depots])
    for depot in depots[1:].tolist():
        trees.merge(int(depots[0]), depot)
    total = 0.0
    order = np.argsort(lengths)
    if model.metric is Metric.ROUNDED:
        lengths = np.floor(lengths + 0.5)
    for i, (a, b) in zip(order.tolist(), edges[order].tolist(), strict=True):
        if trees.merge(a, b):
            total += float(lengths[i])
    longest = total / min(model.vehicles, len(model.customers))
    value = {Objective.MAX: longest, Objective.LEXICOGRAPHIC: longest + LEXICOGRAPHIC * total}
    return value.get(model.objective, total) * (1.0 - SAFE)
