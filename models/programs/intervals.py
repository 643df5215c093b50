"""Arithmetic with vectors of intervals, and sums with bounds on their rounding errors.

Instead of switching the rounding mode, every sum is widened by its a-priori error bound (Higham,
"Accuracy and Stability of Numerical Algorithms", 2002, section 3.1), and every product is rounded
outwards. Callers suppress the warnings of NumPy: an overflow gives unbounded intervals.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ROUNDOFF", "SLACK", "TINY", "Interval", "difference", "smallest", "sums", "total"]

Vector = NDArray[np.float64]

#: Unit roundoff; bound on the error of a product or sum that underflows; factor that covers the rounding
#: of an error bound with fewer than 1e13 terms.
ROUNDOFF, TINY, SLACK = np.finfo(float).eps / 2.0, 1e-300, 1.01


class Interval(NamedTuple):
    """Vector of intervals with the ends `low` and `high`, shape (n,)."""

    low: Vector
    high: Vector


def total(terms: Vector) -> float:
    """Return the sum of `terms` rounded down; -inf if a term is not finite or the sum overflows."""
    if not np.isfinite(terms).all():
        return -math.inf
    numbers = terms[terms != 0].tolist()
    try:
        result = math.fsum(numbers)  # rounds once
        exceeds = math.fsum([*numbers, -result]) < 0.0
    except OverflowError:
        return -math.inf
    return math.nextafter(result, -math.inf) if exceeds else result


def sums(matrix: Any, vector: Vector) -> tuple[Vector, Vector]:
    """Return ``matrix @ vector`` and a bound on the error of each entry; 0 if all terms are 0."""
    value: Vector = matrix @ vector
    ones = type(matrix)((np.ones(matrix.nnz), matrix.indices, matrix.indptr), matrix.shape)
    terms = ones @ (vector != 0).astype(float)
    size = abs(matrix) @ np.abs(vector)
    error = (terms + 2.0) * (ROUNDOFF * SLACK) * size + terms * TINY
    return value, np.where(terms > 0, error, 0.0)


def difference(left: Vector | Interval, right: Vector, error: Vector) -> Interval:
    """Return intervals of ``left - right``, for numbers with errors of up to `error` in `right`."""
    ends = left if isinstance(left, Interval) else Interval(left, left)
    low, high = ends.low - right, ends.high - right
    largest = np.maximum(np.abs(low), np.abs(high))
    changed = (error != 0) | (right != 0)  # the subtraction of an exact 0 is exact
    width = SLACK * (error + ROUNDOFF * largest) + TINY
    return Interval(
        np.where(changed, np.nextafter(low - width, -np.inf), low),
        np.where(changed, np.nextafter(high + width, np.inf), high),
    )


def smallest(factor: Interval, values: Interval) -> Vector:
    """Return lower bounds on the products of numbers in two vectors of intervals.

    A factor of 0 gives 0, also with an infinite end: the numbers themselves are finite.
    """

    def products(value: Vector) -> Vector:
        # Rounded to nearest; a product that underflows keeps its sign.
        end = np.where(value >= 0, factor.low, factor.high)
        return np.where((end == 0) | (value == 0), 0.0, end * value)

    low, high = products(values.low), products(values.high)
    result = np.minimum(low, high)
    exact = (result == 0) & ~np.signbit(low) & ~np.signbit(high)
    rounded: Vector = np.where(exact, 0.0, np.nextafter(result, -np.inf))
    return rounded
