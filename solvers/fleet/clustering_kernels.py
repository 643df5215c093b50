"""Loops over particles: nodes to their nearest centres, and from the largest cluster to the smallest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["assign", "evaluate"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def assign(points: Floats, centres: Floats, slack: int, gaps: Floats, labels: Ints) -> None:
    """Fill `labels` with the cluster of each node, and `gaps` with its distance to each centre.

    Each node goes to its nearest centre. Then the largest cluster gives nodes to the smallest, each
    time the one for which the change costs least, until they differ by `slack` nodes at most
    (eq. 18-21). Of equals the first is taken.

    Parameters
    ----------
    points : ndarray, shape (n, dims)
    centres : ndarray, shape (m, dims)
    slack : int
        At least 1; otherwise there may be no end.
    gaps : ndarray, shape (n, m)
    labels : ndarray of int, shape (n,)
    """
    n, m = gaps.shape
    counts = np.zeros(m, np.int64)
    for i in range(n):
        nearest = 0
        for k in range(m):
            total = 0.0
            for j in range(points.shape[1]):
                total += (points[i, j] - centres[k, j]) * (points[i, j] - centres[k, j])
            gaps[i, k] = math.sqrt(total)
            if gaps[i, k] < gaps[i, nearest]:
                nearest = k
        labels[i] = nearest
        counts[nearest] += 1
    while True:
        large, small = 0, 0
        for k in range(1, m):
            if counts[k] > counts[large]:
                large = k
            if counts[k] < counts[small]:
                small = k
        if counts[large] - counts[small] <= slack:
            return
        chosen, least = -1, math.inf
        for i in range(n):
            if labels[i] == large:
                cost = gaps[i, small] - gaps[i, large]
                if chosen < 0 or cost < least:
                    chosen, least = i, cost
        labels[chosen] = small
        counts[large] -= 1
        counts[small] += 1


@kernel
def evaluate(
    points: Floats, swarm: Floats, slack: int, balance: float, labels: Ints, fitness: Floats,
    flag: NDArray[np.int8],
) -> None:  # fmt: skip
    """Fill the clusters of the nodes and the fitness of each particle, for a part of the swarm.

    The fitness is the sum over clusters of W_k, the distances of its nodes to its centre, and `balance`
    times their standard deviation (division by m); infinite for those that `flag` cuts off.

    Parameters
    ----------
    points : ndarray, shape (n, dims)
    swarm : ndarray, shape (particles, m, dims)
    slack : int
    balance : float
    labels : ndarray of int, shape (particles, n)
    fitness : ndarray, shape (particles,)
    flag : ndarray of int8, shape (1,)
    """
    n, m = points.shape[0], swarm.shape[1]
    gaps = np.empty((n, m))
    widths = np.empty(m)
    for p in range(swarm.shape[0]):
        if flag[0]:
            fitness[p] = math.inf
            continue
        assign(points, swarm[p], slack, gaps, labels[p])
        total = 0.0
        for k in range(m):
            widths[k] = 0.0
        for i in range(n):
            widths[labels[p, i]] += gaps[i, labels[p, i]]
            total += gaps[i, labels[p, i]]
        spread = 0.0
        for k in range(m):
            spread += (widths[k] - total / m) * (widths[k] - total / m)
        fitness[p] = total + balance * math.sqrt(spread / m)
