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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .moment_kernels import blend
from .tables import Table, moment_tables, table_of

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
        step, relative to the largest of them. 0 without refinement, for which the error is known to
        be about 1e-11 and is not measured.
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
