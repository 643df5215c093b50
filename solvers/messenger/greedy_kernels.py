"""Orders of receding horizon, encounters sampled on the boundary or flown to at the centre, 2-opt.

Only :func:`greedy` is called from outside, for every kernel that is takes as long to compile as all
that it calls.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import along, copy_tour, decode, inside, meet, stay
from .transformation import entry

__all__ = ["NEAREST", "SAMPLE", "TURN_AROUND", "TURN_AROUND_CENTRAL", "greedy"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: What :func:`greedy` does: find an order; improve it, flown towards centres; sample encounters anew;
#: improve the order, flown to these.
NEAREST, TURN_AROUND_CENTRAL, SAMPLE, TURN_AROUND = 0, 1, 2, 3


@kernel
def _towards(
    poses: Floats, legs: Floats, k: int, fleet: Floats, craft: Floats, i: int, genes: Floats
) -> float:
    """Fly leg `k` towards the centre of `i` as far as its boundary; return when that is reached."""
    if inside(poses, k, fleet, i, genes):
        stay(poses, legs, k)
        now: float = poses[k, 3]
        return now
    if meet(poses, legs, k, fleet, craft, i, 0.0, 0.0, 0.0) == math.inf:
        return math.inf
    passed, _, _ = entry(poses, legs, k, fleet, craft, i, False)
    if passed < math.inf:
        x, y, h = poses[k, 0], poses[k, 1], poses[k, 2]
        left = passed * craft[3]
        for m in range(3):
            legs[k, m] = min(legs[k, m], left)
            left -= legs[k, m]
            if legs[k, m] > 0.0:
                x, y, h = along(x, y, h, legs[k, m], legs[k, 3 + m], craft[4])
        poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2] = x, y, h
        poses[k + 1, 3] = poses[k, 3] + (legs[k, 0] + legs[k, 1] + legs[k, 2]) / craft[3]
    end: float = poses[k + 1, 3]
    return end


@kernel
def _central(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, first: int, ceiling: float,
    poses: Floats, legs: Floats,
) -> float:  # fmt: skip
    """Fly from one centre towards the next, and return when the tour ends; inf beyond `ceiling`."""
    for k in range(first, len(order)):
        if not _towards(poses, legs, k, fleet, craft, order[k], genes) < ceiling:
            return math.inf
    end: float = poses[len(order), 3]
    return end


@kernel
def _sample(
    order: Ints, k: int, ahead: bool, genes: Floats, fleet: Floats, craft: Floats, samples: int,
    interior: bool, poses: Floats, legs: Floats,
) -> None:  # fmt: skip
    """Fly leg `k` to the best sample of the vehicle's boundary, and note it in `genes`.

    It is the one from which the next vehicle's centre is reached first, or (not `ahead`) the one that
    is reached first itself.
    """
    i = order[k]
    if interior and inside(poses, k, fleet, i, genes):
        stay(poses, legs, k)
        return
    soonest, best = math.inf, 0.0
    for m in range(samples if fleet[i, 4] > 0.0 else 1):
        psi = 2.0 * math.pi * m / samples
        there = math.inf
        if meet(poses, legs, k, fleet, craft, i, psi, 0.0, 1.0) < math.inf:
            there = poses[k + 1, 3]
            if ahead:
                there = _towards(poses, legs, k + 1, fleet, craft, order[k + 1], genes)
        if there < soonest:
            soonest, best = there, psi
    genes[i, 0], genes[i, 2] = best, 1.0
    genes[i, 1] = meet(poses, legs, k, fleet, craft, i, best, 0.0, 1.0)


@kernel
def _nearest(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, horizon: int, samples: int,
    interior: bool, flag: Flag, poses: Floats, legs: Floats,
) -> None:  # fmt: skip
    """Fill `order`: always next the vehicle with which the next `horizon` (1 or 2) are met soonest.

    To choose it, vehicles are met where the way to their centre enters their disc. It is flown there,
    or to the best of `samples` of its boundary where these are above 0.
    """
    n = len(order)
    for k in range(n):
        order[k] = k
    for k in range(n):
        soonest, best, second = math.inf, k, -1
        for m in range(k, n):
            there, then = _towards(poses, legs, k, fleet, craft, order[m], genes), -1
            if horizon > 1 and k + 1 < n and flag[0] == 0:
                there = math.inf
                for p in range(k, n):
                    if p != m:
                        after = _towards(poses, legs, k + 1, fleet, craft, order[p], genes)
                        if after < there:
                            there, then = after, p
            if there < soonest:
                soonest, best, second = there, m, then
        order[k], order[best] = order[best], order[k]
        if second >= 0:
            second = best if second == k else second
            order[k + 1], order[second] = order[second], order[k + 1]
        if samples > 0:
            ahead = second >= 0
            _sample(order, k, ahead, genes, fleet, craft, samples, interior, poses, legs)
        else:
            _towards(poses, legs, k, fleet, craft, order[k], genes)


@kernel
def _two_opt(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, central: bool, interior: bool,
    flag: Flag, poses: Floats, legs: Floats,
) -> None:  # fmt: skip
    """Turn stretches of the order around while the tour ends sooner.

    `central` tells how a tour is flown: towards centres, else to the directions in `genes`. The path
    in `poses` is that of the order on return.
    """
    n = len(order)
    gained = True
    trial, own = order.copy(), genes.copy()
    spot, route = poses.copy(), legs.copy()
    end = poses[n, 3]
    while gained and flag[0] == 0:
        gained = False
        for a in range(n - 1):
            copy_tour(0, order, genes, poses, legs, trial, own, spot, route)
            for b in range(a + 1, n):
                if flag[0] != 0:
                    break
                for m in range(a, b + 1):
                    trial[m] = order[a + b - m]
                if central:
                    there = _central(trial, own, fleet, craft, a, end, spot, route)
                else:
                    there = decode(trial, own, fleet, craft, a, False, interior, end, spot, route)
                if there < end * (1.0 - 1e-12):
                    end, gained = there, True
                    copy_tour(a, trial, own, spot, route, order, genes, poses, legs)
                # What a trial did to genes and order is undone; its path is of no use.
                copy_tour(n, order, genes, poses, legs, trial, own, spot, route)
                for m in range(a, b + 1):
                    trial[m] = order[m]


@kernel
def greedy(
    task: int, order: Ints, genes: Floats, fleet: Floats, craft: Floats, horizon: int,
    samples: int, interior: bool, flag: Flag, poses: Floats, legs: Floats,
) -> float:  # fmt: skip
    """Carry out one of the tasks; return when the tour ends, whose path is filled in.

    Parameters
    ----------
    task : int
        :data:`NEAREST`, :data:`TURN_AROUND_CENTRAL`, :data:`SAMPLE` or :data:`TURN_AROUND`.
    order, genes, fleet, craft, interior, poses, legs
        As in :func:`~.decoding.decode`; order and genes are filled or improved.
    horizon : int
        Vehicles, 1 or 2, that :data:`NEAREST` looks ahead.
    samples : int
        Samples of each boundary; with 0, :data:`NEAREST` flies towards centres.
    flag : ndarray of int8
        Not 0 asks to stop.
    """
    if task == NEAREST:
        _nearest(order, genes, fleet, craft, horizon, samples, interior, flag, poses, legs)
    elif task == SAMPLE:
        n = len(order)
        for k in range(n):
            _sample(order, k, k + 1 < n, genes, fleet, craft, samples, interior, poses, legs)
    else:
        central = task == TURN_AROUND_CENTRAL
        _two_opt(order, genes, fleet, craft, central, interior, flag, poses, legs)
    end: float = poses[len(order), 3]
    return end
