"""Kernels of A* over the states of a tour along a path, with a hash table and buckets.

States are numbered in the order of their discovery. An open state is in the doubly linked list of
its bucket.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .state_kernels import hashed, least_rest, neighbours, pack, serve, unpack

__all__ = [
    "BEST", "COUNT", "DONE", "EXPANDED", "FULL", "GOAL", "LOWEST", "PAUSED", "rehash", "search_anew",
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
def _link(state: int, bucket: int, buckets: Links, links: Links) -> None:
    head = buckets[bucket]
    links[state, 0] = -1
    links[state, 1] = head
    if head >= 0:
        links[head, 0] = state
    buckets[bucket] = state


@kernel
def _unlink(state: int, bucket: int, buckets: Links, links: Links) -> None:
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
    first: Ints, place: Ints, at: Ints, length: Ints, crossings: NDArray[np.int16], needs: Ints,
    needed: Ints, fields: Ints, groups: Ints, members: Ints, weighted: Ints, rests: Links,
    times: int, over: int, keys: Ints, costs: Ints, parents: Links, links: Links,
    table: Links, buckets: Links, lowest: int, width: int, info: Ints, steps: int,
    flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Expand up to `steps` states; return `DONE`, `FULL` or `PAUSED`.

    A state is expanded again if a shorter path to it is found. States whose bound reaches the best
    length are discarded, so the search is exhausted when no bucket below that length remains.

    Parameters
    ----------
    first, place, at, length, crossings, needs, needed, fields
        As in :class:`~.bound.Tables`.
    groups, members, weighted, rests, times, over
        As in :class:`~.shares.Shares`.
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
        Entries as in :data:`COUNT`; updated.
    steps : int
        Maximum number of expansions.
    flag : ndarray of int8
        Stop flag, nonzero to pause.
    """
    chains, room = first.size - 1, len(keys)
    counts, after = np.empty(chains, np.int64), np.empty(chains, np.int64)
    key, scratch = np.empty(keys.shape[1], np.int64), np.empty(length.size, np.int16)
    total = first[chains]
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
        _unlink(state, bucket, buckets, links)
        if costs[state, 1] >= info[BEST]:
            continue
        info[EXPANDED] += 1
        here = unpack(keys[state], fields, counts)
        for there in neighbours(counts, here, first, place, needs, needed):
            if there < 0:
                continue
            done = 0
            for k in range(chains):
                after[k] = counts[k]
            serve(after, there, first, place, needs, needed)
            for k in range(chains):
                done += after[k]
            pack(after, there, fields, key)
            way = costs[state, 0] + abs(at[there] - at[here])
            slot = _slot(key, keys, table)
            other = int(table[slot])
            if other >= 0:
                rest = costs[other, 1] - costs[other, 0]
                if way >= costs[other, 0]:
                    continue
                if links[other, 1] != CLOSED:
                    _unlink(other, (costs[other, 1] - lowest) // width, buckets, links)
            else:
                rest = least_rest(
                    after, there, first, place, at, length, crossings, groups, members,
                    weighted, rests, times, over, scratch,
                )  # fmt: skip
            if way + rest >= info[BEST]:
                continue
            if other < 0:
                other = info[COUNT]
                info[COUNT] += 1
                table[slot] = other
                for word in range(key.size):
                    keys[other, word] = key[word]
            costs[other, 0], costs[other, 1] = way, way + rest
            parents[other] = state
            if done == total:
                info[BEST], info[GOAL] = way + rest, other
                links[other, 1] = CLOSED
            else:
                bucket = (way + rest - lowest) // width
                _link(other, bucket, buckets, links)
                info[LOWEST] = min(info[LOWEST], bucket)
    return PAUSED


@kernel(interpretable=True)
def search_anew(
    first: Ints, place: Ints, at: Ints, length: Ints, crossings: NDArray[np.int16], needs: Ints,
    needed: Ints, fields: Ints, groups: Ints, members: Ints, weighted: Ints, rests: Links,
    times: int, over: int, keys: Ints, costs: Ints, parents: Links, links: Links,
    table: Links, buckets: Links, lowest: int, width: int, info: Ints, best: int, steps: int,
    flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Initialise the search and continue as :func:`search_on`; `best` is the length of a known tour."""
    for slot in range(table.size):
        table[slot] = -1
    for bucket in range(buckets.size):
        buckets[bucket] = -1
    counts = np.zeros(first.size - 1, np.int64)
    scratch = np.empty(length.size, np.int16)
    here = place[place.size - 1]
    serve(counts, here, first, place, needs, needed)
    pack(counts, here, fields, keys[0])
    table[_slot(keys[0], keys, table)] = 0
    costs[0, 0] = 0
    costs[0, 1] = least_rest(
        counts, here, first, place, at, length, crossings, groups, members,
        weighted, rests, times, over, scratch,
    )  # fmt: skip
    parents[0] = -1
    _link(0, (costs[0, 1] - lowest) // width, buckets, links)
    info[COUNT], info[LOWEST], info[BEST], info[GOAL], info[EXPANDED] = 1, 0, best, -1, 0
    return search_on(
        first, place, at, length, crossings, needs, needed, fields, groups, members, weighted, rests, times, over, keys, costs, parents, links,
        table, buckets, lowest, width, info, steps, flag,
    )  # fmt: skip
