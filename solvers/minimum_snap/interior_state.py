"""Iterate of the structured interior point on one chain, and the imposed instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.instants import Instants, outside
from .chain import Chain
from .chain_kernels import (
    bound_gradient,
    factorise,
    multiply,
    row_values,
    solve_factors,
    transposed,
)
from .interior_kernels import Iterate, Posed, interior_point

__all__ = ["Settings", "State", "factorised", "sides", "smooth_start"]

Floats = NDArray[np.float64]

#: Objectives below this share of the initial objective are treated as 0.
NOTHING = 1e-9
#: Mean square of the costs of a segment below which their unit is reduced, and the largest
#: reduction. The mean square is about 1 in the initial iterate.
SMALL, MOST = 1e-6, 30.0


@dataclass(frozen=True)
class Settings:
    """Termination criteria and limits of the interior point."""

    #: Final relative complementarity.
    gap: float = 1e-10
    #: Largest violation at the imposed instants, in normalised rows.
    tolerance: float = 1e-10
    #: Largest violation between the instants, in the scale of the verification.
    between: float = 1e-8
    #: Initial instants per segment.
    samples: int = 8
    #: Largest number of Newton steps for one set of instants.
    iterations: int = 100
    #: Largest number of additions of instants.
    rounds: int = 40
    #: Whether to refine and certify the path itself, see :mod:`~.contacts`.
    certify: bool = False


def sides(posed: Posed, now: Iterate) -> Floats:
    """Return how far the iterate is inside each bound, shape (2, Q); inf for unbounded sides."""
    at = row_values(posed.rows, posed.start, now.knots, now.inner)
    room: Floats = np.stack([at, -at]) - posed.edge
    return room


def factorised(posed: Posed, weight: Floats, cost: Floats) -> tuple[Floats, Floats]:
    """Return the triangular factors of `cost` and the rows times `weight`."""
    count, _, width = cost.shape
    n = posed.fixed.shape[1]
    factors, last = np.zeros((count, width - n, width)), np.zeros((n, n))
    factorise(cost, posed.rows, posed.start, weight, posed.fixed, factors, last)
    return factors, last


def smooth_start(posed: Posed, knots: Floats, inner: Floats) -> Iterate:
    """Return a smooth path near the middle of the bounds, with slacks and their reciprocals.

    The path minimises the cost plus the squared distances from the middle of the bounds.
    """
    typical = max(float(np.linalg.norm(posed.cost, axis=2).max()), 1e-300)
    cost, (low, high) = posed.cost / typical, np.isfinite(posed.edge)
    half = np.where(low & high, 0.5 * (posed.edge[0] - posed.edge[1]), 0.0)
    target = np.where(low & high, half, np.where(low, posed.edge[0], -posed.edge[1]))
    factors, last = factorised(posed, np.ones(len(target)), cost)
    for _ in range(2):
        step = np.zeros_like(knots), np.zeros_like(inner)
        transposed(cost, -multiply(cost, knots, inner), *step)
        away = target - row_values(posed.rows, posed.start, knots, inner)
        bound_gradient(posed.rows, posed.start, away, *step)
        step[0][posed.fixed] = 0.0
        solve_factors(factors, last, posed.fixed, *step)
        knots, inner = knots + step[0], inner + step[1]
    bounded = np.stack([low, high])
    half = np.where(low & high, -0.5 * (posed.edge[0] + posed.edge[1]), 1.0)
    least = np.maximum(0.1 * half, 1e-8)
    now = Iterate(knots, inner, np.ones_like(posed.edge), np.zeros_like(posed.edge))
    slack = np.where(bounded, np.maximum(sides(posed, now), least), 1.0)
    return now._replace(slack=slack, z=np.where(bounded, 1.0 / slack, 0.0))


class State:
    """Iterate of one chain at given times."""

    def __init__(self, chain: Chain, settings: Settings, flag: NDArray[np.int8]) -> None:
        self.chain, self.settings, self.flag = chain, settings, flag
        self.durations = np.array(chain.model.durations)
        self.held = chain.first_instants(settings.samples)
        self.scale = 1.0
        self._pose()
        self.now = Iterate(
            chain.start(self.durations)[1], np.zeros((chain.model.segments, chain.interior)),
            np.ones_like(self.posed.edge), np.zeros_like(self.posed.edge),
        )  # fmt: skip
        self.begin()

    def _pose(self) -> None:
        imposed = self.chain.imposed(self.held)
        posed = self.chain.posed(self.durations, imposed)
        # A corridor without width has no interior. It is relaxed within the tolerance, so that
        # bounds and infeasibility proofs remain valid for the model.
        room = 0.1 * self.settings.between * np.maximum(imposed.scale * posed.share, 1e-3)
        narrow = -posed.edge.sum(axis=0) < room.sum(axis=0)
        # The kernel minimises |C y|² / 2, half of J = Σ |C y|².
        self.posed = posed._replace(
            cost=posed.cost * self.scale, edge=np.where(narrow, posed.edge - room, posed.edge)
        )

    def _rescale(self, factor: float) -> None:
        self.scale *= factor
        self.posed = self.posed._replace(cost=self.posed.cost * factor)

    def begin(self, boost: float = 1.0) -> None:
        """Initialise a smooth path near the middle of the bounds, with slacks and multipliers.

        `boost` multiplies the barrier parameter. Narrow bounds have multipliers far above those of
        the initial guess, and a smaller barrier stalls at the boundary.
        """
        now = smooth_start(self.posed, self.now.knots, self.now.inner)
        value = multiply(self.posed.cost, now.knots, now.inner)
        # Costs of about 1 keep multipliers, slacks and tolerances comparable.
        share = 1.0 / max(float(np.sqrt(np.sum(value**2) / max(value.shape[0], 1))), 1e-12)
        self._rescale(share)
        mu = boost * max(0.5 * float(np.sum((value * share) ** 2)) / self.pairs, 1e-6)
        self.now = now._replace(z=mu * now.z)

    def enlarge(self) -> bool:
        """Rescale an objective far below its initial value to about 1. Return False otherwise."""
        mean = 2.0 * self.cost / len(self.posed.cost)
        if mean >= SMALL:
            return False
        share = min(mean**-0.5, MOST) if mean > 0 else MOST
        self._rescale(share)
        self.now = self.now._replace(z=self.now.z * share**2)
        return True

    @property
    def cost(self) -> float:
        """Cost of the iterate in the units of the kernel."""
        value = multiply(self.posed.cost, self.now.knots, self.now.inner)
        return 0.5 * float(np.sum(value**2))

    @property
    def nothing(self) -> float:
        """Objective treated as 0, in the model's units, relative to the initial objective."""
        return NOTHING * self.chain.model.segments * 2.0 / self.scale**2

    @property
    def pairs(self) -> int:
        """Number of finite bounds."""
        return max(int(np.isfinite(self.posed.edge).sum()), 1)

    def descend(self, gap: float) -> tuple[int, int, float]:
        """Run the kernel to a relative complementarity of `gap`.

        Return status, iterations and the largest primal residual.
        """
        settings, tolerance = self.settings, self.settings.tolerance
        if gap > settings.gap:
            tolerance = max(tolerance, min(0.01 * gap, 1e-4))
        outcome: tuple[int, int, float] = interior_point(
            self.posed, self.now, gap, tolerance, settings.iterations,
            NOTHING * self.chain.model.segments, self.flag,
        )  # fmt: skip
        return outcome

    def powers(self) -> Floats:
        """Return the coefficients of the iterate in ascending powers of s."""
        return self.chain.powers(self.durations, self.now.knots, self.now.inner)

    def is_settled(self, primal: float) -> bool:
        """Return whether a stalled iterate has converged to the rounding error of its rows."""
        comp = float(np.sum(self.now.slack * self.now.z))
        size = max(self.cost, NOTHING * self.chain.model.segments)
        return primal <= 1e-8 and comp <= 1e-7 * size

    def find_violations(self, threshold: float) -> tuple[Instants | None, float]:
        """Return the instants at which the iterate violates bounds, and the largest violation.

        The smallest violation reported is `threshold`, in the scale of the verification.
        """
        limits = self.chain.limits
        at, share = outside(limits.polynomials(self.powers(), self.durations), limits, threshold)
        if not at.s.size:
            return None, 0.0
        fresh = self.held.fresh(at)
        return (fresh if fresh.s.size else None), float(share.max())

    def add(self, fresh: Instants, iterates: Sequence[Iterate]) -> list[Iterate]:
        """Impose the bounds at more instants, and return `iterates` extended by their rows."""
        self.held, order = self.held.joined(fresh).sorted()
        self._pose()
        bounded = np.isfinite(self.posed.edge)
        extended = []
        for now in iterates:
            slack = np.maximum(np.abs(sides(self.posed, now)), 1e-4)
            mu = max(float(np.sum(now.slack * now.z)) / self.pairs, 1e-300)
            extended.append(now.extended(order, np.where(bounded, slack, 1.0), bounded, mu))
        return extended
