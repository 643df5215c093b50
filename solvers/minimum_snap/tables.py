"""Tables of piecewise Hermite polynomials from integers and fractions, for ``hermite``."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.fields import frozen

__all__ = ["Table", "moment_tables", "table_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Table(NamedTuple):
    """Objective of a segment on [0, 1], with the rows of all orders stacked.

    Parameters
    ----------
    rows : ndarray, shape (N, 2r)
        Map from the scaled jet y to the Legendre moments g of every derivative with a weight. Each
        row is scaled to integers.
    factors : ndarray, shape (N,)
        ``(2i + 1) w_j`` of each row, divided by the square of its scale.
    orders : ndarray of int, shape (N,)
        Order j of each row, so that ``J = Σ factors T^(1 - 2 orders) g²``.
    """

    rows: Floats
    factors: Floats
    orders: Ints


def _legendre(index: int) -> list[int]:
    """Return the coefficients of the Legendre polynomial on [0, 1] that equals 1 at 1."""
    sign = (-1) ** index
    return [
        sign * (-1) ** m * math.comb(index, m) * math.comb(index + m, m) for m in range(index + 1)
    ]


@cache
def _hermite_powers(order: int) -> tuple[tuple[Fraction, ...], ...]:
    """Return exact coefficients of powers 0 … 2r-1 (rows) of the Hermite functions (columns).

    The coefficients below r are y_i / i!. The others follow from x^(r) = Σ (2i + 1) g_i P_i.
    """
    r = order
    moments = _end_moments(r)
    powers = [[Fraction(0)] * (2 * r) for _ in range(2 * r)]
    for i in range(r):
        powers[i][i] = Fraction(1, math.factorial(i))
    for i in range(r):
        for m, value in enumerate(_legendre(i)):
            for column in range(2 * r):
                share = Fraction((2 * i + 1) * value * moments[i][column])
                powers[r + m][column] += share / math.perm(r + m, r)
    return tuple(map(tuple, powers))


def _end_moments(order: int) -> list[list[int]]:
    """Return the integer map from the jet to ∫ x^(r) P_i ds for i < r, by integration by parts.

    The m-th derivative of P_i is (i + m)! / (m! (i - m)!) at 1, and that times (-1)^(i + m) at 0.
    """
    rows = []
    for i in range(order):
        row = [0] * (2 * order)
        for m in range(i + 1):
            at_one = math.factorial(i + m) // (math.factorial(m) * math.factorial(i - m))
            row[2 * order - 1 - m] = (-1) ** m * at_one
            row[order - 1 - m] = -((-1) ** i) * at_one
        rows.append(row)
    return rows


@cache
def moment_tables(order: int) -> tuple[Floats, Floats, Floats]:
    """Return the tables that compute powers of s via the moments of the r-th derivative.

    Returns
    -------
    rows : ndarray, shape (r, 2r)
        Integer map from the scaled jet to the moments.
    blend : ndarray, shape (r, r)
        Map from the moments to the coefficients of powers r … 2r-1.
    factorials : ndarray, shape (r,)
        i!, so that the coefficients below r are y_i / i!.
    """
    blend = np.zeros((order, order))
    for i in range(order):
        for m, value in enumerate(_legendre(i)):
            blend[m, i] = float(Fraction((2 * i + 1) * value, math.perm(order + m, order)))
    factorials = np.array([float(math.factorial(i)) for i in range(order)])
    return np.array(_end_moments(order), float), blend, factorials


@cache
def _power_moments(order: int, derivative: int) -> tuple[tuple[Fraction, ...], ...]:
    """Return ∫ (s^n)^(j) P_i ds, shape (2r - j, 2r): rows i, columns n."""
    j = derivative
    return tuple(
        tuple(
            sum(
                (Fraction(p * math.perm(n, j), m + n - j + 1) for m, p in enumerate(_legendre(i))),
                Fraction(0),
            )
            if n >= j
            else Fraction(0)
            for n in range(2 * order)
        )
        for i in range(2 * order - j)
    )


@cache
def _exact_rows(order: int, derivative: int) -> tuple[tuple[Fraction, ...], ...]:
    """Return the map from the scaled jet to Legendre moments of the j-th derivative, (2r - j, 2r).

    For j = r, x^(r) has degree r-1, so moments above index r-1 vanish and are omitted.
    """
    powers = _hermite_powers(order)
    places = range(2 * order)
    return tuple(
        tuple(sum((row[n] * powers[n][p] for n in places), Fraction(0)) for p in places)
        for row in _power_moments(order, derivative)
    )


@cache
def _table(weights: tuple[float, ...]) -> Table:
    r = len(weights)
    rows, factors, orders = [], [], []
    for j, weight in enumerate(weights, start=1):
        if weight == 0.0:
            continue
        own = _exact_rows(r, j)
        for i, row in enumerate(own):
            # Integers are exact in floating point, so that motions without cost have a cost of 0.
            common = math.lcm(*(value.denominator for value in row))
            rows.append([float(value * common) for value in row])
            factors.append(weight * float(Fraction(2 * i + 1, common * common)))
            orders.append(j)
    return Table(
        frozen(np.array(rows)),
        frozen(np.array(factors)),
        frozen(np.array(orders, np.int64)),
    )


def table_of(weights: Floats) -> Table:
    """Return the cached table for weights of the orders 1 … r."""
    return _table(tuple(map(float, weights)))
