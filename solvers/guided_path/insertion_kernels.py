"""Kernels of the paper's heuristics: merges of chains, and visits to the nearest customer.

All customers are in one list, chain after chain: those of chain t from ``starts[t]`` to ``starts[t + 1]``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .table_kernels import fill_table, trace_table

__all__ = ["merge_by_index", "merge_nearest", "visit_nearest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def merge_nearest(
    x: Floats, closure: NDArray[np.bool_], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge the chains into the tour, next the one whose first customer is nearest to its end.

    Parameters
    ----------
    x : ndarray, shape (n + 1,)
        Coordinates of the start and the customers, in m.
    closure : ndarray of bool, shape (n + 1, n + 1)
        True if i must precede j, directly or indirectly.
    members : ndarray of int, shape (n,)
        The customers, chain after chain.
    starts : ndarray of int, shape (k + 1,)
        First position of each chain in the list.
    order : ndarray of int, shape (n,)
        Overwritten with the tour.
    flag : ndarray of int8
        Stop flag, nonzero to stop.

    Returns
    -------
    bool
        True if all chains were merged.
    """
    left = np.ones(len(starts) - 1, np.bool_)
    n, at = 0, x[0]
    for _ in range(len(left)):
        least, nearest = math.inf, -1
        for t in range(len(left)):
            if left[t] and abs(x[members[starts[t]]] - at) < least:
                least, nearest = abs(x[members[starts[t]]] - at), t
        left[nearest] = False
        if not _merge(x, closure, members, starts[nearest], starts[nearest + 1], n, order, flag):
            return False
        n += starts[nearest + 1] - starts[nearest]
        at = x[order[n - 1]]
    return True


@kernel(interpretable=True)
def merge_by_index(
    x: Floats, closure: NDArray[np.bool_], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge the chains into the tour in the order of the list, as :func:`merge_nearest`."""
    for t in range(len(starts) - 1):
        if not _merge(x, closure, members, starts[t], starts[t + 1], starts[t], order, flag):
            return False
    return True


@kernel
def _merge(
    x: Floats, closure: NDArray[np.bool_], members: Ints, begin: int, end: int, n: int, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge one chain into the tour of n customers by the dynamic program for two chains."""
    size = n + end - begin
    places, both = np.empty(size), np.empty(size, np.int64)
    need = np.zeros((size, 2), np.int64)
    for i in range(n):
        both[i] = order[i]
    for j in range(n, size):
        both[j] = members[begin + j - n]
    for i in range(size):
        places[i] = x[both[i]]
    # The customers of one chain that must precede a customer of the other form a prefix of that
    # chain.
    for j in range(n, size):
        for i in range(n):
            if closure[both[i], both[j]]:
                need[j, 0] = i + 1
            elif closure[both[j], both[i]]:
                need[i, 1] = j - n + 1
    heads, strides = np.zeros(3, np.int64), np.ones(2, np.int64)
    heads[1], heads[2], strides[1] = n, size, n + 1
    values = np.empty(((n + 1) * (size - n + 1), 2))
    if not fill_table(x[0], places, heads, strides, need, values, flag):
        return False
    merged = np.empty(size, np.int64)
    trace_table(x[0], places, heads, strides, values, merged)
    for i in range(size):
        order[i] = both[merged[i]]
    return True


@kernel(interpretable=True)
def visit_nearest(
    x: Floats, closure: NDArray[np.bool_], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Repeatedly visit the nearest available customer; ties by the list of customers.

    Arguments and result are those of :func:`merge_nearest`.
    """
    count = len(members)
    # Number of unserved predecessors, -1 for a visited customer.
    missing = np.zeros(len(x), np.int64)
    for i in range(count):
        for j in range(count):
            if closure[members[i], members[j]]:
                missing[members[j]] += 1
    at = x[0]
    for place in range(count):
        if flag[0] != 0:
            return False
        least, chosen = math.inf, -1
        for i in range(count):
            c = members[i]
            if missing[c] == 0 and abs(x[c] - at) < least:
                least, chosen = abs(x[c] - at), c
        order[place] = chosen
        at = x[chosen]
        missing[chosen] = -1
        for i in range(count):
            if closure[chosen, members[i]]:
                missing[members[i]] -= 1
    return True
