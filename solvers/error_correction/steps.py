"""One step of a search: what may be carried along an arc, and what survives its end.

Column 0 of an airspace's limits and rates is the vertical error, column 1 the horizontal one. At a
horizontal point the vertical error survives, at a vertical point the horizontal one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .airspace import END, HORIZONTAL, START, VERTICAL, Airspace
from .grid import Grid, near, reach

__all__ = ["REFUSED", "arrive", "distances_to", "radius_of", "remaining", "trace", "widened"]

#: What :func:`arrive` returns where the head's thresholds refuse the arc.
REFUSED = -1.0


@kernel
def arrive(space: Airspace, tail: int, head: int, error: float, length: float) -> float:
    """Return the error that survives an arc of `length` between points of two kinds.

    `tail` and `head` are kinds, `error` is what survived the tail. Returns :data:`REFUSED` where
    the errors on arrival exceed a threshold of the head; at B, 0.
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
    """Return the longest arc that a label with `error` may take to a point of kind `head`."""
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
    """Return the straight-line distance of every slot from `slot`."""
    distances = np.empty(len(grid.x))
    for s in range(len(grid.x)):
        dx, dy, dz = grid.x[s] - grid.x[slot], grid.y[s] - grid.y[slot], grid.z[s] - grid.z[slot]
        distances[s] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return distances


@kernel(interpretable=True)
def remaining(
    space: Airspace, grid: Grid, forward: bool, flag: NDArray[np.int8]
) -> NDArray[np.float64]:
    """Return the shortest length from every slot to B over arcs that the thresholds alone allow.

    With `forward`, from A to every slot. It ignores what is carried, so it bounds every route from
    below; inf where no such way exists. Dijkstra with a scan for the nearest open slot. Where `flag`
    stops it, 0 is returned for every slot, which bounds nothing.
    """
    count = len(grid.x)
    first, last = count - 2, count - 1
    best = np.full(count, np.inf)
    best[first if forward else last] = 0.0
    done = np.zeros(count, np.bool_)
    found = np.empty(count, np.int64)
    away = np.empty(count)
    reaches = np.array([0.0, reach(space, HORIZONTAL), reach(space, VERTICAL), reach(space, END)])
    for _ in range(count):
        if flag[0] != 0:
            return np.zeros(count)
        here = -1
        for s in range(count):
            if not done[s] and best[s] < np.inf and (here < 0 or best[s] < best[here]):
                here = s
        if here < 0:
            break
        done[here] = True
        kind = grid.kinds[here]
        if kind == (END if forward else START):
            continue
        for other in (HORIZONTAL, VERTICAL):
            # An arc is as long as its head allows.
            radius = reaches[other] if forward else reaches[kind]
            k = near(grid, here, other, radius, found, away)
            for m in range(k):
                best[found[m]] = min(best[found[m]], best[here] + away[m])
        edge = last if forward else first
        dx, dy, dz = (
            grid.x[here] - grid.x[edge],
            grid.y[here] - grid.y[edge],
            grid.z[here] - grid.z[edge],
        )
        d = np.sqrt(dx * dx + dy * dy + dz * dz)
        if d <= (reaches[END] if forward else reaches[kind]):
            best[edge] = min(best[edge], best[here] + d)
    return best


@kernel
def trace(
    slots: NDArray[np.int64], parents: NDArray[np.int64], ids: NDArray[np.int64], label: int
) -> NDArray[np.int64]:
    """Return the points on the way to `label`, from A."""
    count = 0
    at = label
    while at >= 0:
        count += 1
        at = parents[at]
    route = np.empty(count, np.int64)
    at = label
    while at >= 0:
        count -= 1
        route[count] = ids[slots[at]]
        at = parents[at]
    return route


@kernel
def widened(array: NDArray[Any], room: int) -> NDArray[Any]:
    """Return an array with room for `room` entries, which begins with those of `array`."""
    wider = np.empty(room, array.dtype)
    for k in range(len(array)):
        wider[k] = array[k]
    return wider
