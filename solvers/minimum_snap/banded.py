"""Minimum-derivative piecewise polynomials in O(M), on plain arrays: the compiled solver.

``banded_fallback.solver`` chooses between this and the same without Numba.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .banded_kernels import accelerate, is_usual, jerk, snap
from .coefficient_kernels import coefficients_of
from .frontal_kernels import begin, descend, factorise
from .hermite import (
    ACCEPTED,
    MOST_REFINEMENTS,
    REFINED,
    SUSPECT,
    WORST,
    Info,
    Outcome,
    Solved,
    Table,
    has_one_optimum,
    moment_tables,
    patterns,
    table_of,
)
from .precise_kernels import factorise_precisely, precise_coefficients

__all__ = ["jets_to_coefficients", "solve_hermite"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_FUSED = {2: accelerate, 3: jerk, 4: snap}


def solve_hermite(
    durations: Floats, values: Floats, fixed: Bools, weights: Floats, continuity: int
) -> Solved:
    """Minimise ∫ Σ_j w_j (x^(j))² dt over piecewise polynomials of degree 2r-1.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k > 0, s.
    values : ndarray, shape (A, M + 1, r)
        Derivatives of order 0 … r-1 at the knots; read where `fixed`, so NaN may stand elsewhere.
    fixed : ndarray of bool, shape (A, M + 1, r)
        Which of them are given. Axes with the same pattern are factorised once.
    weights : ndarray, shape (r,)
        Of the orders 1 … r; none negative, the last one positive.
    continuity : int
        The highest derivative that neighbours share, 0 … r-1. One of a higher order that is free
        at a knot is free on each side of it; one that is fixed is fixed on both.

    Returns
    -------
    Solved
        Jets of shape (A, M, 2, r), objective of shape (A,), and ``Info``; nothing is raised.
    """
    durations = np.ascontiguousarray(durations, np.float64)
    values = np.ascontiguousarray(values, np.float64)
    fixed = np.ascontiguousarray(fixed, np.bool_)
    weights = np.asarray(weights, np.float64)
    axes, knots, order = values.shape
    jets = np.empty((axes, knots - 1, 2, order))
    objective = np.empty(axes)
    info: Info = {
        "outcome": Outcome.SOLVED,
        "residual": 0.0,
        "refinements": 0,
        "factorisations": 1,
        "pivot": None,
        "method": "fused",
        "lows": None,
    }
    usual = is_usual(fixed, continuity) and not weights[:-1].any()
    if usual:
        upper = np.empty((knots - 1, (order - 1) ** 2))
        work = np.empty((axes, knots - 1 if order == 4 else 0, 3))
        residual, failed, steps = _FUSED[order](durations, values, jets, objective, upper, work)
        objective *= weights[-1]
        info["residual"], info["refinements"] = residual, steps
        if failed < 0 and residual <= ACCEPTED:
            return Solved(jets, objective, info)
    table = table_of(weights)
    groups = list(patterns(fixed))
    info["factorisations"], info["residual"], info["refinements"] = len(groups), 0.0, 0
    state = _State(durations, values, table, continuity, jets, objective)
    for members in groups:
        pattern = fixed[members[0]]
        unique = has_one_optimum(durations, pattern, weights, continuity)
        if unique is False:
            outcome, pivot = Outcome.NOT_UNIQUE, None
        else:
            outcome, pivot = state.solve(
                members, pattern, info, doubtful=unique is None, refined=usual and order == 4
            )
        if outcome is not Outcome.SOLVED:
            info["outcome"], info["residual"], info["lows"] = outcome, np.inf, None
            info["pivot"] = None if pivot is None else (int(members[0]), *pivot)
            jets[:], objective[:] = np.nan, np.nan
            break
    return Solved(jets, objective, info)


def elimination_order(order: int, continuity: int) -> Ints:
    """Return the places of a front in the order in which they are eliminated."""
    shared = continuity + 1
    own = [*range(shared, order), *range(order + shared, 2 * order)]
    return np.array([*own, *range(shared)], np.int64)


#: Shares of the diagonal below which a pivot is taken for rounding, where only pivots can tell.
_SINGULAR = 1e-24


class _State(NamedTuple):
    """What all groups of axes share."""

    durations: Floats
    values: Floats
    table: Table
    continuity: int
    jets: Floats
    objective: Floats

    def solve(
        self, members: Ints, pattern: Bools, info: Info, *, doubtful: bool, refined: bool
    ) -> tuple[Outcome, tuple[int, int] | None]:
        """Solve the axes of one pattern; return the outcome and the pivot that failed.

        In ordinary floats first, unless the fused kernel has `refined` as far as they reach, and
        where they do not, in twice the digits.
        """
        knots, order = pattern.shape
        shared, table = self.continuity + 1, self.table
        slots = elimination_order(order, self.continuity)
        columns = np.zeros((knots, 2 * order, 2 * order))
        pivots = np.zeros((knots, 2 * order))
        none = np.empty((0, 0, 2, order))
        residual, steps = np.inf, 0
        for precise in (True,) if refined else (False, True):
            begin(self.values, pattern, members, self.jets)
            if precise:
                info["method"] = "precise"
                failed = factorise_precisely(
                    self.durations, pattern, table.grams, table.gram_lows, table.gram_weights,
                    table.gram_orders, slots, shared, _SINGULAR if doubtful else 0.0, columns, pivots,
                )  # fmt: skip
                lows = np.zeros(self.jets.shape) if info["lows"] is None else info["lows"]
                info["lows"] = lows
            else:
                if info["method"] != "precise":
                    info["method"] = "frontal"
                failed = factorise(
                    self.durations, pattern, table.grams, table.gram_weights, table.gram_orders,
                    slots, shared, SUSPECT if doubtful else 0.0, columns, pivots,
                )  # fmt: skip
                lows = none
            if failed >= 0:
                continue
            residual, steps = descend(
                self.durations, pattern, table.rows, table.factors, table.orders, slots, shared,
                columns, pivots, members, self.jets, lows, self.objective, REFINED,
                MOST_REFINEMENTS + 1,
            )  # fmt: skip
            if residual <= REFINED:
                break
        if failed >= 0:
            outcome = Outcome.NOT_UNIQUE if doubtful else Outcome.ILL_CONDITIONED
            return outcome, (int(failed) // order, int(failed) % order)
        info["residual"] = max(info["residual"], residual)
        info["refinements"] = max(info["refinements"], steps - 1)
        return Outcome.SOLVED if residual <= WORST else Outcome.ILL_CONDITIONED, None


def jets_to_coefficients(durations: Floats, jets: Floats, lows: Floats | None = None) -> Floats:
    """Return ascending powers of s = (t - t_k) / T_k.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    jets : ndarray, shape (A, M, 2, r)
        Derivatives 0 … r-1 at the start and the end of each segment.
    lows : ndarray, shape (A, M, 2, r), optional
        ``info["lows"]``: what rounding left of the jets.

    Returns
    -------
    ndarray, shape (M, 2r, A)
        In units of position.
    """
    durations = np.ascontiguousarray(durations, np.float64)
    jets = np.ascontiguousarray(jets, np.float64)
    axes, count, _, order = jets.shape
    coefficients = np.empty((count, 2 * order, axes))
    parts = moment_tables(order)
    if lows is None:
        coefficients_of(durations, jets, *parts, coefficients)
    else:
        precise_coefficients(durations, jets, lows, *parts, coefficients)
    return coefficients
