"""What each resource allows by itself: the least level at a point, and the most to leave it with."""

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
    slack: Floats,
    end: int,
    flag: NDArray[np.int8],
) -> Floats:
    """Return the largest level of each resource with which some way leads from a point to `end`.

    Labels of one number, corrected backwards until none changes. -inf where there is no way.

    Parameters
    ----------
    first, arcs, tails : ndarray of int64
        Where the arcs into each point begin, and their numbers and tails.
    use : ndarray, shape (m, r)
        What the arcs use, by number.
    limit, reset : ndarray, shape (n, r)
        Of the points.
    slack : ndarray, shape (r,)
        What rounding may cost, added to all that is returned.
    end : int
        Where routes end.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the search: inf is returned for all.
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
    initial: Floats,
    start: int,
    flag: NDArray[np.int8],
) -> Floats:
    """Return the least level of each resource with which a point can be left, the others aside.

    Labels of one number, corrected forwards from `start`. inf where there is no way; 0 for all where
    `flag` stops it. `first` and `head_of` are the arcs by tail; otherwise as :func:`most_levels`.
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
                level = min(level, reset[there, k])
                if level < least[there, k]:
                    least[there, k] = level
                    if not waiting[there]:
                        waiting[there] = True
                        queue[(head + size) % count] = there
                        size += 1
    return least
