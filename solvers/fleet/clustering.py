"""Embedding of nodes as points, clustering, and assignment of vehicles to clusters."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Metric

__all__ = ["assign_vehicles", "k_means", "move_centres", "positions", "reclassify"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Dimension of the embedding of distances.
DIMENSIONS = 2
#: Largest number of nodes for a dense eigenvalue solver; above, Lanczos's method is used.
DENSE = 500
#: Relative excess over the share due to rounding.
ROUNDING = 1e-12


def positions(model: FleetRouting) -> Floats:
    """Return the customers as points in the unit square, shape (customers, 2).

    Costs without points, and paths on a map, are embedded by classical multidimensional scaling of
    the mean of both directions: W. S. Torgerson, "Multidimensional scaling: I. Theory and method",
    Psychometrika 17 (1952). Route lengths still use the true distances.
    """
    if model.points is not None and model.metric is not Metric.GRID:
        places = model.points[model.customers]
    else:
        d = model.distances[np.ix_(model.customers, model.customers)]
        places = _embed((d + d.T) / 2)
    low, span = places.min(axis=0), np.ptp(places)
    scale = float(np.ptp(places, axis=0).max()) if span > 0 else 0.0
    return np.ascontiguousarray((places - low) / scale if scale > 0 else np.zeros_like(places))


def _embed(distances: Floats) -> Floats:
    from scipy.linalg import eigh
    from scipy.sparse.linalg import eigsh

    n = len(distances)
    largest = float(distances.max())
    squares = (distances / (largest or 1.0)) ** 2
    inner = -0.5 * (squares - squares.mean(axis=0) - squares.mean(axis=1)[:, None] + squares.mean())
    count = min(DIMENSIONS, n)
    if n <= DENSE:
        values, vectors = eigh(inner, subset_by_index=[n - count, n - 1])
    else:
        # A fixed start vector makes the plan reproducible.
        values, vectors = eigsh(inner, k=count, which="LA", v0=np.random.default_rng(0).random(n))
    order = np.argsort(-values, kind="stable")
    places = np.zeros((n, DIMENSIONS))
    places[:, :count] = vectors[:, order] * np.sqrt(np.maximum(values[order], 0.0))
    # The sign of an eigenvector depends on the library: make the largest entry positive.
    signs = np.sign(places[np.abs(places).argmax(axis=0), range(DIMENSIONS)])
    return places * np.where(signs == 0, 1.0, signs)


def k_means(
    points: Floats, m: int, weights: Floats, share: float, rounds: int, rng: Generator
) -> Ints:
    """Return the cluster of each point by k-means with bounded clusters, shape (points,).

    The initial centres are `m` random points. Each round reclassifies the points and moves the centres to
    the means. It ends if no label changes.
    """
    n = len(points)
    centres = points[rng.choice(n, m, replace=False)].copy()
    labels, previous = np.empty(n, np.int64), np.full(n, -1)
    for _ in range(rounds):
        reclassify(points, centres, weights, share, labels)
        if np.array_equal(labels, previous):
            break
        previous = labels.copy()
        centres = move_centres(points, labels, centres)
    return labels


def reclassify(
    points: Floats, centres: Floats, weights: Floats, share: float, labels: Ints
) -> None:
    """Fill `labels` with the cluster of each sample (Algorithm 3, lines 6-10; eq. 20).

    Each centre in turn takes the nearest unassigned samples while the sum of their `weights` (R_i of eq.
    18) is at most `share` (R / m). The last centre takes the rest. If there are enough samples, a centre
    takes at least one and leaves one for each later centre. Points have shape (n, dims), centres (m, dims).
    """
    free = np.arange(len(points))
    for k, centre in enumerate(centres):
        later = len(centres) - 1 - k
        gaps = ((points[free] - centre) ** 2).sum(axis=1)
        order = free[np.argsort(gaps, kind="stable")]
        sums = np.cumsum(weights[order])
        within = (
            np.searchsorted(sums, share * (1.0 + ROUNDING), side="right") if later else free.size
        )
        count = max(min(int(within), free.size - later), 1)
        labels[order[:count]] = k
        free = np.sort(order[count:])


def move_centres(points: Floats, labels: Ints, centres: Floats) -> Floats:
    """Return the mean of each cluster (eq. 21); the centre of an empty cluster is unchanged."""
    m = len(centres)
    counts = np.bincount(labels, minlength=m)[:, None]
    sums = np.column_stack([np.bincount(labels, x, minlength=m) for x in points.T])
    return np.where(counts > 0, sums / np.maximum(counts, 1), centres)


def assign_vehicles(model: FleetRouting, labels: Ints) -> Ints:
    """Return the vehicle of each customer, one cluster per vehicle, shape (customers,).

    The assignment minimises the excess over capacities first and the total distance between depots
    and clusters second. Vehicles of one depot without capacities take the clusters in order.
    """
    if model.depots.size == 1 and model.capacity is None:
        return labels
    from scipy.optimize import linear_sum_assignment

    m, d, nodes = model.vehicles, model.distances, model.customers
    ways = np.zeros((m, m))
    for k in range(m):
        part = nodes[labels == k]
        if part.size:
            ways[k] = (d[model.homes][:, part] + d[part][:, model.homes].T).min(axis=1)
            if model.capacity is not None and model.demands is not None:
                excess = np.maximum(model.demands[part].sum() - model.capacity, 0.0)
                scale = float(model.demands.sum()) or 1.0
                ways[k] += 1e6 * float(d.max()) * excess / scale
    return np.asarray(linear_sum_assignment(ways)[1][labels], np.int64)
