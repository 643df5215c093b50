"""The frontal elimination in twice the digits, for durations that differ wildly and high orders.

A short segment between long ones is nearly free to move: what holds it is smaller than its own
stiffness by powers of the ratio of durations, and its highest derivatives are what is left when the
jets at its ends cancel. Hence numbers here are unevaluated sums of two floats (Dekker 1971), where
digits would be lost: in the front, in the jets (`jets` and `lows`) and in their moments. Forces,
solutions and updates are ordinary floats: refinement makes good what they lack.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel

__all__ = [
    "factorise_precisely",
    "plus",
    "powers_of",
    "precise_coefficients",
    "precise_moments",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Pair = tuple[float, float]

#: 2^27 + 1 splits a float into two halves of 26 bits.
_SPLIT = 134217729.0


@kernel
def plus(ah: float, al: float, bh: float, bl: float) -> Pair:
    """Return a + b."""
    s = ah + bh
    t = s - ah
    e = (ah - (s - t)) + (bh - t)
    e += al + bl
    h = s + e
    return h, e - (h - s)


@kernel
def times(ah: float, al: float, bh: float, bl: float) -> Pair:
    """Return a * b."""
    p = ah * bh
    t = _SPLIT * ah
    a1 = t - (t - ah)
    a2 = ah - a1
    t = _SPLIT * bh
    b1 = t - (t - bh)
    b2 = bh - b1
    e = ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2
    e += ah * bl + al * bh
    h = p + e
    return h, e - (h - p)


@kernel
def inverse_of(ah: float, al: float) -> Pair:
    """Return 1 / a: one Newton step on the float nearby."""
    q = 1.0 / ah
    ph, pl = times(ah, al, q, 0.0)
    rh, rl = plus(1.0, 0.0, -ph, -pl)
    ch, cl = times(rh, rl, q, 0.0)
    return plus(q, 0.0, ch, cl)


@kernel
def powers_of(long: float, power: Floats, low: Floats) -> None:
    """Fill `power` and `low` with the powers of T from 0 on."""
    power[0], low[0] = 1.0, 0.0
    for i in range(1, power.size):
        power[i], low[i] = times(power[i - 1], low[i - 1], long, 0.0)


@kernel
def factorise_precisely(
    durations: Floats,
    fixed: Bools,
    grams: Floats,
    gram_lows: Floats,
    gram_weights: Floats,
    gram_orders: Ints,
    slots: Ints,
    shared: int,
    least: float,
    columns: Floats,
    pivots: Floats,
) -> int:
    """Eliminate all free entries of one pattern: see ``frontal_kernels.factorise``."""
    count, order = durations.size, fixed.shape[1]
    size = 2 * order
    front, front_low = np.zeros((size, size)), np.zeros((size, size))
    diagonal = np.zeros(size)
    unit, unit_low = np.empty(size), np.empty(size)
    column, column_low = np.empty(size), np.empty(size)
    for k in range(count + 1):
        if k < count:
            powers_of(durations[k], unit, unit_low)
            ih, il = inverse_of(durations[k], 0.0)
            for m in range(gram_orders.size):
                sh, sl = times(gram_weights[m], 0.0, durations[k], 0.0)
                for _ in range(2 * gram_orders[m]):
                    sh, sl = times(sh, sl, ih, il)
                for p in range(size):
                    i = p % order
                    if fixed[k + p // order, i]:
                        continue
                    for q in range(size):
                        j = q % order
                        if not fixed[k + q // order, j]:
                            th, tl = times(sh, sl, unit[i + j], unit_low[i + j])
                            th, tl = times(th, tl, grams[m, p, q], gram_lows[m, p, q])
                            front[p, q], front_low[p, q] = plus(
                                front[p, q], front_low[p, q], th, tl
                            )
                            if p == q:
                                diagonal[p] += th
        for p in slots:
            i = p % order
            knot = k + p // order
            pivots[k, p] = 0.0
            if knot > count or fixed[knot, i] or (k == count and i >= shared):
                continue
            if not front[p, p] > least * diagonal[p]:
                return int(knot * order + i)
            ih, il = inverse_of(front[p, p], front_low[p, p])
            pivots[k, p] = ih
            for q in range(size):
                column[q], column_low[q] = times(front[p, q], front_low[p, q], ih, il)
                columns[k, p, q] = column[q]
            columns[k, p, p] = 0.0
            for q in range(size):
                if front[p, q] != 0.0 and q != p:
                    for n in range(q, size):
                        if front[p, n] != 0.0 and n != p:
                            th, tl = times(front[p, q], front_low[p, q], column[n], column_low[n])
                            front[q, n], front_low[q, n] = plus(
                                front[q, n], front_low[q, n], -th, -tl
                            )
                            front[n, q], front_low[n, q] = front[q, n], front_low[q, n]
            for q in range(size):
                front[p, q] = front[q, p] = 0.0
                front_low[p, q] = front_low[q, p] = 0.0
        for p in range(order):
            diagonal[p] = diagonal[order + p] if p < shared else 0.0
            diagonal[order + p] = 0.0
        front[:order, :order] = front[order:, order:]
        front_low[:order, :order] = front_low[order:, order:]
        front[order:, :] = 0.0
        front[:, order:] = 0.0
        front_low[order:, :] = 0.0
        front_low[:, order:] = 0.0
    return -1


@kernel
def precise_moments(
    jet: Floats, low: Floats, rows: Floats, unit: Floats, unit_low: Floats, moments: Floats
) -> float:
    """Fill `moments` from the jet of one segment, shape (2, r); return the size of what cancels."""
    order, terms = jet.shape[1], rows.shape[0]
    moments[:] = 0.0
    size = 0.0
    lows = np.zeros(terms)
    for p in range(1, 2 * order):
        i = p % order
        h, rest = jet[p // order, i], low[p // order, i]
        if i == 0:
            h, rest = plus(h, rest, -jet[0, 0], -low[0, 0])
        h, rest = times(h, rest, unit[i], unit_low[i])
        size += abs(h)
        for n in range(terms):
            if rows[n, p] != 0.0:
                th, tl = times(h, rest, rows[n, p], 0.0)
                moments[n], lows[n] = plus(moments[n], lows[n], th, tl)
    return size


@kernel
def precise_coefficients(
    durations: Floats,
    jets: Floats,
    lows: Floats,
    rows: Floats,
    blend: Floats,
    factorials: Floats,
    coefficients: Floats,
) -> None:
    """Fill `coefficients` from jets and what rounding left of them: see ``coefficients_of``."""
    axes, count, _, order = jets.shape
    unit, unit_low = np.empty(order), np.empty(order)
    moments = np.empty(order)
    for k in range(count):
        powers_of(durations[k], unit, unit_low)
        for a in range(axes):
            precise_moments(jets[a, k], lows[a, k], rows, unit, unit_low, moments)
            for i in range(order):
                coefficients[k, i, a] = jets[a, k, 0, i] * unit[i] / factorials[i]
                total = 0.0
                for n in range(order):
                    total += blend[i, n] * moments[n]
                coefficients[k, order + i, a] = total
