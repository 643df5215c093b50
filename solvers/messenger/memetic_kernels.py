"""The paper's memetic algorithm (Algorithm 3), one generation per call."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import KAPPA, assess, meet, upper_bound
from .local_search import descend, resample, settle
from .operators import cross, mutate, other, shuffle

__all__ = ["evolve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]
Rng = np.random.Generator


@kernel
def _populate(
    orders: Ints, genes: Floats, costs: Floats, fleet: Floats, craft: Floats, timed: bool, rng: Rng,
    poses: Floats,
) -> None:  # fmt: skip
    """Fill a population at random: orders, angles, and intervals up to t_max of Lemma 1."""
    for p in range(len(costs)):
        shuffle(orders[p], rng)
        for k in range(len(fleet)):
            i = orders[p, k]
            genes[p, i, 0] = 2.0 * math.pi * rng.random()
            if timed:
                upper = upper_bound(poses, k, i, genes[p, i, 0], fleet, craft)
                genes[p, i, 1] = rng.random() * upper
                meet(poses, k, i, genes[p, i, 0], genes[p, i, 1], fleet, craft)
        if timed:
            end, off = assess(orders[p], genes[p], fleet, craft, 0, False, poses)
            costs[p] = craft[3] * end + KAPPA * off
        else:
            costs[p] = settle(orders[p], genes[p], fleet, craft, False, False, poses)


@kernel
def evolve(
    number: int, orders: Ints, genes: Floats, costs: Floats, fleet: Floats, craft: Floats,
    rate: float, timed: bool, transformed: bool, period: int, step: float, samples: int, rng: Rng,
    flag: Flag, poses: Floats,
) -> int:  # fmt: skip
    """Create the first population or the next generation; return the index of the best individual.

    Parameters
    ----------
    number : int
        Number of the generation; 0 creates the first population.
    orders, genes, costs : ndarray, shapes (p, n), (p, n, 2), (p,)
        The individuals and their evaluations f (m); updated.
    fleet, craft, poses : ndarray
        The problem, and scratch poses whose first row is the start (see :mod:`.decoding`).
    rate : float
        Probability of a mutation (paper: p_m).
    timed, transformed : bool
        Whether intervals are genes, and whether to apply Algorithm 4.
    period : int
        Generations between local searches (paper: T_lp).
    step : float
        Step size of GS (paper: ρ_l).
    samples : int
        Number of angles of SS (paper: N_s); 0 disables SS.
    rng, flag
        Random generator, and the stop flag.
    """
    if number == 0:
        _populate(orders, genes, costs, fleet, craft, timed, rng, poses)
        return int(np.argmin(costs))
    size, n = orders.shape
    child, child_genes, sources = np.empty(n, np.int64), np.empty((n, 2)), np.empty(n, np.int64)
    for p in range(size):
        if flag[0] != 0:
            break
        q = other(p, size, rng)
        for k in range(n):
            sources[k] = 1 + int(2.0 * rng.random())
        cross(sources, orders[p], genes[p], orders[q], genes[q], child, child_genes)
        if rng.random() < rate:
            kind = 1 + int((3.0 if timed else 2.0) * rng.random())
            mutate(kind, child, child_genes, fleet, craft, rng, poses)
        value = settle(child, child_genes, fleet, craft, timed, transformed, poses)
        if value < costs[p]:
            orders[p], genes[p], costs[p] = child, child_genes, value
    if number % period == 0:
        half = np.argsort(costs)[: max(size // 2, 1)]
        for _ in range(number // period):
            p, k = half[int(rng.random() * len(half))], int(rng.random() * n)
            if samples == 0 or rng.random() < 0.5:
                costs[p] = descend(
                    orders[p, k], orders[p], genes[p], costs[p], fleet, craft, timed, transformed,
                    step, flag, poses,
                )  # fmt: skip
            else:
                costs[p] = resample(
                    k,
                    orders[p],
                    genes[p],
                    costs[p],
                    fleet,
                    craft,
                    transformed,
                    samples,
                    flag,
                    poses,
                )
    return int(np.argmin(costs))
