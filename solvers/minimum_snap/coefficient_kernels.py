"""Kernels from jets to coefficients, written out for r = 2, 3, 4.

By way of the Legendre moments of the r-th derivative, so that the powers from r on keep their digits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel

__all__ = ["coefficients_of"]

Floats = NDArray[np.float64]


@kernel
def coefficients_of(
    durations: Floats,
    jets: Floats,
    rows: Floats,
    blend: Floats,
    factorials: Floats,
    coefficients: Floats,
) -> None:
    """Fill `coefficients`, shape (M, 2r, A), from jets, with ``hermite.moment_tables``."""
    axes, count, _, order = jets.shape
    scaled, moments = np.zeros(2 * order), np.empty(order)
    for k in range(count):
        long = durations[k]
        for a in range(axes):
            jet = jets[a, k]
            # Written out where the tables would take longer than the arithmetic.
            if order == 4:
                _septic(long, jet, coefficients[k, :, a])
                continue
            if order == 3:
                _quintic(long, jet, coefficients[k, :, a])
                continue
            if order == 2:
                _cubic(long, jet, coefficients[k, :, a])
                continue
            power = 1.0
            for i in range(order):
                scaled[i] = jet[0, i] * power
                scaled[order + i] = jet[1, i] * power
                coefficients[k, i, a] = scaled[i] / factorials[i]
                power *= long
            scaled[order] -= scaled[0]
            scaled[0] = 0.0
            for n in range(order):
                total = 0.0
                for p in range(2 * order):
                    total += rows[n, p] * scaled[p]
                moments[n] = total
            for i in range(order):
                total = 0.0
                for n in range(i, order):
                    total += blend[i, n] * moments[n]
                coefficients[k, order + i, a] = total


@kernel
def _septic(long: float, jet: Floats, powers: Floats) -> None:
    """Fill the `powers` of one segment for r = 4."""
    long2 = long * long
    long3 = long2 * long
    v0, v1 = jet[0, 1] * long, jet[1, 1] * long
    a0, a1 = jet[0, 2] * long2, jet[1, 2] * long2
    j0, j1 = jet[0, 3] * long3, jet[1, 3] * long3
    plus_j, minus_j, minus_a, plus_v = j1 + j0, j1 - j0, a1 - a0, v1 + v0
    q1 = 3.0 * (plus_j - 2.0 * minus_a)
    q2 = 5.0 * (minus_j - 6.0 * (a1 + a0) + 12.0 * (v1 - v0))
    q3 = 7.0 * (plus_j - 12.0 * minus_a + 60.0 * plus_v - 120.0 * (jet[1, 0] - jet[0, 0]))
    powers[0] = jet[0, 0]
    powers[1] = v0
    powers[2] = a0 / 2.0
    powers[3] = j0 / 6.0
    powers[4] = (minus_j - q1 + q2 - q3) / 24.0
    powers[5] = (2.0 * q1 - 6.0 * q2 + 12.0 * q3) / 120.0
    powers[6] = (6.0 * q2 - 30.0 * q3) / 360.0
    powers[7] = 20.0 * q3 / 840.0


@kernel
def _quintic(long: float, jet: Floats, powers: Floats) -> None:
    """Fill the `powers` of one segment for r = 3."""
    v0, v1 = jet[0, 1] * long, jet[1, 1] * long
    a0, a1 = jet[0, 2] * long * long, jet[1, 2] * long * long
    g0 = a1 - a0
    q1 = 3.0 * (a1 + a0 - 2.0 * (v1 - v0))
    q2 = 5.0 * (g0 - 6.0 * (v1 + v0) + 12.0 * (jet[1, 0] - jet[0, 0]))
    powers[0] = jet[0, 0]
    powers[1] = v0
    powers[2] = a0 / 2.0
    powers[3] = (g0 - q1 + q2) / 6.0
    powers[4] = (2.0 * q1 - 6.0 * q2) / 24.0
    powers[5] = q2 / 10.0


@kernel
def _cubic(long: float, jet: Floats, powers: Floats) -> None:
    """Fill the `powers` of one segment for r = 2."""
    v0, v1 = jet[0, 1] * long, jet[1, 1] * long
    q1 = 3.0 * (v1 + v0 - 2.0 * (jet[1, 0] - jet[0, 0]))
    powers[0] = jet[0, 0]
    powers[1] = v0
    powers[2] = (v1 - v0 - q1) / 2.0
    powers[3] = q1 / 3.0
