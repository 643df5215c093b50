"""Labels with a vector of levels, and the best-first search that extends them.

A label is a partial route: its last point, length, levels of all resources on leaving, parent label,
and visited *critical* points. A label dominates another of the same point if it is no longer, has no
larger level, and has visited no critical point that is open for the other. Every extension of the
other label is then an extension of the dominating one. A point is open if the label has not visited it
and the shortest path to the end through it is below the ceiling.
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

#: Maximum number of array entries for the labels of a search.
_MOST_NUMBERS = 6 * MOST_LABELS
#: Relative rounding error of a sum of lengths.
_ROUNDING = 1e-12


class Labels(NamedTuple):
    """Columns of labels; only the first ones are in use.

    Attributes
    ----------
    point, parent, following : ndarray of int64
        Last point, parent label (-1 for none), and next label in the list of the point (-1 at the
        end).
    length : ndarray
        Length of the partial route.
    level : ndarray, shape (room, r)
        Level of each resource on leaving.
    visited : ndarray of uint64, shape (room, words)
        Visited critical points, one bit each.
    """

    point: NDArray[np.int64]
    parent: NDArray[np.int64]
    following: NDArray[np.int64]
    length: NDArray[np.float64]
    level: NDArray[np.float64]
    visited: NDArray[np.uint64]


@kernel
def make(room: int, resources: int, words: int) -> Labels:
    """Return columns for `room` labels."""
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
    """Return columns for `room` labels that start with the first `used` labels."""
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
    """Return whether label `one` dominates label `other` of the same point."""
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
    """Return whether a label of its point dominates label `at`; move that label to the list's head."""
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
    """Write label `at` as the extension of `label` by `arc`; return whether it is feasible."""
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
    """Return the points of the partial route of `label`, from the start."""
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
        Shortest-path length from each point to the end; inf if unreachable.
    via : ndarray, shape (n, critical)
        Shortest-path length from each point to the end through each critical point.
    bits : ndarray of int64, shape (n,)
        Index of a point among the critical ones, -1 for the others.
    ceiling : float
        Largest length of interest.
    flag : ndarray of int8, shape (1,)
        Stop flag; a nonzero value stops the search.

    Returns
    -------
    status : int
        ``FOUND``, ``NOTHING``, ``STOPPED`` or ``FULL``.
    route : ndarray
        Points from start to end, empty without one.
    length, bound : float
        Length of the route (inf without one), and a lower bound on the length of all routes.
    made, settled, pruned : int
        Numbers of labels made, of labels extended, and of labels pruned by the ceiling alone.
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
    # Lengths and bounds are summed in different orders, so a margin is needed.
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
