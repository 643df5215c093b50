"""Solver for minimum-derivative piecewise polynomials in O(M), on plain arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .boundary import solve_boundary
from .chain_kernels import factorise, solve_factors
from .hermite import (
    CERTIFIED,
    FLOOR,
    Outcome,
    Solved,
    has_one_optimum,
    patterns,
    scaled_jets,
    table_of,
)
from .moment_kernels import differentiate
from .refined_kernels import MOST_ORDER, is_usual, refined

__all__ = ["added", "knot_forces", "solve_hermite"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Largest rounding error of J from moments in double precision, relative to J.
_BLUR = 1e-9
#: Pivots below this share of their column are rounding errors. Used if only pivots can detect a
#: singular system.
_SINGULAR = 1e-12
#: Corrections below this share of a segment's size are rounding errors, which ends refinement.
_DONE = 1e-15
#: Largest number of Newton steps, and of steps without progress far from the solution. One step
#: suffices for similar durations. For durations that differ by 1e6, each step divides the gap by
#: about 1e3.
_STEPS = 12
_PATIENCE = 4
_ULP = float(np.finfo(float).eps)


def solve_hermite(
    durations: Floats,
    values: Floats,
    fixed: Bools,
    weights: Floats,
    continuity: int,
    *,
    certify: bool = False,
) -> Solved:
    """Minimise ∫ Σ_j w_j (x^(j))² dt over piecewise polynomials of degree 2r-1.

    `values`, shape (A, M + 1, r), are the derivatives of order 0 … r-1 at the knots, and `fixed` is
    the mask of the fixed ones; free entries are ignored and may be NaN. Axes with the same pattern
    share one factorisation. `weights` are those of the orders 1 … r, the last one positive.
    `continuity` is the highest order of a derivative that neighbours share: a free derivative of a
    higher order is free on each side of a knot, and a fixed one is fixed on both sides. If `certify`,
    refine until the last correction proves the shape; otherwise stop as soon as the next correction
    would prove it. The function raises no exception.
    """
    durations = np.ascontiguousarray(durations, np.float64)
    values = np.ascontiguousarray(values, np.float64)
    fixed = np.ascontiguousarray(fixed, np.bool_)
    weights = np.asarray(weights, np.float64)
    axes, knots, order = values.shape
    if is_usual(fixed, continuity) and not weights[:-1].any():
        if order <= MOST_ORDER:
            quick = _refined(durations, values, weights, certify)
            accurate = not quick.refinements or quick.gap <= _BLUR * quick.objective.sum()
            if quick.outcome is Outcome.SOLVED and accurate:
                return quick
    jets, objective = np.empty((axes, knots - 1, 2, order)), np.empty(axes)
    moments = np.empty((axes, knots - 1, order))
    groups = list(patterns(fixed))
    correction, segment, gap, most = 0.0, 0, 0.0, 0
    methods: set[str] = set()
    for members in groups:
        pattern = fixed[members[0]]
        unique = has_one_optimum(durations, pattern, weights, continuity)
        result: Solved | None = None
        if unique is not False:
            system = _System(durations, pattern, weights, continuity)
            if system.factorise(_SINGULAR if unique is None else 0.0):
                result = system.descend(values[members])
            if (result is None and unique) or (
                result is not None and result.correction > CERTIFIED
            ):
                # With free positions it was observed to converge to a point that is not optimal.
                if not weights[:-1].any() and pattern[:, 0].all():
                    result = solve_boundary(
                        durations, values[members], pattern, weights[-1], continuity,
                        system.floor(values[members]),
                    )  # fmt: skip
        if result is None or result.outcome is not Outcome.SOLVED:
            jets[:], objective[:] = np.nan, np.nan
            outcome = Outcome.ILL_CONDITIONED if unique or result else Outcome.NOT_UNIQUE
            return Solved(
                jets, None, objective, outcome, np.nan, 0, np.inf, 0, len(groups), "general"
            )
        jets[members], moments[members] = result.jets, result.moments
        objective[members] = result.objective
        segment = result.segment if result.correction > correction else segment
        correction, gap = max(correction, result.correction), gap + result.gap
        most = max(most, result.refinements)
        methods.add(result.method)
    return Solved(
        jets, moments, objective, Outcome.SOLVED, correction, segment, gap, most, len(groups),
        min(methods),
    )  # fmt: skip


def _refined(durations: Floats, values: Floats, weights: Floats, certify: bool) -> Solved:
    """Solve for waypoints alone."""
    axes, knots, order = values.shape
    table = table_of(weights)
    jets, objective = np.empty((axes, knots - 1, 2, order)), np.empty(axes)
    failed, steps, correction, segment, gap, rounding = refined(
        tuple(range(1, order)), durations, values, table.rows, table.factors, certify, jets, objective,
        np.empty((knots - 1, 2, order - 1, order - 1)), np.empty((axes, knots - 1, order - 1)),
    )  # fmt: skip
    outcome = Outcome.SOLVED if failed < 0 else Outcome.ILL_CONDITIONED
    if steps == 0 and failed < 0:
        correction, gap = np.nan, np.inf
    return Solved(
        jets, None, objective, outcome, correction, segment, gap + rounding, steps, 1, "refined"
    )


class _System:
    """Optimality conditions for one pattern of fixed entries.

    J is a sum of squares of Legendre moments. The system factorises their rows, not the Hessian: for
    durations that differ by a factor of 400, the condition number of the Hessian exceeds double
    precision, and that of its square root does not. Newton's method on a quadratic is exact from any
    start, so that refinement repeats the step with the gradient in twice the digits. The step
    estimates the error of the jets of each segment. The gradient times the step estimates how far J
    is above its optimum.
    """

    def __init__(self, durations: Floats, pattern: Bools, weights: Floats, continuity: int) -> None:
        self.durations, self.pattern = durations, pattern
        self.table = table_of(weights)
        self.order, self.shared = len(weights), continuity + 1

    def factorise(self, least: float) -> bool:
        """Factorise, and return whether every pivot exceeds the share `least` of its column."""
        r, s, table = self.order, self.shared, self.table
        count = self.durations.size
        size = np.sqrt(table.factors * self.durations[:, None] ** (1.0 - 2.0 * table.orders))
        units = np.tile(self.durations[:, None] ** np.arange(r), 2)
        # Derivatives that neighbours do not share belong to one segment and come last.
        own = [*range(s, r), *range(r + s, 2 * r)]
        places = [*range(s), *range(r, r + s), *own]
        rows = size[:, :, None] * table.rows[:, places] * units[:, None, places]
        # A single memory order requires only one compilation of the kernels.
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

    def floor(self, values: Floats) -> Floats:
        """Return the minimum scale of corrections, for segments with little motion, one per axis."""
        floor: Floats = FLOOR * _sizes(self.durations, _begin(values, self.pattern)).max(axis=1)
        return floor

    def descend(self, values: Floats) -> Solved:
        """Take Newton steps from the fixed `values` of some axes until steps are rounding errors."""
        r, s, table = self.order, self.shared, self.table
        jets = _begin(values, self.pattern)
        lows, forces, rests = np.zeros_like(jets), np.empty_like(jets), np.empty_like(jets)
        axes, count = jets.shape[:2]
        moments = np.empty((axes, count, len(table.rows)))
        objective = np.empty(axes)
        units = self.durations[:, None, None] ** np.arange(r)
        floor = self.floor(values)[:, None]
        # The first step is the solution itself, without a correction.
        steps, correction, segment, before = 0, np.inf, 0, (np.inf, np.inf)
        while True:
            differentiate(
                self.durations, table.rows, table.factors, table.orders, jets, lows, forces,
                rests, moments, objective,
            )  # fmt: skip
            knots = -knot_forces(forces, rests, s)
            knots[:, self.held] = 0.0
            inner = -forces[..., s:].reshape(axes, count, 2 * (r - s)) * self.own
            pull = [knots.copy(), inner.copy()]
            for a in range(axes):
                solve_factors(self.factors, self.last, self.held, knots[a], inner[a])
            with np.errstate(all="ignore"):  # an overflow proves nothing and is rejected below
                gap = abs(float((pull[0] * knots).sum() + (pull[1] * inner).sum()))
            step = np.empty_like(jets)
            step[:, :, 0, :s], step[:, :, 1, :s] = knots[:, :-1], knots[:, 1:]
            step[..., s:] = inner.reshape(axes, count, 2, r - s)
            if steps:
                off = np.abs(step * units).reshape(axes, count, -1).max(axis=2)
                share = np.zeros_like(off)
                np.divide(off, _sizes(self.durations, jets) + floor, out=share, where=off != 0)
                segment = int(share.max(axis=0).argmax())
                correction = float(share.max())
            # The comparisons are false for NaN, which therefore ends the loop without a solution.
            now = correction, gap
            stuck = steps > _PATIENCE and not (now[0] < 0.5 * before[0] or now[1] < 0.5 * before[1])
            if not correction > _DONE or steps > _STEPS or stuck:
                if not (np.isfinite(jets).all() and np.isfinite(correction)):
                    correction = np.inf
                outcome = Outcome.SOLVED if correction < 1.0 else Outcome.ILL_CONDITIONED
                gap += 32.0 * _ULP * float(objective.sum())
                return Solved(
                    jets, moments[..., -r:], objective, outcome, correction, segment, gap,
                    steps - 1, 1, "general",
                )  # fmt: skip
            before = now
            steps += 1
            jets, lows = added(jets, lows, step)


def _sizes(durations: Floats, jets: Floats) -> Floats:
    """Return the largest scaled derivative of each segment, shape (axes, segments)."""
    largest: Floats = np.abs(scaled_jets(durations, jets)).max(axis=2)
    return largest


def _begin(values: Floats, pattern: Bools) -> Floats:
    """Return jets with the fixed values. Free positions repeat the previous one, the rest is 0."""
    state = np.where(pattern, values, 0.0)
    held = np.flatnonzero(pattern[:, 0])
    if held.size:
        place = np.searchsorted(held, np.arange(len(pattern)), "right") - 1
        state[:, :, 0] = state[:, held[np.maximum(place, 0)], 0]
    return np.stack([state[:, :-1], state[:, 1:]], axis=2)


def knot_forces(forces: Floats, rests: Floats, shared: int) -> Floats:
    """Return the sum of both segments' gradients for the derivatives that neighbours share.

    `forces` are half the derivative of J with respect to the jets, and `rests` rounding remainders.
    """
    axes, count = forces.shape[:2]
    knots = np.empty((axes, count + 1, shared))
    knots[:, 0], knots[:, -1] = forces[:, 0, 0, :shared], forces[:, -1, 1, :shared]
    left, right = forces[:, :-1, 1, :shared], forces[:, 1:, 0, :shared]
    rest = rests[:, :-1, 1, :shared] + rests[:, 1:, 0, :shared]
    knots[:, 1:-1] = added(left, rest, right)[0]
    return knots


def added(high: Floats, low: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Return ``high + low + step`` as a float and its rounding remainder (Dekker 1971)."""
    total = high + step
    back = total - high
    rest = (high - (total - back)) + (step - back) + low
    result = total + rest
    return result, rest - (result - total)
