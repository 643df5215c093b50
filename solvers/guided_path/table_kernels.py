"""Kernels for the table of shortest lengths f*(t, S), with S the customers served per chain.

State S has the number Σ c_t · strides[t], with c_t customers of chain t served. All customers are
in one list, chain after chain: those of chain t from ``starts[t]`` on, up to ``starts[t + 1]``.
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
    """Fill in the shortest lengths from the start through state S to the last customer of each chain.

    `start`: coordinate of the start, in m. `places`, shape (n,): coordinates of the customers, in m. `starts`,
    shape (k + 1,): index of the first customer of each chain in the list, and n. `strides`, shape (k,):
    increment of a state's number per customer of each chain; the first is 1. `need`, shape (n, k): number of
    customers of each chain that must be served before each customer. `values`, shape (states, k): overwritten;
    inf if no such path exists.
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
    """Trace the shortest tour back from its end; return its length (m).

    :func:`fill_table` must have filled `values`. `order`, shape (n,), is overwritten with indices of the list
    in the order of service; ties by chain.
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
