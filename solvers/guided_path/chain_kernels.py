"""Kernels of the search that removes chains from a tour and merges them into it again.

A step selects a window of the tour and some chains near a turning point in it. The customers of these
chains in the window are removed and merged into the rest of the window chain by chain, each merge in the
shortest way. Random lengths of the gaps diversify the merges.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel
from .bound import Tables
from .merge_kernels import merge_two

__all__ = ["merge_again", "path_length"]

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Needs = NDArray[np.int32]

#: Length of an infeasible path.
FAR = 1 << 60
#: Minimum size of a window, maximum number of removed chains, and largest relative change of a gap.
SHORTEST, MOST, NOISE = 50, 20, 0.2
#: Minimum range of the coordinates with random lengths, so that rounding has little effect.
FINE = 1 << 30
#: Time of a step apart from its merges and gaps, in states of a merge.
STEP = 100
#: Probability that the next chain is near another turning point.
ELSEWHERE = 0.1


@kernel
def path_length(tables: Tables, stops: Ints, before: int, after: int) -> int:
    """Return the length of the path from place `before` through customers to place `after`, in units."""
    at, place = tables.at, tables.place
    here, way = at[before], 0
    for i in range(stops.size):
        there = at[place[stops[i]]]
        way += abs(there - here)
        here = there
    return int(way + abs(here - at[after]))


@kernel
def _pick(
    tables: Tables, order: Ints, owner: Ints, begin: int, size: int, picked: Ints, draw: Generator
) -> int:
    """Fill in chains with customers near a random turning point of a window; return their number."""
    at, place, stop = tables.at, tables.place, begin + size
    centre = begin + int(draw.random() * size)
    while begin < centre < stop - 1:
        here = at[place[order[centre]]]
        if (at[place[order[centre + 1]]] - here) * (
            1.0 * (here - at[place[order[centre - 1]]])
        ) < 0.0:
            break
        centre += 1
    count = 0
    for step in range(int(min(MOST, picked.size) ** draw.random())):
        if draw.random() < ELSEWHERE:
            centre = begin + int(draw.random() * size)
        i = centre + ((step + 1) // 2 if step % 2 else -(step // 2))
        new = begin <= i < stop
        if new:
            for j in range(count):
                new = new and picked[j] != owner[order[i]]
        if new:
            # Insert at a random position.
            j = int(draw.random() * (count + 1))
            picked[count] = picked[j]
            picked[j] = owner[order[i]]
            count += 1
    return count


@kernel
def _relate(
    tables: Tables, need: Needs, rest: Ints, first: int, last: int, k: int, position: Ints, asked: Ints,
    before_chain: Ints,
) -> None:  # fmt: skip
    """Fill in how many customers of `rest` and of chain k must be served before each other."""
    for i in range(rest.size):
        position[rest[i]] = i
        asked[i] = min(max(need[rest[i], k] - (first - tables.first[k]), 0), last - first)
    for j in range(last - first):
        for u in range(need.shape[1]):
            if u != k and need[first + j, u] > 0:
                i = position[tables.first[u] + need[first + j, u] - 1]
                before_chain[j] = max(before_chain[j], i + 1)
    for i in range(rest.size):
        position[rest[i]] = -1


@kernel
def _insert(
    tables: Tables, need: Needs, at: Ints, rest: Ints, bounds: Ints, moves: Bytes, position: Ints, result: Ints,
    flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Merge customers of a chain into `rest`; return the number of states of the merge, or -1 if stopped.

    `bounds` contains the places before and after the window, the first and last customer and the chain.
    """
    place, first, last, k = tables.place, bounds[2], bounds[3], bounds[4]
    start, end, count, size = at[bounds[0]], at[bounds[1]], rest.size, last - first
    x, nodes = np.empty(count + 1, np.int64), np.empty(count + 1, np.int64)
    for i in range(count):
        x[i] = at[place[rest[i]]]
    x[count] = end
    asked, before_chain = np.zeros(count, np.int64), np.zeros(size, np.int64)
    forced = np.zeros(count + 1, np.bool_)
    if len(need) > 0:
        _relate(tables, need, rest, first, last, k, position, asked, before_chain)
        for j in range(size):
            forced[before_chain[j]] = True
    # Customers between turning points are served in passing, unless a pair relates them to the chain.
    kept, earlier, most = 0, start, 0
    for i in range(count):
        turns = x[i] == earlier or (x[i] > earlier) != (x[i + 1] > x[i])
        if turns or forced[i + 1] or asked[i] > most:
            most = max(most, asked[i])
            nodes[kept] = i
            asked[kept] = most
            kept += 1
            earlier = x[i]
    nodes[kept] = count
    node = 0
    for j in range(size):
        before_chain[j] = max(before_chain[j], before_chain[j - 1] if j > 0 else 0)
    base, chain = np.empty(kept, np.int64), np.empty(size, np.int64)
    for i in range(kept):
        base[i] = x[nodes[i]]
    for j in range(size):
        chain[j] = at[place[first + j]]
        while nodes[node] < before_chain[j]:
            node += 1
        before_chain[j] = node
    merged = np.empty(kept + size, np.uint8)
    if not merge_two(start, end, base, chain, asked[:kept], before_chain, FAR, moves, merged, flag):
        return -1
    here, i, j, node = start, 0, 0, 0
    for stop in range(kept + size):
        there = chain[j] if merged[stop] == 1 else base[node]
        while i < nodes[node] and min(here, there) <= x[i] <= max(here, there):
            result[i + j] = rest[i]
            i += 1
        if merged[stop] == 1:
            result[i + j] = first + j
            j += 1
        else:
            result[i + j] = rest[i]
            i, node = i + 1, node + 1
        here = there
    while i < count:
        result[i + j] = rest[i]
        i += 1
    return int((kept + 1) * (size + 1))


