"""Gradient of the objective with respect to the derivatives at the knots, via Legendre moments.

A short segment between long ones is nearly free to move, and its highest derivatives are small
differences of the jets at its ends. Jets and the sums in their moments are therefore unevaluated
sums of two floats (Dekker, "A floating-point technique for extending the available precision",
Numerische Mathematik 18, 1971). The same applies to forces, whose differences act on the knots.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["blend", "differentiate"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Pair = tuple[float, float]

#: 2^27 + 1 splits a float into two halves of 26 bits (Dekker 1971).
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
def times(ah: float, al: float, b: float) -> Pair:
    """Return a * b."""
    p = ah * b
    t = _SPLIT * ah
    a1 = t - (t - ah)
    a2 = ah - a1
    t = _SPLIT * b
    b1 = t - (t - b)
    b2 = b - b1
    e = ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2
    e += al * b
    h = p + e
    return h, e - (h - p)


@kernel(interpretable=True)
def differentiate(
    durations: Floats,
    rows: Floats,
    factors: Floats,
    orders: Ints,
    jets: Floats,
    lows: Floats,
    forces: Floats,
    rests: Floats,
    moments: Floats,
    objective: Floats,
) -> None:
    """Compute the cost of the jets and half its gradient.

    `rows`, `factors` and `orders` are the fields of ``hermite.Table``, and `lows` the rounding
    remainders of `jets`. `forces` and `rests`, shape (A, M, 2, r), receive half the derivative of J
    with respect to each and its rounding remainder, `moments`, shape (A, M, N), the moments for the
    rows of the table, and `objective` J of each axis.
    """
    axes, count, _, order = jets.shape
    size, terms = 2 * order, rows.shape[0]
    power, low, scales = np.empty(order), np.empty(order), np.empty(terms)
    low_moments, pull, low_pull = np.empty(terms), np.empty(terms), np.empty(terms)
    sums = np.zeros((axes, 2))
    for k in range(count):
        power[0], low[0] = 1.0, 0.0
        for i in range(1, order):
            power[i], low[i] = times(power[i - 1], low[i - 1], durations[k])
        for n in range(terms):
            scales[n] = factors[n] * durations[k]
            for _ in range(orders[n]):
                scales[n] /= durations[k] * durations[k]
        for a in range(axes):
            own, rest = jets[a, k], lows[a, k]
            moments[a, k], low_moments[:] = 0.0, 0.0
            # Positions are relative to the start of the segment, so the first entry is 0.
            for p in range(1, size):
                i = p % order
                d, e = own[p // order, i], rest[p // order, i]
                if i == 0:
                    d, e = plus(d, e, -own[0, 0], -rest[0, 0])
                yh, yl = times(d, e, power[i])
                yh, yl = plus(yh, yl, d * low[i], 0.0)
                for n in range(terms):
                    if rows[n, p] != 0.0:
                        th, tl = times(yh, yl, rows[n, p])
                        moments[a, k, n], low_moments[n] = plus(
                            moments[a, k, n], low_moments[n], th, tl
                        )
            for n in range(terms):
                high = moments[a, k, n]
                pull[n], low_pull[n] = times(high, low_moments[n], scales[n])
                sums[a, 0], sums[a, 1] = plus(sums[a, 0], sums[a, 1], pull[n] * high, 0.0)
            for p in range(size):
                fh, fl = 0.0, 0.0
                for n in range(terms):
                    if rows[n, p] != 0.0:
                        th, tl = times(pull[n], low_pull[n], rows[n, p])
                        fh, fl = plus(fh, fl, th, tl)
                i, end = p % order, p // order
                th, tl = times(fh, fl, power[i])
                forces[a, k, end, i], rests[a, k, end, i] = plus(th, tl, fh * low[i], 0.0)
    for a in range(axes):
        objective[a] = sums[a, 0] + sums[a, 1]


@kernel(interpretable=True)
def blend(
    durations: Floats,
    jets: Floats,
    moments: Floats,
    rows: Floats,
    powers: Floats,
    factorials: Floats,
    coefficients: Floats,
) -> None:
    """Fill `coefficients`, shape (M, 2r, A), with the tables of ``hermite.moment_tables``.

    `moments`, shape (A, M, r), are those of the r-th derivative. If A is 0, they are computed from
    the jets.
    """
    axes, count, _, order = jets.shape
    given = moments.shape[0] > 0
    scaled, own = np.zeros(2 * order), np.empty(order)
    for k in range(count):
        for a in range(axes):
            unit = 1.0
            for i in range(order):
                scaled[i] = jets[a, k, 0, i] * unit
                scaled[order + i] = jets[a, k, 1, i] * unit
                coefficients[k, i, a] = scaled[i] / factorials[i]
                unit *= durations[k]
            scaled[order] -= scaled[0]
            for n in range(order):
                total = 0.0
                if given:
                    total = moments[a, k, n]
                else:
                    for p in range(1, 2 * order):
                        total += rows[n, p] * scaled[p]
                own[n] = total
            for i in range(order):
                total = 0.0
                for n in range(i, order):
                    total += powers[i, n] * own[n]
                coefficients[k, order + i, a] = total
