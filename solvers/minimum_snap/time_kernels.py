"""Compiled Newton steps for the barrier problem of one group of axes at given durations."""

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
    rescale,
    row_values,
    times,
    transposed,
)
from .time_rows import knot_scales, pose, slopes

__all__ = ["HALTED", "SETTLED", "UNSETTLED", "centre", "evaluate"]

SETTLED, UNSETTLED, HALTED = 0, 1, 2

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@kernel
def cold_start(
    cost: Floats, rows: Floats, start: Ints, lower: Floats, upper: Floats, fixed: Flags,
    knots: Floats, inner: Floats,
) -> None:  # fmt: skip
    """Move `knots` and `inner` to a smooth path near the middle of the bounds."""
    count, c, width = cost.shape
    n = fixed.shape[1]
    typical = 0.0
    for k in range(count):
        for i in range(c):
            square = 0.0
            for j in range(width):
                square += cost[k, i, j] * cost[k, i, j]
            typical = max(typical, np.sqrt(square))
    typical = max(typical, 1e-300)
    scaled = np.empty(cost.shape)
    for k in range(count):
        for i in range(c):
            for j in range(width):
                scaled[k, i, j] = cost[k, i, j] / typical
    target, weight = np.zeros(rows.shape[0]), np.ones(rows.shape[0])
    for q in range(rows.shape[0]):
        low, high = lower[q] > -np.inf, upper[q] < np.inf
        if low and high:
            target[q] = 0.5 * (lower[q] + upper[q])
        else:
            target[q] = lower[q] if low else upper[q]
    factors, last = np.zeros((count, width - n, width)), np.zeros((n, n))
    factorise(scaled, rows, start, weight, fixed, factors, last)
    b_knots, b_inner = np.zeros(knots.shape), np.zeros(inner.shape)
    transposed(scaled, times(-1.0, multiply(scaled, knots, inner)), b_knots, b_inner)
    at = row_values(rows, start, knots, inner)
    for q in range(at.size):
        target[q] -= at[q]
    bound_gradient(rows, start, target, b_knots, b_inner)
    hold_still(fixed, b_knots)
    x_knots, x_inner = newton_step(
        scaled, rows, start, weight, fixed, factors, last, b_knots, b_inner
    )
    advance(knots, 1.0, x_knots)
    advance(inner, 1.0, x_inner)


