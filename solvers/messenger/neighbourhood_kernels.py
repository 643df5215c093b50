"""Shaking and local search of the variable neighbourhood search."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import copy_tour, decode
from .sequences import exchange, move

__all__ = ["improve", "shake"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def shake(order: Ints, kind: int, rng: np.random.Generator) -> None:
    """Move a random stretch of the order (`kind` 0), or exchange two (1)."""
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
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, trials: int, interior: bool,
    rng: np.random.Generator, flag: NDArray[np.int8], poses: Floats, legs: Floats,
) -> float:  # fmt: skip
    """Decode, then try random moves of one vehicle, exchanges of two, and encounter directions.

    What ends the tour sooner is kept. Parameters are those of :func:`~.decoding.decode`, `trials`
    the number of tries. Returns when the tour ends.
    """
    n = len(order)
    end = decode(order, genes, fleet, craft, 0, False, interior, math.inf, poses, legs)
    trial, own = order.copy(), genes.copy()
    spot, route = poses.copy(), legs.copy()
    for _ in range(trials):
        if flag[0] != 0:
            break
        kind, a, b = int(rng.random() * 3), int(rng.random() * n), int(rng.random() * n)
        first = min(a, b)
        if kind == 0:
            move(trial, a, 1, b)
        elif kind == 1:
            trial[a], trial[b] = trial[b], trial[a]
        else:
            first, i = a, order[a]
            own[i, 0] = 2.0 * math.pi * rng.random()
            own[i, 2] = math.sqrt(rng.random()) if interior else 1.0
        for m in range(4):
            spot[first, m] = poses[first, m]
        there = math.inf
        if kind == 2 or a != b:
            there = decode(trial, own, fleet, craft, first, False, interior, end, spot, route)
        if there < end:
            end = there
            copy_tour(first, trial, own, spot, route, order, genes, poses, legs)
        else:
            for k in range(n):
                trial[k] = order[k]
                for m in range(3):
                    own[k, m] = genes[k, m]
    return end
