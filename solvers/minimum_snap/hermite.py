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

#: Correction of a segment, relative to its size, up to which its shape is certified.
CERTIFIED = 1e-9
#: Share of what is given that a segment in which little happens is held against.
FLOOR = 1e-6


class Outcome(IntEnum):
    """How a solve ended."""

    SOLVED = 0
    #: Some motion costs nothing and moves no fixed entry: there is no unique optimum.
    NOT_UNIQUE = 1
    #: The durations differ so much that double precision cannot tell.
    ILL_CONDITIONED = 2


class Solved(NamedTuple):
    """What a solve found.

    Parameters
    ----------
    jets : ndarray, shape (axes, segments, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment; NaN unless ``SOLVED``.
    moments : ndarray, shape (axes, segments, r), or None
        Legendre moments of the r-th derivative, with digits that the jets cannot hold where
        durations differ wildly; None where the jets say as much.
    objective : ndarray, shape (axes,)
        J of each axis; NaN unless ``SOLVED``.
    outcome : Outcome
        How it ended.
    correction : float
        How far the scaled derivatives at the ends of a segment are off, by the last Newton step,
        relative to the largest of them: the worst segment's. NaN where durations are so calm that
        it is known to be about 1e-11, and nothing was measured.
    segment : int
        Where that is.
    gap : float
        By how much J may be above its optimum: half the gradient times the last Newton step, and
        what rounding does to the moments.
    refinements : int
        Newton steps after the first one, the most of all groups of axes.
    factorisations : int
        Groups of axes with a pattern of their own.
    method : str
        ``"calm"`` or ``"refined"``, the kernels for waypoints alone; ``"general"``, those for any
        pattern; or ``"boundary"``, the slow way of :mod:`~.boundary`.
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
    """Return y, shape (axes, segments, 2r), with positions counted from the start of the segment.

    So no digits are lost where a path runs far from the origin: only differences cost anything.
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
        ``Solved.moments``, for the powers from r on. Without them they come from the jets, and lose
        digits where durations differ wildly.

    Returns
    -------
    ndarray, shape (M, 2r, A)
        In units of position.
    """
    axes, count, _, order = jets.shape
    coefficients = np.empty((count, 2 * order, axes))
    given = np.empty((0, 0, order)) if moments is None else moments
    blend(durations, jets, given, *moment_tables(order), coefficients)
    return coefficients


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
    table = table_of(weights)
    scaled = scaled_jets(durations, jets)
    moments = scaled @ table.rows.T
    # d y_i / dT = i y_i / T; what follows is multiplied by T throughout.
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
    return bool(np.linalg.matrix_rank(np.concatenate(rows), tol=1e-13) == least)
