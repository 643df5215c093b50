"""Truncated Taylor series of functions of time, over numbers or over intervals.

The flatness maps of the vehicles are written once for series. With arrays as coefficients they give
values at instants; with intervals they give bounds over parts of a segment (Moore, Kearfott and Cloud,
"Introduction to Interval Analysis", 2009, chapter 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Interval", "Jet", "squared_norm"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Interval:
    """Array of closed intervals. Rounding is to nearest; the caller allows for it.

    Parameters
    ----------
    low, high : ndarray
        Ends, of one shape.
    """

    low: Floats
    high: Floats

    # NumPy arrays on the left must call the reflected operators of this class.
    __array_ufunc__ = None

    @staticmethod
    def of(value: Any) -> Interval:
        """Return `value` as intervals: unchanged, or of width 0 for numbers."""
        return value if isinstance(value, Interval) else Interval(value, value)

    def __add__(self, other: Any) -> Interval:
        other = Interval.of(other)
        return Interval(self.low + other.low, self.high + other.high)

    __radd__ = __add__

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Any) -> Interval:
        return self + -Interval.of(other)

    def __rsub__(self, other: Any) -> Interval:
        return -self + Interval.of(other)

    def __mul__(self, other: Any) -> Interval:
        if not isinstance(other, Interval):
            first, second = self.low * other, self.high * other
            return Interval(np.minimum(first, second), np.maximum(first, second))
        products = (
            self.low * other.low, self.low * other.high,
            self.high * other.low, self.high * other.high,
        )  # fmt: skip
        first, second = np.minimum(*products[:2]), np.maximum(*products[:2])
        return Interval(
            np.minimum(np.minimum(first, products[2]), products[3]),
            np.maximum(np.maximum(second, products[2]), products[3]),
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Interval:
        other = Interval.of(other)
        crosses = (other.low <= 0) & (other.high >= 0)
        with np.errstate(all="ignore"):
            low = np.where(crosses, -np.inf, 1.0 / other.high)
            high = np.where(crosses, np.inf, 1.0 / other.low)
        result = self * Interval(low, high)
        return Interval(
            np.where(np.isnan(result.low), -np.inf, result.low),
            np.where(np.isnan(result.high), np.inf, result.high),
        )

    def square(self) -> Interval:
        """Return the squares, which are not negative."""
        low, high = self.low**2, self.high**2
        crosses = (self.low <= 0) & (self.high >= 0)
        return Interval(np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high))

    def root(self) -> Interval:
        """Return the square roots; negative values, which only rounding yields, become 0."""
        return Interval(np.sqrt(np.maximum(self.low, 0)), np.sqrt(np.maximum(self.high, 0)))


def _square(value: Any) -> Any:
    return value.square() if isinstance(value, Interval) else value * value


def _root(value: Any) -> Any:
    return value.root() if isinstance(value, Interval) else np.sqrt(np.maximum(value, 0.0))


class Jet:
    """Taylor series in time: ``terms[k]`` is the k-th derivative divided by k!.

    Operations between series keep the shorter length.

    Parameters
    ----------
    terms : sequence of ndarray or of Interval
        Coefficients of one shape, at least one.
    """

    __slots__ = ("terms",)

    def __init__(self, terms: Sequence[Any]) -> None:
        self.terms = list(terms)

    def __add__(self, other: Any) -> Jet:
        if not isinstance(other, Jet):
            return Jet([self.terms[0] + other, *self.terms[1:]])
        return Jet([a + b for a, b in zip(self.terms, other.terms, strict=False)])

    def __sub__(self, other: Any) -> Jet:
        return self.__add__(-other)

    def __neg__(self) -> Jet:
        return Jet([-term for term in self.terms])

    def __mul__(self, other: Any) -> Jet:
        if not isinstance(other, Jet):
            return Jet([term * other for term in self.terms])
        a, b = self.terms, other.terms
        size = min(len(a), len(b))
        return Jet([_sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(size)])

    __rmul__ = __mul__

    def __truediv__(self, other: Jet) -> Jet:
        a, b = self.terms, other.terms
        result: list[Any] = []
        for k in range(min(len(a), len(b))):
            rest = a[k]
            for i in range(k):
                rest = rest - result[i] * b[k - i]
            result.append(rest / b[0])
        return Jet(result)

    def square(self) -> Jet:
        """Return the square, with tighter intervals than a product."""
        a = self.terms
        result = []
        for k in range(len(a)):
            parts = [2.0 * (a[i] * a[k - i]) for i in range((k + 1) // 2)]
            result.append(_sum(parts if k % 2 else [*parts, _square(a[k // 2])]))
        return Jet(result)

    def root(self) -> Jet:
        """Return the square root of a positive series."""
        a = self.terms
        result = [_root(a[0])]
        for k in range(1, len(a)):
            rest = a[k]
            for i in range(1, k):
                rest = rest - result[i] * result[k - i]
            result.append(rest / (2.0 * result[0]))
        return Jet(result)

    def rate(self) -> Jet:
        """Return the derivative in time, one term shorter."""
        return Jet([(k + 1.0) * term for k, term in enumerate(self.terms[1:])])


def _sum(parts: Any) -> Any:
    total = None
    for part in parts:
        total = part if total is None else total + part
    return total


def squared_norm(vector: Sequence[Jet]) -> Jet:
    """Return the sum of the squares of the components."""
    total = vector[0].square()
    for component in vector[1:]:
        total = total + component.square()
    return total
