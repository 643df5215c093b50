"""Labels with a vector of levels, and the best-first search that extends them.

A label is a partial route: where it ends, its length, the levels of all resources on leaving, the
label it extends, and which of the *critical* points it has visited. One label dominates another of
the same point where it is no longer, has no more of any resource, and has visited no critical point
that the other has not visited and could still use: whatever the other can do from there, it can do as
well. A point can still be used where the shortest way to the end through it stays below the ceiling.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from .network import Network
from .outcomes import FOUND, FULL, NOTHING, STOPPED

__all__ = ["best_first"]

#: Numbers that the labels of a search may hold.
_MOST_NUMBERS = 6 * MOST_LABELS
#: By how much rounding may shorten a sum of lengths, relative.
_ROUNDING = 1e-12


class Labels(NamedTuple):
    """Columns of labels; only the first ones are in use.

    Attributes
    ----------
    point, parent, following : ndarray of int64
        Where the label ends, the label it extends (-1 for none), and the next one in the list of its
        point (-1 at the end).
    length : ndarray
        Length so far.
    level : ndarray, shape (room, r)
        Of each resource, on leaving.
    visited : ndarray of uint64, shape (room, words)
        Critical points visited, by bit.
    """

    point: NDArray[np.int64]
    parent: NDArray[np.int64]
    following: NDArray[np.int64]
    length: NDArray[np.float64]
    level: NDArray[np.float64]
    visited: NDArray[np.uint64]


@kernel
def make(room: int, resources: int, words: int) -> Labels:
    """Return empty columns."""
    return Labels(
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.full(room, -1),
        np.empty(room),
        np.empty((room, resources)),
        np.zeros((room, words), np.uint64),
    )


@kernel
def grown(labels: Labels, used: int, room: int) -> Labels:
    """Return columns with more room and the same first `used` labels."""
    wider = make(room, labels.level.shape[1], labels.visited.shape[1])
    for k in range(used):
        wider.point[k] = labels.point[k]
        wider.parent[k] = labels.parent[k]
        wider.following[k] = labels.following[k]
        wider.length[k] = labels.length[k]
        for column in range(labels.level.shape[1]):
            wider.level[k, column] = labels.level[k, column]
        for word in range(labels.visited.shape[1]):
            wider.visited[k, word] = labels.visited[k, word]
    return wider


@kernel
def beats(labels: Labels, one: int, other: int, via: NDArray[np.float64], ceiling: float) -> bool:
    """Whether label `one` dominates label `other` of the same point."""
    if labels.length[one] > labels.length[other]:
        return False
    for k in range(labels.level.shape[1]):
        if labels.level[one, k] > labels.level[other, k]:
            return False
    for word in range(labels.visited.shape[1]):
        more = labels.visited[one, word] & ~labels.visited[other, word]
        bit = 64 * word
        while more != np.uint64(0):
            if more & np.uint64(1) != np.uint64(0):
                whole = labels.length[other] + via[labels.point[one], bit]
                if whole <= ceiling and whole < np.inf:
                    return False
            more = more >> np.uint64(1)
            bit += 1
    return True


@kernel
def dominated(
    labels: Labels,
    heads: NDArray[np.int64],
    at: int,
    via: NDArray[np.float64],
    ceiling: float,
) -> bool:
    """Whether a label in the list of its point dominates label `at`; that one then heads the list."""
    point = labels.point[at]
    before, other = -1, heads[point]
    while other >= 0:
        if beats(labels, other, at, via, ceiling):
            if before >= 0:
                labels.following[before] = labels.following[other]
                labels.following[other] = heads[point]
                heads[point] = other
            return True
        before, other = other, labels.following[other]
    return False


@kernel
def extend(
    net: Network, labels: Labels, at: int, label: int, arc: int, bits: NDArray[np.int64]
) -> bool:
    """Write label `at`, which takes `arc` from `label`; whether all limits and visits allow it."""
    there = net.head[arc]
    for k in range(labels.level.shape[1]):
        level = labels.level[label, k] + net.use[arc, k]
        if level > net.limit[there, k]:
            return False
        level = min(level, net.reset[there, k])
        if level > net.most[there, k]:
            return False
        labels.level[at, k] = level
    for word in range(labels.visited.shape[1]):
        labels.visited[at, word] = labels.visited[label, word]
    bit = bits[there]
    if bit >= 0:
        mask = np.uint64(1) << np.uint64(bit & 63)
        if labels.visited[label, bit >> 6] & mask != np.uint64(0):
            return False
        labels.visited[at, bit >> 6] |= mask
    labels.point[at] = there
    labels.parent[at] = label
    labels.following[at] = -1
    labels.length[at] = labels.length[label] + net.length[arc]
    return True


@kernel
def route_of(labels: Labels, label: int) -> NDArray[np.int64]:
    """Return the points on the way to `label`, from the start."""
    count, at = 0, label
    while at >= 0:
        count += 1
        at = labels.parent[at]
    route = np.empty(count, np.int64)
    at = label
    while at >= 0:
        count -= 1
        route[count] = labels.point[at]
        at = labels.parent[at]
    return route


@kernel(interpretable=True)
def best_first(
    net: Network,
    ahead: NDArray[np.float64],
    via: NDArray[np.float64],
    bits: NDArray[np.int64],
    ceiling: float,
    flag: NDArray[np.int8],
) -> tuple[int, NDArray[np.int64], float, float, int, int, int]:
    """Return the shortest route no longer than `ceiling` that visits no critical point twice.

    Parameters
    ----------
    net : Network
        Arcs, limits and resets.
    ahead : ndarray, shape (n,)
        The least length from each point to the end; inf where it cannot be reached.
    via : ndarray, shape (n, critical)
        The least length from each point to the end through each critical point.
    bits : ndarray of int64, shape (n,)
        Number of a point among the critical ones, -1 for the others.
    ceiling : float
        Length above which nothing is wanted.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the search.

    Returns
    -------
    status : int
        ``FOUND``, ``NOTHING``, ``STOPPED`` or ``FULL``.
    route : ndarray
        Points from start to end, empty without one.
    length, bound : float
        Its length (inf without one), and a lower bound on every route's.
    made, settled, pruned : int
        Labels made, labels extended, and labels that only the ceiling refused.
    """
    count, resources = len(ahead), len(net.initial)
    words = (via.shape[1] + 63) // 64
    most = _MOST_NUMBERS // (6 + resources + words)
    heads = np.full(count, -1)
    room = 2 * count + 1024
    labels = make(room, resources, words)
    labels.point[0], labels.parent[0], labels.length[0] = net.start, -1, 0.0
    for k in range(resources):
        labels.level[0, k] = net.initial[k]
    # Lengths are added up in another order than the bounds.
    high = ceiling * (1.0 + _ROUNDING)
    used, settled, pruned = 1, 0, 0
    nothing = np.empty(0, np.int64)
    heap = [(ahead[net.start], 0)]
    if ahead[net.start] > high or ahead[net.start] == np.inf:
        heap.clear()
        pruned = int(ahead[net.start] < np.inf)
    while len(heap) > 0:
        key, label = heappop(heap)
        here = labels.point[label]
        if here == net.end:
            length = labels.length[label]
            return FOUND, route_of(labels, label), length, length, used, settled, pruned
        if dominated(labels, heads, label, via, high):
            continue
        if flag[0] != 0:
            return STOPPED, nothing, np.inf, key, used, settled, pruned
        if used > most:
            return FULL, nothing, np.inf, key, used, settled, pruned
        labels.following[label] = heads[here]
        heads[here] = label
        settled += 1
        begin, stop = net.first[here], net.first[here + 1]
        if used + stop - begin >= room:
            room = 2 * (used + stop - begin)
            labels = grown(labels, used, room)
        for arc in range(begin, stop):
            there = net.head[arc]
            if ahead[there] == np.inf or not extend(net, labels, used, label, arc, bits):
                continue
            key = labels.length[used] + ahead[there]
            if key > high:
                pruned += 1
            elif not dominated(labels, heads, used, via, high):
                heappush(heap, (key, used))
                used += 1
    return NOTHING, nothing, np.inf, ceiling, used, settled, pruned
