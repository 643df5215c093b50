"""Piecewise polynomials by their derivatives at the knots: exact tables, objective, gradient.

A segment of duration T is a polynomial of degree 2r-1 in s = (t - t_k) / T. Its *jet* is its
derivatives of order 0 … r-1 at both ends; y_i = T^i d_i are the same in units of position. The j-th
derivative is expanded in Legendre polynomials on [0, 1], g_i = ∫ x^(j) P_i ds, so that

    ∫ (x^(j))² dt = T^(1-2j) Σ_i (2i + 1) g_i²

is a sum of squares, which loses no digits to cancellation as y'Qy does. For j = r integration by
parts gives the g_i as sums of y with whole numbers, and none of higher index exist.

Sources: Richter, Bry and Roy, "Polynomial trajectory planning for aggressive quadrotor flight",
2013 (derivatives at the knots as unknowns); Wang, Zhou, Xu and Gao, "Geometrically constrained
trajectory optimization for multicopters" (MINCO), 2022 (O(M), gradients of durations).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from .tables import Table, moment_tables, moments_of_powers, table_of

__all__ = [
    "ACCEPTED",
    "MOST_REFINEMENTS",
    "REFINED",
    "SUSPECT",
    "WORST",
    "Info",
    "Outcome",
    "Solved",
    "Table",
    "duration_gradient",
    "has_one_optimum",
    "jets_to_coefficients",
    "moment_tables",
    "objective_of_coefficients",
    "objective_of_jets",
    "patterns",
    "scaled_jets",
    "table_of",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

#: Jumps of a derivative, relative to its largest value, below which nothing is refined.
REFINED = 2e-12
#: Jumps up to which ordinary floats are left alone where they reach no further.
ACCEPTED = 5e-12
#: Jumps above which there is no solution to speak of.
WORST = 1e-6
#: Shares of the diagonal below which a pivot may be rounding.
SUSPECT = 1e-13
#: Newton steps after the first one.
MOST_REFINEMENTS = 6


class Outcome(IntEnum):
    """How a solve ended."""

    SOLVED = 0
    #: Some motion costs nothing and moves no fixed entry: there is no unique optimum.
    NOT_UNIQUE = 1
    #: The durations differ so much that double precision cannot tell.
    ILL_CONDITIONED = 2


class Info(TypedDict):
    """What a solve says of itself.

    Parameters
    ----------
    outcome : Outcome
        Jets and objective are NaN unless it is ``SOLVED``.
    residual : float
        Worst jump of a derivative of order r … 2r-1 across a knot where its counterpart is free
        (stationarity), relative to the largest value of that derivative on its axis.
    refinements : int
        Newton steps after the first one, the most of all groups of axes.
    factorisations : int
        Groups of axes with a pattern of their own.
    pivot : (int, int, int) or None
        Axis, knot and order of the derivative at which the elimination broke down.
    method : str
        ``"fused"``, ``"frontal"``, ``"precise"`` or ``"scipy"``: how far it had to go.
    lows : ndarray, shape (axes, segments, 2, r), or None
        Where ordinary floats do not reach, what rounding left of the jets: add it before anything
        cancels, as ``jets_to_coefficients`` does.
    """

    outcome: Outcome
    residual: float
    refinements: int
    factorisations: int
    pivot: tuple[int, int, int] | None
    method: str
    lows: Floats | None


class Solved(NamedTuple):
    """Jets, shape (axes, segments, 2, r); objective, shape (axes,); and what was met on the way."""

    jets: Floats
    objective: Floats
    info: Info


# -- algebra --------------------------------------------------------------------------------------


def scaled_jets(durations: Floats, jets: Floats) -> Floats:
    """Return y, shape (axes, segments, 2r), with positions counted from the start of the segment.

    So no digits are lost where a path runs far from the origin: only differences cost anything.
    """
    order = jets.shape[-1]
    scaled = jets * (durations[:, None] ** np.arange(order))[:, None, :]
    scaled[:, :, 1, 0] = jets[:, :, 1, 0] - jets[:, :, 0, 0]
    scaled[:, :, 0, 0] = 0.0
    return scaled.reshape(*jets.shape[:2], 2 * order)


def jets_to_coefficients(durations: Floats, jets: Floats, lows: Floats | None = None) -> Floats:
    """Return ascending powers of s = (t - t_k) / T_k.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    jets : ndarray, shape (A, M, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment.
    lows : ndarray, shape (A, M, 2, r), optional
        What rounding left of the jets; here it is merely added.

    Returns
    -------
    ndarray, shape (M, 2r, A)
        In units of position.
    """
    order = jets.shape[-1]
    rows, blend, factorials = moment_tables(order)
    scaled = scaled_jets(durations, jets)
    moments = scaled @ rows.T
    if lows is not None:
        moments += scaled_jets(durations, lows) @ rows.T
    coefficients = np.empty((len(durations), 2 * order, len(jets)))
    coefficients[:, 0] = jets[:, :, 0, 0].T
    coefficients[:, 1:order] = np.moveaxis(scaled[:, :, 1:order] / factorials[1:], 0, 2)
    coefficients[:, order:] = np.moveaxis(moments @ blend.T, 0, 2)
    return coefficients


def _per_segment(durations: Floats, jets: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return cost and its derivative by the duration, both of shape (A, M)."""
    table = table_of(weights)
    order = jets.shape[-1]
    scaled = scaled_jets(durations, jets)
    moments = scaled @ table.rows.T
    # d y_i / dT = i y_i / T; what follows is multiplied by T throughout.
    slopes = (scaled * np.tile(np.arange(order), 2)) @ table.rows.T
    powers = 1.0 - 2.0 * table.orders
    scale = table.factors * durations[:, None] ** powers
    cost: Floats = np.einsum("kn,akn,akn->ak", scale, moments, moments)
    slope: Floats = np.einsum("kn,akn,akn->ak", scale, moments, powers * moments + 2.0 * slopes)
    return cost, slope / durations


def objective_of_jets(durations: Floats, jets: Floats, weights: Floats) -> Floats:
    """Return ∫ Σ w_j (x^(j))² dt of each axis, shape (A,)."""
    cost: Floats = _per_segment(durations, jets, weights)[0].sum(axis=1)
    return cost


def duration_gradient(
    durations: Floats, jets: Floats, weights: Floats, *, per_axis: bool = False
) -> Floats:
    """Return dJ/dT_k while the derivatives at the knots stay as they are.

    At an optimum the free ones are stationary, so this is the whole derivative of the optimal value
    by the duration (the envelope theorem): no second solve is needed.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    jets : ndarray, shape (A, M, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment.
    weights : ndarray, shape (r,)
        Of the orders 1 … r.
    per_axis : bool
        Whether the axes are left apart.

    Returns
    -------
    ndarray, shape (M,), or (A, M) with `per_axis`
        J per second.
    """
    slope = _per_segment(durations, jets, weights)[1]
    if per_axis:
        return slope
    total: Floats = slope.sum(axis=0)
    return total


def objective_of_coefficients(durations: Floats, coefficients: Floats, weights: Floats) -> Floats:
    """Return ∫ Σ w_j (x^(j))² dt of each axis by closed form, shape (A,).

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    coefficients : ndarray, shape (M, 2r, A)
        Ascending powers of s in [0, 1].
    weights : ndarray, shape (r,)
        Of the orders 1 … r.
    """
    order = len(weights)
    total = np.zeros(coefficients.shape[2])
    for j, weight in enumerate(weights, start=1):
        if weight:
            moments = np.einsum("in,kna->kia", moments_of_powers(order, j), coefficients)
            norms = 2.0 * np.arange(2 * order - j) + 1.0
            total += weight * np.einsum(
                "k,i,kia,kia->a", durations ** (1.0 - 2.0 * j), norms, moments, moments
            )
    return total


def patterns(fixed: Bools) -> Iterator[Ints]:
    """Yield the axes that share a pattern of fixed entries, the patterns as they come."""
    left = list(range(len(fixed)))
    while left:
        same = [a for a in left if a == left[0] or np.array_equal(fixed[a], fixed[left[0]])]
        left = [a for a in left if a not in same]
        yield np.array(same, np.int64)


def has_one_optimum(
    durations: Floats, fixed: Bools, weights: Floats, continuity: int
) -> bool | None:
    """Return whether the fixed entries of one axis leave no motion free of cost.

    What costs nothing has x^(j) = 0 for the least order j with a weight. Where `continuity` is j-1
    or more it is one polynomial of degree < j for the whole path, which must vanish with all that
    is fixed (a Birkhoff problem), whatever the durations. Otherwise None: the pivots must tell.

    Parameters
    ----------
    fixed : ndarray of bool, shape (M + 1, r)
        Of one axis.
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
    return bool(np.linalg.matrix_rank(np.concatenate(rows), tol=1e-10) == least)
