"""Shaking and local search of the variable neighbourhood search."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import follow
from .operators import exchange, move

__all__ = ["improve", "shake"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def shake(order: Ints, kind: int, rng: np.random.Generator) -> None:
    """Move a random stretch of the order (`kind` 0), or exchange two stretches (`kind` 1)."""
    n = len(order)
    if kind == 0:
        begin = int(rng.random() * n)
        count = 1 + int(rng.random() * (n - begin))
        move(order, begin, count, int(rng.random() * (n - count + 1)))
    else:
        cuts = np.empty(4, np.int64)
        for m in range(4):
            cuts[m] = int(rng.random() * (n + 1))
        cuts.sort()
        exchange(order, cuts[0], cuts[1], cuts[2], cuts[3])


@kernel
def improve(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, trials: int,
    rng: np.random.Generator, flag: NDArray[np.int8], poses: Floats,
) -> float:  # fmt: skip
    """Try random moves of one vehicle, exchanges of two, and new angles; return the end of the tour (s).

    A change is accepted if the tour ends sooner.

    Parameters
    ----------
    order, genes, fleet, craft, poses : ndarray
        See :mod:`.decoding`; order, genes and poses are updated.
    trials : int
        Number of changes to try.
    rng, flag
        Random generator, and the stop flag.
    """
    n = len(order)
    end = follow(order, genes, fleet, craft, 0, math.inf, poses)
    trial, trial_genes, spot = order.copy(), genes.copy(), poses.copy()
    for _ in range(trials):
        if flag[0] != 0:
            break
        kind, a, b = int(rng.random() * 3), int(rng.random() * n), int(rng.random() * n)
        if kind < 2 and a == b:
            continue
        first = a if kind == 2 else min(a, b)
        if kind == 0:
            move(trial, a, 1, b)
        elif kind == 1:
            trial[a], trial[b] = trial[b], trial[a]
        else:
            trial_genes[order[a], 0] = 2.0 * math.pi * rng.random()
        spot[first] = poses[first]
        there = follow(trial, trial_genes, fleet, craft, first, end, spot)
        if there < end:
            end, order[:], genes[:] = there, trial, trial_genes
            poses[first:] = spot[first:]
        else:
            trial[:], trial_genes[:] = order, genes
    return end
