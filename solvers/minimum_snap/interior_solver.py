"""The structured interior point on one chain: instants are added while the barrier falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Chain, Held
from .interior_kernels import (
    CONVERGED,
    STOPPED,
    bound_gradient,
    factorise,
    interior_point,
    multiply,
    row_values,
    solve_factors,
    transposed,
)
from .separation import outside

__all__ = ["ChainResult", "Settings", "solve_chain"]

Floats = NDArray[np.float64]

#: How far beyond its present size a coordinate may go before a proof of contradiction ends.
REACH = 1e4
#: Relative complementarity of the iterate from which added instants are taken up.
CENTRAL = 1e-3
#: Share of the first guess's objective that counts as 0.
NOTHING = 1e-9


@dataclass(frozen=True)
class Settings:
    """How far to go.

    Parameters
    ----------
    gap : float
        Relative complementarity at the end.
    tolerance : float
        Largest violation at the held instants, in normalised rows.
    between : float
        Largest violation between the instants, relative to ``max(1, |bound|)``.
    samples : int
        Instants of each segment held from the start.
    iterations : int
        Most Newton steps for one set of instants.
    rounds : int
        Most additions of instants.
    """

    gap: float = 1e-10
    tolerance: float = 1e-10
    between: float = 1e-8
    samples: int = 8
    iterations: int = 100
    rounds: int = 40


@dataclass(frozen=True)
class ChainResult:
    """What the interior point found for one chain.

    Parameters
    ----------
    status : str
        ``"solved"``, ``"infeasible"``, ``"stopped"`` or ``"stalled"``.
    powers : ndarray, shape (segments, degree + 1, axes)
        Coefficients in ascending powers of s.
    objective, bound : float
        Objective of the iterate, and the lower bound that its multipliers prove.
    primal, dual : float
        Largest residuals: of the rows, and of the gradient relative to the largest multiplier.
    iterations, rounds, instants : int
        Counts.
    conflict : ndarray of int
        Segments whose bounds prove that there is no solution.
    """

    status: str
    powers: Floats
    objective: float
    bound: float
    primal: float
    dual: float
    iterations: int
    rounds: int
    instants: int
    conflict: NDArray[np.int64]


class _State:
    """The iterate of one chain."""

    def __init__(self, chain: Chain, settings: Settings, flag: NDArray[np.int8]) -> None:
        self.chain, self.settings, self.flag = chain, settings, flag
        self.fixed, self.knots = chain.start()
        self.inner = np.zeros((chain.model.segments, chain.interior))
        # J = Σ |C y|² is twice what the kernel minimises, |C y|² / 2.
        self.cost = chain.cost()
        self.held = chain.first_instants(settings.samples)
        self._pose()
        self.scale = 1.0
        self._begin()

    def _pose(self) -> None:
        count = self.chain.model.segments
        self.rows, self.lower, self.upper, _ = self.chain.rows(self.held)
        self.start = np.searchsorted(self.held.segment, np.arange(count + 1)).astype(np.int64)

    def newton(self, weight: Floats, target: Floats, cost: Floats) -> None:
        """Move to the minimum of |cost y|² + |weight (rows y - target)|²."""
        count, _, width = cost.shape
        n = self.fixed.shape[1]
        own = width - 2 * n
        factors, last = np.zeros((count, own + n, width)), np.zeros((n, n))
        factorise(cost, self.rows, self.start, weight, self.fixed, factors, last)
        for _ in range(2):
            knots, inner = np.zeros_like(self.knots), np.zeros_like(self.inner)
            transposed(cost, -multiply(cost, self.knots, self.inner), knots, inner)
            off = target - row_values(self.rows, self.start, self.knots, self.inner)
            bound_gradient(self.rows, self.start, weight * weight * off, knots, inner)
            knots[self.fixed] = 0.0
            solve_factors(factors, last, self.fixed, knots, inner)
            self.knots += knots
            self.inner += inner

    def _begin(self) -> None:
        """Start smooth and near the middle of the bounds, with slacks and multipliers alike."""
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        target = np.where(
            low & high,
            (np.where(low, self.lower, 0.0) + np.where(high, self.upper, 0.0)) / 2,
            np.where(low, self.lower, np.where(high, self.upper, 0.0)),
        )
        typical = np.linalg.norm(self.cost, axis=2).max()
        weight = np.full(self.rows.shape[0], 1.0)
        self.newton(weight, target, self.cost / max(float(typical), 1e-300))
        value = multiply(self.cost, self.knots, self.inner)
        # Costs of the order of 1 keep multipliers, slacks and tolerances comparable.
        self.scale = 1.0 / max(float(np.sqrt(np.sum(value**2) / max(value.shape[0], 1))), 1e-12)
        self.cost = self.cost * self.scale
        at = row_values(self.rows, self.start, self.knots, self.inner)
        wide = np.where(low & high, (self.upper - self.lower) / 2, 1.0)
        least = np.maximum(0.1 * np.where(np.isfinite(wide), wide, 1.0), 1e-8)
        self.below = np.where(low, np.maximum(at - self.lower, least), 1.0)
        self.above = np.where(high, np.maximum(self.upper - at, least), 1.0)
        pairs = max(int(low.sum() + high.sum()), 1)
        mu = max(0.5 * float(np.sum((value * self.scale) ** 2)) / pairs, 1e-6)
        self.z_below = np.where(low, mu / self.below, 0.0)
        self.z_above = np.where(high, mu / self.above, 0.0)

    @property
    def iterate(self) -> tuple[Floats, ...]:
        """The present iterate, to come back to."""
        parts = (self.knots, self.inner, self.below, self.above, self.z_below, self.z_above)
        return tuple(part.copy() for part in parts)

    @iterate.setter
    def iterate(self, parts: tuple[Floats, ...]) -> None:
        copies = [part.copy() for part in parts]
        self.knots, self.inner, self.below, self.above, self.z_below, self.z_above = copies

    @property
    def nothing(self) -> float:
        """The objective, in the model's units, that counts as 0 beside the first guess's."""
        return NOTHING * self.chain.model.segments * 2.0 / self.scale**2

    def descend(self, gap: float) -> tuple[int, int, float, float, float, float]:
        """Run the kernel down to a relative complementarity of `gap`."""
        settings = self.settings
        outcome: tuple[int, int, float, float, float, float] = interior_point(
            self.cost, self.rows, self.start, self.lower, self.upper, self.fixed, self.knots,
            self.inner, self.below, self.above, self.z_below, self.z_above, gap,
            settings.tolerance if gap <= settings.gap else max(settings.tolerance, 0.01 * gap),
            settings.iterations, NOTHING * self.chain.model.segments, self.flag,
        )  # fmt: skip
        return outcome

    def powers(self) -> Floats:
        """Return the coefficients of the iterate."""
        return self.chain.powers(self.knots, self.inner)

    def missing(self, threshold: float) -> Held | None:
        """Return the instants at which the iterate lies outside by more than `threshold`."""
        polynomials, low, high, owners = self.chain.polynomials(self.powers())
        row, s, _ = outside(np.ascontiguousarray(polynomials), low, high, threshold)
        if not row.size:
            return None
        fresh = owners.taken(row)
        fresh = Held(fresh.bound, fresh.segment, fresh.which, s)
        known = dict.fromkeys(zip(self.held.bound.tolist(), self.held.segment.tolist(), self.held.which.tolist(), np.round(self.held.s, 9).tolist(), strict=True))  # fmt: skip
        keep = []
        for index, key in enumerate(
            zip(
                fresh.bound.tolist(), fresh.segment.tolist(), fresh.which.tolist(),
                np.round(fresh.s, 9).tolist(), strict=True,
            )
        ):  # fmt: skip
            if key not in known:
                known[key] = None
                keep.append(index)
        return fresh.taken(np.array(keep, np.int64)) if keep else None

    def add(self, fresh: Held, mu: float) -> None:
        """Hold the bounds at more instants, with slacks and multipliers at the barrier's level."""
        old = (self.below, self.above, self.z_below, self.z_above)
        self.held, order = self.held.joined(fresh).sorted()
        self._pose()
        new = np.flatnonzero(order >= old[0].size)
        at = row_values(self.rows, self.start, self.knots, self.inner)
        joined = []
        for part, default in zip(old, (1.0, 1.0, 0.0, 0.0), strict=True):
            joined.append(np.concatenate([part, np.full(fresh.s.size, default)])[order])
        self.below, self.above, self.z_below, self.z_above = joined
        least = np.sqrt(mu)
        for bound, slack, z, gap in (
            (self.lower, self.below, self.z_below, at - self.lower),
            (self.upper, self.above, self.z_above, self.upper - at),
        ):
            there = new[np.isfinite(bound[new])]
            slack[there] = np.maximum(np.abs(gap[there]), least)
            z[there] = mu / slack[there]

    def proven(self) -> tuple[float, float, float]:
        """Return objective, lower bound and dual residual, in the model's units.

        For any λ, ``|Cy|²/2 >= λ'Cy - |λ|²/2``: with multipliers z of the bounds this is linear in y
        but for a residual ``C'λ - G'z``, which is what no coordinate may gain from. λ = Cy leaves a
        residual as large as the rounding of y times C'C, so λ and z are refined by themselves: they
        are small where y is a position far from the origin.
        """
        count, _, width = self.cost.shape
        n = self.fixed.shape[1]
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        z_below, z_above = self.z_below.copy(), self.z_above.copy()
        d_below = np.where(low, z_below / self.below, 0.0)
        d_above = np.where(high, z_above / self.above, 0.0)
        factors, last = np.zeros((count, width - n, width)), np.zeros((n, n))
        weight = np.sqrt(d_below + d_above)
        factorise(self.cost, self.rows, self.start, weight, self.fixed, factors, last)
        value = multiply(self.cost, self.knots, self.inner)
        dual = value.copy()
        for turn in range(4):
            knots, inner = np.zeros_like(self.knots), np.zeros_like(self.inner)
            transposed(self.cost, dual, knots, inner)
            bound_gradient(self.rows, self.start, z_above - z_below, knots, inner)
            knots[self.fixed] = 0.0
            if turn == 3:
                break
            x_knots, x_inner = -knots, -inner
            solve_factors(factors, last, self.fixed, x_knots, x_inner)
            dual += multiply(self.cost, x_knots, x_inner)
            step = row_values(self.rows, self.start, x_knots, x_inner)
            z_below = np.maximum(z_below - d_below * step, 0.0)
            z_above = np.maximum(z_above + d_above * step, 0.0)
        reach_knots, reach_inner = self._reach()
        gain = float(np.sum(np.abs(knots) * reach_knots) + np.sum(np.abs(inner) * reach_inner))
        at = row_values(self.rows, self.start, self.knots, self.inner)
        slack = float(np.sum(z_below[low] * (at - self.lower)[low]))
        slack += float(np.sum(z_above[high] * (self.upper - at)[high]))
        half = 0.5 * float(np.sum(value**2))
        away = 0.5 * float(np.sum((value - dual) ** 2))
        unit = 2.0 / self.scale**2
        residual = max(float(np.abs(knots).max()), float(np.abs(inner).max(initial=0.0)))
        return half * unit, (half - away - slack - gain) * unit, residual

    def _reach(self) -> tuple[Floats, Floats]:
        """Return how far each coordinate may be from the optimum's.

        As far as the corridor and the limits at its knot allow, and ``max(1, |y|)`` without.
        """
        model, chain, r = self.chain.model, self.chain, self.chain.model.order
        knots = np.maximum(1.0, np.abs(self.knots))
        for bound in model.bounds:
            if bound.derivative >= r:
                continue
            wide = (bound.upper - bound.lower)[:, list(chain.axes)]
            wide = np.concatenate([wide, wide[-1:]])
            wide[1:-1] = np.minimum(wide[1:-1], wide[:-2])
            wide *= (chain.knot_times**bound.derivative)[:, None]
            own = knots[:, bound.derivative :: r]
            knots[:, bound.derivative :: r] = np.where(np.isfinite(wide), wide, own)
        return knots, np.maximum(1.0, np.abs(self.inner))

    def _refined_ray(self, below: Floats, above: Floats) -> tuple[Floats, Floats]:
        """Make ``G'z`` vanish, changing the ray in place; return what is left of it.

        The barrier only tends to a ray. The least change of the multipliers, each weighed by its
        own size over its slack, takes what is missing.
        """
        count, _, width = self.cost.shape
        n = self.fixed.shape[1]
        d_below, d_above = below / self.below, above / self.above
        largest = max(float((d_below + d_above).max()), 1e-300)
        d_below, d_above = d_below / largest, d_above / largest
        typical = max(float(np.linalg.norm(self.cost, axis=2).max()), 1e-300)
        factors, last = np.zeros((count, width - n, width)), np.zeros((n, n))
        factorise(
            self.cost * (1e-8 / typical), self.rows, self.start, np.sqrt(d_below + d_above),
            self.fixed, factors, last,
        )  # fmt: skip
        for turn in range(4):
            knots, inner = np.zeros_like(self.knots), np.zeros_like(self.inner)
            bound_gradient(self.rows, self.start, above - below, knots, inner)
            knots[self.fixed] = 0.0
            if turn < 3:
                x_knots, x_inner = -knots, -inner
                solve_factors(factors, last, self.fixed, x_knots, x_inner)
                step = row_values(self.rows, self.start, x_knots, x_inner)
                np.maximum(below - d_below * step, 0.0, out=below)
                np.maximum(above + d_above * step, 0.0, out=above)
        return knots, inner

    def contradiction(self) -> NDArray[np.int64] | None:
        """Return the segments whose bounds prove that no trajectory keeps them, None without proof.

        Where there is none, the multipliers grow without limit along a ray that proves it (Farkas):
        the weighted sum of the bounds' violations is positive, and no coordinate can lower it.
        The proof holds for all coordinates within :data:`REACH` times their present size.
        """
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        largest = max(float(self.z_below.max(initial=0.0)), float(self.z_above.max(initial=0.0)))
        if not largest > 1.0 or not np.isfinite(largest):
            return None
        below, above = self.z_below / largest, self.z_above / largest
        knots, inner = self._refined_ray(below, above)
        at = row_values(self.rows, self.start, self.knots, self.inner)
        violation = float(np.sum(below[low] * (self.lower - at)[low]))
        violation += float(np.sum(above[high] * (at - self.upper)[high]))
        gain = float(
            np.sum(np.abs(knots) * np.maximum(1.0, np.abs(self.knots)))
            + np.sum(np.abs(inner) * np.maximum(1.0, np.abs(self.inner)))
        )
        if not violation > REACH * gain:
            return None
        found: NDArray[np.int64] = np.unique(self.held.segment[(below + above) > 1e-3])
        return found


