"""Batches of polynomials on the unit interval: values, Bernstein coefficients, exact extrema.

Coefficients are in ascending powers of s in [0, 1] along one axis of an array.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "bernstein_matrix",
    "by_power",
    "critical_points",
    "derivative_matrix",
    "derived",
    "factorials",
    "gauss_legendre",
    "horner",
    "power_matrix",
]

Floats = NDArray[np.float64]

#: Leading coefficients below this share of the largest one are rounding noise.
_NOISE = 1e-14


@cache
def factorials(degree: int, derivative: int) -> Floats:
    """Return ``j! / (j - derivative)!`` for the powers j = derivative … degree."""
    powers = range(derivative, degree + 1)
    return np.array([math.perm(j, derivative) for j in powers], float)


@cache
def derivative_matrix(degree: int, orders: int) -> Floats:
    """Return ``j! / (j - i)!``, shape (orders, degree + 1): powers of s to derivatives at s = 1."""
    matrix = np.zeros((orders, degree + 1))
    for order in range(min(orders, degree + 1)):
        matrix[order, order:] = factorials(degree, order)
    return matrix


def derived(coefficients: Floats, derivative: int) -> Floats:
    """Return the coefficients of a derivative in s, with the powers along the second axis.

    Above the degree, the result is one zero coefficient.
    """
    degree = coefficients.shape[1] - 1
    if derivative == 0:
        return coefficients
    if derivative > degree:
        return np.zeros_like(coefficients[:, :1])
    factors = factorials(degree, derivative)
    return coefficients[:, derivative:] * factors.reshape(-1, *[1] * (coefficients.ndim - 2))


def by_power(coefficients: Floats, derivative: int = 0) -> Floats:
    """Return a copy of the coefficients of a derivative in s, shape (degree + 1 - derivative, D, N).

    `coefficients` has the shape (N, degree + 1, D). Loops over many polynomials are several times
    faster with the polynomials along the last axis.
    """
    inner = np.array(coefficients.transpose(1, 2, 0)[derivative:], order="C")
    if derivative:
        inner *= factorials(coefficients.shape[1] - 1, derivative)[:, None, None]
    return inner


def horner(coefficients: Floats, s: Floats) -> Floats:
    """Evaluate each polynomial, shape (N, degree + 1, D), at its own argument by Horner's method.

    `s` has the shape (N,) or (N, D). For D = 1 it may have any number of columns.
    """
    argument = s[:, None] if s.ndim == 1 else s
    shape = np.broadcast_shapes(coefficients[:, -1].shape, argument.shape)
    value = np.broadcast_to(coefficients[:, -1], shape).copy()
    for power in range(coefficients.shape[1] - 2, -1, -1):
        value *= argument
        value += coefficients[:, power]
    return value


@cache
def bernstein_matrix(degree: int, pieces: int = 1) -> Floats:
    """Return B with ``control = B @ coefficients``: powers of s to Bernstein coefficients.

    [0, 1] is split into `pieces` equal parts, whose matrices are stacked vertically.
    """
    matrix = np.zeros((degree + 1, degree + 1))
    for row in range(degree + 1):
        for power in range(row + 1):
            matrix[row, power] = math.comb(row, power) / math.comb(degree, power)
    parts = []
    for piece in range(pieces):
        # s = (piece + u) / pieces
        shift = np.zeros((degree + 1, degree + 1))
        for power in range(degree + 1):
            for row in range(power + 1):
                share = math.comb(power, row) * piece ** (power - row)
                shift[row, power] = share / pieces**power
        parts.append(matrix @ shift)
    return np.concatenate(parts)


@cache
def power_matrix(degree: int) -> Floats:
    """Return the inverse of :func:`bernstein_matrix`: Bernstein coefficients to powers of s."""
    matrix = np.zeros((degree + 1, degree + 1))
    for power in range(degree + 1):
        for row in range(power + 1):
            sign = -1.0 if (power - row) % 2 else 1.0
            matrix[power, row] = sign * math.comb(degree, power) * math.comb(power, row)
    return matrix


@cache
def gauss_legendre(count: int) -> tuple[Floats, Floats]:
    """Return nodes and weights on [0, 1] that integrate degree ``2 count - 1`` exactly."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def critical_points(coefficients: Floats) -> Floats:
    """Return arguments in [0, 1] that include the minimum and maximum of every polynomial.

    The arguments, shape (N, 2 + 2 max(degree - 1, 0)), are both ends and the real part of every root
    of the derivative, clipped to the interval. The real part of a complex root is only an additional
    sample, so that no tolerance has to identify the real roots.
    """
    count = coefficients.shape[0]
    ends = np.broadcast_to(np.array([0.0, 1.0]), (count, 2))
    slope = derived(coefficients, 1)
    degree = slope.shape[1] - 1
    if degree < 1 or count == 0:
        return ends.copy()
    wide = ~np.isfinite(slope).all(axis=1)
    if wide.any():
        # If only the slope overflows, scale before differentiation. Non-finite values have no roots.
        size = np.abs(coefficients[wide]).max(axis=1, keepdims=True)
        slope[wide] = derived(np.where(np.isfinite(size), coefficients[wide] / size, 0.0), 1)
    largest = np.abs(slope).max(axis=1, keepdims=True)
    slope = slope / np.where(largest > 0, largest, 1.0)
    lead = slope[:, -1]
    # A leading coefficient of 0 is replaced by noise, which moves its root far from the interval.
    lead = np.where(np.abs(lead) < _NOISE, np.where(lead < 0, -_NOISE, _NOISE), lead)
    companion = np.zeros((count, degree, degree))
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    companion[:, :, -1] = -slope[:, :-1] / lead[:, None]
    roots = np.clip(np.linalg.eigvals(companion).real, 0.0, 1.0)
    # The noise reduces the accuracy of the other roots, which Newton steps restore. The initial
    # roots are kept because a step may diverge, and additional arguments are harmless.
    polished = roots
    bend = derived(slope, 1)
    for _ in range(3):
        value, curvature = horner(slope[:, :, None], polished), horner(bend[:, :, None], polished)
        with np.errstate(over="ignore"):  # infinite steps are clipped
            step = np.divide(value, curvature, out=np.zeros_like(value), where=curvature != 0)
        polished = np.clip(polished - step, 0.0, 1.0)
    return np.concatenate([ends, roots, polished], axis=1)
