"""Compiled second derivatives of the barrier problem's optimal value by the durations.

Let φ(y, T) be the Lagrangian of :mod:`~crosstrack.solvers.minimum_snap.time_rows` and K its Hessian
in the coordinates y. The optimal value has the Hessian ``φ_TT - φ_yT' K⁻¹ φ_yT``. φ_TT is diagonal,
and a column of φ_yT involves the two knots of its segment. K is factorised knot by knot, so that the
total cost is O(M²).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .chain_kernels import factorise, rescale, solve_factors
from .time_rows import knot_scales, pose

__all__ = ["curvature", "foreseen", "shifted_solve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@kernel
def curvature(
    durations: Floats, order: int, axes: int, unit_cost: Floats, cost_orders: Ints,
    unit_rows: Floats, mix: Floats, derivative: Ints, start: Ints, lower: Floats, upper: Floats,
    fixed: Flags, knots: Floats, inner: Floats, below: Floats, above: Floats, z_below: Floats,
    z_above: Floats, unit: float, hessian: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """Add the second derivatives of one group by the durations to `hessian`, shape (M, M).

    The parameters are those of :func:`~crosstrack.solvers.minimum_snap.time_kernels.evaluate`. The
    iterate is its result at the same durations.

    Returns
    -------
    response : ndarray, shape (M, M + 1, n)
        Derivatives of the knots' coordinates by each duration, at fixed scales of the knots.
    response_inner : ndarray, shape (M, M, interior)
        Derivatives of the inner coordinates of the segments by each duration.
    rows : ndarray, shape (Q, width)
        Rows of the bounds in coordinates, not normalised.
    rate : ndarray, shape (Q,)
        Derivative of each bounded value by its segment's duration, at fixed derivatives of the path.
    """
    count, size = durations.size, unit_cost.shape[1]
    extra = size - 2 * order
    n = order * axes
    width = 2 * n + extra * axes
    cost, rows, share = pose(
        durations, order, axes, unit_cost, cost_orders, unit_rows, mix, derivative, start
    )
    rescale(cost, np.sqrt(2.0 / unit))
    weight = np.zeros(rows.shape[0])
    firm, pull = np.zeros(rows.shape[0]), np.zeros(rows.shape[0])
    for q in range(rows.shape[0]):
        if lower[q] > -np.inf:
            firm[q] += z_below[q] / below[q]
            pull[q] -= z_below[q]
        if upper[q] < np.inf:
            firm[q] += z_above[q] / above[q]
            pull[q] += z_above[q]
        weight[q] = np.sqrt(firm[q] / unit) / share[q]
    factors, last = np.zeros((count, width - n, width)), np.zeros((n, n))
    factorise(cost, rows, start, weight, fixed, factors, last)
    # For each coordinate of an axis: its power of the duration, and its factor to y.
    power = np.zeros(size)
    for i in range(order):
        power[i] = power[order + i] = float(i)
    scales = knot_scales(durations)
    column = np.ones(size)
    y = np.zeros((axes, size))
    mixed = np.zeros((count, width))
    rates = np.zeros(rows.shape[0])
    for k in range(count):
        long = durations[k]
        for i in range(order):
            column[i] = (long / scales[k]) ** i
            column[order + i] = (long / scales[k + 1]) ** i
        for a in range(axes):
            for i in range(order):
                y[a, i] = knots[k, a * order + i] * column[i]
                y[a, order + i] = knots[k + 1, a * order + i] * column[order + i]
            for i in range(extra):
                y[a, 2 * order + i] = inner[k, a * extra + i]
        total = 0.0
        for c in range(unit_cost.shape[0]):
            e = 1.0 - 2.0 * cost_orders[c]
            factor = long ** (e - 2.0)
            for a in range(axes):
                v, first, second = 0.0, 0.0, 0.0
                for i in range(size):
                    own = unit_cost[c, i] * y[a, i]
                    v += own
                    first += power[i] * own
                    second += power[i] * (power[i] - 1.0) * own
                total += factor * (
                    e * (e - 1.0) * v * v + 4.0 * e * v * first
                    + 2.0 * (first * first + v * second)
                )  # fmt: skip
                for i in range(size):
                    at = _place(i, a, order, n, extra)
                    mixed[k, at] += (
                        2.0 * factor * long * column[i] * unit_cost[c, i]
                        * ((e + power[i]) * v + first)
                    )  # fmt: skip
        for q in range(start[k], start[k + 1]):
            j = float(derivative[q])
            factor = long ** (-j)
            v, first, second = 0.0, 0.0, 0.0
            for a in range(axes):
                for i in range(size):
                    own = mix[q, a] * unit_rows[q, i] * y[a, i]
                    v += own
                    first += power[i] * own
                    second += power[i] * (power[i] - 1.0) * own
            rate = factor / long * (first - j * v)
            rates[q] = rate
            total += firm[q] * rate * rate
            total += pull[q] * factor / long**2 * (j * (j + 1.0) * v - 2.0 * j * first + second)
            for a in range(axes):
                for i in range(size):
                    at = _place(i, a, order, n, extra)
                    row = factor * mix[q, a] * unit_rows[q, i] * column[i]
                    mixed[k, at] += row * (pull[q] * (power[i] - j) / long + firm[q] * rate)
        for j in range(n):
            if fixed[k, j]:
                mixed[k, j] = 0.0
            if fixed[k + 1, j]:
                mixed[k, n + j] = 0.0
        hessian[k, k] += total
    response = np.zeros((count, count + 1, n))
    response_inner = np.zeros((count, count, width - 2 * n))
    for k in range(count):
        x_knots, x_inner = response[k], response_inner[k]
        for j in range(n):
            x_knots[k, j] = mixed[k, j] / unit
            x_knots[k + 1, j] = mixed[k, n + j] / unit
        for j in range(width - 2 * n):
            x_inner[k, j] = mixed[k, 2 * n + j] / unit
        solve_factors(factors, last, fixed, x_knots, x_inner)
        for other in range(count):
            value = 0.0
            for j in range(n):
                value += mixed[other, j] * x_knots[other, j]
                value += mixed[other, n + j] * x_knots[other + 1, j]
            for j in range(width - 2 * n):
                value += mixed[other, 2 * n + j] * x_inner[other, j]
            hessian[other, k] -= value
    for q in range(rows.shape[0]):
        for j in range(width):
            rows[q, j] /= share[q]
    rescale(response, -1.0)
    rescale(response_inner, -1.0)
    return response, response_inner, rows, rates


@kernel
def foreseen(
    start: Ints, rows: Floats, rates: Floats, change: Floats, knots: Floats, inner: Floats,
    below: Floats, above: Floats, lower: Floats, upper: Floats, share: float, step: Floats,
) -> float:  # fmt: skip
    """Return the share of `change` at which the linear prediction uses up a slack.

    Parameters
    ----------
    change : ndarray, shape (M,)
        Change of the durations, s.
    knots, inner : ndarray
        Resulting change of the coordinates.
    share : float
        Largest share of a slack that may be used.
    step : ndarray, shape (Q,)
        Receives the changes of the bounded values.
    """
    n = knots.shape[1]
    width = rows.shape[1]
    far = np.inf
    for k in range(start.size - 1):
        for q in range(start[k], start[k + 1]):
            value = rates[q] * change[k]
            for j in range(n):
                value += rows[q, j] * knots[k, j] + rows[q, n + j] * knots[k + 1, j]
            for j in range(width - 2 * n):
                value += rows[q, 2 * n + j] * inner[k, j]
            step[q] = value
            if value < 0.0 and lower[q] > -np.inf:
                far = min(far, -share * below[q] / value)
            if value > 0.0 and upper[q] < np.inf:
                far = min(far, share * above[q] / value)
    return far


@kernel
def shifted_solve(matrix: Floats, shift: float, right: Floats) -> bool:
    """Solve ``(matrix + shift I) x = right`` in place by Cholesky. Return False if not positive.

    It is compiled because LAPACK's threads are slower for such sizes if the cores are busy.
    """
    n = right.size
    factor = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            if i == j:
                value += shift
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = value / factor[j, j]
            elif value > 1e-14 * abs(matrix[i, i]):
                factor[i, i] = np.sqrt(value)
            else:
                return False
    for i in range(n):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            right[i] -= factor[k, i] * right[k]
        right[i] /= factor[i, i]
    return True


@kernel
def _place(i: int, axis: int, order: int, n: int, extra: int) -> int:
    """Return the index of coordinate `i` of `axis` among the coordinates of a segment."""
    if i < order:
        return axis * order + i
    if i < 2 * order:
        return n + axis * order + i - order
    return 2 * n + axis * extra + i - 2 * order
