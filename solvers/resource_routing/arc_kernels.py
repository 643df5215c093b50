"""The arcs of a network: all pairs of points that a full stock allows, and those that remain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["all_pairs", "count_pairs", "remaining"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@kernel
def distance(points: Floats, i: int, j: int) -> float:
    """Return the straight line between two points."""
    total = 0.0
    for axis in range(points.shape[1]):
        step = points[i, axis] - points[j, axis]
        total += step * step
    return float(np.sqrt(total))


@kernel
def allowed(length: float, rates: Floats, gain: Floats, limit: Floats, head: int) -> bool:
    """Whether a head can be reached with nothing used before."""
    for k in range(len(rates)):  # noqa: SIM110 - kernels have no generators
        if length * rates[k] + gain[head, k] > limit[head, k]:
            return False
    return True


@kernel(interpretable=True)
def count_pairs(
    points: Floats,
    scale: float,
    rates: Floats,
    gain: Floats,
    limit: Floats,
    start: int,
    end: int,
    most: int,
    flag: NDArray[np.int8],
) -> Whole:
    """Return where the arcs of each tail begin, among all pairs that the limits allow; shape (n + 1,).

    Parameters
    ----------
    points : ndarray, shape (n, d)
        Coordinates divided by `scale`.
    rates : ndarray, shape (r,)
        Use for a unit of length.
    gain, limit : ndarray, shape (n, r)
        Of the points.
    start, end : int
        Nothing leads to the start or from the end.
    most : int
        Arcs after which counting ends; the last entry is then larger.
    flag : ndarray of int8, shape (1,)
        Nonzero ends it as well.
    """
    count = len(points)
    first = np.zeros(count + 1, np.int64)
    for i in range(count):
        found = first[i]
        if i != end and found <= most and flag[0] == 0:
            for j in range(count):
                if j != i and j != start:
                    length = scale * distance(points, i, j)
                    if length < np.inf and allowed(length, rates, gain, limit, j):
                        found += 1
        first[i + 1] = found
    return first


@kernel(interpretable=True)
def all_pairs(
    points: Floats,
    scale: float,
    rates: Floats,
    gain: Floats,
    limit: Floats,
    start: int,
    end: int,
    first: Whole,
) -> tuple[Whole, Floats, Floats]:
    """Return heads, lengths and uses of the arcs that :func:`count_pairs` counted."""
    count = len(points)
    head = np.empty(first[count], np.int64)
    lengths = np.empty(first[count])
    use = np.empty((first[count], len(rates)))
    for i in range(count):
        at = first[i]
        if first[i + 1] == at:
            continue
        for j in range(count):
            if j != i and j != start:
                length = scale * distance(points, i, j)
                if length < np.inf and allowed(length, rates, gain, limit, j):
                    head[at], lengths[at] = j, length
                    for k in range(len(rates)):
                        use[at, k] = length * rates[k] + gain[j, k]
                    at += 1
    return head, lengths, use


@kernel(interpretable=True)
def remaining(
    first: Whole,
    head: Whole,
    length: Floats,
    use: Floats,
    limit: Floats,
    reset: Floats,
    least: Floats,
    most: Floats,
) -> tuple[Whole, Whole, Floats, Floats]:
    """Return the arcs that the least levels at their tails and the most at their heads allow."""
    count, resources = len(first) - 1, use.shape[1]
    begins = np.zeros(count + 1, np.int64)
    kept = np.empty(len(head), np.int64)
    number = 0
    for i in range(count):
        for arc in range(first[i], first[i + 1]):
            there, good = head[arc], True
            for k in range(resources):
                level = least[i, k] + use[arc, k]
                if level > limit[there, k] or min(level, reset[there, k]) > most[there, k]:
                    good = False
                    break
            if good:
                kept[number] = arc
                number += 1
        begins[i + 1] = number
    heads = np.empty(number, np.int64)
    lengths = np.empty(number)
    uses = np.empty((number, resources))
    for at in range(number):
        arc = kept[at]
        heads[at], lengths[at] = head[arc], length[arc]
        for k in range(resources):
            uses[at, k] = use[arc, k]
    return begins, heads, lengths, uses
