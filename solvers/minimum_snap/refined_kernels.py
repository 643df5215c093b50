"""Fused kernel per order for the usual case: positions fixed, ends fixed, the rest free.

The unknowns are the derivatives of order 1 … r-1 at the inner knots, and the Hessian is block
tridiagonal with blocks of r-1. One sweep forward assembles block row k, eliminates it (LDL', no
square roots) and reduces the right-hand sides of all axes at once. One sweep backward writes the
jets, sums up the objective and forms the gradient, which is the right-hand side of the next two
sweeps. The gradient is computed from differences of jets, which are more accurate than the entries of
the Hessian: one refinement recovers the digits lost in the elimination.

The factors of powers of 1 / T are the units of the rows. Scaling rows and columns does not change the
relative errors of an LDL' factorisation, so local times are not divided out beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .banded_kernels import add
from .hermite import CERTIFIED, FLOOR

__all__ = ["FUSED"]

Floats = NDArray[np.float64]

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


def _fused(r: int) -> Any:
    """Return the kernel of order `r`, a constant that lets the compiler unroll loops over a block."""
    n = r - 1

    @kernel(interpretable=True)
    def solve(
        durations: Floats,
        values: Floats,
        rows: Floats,
        factors: Floats,
        certify: bool,
        given: bool,
        jets: Floats,
        objective: Floats,
        blocks: Floats,
        work: Floats,
    ) -> tuple[int, int, float, int, float, float]:
        """Minimise ∫ (x^(r))² dt.

        Parameters
        ----------
        durations : ndarray, shape (M,)
            T_k, s.
        values : ndarray, shape (A, M + 1, r)
            Positions at all knots, derivatives at the two ends.
        rows, factors : ndarray
            Fields of ``tables.Table``.
        certify : bool
            Whether to refine at least once and until the last correction proves the shape.
        given : bool
            Whether `jets` already contain a solution to refine.
        jets : ndarray, shape (A, M, 2, r)
            Filled with the derivatives at the start and the end of each segment.
        objective : ndarray, shape (A,)
            Filled with J.
        blocks : ndarray, shape (M, 2, r - 1, r - 1)
            Workspace for the coupling of each knot with the next one and for the factor of its
            block. The caller allocates it, because NumPy uses large memory pages and compiled code
            does not.
        work : ndarray, shape (A, M, r - 1)
            Workspace for reduced right-hand sides.

        Returns
        -------
        failed : int
            Index of the knot with a pivot at rounding level, M if refinement does not converge, or
            -1.
        refinements : int
            Number of solves after the first one.
        correction : float
            Largest last correction of a scaled derivative, relative to its segment's size; 0
            without refinement.
        segment : int
            Index of the segment with that correction.
        gap : float
            J less its optimum before the last refinement.
        rounding : float
            Effect of rounding errors of the moments on J.
        """
        count, axes = durations.size, values.shape[0]
        unit = np.zeros((2 * r, 2 * r))
        extent = np.zeros(r)
        for m in range(r):
            for p in range(2 * r):
                extent[m] += abs(rows[m, p])
                for q in range(2 * r):
                    unit[p, q] += factors[m] * rows[m, p] * rows[m, q]
        y, up, moments = np.empty(n), np.empty(r), np.empty(r)
        before, after = np.empty(2 * r), np.empty(2 * r)
        # Differences and sums of the scaled jets at both ends. Each moment uses one of the two.
        pair = np.empty((2, r))
        # For each axis: solution of the knot to the right, and the gradient with respect to its
        # derivatives from the segment to the right.
        moved, pull = np.empty((axes, n)), np.empty((axes, n))
        sums, least = np.empty((axes, 2)), np.zeros(axes)
        share, former = 1.0, np.inf
        for attempt in range(_REFINEMENTS + 1):
            first = attempt == 0
            fill = first and not given
            correction, place, gap, rounding = 0.0, 0, 0.0, 0.0
            for a in range(axes):
                for i in range(n):
                    work[a, 0, i] = values[a, 0, i + 1] if fill else 0.0
                    moved[a, i] = values[a, count, i + 1] if fill else 0.0
                    pull[a, i] = 0.0
                if first:
                    long, last = durations[0], durations[count - 1]
                    for i in range(r):
                        if fill:
                            jets[a, 0, 0, i] = values[a, 0, i]
                            jets[a, count - 1, 1, i] = values[a, count, i]
                        if i > 0:
                            least[a] = max(least[a], abs(values[a, 0, i]) * long)
                            least[a] = max(least[a], abs(values[a, count, i]) * last)
                            long *= durations[0]
                            last *= durations[count - 1]
            for i in range(n):
                for j in range(n):
                    blocks[0, 0, i, j] = 0.0
            h = 1.0 / durations[0]
            # T to the power of the index less 2r.
            after[2 * r - 1] = h
            for i in range(2 * r - 2, -1, -1):
                after[i] = after[i + 1] * h
            for k in range(1, count):
                coupled, block, coupling = blocks[k - 1, 0], blocks[k, 1], blocks[k, 0]
                h = 1.0 / durations[k]
                for i in range(2 * r):
                    before[i] = after[i]
                after[2 * r - 1] = h
                for i in range(2 * r - 2, -1, -1):
                    after[i] = after[i + 1] * h
                if first:
                    for i in range(n):
                        for j in range(i + 1):
                            v = unit[r + i + 1, r + j + 1] * before[i + j + 3]
                            v += unit[i + 1, j + 1] * after[i + j + 3]
                            for m in range(n):
                                v -= unit[m + 1, r + i + 1] * before[m + i + 3] * coupled[m, j]
                            block[i, j] = v
                    # L D below the diagonal, L' above, 1 / D on it.
                    for i in range(n):
                        for j in range(i):
                            v = block[i, j]
                            for m in range(j):
                                v -= block[i, m] * block[m, j]
                            block[i, j] = v
                            block[j, i] = v * block[j, j]
                        v = block[i, i]
                        for m in range(i):
                            v -= block[i, m] * block[m, i]
                        size = unit[r + i + 1, r + i + 1] * before[2 * i + 3]
                        size += unit[i + 1, i + 1] * after[2 * i + 3]
                        if not v > _LEAST * size:
                            return k, 0, np.inf, k, np.inf, np.inf
                        if v < share * size:
                            share = v / size
                        block[i, i] = 1.0 / v
                    for j in range(n):
                        for i in range(n):
                            v = unit[i + 1, r + j + 1] * after[i + j + 3]
                            for m in range(i):
                                v -= block[m, i] * y[m]
                            y[i] = v
                        for i in range(n - 1, -1, -1):
                            v = y[i] * block[i, i]
                            for m in range(i + 1, n):
                                v -= block[i, m] * y[m]
                            y[i] = v
                            coupling[i, j] = v
                for a in range(axes):
                    left, right = 0.0, 0.0
                    if first:
                        here = values[a, k, 0]
                        left, right = here - values[a, k - 1, 0], values[a, k + 1, 0] - here
                        if fill:
                            jets[a, k, 0, 0] = jets[a, k - 1, 1, 0] = here
                        least[a] = max(least[a], max(abs(left), abs(right)))
                    if first and given:
                        continue
                    for i in range(n):
                        if first:
                            v = -unit[r + i + 1, r] * before[i + 2] * left
                            v -= unit[i + 1, r] * after[i + 2] * right
                        else:
                            v = -work[a, k, i]
                        for m in range(n):
                            v -= unit[m + 1, r + i + 1] * before[m + i + 3] * work[a, k - 1, m]
                        for m in range(i):
                            v -= block[m, i] * y[m]
                        y[i] = v
                    for i in range(n - 1, -1, -1):
                        v = y[i] * block[i, i]
                        gap += v * y[i]
                        for m in range(i + 1, n):
                            v -= block[i, m] * y[m]
                        y[i] = v
                        work[a, k, i] = v

            again = certify or share < _CALM
            sums[:] = 0.0
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
                    if not (first and given):
                        for i in range(n):
                            v = work[a, k, i]
                            for m in range(n):
                                v -= coupling[i, m] * moved[a, m]
                            y[i] = v
                        for i in range(n):
                            v = y[i]
                            if not first:
                                off = max(off, max(abs(v), abs(moved[a, i])) * up[i + 1])
                                v += now[i + 1]
                            moved[a, i] = y[i]
                            now[i + 1] = v
                            if k > 0:
                                jets[a, k - 1, 1, i + 1] = v
                    step = end[0] - now[0]
                    pair[0, 0] = pair[1, 0] = step
                    size = abs(step)
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
                    add(sums[a], cost)
                    if again:
                        for m in range(r):
                            rounding += abs(moments[m]) * extent[m] * size
                        for i in range(n):
                            v, w = 0.0, 0.0
                            for m in range(n - 1 - i, r):
                                v += rows[m, r + i + 1] * moments[m]
                                w += rows[m, i + 1] * moments[m]
                            if k < count - 1:
                                work[a, k + 1, i] = v * up[i + 1] + pull[a, i]
                            pull[a, i] = w * up[i + 1]
            objective[:] = sums[:, 0] + sums[:, 1]
            if not again:
                return -1, 0, 0.0, 0, 0.0, 0.0
            if not first:
                enough = CERTIFIED if certify else _QUADRATIC
                if correction <= enough:
                    return -1, attempt, correction, place, gap, 4.0 * _ULP * rounding
                if not correction < _CONTRACTION * former:
                    break
                former = correction
        return count, attempt, correction, place, gap, 4.0 * _ULP * rounding

    return solve


#: Kernel of each order.
FUSED: dict[int, Callable[..., tuple[int, int, float, int, float, float]]] = {
    order: _fused(order) for order in (2, 3, 4, 5)
}
