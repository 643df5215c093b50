"""Loops over the table of shortest ways f*(t, S), where S says how far each chain has been served.

State S has the number Σ c_t · strides[t], with c_t customers of chain t served. All customers stand in
one list, chain after chain: those of chain t from ``starts[t]`` on, up to ``starts[t + 1]``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["fill_table", "trace_table"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def fill_table(
    start: float, places: Floats, starts: Ints, strides: Ints, need: Ints, values: Floats,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Fill in the shortest ways from the start through state S to the last customer of each chain.

    Parameters
    ----------
    start : float
        Where the start is.
    places : ndarray, shape (n,)
        Where the customers are.
    starts : ndarray of int, shape (k + 1,)
        Where each chain begins in the list.
    strides : ndarray of int, shape (k,)
        What one more customer of each chain adds to the number of a state; the first is 1.
    need : ndarray of int, shape (n, k)
        How many customers of each chain must be served before this one.
    values : ndarray, shape (states, k)
        Filled in; infinite where there is no such way.
    flag : ndarray of int8
        Not 0 asks to stop.

    Returns
    -------
    bool
        Whether all was filled in.
    """
    k = len(strides)
    counts = np.zeros(k, np.int64)
    at = np.zeros(k)
    for s in range(len(values)):
        if flag[0] != 0:
            return False
        if s > 0:
            t = 0
            while counts[t] == starts[t + 1] - starts[t]:
                counts[t] = 0
                t += 1
            counts[t] += 1
            at[t] = places[starts[t] + counts[t] - 1]
            for u in range(t):
                at[u] = start
        for t in range(k):
            best = math.inf
            j = starts[t] + counts[t] - 1
            allowed = counts[t] > 0
            if allowed:
                for u in range(k):
                    if need[j, u] > counts[u]:
                        allowed = False
            if allowed:
                here, before = places[j], s - strides[t]
                if before == 0:
                    best = abs(here - start)
                elif counts[t] > 1:
                    best = values[before, t] + abs(places[j - 1] - here)
                for u in range(k):
                    if u != t and counts[u] > 0:
                        best = min(best, values[before, u] + abs(at[u] - here))
            values[s, t] = best
    return True


@kernel(interpretable=True)
def trace_table(
    start: float, places: Floats, starts: Ints, strides: Ints, values: Floats, order: Ints
) -> float:
    """Follow the shortest tour back from its end; return its length.

    Parameters
    ----------
    start, places, starts, strides, values
        As in :func:`fill_table`, the last filled in.
    order : ndarray of int, shape (n,)
        Filled in with places in the list, in the order of service; ties to the first chain.
    """
    k = len(strides)
    counts = np.zeros(k, np.int64)
    for t in range(k):
        counts[t] = starts[t + 1] - starts[t]
    s, there, total = len(values) - 1, start, math.inf
    for stop in range(len(places) - 1, -1, -1):
        last, least = -1, math.inf
        for t in range(k):
            if counts[t] > 0:
                way = values[s, t] + abs(places[starts[t] + counts[t] - 1] - there)
                if way < least:
                    last, least = t, way
        if stop == len(places) - 1:
            total = least
        order[stop] = starts[last] + counts[last] - 1
        there = places[order[stop]]
        counts[last] -= 1
        s -= strides[last]
    return total
