"""Steps of a search: errors along an arc, reach of a label, remaining lengths and reachable points.

Column 0 of an airspace's limits and rates is the vertical error, column 1 the horizontal one. At a
horizontal point the vertical error survives, at a vertical point the horizontal one.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .airspace import END, HORIZONTAL, START, VERTICAL, Airspace
from .grid import Grid, near, near_beyond, reach

__all__ = [
    "REFUSED", "arrive", "distance", "distances_to", "least_errors", "radius_of", "remaining",
]  # fmt: skip

#: Result of :func:`arrive` for an arc that violates a threshold of its head.
REFUSED = -1.0


@kernel
def arrive(space: Airspace, tail: int, head: int, error: float, length: float) -> float:
    """Return the surviving error after an arc of `length` (m) between points of two kinds.

    `tail` and `head` are kinds, and `error` is the surviving error at the tail. The result is
    :data:`REFUSED` if an error on arrival exceeds a threshold of the head, and 0 at B.
    """
    vertical: float = space.rates[0] * length
    horizontal: float = space.rates[1] * length
    if tail == HORIZONTAL:
        vertical += error
    elif tail == VERTICAL:
        horizontal += error
    if vertical > space.limits[head, 0] or horizontal > space.limits[head, 1]:
        return REFUSED
    if head == HORIZONTAL:
        return vertical
    if head == VERTICAL:
        return horizontal
    return 0.0


@kernel
def radius_of(space: Airspace, kind: int, head: int, error: float) -> float:
    """Return the length of the longest arc of a label with `error` to a point of kind `head`, m."""
    radius = np.inf
    for axis in range(2):
        carried = 0.0
        if (axis == 0 and kind == HORIZONTAL) or (axis == 1 and kind == VERTICAL):
            carried = error
        spare = space.limits[head, axis] - carried
        if spare < 0.0:
            return -1.0
        if space.rates[axis] > 0.0:
            radius = min(radius, spare / space.rates[axis])
    return radius


@kernel(interpretable=True)
def distances_to(grid: Grid, slot: int) -> NDArray[np.float64]:
    """Return the straight-line distance of every slot from `slot`, m, shape (slots,)."""
    distances = np.empty(len(grid.x))
    for s in range(len(grid.x)):
        distances[s] = distance(grid, s, slot)
    return distances


@kernel
def distance(grid: Grid, one: int, other: int) -> float:
    """Return the straight-line distance of two slots, m."""
    dx, dy, dz = (
        grid.x[one] - grid.x[other],
        grid.y[one] - grid.y[other],
        grid.z[one] - grid.z[other],
    )
    return float(np.sqrt(dx * dx + dy * dy + dz * dz))


@kernel(interpretable=True)
def remaining(
    space: Airspace, grid: Grid, forward: bool, arcs: int, flag: NDArray[np.int8]
) -> NDArray[np.float64]:
    """Return the shortest-path length from every slot to B over arcs within the thresholds, m.

    With `forward`, from A to every slot. The length ignores carried errors and visits, so it is a lower
    bound for routes with or without revisits; inf without a path. Along an arc the bound decreases by
    at most the arc's length.

    Dijkstra's search ends after scanning `arcs` arcs or a stop by `flag`. The bound of the remaining
    slots is then the maximum of the last settled length and the straight line.
    """
    count = len(grid.x)
    first, last = count - 2, count - 1
    via = np.full(count, -1)
    root, edge = (first, last) if forward else (last, first)
    best = np.full(count, np.inf)
    best[root] = 0.0
    straight = distances_to(grid, root)
    result = np.empty(count, np.int64)
    away = np.empty(count)
    reaches = np.array([0.0, reach(space, HORIZONTAL), reach(space, VERTICAL), reach(space, END)])
    heap = [(0.0, root)]
    left = arcs
    while len(heap) > 0:
        nearest, here = heappop(heap)
        if nearest > best[here]:
            continue
        if left < 0 or flag[0] != 0:
            for s in range(count):
                best[s] = min(best[s], max(nearest, straight[s]))
            return best
        kind = grid.kinds[here]
        if kind == (END if forward else START):
            continue
        for other in (HORIZONTAL, VERTICAL):
            # The head's thresholds limit the length of an arc.
            radius = reaches[other] if forward else reaches[kind]
            # The former point of the path reaches the points within its own radius by a shorter arc.
            former, inner = via[here], -1.0
            if former >= 0:
                inner = radius if forward else reaches[grid.kinds[former]]
            k = near_beyond(grid, here, other, radius, former, inner, result, away)
            left -= k + 1
            for m in range(k):
                there, total = result[m], nearest + away[m]
                if total < best[there]:
                    best[there] = total
                    via[there] = here
                    heappush(heap, (total, there))
        total = nearest + distance(grid, here, edge)
        if total < best[edge] and total - nearest <= reaches[END if forward else kind]:
            best[edge] = total
            heappush(heap, (total, edge))
    return best


@kernel(interpretable=True)
def least_errors(
    space: Airspace, grid: Grid, until: bool, flag: NDArray[np.int8]
) -> NDArray[np.float64]:
    """Return the least error on leaving each slot by walks from A, shape (slots,); inf if unreachable.

    Revisits are allowed. The walk of least error can be extended wherever any other can, so the least
    errors determine which points are reachable. A later walk may have a smaller error, so a point is
    extended again after its error decreases. With `until` the search ends as soon as B is reached.
    After an early end, by `until` or `flag`, points not reached yet have inf, too.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    least = np.full(count, np.inf)
    result = np.empty(count, np.int64)
    away = np.empty(count)
    to_end = distances_to(grid, end)
    least[start] = 0.0
    heap = [(0.0, start)]
    while len(heap) > 0 and flag[0] == 0:
        error, here = heappop(heap)
        if error > least[here]:
            continue
        kind = grid.kinds[here]
        if arrive(space, kind, END, error, to_end[here]) != REFUSED:
            least[end] = 0.0
            if until:
                break
        for head in (HORIZONTAL, VERTICAL):
            k = near(grid, here, head, radius_of(space, kind, head, error), result, away)
            for m in range(k):
                there = result[m]
                left = arrive(space, kind, head, error, away[m])
                if left != REFUSED and left < least[there]:
                    least[there] = left
                    heappush(heap, (left, there))
    return least
