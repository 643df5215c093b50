"""Compiled iterations of the structured interior point, based on :mod:`.chain_kernels`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .chain_kernels import (
    advance,
    bound_gradient,
    factorise,
    hold_still,
    largest_of,
    multiply,
    newton_step,
    row_values,
    times,
    transposed,
)

__all__ = ["CONVERGED", "STALLED", "STOPPED", "interior_point"]

CONVERGED, STALLED, STOPPED = 0, 1, 2

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@kernel
def interior_point(
    cost: Floats, rows: Floats, start: Ints, lower: Floats, upper: Floats, fixed: Flags,
    knots: Floats, inner: Floats, below: Floats, above: Floats, z_below: Floats, z_above: Floats,
    gap_target: float, tolerance: float, most: int, nothing: float, flag: NDArray[np.int8],
) -> tuple[int, int, float, float, float, float]:  # fmt: skip
    """Run Mehrotra's predictor-corrector method from the given iterate, which is updated in place.

    Minimise ``|cost @ y|² / 2`` subject to ``lower <= rows @ y <= upper``. Slacks `below` and
    `above` and multipliers `z_below` and `z_above` are positive on entry; those of infinite bounds
    are 1 and 0. Gaps are relative to the objective, or to `nothing` if that is larger.

    Returns
    -------
    tuple
        Status, iterations, objective, complementarity (the sum of slack times multiplier), largest
        primal residual, largest dual residual.
    """
    count, _, width = cost.shape
    n = fixed.shape[1]
    own = width - 2 * n
    size = rows.shape[0]
    has_low, has_high = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    pairs = 0
    for q in range(size):
        has_low[q], has_high[q] = lower[q] > -np.inf, upper[q] < np.inf
        pairs += int(has_low[q]) + int(has_high[q])
    pairs = max(pairs, 1)
    factors = np.zeros((count, own + n, width))
    last = np.zeros((n, n))
    weight = np.zeros(size)
    status, objective, comp, primal, dual = STALLED, 0.0, 0.0, 0.0, 0.0
    best = np.inf
    idle = 0
    done = 0
    for iteration in range(most):
        done = iteration
        if flag[0] != 0:
            status = STOPPED
            break
        value = multiply(cost, knots, inner)
        objective = 0.0
        for k in range(count):
            for i in range(cost.shape[1]):
                objective += value[k, i] * value[k, i]
        objective *= 0.5
        at = row_values(rows, start, knots, inner)
        g_knots, g_inner = np.zeros(knots.shape), np.zeros(inner.shape)
        transposed(cost, value, g_knots, g_inner)
        pull = np.zeros(size)
        for q in range(size):
            pull[q] = z_above[q] - z_below[q]
        bound_gradient(rows, start, pull, g_knots, g_inner)
        hold_still(fixed, g_knots)
        dual = max(largest_of(g_knots), largest_of(g_inner))
        r_low, r_high = np.zeros(size), np.zeros(size)
        comp, primal, largest = 0.0, 0.0, 1.0
        for q in range(size):
            if has_low[q]:
                r_low[q] = at[q] - lower[q] - below[q]
                comp += below[q] * z_below[q]
                primal = max(primal, abs(r_low[q]))
                largest = max(largest, z_below[q])
            if has_high[q]:
                r_high[q] = upper[q] - at[q] - above[q]
                comp += above[q] * z_above[q]
                primal = max(primal, abs(r_high[q]))
                largest = max(largest, z_above[q])
        mu = comp / pairs
        if largest > 1e100:  # a ray of an infeasible problem, or no free coordinate
            break
        size_of = max(objective, nothing)
        merit = max(comp / size_of, primal, dual / largest)
        if comp <= gap_target * size_of and primal <= tolerance and dual <= tolerance * largest:
            status = CONVERGED
            break
        if merit < 0.9 * best:
            best, idle = merit, 0
        else:
            idle += 1
            if idle > 15:
                break
        for q in range(size):
            d = 0.0
            if has_low[q]:
                d += z_below[q] / below[q]
            if has_high[q]:
                d += z_above[q] / above[q]
            weight[q] = np.sqrt(d)
        factorise(cost, rows, start, weight, fixed, factors, last)
        # Predictor: no centring, no second-order term.
        c_low, c_high = np.zeros(size), np.zeros(size)
        for q in range(size):
            c_low[q], c_high[q] = below[q] * z_below[q], above[q] * z_above[q]
        a_low, a_high = np.zeros(size), np.zeros(size)
        b_low, b_high = np.zeros(size), np.zeros(size)
        sigma = 0.0
        alpha = 0.0
        x_knots, x_inner = knots, inner
        for phase in range(2):
            for q in range(size):
                pull[q] = 0.0
                if has_low[q]:
                    pull[q] -= (c_low[q] + z_below[q] * r_low[q]) / below[q]
                if has_high[q]:
                    pull[q] += (c_high[q] + z_above[q] * r_high[q]) / above[q]
            b_knots, b_inner = times(-1.0, g_knots), times(-1.0, g_inner)
            bound_gradient(rows, start, pull, b_knots, b_inner)
            hold_still(fixed, b_knots)
            x_knots, x_inner = newton_step(
                cost, rows, start, weight, fixed, factors, last, b_knots, b_inner
            )
            step = row_values(rows, start, x_knots, x_inner)
            alpha = 1.0
            limit = 1.0 if phase == 0 else 0.995
            for q in range(size):
                if has_low[q]:
                    a_low[q] = step[q] + r_low[q]
                    b_low[q] = -(c_low[q] + z_below[q] * a_low[q]) / below[q]
                    if a_low[q] < 0:
                        alpha = min(alpha, -limit * below[q] / a_low[q])
                    if b_low[q] < 0:
                        alpha = min(alpha, -limit * z_below[q] / b_low[q])
                if has_high[q]:
                    a_high[q] = -step[q] + r_high[q]
                    b_high[q] = -(c_high[q] + z_above[q] * a_high[q]) / above[q]
                    if a_high[q] < 0:
                        alpha = min(alpha, -limit * above[q] / a_high[q])
                    if b_high[q] < 0:
                        alpha = min(alpha, -limit * z_above[q] / b_high[q])
            if phase == 0:
                ahead = 0.0
                for q in range(size):
                    if has_low[q]:
                        ahead += (below[q] + alpha * a_low[q]) * (z_below[q] + alpha * b_low[q])
                    if has_high[q]:
                        ahead += (above[q] + alpha * a_high[q]) * (z_above[q] + alpha * b_high[q])
                ratio = ahead / max(comp, 1e-300)
                sigma = ratio * ratio * ratio
                for q in range(size):
                    if has_low[q]:
                        c_low[q] += a_low[q] * b_low[q] - sigma * mu
                    if has_high[q]:
                        c_high[q] += a_high[q] * b_high[q] - sigma * mu
        advance(knots, alpha, x_knots)
        advance(inner, alpha, x_inner)
        for q in range(size):
            if has_low[q]:
                below[q] += alpha * a_low[q]
                z_below[q] += alpha * b_low[q]
            if has_high[q]:
                above[q] += alpha * a_high[q]
                z_above[q] += alpha * b_high[q]
        done = iteration + 1
    return status, done, objective, comp, primal, dual
