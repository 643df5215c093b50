"""Kernels for any pattern of fixed and free derivatives, any weights and any continuity.

A frontal elimination: the front of segment k holds the derivatives at its two ends, 2r of them. What
belongs to this segment alone (the derivatives beyond the continuity, at both ends) is eliminated
first, then what the start shares with the segment before; what is left of the end is carried to the
next front. Fixed entries are never pivots. One factor serves all axes of one pattern.

Solving is Newton's method on a quadratic from any start, so that refinement is the same step again:
the gradient is recomputed from the Legendre moments of the jets, which keeps its digits where the
products of Hessian and jets would lose them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from .precise_kernels import plus, powers_of, precise_moments

__all__ = ["begin", "descend", "factorise"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@kernel
def begin(values: Floats, fixed: Bools, axes: Ints, jets: Floats) -> None:
    """Fill `jets` with what is fixed; free positions take the fixed one before, the rest is 0."""
    knots, order = fixed.shape
    for a in axes:
        held = 0.0
        for k in range(knots - 1, -1, -1):
            if fixed[k, 0]:
                held = values[a, k, 0]
        for k in range(knots):
            for i in range(order):
                if fixed[k, i]:
                    entry = values[a, k, i]
                    if i == 0:
                        held = entry
                else:
                    entry = held if i == 0 else 0.0
                if k < knots - 1:
                    jets[a, k, 0, i] = entry
                if k > 0:
                    jets[a, k - 1, 1, i] = entry


@kernel
def factorise(
    durations: Floats,
    fixed: Bools,
    grams: Floats,
    gram_weights: Floats,
    gram_orders: Ints,
    slots: Ints,
    shared: int,
    least: float,
    columns: Floats,
    pivots: Floats,
) -> int:
    """Eliminate all free entries of one pattern.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k.
    fixed : ndarray of bool, shape (M + 1, r)
        The pattern.
    grams, gram_weights, gram_orders : ndarray
        See ``hermite.Table``.
    slots : ndarray of int
        Places of a front (0 … r-1 start, r … 2r-1 end) in the order of elimination.
    shared : int
        How many derivatives neighbours share: continuity + 1.
    least : float
        A pivot must exceed this share of the diagonal before elimination.
    columns : ndarray, shape (M + 1, 2r, 2r)
        Filled: row p of front k holds what remains of the pivot's row, divided by it.
    pivots : ndarray, shape (M + 1, 2r)
        Filled with the inverse pivots, 0 where there is none.

    Returns
    -------
    int
        -1, or ``knot * r + order`` of the pivot that failed.
    """
    count, order = durations.size, fixed.shape[1]
    size = 2 * order
    front = np.zeros((size, size))
    diagonal = np.zeros(size)
    unit = np.empty(order)
    for k in range(count + 1):
        if k < count:
            long = durations[k]
            unit[0] = 1.0
            for i in range(1, order):
                unit[i] = unit[i - 1] * long
            for m in range(gram_orders.size):
                scale = gram_weights[m] * long
                for _ in range(gram_orders[m]):
                    scale /= long * long
                for p in range(size):
                    i = p % order
                    if fixed[k + p // order, i]:
                        continue
                    row = scale * unit[i]
                    for q in range(size):
                        j = q % order
                        if not fixed[k + q // order, j]:
                            front[p, q] += row * unit[j] * grams[m, p, q]
                    diagonal[p] += row * unit[i] * grams[m, p, p]
        for p in slots:
            i = p % order
            knot = k + p // order
            pivots[k, p] = 0.0
            # The last front has no segment: what its knot does not share is done already.
            if knot > count or fixed[knot, i] or (k == count and i >= shared):
                continue
            pivot = front[p, p]
            if not pivot > least * diagonal[p]:
                return int(knot * order + i)
            inverse = 1.0 / pivot
            pivots[k, p] = inverse
            column = columns[k, p]
            for q in range(size):
                column[q] = front[p, q] * inverse
            column[p] = 0.0
            for q in range(size):
                share = front[q, p]
                if share != 0.0 and q != p:
                    for n in range(size):
                        front[q, n] -= share * column[n]
            for q in range(size):
                front[p, q] = 0.0
                front[q, p] = 0.0
        for p in range(order):
            diagonal[p] = diagonal[order + p] if p < shared else 0.0
            diagonal[order + p] = 0.0
            for q in range(order):
                front[p, q] = front[order + p, order + q]
                front[order + p, order + q] = 0.0
                front[p, order + q] = 0.0
                front[order + p, q] = 0.0
    return -1


@kernel
def descend(
    durations: Floats,
    fixed: Bools,
    rows: Floats,
    factors: Floats,
    orders: Ints,
    slots: Ints,
    shared: int,
    columns: Floats,
    pivots: Floats,
    axes: Ints,
    jets: Floats,
    lows: Floats,
    objective: Floats,
    tolerance: float,
    most: int,
) -> tuple[float, int]:
    """Take Newton steps from `jets` until the jumps are rounding.

    Parameters
    ----------
    rows, factors, orders : ndarray
        See ``hermite.Table``.
    axes : ndarray of int
        The axes of this pattern.
    jets : ndarray, shape (A, M, 2, r)
        Changed in place; fixed entries stay as they are.
    lows : ndarray, shape (A, M, 2, r)
        What rounding leaves of `jets`, changed in place; with no axes, jets are ordinary floats.
    objective : ndarray, shape (A,)
        Filled with J of the jets returned.
    tolerance : float
        Residual at which to stop.
    most : int
        Steps after which to stop.

    Other parameters are those of :func:`factorise`.

    Returns
    -------
    residual : float
        Worst jump of a derivative, relative to its largest value on the axis.
    steps : int
        Newton steps taken.
    """
    count, order = durations.size, fixed.shape[1]
    size, terms, wide = 2 * order, rows.shape[0], axes.size
    precise = lows.shape[0] > 0
    # Jumps so small beside the jets at their ends are no information.
    floor = 1e-28 if precise else 0.0
    # The first steps may stand still where the solution is far from the start.
    patience = 4 if precise else 1
    reduced = np.zeros((count + 1, wide, size))
    raw, carried = np.zeros((wide, order)), np.zeros((wide, order))
    jumps, sizes, bounds = (
        np.zeros((wide, order)),
        np.zeros((wide, order)),
        np.zeros((wide, order)),
    )
    sums = np.zeros((wide, 2))
    unit, unit_low, scaled = np.empty(order), np.empty(order), np.zeros(size)
    side, gradient, change = np.empty(size), np.empty(size), np.zeros((wide, size))
    scales, moments, strength = np.empty(terms), np.empty(terms), np.empty(order)
    before = np.inf
    steps = 0
    while True:
        for sum_of in (raw, carried, jumps, sizes, bounds, sums):
            sum_of[:] = 0.0
        for k in range(count + 1):
            if k < count:
                powers_of(durations[k], unit, unit_low)
                strength[:] = 0.0
                for n in range(terms):
                    if n > 0 and orders[n] == orders[n - 1]:
                        scales[n] = scales[n - 1] / factors[n - 1] * factors[n]
                    else:
                        scales[n] = factors[n] * durations[k]
                        for _ in range(orders[n]):
                            scales[n] /= durations[k] * durations[k]
                    largest = np.abs(rows[n]).max()
                    for p in range(size):
                        part = scales[n] * unit[p % order] * abs(rows[n, p]) * largest
                        strength[p % order] += part
            for b in range(wide):
                a = axes[b]
                side[:] = 0.0
                if k < count:
                    jet = jets[a, k]
                    if precise:
                        amount = precise_moments(jet, lows[a, k], rows, unit, unit_low, moments)
                    else:
                        for i in range(1, order):
                            scaled[i] = jet[0, i] * unit[i]
                            scaled[order + i] = jet[1, i] * unit[i]
                        scaled[order] = jet[1, 0] - jet[0, 0]
                        amount = np.abs(scaled).sum()
                        for n in range(terms):
                            moments[n] = 0.0
                            for p in range(1, size):
                                moments[n] += rows[n, p] * scaled[p]
                    for n in range(terms):
                        force = scales[n] * moments[n]
                        term = force * moments[n]
                        total = sums[b, 0] + term
                        if sums[b, 0] >= term:
                            sums[b, 1] += (sums[b, 0] - total) + term
                        else:
                            sums[b, 1] += (term - total) + sums[b, 0]
                        sums[b, 0] = total
                        for p in range(size):
                            side[p] += force * rows[n, p]
                    for i in range(order):
                        side[i] *= unit[i]
                        side[order + i] *= unit[i]
                        bounds[b, i] = max(bounds[b, i], strength[i] * amount)
                    # A derivative may vanish at all knots: its terms say how large it is between.
                    for n in range(terms):
                        for i in range(order):
                            part = abs(scales[n] * moments[n] * rows[n, i]) * unit[i]
                            sizes[b, i] = max(sizes[b, i], part)
                for i in range(order):
                    if i < shared:
                        if not fixed[k, i]:
                            jumps[b, i] = max(jumps[b, i], abs(raw[b, i] + side[i]))
                        raw[b, i] = side[order + i]
                    elif k < count:
                        if not fixed[k, i]:
                            jumps[b, i] = max(jumps[b, i], abs(side[i]))
                        if not fixed[k + 1, i]:
                            jumps[b, i] = max(jumps[b, i], abs(side[order + i]))
                    gradient[i] = side[i] + carried[b, i]
                    gradient[order + i] = side[order + i]
                for p in slots:
                    if pivots[k, p] != 0.0:
                        share = gradient[p]
                        reduced[k, b, p] = share * pivots[k, p]
                        for q in range(size):
                            gradient[q] -= columns[k, p, q] * share
                for i in range(order):
                    carried[b, i] = gradient[order + i] if i < shared else 0.0
        residual = progress = 0.0
        for b in range(wide):
            objective[axes[b]] = sums[b, 0] + sums[b, 1]
            for i in range(order):
                if jumps[b, i] > floor * bounds[b, i]:
                    residual = max(residual, jumps[b, i] / sizes[b, i])
                    # Where a derivative vanishes, jumps and sizes shrink alike.
                    progress = max(progress, jumps[b, i] / bounds[b, i])
        if (
            residual <= tolerance
            or steps == most
            or (steps > patience and not progress < 0.5 * before)
        ):
            return residual, steps
        before = progress
        steps += 1
        change[:] = 0.0
        for k in range(count, -1, -1):
            for b in range(wide):
                a, moved = axes[b], change[b]
                for i in range(order):
                    moved[order + i] = moved[i] if i < shared else 0.0
                    moved[i] = 0.0
                for n in range(slots.size - 1, -1, -1):
                    p = slots[n]
                    if pivots[k, p] != 0.0:
                        total = -reduced[k, b, p]
                        for q in range(size):
                            total -= columns[k, p, q] * moved[q]
                        moved[p] = total
                if k < count:
                    for p in range(size):
                        s, i = p // order, p % order
                        if precise:
                            jets[a, k, s, i], lows[a, k, s, i] = plus(
                                jets[a, k, s, i], lows[a, k, s, i], moved[p], 0.0
                            )
                        else:
                            jets[a, k, s, i] += moved[p]
