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

    `first`, `arcs` and `tails` are the incoming arcs, see :func:`.network.arcs_into`, with weights of either
    sign. `rounding` is the least improvement of interest, > 0 if cycles of weight 0 may have rounding errors. The
    results are the weights (inf without a walk), the first arc of each walk (-1 without one), and a point on a
    cycle of negative weight, which these arcs contain (-1 without a cycle).
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