def solve_chain(chain: Chain, settings: Settings, flag: NDArray[np.int8]) -> ChainResult:
    """Solve one chain: the barrier falls in stages, and after each the instants are reviewed.

    An iterate close to the end is a bad start for more rows: its slacks are too small to give way.
    So the one at :data:`CENTRAL` is kept, and later additions begin there again.
    """
    state = _State(chain, settings, flag)
    pairs = max(int(np.isfinite(state.lower).sum() + np.isfinite(state.upper).sum()), 1)
    gap, iterations, rounds = 1e-1, 0, 0
    status, primal = "stalled", 0.0
    kept: tuple[Floats, ...] | None = None
    kept_mu = 0.0
    while rounds < settings.rounds:
        code, count, _, comp, primal, _ = state.descend(gap)
        iterations += count
        if code == STOPPED:
            status = "stopped"
            break
        if code != CONVERGED and gap > settings.gap:
            break
        fresh = state.missing(max(settings.between, 1e-2 * gap, 4.0 * primal))
        if fresh is None and gap <= settings.gap:
            status = "solved" if code == CONVERGED else "stalled"
            break
        if fresh is not None:
            mu = comp / pairs
            if gap < CENTRAL and kept is not None:
                state.iterate, mu, gap = kept, kept_mu, CENTRAL
            state.add(fresh, mu)
            rounds += 1
        if gap >= CENTRAL:
            kept, kept_mu = state.iterate, comp / pairs
        gap = settings.gap if gap <= CENTRAL else max(CENTRAL, gap * 1e-1)
    conflict = np.empty(0, np.int64)
    objective, bound, dual = state.proven()
    if status == "stalled":
        # Good enough is for the caller to judge by the bound; else see whether nothing can be.
        small = max(1e-6 * abs(objective), state.nothing)
        if abs(objective - bound) <= small and primal <= 1e-7:
            status = "solved"
        else:
            found = state.contradiction()
            if found is not None:
                status, conflict = "infeasible", found
    return ChainResult(
        status, state.powers(), objective, bound, primal, dual, iterations, rounds,
        int(state.held.s.size), conflict,
    )  # fmt: skip
