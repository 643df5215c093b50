"""Kernels for the usual case: positions fixed, ends fixed, the other derivatives free.

The unknowns are the derivatives of order 1 … r-1 at the inner knots, and the Hessian is block
tridiagonal with blocks of r-1. One sweep forward eliminates the blocks (LDL', no square roots). For
all axes at once, a second one reduces the right-hand sides, and one sweep backward writes the jets,
sums up the objective and forms the gradient, which is the right-hand side of the next two sweeps. The
gradient is computed from differences of jets, which are more accurate than the entries of the
Hessian: one refinement recovers the digits lost in the elimination.

The factors of powers of 1 / T are the units of the rows. Scaling rows and columns does not change the
relative errors of an LDL' factorisation, so local times are not divided out beforehand.

The tuple `orders` = (1, …, r-1) makes r a constant of each compiled kernel, because its length belongs
to its type. The compiler then unrolls the loops over a block, which divides the time by 2 to 4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .hermite import CERTIFIED, FLOOR

__all__ = ["MOST_ORDER", "is_usual", "refined"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Orders = tuple[int, ...]

#: Highest order for which the elimination is accurate enough to be refined.
MOST_ORDER = 5
#: Smallest pivot without refinement, as a share of its diagonal entry. Coefficients are then accurate
#: to 1e-11, as measured for ratios of durations from 1 to 400.
_CALM = 1e-2
#: Smallest meaningful pivot. Below it, refinement does not converge.
_LEAST = 1e-13
#: Correction below which the next one is known to be its square and is skipped.
_QUADRATIC = 1e-5
#: Largest number of refinements, and the required ratio of consecutive corrections.
_REFINEMENTS = 5
_CONTRACTION = 0.1
_ULP = float(np.finfo(float).eps)


@kernel(interpretable=True)
def is_usual(fixed: Bools, continuity: int) -> bool:
    """Return whether only positions and the two ends are fixed; `fixed` has shape (A, M + 1, r)."""
    axes, knots, order = fixed.shape
    if continuity != order - 1:
        return False
    for a in range(axes):
        for k in range(knots):
            end = k == 0 or k == knots - 1
            if not fixed[a, k, 0]:
                return False
            for i in range(1, order):
                if fixed[a, k, i] != end:
                    return False
    return True


@kernel
def _powers(orders: Orders, duration: float, powers: Floats) -> None:
    """Fill `powers`, shape (2r,), with T to the power of the index less 2r."""
    h = 1.0 / duration
    last = 2 * len(orders) + 1
    powers[last] = h
    for i in range(last - 1, -1, -1):
        powers[i] = powers[i + 1] * h


@kernel
def _lower(orders: Orders, block: Floats, y: Floats) -> None:
    """Solve in place with the unit lower triangle of a factorised block."""
    for i in range(len(orders)):
        v = y[i]
        for m in range(i):
            v -= block[m, i] * y[m]
        y[i] = v


@kernel
def _upper(orders: Orders, block: Floats, y: Floats) -> None:
    """Solve in place with the diagonal and the upper triangle of a factorised block."""
    for i in range(len(orders) - 1, -1, -1):
        v = y[i] * block[i, i]
        for m in range(i + 1, len(orders)):
            v -= block[i, m] * y[m]
        y[i] = v


@kernel
def _eliminate(
    orders: Orders, durations: Floats, unit: Floats, blocks: Floats
) -> tuple[int, float]:
    """Fill `blocks` with couplings and factors. Return the failed knot or -1, and the least pivot."""
    count, n = durations.size, len(orders)
    r = n + 1
    before, after, y = np.empty(2 * r), np.empty(2 * r), np.empty(n)
    share = 1.0
    for i in range(n):
        for j in range(n):
            blocks[0, 0, i, j] = 0.0
    _powers(orders, durations[0], after)
    for k in range(1, count):
        coupled, coupling, block = blocks[k - 1, 0], blocks[k, 0], blocks[k, 1]
        for i in range(2 * r):
            before[i] = after[i]
        _powers(orders, durations[k], after)
        for i in range(n):
            for j in range(i + 1):
                v = unit[r + i + 1, r + j + 1] * before[i + j + 3]
                v += unit[i + 1, j + 1] * after[i + j + 3]
                for m in range(n):
                    v -= unit[m + 1, r + i + 1] * before[m + i + 3] * coupled[m, j]
                block[i, j] = v
        # L D below the diagonal, L' above, 1 / D on it.
        for i in range(n):
            for j in range(i + 1):
                v = block[i, j]
                for m in range(j):
                    v -= block[i, m] * block[m, j]
                block[i, j] = v
                if j < i:
                    block[j, i] = v * block[j, j]
            size = unit[r + i + 1, r + i + 1] * before[2 * i + 3]
            size += unit[i + 1, i + 1] * after[2 * i + 3]
            if not block[i, i] > _LEAST * size:
                return k, 0.0
            share = min(share, block[i, i] / size)
            block[i, i] = 1.0 / block[i, i]
        for j in range(n):
            for i in range(n):
                y[i] = unit[i + 1, r + j + 1] * after[i + j + 3]
            _lower(orders, block, y)
            _upper(orders, block, y)
            for i in range(n):
                coupling[i, j] = y[i]
    return -1, share


@kernel
def _begin(
    orders: Orders, durations: Floats, values: Floats, unit: Floats, jets: Floats, work: Floats, moved: Floats,
    least: Floats,
) -> None:  # fmt: skip
    """Fill `jets` with the fixed values, `work` with right-hand sides, `moved` with the last knot.

    `least` receives the size of the given values of each axis.
    """
    axes, count, n = work.shape[0], durations.size, len(orders)
    r = n + 1
    before, after = np.empty(2 * r), np.empty(2 * r)
    for a in range(axes):
        long, last, least[a] = 1.0, 1.0, 0.0
        for i in range(r):
            jets[a, 0, 0, i] = values[a, 0, i]
            jets[a, count - 1, 1, i] = values[a, count, i]
            if i > 0:
                long, last = long * durations[0], last * durations[count - 1]
                work[a, 0, i - 1], moved[a, i - 1] = values[a, 0, i], values[a, count, i]
                least[a] = max(least[a], abs(values[a, 0, i]) * long)
                least[a] = max(least[a], abs(values[a, count, i]) * last)
    _powers(orders, durations[0], after)
    for k in range(1, count):
        for i in range(2 * r):
            before[i] = after[i]
        _powers(orders, durations[k], after)
        for a in range(axes):
            here = values[a, k, 0]
            left, right = here - values[a, k - 1, 0], values[a, k + 1, 0] - here
            jets[a, k, 0, 0] = jets[a, k - 1, 1, 0] = here
            least[a] = max(least[a], max(abs(left), abs(right)))
            for i in range(n):
                v = -unit[r + i + 1, r] * before[i + 2] * left
                work[a, k, i] = v - unit[i + 1, r] * after[i + 2] * right


@kernel
def _reduce(orders: Orders, durations: Floats, unit: Floats, blocks: Floats, work: Floats) -> float:
    """Reduce the right-hand sides `work` in place. Return their product with the solution."""
    axes, count, n = work.shape[0], durations.size, len(orders)
    r = n + 1
    before, y = np.empty(2 * r), np.empty(n)
    product = 0.0
    for k in range(1, count):
        block = blocks[k, 1]
        _powers(orders, durations[k - 1], before)
        for a in range(axes):
            for i in range(n):
                v = work[a, k, i]
                for m in range(n):
                    v -= unit[m + 1, r + i + 1] * before[m + i + 3] * work[a, k - 1, m]
                y[i] = v
            _lower(orders, block, y)
            for i in range(n):
                product += y[i] * y[i] * block[i, i]
            _upper(orders, block, y)
            for i in range(n):
                work[a, k, i] = y[i]
    return product


@kernel
def _substitute(
    orders: Orders, durations: Floats, rows: Floats, factors: Floats, first: bool, again: bool, jets: Floats, blocks: Floats,
    work: Floats, moved: Floats, least: Floats, sums: Floats,
) -> tuple[float, int, float]:  # fmt: skip
    """Add the solution to `jets`, and if `again`, fill `work` with the next right-hand sides.

    `sums` receives J with its rounding remainder. Return the largest correction relative to the size
    of a segment, that segment, and the rounding error of J per unit of precision.
    """
    axes, count, n = work.shape[0], durations.size, len(orders)
    r = n + 1
    extent, up, moments = np.zeros(r), np.empty(r), np.empty(r)
    for m in range(r):
        for p in range(2 * r):
            extent[m] += abs(rows[m, p])
    # Differences and sums of the scaled jets at both ends. Each moment uses one of the two.
    pair, pull, y = np.empty((2, r)), np.zeros((axes, n)), np.empty(n)
    correction, place, rounding = 0.0, 0, 0.0
    for a in range(axes):
        sums[a, 0] = sums[a, 1] = 0.0
    for k in range(count - 1, -1, -1):
        h = 1.0 / durations[k]
        up[0], power = 1.0, h
        for i in range(n):
            up[i + 1] = up[i] * durations[k]
            power *= h * h
        coupling = blocks[k, 0]
        for a in range(axes):
            now, end = jets[a, k, 0], jets[a, k, 1]
            off = 0.0
            for i in range(n):
                v = work[a, k, i]
                for m in range(n):
                    v -= coupling[i, m] * moved[a, m]
                y[i] = v
            for i in range(n):
                if not first:
                    off = max(off, max(abs(y[i]), abs(moved[a, i])) * up[i + 1])
                moved[a, i] = y[i]
                if not (first and k == 0):
                    now[i + 1] = y[i] if first else now[i + 1] + y[i]
                if k > 0:
                    jets[a, k - 1, 1, i + 1] = now[i + 1]
            pair[0, 0] = pair[1, 0] = end[0] - now[0]
            size = abs(pair[0, 0])
            for i in range(1, r):
                late, soon = end[i] * up[i], now[i] * up[i]
                size = max(size, max(abs(late), abs(soon)))
                pair[0, i], pair[1, i] = late - soon, late + soon
            if not off <= correction * (size + FLOOR * least[a]):
                correction, place = off / (size + FLOOR * least[a]), k
            cost = 0.0
            for m in range(r):
                v = 0.0
                for i in range(n - m, r):
                    v += rows[m, r + i] * pair[(m + n - i) % 2, i]
                moments[m] = v * factors[m] * power
                cost += moments[m] * v
            _add(sums[a], cost)
            if again:
                for m in range(r):
                    rounding += abs(moments[m]) * extent[m] * size
                target = work[a, min(k + 1, count - 1)]
                _pull(orders, rows, moments, up, pull[a], target, k < count - 1)
    return correction, place, rounding


@kernel
def _pull(
    orders: Orders, rows: Floats, moments: Floats, up: Floats, pull: Floats, target: Floats,
    inner: bool,
) -> None:  # fmt: skip
    """Replace `pull` by the gradient by the start of a segment. If `inner`, fill `target`.

    `target` receives minus the gradient by the end of the segment and by the start of the next.
    """
    r = len(orders) + 1
    for i in range(r - 1):
        v, w = 0.0, 0.0
        for m in range(r - 2 - i, r):
            v += rows[m, r + i + 1] * moments[m]
            w += rows[m, i + 1] * moments[m]
        if inner:
            target[i] = -(v * up[i + 1] + pull[i])
        pull[i] = w * up[i + 1]


@kernel
def _add(own: Floats, term: float) -> None:
    """Add with compensated rounding errors (Neumaier), so that J of a million segments is exact."""
    total = own[0] + term
    if abs(own[0]) >= abs(term):
        own[1] += (own[0] - total) + term
    else:
        own[1] += (term - total) + own[0]
    own[0] = total


@kernel(interpretable=True)
def refined(
    orders: Orders, durations: Floats, values: Floats, rows: Floats, factors: Floats, certify: bool, jets: Floats,
    objective: Floats, blocks: Floats, work: Floats,
) -> tuple[int, int, float, int, float, float]:  # fmt: skip
    """Minimise ∫ (x^(r))² dt for the positions at all knots and the derivatives at the two ends.

    `rows` and `factors` are the fields of ``hermite.Table``. If `certify`, refine at least once and
    until the last correction proves the shape. `jets`, shape (A, M, 2, r), and `objective` receive
    the solution. The workspaces `blocks`, shape (M, 2, r - 1, r - 1), for the coupling of each knot
    with the next one and the factor of its block, and `work`, shape (A, M, r - 1), for right-hand
    sides are allocated by the caller, because NumPy uses large memory pages and compiled code does
    not.

    Returns
    -------
    failed : int
        Index of the knot with a pivot at rounding level, M if refinement does not converge, or -1.
    refinements : int
        Number of solves after the first one.
    correction, segment : float and int
        Largest last correction of a scaled derivative, relative to its segment's size (0 without
        refinement), and the index of that segment.
    gap, rounding : float
        J less its optimum before the last refinement, and the effect of rounding errors of the
        moments on J.
    """
    axes, count, n = work.shape[0], durations.size, len(orders)
    unit = np.zeros((2 * n + 2, 2 * n + 2))
    for m in range(n + 1):
        for p in range(2 * n + 2):
            for q in range(2 * n + 2):
                unit[p, q] += factors[m] * rows[m, p] * rows[m, q]
    failed, share = _eliminate(orders, durations, unit, blocks)
    if failed >= 0:
        return failed, 0, np.inf, failed, np.inf, np.inf
    # For each axis: solution of the knot to the right.
    moved, sums, least = np.empty((axes, n)), np.empty((axes, 2)), np.empty(axes)
    _begin(orders, durations, values, unit, jets, work, moved, least)
    again = certify or share < _CALM
    former, correction, place, gap, rounding = np.inf, 0.0, 0, 0.0, 0.0
    for attempt in range(_REFINEMENTS + 1):
        gap = _reduce(orders, durations, unit, blocks, work)
        correction, place, rounding = _substitute(
            orders,
            durations,
            rows,
            factors,
            attempt == 0,
            again,
            jets,
            blocks,
            work,
            moved,
            least,
            sums,
        )
        for a in range(axes):
            objective[a] = sums[a, 0] + sums[a, 1]
            for i in range(n):
                work[a, 0, i] = moved[a, i] = 0.0
        if attempt == 0:
            if not again:
                return -1, 0, 0.0, 0, 0.0, 0.0
            continue
        if correction <= (CERTIFIED if certify else _QUADRATIC):
            return -1, attempt, correction, place, gap, 4.0 * _ULP * rounding
        if not correction < _CONTRACTION * former:
            return count, attempt, correction, place, gap, 4.0 * _ULP * rounding
        former = correction
    return count, _REFINEMENTS, correction, place, gap, 4.0 * _ULP * rounding
