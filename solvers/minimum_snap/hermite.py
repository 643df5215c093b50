"""Piecewise polynomials in terms of derivatives at the knots: tables, objective, gradient.

A segment of duration T is a polynomial of degree 2r-1 in s = (t - t_k) / T. Its *jet* consists of the
derivatives of order 0 … r-1 at both ends; y_i = T^i d_i are the same in units of position. The j-th
derivative is expanded in Legendre polynomials on [0, 1], g_i = ∫ x^(j) P_i ds, so that

    ∫ (x^(j))² dt = T^(1-2j) Σ_i (2i + 1) g_i²

is a sum of squares, which avoids the cancellation of y'Qy. For j = r, integration by parts gives the
g_i as sums of y with integer coefficients, and the index i is at most r-1.

Sources: Richter, Bry and Roy, "Polynomial trajectory planning for aggressive quadrotor flight",
2013 (derivatives at the knots as unknowns); Wang, Zhou, Xu and Gao, "Geometrically constrained
trajectory optimization for multicopters" (MINCO), 2022 (O(M), gradients of durations).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.fields import frozen
from .moment_kernels import blend

__all__ = [
    "CERTIFIED",
    "FLOOR",
    "Outcome",
    "Solved",
    "Table",
    "duration_gradient",
    "has_one_optimum",
    "jets_to_coefficients",
    "moment_tables",
    "patterns",
    "scaled_jets",
    "table_of",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

#: Largest correction of a segment with a certified shape, relative to its size.
CERTIFIED = 1e-9
#: Minimum scale of corrections for segments with little motion, as a share of the given values.
FLOOR = 1e-6


class Outcome(IntEnum):
    """Outcome of a solve."""

    SOLVED = 0
    #: The optimum is not unique: a motion without cost changes no fixed entry.
    NOT_UNIQUE = 1
    #: The durations differ too much for double precision.
    ILL_CONDITIONED = 2


class Solved(NamedTuple):
    """Solution of a minimum-derivative problem.

    Parameters
    ----------
    jets : ndarray, shape (axes, segments, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment; NaN unless ``SOLVED``.
    moments : ndarray, shape (axes, segments, r), or None
        Legendre moments of the r-th derivative, which are more accurate than the jets if durations
        differ strongly. None if the jets are equally accurate.
    objective : ndarray, shape (axes,)
        J of each axis; NaN unless ``SOLVED``.
    outcome : Outcome
        Outcome of the solve.
    correction : float
        Error estimate of the scaled derivatives at the ends of the worst segment: the last Newton
        step, relative to the largest of them. NaN without refinement, for which the error is known
        to be about 1e-11 and is not measured.
    segment : int
        Index of the worst segment.
    gap : float
        Bound on J less its optimum: half the gradient times the last Newton step, plus the rounding
        error of the moments.
    refinements : int
        Newton steps after the first one, the maximum over all groups of axes.
    factorisations : int
        Number of groups of axes with different patterns.
    method : str
        ``"refined"`` for the kernels for waypoints alone, ``"general"`` for the kernels for any
        pattern, ``"boundary"`` for the slow method of :mod:`~.boundary`.
    """

    jets: Floats
    moments: Floats | None
    objective: Floats
    outcome: Outcome
    correction: float
    segment: int
    gap: float
    refinements: int
    factorisations: int
    method: str


# -- tables, from integers and fractions ----------------------------------------------------------


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


# -- algebra --------------------------------------------------------------------------------------


def scaled_jets(durations: Floats, jets: Floats) -> Floats:
    """Return y, shape (axes, segments, 2r), with positions relative to the start of the segment.

    Only differences of positions affect the objective, so no digits are lost far from the origin.
    """
    order = jets.shape[-1]
    scaled = jets * (durations[:, None] ** np.arange(order))[:, None, :]
    scaled[:, :, 1, 0] = jets[:, :, 1, 0] - jets[:, :, 0, 0]
    scaled[:, :, 0, 0] = 0.0
    return scaled.reshape(*jets.shape[:2], 2 * order)


def jets_to_coefficients(durations: Floats, jets: Floats, moments: Floats | None = None) -> Floats:
    """Return ascending powers of s = (t - t_k) / T_k.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    jets : ndarray, shape (A, M, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment.
    moments : ndarray, shape (A, M, r), optional
        ``Solved.moments``, for the powers from r on. Without them these powers are computed from the
        jets and lose digits if durations differ strongly.

    Returns
    -------
    ndarray, shape (M, 2r, A)
        Coefficients in units of position.
    """
    axes, count, _, order = jets.shape
    coefficients = np.empty((count, 2 * order, axes))
    given = np.empty((0, 0, order)) if moments is None else moments
    blend(durations, jets, given, *moment_tables(order), coefficients)
    return coefficients


def duration_gradient(
    durations: Floats, jets: Floats, weights: Floats, *, per_axis: bool = False
) -> Floats:
    """Return dJ/dT_k at fixed derivatives at the knots.

    At an optimum the free derivatives are stationary, so that this is the total derivative of the
    optimal value with respect to the duration (envelope theorem), without a second solve.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    jets : ndarray, shape (A, M, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment.
    weights : ndarray, shape (r,)
        Weights of the orders 1 … r.
    per_axis : bool
        Whether to return one gradient per axis instead of the sum.

    Returns
    -------
    ndarray, shape (M,), or (A, M) with `per_axis`
        J per second.
    """
    table = table_of(weights)
    scaled = scaled_jets(durations, jets)
    moments = scaled @ table.rows.T
    # d y_i / dT = i y_i / T. All terms below are multiplied by T.
    slopes = (scaled * np.tile(np.arange(jets.shape[-1]), 2)) @ table.rows.T
    powers = 1.0 - 2.0 * table.orders
    scale = table.factors * durations[:, None] ** powers
    slope: Floats = np.einsum("kn,akn,akn->ak", scale, moments, powers * moments + 2.0 * slopes)
    slope /= durations
    if per_axis:
        return slope
    total: Floats = slope.sum(axis=0)
    return total


def patterns(fixed: Bools) -> Iterator[Ints]:
    """Yield the axes of each distinct pattern of fixed entries, in order of appearance."""
    left = list(range(len(fixed)))
    while left:
        same = [a for a in left if a == left[0] or np.array_equal(fixed[a], fixed[left[0]])]
        left = [a for a in left if a not in same]
        yield np.array(same, np.int64)


def has_one_optimum(
    durations: Floats, fixed: Bools, weights: Floats, continuity: int
) -> bool | None:
    """Return whether the fixed entries of one axis determine a unique optimum.

    A motion without cost has x^(j) = 0 for the lowest order j with a weight. If `continuity` is at
    least j-1, it is one polynomial of degree < j on the whole path. The optimum is unique if only
    the zero polynomial vanishes at all fixed entries (a Birkhoff problem). Return None for a lower
    continuity: the pivots of the factorisation then decide.

    Parameters
    ----------
    fixed : ndarray of bool, shape (M + 1, r)
        Mask of the fixed entries of one axis.
    """
    least = int(np.flatnonzero(weights)[0]) + 1
    if continuity < least - 1:
        return None
    if np.count_nonzero(fixed[:, 0]) >= least or fixed[:, :least].all(axis=1).any():
        return True
    times = np.concatenate([[0.0], np.cumsum(durations)])
    times = 2.0 * times / times[-1] - 1.0
    rows = [np.zeros((1, least))]
    for order in range(least):
        at = times[fixed[:, order]]
        own = np.zeros((at.size, least))
        for power in range(order, least):
            own[:, power] = math.perm(power, order) * at ** (power - order)
        rows.append(own)
    return bool(np.linalg.matrix_rank(np.concatenate(rows), tol=1e-13) == least)
