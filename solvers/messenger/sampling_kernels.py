"""Shortest tour over sampled times and boundaries for one order, by branch and bound."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import meet

__all__ = ["search_samples"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def _soonest(poses: Floats, k: int, i: int, fleet: Floats, craft: Floats, t: float) -> float:
    """Return a lower bound (s) on the time at which a UAV at row `k` of `poses` meets vehicle `i`.

    The bound is the time of a straight flight from time `t` on, with the vehicle heading for the
    UAV.
    """
    dx = fleet[i, 0] + fleet[i, 2] * t - poses[k, 0]
    dy = fleet[i, 1] + fleet[i, 3] * t - poses[k, 1]
    gap = math.hypot(dx, dy) - fleet[i, 4]
    soonest: float = t + max(gap, 0.0) / (craft[3] + math.hypot(fleet[i, 2], fleet[i, 3]))
    return soonest


@kernel
def search_samples(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, samples: int, step: float,
    ceiling: float, flag: NDArray[np.int8], poses: Floats,
) -> float:  # fmt: skip
    """Fill `genes` with the best samples for `order`; return the end of the tour (s).

    Depth-first search: each level is an encounter. Its nodes are the times in multiples of `step`
    and the `samples` angles of the boundary that the UAV can reach exactly at these times. A node
    is pruned if a straight flight from it cannot end before the best tour so far.

    Parameters
    ----------
    order, genes, fleet, craft, poses : ndarray
        See :mod:`.decoding`.
    samples : int
        Number of angles of each boundary.
    step : float
        Time step (s).
    ceiling : float
        Time (s) before which the tour must end; the result is inf if no tour does.
    flag : ndarray of int8
        Stop flag; if it is set, the result is the best tour so far.
    """
    n = len(order)
    trial, ticks, best = genes.copy(), np.zeros(n, np.int64), math.inf
    # Node number: tick * samples + angle.
    level, nodes = 0, np.zeros(n, np.int64)
    nodes[0] = int(_soonest(poses, 0, order[0], fleet, craft, 0.0) / step) * samples
    while level >= 0 and flag[0] == 0:
        i, last = order[level], level + 1 == n
        ticks[level] = nodes[level] // samples
        theta = 2.0 * math.pi * (nodes[level] % samples) / samples
        nodes[level] += 1
        t = ticks[level] * step
        interval = t - poses[level, 3]
        if not t < ceiling or (
            not last
            and not _soonest(poses, level, order[n - 1], fleet, craft, poses[level, 3]) < ceiling
        ):
            level -= 1
            continue
        trial[i, 0], trial[i, 1] = theta, interval
        if interval < 0.0 or meet(poses, level, i, theta, interval, fleet, craft) != 0.0:
            continue
        if last:
            best = ceiling = t
            genes[:] = trial
            level -= 1
            continue
        soonest = _soonest(poses, level + 1, order[level + 1], fleet, craft, t)
        if soonest < ceiling:
            level += 1
            nodes[level] = int(soonest / step) * samples
    return best
