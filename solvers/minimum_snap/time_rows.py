"""Compiled cost and bound rows of one group of axes at given durations, with their slopes.

At fixed derivatives at the knots and fixed instants s, the cost ``Σ w_j T^(1-2j) |U_j y|²`` and a
bounded derivative ``T^-j u'y`` depend on the durations through T and ``y_i = T^i d_i``. Each row is
therefore a scaled unit row. At optimal derivatives, the slope of the optimal value is the slope of
the Lagrangian at fixed derivatives (envelope theorem).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["knot_scales", "pose", "slopes"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def knot_scales(durations: Floats) -> Floats:
    """Return the time that scales the derivatives of each knot, shape (M + 1,)."""
    count = durations.size
    scales = np.empty(count + 1)
    scales[0], scales[count] = durations[0], durations[count - 1]
    for k in range(1, count):
        scales[k] = np.sqrt(durations[k - 1] * durations[k])
    return scales


@kernel
def _column_scales(durations: Floats, scales: Floats, order: int, size: int) -> Floats:
    """Return the factors from the coordinates of one axis to y, shape (M, degree + 1)."""
    columns = np.ones((durations.size, size))
    for k in range(durations.size):
        before, after = durations[k] / scales[k], durations[k] / scales[k + 1]
        for i in range(1, order):
            columns[k, i] = columns[k, i - 1] * before
            columns[k, order + i] = columns[k, order + i - 1] * after
    return columns


@kernel
def pose(
    durations: Floats, order: int, axes: int, unit_cost: Floats, cost_orders: Ints,
    unit_rows: Floats, mix: Floats, derivative: Ints, start: Ints,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Return the cost rows and normalised bound rows in local coordinates, and their factors.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    order, axes : int
        r, and the number of axes in the group.
    unit_cost, cost_orders : ndarray, shapes (C, degree + 1), (C,)
        Rows with J = Σ T^(1-2j) |row y|² for one axis, and their j.
    unit_rows, mix, derivative : ndarray, shapes (Q, degree + 1), (Q, axes), (Q,)
        A bounded value is ``T^-derivative Σ_axis mix[axis] row'y[axis]``.
    start : ndarray of int, shape (M + 1,)
        Index of the first bound of each segment.

    Returns
    -------
    cost : ndarray, shape (M, C axes, width)
        Rows of the cost.
    rows : ndarray, shape (Q, width)
        Rows of the bounds, normalised to a largest entry of 1.
    share : ndarray, shape (Q,)
        Normalisation factor of each bound row.
    """
    count, size = durations.size, unit_cost.shape[1]
    extra = size - 2 * order
    n = order * axes
    width = 2 * n + extra * axes
    columns = _column_scales(durations, knot_scales(durations), order, size)
    cost = np.zeros((count, unit_cost.shape[0] * axes, width))
    rows = np.zeros((unit_rows.shape[0], width))
    share = np.ones(unit_rows.shape[0])
    for k in range(count):
        for c in range(unit_cost.shape[0]):
            factor = durations[k] ** (0.5 - cost_orders[c])
            for a in range(axes):
                row = cost[k, c * axes + a]
                for i in range(order):
                    row[a * order + i] = factor * unit_cost[c, i] * columns[k, i]
                    at = order + i
                    row[n + a * order + i] = factor * unit_cost[c, at] * columns[k, at]
                for i in range(extra):
                    row[2 * n + a * extra + i] = factor * unit_cost[c, 2 * order + i]
        for q in range(start[k], start[k + 1]):
            factor = durations[k] ** (-float(derivative[q]))
            row = rows[q]
            largest = 0.0
            for a in range(axes):
                own = factor * mix[q, a]
                for i in range(order):
                    row[a * order + i] = own * unit_rows[q, i] * columns[k, i]
                    at = order + i
                    row[n + a * order + i] = own * unit_rows[q, at] * columns[k, at]
                for i in range(extra):
                    row[2 * n + a * extra + i] = own * unit_rows[q, 2 * order + i]
            for j in range(width):
                largest = max(largest, abs(row[j]))
            if largest > 0.0:
                share[q] = 1.0 / largest
                for j in range(width):
                    row[j] *= share[q]
    return cost, rows, share


@kernel
def slopes(
    durations: Floats, order: int, axes: int, unit_cost: Floats, cost_orders: Ints,
    unit_rows: Floats, mix: Floats, derivative: Ints, start: Ints,
    knots: Floats, inner: Floats, pull: Floats, slope: Floats,
) -> float:  # fmt: skip
    """Add the derivatives of the Lagrangian by the durations to `slope`. Return J.

    Parameters
    ----------
    knots, inner : ndarray
        Coordinates: derivatives at the knots times :func:`knot_scales` to their order.
    pull : ndarray, shape (Q,)
        Multiplier of the upper bound less that of the lower one, in units of J per unit.
    slope : ndarray, shape (M,)
        Receives the derivatives.
    """
    count, size = durations.size, unit_cost.shape[1]
    extra = size - 2 * order
    columns = _column_scales(durations, knot_scales(durations), order, size)
    y = np.zeros((axes, size))
    weighted = np.zeros((axes, size))
    objective = 0.0
    for k in range(count):
        long = durations[k]
        for a in range(axes):
            for i in range(order):
                y[a, i] = knots[k, a * order + i] * columns[k, i]
                y[a, order + i] = knots[k + 1, a * order + i] * columns[k, order + i]
                # d y_i / dT = i y_i / T at a fixed derivative, and 0 for inner coordinates.
                weighted[a, i] = i * y[a, i]
                weighted[a, order + i] = i * y[a, order + i]
            for i in range(extra):
                y[a, 2 * order + i] = inner[k, a * extra + i]
        total = 0.0
        for c in range(unit_cost.shape[0]):
            j = float(cost_orders[c])
            factor = long ** (1.0 - 2.0 * j)
            for a in range(axes):
                value, rate = 0.0, 0.0
                for i in range(size):
                    value += unit_cost[c, i] * y[a, i]
                    rate += unit_cost[c, i] * weighted[a, i]
                objective += factor * value * value
                total += factor * value * ((1.0 - 2.0 * j) * value + 2.0 * rate)
        for q in range(start[k], start[k + 1]):
            if pull[q] != 0.0:
                j = float(derivative[q])
                value, rate = 0.0, 0.0
                for a in range(axes):
                    for i in range(size):
                        value += mix[q, a] * unit_rows[q, i] * y[a, i]
                        rate += mix[q, a] * unit_rows[q, i] * weighted[a, i]
                total += pull[q] * long ** (-j) * (rate - j * value)
        slope[k] += total / long
    return objective
