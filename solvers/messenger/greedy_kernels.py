"""Receding-horizon orders, flown to samples of the boundaries or to the centres (HE-B, HE-C)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import meet, shortest_time

__all__ = ["build", "next_vehicle"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def next_vehicle(order: Ints, k: int, x: float, y: float, fleet: Floats, horizon: int) -> int:
    """Return the index in `order`, at least `k`, of the first vehicle of the best horizon.

    The best horizon is the shortest polyline from (x, y) over the centres at time 0 of `horizon` (1
    or 2) of the vehicles from index `k` on.
    """
    n = len(order)
    shortest, best = math.inf, k
    for a in range(k, n):
        ax, ay = fleet[order[a], 0], fleet[order[a], 1]
        rest = 0.0 if horizon == 1 or n - k == 1 else math.inf
        for b in range(k, n):
            if b != a:
                rest = min(rest, math.hypot(fleet[order[b], 0] - ax, fleet[order[b], 1] - ay))
        if math.hypot(ax - x, ay - y) + rest < shortest:
            shortest, best = math.hypot(ax - x, ay - y) + rest, a
    return best


@kernel
def build(
    order: Ints,
    genes: Floats,
    fleet: Floats,
    craft: Floats,
    horizon: int,
    samples: int,
    poses: Floats,
) -> None:
    """Fill in an order and its genes.

    Parameters
    ----------
    order, genes, fleet, craft, poses : ndarray
        See :mod:`.decoding`; `order` contains every vehicle, in any order.
    horizon : int
        Number of vehicles of the receding horizon, 1 or 2.
    samples : int
        Number of samples of each boundary. The UAV flies to the sample with the shortest time.
    """
    x, y = craft[0], craft[1]
    for k in range(len(order)):
        at = next_vehicle(order, k, x, y, fleet, horizon)
        order[k], order[at] = order[at], order[k]
        i = order[k]
        x, y = fleet[i, 0], fleet[i, 1]
        genes[i, 1] = math.inf
        for m in range(samples if fleet[i, 4] > 0.0 else 1):
            theta = 2.0 * math.pi * m / samples
            interval = shortest_time(poses, k, i, theta, fleet, craft)
            if interval < genes[i, 1]:
                genes[i, 0], genes[i, 1] = theta, interval
        meet(poses, k, i, genes[i, 0], genes[i, 1], fleet, craft)
