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

    Parameters
    ----------
    tours : ndarray, shape (vehicles, sets)
        Lengths of the shortest routes.
    limit : float
        Longest feasible route.
    sums : ndarray, shape (vehicles + 1, sets)
        Output: the total lengths; infinite if infeasible.
    choice : ndarray of int, shape (vehicles, sets)
        Output: the set that vehicle k takes.
    flag : ndarray of int8
        Stop flag; a nonzero value requests a stop.

    Returns
    -------
    bool
        Whether the tables are complete.
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
    """Return the least Σ L + q s over all partitions of the nodes, by branch and bound.

    The objective increases with every length. It is bounded below by equal lengths of the remaining
    vehicles with the least total length.

    Parameters
    ----------
    tours, sums
        Tables as in :func:`least_sums`.
    alike : ndarray of int8, shape (vehicles,)
        Whether vehicle k and all later ones are identical: then k takes the first remaining node.
    q, share : float
        Weight of the deviation, and divisor of the sum of squares.
    budget : float
        Largest total length.
    ceiling : float
        Upper bound: only better objectives are considered.
    owned : ndarray of int, shape (vehicles,)
        Output: the sets of the best partition.
    flag : ndarray of int8
        Stop flag; a nonzero value requests a stop.

    Returns
    -------
    best : float
        The least objective, or `ceiling` if no partition is below it.
    tried : int
        The number of sets tried.
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
