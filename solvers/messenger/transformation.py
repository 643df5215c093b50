"""Transformation procedure of the paper (Algorithm 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import relaxed_length
from .decoding import access, meet, shortest_time

__all__ = ["catches_up", "transform"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Interval ε_t of Definition 1 (arbitrary in the paper), as a share of the leg's interval.
LATER = 1e-3


@kernel
def catches_up(poses: Floats, k: int, i: int, genes: Floats, fleet: Floats, craft: Floats) -> bool:
    """Return whether leg `k` ends in the catch-up pattern (paper: Definition 1).

    In this pattern, the shortest path to the access point of vehicle `i` at the encounter is at
    most as long as that to the access point an interval ε_t later.
    """
    x, y, h, t = poses[k, 0], poses[k, 1], poses[k, 2], poses[k, 3] + genes[i, 1]
    qx, qy = access(fleet, i, genes[i, 0], t)
    now = relaxed_length(x, y, h, qx, qy, craft[4])
    qx, qy = access(fleet, i, genes[i, 0], t + LATER * genes[i, 1])
    return bool(now <= relaxed_length(x, y, h, qx, qy, craft[4]))


@kernel
def transform(order: Ints, genes: Floats, fleet: Floats, craft: Floats, poses: Floats) -> int:
    """Reset the interval before each vehicle that is caught up with; return the number of changes.

    Parameters
    ----------
    order, genes, fleet, craft, poses : ndarray
        Individual and its decoded poses (see :mod:`.decoding`). Both are updated, the poses up to
        the second-to-last vehicle.
    """
    changed = 0
    for k in range(len(order) - 1):
        i = order[k]
        if catches_up(poses, k + 1, order[k + 1], genes, fleet, craft):
            genes[i, 1] = shortest_time(poses, k, i, genes[i, 0], fleet, craft)
            changed += 1
        meet(poses, k, i, genes[i, 0], genes[i, 1], fleet, craft)
    return changed
