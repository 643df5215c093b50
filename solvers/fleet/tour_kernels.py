"""Closed tours of a cluster; node 0 is the depot.

PSO-AC and k-means-AC use an ant colony (Algorithm 3, lines 13-22), TPHA a genetic algorithm with 2-opt and
Or-opt.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["breed", "colony", "measure", "nearest", "polish"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: Minimum pheromone on an arc, as a share of the maximum, so that every arc remains possible.
FAINT = 0.05
#: Offset of distances in reciprocals, relative to the longest distance.
NEAR = 1e-9
#: Longest segment that Or-opt moves.
STRETCH = 3
#: Smallest gain of an improving move, relative to the longest distance.
GAIN = 1e-12


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
    evaporation: float, rng: Generator, flag: Flag, order: Ints,
) -> tuple[float, int]:  # fmt: skip
    """Improve the tour `order`, shape (n,), in place; return its length and the number of iterations.

    `d`, shape (n + 1, n + 1), are distances, the largest about 1, with the depot as node 0. `alpha` and
    `beta` are the exponents of the pheromone and of the reciprocal distance, and `evaporation` is the share
    of the pheromone that is lost in an iteration. The stop flag is polled after each ant.
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


@kernel
def _at(order: Ints, k: int) -> int:
    """Return the k-th stop; the depot precedes the first and follows the last."""
    return order[k] if 0 <= k < len(order) else 0


@kernel
def _reverse(order: Ints, first: int, last: int) -> None:
    """Reverse the stops first … last in place."""
    while first < last:
        order[first], order[last] = order[last], order[first]
        first += 1
        last -= 1


@kernel
def _move(order: Ints, first: int, last: int, place: int) -> None:
    """Move the stops first … last, in the same order, behind the stop `place` outside of them."""
    if place > last:
        _reverse(order, first, last)
        _reverse(order, last + 1, place)
        _reverse(order, first, place)
    else:
        _reverse(order, place + 1, first - 1)
        _reverse(order, first, last)
        _reverse(order, place + 1, last)


@kernel
def polish(d: Floats, symmetric: bool, flag: Flag, order: Ints) -> None:
    """Improve `order` in place to a local optimum of 2-opt and Or-opt.

    2-opt reverses a segment, so it is used for symmetric distances only.
    """
    n = len(order)
    better = True
    while better:
        better = False
        for i in range(n):
            if flag[0]:
                return
            if symmetric:
                for j in range(i + 1, n):
                    a, b, c, e = _at(order, i - 1), order[i], order[j], _at(order, j + 1)
                    if d[a, c] + d[b, e] < d[a, b] + d[c, e] - GAIN:
                        _reverse(order, i, j)
                        better = True
            for size in range(1, min(STRETCH, n - i) + 1):
                first, last = i, i + size - 1
                a, b, c, e = _at(order, first - 1), order[first], order[last], _at(order, last + 1)
                saved = d[a, b] + d[c, e] - d[a, e]
                for place in range(-1, n):
                    if first - 1 <= place <= last:
                        continue
                    p, q = _at(order, place), _at(order, place + 1)
                    if d[p, b] + d[c, q] - d[p, q] < saved - GAIN:
                        _move(order, first, last, place)
                        better = True
                        break


@kernel
def _draw(n: int, rng: Generator) -> int:
    """Return a random number of 0 … n - 1; compiles faster than ``rng.integers``."""
    return min(int(rng.random() * n), n - 1)


@kernel
def _cross(one: Ints, two: Ints, child: Ints, rng: Generator) -> None:
    """Fill `child` by order crossover (OX): a segment of one parent, the rest as in the other."""
    n = len(one)
    first, last = _draw(n, rng), _draw(n, rng)
    if first > last:
        first, last = last, first
    copied = np.zeros(n + 1, np.int8)
    for k in range(first, last + 1):
        child[k] = one[k]
        copied[one[k]] = 1
    k = 0
    for j in range(n):
        if not copied[two[j]]:
            if k == first:
                k = last + 1
            child[k] = two[j]
            k += 1


@kernel
def _winner(lengths: Floats, rng: Generator) -> int:
    """Return the winner of a tournament of two random individuals."""
    i, j = _draw(len(lengths), rng), _draw(len(lengths), rng)
    return i if lengths[i] <= lengths[j] else j


@kernel
def breed(
    d: Floats, symmetric: bool, population: int, generations: int, mutation: float, rng: Generator,
    flag: Flag, order: Ints,
) -> tuple[float, int]:  # fmt: skip
    """Improve the tour `order` in place; return its length and the number of generations.

    `mutation` is the probability that a child is mutated. The initial tour is a member of the first
    population. The other arguments are those of :func:`colony`.
    """
    n = len(order)
    polish(d, symmetric, flag, order)
    best = measure(d, order)
    if n < 3:
        return best, 0
    old, new = np.empty((population, n), np.int64), np.empty((population, n), np.int64)
    lengths = np.empty(population)
    for i in range(population):
        for k in range(n):
            old[i, k] = order[k]
        if i:
            for k in range(n - 1, 0, -1):
                j = _draw(k + 1, rng)
                old[i, k], old[i, j] = old[i, j], old[i, k]
        lengths[i] = measure(d, old[i])
    for step in range(generations):
        if flag[0]:
            return best, step
        # Elitism: the incumbent survives as a child.
        for k in range(n):
            new[0, k] = order[k]
        for i in range(1, population):
            _cross(old[_winner(lengths, rng)], old[_winner(lengths, rng)], new[i], rng)
            if rng.random() < mutation:
                first, last = _draw(n, rng), _draw(n, rng)
                if symmetric:
                    _reverse(new[i], min(first, last), max(first, last))
                elif first != last:
                    _move(new[i], first, first, last)
        old, new = new, old
        fittest = 0
        for i in range(population):
            lengths[i] = measure(d, old[i])
            if lengths[i] < lengths[fittest]:
                fittest = i
        if lengths[fittest] < best:
            for k in range(n):
                order[k] = old[fittest, k]
            polish(d, symmetric, flag, order)
            best = measure(d, order)
    return best, generations
