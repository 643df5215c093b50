"""Kernel of the beam search over the states of a tour along a path.

States wait in one list per number of customers served, so that compared states have equal progress.
The best states of each list are expanded, and all are returned to the pool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .bound import Tables
from .share_kernels import Shares
from .state_kernels import (
    hashed,
    neighbours,
    pack,
    rest_after,
    rest_by_gaps,
    rest_with_shares,
    serve,
    unpack,
)

__all__ = ["CLASSES", "beam"]

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Number of chains above which an update of the bound is faster than its computation from all chains.
MANY = 64
#: Number of rank classes for the selection of the best states.
CLASSES = 1024


@kernel
def _distinct(head: int, keys: Ints, costs: Ints, after: Links, table: Links, free: Links) -> int:
    """Remove duplicates from a list, keeping the shortest path to each state; return its new head."""
    for slot in range(table.size):
        table[slot] = -1
    mask, result, state = table.size - 1, -1, head
    while state >= 0:
        following = int(after[state])
        slot = hashed(keys[state]) & mask
        twin = -1
        while table[slot] >= 0:
            other = int(table[slot])
            same = True
            for word in range(keys.shape[1]):
                same = same and keys[other, word] == keys[state, word]
            if same:
                twin = other
                break
            slot = (slot + 1) & mask
        if twin < 0:
            table[slot] = state
            after[state] = result
            result = state
        else:
            if costs[state, 0] < costs[twin, 0]:
                for column in range(costs.shape[1]):
                    costs[twin, column] = costs[state, column]
            free[0] += 1
            free[free[0]] = state
        state = following
    return result


@kernel
def _limit(
    head: int, costs: Ints, after: Links, width: int, tally: Ints
) -> tuple[int, int, int, int]:
    """Return least rank, class width, the class that fills `width`, and its number of states."""
    low, high, count, state = 0, 0, 0, head
    while state >= 0:
        rank = costs[state, 1]
        low, high = (min(low, rank), max(high, rank)) if count else (rank, rank)
        count += 1
        state = int(after[state])
    step = (high - low) // tally.size + 1
    if count <= width:
        return low, step, int(tally.size), 0
    for index in range(tally.size):
        tally[index] = 0
    state = head
    while state >= 0:
        tally[(costs[state, 1] - low) // step] += 1
        state = int(after[state])
    index = 0
    while tally[index] < width:
        width -= tally[index]
        index += 1
    return low, step, index, width


@kernel(interpretable=True)
def beam(
    tables: Tables, shares: Shares, keys: Ints, costs: Ints, maxima: NDArray[np.int16], after: Links,
    free: Links, table: Links, heads: Links, trace: Links, best: int, width: int, flag: NDArray[np.int8],
) -> tuple[int, int, int]:  # fmt: skip
    """Return the length of the best tour, its last entry of `trace`, and the number of pruned states.

    `tables`, `shares`: tables of the model, and shares of its chains. `keys`, shape (room, words): pool of
    states. `costs`, shape (room, 4): length up to each state, the same plus the bound on the rest, its entry of
    `trace`, and the bound by gaps on the rest. `maxima`, shape (room + 1, groups): largest number of crossings
    of each group of gaps in each state, and scratch space. `after`, shape (room,): successor in the list of the
    state. `free`, shape (room + 1,): number of free slots of the pool, and their indices. `table`: hash table
    of the states of a list. Its size is a power of two, at least twice the pool's. `heads`, shape (n + 1,):
    first state of each list. `trace`, shape (m, 2): overwritten with the predecessor entry and place of each entry.
    `best`: upper bound: only shorter tours are accepted. `width`: maximum number of expanded states per list.
    Result: length; entry, or -1 if no shorter tour was found; number of pruned states, 0 if the search was
    exhaustive, which proves optimality.
    """
    place, at, fields = tables.place, tables.at, tables.fields
    chains, total = tables.first.size - 1, tables.first[tables.first.size - 1]
    counts, then = np.zeros(chains, np.int64), np.empty(chains, np.int64)
    mine, groups = np.empty(tables.wide.size, np.int16), tables.wide.size
    tally = np.empty(CLASSES, np.int64)
    for index in range(heads.size):
        heads[index] = -1
    for index in range(len(keys)):
        free[index + 1] = index
    free[0] = len(keys) - 1
    here = place[place.size - 1]
    served = serve(tables, counts, here)
    root = int(free[free[0] + 1])
    pack(counts, here, fields, keys[root])
    for column in range(3):
        costs[root, column] = 0
    costs[root, 3] = rest_by_gaps(tables, counts, here, maxima[root])
    after[root], heads[served] = -1, root
    trace[0, 0], trace[0, 1] = -1, here
    entries, last, left = 1, -1, 0
    for layer in range(served, total):
        head = _distinct(int(heads[layer]), keys, costs, after, table, free)
        low, step, limit, quota = _limit(head, costs, after, width, tally)
        state = head
        while state >= 0:
            if flag[0] != 0:
                return best, last, left + 1
            following = int(after[state])
            way, reached, group = costs[state, 0], costs[state, 2], (costs[state, 1] - low) // step
            useful, bound = costs[state, 1] < best, costs[state, 3]
            former = state
            here = unpack(keys[state], fields, counts)
            free[0] += 1
            free[free[0]] = state
            state = following
            if not useful:
                continue
            if group > limit or (group == limit and quota == 0):
                left += 1
                continue
            if group == limit:
                quota -= 1
            # The slot of the state is free for its first successor.
            if chains > MANY:
                for gap in range(groups):
                    mine[gap] = maxima[former, gap]
            for there in neighbours(tables, counts, here):
                if there < 0:
                    continue
                for k in range(chains):
                    then[k] = counts[k]
                done = layer + serve(tables, then, there)
                farther = way + abs(at[there] - at[here])
                room = int(free[free[0]]) if free[0] > 0 else len(keys)
                if chains > MANY:
                    for gap in range(groups):
                        maxima[room, gap] = mine[gap]
                    lower = rest_after(tables, counts, then, here, there, bound, maxima[room])
                else:
                    lower = rest_by_gaps(tables, then, there, mine)
                rest = rest_with_shares(tables, shares, then, there, lower)
                if farther + rest >= best:
                    continue
                if free[0] == 0 and done < total:
                    left += 1
                    continue
                trace[entries, 0], trace[entries, 1] = reached, there
                if done == total:
                    best, last = farther + rest, entries
                else:
                    free[0] -= 1
                    pack(then, there, fields, keys[room])
                    costs[room, 0], costs[room, 1] = farther, farther + rest
                    costs[room, 2], costs[room, 3] = entries, lower
                    after[room] = heads[done]
                    heads[done] = room
                entries += 1
    return best, last, left
