"""Optimality conditions as a boundary-value problem in the coefficients, for one order.

The optimum satisfies x^(2r) = 0 in every segment. At a knot, for every i < r, either x^(i) is given,
or x^(i) and its costate x^(2r-1-i) are continuous. If neighbours do not share x^(i), its costate is
0 on both sides. These are 2r conditions per segment for its 2r coefficients. A short, stiff segment
has small coefficients and no large stiffness in this form. Durations may therefore differ by 1e6,
for which derivatives at the knots as unknowns lose all digits in their differences.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .hermite import Outcome, Solved, moment_tables

__all__ = ["solve_boundary"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Corrections below this share of a segment's size are rounding errors, which ends refinement.
_DONE = 1e-15
_STEPS = 20
_ULP = float(np.finfo(float).eps)


@np.errstate(over="ignore", invalid="ignore")  # the outcome reports an overflow
def solve_boundary(
    durations: Floats, values: Floats, fixed: Bools, weight: float, continuity: int, floor: Floats
) -> Solved:
    """Minimise w ∫ (x^(r))² dt for axes with one pattern.

    It takes ten times as long as the Newton steps on derivatives at the knots. It is the fallback
    if those do not converge. Arguments are those of ``banded.solve_hermite``, with one pattern
    `fixed`, shape (M + 1, r). `floor` is the minimum scale of corrections of each axis, for segments
    with little motion.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    axes, knots, r = values.shape
    count, size = knots - 1, 2 * r
    # A condition is derivative `order` of segment `one` at its start (side 0) or end (1), less that at
    # the start of segment `other` for a `pair`.
    knot, i = np.indices((knots, r)).reshape(2, -1)
    held, first, last = fixed.ravel(), knot == 0, knot == count
    joined = ~first & ~last & ~held & (i <= continuity)
    apart = ~held & ~joined
    kinds = [
        (held & ~last, 0, i), (held & ~first, 1, i), (apart & ~last, 0, size - 1 - i),
        (apart & ~first, 1, size - 1 - i), (joined, 1, i), (joined, 1, size - 1 - i),
    ]  # fmt: skip
    at = np.concatenate([knot[mask] for mask, *_ in kinds])
    order = np.concatenate([which[mask] for mask, _, which in kinds])
    kind = np.repeat(np.arange(6), [np.count_nonzero(mask) for mask, *_ in kinds])
    side, pair = np.array([0, 1, 0, 1, 1, 1])[kind], kind >= 4
    item, other = at - side, np.minimum(at, count - 1)
    # Residuals use extended precision if the platform supports it.
    long = durations.astype(np.longdouble)
    least = np.where(pair, np.minimum(long[item], long[other]), long[item])
    ends = np.zeros((2, size, size), np.longdouble)
    for j in range(size):
        ends[0, j, j] = math.factorial(j)
        ends[1, j, j:] = [math.perm(p, j) for p in range(j, size)]
    mine = ends[side, order] * _power(least / long[item], order)[:, None]
    next_ = ends[0, order] * (pair * _power(least / long[other], order))[:, None]
    # Positions are relative to the previous fixed position.
    known = np.flatnonzero(fixed[:, 0])
    origin = np.zeros((count, axes), np.longdouble)
    if known.size:
        nearest = np.maximum(np.searchsorted(known, np.arange(count), "right") - 1, 0)
        origin += values[:, known[nearest], 0].T
    wanted = np.zeros((at.size, axes), np.longdouble)
    given = kind < 2
    wanted[given] = values[:, at[given], order[given]].T
    wanted -= (order == 0)[:, None] * (origin[item] - pair[:, None] * origin[other])
    wanted *= _power(least, order)[:, None]

    # Scale each unknown by its largest entry.
    place, columns = np.repeat(np.arange(at.size), size), np.arange(size)
    where = [(segment[:, None] * size + columns).ravel() for segment in (item, other)]
    entries = [mine.astype(float).ravel(), -next_.astype(float).ravel()]
    largest = np.zeros(count * size)
    for spot, entry in zip(where, entries, strict=True):
        np.maximum.at(largest, spot, np.abs(entry))
    units = 1.0 / largest
    matrix = coo_array(
        (
            np.concatenate([e * units[w] for e, w in zip(entries, where, strict=True)]),
            (np.tile(place, 2), np.concatenate(where)),
        ),
        shape=(at.size, count * size),
    ).tocsc()
    powers = np.zeros((count, size, axes), np.longdouble)
    # Moments of the r-th derivative from the powers, and the cost of their squares.
    blend = np.linalg.inv(moment_tables(r)[1])
    cost = weight * (2.0 * np.arange(r) + 1.0) * durations[:, None] ** (1.0 - 2.0 * r)
    correction, segment, gap, steps = np.inf, 0, np.inf, 0
    try:
        factors = splu(matrix)
    except RuntimeError:  # exactly singular
        steps = _STEPS + 1
    while steps <= _STEPS:
        rest = wanted - (mine[:, None] @ powers[item])[:, 0]
        rest += (next_[:, None] @ powers[other])[:, 0]
        step = factors.solve(rest.astype(float)) * units[:, None]
        step = step.reshape(count, size, axes)
        off = np.abs(step).max(axis=1)
        extent = np.abs(powers[:, 1:]).max(axis=1).astype(float) + floor
        share = np.divide(off, extent, out=np.zeros_like(off), where=off != 0)
        before, correction = correction, float(share.max())
        segment = int(share.max(axis=1).argmax())
        gap = float(np.einsum("kn,kna->", cost, (blend @ step[:, r:]) ** 2))
        if steps > 1 and not (correction > _DONE and correction < 0.5 * before):
            break
        powers += step
        steps += 1
    # Effect of rounding errors of the state on J: the costate is the derivative of J.
    state = powers.astype(float) * ends[0].diagonal().astype(float)[:, None]
    price = np.abs(state * state[:, ::-1])[:, :r].sum(axis=(1, 2)) * durations ** (1.0 - size)
    gap += 32.0 * _ULP * weight * float(price.sum())
    powers[:, 0] += origin
    moments = np.moveaxis(blend @ powers[:, r:].astype(float), 2, 0)
    objective = np.einsum("kn,akn->a", cost, moments**2)
    rates = _power(long[:, None], np.arange(r))
    jets = np.stack([(end[:r] @ powers) / rates[:, :, None] for end in ends])
    jets = np.ascontiguousarray(jets.transpose(3, 1, 0, 2), float)
    jets[:, :-1, 1, : continuity + 1] = jets[:, 1:, 0, : continuity + 1]
    for which, own in ((0, slice(None, -1)), (1, slice(1, None))):
        jets[:, :, which] = np.where(fixed[own], values[:, own], jets[:, :, which])
    certain = np.isfinite(jets).all() and correction < 1.0
    outcome = Outcome.SOLVED if certain else Outcome.ILL_CONDITIONED
    return Solved(
        jets, moments, objective, outcome, correction, segment, gap, steps - 1, 1, "boundary"
    )


def _power(base: NDArray[np.longdouble], order: NDArray[np.int64]) -> NDArray[np.longdouble]:
    """Return ``base**order`` by products, because powers of long doubles take a microsecond each."""
    result = np.ones(np.broadcast_shapes(base.shape, order.shape), np.longdouble)
    for j in range(1, int(order.max()) + 1):
        result *= np.where(order >= j, base, 1)
    return result
