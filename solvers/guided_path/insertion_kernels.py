"""Loops that build a tour chain by chain: by the best merges, or customer by customer.

All customers stand in one list, chain after chain: those of chain t from ``starts[t]`` on, up to
``starts[t + 1]``. The tour so far keeps the relation with everything that it implies.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .table_kernels import fill_table, trace_table

__all__ = ["insert_cheapest", "merge_chains"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def merge_chains(
    x: Floats, closure: NDArray[np.bool_], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge chain after chain into the tour, each by the dynamic program for two chains.

    Parameters
    ----------
    x : ndarray, shape (n + 1,)
        Where the start and the customers are.
    closure : ndarray of bool, shape (n + 1, n + 1)
        Whether i must precede j, directly or through others.
    members : ndarray of int, shape (n,)
        The customers, chain after chain.
    starts : ndarray of int, shape (k + 1,)
        Where each chain begins in the list.
    order : ndarray of int, shape (n,)
        Filled in with the tour.
    flag : ndarray of int8
        Not 0 asks to stop.

    Returns
    -------
    bool
        Whether all chains were merged.
    """
    for t in range(len(starts) - 1):
        n, size = starts[t], starts[t + 1]
        places, both = np.empty(size), np.empty(size, np.int64)
        need = np.zeros((size, 2), np.int64)
        for i in range(n):
            both[i] = order[i]
        for j in range(n, size):
            both[j] = members[j]
        for i in range(size):
            places[i] = x[both[i]]
        # Whoever must precede a customer of the one is a beginning of the other, as far as it reaches.
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
        found = np.empty(size, np.int64)
        trace_table(x[0], places, heads, strides, values, found)
        for i in range(size):
            order[i] = both[found[i]]
    return True


@kernel(interpretable=True)
def insert_cheapest(
    x: Floats, closure: NDArray[np.bool_], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Insert customer after customer where the tour grows least; ties to the first place.

    Parameters
    ----------
    x, closure, members, starts, order, flag
        As in :func:`merge_chains`.

    Returns
    -------
    bool
        Whether all were inserted.
    """
    for count in range(starts[len(starts) - 1]):
        if flag[0] != 0:
            return False
        c = members[count]
        first, end = 0, count
        for place in range(count):
            if closure[order[place], c]:
                first = place + 1
        for place in range(count - 1, -1, -1):
            if closure[c, order[place]]:
                end = place
        least, chosen = math.inf, first
        for place in range(first, end + 1):
            came = x[0] if place == 0 else x[order[place - 1]]
            goes = x[0] if place == count else x[order[place]]
            more = abs(x[c] - came) + abs(goes - x[c]) - abs(goes - came)
            if more < least:
                least, chosen = more, place
        for place in range(count, chosen, -1):
            order[place] = order[place - 1]
        order[chosen] = c
    return True
