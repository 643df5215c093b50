"""Shortest walks from every point to B that leave the point without an error.

The search of :mod:`.ceiling_kernels` in reverse: a label holds the length of the rest of a walk and the
largest surviving error on leaving the point. Labels of a point are settled in the order of their
lengths, and a label is kept only if it allows more error than the previous ones. The first one is the
shortest walk.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from ..resource_routing.front_kernels import widened
from ..resource_routing.outcomes import FOUND, FULL, STOPPED
from .airspace import END, HORIZONTAL, START, VERTICAL, Airspace
from .grid import Grid, near
from .steps import REFUSED, distance, distances_to

__all__ = ["lengths_of_walks"]

#: Slack of errors relative to a threshold, as backward sums round differently from forward sums.
ROUNDING = 1e-12


@kernel
def most_before(space: Airspace, tail: int, head: int, most: float, length: float) -> float:
    """Return the largest error on leaving `tail` such that `head` is left with at most `most`.

    `tail` and `head` are kinds. The result is :data:`.REFUSED` if no error is small enough.
    """
    spare = np.inf
    for axis in range(2):
        limit = space.limits[head, axis]
        if head == (HORIZONTAL if axis == 0 else VERTICAL):
            limit = min(limit, most)
        left = limit - space.rates[axis] * length + ROUNDING * space.limits[head, axis]
        if left < 0.0:
            return REFUSED
        if tail == (HORIZONTAL if axis == 0 else VERTICAL):
            spare = left
    return spare


@kernel
def radius_before(space: Airspace, head: int, most: float) -> float:
    """Return the longest arc into a point of kind `head` that is left with at most `most`, m."""
    radius = np.inf
    for axis in range(2):
        limit = space.limits[head, axis]
        if head == (HORIZONTAL if axis == 0 else VERTICAL):
            limit = min(limit, most)
        limit += ROUNDING * space.limits[head, axis]
        if space.rates[axis] > 0.0:
            radius = min(radius, limit / space.rates[axis])
    return radius


@kernel(interpretable=True)
def lengths_of_walks(
    space: Airspace, grid: Grid, ceiling: float, flag: NDArray[np.int8]
) -> tuple[int, NDArray[np.float64], int]:
    """Return the lengths of the shortest walks to B that are part of a walk from A no longer than `ceiling`.

    The status is ``FOUND`` if the search was completed, whether or not it reached A, ``STOPPED`` or
    ``FULL``. The lengths, shape (slots,), are in metres, inf without a walk. The last value is the number of
    labels made.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    behind = distances_to(grid, start)
    widest = np.full(count, -1.0)
    least = np.full(count, np.inf)
    # Waiting label of largest allowed error at each slot.
    waiting, waiting_length = np.full(count, -1.0), np.empty(count)
    result = np.empty(count, np.int64)
    away = np.empty(count)
    room = 2 * count + 1024
    slots, parents = np.empty(room, np.int64), np.empty(room, np.int64)
    lengths, allowed = np.empty(room), np.empty(room)
    slots[0], parents[0], lengths[0], allowed[0] = end, -1, 0.0, np.inf
    labels = 1
    heap = [(behind[end], 0)]
    status = FOUND
    while len(heap) > 0:
        _, label = heappop(heap)
        here = slots[label]
        most, before = allowed[label], widest[here]
        if most <= before:
            continue
        if flag[0] != 0 or labels > MOST_LABELS:
            status = STOPPED if flag[0] != 0 else FULL
            break
        widest[here] = most
        least[here] = min(least[here], lengths[label])
        if here == start:
            continue
        if labels + count >= room:
            more = 2 * (labels + count)
            slots, parents = widened(slots, more), widened(parents, more)
            lengths, allowed = widened(lengths, more), widened(allowed, more)
            room = more
        head, length = grid.kinds[here], lengths[label]
        radius = radius_before(space, head, most)
        # A may be a tail, too, but is in no cell of the grid.
        for tail in (START, HORIZONTAL, VERTICAL):
            done = -1.0
            if head == END:
                pass
            elif tail == head:
                # As in the forward search, skip two arcs between points of one kind.
                onto = parents[label]
                reach = radius_before(space, grid.kinds[slots[onto]], allowed[onto])
                done = reach - (length - lengths[onto])
            elif before >= 0.0:
                done = radius_before(space, head, before)
            if radius <= done:
                continue
            if tail == START:
                k = 1
                result[0], away[0] = start, distance(grid, here, start)
            else:
                k = near(grid, here, tail, radius, result, away)
            for m in range(k):
                there, d = result[m], away[m]
                if d <= done * (1.0 - 1e-12):
                    continue
                total = length + d
                if total + behind[there] > ceiling:
                    continue
                spare = most_before(space, tail, head, most, d)
                if spare == REFUSED or spare <= widest[there]:
                    continue
                if spare > waiting[there]:
                    waiting[there], waiting_length[there] = spare, total
                elif total >= waiting_length[there]:
                    continue
                slots[labels], parents[labels] = there, label
                lengths[labels], allowed[labels] = total, spare
                heappush(heap, (total + behind[there], labels))
                labels += 1
    return status, least, labels
