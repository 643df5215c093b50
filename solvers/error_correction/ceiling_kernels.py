"""Search of ``label-setting`` with revisits: A* under a rising ceiling.

Labels leave the heap in the order of ``length + distance to B``. The bound depends on the point
only and satisfies the triangle inequality, so the labels of a point leave in the order of their
lengths. A label is dominated exactly if its surviving error is not below the smallest settled error of
its point. After an arc between points of different kinds, the surviving error is the gain on that arc.
The first label that can take such an arc is therefore the best one, and later labels of the tail only
take arcs that no earlier label could take.

Labels above the ceiling are not stored, and points that are on longer walks only are not in the grid.
If B is not reached under the ceiling, the ceiling is raised and the search starts again.

The straight line is a free bound, sufficient for nearly straight routes. If the number of labels
becomes large, shortest paths to B over the arcs that the thresholds allow replace it. They satisfy the
triangle inequality along arcs, too, and identify the points from which B is unreachable. Their work is
limited to a multiple of the work for labels.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from ..resource_routing.front_kernels import trace, widened
from ..resource_routing.outcomes import DEAR, FOUND, FULL, NOTHING, STOPPED
from .airspace import END, HORIZONTAL, START, VERTICAL, Airspace
from .grid import Grid, build, near
from .steps import REFUSED, arrive, distances_to, least_errors, radius_of, remaining

__all__ = ["climb"]


#: First ceiling above the bound, relative to it, and the growth factor of that share.
FIRST, RISE = 0.004, 2.2
#: Labels per point before a better bound is computed, and the growth factor before it is recomputed.
PATIENCE, LONGER = 4, 8
#: Maximum number of arcs scanned for the bound per arc scanned by labels.
WORTH = 64


@kernel(interpretable=True)
def climb(
    space: Airspace, cutoff: float, flag: NDArray[np.int8]
) -> tuple[int, NDArray[np.int64], float, float, int, int]:
    """Return the shortest walk from A to B that is no longer than `cutoff` (m).

    The result is the status, ``FOUND``, ``NOTHING`` (no walk up to the cutoff exists), ``STOPPED`` by
    `flag` or ``FULL``; the points from A to B, empty without a walk; its length (m, inf without one) and
    a lower bound on every walk's; and the numbers of labels made and of labels that left the heap, over
    all ceilings.
    """
    points = space.points
    n = len(points)
    from_start = lengths_from(points, space.start)
    ahead = lengths_from(points, space.end)
    keep = np.empty(n, np.bool_)
    share = FIRST
    made = settled = scanned = 0
    budget = PATIENCE * n
    dear = 0
    floor = bound = ahead[space.start]
    while True:
        ceiling = floor * (1.0 + share) if floor > 0.0 else np.inf
        if share > 4.0 or ceiling >= cutoff:
            ceiling = cutoff
        left_out = 0
        for i in range(n):
            keep[i] = ahead[i] < np.inf and from_start[i] + ahead[i] <= ceiling
            if ahead[i] < np.inf and not keep[i]:
                left_out += 1
        grid = build(space, keep)
        status, route, length, labels, gone, pruned, arcs = under(
            space, grid, ahead[grid.ids], ceiling, budget - made, flag
        )
        made += labels
        settled += gone
        scanned += arcs
        if status == FOUND:
            return FOUND, route, length, length, made, settled
        if status in (STOPPED, FULL):
            return status, route, np.inf, max(bound, length), made, settled
        if status == DEAR:
            for i in range(n):
                keep[i] = ahead[i] < np.inf
            grid = build(space, keep)
            left = remaining(space, grid, False, WORTH * scanned, flag)
            for i in range(len(left)):
                ahead[grid.ids[i]] = left[i]
            vain = ahead[space.start] == np.inf
            dear += 1
            if dear == 2 and not vain:
                # Before more work, test whether B is reachable with the carried errors.
                vain = least_errors(space, grid, True, flag)[len(grid.x) - 1] == np.inf
            if vain and flag[0] == 0:
                return NOTHING, route, np.inf, np.inf, made, settled
            floor = bound = max(bound, ahead[space.start], length)
            share = FIRST
            budget = LONGER * made
            continue
        if (left_out == 0 and pruned == 0) or ceiling >= cutoff:
            # All walks up to the cutoff were enumerated.
            bound = np.inf if pruned + left_out == 0 else cutoff
            return NOTHING, route, np.inf, bound, made, settled
        bound = ceiling
        share *= RISE


@kernel
def lengths_from(points: NDArray[np.float64], at: int) -> NDArray[np.float64]:
    """Return the straight-line distance of every point from point `at`, m, shape (n,)."""
    lengths = np.empty(len(points))
    for i in range(len(points)):
        dx = points[i, 0] - points[at, 0]
        dy = points[i, 1] - points[at, 1]
        dz = points[i, 2] - points[at, 2]
        lengths[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
    return lengths


@kernel
def under(
    space: Airspace,
    grid: Grid,
    ahead: NDArray[np.float64],
    ceiling: float,
    budget: int,
    flag: NDArray[np.int8],
) -> tuple[int, NDArray[np.int64], float, int, int, int, int]:
    """Return the shortest walk no longer than `ceiling`; see :func:`climb`.

    `ahead` is a lower bound on the length from each slot to B. The status is ``DEAR`` after more
    labels than `budget`. The third value is the length, or the smallest key in the heap after a stop.
    The last values count the labels pruned by the ceiling and the scanned arcs.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    to_end = distances_to(grid, end)
    smallest = np.full(count, np.inf)
    # Waiting label of least error at each slot: it dominates many others before they are stored.
    waiting, waiting_length = np.full(count, np.inf), np.empty(count)
    result = np.empty(count, np.int64)
    away = np.empty(count)
    room = 1024
    slots = np.empty(room, np.int64)
    parents = np.empty(room, np.int64)
    lengths = np.empty(room)
    errors = np.empty(room)
    slots[0], parents[0], lengths[0], errors[0] = start, -1, 0.0, 0.0
    labels, settled, pruned, arcs = 1, 0, 0, 0
    heap = [(ahead[start], 0)]
    nothing = np.empty(0, np.int64)
    while len(heap) > 0:
        key, label = heappop(heap)
        here = slots[label]
        if here == end:
            route = grid.ids[trace(slots, parents, label)]
            return FOUND, route, lengths[label], labels, settled, pruned, arcs
        error = errors[label]
        before = smallest[here]
        if error >= before:
            continue
        if flag[0] != 0:
            return STOPPED, nothing, key, labels, settled, pruned, arcs
        smallest[here] = error
        settled += 1
        length = lengths[label]
        kind = grid.kinds[here]
        if labels > MOST_LABELS:
            return FULL, nothing, key, labels, settled, pruned, arcs
        if labels > budget:
            return DEAR, nothing, key, labels, settled, pruned, arcs
        if labels + count >= room:
            room = 2 * (labels + count)
            slots, parents = widened(slots, room), widened(parents, room)
            lengths, errors = widened(lengths, room), widened(errors, room)
        # Extend to B first: its label enters the heap like the others.
        if arrive(space, kind, END, error, to_end[here]) != REFUSED:
            total = length + to_end[here]
            if total <= ceiling:
                slots[labels], parents[labels] = end, label
                lengths[labels], errors[labels] = total, 0.0
                heappush(heap, (total, labels))
                labels += 1
            else:
                pruned += 1
        for head in (HORIZONTAL, VERTICAL):
            radius = radius_of(space, kind, head, error)
            done = -1.0
            if head == kind:
                # Two arcs between points of one kind are longer than a single arc and add no less
                # error, so only points beyond the reach of the parent label are useful.
                last = parents[label]
                most = radius_of(space, grid.kinds[slots[last]], head, errors[last])
                done = most * (1.0 + 1e-12) - (length - lengths[last])
            elif kind != START and before < np.inf:
                # An earlier label of this point, with more error, covers the points within its reach.
                done = radius_of(space, kind, head, before)
            if radius <= done:
                continue
            k = near(grid, here, head, radius, result, away)
            arcs += k
            for m in range(k):
                there = result[m]
                d = away[m]
                # Within rounding, an arc is taken twice rather than never.
                if d <= done * (1.0 - 1e-12):
                    continue
                total = length + d
                bound = total + ahead[there]
                if bound > ceiling:
                    pruned += 1
                    continue
                left = arrive(space, kind, head, error, d)
                if left == REFUSED or left >= smallest[there]:
                    continue
                if left < waiting[there]:
                    waiting[there], waiting_length[there] = left, total
                elif total >= waiting_length[there]:
                    continue
                slots[labels], parents[labels] = there, label
                lengths[labels], errors[labels] = total, left
                heappush(heap, (bound, labels))
                labels += 1
    return NOTHING, nothing, np.inf, labels, settled, pruned, arcs
