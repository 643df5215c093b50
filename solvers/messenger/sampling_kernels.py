"""All combinations of boundary samples in one order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import inside, meet, stay

__all__ = ["enumerate_samples"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def enumerate_samples(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, samples: int, interior: bool,
    ceiling: float, flag: NDArray[np.int8], poses: Floats, legs: Floats,
) -> float:  # fmt: skip
    """Fill `genes` with the best combination for `order`, and return when its tour ends.

    Parameters are those of :func:`~.decoding.decode`; `samples` is the number a boundary. inf where
    no tour ends before `ceiling`. Where `flag` asks to stop, the best so far, one at least.
    """
    n = len(order)
    digits, trial = np.zeros(n, np.int64), genes.copy()
    best, level = math.inf, 0
    while level >= 0 and (flag[0] == 0 or best == ceiling == math.inf):
        i = order[level]
        many = samples if fleet[i, 4] > 0.0 else 1
        if digits[level] >= many:
            digits[level] = 0
            level -= 1
            continue
        psi = 2.0 * math.pi * digits[level] / samples
        digits[level] += 1
        trial[i, 0], trial[i, 2] = psi, 1.0
        if interior and inside(poses, level, fleet, i, trial):
            stay(poses, legs, level)
            digits[level] = many
        elif meet(poses, legs, level, fleet, craft, i, psi, 0.0, 1.0) == math.inf:
            continue
        if not poses[level + 1, 3] < ceiling:
            continue
        if level + 1 < n:
            level += 1
        else:
            best = ceiling = poses[n, 3]
            for k in range(n):
                for m in range(3):
                    genes[k, m] = trial[k, m]
    return best