@kernel
def centre(
    cost: Floats, rows: Floats, start: Ints, lower: Floats, upper: Floats, fixed: Flags,
    knots: Floats, inner: Floats, below: Floats, above: Floats, z_below: Floats, z_above: Floats,
    room_low: Floats, room_high: Floats, mu: float, accuracy: float, most: int,
    flag: NDArray[np.int8],
) -> tuple[int, int, float, float]:  # fmt: skip
    """Minimise ``|cost @ y|² / 2 - mu Σ log slack`` by primal-dual Newton steps, in place.

    The barrier parameter `mu` is constant, so that the value is a smooth function of the durations
    and a few steps lead to the solution for similar durations.

    Parameters
    ----------
    room_low, room_high : ndarray, shape (Q,)
        Largest violations of the bounds, in the normalised rows.
    accuracy : float
        Largest relative error of slack times multiplier, and of the gradient.
    most : int
        Largest number of Newton steps. Without convergence, the bounds are treated as infeasible.

    Returns
    -------
    tuple
        Status, steps, largest violation relative to the allowed one, largest entry of the gradient.
    """
    count, _, width = cost.shape
    n = fixed.shape[1]
    own = width - 2 * n
    size = rows.shape[0]
    factors, last = np.zeros((count, own + n, width)), np.zeros((n, n))
    weight, pull = np.zeros(size), np.zeros(size)
    a_low, a_high, b_low, b_high = (
        np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size),
    )  # fmt: skip
    primal, dual, best, idle, before = 0.0, 0.0, np.inf, 0, np.inf
    for iteration in range(most):
        if flag[0] != 0:
            return HALTED, iteration, primal, dual
        value = multiply(cost, knots, inner)
        at = row_values(rows, start, knots, inner)
        g_knots, g_inner = np.zeros(knots.shape), np.zeros(inner.shape)
        transposed(cost, value, g_knots, g_inner)
        # Gradients are compared with the size of their summands.
        typical = 0.0
        for k in range(count):
            for i in range(cost.shape[1]):
                for j in range(width):
                    typical = max(typical, abs(cost[k, i, j] * value[k, i]))
        for q in range(size):
            pull[q] = z_above[q] - z_below[q]
        bound_gradient(rows, start, pull, g_knots, g_inner)
        hold_still(fixed, g_knots)
        dual = max(largest_of(g_knots), largest_of(g_inner))
        primal, off, largest = 0.0, 0.0, 0.0
        for q in range(size):
            a_low[q], a_high[q] = 0.0, 0.0
            if lower[q] > -np.inf:
                a_low[q] = at[q] - lower[q] - below[q]
                primal = max(primal, abs(a_low[q]) / room_low[q])
                off = max(off, abs(below[q] * z_below[q] / mu - 1.0))
                largest = max(largest, z_below[q])
            if upper[q] < np.inf:
                a_high[q] = upper[q] - at[q] - above[q]
                primal = max(primal, abs(a_high[q]) / room_high[q])
                off = max(off, abs(above[q] * z_above[q] / mu - 1.0))
                largest = max(largest, z_above[q])
        if primal <= 1.0 and off <= accuracy:
            ratio = dual / max(typical, largest, 1e-300)
            # Rounding may prevent the requested accuracy. Accept a ratio that no longer decreases.
            if ratio <= accuracy or (ratio <= 1e-5 and ratio > 0.5 * before):
                return SETTLED, iteration, primal, dual
            before = ratio
        if primal > 1.0:
            # Without a feasible path, the violation stops decreasing.
            if primal < 0.7 * best:
                best, idle = primal, 0
            else:
                idle += 1
                if idle > 12:
                    break
        for q in range(size):
            d, p = 0.0, 0.0
            if lower[q] > -np.inf:
                d += z_below[q] / below[q]
                p -= (below[q] * z_below[q] - mu + z_below[q] * a_low[q]) / below[q]
            if upper[q] < np.inf:
                d += z_above[q] / above[q]
                p += (above[q] * z_above[q] - mu + z_above[q] * a_high[q]) / above[q]
            weight[q] = np.sqrt(d)
            pull[q] = p
        factorise(cost, rows, start, weight, fixed, factors, last)
        b_knots, b_inner = times(-1.0, g_knots), times(-1.0, g_inner)
        bound_gradient(rows, start, pull, b_knots, b_inner)
        hold_still(fixed, b_knots)
        x_knots, x_inner = newton_step(
            cost, rows, start, weight, fixed, factors, last, b_knots, b_inner
        )
        step = row_values(rows, start, x_knots, x_inner)
        alpha = 1.0
        for q in range(size):
            if lower[q] > -np.inf:
                a_low[q] += step[q]
                b_low[q] = (mu - z_below[q] * a_low[q]) / below[q] - z_below[q]
                if a_low[q] < 0.0:
                    alpha = min(alpha, -0.99 * below[q] / a_low[q])
                if b_low[q] < 0.0:
                    alpha = min(alpha, -0.99 * z_below[q] / b_low[q])
            if upper[q] < np.inf:
                a_high[q] -= step[q]
                b_high[q] = (mu - z_above[q] * a_high[q]) / above[q] - z_above[q]
                if a_high[q] < 0.0:
                    alpha = min(alpha, -0.99 * above[q] / a_high[q])
                if b_high[q] < 0.0:
                    alpha = min(alpha, -0.99 * z_above[q] / b_high[q])
        advance(knots, alpha, x_knots)
        advance(inner, alpha, x_inner)
        for q in range(size):
            if lower[q] > -np.inf:
                below[q] += alpha * a_low[q]
                z_below[q] += alpha * b_low[q]
            if upper[q] < np.inf:
                above[q] += alpha * a_high[q]
                z_above[q] += alpha * b_high[q]
    return UNSETTLED, most, primal, dual


