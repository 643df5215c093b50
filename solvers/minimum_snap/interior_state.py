"""Iterate of the structured interior point on one chain, and the imposed instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.instants import Instants
from .chain import Chain
from .chain_kernels import (
    bound_gradient,
    factorise,
    multiply,
    row_values,
    solve_factors,
    transposed,
)
from .interior_kernels import interior_point
from .separation import outside

__all__ = ["Iterate", "Settings", "State"]

Floats = NDArray[np.float64]

#: Objectives below this share of the initial objective are treated as 0.
NOTHING = 1e-9
#: Mean square of the costs of a segment below which their unit is reduced, and the largest
#: reduction. The mean square is about 1 in the initial iterate.
SMALL, MOST = 1e-6, 30.0


@dataclass(frozen=True)
class Settings:
    """Termination criteria and limits of the interior point.

    Parameters
    ----------
    gap : float
        Final relative complementarity.
    tolerance : float
        Largest violation at the imposed instants, in normalised rows.
    between : float
        Largest violation between the instants, relative to ``max(1, |bound|)``.
    samples : int
        Initial instants per segment.
    iterations : int
        Largest number of Newton steps for one set of instants.
    rounds : int
        Largest number of additions of instants.
    certify : bool
        Whether to refine and certify the path itself, see :mod:`~.contacts`.
    """

    gap: float = 1e-10
    tolerance: float = 1e-10
    between: float = 1e-8
    samples: int = 8
    iterations: int = 100
    rounds: int = 40
    certify: bool = False


class Iterate(NamedTuple):
    """Coordinates of the knots and the interiors, then slacks and multipliers of both sides."""

    knots: Floats
    inner: Floats
    below: Floats
    above: Floats
    z_below: Floats
    z_above: Floats


class State:
    """Iterate of one chain."""

    def __init__(self, chain: Chain, settings: Settings, flag: NDArray[np.int8]) -> None:
        self.chain, self.settings, self.flag = chain, settings, flag
        self.fixed, self.knots = chain.start()
        self.inner = np.zeros((chain.model.segments, chain.interior))
        # The kernel minimises |C y|² / 2, half of J = Σ |C y|².
        self.cost = chain.cost()
        self.held = chain.first_instants(settings.samples)
        self._pose()
        self.scale = 1.0
        self.begin()

    def _pose(self) -> None:
        count = self.chain.model.segments
        self.rows, self.lower, self.upper, share = self.chain.rows(self.held)
        # A corridor without width has no interior. It is relaxed within the tolerance, so that
        # bounds and infeasibility proofs remain valid for the model.
        size = np.maximum(share * self.chain.model.position_scale.max(), 1e-3)
        room = 0.1 * self.settings.between * size
        with np.errstate(invalid="ignore"):
            narrow = self.upper - self.lower < 2.0 * room
        self.lower = np.where(narrow, self.lower - room, self.lower)
        self.upper = np.where(narrow, self.upper + room, self.upper)
        self.start = np.searchsorted(self.held.segment, np.arange(count + 1)).astype(np.int64)

    def factorised(self, weight: Floats, cost: Floats) -> tuple[Floats, Floats]:
        """Return the triangular factors of `cost` and the rows times `weight`."""
        count, _, width = cost.shape
        n = self.fixed.shape[1]
        factors, last = np.zeros((count, width - n, width)), np.zeros((n, n))
        factorise(cost, self.rows, self.start, weight, self.fixed, factors, last)
        return factors, last

    def newton(self, weight: Floats, target: Floats, cost: Floats) -> None:
        """Move to the minimum of |cost y|² + |weight (rows y - target)|²."""
        factors, last = self.factorised(weight, cost)
        for _ in range(2):
            knots, inner = np.zeros_like(self.knots), np.zeros_like(self.inner)
            transposed(cost, -multiply(cost, self.knots, self.inner), knots, inner)
            off = target - row_values(self.rows, self.start, self.knots, self.inner)
            bound_gradient(self.rows, self.start, weight * weight * off, knots, inner)
            knots[self.fixed] = 0.0
            solve_factors(factors, last, self.fixed, knots, inner)
            self.knots += knots
            self.inner += inner

    def begin(self, boost: float = 1.0) -> None:
        """Initialise a smooth path near the middle of the bounds, with slacks and multipliers.

        Parameters
        ----------
        boost : float
            Factor of the barrier parameter. Narrow bounds have multipliers far above those of the
            initial guess, and a smaller barrier stalls at the boundary.
        """
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
        # Costs of about 1 keep multipliers, slacks and tolerances comparable.
        share = 1.0 / max(float(np.sqrt(np.sum(value**2) / max(value.shape[0], 1))), 1e-12)
        self.scale, self.cost = self.scale * share, self.cost * share
        at = row_values(self.rows, self.start, self.knots, self.inner)
        wide = np.where(low & high, (self.upper - self.lower) / 2, 1.0)
        least = np.maximum(0.1 * np.where(np.isfinite(wide), wide, 1.0), 1e-8)
        self.below = np.where(low, np.maximum(at - self.lower, least), 1.0)
        self.above = np.where(high, np.maximum(self.upper - at, least), 1.0)
        pairs = max(int(low.sum() + high.sum()), 1)
        mu = boost * max(0.5 * float(np.sum((value * share) ** 2)) / pairs, 1e-6)
        self.z_below = np.where(low, mu / self.below, 0.0)
        self.z_above = np.where(high, mu / self.above, 0.0)

    def enlarge(self) -> bool:
        """Rescale an objective far below its initial value to about 1. Return False otherwise."""
        mean = float(np.sum(multiply(self.cost, self.knots, self.inner) ** 2)) / len(self.cost)
        if mean >= SMALL:
            return False
        share = min(mean**-0.5, MOST) if mean > 0 else MOST
        self.scale, self.cost = self.scale * share, self.cost * share
        self.z_below *= share**2
        self.z_above *= share**2
        return True

    def copy(self) -> Iterate:
        """Return a copy of the current iterate."""
        parts = (self.knots, self.inner, self.below, self.above, self.z_below, self.z_above)
        return Iterate(*(part.copy() for part in parts))

    def restore(self, iterate: Iterate) -> None:
        """Restore a stored iterate."""
        copies = [part.copy() for part in iterate]
        self.knots, self.inner, self.below, self.above, self.z_below, self.z_above = copies

    @property
    def nothing(self) -> float:
        """Objective treated as 0, in the model's units, relative to the initial objective."""
        return NOTHING * self.chain.model.segments * 2.0 / self.scale**2

    @property
    def pairs(self) -> int:
        """Number of finite bounds."""
        return max(int(np.isfinite(self.lower).sum() + np.isfinite(self.upper).sum()), 1)

    def descend(self, gap: float) -> tuple[int, int, float, float, float, float]:
        """Run the kernel to a relative complementarity of `gap`, and return its result."""
        settings = self.settings
        outcome: tuple[int, int, float, float, float, float] = interior_point(
            self.cost, self.rows, self.start, self.lower, self.upper, self.fixed, self.knots,
            self.inner, self.below, self.above, self.z_below, self.z_above, gap,
max(settings.tolerance, min(0.01 * gap, 1e-4)) if gap > settings.gap else settings.tolerance,
            settings.iterations, NOTHING * self.chain.model.segments, self.flag,
        )  # fmt: skip
        return outcome

    def powers(self) -> Floats:
        """Return the coefficients of the iterate in ascending powers of s."""
        return self.chain.powers(self.knots, self.inner)

    def is_settled(self, primal: float) -> bool:
        """Return whether a stalled iterate has converged to the rounding error of its rows."""
        comp = float(np.sum(self.below * self.z_below) + np.sum(self.above * self.z_above))
        value = multiply(self.cost, self.knots, self.inner)
        size = max(0.5 * float(np.sum(value**2)), NOTHING * self.chain.model.segments)
        return primal <= 1e-8 and comp <= 1e-7 * size

    def find_violations(self, threshold: float) -> tuple[Instants | None, float]:
        """Return the instants at which the iterate violates bounds, and the largest violation.

        Parameters
        ----------
        threshold : float
            Smallest violation reported, in the scale of the verification.
        """
        polynomials, limits, owners = self.chain.polynomials(self.powers())
        row, s, share = outside(polynomials, *limits, threshold)
        if not row.size:
            return None, 0.0
        fresh = self.held.fresh(owners.taken(row)._replace(s=s))
        return (fresh if fresh.s.size else None), float(share.max())

    def add(self, fresh: Instants, iterates: Sequence[Iterate]) -> list[Iterate]:
        """Impose the bounds at more instants, and return `iterates` extended by their rows."""
        self.held, order = self.held.joined(fresh).sorted()
        self._pose()
        return [self._extended(iterate, order) for iterate in iterates]

    def _extended(self, iterate: Iterate, order: NDArray[np.int64]) -> Iterate:
        """Return an iterate with slacks and multipliers for new rows at its barrier parameter."""
        knots, inner, *old = iterate
        at = row_values(self.rows, self.start, knots, inner)
        before = old[0].size
        new = np.flatnonzero(order >= before)
        comp = float(np.sum(old[0] * old[2]) + np.sum(old[1] * old[3]))
        mu = max(comp / self.pairs, 1e-300)
        parts = [
            np.concatenate([part, np.full(order.size - before, default)])[order]
            for part, default in zip(old, (1.0, 1.0, 0.0, 0.0), strict=True)
        ]
        for bound, slack, z, gap in (
            (self.lower, parts[0], parts[2], at - self.lower),
            (self.upper, parts[1], parts[3], self.upper - at),
        ):
            there = new[np.isfinite(bound[new])]
            slack[there] = np.maximum(np.abs(gap[there]), 1e-4)
            z[there] = mu / slack[there]
        return Iterate(knots, inner, *parts)
