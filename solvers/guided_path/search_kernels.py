"""Kernels of A* over the states of a tour along a path, with a hash table and buckets.

States are numbered in the order of their discovery. An open state is in the doubly linked list of
its bucket.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .bound import Tables
from .share_kernels import Shares
from .state_kernels import hashed, least_rest, neighbours, pack, serve, unpack

__all__ = [
    "BEST", "COUNT", "DONE", "EXPANDED", "FULL", "GOAL", "LOWEST", "PAUSED", "States", "rehash", "search_anew",
    "search_on",
]  # fmt: skip

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Return values of a search: exhausted, out of room, or paused.
DONE, FULL, PAUSED = 0, 1, 2
#: Entries of `info`: number of states, lowest bucket that may be non-empty, length of the best
#: tour, its
#: last state (-1 if the tour is not from this search), number of expansions.
COUNT, LOWEST, BEST, GOAL, EXPANDED = 0, 1, 2, 3, 4
#: Link of a state that is not open.
CLOSED = -2


class States(NamedTuple):
    """States of a search and its queue, modified in place.

    Attributes
    ----------
    keys : ndarray of int, shape (room, words)
        Keys of the states.
    costs : ndarray of int, shape (room, 2)
        Length up to each state, and the same plus the bound on the rest.
    parents : ndarray of int32, shape (room,)
        Predecessor of each state.
    links : ndarray of int32, shape (room, 2)
        Previous and next state in its bucket.
    table, buckets : ndarray of int32
        Hash table of the states, and first state of each bucket; -1 if empty.
    lowest, width : int
        Least length of the first bucket, and width of each bucket.
    info : ndarray of int, shape (5,)
        Entries as in :data:`COUNT`.
    """

    keys: Ints
    costs: Ints
    parents: Links
    links: Links
    table: Links
    buckets: Links
    lowest: int
    width: int
    info: Ints


@kernel
def _slot(key: Ints, keys: Ints, table: Links) -> int:
    """Return the slot of a key in the hash table, or the free slot for it."""
    mask = table.size - 1
    slot = hashed(key) & mask
    while True:
        state = table[slot]
        if state < 0:
            return slot
        same = True
        for word in range(key.size):
            if keys[state, word] != key[word]:
                same = False
                break
        if same:
            return slot
        slot = (slot + 1) & mask


@kernel
def rehash(keys: Ints, count: int, table: Links) -> None:
    """Fill a hash table, whose size is a power of two, with the first `count` states."""
    for slot in range(table.size):
        table[slot] = -1
    for state in range(count):
        table[_slot(keys[state], keys, table)] = state


@kernel
def _link(states: States, state: int, bucket: int) -> None:
    buckets, links = states.buckets, states.links
    head = buckets[bucket]
    links[state, 0] = -1
    links[state, 1] = head
    if head >= 0:
        links[head, 0] = state
    buckets[bucket] = state


@kernel
def _unlink(states: States, state: int, bucket: int) -> None:
    buckets, links = states.buckets, states.links
    before, after = int(links[state, 0]), int(links[state, 1])
    if before >= 0:
        links[before, 1] = after
    else:
        buckets[bucket] = after
    if after >= 0:
        links[after, 0] = before
    links[state, 1] = CLOSED


@kernel
def search_on(
    tables: Tables, shares: Shares, states: States, steps: int, flag: NDArray[np.int8]
) -> int:
    """Expand up to `steps` states; return `DONE`, `FULL` or `PAUSED`.

    A state is expanded again if a shorter path to it is found. States whose bound reaches the best
    length are discarded, so the search is exhausted when no bucket below that length remains. A nonzero
    `flag` pauses the search.
    """
    at, keys, costs, links = tables.at, states.keys, states.costs, states.links
    buckets, lowest, width, info = states.buckets, states.lowest, states.width, states.info
    chains, room = tables.first.size - 1, len(keys)
    counts, after = np.empty(chains, np.int64), np.empty(chains, np.int64)
    key, scratch = np.empty(keys.shape[1], np.int64), np.empty(tables.wide.size, np.int16)
    total = tables.first[chains]
    for _ in range(steps):
        if flag[0] != 0:
            return PAUSED
        bucket = info[LOWEST]
        while bucket < buckets.size and buckets[bucket] < 0:
            bucket += 1
        info[LOWEST] = bucket
        if bucket == buckets.size or lowest + bucket * width >= info[BEST]:
            return DONE
        if info[COUNT] + 2 > room:
            return FULL
        state = int(buckets[bucket])
        _unlink(states, state, bucket)
        if costs[state, 1] >= info[BEST]:
            continue
        info[EXPANDED] += 1
        here = unpack(keys[state], tables.fields, counts)
        for there in neighbours(tables, counts, here):
            if there < 0:
                continue
            done = 0
            for k in range(chains):
                after[k] = counts[k]
            serve(tables, after, there)
            for k in range(chains):
                done += after[k]
            pack(after, there, tables.fields, key)
            way = costs[state, 0] + abs(at[there] - at[here])
            slot = _slot(key, keys, states.table)
            other = int(states.table[slot])
            if other >= 0:
                rest = costs[other, 1] - costs[other, 0]
                if way >= costs[other, 0]:
                    continue
                if links[other, 1] != CLOSED:
                    _unlink(states, other, (costs[other, 1] - lowest) // width)
            else:
                rest = least_rest(tables, shares, after, there, scratch)
            if way + rest >= info[BEST]:
                continue
            if other < 0:
                other = info[COUNT]
                info[COUNT] += 1
                states.table[slot] = other
                for word in range(key.size):
                    keys[other, word] = key[word]
            costs[other, 0], costs[other, 1] = way, way + rest
            states.parents[other] = state
            if done == total:
                info[BEST], info[GOAL] = way + rest, other
                links[other, 1] = CLOSED
            else:
                bucket = (way + rest - lowest) // width
                _link(states, other, bucket)
                info[LOWEST] = min(info[LOWEST], bucket)
    return PAUSED


@kernel(interpretable=True)
def search_anew(
    tables: Tables, shares: Shares, states: States, best: int, steps: int, flag: NDArray[np.int8]
) -> int:
    """Initialise the search and continue as :func:`search_on`; `best` is the length of a known tour."""
    table, buckets, costs, info = states.table, states.buckets, states.costs, states.info
    for slot in range(table.size):
        table[slot] = -1
    for bucket in range(buckets.size):
        buckets[bucket] = -1
    counts = np.zeros(tables.first.size - 1, np.int64)
    scratch = np.empty(tables.wide.size, np.int16)
    here = tables.place[tables.place.size - 1]
    serve(tables, counts, here)
    pack(counts, here, tables.fields, states.keys[0])
    table[_slot(states.keys[0], states.keys, table)] = 0
    costs[0, 0] = 0
    costs[0, 1] = least_rest(tables, shares, counts, here, scratch)
    states.parents[0] = -1
    _link(states, 0, (costs[0, 1] - states.lowest) // states.width)
    info[COUNT], info[LOWEST], info[BEST], info[GOAL], info[EXPANDED] = 1, 0, best, -1, 0
    return search_on(tables, shares, states, steps, flag)
