"""Kernels of the paper's heuristics: merges of chains, and visits to the nearest customer.

All customers are in one list, chain after chain: those of chain t from ``starts[t]`` to ``starts[t + 1]``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .merge_kernels import merge_two

__all__ = ["merge_by_index", "merge_nearest", "visit_nearest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def merge_nearest(
    x: Floats, need: NDArray[np.int32], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge the chains into the tour, next the one whose first customer is nearest to its end.

    Parameters
    ----------
    x : ndarray, shape (n + 1,)
        Coordinates of the start and the customers, in m.
    need : ndarray of int32, shape (n, k)
        Number of customers of each chain that must be served before each customer of the list; shape (0, k)
        if no pair relates two chains.
    members : ndarray of int, shape (n,)
        The customers, chain after chain.
    starts : ndarray of int, shape (k + 1,)
        First position of each chain in the list.
    order : ndarray of int, shape (n,)
        Overwritten with the tour, as positions in the list.
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
        if not _merge(x, need, members, starts, nearest, n, order, flag):
            return False
        n += starts[nearest + 1] - starts[nearest]
        at = x[members[order[n - 1]]]
    return True


@kernel(interpretable=True)
def merge_by_index(
    x: Floats, need: NDArray[np.int32], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge the chains into the tour in the order of the list, as :func:`merge_nearest`."""
    for t in range(len(starts) - 1):
        if not _merge(x, need, members, starts, t, starts[t], order, flag):
            return False
    return True


@kernel
def _merge(
    x: Floats, need: NDArray[np.int32], members: Ints, starts: Ints, t: int, n: int, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge chain t into the tour of n customers, whose order has positions in the list."""
    begin, size = starts[t], starts[t + 1] - starts[t]
    base, chain = np.empty(n), np.empty(size)
    before_base, before_chain = np.zeros(n, np.int64), np.zeros(size, np.int64)
    for i in range(n):
        base[i] = x[members[order[i]]]
    for j in range(size):
        chain[j] = x[members[begin + j]]
    if len(need) > 0:
        position = np.full(len(members), -1)
        for i in range(n):
            position[order[i]] = i
            before_base[i] = need[order[i], t]
        for j in range(size):
            for u in range(len(starts) - 1):
                if u != t and need[begin + j, u] > 0:
                    i = position[starts[u] + need[begin + j, u] - 1]
                    before_chain[j] = max(before_chain[j], i + 1)
    moves = np.empty((n + 1) * (size + 1), np.uint8)
    merged = np.empty(n + size, np.uint8)
    if not merge_two(
        x[0], x[0], base, chain, before_base, before_chain, math.inf, moves, merged, flag
    ):
        return False
    i, j = n, size
    for stop in range(n + size - 1, -1, -1):
        if merged[stop] == 1:
            j -= 1
            order[stop] = begin + j
        else:
            i -= 1
            order[stop] = order[i]
    return True


@kernel(interpretable=True)
def visit_nearest(
    x: Floats, need: NDArray[np.int32], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Repeatedly visit the nearest available customer; ties by the list of customers.

    Arguments and result are those of :func:`merge_nearest`.
    """
    chains = len(starts) - 1
    counts, at = np.zeros(chains, np.int64), x[0]
    for place in range(len(members)):
        if flag[0] != 0:
            return False
        least, chosen = math.inf, -1
        for t in range(chains):
            i = starts[t] + counts[t]
            if i < starts[t + 1] and abs(x[members[i]] - at) < least:
                allowed = True
                if len(need) > 0:
                    for u in range(chains):
                        allowed = allowed and (u == t or need[i, u] <= counts[u])
                if allowed:
                    least, chosen = abs(x[members[i]] - at), t
        order[place] = starts[chosen] + counts[chosen]
        at = x[members[order[place]]]
        counts[chosen] += 1
    return True
