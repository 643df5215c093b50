"""Closed tours by an ant colony (Algorithm 3, lines 13-22); node 0 is the depot."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["colony", "measure", "nearest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Minimum pheromone on an arc, as a share of the maximum, so that every arc remains possible.
FAINT = 0.05
#: Offset of distances in reciprocals, relative to the longest distance.
NEAR = 1e-9


@kernel
def measure(d: Floats, order: Ints) -> float:
    """Return the length of the tour from node 0 through `order` and back."""
    total, here = 0.0, 0
    for k in range(len(order)):
        total += d[here, order[k]]
        here = order[k]
    return float(total + d[here, 0])


@kernel
def nearest(d: Floats, order: Ints) -> None:
    """Fill `order` with the nearest-neighbour tour of nodes 1 … n; ties go to the first node."""
    n = len(order)
    for k in range(n):
        order[k] = k + 1
    here = 0
    for k in range(n):
        best = k
        for j in range(k + 1, n):
            if d[here, order[j]] < d[here, order[best]]:
                best = j
        order[k], order[best] = order[best], order[k]
        here = order[k]


@kernel
def _walk(choice: Floats, d: Floats, order: Ints, rng: Generator) -> None:
    """Fill `order` with the tour of one ant; steps are drawn with probability ∝ `choice`."""
    n = len(order)
    for k in range(n):
        order[k] = k + 1
    here = 0
    for k in range(n):
        total = 0.0
        for j in range(k, n):
            total += choice[here, order[j]]
        chosen = n - 1
        threshold = rng.random() * total
        for j in range(k, n):
            threshold -= choice[here, order[j]]
            if threshold < 0.0:
                chosen = j
                break
        order[k], order[chosen] = order[chosen], order[k]
        here = order[k]


@kernel
def _mark(trail: Floats, order: Ints, amount: float, symmetric: bool) -> None:
    """Deposit pheromone along a tour, in both directions for symmetric distances."""
    here = 0
    for k in range(len(order) + 1):
        there = order[k] if k < len(order) else 0
        trail[here, there] += amount
        if symmetric:
            trail[there, here] += amount
        here = there


@kernel
def colony(
    d: Floats, symmetric: bool, ants: int, iterations: int, alpha: float, beta: float,
    evaporation: float, rng: Generator, flag: NDArray[np.int8], order: Ints,
) -> tuple[float, int]:  # fmt: skip
    """Improve the tour `order` in place; return its length and the number of iterations.

    Parameters
    ----------
    d : ndarray, shape (n + 1, n + 1)
        Distances, the largest about 1; node 0 is the depot.
    symmetric : bool
        Whether distances are the same in both directions.
    ants, iterations : int
        Number of ants and of iterations.
    alpha, beta : float
        Exponents of the pheromone and of the reciprocal distance.
    evaporation : float
        Share of the pheromone that is lost in an iteration.
    rng : Generator
        Source of random numbers.
    flag : ndarray of int8, shape (1,)
        Stop flag, polled after each ant.
    order : ndarray of int, shape (n,)
        Initial tour; overwritten by the best tour.
    """
    n = len(order)
    best = measure(d, order)
    trail, choice = np.ones((n + 1, n + 1)), np.empty((n + 1, n + 1))
    shine = np.empty((n + 1, n + 1))
    for i in range(n + 1):
        for j in range(n + 1):
            shine[i, j] = (d[i, j] + NEAR) ** -beta
    ways, lengths = np.empty((ants, n), np.int64), np.empty(ants)
    # Per iteration, the best tour deposits 1 and all ants together at most 1.
    floor = FAINT * 2.0 / (evaporation * (n + 1))
    for step in range(iterations):
        if not best > 0.0 or n < 2:
            return best, step
        for i in range(n + 1):
            for j in range(n + 1):
                faded = trail[i, j] if alpha == 1.0 else trail[i, j] ** alpha
                choice[i, j] = faded * shine[i, j]
        for a in range(ants):
            if flag[0]:
                return best, step
            _walk(choice, d, ways[a], rng)
            lengths[a] = measure(d, ways[a])
            if lengths[a] < best:
                best = lengths[a]
                for k in range(n):
                    order[k] = ways[a, k]
        for i in range(n + 1):
            for j in range(n + 1):
                trail[i, j] = max(trail[i, j] * (1.0 - evaporation), floor)
        for a in range(ants):
            if lengths[a] > 0.0 and lengths[a] < math.inf:
                _mark(trail, ways[a], best / lengths[a] / ants, symmetric)
        _mark(trail, order, 1.0, symmetric)
    return best, iterations
