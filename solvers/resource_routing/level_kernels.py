"""Bounds per resource: least level at a point, and largest level from which the end is reachable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["least_levels", "most_levels"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@kernel(interpretable=True)
def most_levels(
    first: Whole,
    arcs: Whole,
    tails: Whole,
    use: Floats,
    limit: Floats,
    reset: Floats,
    floor: Floats,
    slack: Floats,
    end: int,
    flag: NDArray[np.int8],
) -> Floats:
    """Return the largest level of each resource from which `end` is reachable, shape (n, r).

    Label correcting in reverse, one resource at a time. The level is -inf without a path. The incoming arcs are
    those of :func:`.network.arcs_into`; `slack`, shape (r,), is a rounding margin. After a stop all results are
    inf.
    """
    count = len(first) - 1
    most = np.full((count, len(slack)), -np.inf)
    waiting = np.zeros(count, np.bool_)
    queue = np.empty(count, np.int64)
    for k in range(len(slack)):
        most[end, k] = np.inf
        queue[0] = end
        head, size = 0, 1
        while size > 0:
            if flag[0] != 0:
                return np.full((count, len(slack)), np.inf)
            here = queue[head]
            head, size = (head + 1) % count, size - 1
            waiting[here] = False
            arrival = limit[here, k]
            if reset[here, k] > most[here, k] + slack[k]:
                arrival = min(arrival, most[here, k])
                if floor[here, k] > most[here, k] + slack[k]:
                    continue
            for place in range(first[here], first[here + 1]):
                there, left = tails[place], arrival
                if arrival < np.inf:
                    left -= use[arcs[place], k]
                if left > most[there, k]:
                    most[there, k] = left
                    if not waiting[there]:
                        waiting[there] = True
                        queue[(head + size) % count] = there
                        size += 1
    return most + slack


@kernel(interpretable=True)
def least_levels(
    first: Whole,
    head_of: Whole,
    use: Floats,
    limit: Floats,
    reset: Floats,
    floor: Floats,
    initial: Floats,
    start: int,
    flag: NDArray[np.int8],
) -> Floats:
    """Return the least level of each resource on leaving each point, shape (n, r).

    Label correcting from `start`, one resource at a time. The level is inf without a path, and 0
    everywhere after a stop. `first` and `head_of` are the arcs by tail; the other parameters are those
    of :func:`most_levels`.
    """
    count = len(first) - 1
    least = np.full((count, len(initial)), np.inf)
    waiting = np.zeros(count, np.bool_)
    queue = np.empty(count, np.int64)
    for k in range(len(initial)):
        least[start, k] = initial[k]
        queue[0] = start
        head, size = 0, 1
        while size > 0:
            if flag[0] != 0:
                return np.zeros((count, len(initial)))
            here = queue[head]
            head, size = (head + 1) % count, size - 1
            waiting[here] = False
            for arc in range(first[here], first[here + 1]):
                there = head_of[arc]
                level = least[here, k] + use[arc, k]
                if level > limit[there, k]:
                    continue
                level = min(max(level, floor[there, k]), reset[there, k])
                if level < least[there, k]:
                    least[there, k] = level
                    if not waiting[there]:
                        waiting[there] = True
                        queue[(head + size) % count] = there
                        size += 1
    return least
