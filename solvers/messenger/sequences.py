"""What random search does to orders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["cross", "exchange", "move", "shuffle"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rng = np.random.Generator


@kernel
def shuffle(order: Ints, rng: Rng) -> None:
    """Fill `order` with a random permutation."""
    for k in range(len(order)):
        m = int(rng.random() * (k + 1))
        order[k] = order[m]
        order[m] = k


@kernel
def move(order: Ints, begin: int, count: int, place: int) -> None:
    """Take `count` vehicles from `begin` on out, and put them so that the first is at `place`."""
    taken = order[begin : begin + count].copy()
    step = 1 if place > begin else -1
    k = begin if place > begin else begin + count - 1
    for _ in range(abs(place - begin)):
        order[k] = order[k + step * count]
        k += step
    for m in range(count):
        order[place + m] = taken[m]


@kernel
def exchange(order: Ints, a: int, b: int, c: int, d: int) -> None:
    """Exchange the stretches `a` … `b` - 1 and `c` … `d` - 1, where a <= b <= c <= d."""
    old = order[a:d].copy()
    k = a
    for low, high in ((c, d), (b, c), (a, b)):
        for m in range(low, high):
            order[k] = old[m - a]
            k += 1


@kernel
def cross(
    one: Ints, one_genes: Floats, two: Ints, two_genes: Floats, child: Ints, child_genes: Floats,
    rng: Rng,
) -> None:  # fmt: skip
    """Order crossover: a stretch of `one` at its places, the others as they follow in `two`.

    Genes come from the parent that gives the place.
    """
    n = len(one)
    low, high = int(rng.random() * n), int(rng.random() * n)
    low, high = min(low, high), max(low, high)
    taken = np.zeros(n, np.bool_)
    for k in range(low, high + 1):
        i = one[k]
        child[k], taken[i] = i, True
        for m in range(3):
            child_genes[i, m] = one_genes[i, m]
    k = (high + 1) % n
    for step in range(n):
        i = two[(high + 1 + step) % n]
        if not taken[i]:
            child[k] = i
            for m in range(3):
                child_genes[i, m] = two_genes[i, m]
            k = (k + 1) % n
