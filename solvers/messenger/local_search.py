"""The two local searches of the paper on encounter directions: gradient (GS) and sampling (SS).

While every interval is kept, the end of a tour does not depend on directions. So both look at the
tour in which every vehicle is met at its first interception, and the intervals of the best are kept.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import copy_tour, decode

__all__ = ["descend", "resample"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Change of a direction (rad) over which a slope is taken.
_SLOPE = 1e-4
#: Rounds of a local search at most, and doublings or halvings of a step.
_ROUNDS, _STEPS = 50, 12


@kernel
def _suffix(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, k: int, interior: bool,
    ceiling: float, poses: Floats, to_genes: Floats, to_poses: Floats, to_legs: Floats,
) -> float:  # fmt: skip
    """Return when the tour ends that is flown from leg `k` on with the directions in `genes`."""
    for m in range(k, len(order)):
        for g in range(3):
            to_genes[order[m], g] = genes[order[m], g]
    for m in range(4):
        to_poses[k, m] = poses[k, m]
    return decode(
        order, to_genes, fleet, craft, k, False, interior, ceiling, to_poses, to_legs
    )  # fmt: skip


@kernel
def descend(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, interior: bool, rate: float,
    tolerance: float, flag: NDArray[np.int8], poses: Floats, legs: Floats,
) -> None:  # fmt: skip
    """GS: descend along the gradient of the tour's length by the directions.

    The paper's eq. 11 with 12 as printed ascends. Ours: slopes are divided by the radius, so that
    `rate` (paper: ρ_l) has no unit, and a step is doubled while that pays and halved until it does.

    Parameters
    ----------
    order, genes, fleet, craft, interior, poses, legs
        As in :func:`~.decoding.decode`; the individual and its path are updated if they get better.
    rate : float
        Step (rad) along a slope of the length that is as large as the radius.
    tolerance : float
        Relative gain of a round below which it ends (paper: ε).
    flag : ndarray of int8
        Not 0 asks to stop.
    """
    n = len(order)
    trial, slope = genes.copy(), np.zeros(n)
    near, path = np.empty((n + 1, 4)), np.empty((n, 6))
    spare, spot, route = genes.copy(), np.empty((n + 1, 4)), np.empty((n, 6))
    here, track = poses.copy(), np.empty((n, 6))
    current = genes.copy()
    end = decode(order, current, fleet, craft, 0, False, interior, math.inf, here, track)
    for _ in range(_ROUNDS):
        before = end
        for k in range(n):
            i = order[k]
            slope[i] = 0.0
            if flag[0] != 0:
                return
            if fleet[i, 4] > 0.0:
                psi = current[i, 0]
                current[i, 0] = psi + _SLOPE
                there = _suffix(
                    order, current, fleet, craft, k, interior, math.inf, here, spare, spot, route
                )
                current[i, 0] = psi
                slope[i] = (there - end) / _SLOPE * craft[3] / fleet[i, 4]
        step, grown = rate, False
        for _ in range(_STEPS):
            for i in range(n):
                trial[i, 0] = current[i, 0] - step * slope[i]
                trial[i, 1], trial[i, 2] = 0.0, current[i, 2]
            for m in range(4):
                near[0, m] = here[0, m]
            there = decode(order, trial, fleet, craft, 0, False, interior, end, near, path)
            if there < end:
                end, grown = there, True
                copy_tour(0, order, trial, near, path, order, spare, spot, route)
                step *= 2.0
            elif grown:
                break
            else:
                step *= 0.5
        if grown:
            copy_tour(0, order, spare, spot, route, order, current, here, track)
        if end > before * (1.0 - tolerance):
            break
    if end < poses[n, 3]:
        copy_tour(0, order, current, here, track, order, genes, poses, legs)


@kernel
def resample(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, interior: bool, samples: int,
    tolerance: float, rng: np.random.Generator, flag: NDArray[np.int8], poses: Floats,
    legs: Floats,
) -> None:  # fmt: skip
    """SS: try directions drawn uniformly for one vehicle after the other, and keep the best.

    Parameters are those of :func:`descend`; `samples` is the number a vehicle (paper: N_s). With
    `interior`, the share of the radius is drawn too, evenly over the disc.
    """
    n = len(order)
    spare, spot, route = genes.copy(), np.empty((n + 1, 4)), np.empty((n, 6))
    here, track, current = poses.copy(), np.empty((n, 6)), genes.copy()
    end = decode(order, current, fleet, craft, 0, False, interior, math.inf, here, track)
    for _ in range(_ROUNDS):
        before = end
        for k in range(n):
            i = order[k]
            if flag[0] != 0 or fleet[i, 4] == 0.0:
                continue
            psi, rho = current[i, 0], current[i, 2]
            best_psi, best_rho = psi, rho
            for _ in range(samples):
                current[i, 0] = 2.0 * math.pi * rng.random()
                if interior:
                    current[i, 2] = math.sqrt(rng.random())
                there = _suffix(
                    order, current, fleet, craft, k, interior, end, here, spare, spot, route
                )
                if there < end:
                    end, best_psi, best_rho = there, current[i, 0], current[i, 2]
            current[i, 0], current[i, 2] = best_psi, best_rho
            if best_psi != psi or best_rho != rho:
                end = decode(
                    order, current, fleet, craft, k, False, interior, math.inf, here, track
                )
        if flag[0] != 0 or end > before * (1.0 - tolerance):
            break
    if end < poses[n, 3]:
        copy_tour(0, order, current, here, track, order, genes, poses, legs)
