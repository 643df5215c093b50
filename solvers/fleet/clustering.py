"""Nodes as points, clusters of them, and the vehicle of each cluster."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment
from scipy.sparse.linalg import eigsh

from ...models.fleet import FleetRouting, Metric
from .clustering_kernels import assign

__all__ = ["clustered", "k_means", "positions"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Dimensions that distances are embedded in.
DIMENSIONS = 2
#: Nodes above which two eigenvectors are computed alone, by Lanczos's method.
DENSE = 500


def positions(model: FleetRouting) -> Floats:
    """Return the customers as points in a square of about unit size, shape (customers, 2).

    Where only costs are given, or paths on a map, these are embedded by classical multidimensional
    scaling: W. S. Torgerson, "Multidimensional scaling: I. Theory and method", Psychometrika 17 (1952),
    with the mean of both ways. Routes are measured by the true distances all the same.
    """
    if model.points is not None and model.metric is not Metric.GRID:
        found = model.points[model.customers]
    else:
        d = model.distances[np.ix_(model.customers, model.customers)]
        found = _embedded((d + d.T) / 2)
    low, span = found.min(axis=0), np.ptp(found)
    scale = float(np.ptp(found, axis=0).max()) if span > 0 else 0.0
    return np.ascontiguousarray((found - low) / scale if scale > 0 else np.zeros_like(found))


def _embedded(distances: Floats) -> Floats:
    n = len(distances)
    largest = float(distances.max())
    squares = (distances / (largest or 1.0)) ** 2
    inner = -0.5 * (squares - squares.mean(axis=0) - squares.mean(axis=1)[:, None] + squares.mean())
    count = min(DIMENSIONS, n)
    if n <= DENSE:
        values, vectors = eigh(inner, subset_by_index=[n - count, n - 1])
    else:
        # Started alike each time, for the same plan.
        values, vectors = eigsh(inner, k=count, which="LA", v0=np.random.default_rng(0).random(n))
    order = np.argsort(-values, kind="stable")
    found = np.zeros((n, DIMENSIONS))
    found[:, :count] = vectors[:, order] * np.sqrt(np.maximum(values[order], 0.0))
    # The sign of an eigenvector is the library's choice.
    signs = np.sign(found[np.abs(found).argmax(axis=0), range(DIMENSIONS)])
    return found * np.where(signs == 0, 1.0, signs)


def k_means(points: Floats, m: int, slack: int, rounds: int, rng: Generator) -> Ints:
    """Return the cluster of each point by Lloyd's rounds from `m` of the points, drawn.

    With `slack` below the number of points, clusters are balanced in each round as those of particles.
    """
    n = len(points)
    centres = points[rng.choice(n, m, replace=False)]
    gaps, labels = np.empty((n, m)), np.empty(n, np.int64)
    previous = np.full(n, -1)
    for _ in range(rounds):
        assign(points, centres, slack, gaps, labels)
        if np.array_equal(labels, previous):
            break
        previous = labels.copy()
        centres = centres_of(points, labels, centres)
    return labels


def centres_of(points: Floats, labels: Ints, before: Floats) -> Floats:
    """Return the mean of each cluster; an empty one stays where it was."""
    counts = np.bincount(labels, minlength=len(before))
    sums = np.zeros_like(before)
    np.add.at(sums, labels, points)
    return np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], before)


def clustered(model: FleetRouting, points: Floats, labels: Ints) -> list[Ints]:
    """Return the customers of each vehicle, as indices of `points`.

    Where there are nodes enough, no cluster is left empty: the largest gives the node that is farthest
    from its mean. Clusters go to vehicles such that the ways to their depots are shortest in all, and
    demands above a vehicle's capacity least.
    """
    m = model.vehicles
    labels = labels.copy()
    count = min(m, len(points))
    while True:
        sizes = np.bincount(labels, minlength=m)
        if np.count_nonzero(sizes) >= count:
            break
        large = int(sizes.argmax())
        members = np.flatnonzero(labels == large)
        gaps = np.linalg.norm(points[members] - points[members].mean(axis=0), axis=1)
        labels[members[int(gaps.argmax())]] = int(sizes.argmin())
    parts = [np.flatnonzero(labels == k) for k in range(m)]
    if model.depots.size == 1 and model.capacity is None:
        return parts
    d, nodes = model.distances, model.customers
    ways = np.zeros((m, m))
    for k, part in enumerate(parts):
        if part.size:
            both = d[model.homes][:, nodes[part]] + d[nodes[part]][:, model.homes].T
            ways[k] = both.min(axis=1)
            if model.capacity is not None and model.demands is not None:
                excess = np.maximum(model.demands[nodes[part]].sum() - model.capacity, 0.0)
                scale = float(model.demands.sum()) or 1.0
                ways[k] += 1e6 * float(d.max()) * excess / scale
    vehicles = linear_sum_assignment(ways)[1]
    return [parts[int(k)] for k in np.argsort(vehicles)]
