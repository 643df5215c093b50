"""Compiled: the iterate of a barrier problem as polynomials, and what of them is bounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from .time_rows import knot_scales

__all__ = ["bounded_rows", "powers_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def powers_of(
    durations: Floats, order: int, axes: int, basis: Floats, knots: Floats, inner: Floats
) -> Floats:
    """Return ascending powers of s, shape (M, degree + 1, axes).

    Parameters
    ----------
    basis : ndarray, shape (degree + 1, degree + 1)
        Powers (rows) of the Hermite functions (columns).
    knots, inner : ndarray
        Coordinates: derivatives at the knots times ``knot_scales`` to their order.
    """
    count, size = durations.size, basis.shape[0]
    extra = size - 2 * order
    scales = knot_scales(durations)
    powers = np.zeros((count, size, axes))
    y = np.zeros(size)
    for k in range(count):
        before, after = durations[k] / scales[k], durations[k] / scales[k + 1]
        for a in range(axes):
            # Relative to the start: Hermite functions take differences of positions.
            begin = knots[k, a * order]
            left, right = 1.0, 1.0
            for i in range(order):
                y[i] = knots[k, a * order + i] * left
                y[order + i] = knots[k + 1, a * order + i] * right
                left *= before
                right *= after
            y[0] = 0.0
            y[order] -= begin
            for i in range(extra):
                y[2 * order + i] = inner[k, a * extra + i]
            for p in range(size):
                value = 0.0
                for i in range(size):
                    value += basis[p, i] * y[i]
                powers[k, p, a] = value
            powers[k, 0, a] += begin
    return powers


@kernel
def bounded_rows(
    powers: Floats, durations: Floats, segment: Ints, derivative: Ints, mix: Floats
) -> Floats:
    """Return what is bounded as polynomials in s, padded to one width, shape (N, degree + 1).

    Parameters
    ----------
    segment, derivative : ndarray of int, shape (N,)
        Whose derivative in time each is.
    mix : ndarray, shape (N, axes)
        Of which axes it is the sum.
    """
    size = powers.shape[1]
    rows = np.zeros((segment.size, size))
    for row in range(segment.size):
        k, j = segment[row], derivative[row]
        scale = durations[k] ** (-float(j))
        for p in range(j, size):
            factor = scale
            for m in range(p - j + 1, p + 1):
                factor *= m
            value = 0.0
            for a in range(mix.shape[1]):
                value += mix[row, a] * powers[k, p, a]
            rows[row, p - j] = factor * value
    return rows
