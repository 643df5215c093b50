"""Minimum-derivative piecewise polynomials in O(M), on plain arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .banded_kernels import accelerate, is_usual, jerk, snap
from .chain_kernels import factorise, solve_factors
from .hermite import (
    ACCEPTED,
    MOST_REFINEMENTS,
    REFINED,
    WORST,
    Outcome,
    Solved,
    has_one_optimum,
    patterns,
    table_of,
)
from .moment_kernels import differentiate

__all__ = ["solve_hermite"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Kernels for waypoints alone. At 1,000 segments they take a sixth of the general solve's time: see
#: ``tests/benchmarks/minimum_snap/test_minimum_snap_speed.py``.
_FUSED = {2: accelerate, 3: jerk, 4: snap}
#: Pivots below this share of their column are rounding, where only pivots can tell.
_SINGULAR = 1e-12
#: Newton steps that may stand still where the solution is far from the start.
_PATIENCE = 4
#: Jumps below this share of what cancels in them are no information: twice a float's digits less 4.
_FLOOR = 1e-28


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
        With the outcome; nothing is raised.
    """
    durations = np.ascontiguousarray(durations, np.float64)
    values = np.ascontiguousarray(values, np.float64)
    fixed = np.ascontiguousarray(fixed, np.bool_)
    weights = np.asarray(weights, np.float64)
    axes, knots, order = values.shape
    jets = np.empty((axes, knots - 1, 2, order))
    objective = np.empty(axes)
    if is_usual(fixed, continuity) and not weights[:-1].any():
        upper = np.empty((knots - 1, (order - 1) ** 2))
        work = np.empty((axes, knots - 1 if order == 4 else 0, 3))
        residual, failed, steps = _FUSED[order](durations, values, jets, objective, upper, work)
        if failed < 0 and residual <= ACCEPTED:
            objective *= weights[-1]
            return Solved(jets, None, objective, Outcome.SOLVED, residual, steps, 1, "fused")
    moments = np.empty((axes, knots - 1, order))
    groups = list(patterns(fixed))
    worst, most = 0.0, 0
    for members in groups:
        pattern = fixed[members[0]]
        unique = has_one_optimum(durations, pattern, weights, continuity)
        outcome, residual, steps = Outcome.NOT_UNIQUE, np.inf, 0
        if unique is not False:
            system = _System(durations, pattern, weights, continuity)
            if system.factorise(_SINGULAR if unique is None else 0.0):
                descent = system.descend(values[members])
                jets[members], moments[members], objective[members], residual, steps = descent
                outcome = Outcome.SOLVED if residual <= WORST else Outcome.ILL_CONDITIONED
            elif unique:
                outcome = Outcome.ILL_CONDITIONED
        worst, most = max(worst, residual), max(most, steps - 1)
        if outcome is not Outcome.SOLVED:
            jets[:], objective[:] = np.nan, np.nan
            break
    return Solved(jets, moments, objective, outcome, worst, most, len(groups), "general")


class _Descent(NamedTuple):
    """Where Newton's method ended: see :class:`~.hermite.Solved`."""

    jets: Floats
    moments: Floats
    objective: Floats
    residual: float
    steps: int


