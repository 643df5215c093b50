"""Least weighted lengths to the end, with arcs of negative weight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["least_ways"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@kernel(interpretable=True)
def least_ways(
    first: Whole, arcs: Whole, tails: Whole, weight: Floats, end: int, rounding: float
) -> tuple[Floats, Whole, int]:
    """Return the least weight of a walk from each point to `end`, by label correcting in reverse.

    Parameters
    ----------
    first, arcs, tails : ndarray of int64
        First incoming arc of each point, and the indices and tails of the incoming arcs.
    weight : ndarray, shape (m,)
        Weight of each arc, of either sign.
    end : int
        Last point.
    rounding : float
        Least improvement of interest, > 0 if cycles of weight 0 may have rounding errors.

    Returns
    -------
    ahead : ndarray, shape (n,)
        Least weights, inf without a walk.
    following : ndarray of int64, shape (n,)
        First arc of the walk from each point, -1 without one.
    cycle : int
        A point on a cycle of negative weight, which `following` contains; -1 without a cycle.
    """
    count = len(first) - 1
    ahead, following = np.full(count, np.inf), np.full(count, -1)
    after, length = np.full(count, -1), np.zeros(count, np.int64)
    waiting, queue = np.zeros(count, np.bool_), np.empty(count, np.int64)
    ahead[end], queue[0] = 0.0, end
    head, size = 0, 1
    while size > 0:
        here = queue[head]
        head, size = (head + 1) % count, size - 1
        waiting[here] = False
        for place in range(first[here], first[here + 1]):
            there, total = tails[place], ahead[here] + weight[arcs[place]]
            if total < ahead[there] - rounding:
                ahead[there], following[there], after[there] = total, arcs[place], here
                length[there] = length[here] + 1
                if length[there] >= count:
                    # A walk of so many arcs repeats a point.
                    at = there
                    for _ in range(count):
                        at = after[at] if after[at] >= 0 else at
                    if after[at] >= 0:
                        return ahead, following, at
                    length[there] = 0
                if not waiting[there]:
                    waiting[there] = True
                    queue[(head + size) % count] = there
                    size += 1
    return ahead, following, -1
