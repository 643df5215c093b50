"""The local searches of the paper (section IV-G): along a gradient (GS), and by sampling (SS).

Both change the angle of one random vehicle of an individual, and repair and transform the result.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import KAPPA, assess, follow, shortest_time
from .transformation import transform

__all__ = ["descend", "resample", "settle"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: Change of the angle (rad) in eq. 11 (paper: Δθ, not given).
DELTA = 1e-4


@kernel
def settle(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, timed: bool, transformed: bool,
    poses: Floats,
) -> float:  # fmt: skip
    """Repair and transform an individual; return its evaluation f (m, paper: eq. 8).

    Parameters
    ----------
    order, genes, fleet, craft, poses : ndarray
        See :mod:`.decoding`; genes and poses are updated.
    timed : bool
        Whether intervals are genes. If False, each vehicle is met in the shortest time (MAR).
    transformed : bool
        Whether to apply Algorithm 4.
    """
    if not timed:
        length: float = craft[3] * follow(order, genes, fleet, craft, 0, math.inf, poses)
        return length
    end, off = assess(order, genes, fleet, craft, 0, True, poses)
    if transformed and transform(order, genes, fleet, craft, poses) > 0:
        end, off = assess(order, genes, fleet, craft, 0, False, poses)
    length = craft[3] * end
    return length + KAPPA * off


@kernel
def descend(
    i: int, order: Ints, genes: Floats, cost: float, fleet: Floats, craft: Floats, timed: bool,
    transformed: bool, rate: float, flag: Flag, poses: Floats,
) -> float:  # fmt: skip
    """GS: move the angle of vehicle `i` against the gradient while the tour gets shorter; return f.

    Equation 11 prints the negative gradient, which eq. 12 subtracts, so the printed step ascends.
    This implementation descends. It takes at most 2 π / ρ_l steps (paper: section IV-H).

    Parameters
    ----------
    order, genes, fleet, craft, timed, transformed, poses
        As for :func:`settle`; `genes` is updated.
    cost : float
        f of the individual.
    rate : float
        Step size (paper: ρ_l).
    flag : ndarray of int8
        Stop flag.
    """
    trial = genes.copy()
    for _ in range(int(2.0 * math.pi / rate)):
        if flag[0] != 0:
            break
        trial[:] = genes
        trial[i, 0] += DELTA
        slope = (settle(order, trial, fleet, craft, timed, transformed, poses) - cost) / DELTA
        trial[:] = genes
        trial[i, 0] -= rate * slope
        value = settle(order, trial, fleet, craft, timed, transformed, poses)
        if not value < cost:
            break
        cost, genes[:] = value, trial
    return cost


@kernel
def resample(
    k: int, order: Ints, genes: Floats, cost: float, fleet: Floats, craft: Floats,
    transformed: bool, samples: int, flag: Flag, poses: Floats,
) -> float:  # fmt: skip
    """SS: try equally spaced angles for the k-th vehicle of the order and keep the best; return f.

    Its interval is then given by Algorithm 1. The parameters are those of :func:`descend`;
    `samples` is the number of angles (paper: N_s).
    """
    i = order[k]
    start, trial = genes.copy(), genes.copy()
    for m in range(samples):
        if flag[0] != 0:
            break
        trial[:] = start
        trial[i, 0] = 2.0 * math.pi * m / samples
        assess(order, trial, fleet, craft, 0, False, poses)
        trial[i, 1] = shortest_time(poses, k, i, trial[i, 0], fleet, craft)
        value = settle(order, trial, fleet, craft, True, transformed, poses)
        if value < cost:
            cost, genes[:] = value, trial
    return cost
