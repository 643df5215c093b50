"""Shortest walks from every point to B as a function of the error on leaving the point.

The search of :mod:`.ceiling_kernels` in reverse: a label holds the length of the rest of a walk and the
largest surviving error on leaving the point. Labels of a point are settled in the order of their
lengths, and a label is kept only if it allows more error than the previous ones. The result is the exact
length of the best walk that completes a partial route, the tightest bound of the relaxation.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from ..resource_routing.front_kernels import widened
from ..resource_routing.outcomes import FOUND, FULL, STOPPED
from .airspace import END, HORIZONTAL, START, VERTICAL, Airspace
from .grid import Grid, near
from .labels import Labels, close, visited
from .steps import REFUSED, distance, distances_to

__all__ = ["Ways", "forget", "least", "plain_ways", "rest", "ways_on"]

#: Slack of errors relative to a threshold, as backward sums round differently from forward sums.
ROUNDING = 1e-12


class Ways(NamedTuple):
    """Walks from slots to B, sorted by length and allowed error.

    `first` is the shortest walk of each slot, and `following` the next walk of the same slot, longer and
    with more allowed error; -1 for none. A walk has its length, m, and the largest `allowed` error on
    leaving the slot.
    """

    first: NDArray[np.int64]
    following: NDArray[np.int64]
    length: NDArray[np.float64]
    allowed: NDArray[np.float64]


@kernel(interpretable=True)
def plain_ways(ahead: NDArray[np.float64]) -> Ways:
    """Return lower bounds on the length to B, shape (slots,), as walks that allow any error."""
    count = len(ahead)
    return Ways(np.arange(count), np.full(count, -1), ahead, np.full(count, np.inf))


@kernel
def least(ways: Ways, slot: int) -> float:
    """Return the length of the shortest walk from `slot` to B without an error, m; inf for none."""
    way = ways.first[slot]
    return float(ways.length[way]) if way >= 0 else np.inf


@kernel
def rest(ways: Ways, slot: int, error: float) -> float:
    """Return the length of the shortest walk from `slot` to B for a given `error`, m; inf for none."""
    way = ways.first[slot]
    while way >= 0:
        if ways.allowed[way] >= error:
            return float(ways.length[way])
        way = ways.following[way]
    return np.inf


@kernel
def forget(
    labels: Labels,
    at: int,
    grid: Grid,
    ways: Ways,
    bits: NDArray[np.int64],
    marked: NDArray[np.int64],
    ceiling: float,
) -> None:
    """Close the critical slots in `marked` that label `at` cannot use below `ceiling`.

    The test bounds a route through the slot by the straight line to it and the shortest walk from it to
    B. Closed slots make dominance stronger, see :mod:`.labels`.
    """
    here, length = labels.slot[at], labels.length[at]
    for slot in marked:
        if not visited(labels, at, bits[slot]):
            through = length + distance(grid, here, slot) + least(ways, slot)
            if through > ceiling * (1.0 + ROUNDING) or through == np.inf:
                close(labels, at, bits[slot])


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
def ways_on(
    space: Airspace, grid: Grid, ceiling: float, flag: NDArray[np.int8]
) -> tuple[int, Ways, int, int]:
    """Return the shortest walks to B that are part of a walk from A no longer than `ceiling`.

    The status is ``FOUND`` if the search was completed, whether or not it reached A, ``STOPPED`` or
    ``FULL``. The last values are the numbers of labels made and of labels pruned by the ceiling.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    behind = distances_to(grid, start)
    widest = np.full(count, -1.0)
    first, last = np.full(count, -1), np.full(count, -1)
    # Waiting label of largest allowed error at each slot.
    waiting, waiting_length = np.full(count, -1.0), np.empty(count)
    result = np.empty(count, np.int64)
    away = np.empty(count)
    room = 2 * count + 1024
    slots, parents = np.empty(room, np.int64), np.empty(room, np.int64)
    following = np.full(room, -1)
    lengths, allowed = np.empty(room), np.empty(room)
    slots[0], parents[0], lengths[0], allowed[0] = end, -1, 0.0, np.inf
    labels, pruned = 1, 0
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
        if last[here] < 0:
            first[here] = label
        else:
            following[last[here]] = label
        last[here] = label
        if here == start:
            continue
        if labels + count >= room:
            more = 2 * (labels + count)
            slots, parents = widened(slots, more), widened(parents, more)
            lengths, allowed = widened(lengths, more), widened(allowed, more)
            following = widened(following, more)
            following[room:] = -1
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
                    pruned += 1
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
    return status, Ways(first, following, lengths, allowed), labels, pruned
