"""The paper's first stage: labels of length and errors, one kept at each point."""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .airspace import END, HORIZONTAL, VERTICAL, Airspace
from .grid import Grid, near
from .outcomes import FOUND, NOTHING, STOPPED
from .steps import REFUSED, arrive, distances_to, radius_of, trace

__all__ = ["label_once"]


@kernel(interpretable=True)
def label_once(
    space: Airspace, grid: Grid, weight: float, flag: NDArray[np.int8]
) -> tuple[int, NDArray[np.int64], float, int]:
    """Return the route that a single sweep finds, or none.

    Points are labelled for good in the order of ``weight * length + (1 - weight) * e / rate``,
    where e is the surviving error and ``e / rate`` the metres flown since it was 0. One label is
    kept at a point, so a route has no point twice, and a route may be missed.

    Parameters
    ----------
    space, grid : Airspace, Grid
        The problem.
    weight : float
        The paper's λ.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the sweep.

    Returns
    -------
    status : int
        ``FOUND``, ``NOTHING`` or ``STOPPED``.
    route : ndarray
        Points from A to B, empty without one.
    length : float
        Its length (m), inf without one.
    made : int
        Labels made.
    """
    count = len(grid.x)
    start, end = count - 2, count - 1
    to_end = distances_to(grid, end)
    key_of = np.full(count, np.inf)
    length_of = np.full(count, np.inf)
    error_of = np.zeros(count)
    parent = np.full(count, -1)
    done = np.zeros(count, np.bool_)
    found = np.empty(count, np.int64)
    away = np.empty(count)
    nothing = np.empty(0, np.int64)
    key_of[start], length_of[start] = 0.0, 0.0
    heap = [(0.0, start)]
    made = 1
    best, last = np.inf, -1
    while len(heap) > 0:
        _, here = heappop(heap)
        if done[here]:
            continue
        if flag[0] != 0:
            return STOPPED, nothing, np.inf, made
        done[here] = True
        kind, error, length = grid.kinds[here], error_of[here], length_of[here]
        # Any label that reaches B gives a route; the shortest of them is kept.
        if (
            length + to_end[here] < best
            and arrive(space, kind, END, error, to_end[here]) != REFUSED
        ):
            best, last = length + to_end[here], here
        for head in (HORIZONTAL, VERTICAL):
            rate = space.rates[0] if head == HORIZONTAL else space.rates[1]
            k = near(grid, here, head, radius_of(space, kind, head, error), found, away)
            for m in range(k):
                there = found[m]
                if done[there]:
                    continue
                left = arrive(space, kind, head, error, away[m])
                if left == REFUSED:
                    continue
                flown = left / rate if rate > 0.0 else 0.0
                key = weight * (length + away[m]) + (1.0 - weight) * flown
                if key < key_of[there]:
                    key_of[there], length_of[there] = key, length + away[m]
                    error_of[there], parent[there] = left, here
                    heappush(heap, (key, there))
                    made += 1
    if last < 0:
        return NOTHING, nothing, np.inf, made
    route = np.append(trace(np.arange(count), parent, grid.ids, last), grid.ids[end])
    return FOUND, route, best, made
