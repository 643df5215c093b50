"""Loops over all ways to hand out a set of nodes to vehicles, one after the other.

A set is a whole number with a bit a node. ``tours[k, S]`` is the shortest route of vehicle k through
S, infinite where it may not go there.
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
    """Fill in the least total lengths of the vehicles from k on that share out S, for all k and S.

    Parameters
    ----------
    tours : ndarray, shape (vehicles, sets)
        Lengths.
    limit : float
        Longest route allowed.
    sums : ndarray, shape (vehicles + 1, sets)
        Filled in; infinite where there is no way.
    choice : ndarray of int, shape (vehicles, sets)
        Filled in with the set that vehicle k takes.
    flag : ndarray of int8
        Not 0 asks to stop.

    Returns
    -------
    bool
        Whether all was filled in.
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
    """Return Σ L + q s, where the lengths from `count` on are equal and add up to `rest`."""
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
    """Return the least Σ L + q s over all ways to share out all nodes, by branch and bound.

    The objective grows with every length, so vehicles to come are at best equally long, with the
    least total that they can have.

    Parameters
    ----------
    tours, sums
        As in :func:`least_sums`, the latter filled in.
    alike : ndarray of int8, shape (vehicles,)
        Whether vehicle k and all after it are alike: then k takes the first node that is left.
    q, share : float
        Weight of the deviation, and what the sum of squares is divided by.
    budget : float
        Largest total.
    ceiling : float
        Only what is below counts.
    owned : ndarray of int, shape (vehicles,)
        Filled in with the sets of the best way.
    flag : ndarray of int8
        Not 0 asks to stop.

    Returns
    -------
    float, int
        The least objective, `ceiling` where nothing is below it; and the number of parts tried.
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