@kernel
def evaluate(
    durations: Floats, order: int, axes: int, unit_cost: Floats, cost_orders: Ints,
    unit_rows: Floats, mix: Floats, derivative: Ints, start: Ints, lower: Floats, upper: Floats,
    low_scale: Floats, high_scale: Floats, fixed: Flags, values: Floats, knots: Floats, inner: Floats, below: Floats, above: Floats,
    z_below: Floats, z_above: Floats, warm: bool, unit: float, mu: float, tolerance: float,
    accuracy: float, most: int, flag: NDArray[np.int8], slope: Floats,
) -> tuple[int, int, float, float]:  # fmt: skip
    """Solve the barrier problem of one group at `durations` and add its slopes to `slope`.

    The iterate consists of `knots` and `inner` (coordinates) and of `below`, `above`, `z_below` and
    `z_above` (slacks and multipliers in the model's units). It is updated in place, and is the
    starting point if `warm`.

    Parameters
    ----------
    low_scale, high_scale : ndarray, shape (Q,)
        Scales of violations from below and from above.
    tolerance : float
        Largest violation, relative to its scale.
    values : ndarray, shape (M + 1, n)
        Values of the derivatives with `fixed`.
    unit : float
        Typical J, which scales the kernel's numbers to about 1.
    mu : float
        Slack times multiplier, in units of J.

    Returns
    -------
    tuple
        Status, Newton steps, J, and the sum of the logarithms of the slacks.
    """
    cost, rows, share = pose(
        durations, order, axes, unit_cost, cost_orders, unit_rows, mix, derivative, start
    )
    rescale(cost, np.sqrt(2.0 / unit))
    scales = knot_scales(durations)
    for k in range(fixed.shape[0]):
        for j in range(fixed.shape[1]):
            if fixed[k, j]:
                knots[k, j] = values[k, j] * scales[k] ** (j % order)
    size = share.size
    low, high, room_low, room_high = (
        np.empty(size), np.empty(size), np.empty(size), np.empty(size),
    )  # fmt: skip
    for q in range(size):
        low[q], high[q] = lower[q] * share[q], upper[q] * share[q]
        room_low[q] = tolerance * low_scale[q] * share[q] + 1e-14
        room_high[q] = tolerance * high_scale[q] * share[q] + 1e-14
    if not warm:
        cold_start(cost, rows, start, low, high, fixed, knots, inner)
    at = row_values(rows, start, knots, inner)
    inside = mu / unit
    # In normalised rows: slacks at the new durations, but never far below the previous slacks.
    for q in range(at.size):
        has_low, has_high = low[q] > -np.inf, high[q] < np.inf
        wide = 1.0
        if has_low and has_high:
            wide = max(0.1 * 0.5 * (high[q] - low[q]), 1e-8)
        if has_low:
            least = 0.3 * below[q] * share[q] if warm else wide
            below[q] = max(at[q] - low[q], least)
            z_below[q] = z_below[q] / (unit * share[q]) if warm else inside / below[q]
        if has_high:
            least = 0.3 * above[q] * share[q] if warm else wide
            above[q] = max(high[q] - at[q], least)
            z_above[q] = z_above[q] / (unit * share[q]) if warm else inside / above[q]
    status, steps, _, _ = centre(
        cost, rows, start, low, high, fixed, knots, inner, below, above, z_below, z_above,
        room_low, room_high, inside, accuracy, most, flag,
    )  # fmt: skip
    pull = np.zeros(at.size)
    logs = 0.0
    for q in range(at.size):
        if low[q] > -np.inf:
            below[q] /= share[q]
            z_below[q] *= unit * share[q]
            pull[q] -= z_below[q]
            logs += np.log(below[q])
        if high[q] < np.inf:
            above[q] /= share[q]
            z_above[q] *= unit * share[q]
            pull[q] += z_above[q]
            logs += np.log(above[q])
    objective = slopes(
        durations, order, axes, unit_cost, cost_orders, unit_rows, mix, derivative, start,
        knots, inner, pull, slope,
    )  # fmt: skip
    return status, steps, objective, logs
