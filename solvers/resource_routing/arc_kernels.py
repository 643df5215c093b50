"""Arcs of a network: pairs of points within the limits, and the arcs left after bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["all_pairs", "count_pairs", "remaining"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@kernel
def distance(points: Floats, i: int, j: int) -> float:
    """Return the straight-line distance between two points."""
    total = 0.0
    for axis in range(points.shape[1]):
        step = points[i, axis] - points[j, axis]
        total += step * step
    return float(np.sqrt(total))


@kernel
def allowed(length: float, rates: Floats, gain: Floats, limit: Floats, head: int) -> bool:
    """Return whether an arc from levels of 0 satisfies the limits of its head."""
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
    """Return the first arc of each tail among all pairs within the limits, shape (n + 1,).

    The coordinates are divided by `scale`. Arcs to the start or from the end are excluded. Counting ends after
    `most` arcs, which the last entry then exceeds, or if the stop flag is set.
    """
    count = len(points)
    first = np.zeros(count + 1, np.int64)
    for i in range(count):
        total = first[i]
        if i != end and total <= most and flag[0] == 0:
            for j in range(count):
                if j != i and j != start:
                    length = scale * distance(points, i, j)
                    if length < np.inf and allowed(length, rates, gain, limit, j):
                        total += 1
        first[i + 1] = total
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
    """Return the heads, lengths and uses of the arcs counted by :func:`count_pairs`."""
    count = len(points)
    head = np.empty(first[count], np.int64)
    lengths = np.empty(first[count])
    use = np.empty((first[count], len(rates)))
    for i in range(count):
        arc = first[i]
        if first[i + 1] == arc:
            continue
        for j in range(count):
            if j != i and j != start:
                length = scale * distance(points, i, j)
                if length < np.inf and allowed(length, rates, gain, limit, j):
                    head[arc], lengths[arc] = j, length
                    for k in range(len(rates)):
                        use[arc, k] = length * rates[k] + gain[j, k]
                    arc += 1
    return head, lengths, use


@kernel(interpretable=True)
def remaining(
    first: Whole,
    head: Whole,
    length: Floats,
    use: Floats,
    limit: Floats,
    reset: Floats,
    floor: Floats,
    least: Floats,
    most: Floats,
) -> tuple[Whole, Whole, Floats, Floats]:
    """Return the arcs compatible with the least levels at tails and the largest at heads."""
    count, resources = len(first) - 1, use.shape[1]
    begins = np.zeros(count + 1, np.int64)
    kept = np.empty(len(head), np.int64)
    number = 0
    for i in range(count):
        for arc in range(first[i], first[i + 1]):
            there, good = head[arc], True
            for k in range(resources):
                level = least[i, k] + use[arc, k]
                leaving = min(max(level, floor[there, k]), reset[there, k])
                if level > limit[there, k] or leaving > most[there, k]:
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