class _System:
    """The optimality conditions of one pattern of fixed entries.

    J is a sum of squares of Legendre moments, and their rows are what is factorised: where durations
    differ by a factor of 400, the Hessian's condition number is beyond double precision, and that of
    its root is not. Newton's method on a quadratic is exact from any start, so that refinement is
    the same step again, with the gradient in twice the digits.
    """

    def __init__(self, durations: Floats, pattern: Bools, weights: Floats, continuity: int) -> None:
        self.durations, self.pattern = durations, pattern
        self.table = table_of(weights)
        self.order, self.shared = len(weights), continuity + 1

    def factorise(self, least: float) -> bool:
        """Factorise; return whether every pivot is more than the share `least` of its column."""
        r, s, table = self.order, self.shared, self.table
        count = self.durations.size
        size = np.sqrt(table.factors * self.durations[:, None] ** (1.0 - 2.0 * table.orders))
        units = np.tile(self.durations[:, None] ** np.arange(r), 2)
        # What neighbours do not share belongs to the segment alone: it comes last.
        own = [*range(s, r), *range(r + s, 2 * r)]
        places = [*range(s), *range(r, r + s), *own]
        rows = size[:, :, None] * table.rows[:, places] * units[:, None, places]
        # In one memory order, for which the kernels are compiled once.
        rows = np.ascontiguousarray(rows)
        free = ~np.concatenate([self.pattern[:-1], self.pattern[1:]], axis=1)
        self.own = free[:, own]
        rows[:, :, 2 * s :] *= self.own[:, None]
        self.held = np.ascontiguousarray(self.pattern[:, :s])
        self.factors = np.zeros((count, len(own) + s, 2 * r))
        self.last = np.zeros((s, s))
        factorise(
            rows, np.empty((0, 2 * r)), np.zeros(count + 1, np.int64), np.empty(0), self.held,
            self.factors, self.last,
        )  # fmt: skip
        squares = np.einsum("kcp,kcp->kp", rows, rows)
        knots = np.zeros((count + 1, s))
        knots[:-1] += squares[:, :s]
        knots[1:] += squares[:, s : 2 * s]
        pivots = np.abs(np.einsum("kii->ki", self.factors[:, :, : len(own) + s]))
        ends = np.concatenate([pivots[:, len(own) :], np.abs(np.diag(self.last))[None]])
        return bool(
            (self.held | (ends > least * np.sqrt(knots))).all()
            and (~self.own | (pivots[:, : len(own)] > least * np.sqrt(squares[:, 2 * s :]))).all()
        )

    def descend(self, values: Floats) -> _Descent:
        """Take Newton steps from the fixed `values` of some axes until the jumps are rounding."""
        r, s, table = self.order, self.shared, self.table
        jets = _begin(values, self.pattern)
        lows, forces = np.zeros_like(jets), np.empty_like(jets)
        axes, count = jets.shape[:2]
        moments = np.empty((axes, count, len(table.rows)))
        sizes, bounds, objective = np.empty((axes, r)), np.empty((axes, r)), np.empty(axes)
        steps, before = 0, np.inf
        while True:
            differentiate(
                self.durations, table.rows, table.factors, table.orders, jets, lows, forces,
                moments, sizes, bounds, objective,
            )  # fmt: skip
            knots = np.zeros((axes, count + 1, s))
            knots[:, :-1] -= forces[:, :, 0, :s]
            knots[:, 1:] -= forces[:, :, 1, :s]
            knots[:, self.held] = 0.0
            inner = -forces[..., s:].reshape(axes, count, 2 * (r - s)) * self.own
            jumps = np.zeros((axes, r))
            jumps[:, :s] = np.abs(knots).max(axis=1)
            jumps[:, s:] = np.abs(inner).reshape(axes, 2 * count, r - s).max(axis=1)
            counts = jumps > _FLOOR * bounds
            residual = float((jumps[counts] / sizes[counts]).max(initial=0.0))
            # Where a derivative vanishes, jumps and sizes shrink alike.
            progress = float((jumps[counts] / bounds[counts]).max(initial=0.0))
            # Written so that what is not a number stops, and is no solution.
            stuck = steps > _PATIENCE and not progress < 0.5 * before
            if not residual > REFINED or steps > MOST_REFINEMENTS or stuck:
                worst = residual if np.isfinite(jets).all() else np.inf
                return _Descent(jets, moments[..., -r:], objective, worst, steps)
            before = progress
            steps += 1
            for a in range(axes):
                solve_factors(self.factors, self.last, self.held, knots[a], inner[a])
            step = np.empty_like(jets)
            step[:, :, 0, :s], step[:, :, 1, :s] = knots[:, :-1], knots[:, 1:]
            step[..., s:] = inner.reshape(axes, count, 2, r - s)
            jets, lows = _added(jets, lows, step)


def _begin(values: Floats, pattern: Bools) -> Floats:
    """Return jets with what is fixed; free positions take the fixed one before, the rest is 0."""
    state = np.where(pattern, values, 0.0)
    held = np.flatnonzero(pattern[:, 0])
    if held.size:
        place = np.searchsorted(held, np.arange(len(pattern)), "right") - 1
        state[:, :, 0] = state[:, held[np.maximum(place, 0)], 0]
    return np.stack([state[:, :-1], state[:, 1:]], axis=2)


def _added(high: Floats, low: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Return ``high + low + step`` as a float and what rounding left of it (Dekker 1971)."""
    total = high + step
    back = total - high
    rest = (high - (total - back)) + (step - back) + low
    result = total + rest
    return result, rest - (result - total)
