"""The pulse algorithm: depth-first, with three prunings.

A pulse runs from A through feasible points until it is pruned: by infeasibility (a threshold
refuses the arc), by bound (its length and the least that remains reach the best route's length) or
by dominance (a pulse that came by before was no worse). Successors are tried in the order of their
length and what remains after them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from .airspace import END, HORIZONTAL, VERTICAL, Airspace
from .grid import Grid, near
from .labels import add, dominated, grown, link, make, visited
from .outcomes import FOUND, FULL, NOTHING, STOPPED
from .reach_kernels import least_errors
from .steps import REFUSED, arrive, distances_to, radius_of, trace, widened
from .way_kernels import Ways, forget, least, rest

__all__ = ["pulse"]

#: Pulses a point that are sent before it is worth asking whether there is any route.
PATIENCE = 4


@kernel(interpretable=True)
def pulse(
    space: Airspace,
    grid: Grid,
    ways: Ways,
    bits: NDArray[np.int64],
    words: int,
    ceiling: float,
    flag: NDArray[np.int8],
) -> tuple[int, NDArray[np.int64], float, float, int, int]:
    """Return the shortest route; see :func:`.sweep_kernels.best_first` for the values."""
    count = len(grid.x)
    start, end = count - 2, count - 1
    heads = np.full(count, -1)
    found = np.empty(count, np.int64)
    away = np.empty(count)
    to_end = distances_to(grid, end)
    room = 2 * count + 1024
    labels = make(room, words)
    add(labels, 0, start, -1, 0.0, 0.0, -1)
    used, settled = 1, 0
    best = ceiling
    route = np.empty(0, np.int64)
    any_route = False
    marked = np.flatnonzero(bits >= 0)
    # Successors of the labels on the way stand in one stack: those of a depth begin at its mark.
    next_slot = np.empty(room, np.int64)
    next_key = np.empty(room)
    next_total = np.empty(room)
    next_error = np.empty(room)
    marks = np.zeros(count + 8, np.int64)
    ends = np.zeros(count + 8, np.int64)
    way = np.zeros(count + 8, np.int64)
    depth = 0
    entering = True
    asked = False
    while depth >= 0:
        if not asked and not any_route and used > PATIENCE * count:
            # Depth-first search meets every dead end before it knows: settle first whether B can
            # be reached at all, whatever the length.
            asked = True
            if least_errors(space, grid, True, flag)[end] == np.inf and flag[0] == 0:
                return NOTHING, route, np.inf, np.inf, used, settled
        if flag[0] != 0 or used > MOST_LABELS:
            status = STOPPED if flag[0] != 0 else FULL
            bound = min(best, least(ways, start))
            return status, route, best if any_route else np.inf, bound, used, settled
        label = way[depth]
        if entering:
            entering = False
            settled += 1
            here, error, length = labels.slot[label], labels.error[label], labels.length[label]
            kind = grid.kinds[here]
            total = length + to_end[here]
            if total < best or (total <= best and not any_route):
                if arrive(space, kind, END, error, to_end[here]) != REFUSED:
                    best, any_route = total, True
                    inner = trace(labels.slot, labels.parent, grid.ids, label)
                    route = np.append(inner, grid.ids[end])
            begin = marks[depth]
            top = begin
            if begin + count >= len(next_slot):
                wide = 2 * (begin + count)
                next_slot = widened(next_slot, wide)
                next_total, next_error = widened(next_total, wide), widened(next_error, wide)
                next_key = widened(next_key, wide)
            for head in (HORIZONTAL, VERTICAL):
                k = near(grid, here, head, radius_of(space, kind, head, error), found, away)
                for m in range(k):
                    there = found[m]
                    total = length + away[m]
                    if total + least(ways, there) > best or visited(labels, label, bits[there]):
                        continue
                    left = arrive(space, kind, head, error, away[m])
                    if left == REFUSED:
                        continue
                    key = total + rest(ways, there, left)
                    if key <= best and key < np.inf:
                        next_slot[top], next_key[top] = there, key
                        next_total[top], next_error[top] = total, left
                        top += 1
            order = np.argsort(next_key[begin:top], kind="mergesort")
            next_slot[begin:top] = next_slot[begin:top][order]
            next_key[begin:top] = next_key[begin:top][order]
            next_total[begin:top] = next_total[begin:top][order]
            next_error[begin:top] = next_error[begin:top][order]
            ends[depth] = top
        if marks[depth] == ends[depth]:
            depth -= 1
            continue
        at = marks[depth]
        marks[depth] += 1
        there, total, key = next_slot[at], next_total[at], next_key[at]
        # The order is by bound: what follows in this depth is no better.
        if key > best or (any_route and key >= best):
            marks[depth] = ends[depth]
            continue
        if used + 1 >= room:
            room *= 2
            labels = grown(labels, used, room)
        add(labels, used, there, label, total, next_error[at], bits[there])
        forget(labels, used, grid, ways, bits, marked, best)
        if dominated(labels, heads[there], used):
            continue
        link(labels, heads, used)
        depth += 1
        if depth + 1 >= len(marks):
            wide = 2 * len(marks)
            marks, ends, way = widened(marks, wide), widened(ends, wide), widened(way, wide)
        way[depth] = used
        used += 1
        marks[depth] = ends[depth - 1]
        entering = True
    if not any_route:
        return NOTHING, route, np.inf, ceiling, used, settled
    return FOUND, route, best, best, used, settled
