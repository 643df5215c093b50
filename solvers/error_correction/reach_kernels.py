"""Reachability of points by walks of any length from A."""

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
    """Return the least error on leaving each slot by walks from A, shape (slots,); inf if unreachable.

    Revisits are allowed. The walk of least error can be extended wherever any other can, so the least
    errors determine which points are reachable. A later walk may have a smaller error, so a point is
    extended again after its error decreases. With `until` the search ends as soon as B is reached.
    After an early end, by `until` or `flag`, points not reached yet have inf, too.
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
