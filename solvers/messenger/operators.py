"""Operators of the paper's algorithms on individuals: crossover, mutation, moves of the order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import assess, upper_bound

__all__ = ["cross", "exchange", "move", "mutate", "other", "shuffle"]

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
def other(k: int, count: int, rng: Rng) -> int:
    """Return a random index below `count` other than `k`; `k` if `count` is 1."""
    m = int(rng.random() * (count - 1))
    return m + 1 if m >= k and count > 1 else m


@kernel
def cross(
    sources: Ints, one: Ints, one_genes: Floats, two: Ints, two_genes: Floats, child: Ints,
    child_genes: Floats,
) -> None:  # fmt: skip
    """Fill in a child by the auxiliary vector `sources` of 1 and 2 (paper: section IV-C).

    Each element takes the first remaining gene of parent `one` (1) or `two` (2), and removes the
    vehicle from both.
    """
    taken = np.zeros(len(one), np.bool_)
    p = q = 0
    for k in range(len(one)):
        if sources[k] == 1:
            while taken[one[p]]:
                p += 1
            i = one[p]
            child_genes[i, 0], child_genes[i, 1] = one_genes[i, 0], one_genes[i, 1]
        else:
            while taken[two[q]]:
                q += 1
            i = two[q]
            child_genes[i, 0], child_genes[i, 1] = two_genes[i, 0], two_genes[i, 1]
        child[k], taken[i] = i, True


@kernel
def mutate(
    kind: int, order: Ints, genes: Floats, fleet: Floats, craft: Floats, rng: Rng, poses: Floats
) -> None:
    """Apply mutation operator 1, 2 or 3 of section IV-D.

    Operator 1 swaps two vehicles of the order, operator 2 draws an angle from (0, 2 π], operator 3 draws
    an interval from 0 to t_max of Lemma 1.
    """
    k = int(rng.random() * len(order))
    i = order[k]
    if kind == 1:
        m = other(k, len(order), rng)
        order[k], order[m] = order[m], i
    elif kind == 2:
        genes[i, 0] = 2.0 * math.pi * (1.0 - rng.random())
    else:
        assess(order, genes, fleet, craft, 0, False, poses)
        genes[i, 1] = rng.random() * upper_bound(poses, k, i, genes[i, 0], fleet, craft)


@kernel
def move(order: Ints, begin: int, count: int, place: int) -> None:
    """Move the `count` vehicles from index `begin` on so that the first is at index `place`."""
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
    """Exchange the stretches from `a` to `b` and from `c` to `d` (excluded); a <= b <= c <= d."""
    old = order[a:d].copy()
    k = a
    for low, high in ((c, d), (b, c), (a, b)):
        for m in range(low, high):
            order[k] = old[m - a]
            k += 1
