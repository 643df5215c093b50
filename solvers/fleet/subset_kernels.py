"""Loops over all partitions of a set of nodes among vehicles.

A set is a whole number with one bit per node. ``tours[k, S]`` is the length of the shortest route of
vehicle k through S, infinite if the route is infeasible.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["best_spread", "least_sums"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def least_sums(
    tours: Floats, limit: float, sums: Floats, choice: Ints, flag: NDArray[np.int8]
) -> bool:
    """Compute the least total length for vehicles k, k + 1, … to visit S, for all k and S.

    Routes are at most `limit` long. `sums`, shape (vehicles + 1, sets), are the lengths, infinite if
    infeasible, and `choice`, shape (vehicles, sets), the sets that vehicle k takes. Return whether the
    tables are complete; a nonzero `flag` requests a stop.
    """
    vehicles, size = tours.shape
    for s in range(size):
        sums[vehicles, s] = math.inf
    sums[vehicles, 0] = 0.0
    for k in range(vehicles - 1, -1, -1):
        for s in range(size):
            if flag[0] != 0:
                return False
            best, taken, part = math.inf, 0, s
            while True:
                if tours[k, part] <= limit:
                    total = tours[k, part] + sums[k + 1, s ^ part]
                    if total < best:
                        best, taken = total, part
                if part == 0:
                    break
                part = (part - 1) & s
            sums[k, s] = best
            choice[k, s] = taken
    return True


@kernel
def _objective(loads: Floats, count: int, rest: float, q: float, share: float) -> float:
    """Return Σ L + q s if the lengths from index `count` on are equal and sum to `rest`."""
    vehicles = len(loads)
    each = rest / (vehicles - count) if count < vehicles else 0.0
    total = rest if count < vehicles else 0.0
    for k in range(count):
        total += loads[k]
    mean, squares = total / vehicles, 0.0
    for k in range(count):
        squares += (loads[k] - mean) ** 2
    squares += (vehicles - count) * (each - mean) ** 2
    return total + q * math.sqrt(squares / share)


@kernel(interpretable=True)
def best_spread(
    tours: Floats, sums: Floats, alike: NDArray[np.int8], q: float, share: float, budget: float,
    ceiling: float, owned: Ints, flag: NDArray[np.int8],
) -> tuple[float, int]:  # fmt: skip
    """Return the least Σ L + q s over all partitions of the nodes, by branch and bound, and the sets tried.

    The objective increases with every length. It is bounded below by equal lengths of the remaining
    vehicles with the least total length. ``alike[k]`` states whether vehicle k and all later ones are
    identical: then k takes the first remaining node. `share` is the divisor of the sum of squares, and
    `budget` the largest total length. Only objectives below `ceiling` are considered; the sets of the best
    partition are written to `owned`. A nonzero `flag` requests a stop.
    """
    vehicles, size = tours.shape
    loads, left = np.zeros(vehicles), np.zeros(vehicles, np.int64)
    part, best, tried, k = np.zeros(vehicles, np.int64), ceiling, 0, 0
    left[0] = part[0] = size - 1
    while k >= 0:
        if flag[0] != 0:
            break
        now = part[k]
        if now < 0:
            k -= 1
            continue
        part[k] = -1 if now == 0 else (now - 1) & left[k]
        first = left[k] & -left[k]
        if (alike[k] != 0 and now & first != first) or tours[k, now] == math.inf:
            continue
        rest = sums[k + 1, left[k] ^ now]
        loads[k] = tours[k, now]
        total = rest
        for other in range(k + 1):
            total += loads[other]
        if not total <= budget:
            continue
        tried += 1
        if _objective(loads, k + 1, rest, q, share) >= best:
            continue
        if k + 1 == vehicles:
            best = _objective(loads, vehicles, 0.0, q, share)
            for other in range(vehicles):
                owned[other] = left[other] ^ (left[other + 1] if other + 1 < vehicles else 0)
        else:
            k += 1
            left[k] = part[k] = left[k - 1] ^ now
    return best, tried
