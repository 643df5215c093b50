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
from itertools import product
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
Exact = NDArray[np.object_]

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
    """Solution of a minimum-derivative problem."""

    #: Derivatives 0 … r-1 at the start and the end of each segment, shape (axes, segments, 2, r).
    #: NaN unless ``SOLVED``.
    jets: Floats
    #: Legendre moments of the r-th derivative, shape (axes, segments, r), which are more accurate than
    #: the jets if durations differ strongly. None if the jets are equally accurate.
    moments: Floats | None
    #: J of each axis; NaN unless ``SOLVED``.
    objective: Floats
    outcome: Outcome
    #: Error estimate of the scaled derivatives at the ends of the worst segment: the last Newton step,
    #: relative to the largest of them. NaN without refinement: the error is about 1e-11, not measured.
    correction: float
    #: Index of the worst segment.
    segment: int
    #: Bound on J less its optimum: half the gradient times the last Newton step, plus the rounding
    #: error of the moments.
    gap: float
    #: Newton steps after the first one, the maximum over all groups of axes.
    refinements: int
    #: Number of groups of axes with different patterns.
    factorisations: int
    #: ``"refined"`` for the kernels for waypoints alone, ``"general"`` for the kernels for any
    #: pattern, ``"boundary"`` for the slow method of :mod:`~.boundary`.
    method: str


# -- tables, from integers and fractions ----------------------------------------------------------


class Table(NamedTuple):
    """Objective of a segment on [0, 1], with the rows of all orders stacked."""

    #: Map from the scaled jet y to the Legendre moments g of every derivative with a weight, shape
    #: (N, 2r). Each row is scaled to integers.
    rows: Floats
    #: ``(2i + 1) w_j`` of each row, divided by the square of its scale.
    factors: Floats
    #: Order j of each row, so that ``J = Σ factors T^(1 - 2 orders) g²``.
    orders: Ints


def _legendre(count: int) -> Exact:
    """Return the coefficients of the Legendre polynomials on [0, 1] that equal 1 at 1, one per row."""
    places = range(count)
    return np.array(
        [[(-1) ** (i + m) * math.comb(i, m) * math.comb(i + m, m) for m in places] for i in places],
        object,
    )


def _end_moments(order: int) -> Exact:
    """Return the integer map from the jet to ∫ x^(r) P_i ds for i < r, by integration by parts.

    The m-th derivative of P_i is (i + m)! / (m! (i - m)!) at 1, and that times (-1)^(i + m) at 0.
    """
    rows = np.full((order, 2 * order), 0, object)
    for i in range(order):
        for m in range(i + 1):
            at_one = math.perm(i + m, 2 * m) // math.factorial(m)
            rows[i, 2 * order - 1 - m] = (-1) ** m * at_one
            rows[i, order - 1 - m] = -((-1) ** i) * at_one
    return rows


def _blend(order: int) -> Exact:
    """Return the map from the moments to powers r … 2r-1: x^(r) = Σ (2i + 1) g_i P_i, integrated."""
    legendre = _legendre(order)
    places = range(order)
    return np.array(
        [
            [Fraction((2 * i + 1) * legendre[i, m], math.perm(order + m, order)) for i in places]
            for m in places
        ],
        object,
    )


@cache
def moment_tables(order: int) -> tuple[Floats, Floats, Floats]:
    """Return the tables that compute powers of s via the moments of the r-th derivative.

    They are the integer map from the scaled jet to the moments, shape (r, 2r), the map from the
    moments to the coefficients of powers r … 2r-1, shape (r, r), and i!, so that the coefficients
    below r are y_i / i!.
    """
    factorials = np.array([float(math.factorial(i)) for i in range(order)])
    return _end_moments(order).astype(float), _blend(order).astype(float), factorials


@cache
def _exact_rows(order: int, derivative: int) -> Exact:
    """Return the map from the scaled jet to Legendre moments of the j-th derivative, (2r - j, 2r).

    For j = r, x^(r) has degree r-1, so moments above index r-1 vanish and are omitted.
    """
    count, size = 2 * order - derivative, 2 * order
    # Powers 0 … 2r-1 (rows) of the Hermite functions (columns).
    powers = np.full((size, size), Fraction(0), object)
    for i in range(order):
        powers[i, i] = Fraction(1, math.factorial(i))
    powers[order:] = _blend(order) @ _end_moments(order)
    # ∫ (s^n)^(j) s^m ds
    integrals = np.full((count, size), Fraction(0), object)
    for m, n in product(range(count), range(derivative, size)):
        integrals[m, n] = Fraction(math.perm(n, derivative), m + n - derivative + 1)
    rows: Exact = _legendre(count) @ integrals @ powers
    return rows


@cache
def _table(weights: tuple[float, ...]) -> Table:
    rows, factors, orders = [], [], []
    for j, weight in enumerate(weights, start=1):
        for i, row in enumerate(_exact_rows(len(weights), j) if weight else ()):
            # Integers are exact in floating point, so that motions without cost have a cost of 0.
            common = math.lcm(*(value.denominator for value in row))
            rows.append([float(value * common) for value in row])
            factors.append(weight * float(Fraction(2 * i + 1, common * common)))
            orders.append(j)
    parts = np.array(rows), np.array(factors), np.array(orders, np.int64)
    return Table(*map(frozen, parts))


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
    """Return ascending powers of s = (t - t_k) / T_k, shape (M, 2r, axes), in units of position.

    Without the `moments` of a solution, the powers from r on are computed from the jets and lose
    digits if durations differ strongly.
    """
    axes, count, _, order = jets.shape
    coefficients = np.empty((count, 2 * order, axes))
    given = np.empty((0, 0, order)) if moments is None else moments
    blend(durations, jets, given, *moment_tables(order), coefficients)
    return coefficients


def duration_gradient(
    durations: Floats, jets: Floats, weights: Floats, *, per_axis: bool = False
) -> Floats:
    """Return dJ/dT_k at fixed derivatives at the knots, shape (M,), or one row per axis.

    At an optimum the free derivatives are stationary, so that this is the total derivative of the
    optimal value with respect to the duration (envelope theorem), without a second solve.
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
    return slope if per_axis else np.asarray(slope.sum(axis=0))


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
    continuity: the pivots of the factorisation then decide. `fixed` has shape (M + 1, r).
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
