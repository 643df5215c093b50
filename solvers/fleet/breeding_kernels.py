"""Closed tours by a genetic algorithm, and by 2-opt and Or-opt; node 0 of the distances is the depot."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel
from .colony_kernels import measure

__all__ = ["breed", "polish"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: Longest stretch of nodes that Or-opt moves.
STRETCH = 3
#: Gain, relative to the longest distance, that counts as one.
GAIN = 1e-12


@kernel
def _at(order: Ints, k: int) -> int:
    """Return the k-th stop, the depot before the first and after the last."""
    return order[k] if 0 <= k < len(order) else 0


@kernel
def _reverse(order: Ints, first: int, last: int) -> None:
    """Turn the stops first … last around."""
    while first < last:
        order[first], order[last] = order[last], order[first]
        first += 1
        last -= 1


@kernel
def _move(order: Ints, first: int, last: int, place: int) -> None:
    """Move the stops first … last, not turned around, behind the stop `place` outside of them."""
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
    """Improve `order` in place until no 2-opt and no Or-opt move shortens it.

    2-opt turns a stretch around, so it is left out where the ways there and back differ.
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
def _cross(one: Ints, two: Ints, child: Ints, rng: Generator) -> None:
    """Fill `child` with a stretch of one parent and the rest in the order of the other (OX)."""
    n = len(one)
    first, last = int(rng.integers(0, n)), int(rng.integers(0, n))
    if first > last:
        first, last = last, first
    held = np.zeros(n + 1, np.int8)
    for k in range(first, last + 1):
        child[k] = one[k]
        held[one[k]] = 1
    k = 0
    for j in range(n):
        if not held[two[j]]:
            if k == first:
                k = last + 1
            child[k] = two[j]
            k += 1


@kernel
def _winner(lengths: Floats, rng: Generator) -> int:
    """Return the better of two individuals that are drawn."""
    i, j = int(rng.integers(0, len(lengths))), int(rng.integers(0, len(lengths)))
    return i if lengths[i] <= lengths[j] else j


@kernel
def breed(
    d: Floats, symmetric: bool, population: int, generations: int, mutation: float, rng: Generator,
    flag: Flag, order: Ints,
) -> tuple[float, int]:  # fmt: skip
    """Improve the tour `order` in place; return its length and the generations done.

    Parameters
    ----------
    d : ndarray, shape (n + 1, n + 1)
        Distances, the largest about 1; node 0 is the depot.
    symmetric : bool
        Whether both ways are equally long.
    population, generations : int
    mutation : float
        Probability that a child is changed.
    rng : Generator
    flag : ndarray of int8, shape (1,)
    order : ndarray of int, shape (n,)
        A tour to begin with, one of the first individuals.
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
                j = int(rng.integers(0, k + 1))
                old[i, k], old[i, j] = old[i, j], old[i, k]
        lengths[i] = measure(d, old[i])
    for step in range(generations):
        if flag[0]:
            return best, step
        # The best so far is one of the children.
        for k in range(n):
            new[0, k] = order[k]
        for i in range(1, population):
            _cross(old[_winner(lengths, rng)], old[_winner(lengths, rng)], new[i], rng)
            if rng.random() < mutation:
                first, last = int(rng.integers(0, n)), int(rng.integers(0, n))
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
