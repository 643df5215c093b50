"""Kernels of the paper's heuristics: merges of chains, and visits to the nearest customer.

All customers are in one list, chain after chain: those of chain t from ``starts[t]`` to ``starts[t + 1]``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .merge_kernels import merge_two

__all__ = ["merge_by_index", "merge_nearest", "merge_walks", "visit_nearest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def merge_nearest(
    x: Floats, need: NDArray[np.int32], members: Ints, starts: Ints, order: Ints,
    flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge the chains into the tour, next the one whose first customer is nearest to its end.

    `x`, shape (n + 1,): coordinates of the start and the customers, in m. `need`, shape (n, k): number of
    customers of each chain that must be served before each customer of the list; shape (0, k) if no pair
    relates two chains. `members`, shape (n,): the customers, chain after chain. `starts`, shape (k + 1,): first
    position of each chain in the list. `order`, shape (n,): overwritten with the tour, as positions in the
    list.
    """
    left = np.ones(len(starts) - 1, np.bool_)
    n, at = 0, x[0]
    for _ in range(len(left)):
        nearest = _nearest(x, members, starts, left, at)
        if not _merge(x, need, members, starts, nearest, n, order, flag):
            return False
        n += starts[nearest + 1] - starts[nearest]
        at = x[members[order[n - 1]]]
    return True


@kernel
def _nearest(x: Floats, members: Ints, starts: Ints, left: NDArray[np.bool_], at: float) -> int:
    """Return the chain that is `left` whose first customer is nearest to `at`; it is no longer left."""
    least, nearest = math.inf, -1
    for t in range(len(left)):
        if left[t] and abs(x[members[starts[t]]] - at) < least:
            least, nearest = abs(x[members[starts[t]]] - at), t
    left[nearest] = False
    return nearest


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


@kernel
def _turns(x: Floats, stops: Ints, count: int) -> int:
    """Remove the stops at which a tour from the start and back does not turn; return how many remain."""
    kept = 0
    for i in range(count + 1):
        there = x[stops[i]] if i < count else x[0]
        here = x[stops[kept - 1]] if kept > 0 else x[0]
        if there == here:
            continue
        if kept > 0:  # remove the stop before if it is passed on the way to this one
            before = x[stops[kept - 2]] if kept > 1 else x[0]
            if (here > before) == (there > here):
                kept -= 1
        if i < count:
            stops[kept] = stops[i]
            kept += 1
    if kept > 0 and x[stops[kept - 1]] == x[0]:
        kept -= 1
    return kept


@kernel(interpretable=True)
def merge_walks(
    x: Floats, members: Ints, starts: Ints, chosen: Ints, walk: Ints, flag: NDArray[np.int8]
) -> int:
    """Merge unrelated chains into a walk, and store only its turns.

    A tour serves the other customers when it passes them. Each merge is a shortest one, as those of
    :func:`merge_nearest`, but compares the stops of the walk only.

    `x`, `members`, `starts`, `flag`: as for :func:`merge_nearest`. `chosen`, shape (k,) or (0,): chains in the
    order of their merges; if empty, the nearest one comes next. `walk`, shape (n,): overwritten with the
    customers at which the walk turns. Result: number of these customers, or -1 if stopped.
    """
    left = np.ones(len(starts) - 1, np.bool_)
    n = 0
    for step in range(len(left)):
        at = x[walk[n - 1]] if n > 0 else x[0]
        t = chosen[step] if len(chosen) > 0 else _nearest(x, members, starts, left, at)
        chain = members[starts[t] : starts[t + 1]].copy()
        size = _turns(x, chain, len(chain))
        base, other = np.empty(n), np.empty(size)
        former = walk[:n].copy()
        for i in range(n):
            base[i] = x[former[i]]
        for j in range(size):
            other[j] = x[chain[j]]
        free, moves = np.zeros(n + size, np.int64), np.empty((n + 1) * (size + 1), np.uint8)
        merged = np.empty(n + size, np.uint8)
        if not merge_two(
            x[0], x[0], base, other, free[:n], free[n:], math.inf, moves, merged, flag
        ):
            return -1
        i, j = 0, 0
        for stop in range(n + size):
            if merged[stop] == 1:
                walk[stop] = chain[j]
                j += 1
            else:
                walk[stop] = former[i]
                i += 1
        n = _turns(x, walk, n + size)
    return n


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
