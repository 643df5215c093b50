"""Exact best-first label search with critical points.

A label is extended to every point within its reach, found by a spatial grid; labels above a ceiling are
dropped.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from ..resource_routing.front_kernels import trace
from ..resource_routing.outcomes import FOUND, FULL, NOTHING, STOPPED
from .airspace import END, HORIZONTAL, VERTICAL, Airspace
from .grid import Grid, near
from .labels import add, dominated, grown, link, make, visited
from .steps import REFUSED, arrive, distances_to, radius_of
from .way_kernels import Ways, forget, least, rest

__all__ = ["best_first"]


Result = tuple[int, NDArray[np.int64], float, float, int, int]


@kernel(interpretable=True)
def best_first(
    space: Airspace,
    grid: Grid,
    ways: Ways,
    bits: NDArray[np.int64],
    words: int,
    ceiling: float,
    flag: NDArray[np.int8],
) -> Result:
    """Return the shortest route no longer than `ceiling` (m) that visits no critical point twice.

    `ways` are lower bounds on the length from each slot to B as a function of the carried error, for
    routes below the ceiling. `bits` is the number of a slot among the critical points, -1 for the
    others, and `words` the number of 64-bit words for them. The result is the status, ``FOUND``,
    ``NOTHING``, ``STOPPED`` by `flag` or ``FULL``; points from A to B and length (m), empty and inf
    without a route; a lower bound on every route's length; and the numbers of labels made and extended.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    heads = np.full(count, -1)
    result = np.empty(count, np.int64)
    away = np.empty(count)
    to_end = distances_to(grid, end)
    room = 2 * count + 1024
    labels = make(room, words)
    add(labels, 0, start, -1, 0.0, 0.0, -1)
    used, settled = 1, 0
    nothing = np.empty(0, np.int64)
    marked = np.flatnonzero(bits >= 0)
    heap = [(least(ways, start), 0)]
    if least(ways, start) > ceiling:
        heap.clear()
    while len(heap) > 0:
        key, label = heappop(heap)
        here = labels.slot[label]
        if here == end:
            route = grid.ids[trace(labels.slot, labels.parent, label)]
            return FOUND, route, labels.length[label], labels.length[label], used, settled
        if dominated(labels, heads[here], label):
            continue
        if flag[0] != 0:
            return STOPPED, nothing, np.inf, key, used, settled
        link(labels, heads, label)
        settled += 1
        if used > MOST_LABELS:
            return FULL, nothing, np.inf, key, used, settled
        if used + count >= room:
            room = 2 * (used + count)
            labels = grown(labels, room)
        kind, error, length = grid.kinds[here], labels.error[label], labels.length[label]
        if length + to_end[here] <= ceiling:
            if arrive(space, kind, END, error, to_end[here]) != REFUSED:
                add(labels, used, end, label, length + to_end[here], 0.0, -1)
                heappush(heap, (labels.length[used], used))
                used += 1
        for head in (HORIZONTAL, VERTICAL):
            k = near(grid, here, head, radius_of(space, kind, head, error), result, away)
            for m in range(k):
                there = result[m]
                total = length + away[m]
                if total + least(ways, there) > ceiling or visited(labels, label, bits[there]):
                    continue
                left = arrive(space, kind, head, error, away[m])
                if left == REFUSED:
                    continue
                key = total + rest(ways, there, left)
                if not key <= ceiling or key == np.inf:
                    continue
                add(labels, used, there, label, total, left, bits[there])
                forget(labels, used, grid, ways, bits, marked, ceiling)
                if dominated(labels, heads[there], used):
                    continue
                heappush(heap, (key, used))
                used += 1
    return NOTHING, nothing, np.inf, ceiling, used, settled
