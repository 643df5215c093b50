"""The paper's memetic algorithm (Algorithm 3), one generation a call.

Only :func:`evolve` is called from outside, for every kernel that is takes as long to compile as all
that it calls.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import copy_tour, decode
from .local_search import descend, resample
from .sequences import cross, move, shuffle
from .transformation import transform

__all__ = ["Tour", "evolve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]
Rng = np.random.Generator


class Tour(NamedTuple):
    """An order, its genes, and its path (see :mod:`.decoding`)."""

    order: Ints
    genes: Floats
    poses: Floats
    legs: Floats


@kernel
def _draw(genes: Floats, i: int, interior: bool, rng: Rng) -> None:
    """Draw where vehicle `i` is met, at its first interception."""
    genes[i, 0] = 2.0 * math.pi * rng.random()
    genes[i, 1] = 0.0
    genes[i, 2] = math.sqrt(rng.random()) if interior else 1.0


@kernel
def _settle(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, timed: bool, transformed: bool,
    interior: bool, flag: Flag, poses: Floats, legs: Floats,
) -> float:  # fmt: skip
    """Decode, repair and transform an individual; return when its tour ends."""
    end = decode(order, genes, fleet, craft, 0, timed, interior, math.inf, poses, legs)
    if transformed and end < math.inf:
        transform(order, genes, fleet, craft, timed, interior, flag, poses, legs)
        end = poses[len(order), 3]
    return end


@kernel
def _record(
    order: Ints, genes: Floats, end: float, poses: Floats, legs: Floats, best: Tour
) -> None:
    """Keep an individual that ends sooner than the best, with the path that was flown.

    Its genes may decode to another path: where a point lies on a turning circle, as it does when an
    encounter is moved onto a turn, rounding decides whether it is reached at once.
    """
    if end < best.poses[len(order), 3]:
        copy_tour(0, order, genes, poses, legs, best.order, best.genes, best.poses, best.legs)


@kernel
def _populate(
    orders: Ints, genes: Floats, ends: Floats, fleet: Floats, craft: Floats, transformed: bool,
    interior: bool, rng: Rng, flag: Flag, poses: Floats, legs: Floats, best: Tour,
) -> None:  # fmt: skip
    """Fill a population; where it is stopped, the first individual at least is decoded."""
    for p in range(len(ends)):
        ends[p] = math.inf
        shuffle(orders[p], rng)
        for i in range(len(fleet)):
            _draw(genes[p], i, interior, rng)
        if p == 0 or flag[0] == 0:
            ends[p] = _settle(
                orders[p], genes[p], fleet, craft, True, transformed, interior, flag, poses, legs
            )
            _record(orders[p], genes[p], ends[p], poses, legs, best)


@kernel
def _mutate(order: Ints, genes: Floats, rate: float, interior: bool, rng: Rng) -> None:
    """Apply the three mutations, each with probability `rate`: sequence, direction, time."""
    n = len(order)
    if rng.random() < rate:
        a, b = int(rng.random() * n), int(rng.random() * n)
        if rng.random() < 0.5:
            order[a], order[b] = order[b], order[a]
        else:
            move(order, a, 1, b)
    if rng.random() < rate:
        i = int(rng.random() * n)
        interval = genes[i, 1]
        _draw(genes, i, interior, rng)
        genes[i, 1] = interval
    if rng.random() < rate:
        genes[int(rng.random() * n), 1] *= 2.0 * rng.random()


@kernel
def _rival(ends: Floats, rng: Rng) -> int:
    """Return the better of two drawn individuals."""
    a, b = int(rng.random() * len(ends)), int(rng.random() * len(ends))
    return a if ends[a] <= ends[b] else b


@kernel
def _survive(
    orders: Ints, genes: Floats, ends: Floats, kids: Ints, kid_genes: Floats, kid_ends: Floats
) -> None:
    """Keep the best of parents and children, best first, twins only where there are no others."""
    size = len(ends)
    every = np.concatenate((ends, kid_ends))
    ranks = np.argsort(every, kind="mergesort")
    picked, count = np.empty(2 * size, np.int64), 0
    for twins in (False, True):
        for m in range(2 * size):
            twin = m > 0 and every[ranks[m]] <= every[ranks[m - 1]] * (1.0 + 1e-12)
            if twin == twins:
                picked[count] = ranks[m]
                count += 1
    old_orders, old_genes = orders.copy(), genes.copy()
    for p in range(size):
        q = picked[p]
        ends[p] = every[q]
        if q < size:
            orders[p], genes[p] = old_orders[q], old_genes[q]
        else:
            orders[p], genes[p] = kids[q - size], kid_genes[q - size]


@kernel
def _breed(
    orders: Ints, genes: Floats, ends: Floats, fleet: Floats, craft: Floats, rate: float,
    timed: bool, transformed: bool, interior: bool, rng: Rng, flag: Flag, poses: Floats,
    legs: Floats, best: Tour,
) -> None:  # fmt: skip
    """Breed as many children as there are individuals, and keep the best of all, best first."""
    kids, kid_genes = orders.copy(), genes.copy()
    kid_ends = np.full(len(ends), math.inf)
    for p in range(len(ends)):
        if flag[0] != 0:
            break
        one, two = _rival(ends, rng), _rival(ends, rng)
        cross(orders[one], genes[one], orders[two], genes[two], kids[p], kid_genes[p], rng)
        _mutate(kids[p], kid_genes[p], rate, interior, rng)
        kid_ends[p] = _settle(
            kids[p], kid_genes[p], fleet, craft, timed, transformed, interior, flag, poses, legs
        )
        _record(kids[p], kid_genes[p], kid_ends[p], poses, legs, best)
    _survive(orders, genes, ends, kids, kid_genes, kid_ends)


@kernel
def _refine(
    orders: Ints, genes: Floats, ends: Floats, fleet: Floats, craft: Floats, count: int,
    gradient: bool, step: float, samples: int, tolerance: float, interior: bool, rng: Rng,
    flag: Flag, poses: Floats, legs: Floats, best: Tour,
) -> None:  # fmt: skip
    """Apply the local searches to the first `count` individuals."""
    for p in range(count):
        if flag[0] != 0:
            break
        order, own = orders[p], genes[p]
        decode(order, own, fleet, craft, 0, True, interior, math.inf, poses, legs)
        if gradient:
            descend(order, own, fleet, craft, interior, step, tolerance, flag, poses, legs)
        if samples > 0:
            resample(order, own, fleet, craft, interior, samples, tolerance, rng, flag, poses, legs)
        ends[p] = poses[len(order), 3]
        _record(order, own, ends[p], poses, legs, best)


@kernel
def evolve(
    number: int, orders: Ints, genes: Floats, ends: Floats, fleet: Floats, craft: Floats,
    rate: float, timed: bool, transformed: bool, interior: bool, elite: int, gradient: bool,
    step: float, samples: int, tolerance: float, rng: Rng, flag: Flag, best: Tour,
) -> float:  # fmt: skip
    """Make the first population, or the next one; return when the best tour so far ends (s).

    Parameters
    ----------
    number : int
        0 for the first population.
    orders, genes, ends : ndarray, shapes (p, n), (p, n, 3), (p,)
        The individuals and when their tours end (s); inf for those that were not decoded.
    fleet, craft : ndarray
        The problem (see :mod:`.decoding`).
    rate : float
        Probability of each mutation (paper: p_m).
    timed, transformed, interior : bool
        Whether intervals are genes, Algorithm 4 is applied, encounters inside of discs count.
    elite : int
        The number of individuals to which the local searches are applied; 0 for none.
    gradient, step, samples, tolerance
        What they do (see :mod:`.local_search`); with 0 `samples`, SS is left out.
    rng, flag
        What draws, and what asks to stop.
    best : Tour
        The best tour so far and its path; updated. Its first pose is the start, and the time of its
        last one inf before there is a tour.
    """
    poses, legs = best.poses.copy(), best.legs.copy()
    if number == 0:
        _populate(
            orders, genes, ends, fleet, craft, transformed, interior, rng, flag, poses, legs, best
        )
    else:
        _breed(
            orders, genes, ends, fleet, craft, rate, timed, transformed, interior, rng, flag,
            poses, legs, best,
        )  # fmt: skip
        _refine(
            orders, genes, ends, fleet, craft, elite, gradient, step, samples, tolerance,
            interior, rng, flag, poses, legs, best,
        )  # fmt: skip
    end: float = best.poses[len(fleet), 3]
    return end