@kernel
def merge_again(
    tables: Tables, need: Needs, order: Ints, best: Ints, work: int, heat: float, cold: float, moves: Bytes,
    draw: Generator, flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Improve a tour by merging some of its chains again; return the length of the best one, in units.

    `need`, shape (n, chains): see :func:`.bound.needs_of`. `order`, `best`, shape (n,): current and best tour;
    updated. `work`: number of states of all merges after which the search ends. `heat`, `cold`: mean accepted
    increase of the length at the beginning and at the end, in units. `moves`: scratch space for the states of
    the largest merge.
    """
    n, chains = order.size, tables.first.size - 1
    at, place = tables.at, tables.place
    rest, result = np.empty(n, np.int64), np.empty(n, np.int64)
    owner, position, picked = np.empty(n, np.int64), np.full(n, -1), np.empty(chains, np.int64)
    low, high = np.full(chains, n), np.zeros(chains, np.int64)
    bounds, weighted = np.empty(5, np.int64), at.copy()
    fine = max(FINE // max(at[at.size - 1], 1), 1)
    for k in range(chains):
        for c in range(tables.first[k], tables.first[k + 1]):
            owner[c] = k
    value = path_length(tables, order, place[n], place[n])
    least = path_length(tables, best, place[n], place[n])
    done = 0
    while done < work and flag[0] == 0:
        size = int(SHORTEST * (n / SHORTEST) ** draw.random()) if n > SHORTEST else n
        begin = int(draw.random() * (n - size + 1))
        count = _pick(tables, order, owner, begin, size, picked, draw)
        for i in range(count):
            high[picked[i]] = 1
        m = 0
        for i in range(begin, begin + size):
            c, k = order[i], owner[order[i]]
            if high[k] == 0:
                rest[m] = c
                m += 1
            else:
                low[k], high[k] = min(low[k], c), c + 1
        for gap in range(at.size - 1):
            scale = 1.0 + NOISE * (draw.random() - 0.5)
            weighted[gap + 1] = weighted[gap] + int(scale * (fine * tables.length[gap]))
        bounds[0] = place[order[begin - 1]] if begin > 0 else place[n]
        bounds[1] = place[order[begin + size]] if begin + size < n else place[n]
        done += size + at.size + STEP
        states = 0
        for i in range(count):
            k = picked[i]
            bounds[2], bounds[3], bounds[4] = low[k], high[k], k
            if states >= 0:
                states = _insert(
                    tables, need, weighted, rest[:m], bounds, moves, position, result, flag
                )
                done += states
            m += high[k] - low[k]
            low[k], high[k] = n, 0
            rest, result = result, rest
        if states < 0:
            break
        change = path_length(tables, rest[:size], bounds[0], bounds[1]) - path_length(
            tables, order[begin : begin + size], bounds[0], bounds[1]
        )
        level = heat + (cold - heat) * min(done / work, 1.0)
        if change <= -level * math.log(1.0 - draw.random()):
            value += change
            for i in range(size):
                order[begin + i] = rest[i]
            if value < least:
                least = value
                for i in range(n):
                    best[i] = order[i]
    return least
