"""How far walks from A get at all, whatever their length."""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .airspace import END, HORIZONTAL, VERTICAL, Airspace
from .grid import Grid, near
from .steps import REFUSED, arrive, distances_to, radius_of

__all__ = ["least_errors"]


@kernel(interpretable=True)
def least_errors(
    space: Airspace, grid: Grid, until: bool, flag: NDArray[np.int8]
) -> NDArray[np.float64]:
    """Return the smallest error with which a walk from A leaves each slot; inf where none arrives.

    Revisits are allowed. Of the walks that reach a point, the one that leaves it with the least
    error can go on wherever any other can, so this alone settles which points, and whether B, can
    be reached. A renewed error may be smaller than the one before, so a point whose error falls is
    extended again. With `until` the search ends as soon as B is reached. Where that or `flag` stops
    it, what is not yet reached is inf too.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    least = np.full(count, np.inf)
    found = np.empty(count, np.int64)
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
            k = near(grid, here, head, radius_of(space, kind, head, error), found, away)
            for m in range(k):
                there = found[m]
                left = arrive(space, kind, head, error, away[m])
                if left != REFUSED and left < least[there]:
                    least[there] = left
                    heappush(heap, (left, there))
    return least
