"""Optimal J at given durations and its slope: the function that time allocation minimises.

Without corridor and limits the banded solver computes both. Otherwise they follow from a barrier
problem. Its value ``min J - μ Σ log slack`` is smooth in the durations if a strictly feasible path
exists, as quasi-Newton steps require, and converges to J with μ. The slope requires no second solve
(envelope theorem), because the derivatives at the knots are stationary.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.instants import Instants, outside
from ...models.minimum_snap.time_allocation import TimeAllocation
from ...models.minimum_snap.trajectory import Trajectory
from .banded import solve_hermite
from .chain import Chain, Imposed, chains
from .hermite import Outcome, duration_gradient, jets_to_coefficients
from .interior_kernels import CONVERGED, Iterate, centre
from .interior_state import sides, smooth_start

__all__ = ["Barrier", "Group", "Inner", "Spline", "Value", "inner_problem"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Initial instants per segment at which bounds are imposed.
SAMPLES = 8
#: Initial slack of an added bound, relative to its scale.
FRESH = 1e-3
#: Largest number of Newton steps for one barrier problem.
STEPS = 40
#: Relative error of slack times multiplier, and of the gradient with respect to the coordinates.
ACCURACY = 1e-6
#: Largest violation of an imposed bound, relative to its scale.
FEASIBLE = 1e-10
#: Relative complementarity of a plan, and its largest relative violation between the instants.
SHARP, BETWEEN = 1e-9, 2e-10


@dataclass(frozen=True)
class Value:
    """J at given durations, with its slope."""

    #: Minimum of the inner problem: J plus the barrier term; inf without a path.
    value: float
    #: J without the barrier term.
    objective: float
    #: Derivative of `value` by each duration, shape (M,).
    slope: Floats


def jets_of(model: TimeAllocation) -> tuple[Floats, Flags, Floats]:
    """Return the fixed derivatives below order r, their mask and the origin of positions.

    Values, 0 for free entries, and mask have the shape (axes, knots, r). Positions are relative to
    the first fixed one of each axis, which retains the digits of differences far from the coordinate
    origin.
    """
    table = np.moveaxis(model.unit.jets, 2, 0).copy()
    fixed = np.isfinite(table)
    known = fixed[:, :, 0]
    first = table[np.arange(len(table)), known.argmax(axis=1), 0]
    origin = np.where(known.any(axis=1), first, 0.0)
    table[:, :, 0] -= origin[:, None]
    return np.where(fixed, table, 0.0), fixed, origin


class Spline:
    """Inner problem without corridor and limits: one banded solve per evaluation."""

    def __init__(self, model: TimeAllocation) -> None:
        self.model = model
        self.values, self.fixed, self.origin = jets_of(model)
        self.weights = np.asarray(model.order_weights)
        self.solves = self.steps = 0

    def solve(self, durations: Floats) -> Any:
        """Return the result of the banded solver, or None without a solution."""
        self.solves += 1
        continuity = min(self.model.continuity, self.model.order - 1)
        result = solve_hermite(durations, self.values, self.fixed, self.weights, continuity)
        return result if result.outcome is Outcome.SOLVED else None

    def value(self, durations: Floats) -> Value:
        """Return J and its slope at `durations`."""
        result = self.solve(durations)
        if result is None:
            return Value(np.inf, np.inf, np.zeros(durations.size))
        objective = float(result.objective.sum())
        return Value(objective, objective, duration_gradient(durations, result.jets, self.weights))

    def plan(self, durations: Floats) -> Trajectory | None:
        """Return the optimal spline at `durations`, or None without a solution."""
        result = self.solve(durations)
        if result is None:
            return None
        powers = jets_to_coefficients(durations, result.jets, result.moments)
        powers[:, 0] += self.origin
        return Trajectory(self.model.times(durations), powers)


@dataclass
class Group:
    """Coupled axes, with the last solution of their barrier problem."""

    #: Problem of the axes.
    chain: Chain
    #: Instants at which the bounds are imposed.
    held: Instants
    #: Bounds at these instants.
    imposed: Imposed
    #: Coordinates, then slacks and multipliers in the model's units.
    iterate: Iterate
    #: Whether the iterate solves the barrier problem.
    warm: bool = False

    @classmethod
    def of(cls, chain: Chain) -> Group:
        """Return the group without a solution."""
        held = chain.first_instants(SAMPLES)
        imposed = chain.imposed(held)
        knots = chain.start(np.array(chain.model.durations))[1]
        inner = np.zeros((chain.model.segments, chain.interior))
        slack = np.ones((2, held.s.size))
        return cls(chain, held, imposed, Iterate(knots, inner, slack, 0.0 * slack))

    @property
    def pairs(self) -> int:
        """Number of slacks."""
        return int(self.imposed.bounded.sum())

    def impose(self, fresh: Instants, mu: float) -> int:
        """Impose the bounds at more instants, with slack times multiplier equal to `mu`.

        Return the number of new instants.
        """
        fresh = self.held.fresh(fresh)
        if fresh.s.size:
            self.held, order = self.held.joined(fresh).sorted()
            self.imposed = self.chain.imposed(self.held)
            slack = FRESH * self.imposed.scale.max(axis=0)
            bounded = self.imposed.bounded
            self.iterate = self.iterate.extended(order, np.where(bounded, slack, 1.0), bounded, mu)
        return int(fresh.s.size)

    def powers(self, durations: Floats) -> Floats:
        """Return the iterate as ascending powers of s, shape (M, degree + 1, axes)."""
        return self.chain.powers(durations, self.iterate.knots, self.iterate.inner)


class Barrier:
    """Barrier problem of all groups, each warm-started from its last iterate.

    A nonzero `flag` stops the Newton steps. `mu` is slack times multiplier in units of J, and `unit` a
    typical J.
    """

    def __init__(self, model: TimeAllocation, flag: NDArray[np.int8]) -> None:
        self.model, self.flag = model, flag
        self.solves = self.steps = 0
        self.mu = self.unit = 1.0
        self.accuracy = ACCURACY
        self.groups = [Group.of(chain) for chain in chains(model.unit)]
        self._latest: tuple[Floats, float, Value] | None = None

    @property
    def pairs(self) -> int:
        """Number of slacks of all groups."""
        return max(sum(group.pairs for group in self.groups), 1)

    # -- values ----------------------------------------------------------------------------------

    def value(self, durations: Floats, *, afresh: bool = False) -> Value:
        """Return the value of the barrier problem and its slope. Store the iterate for warm starts.

        If `afresh`, retry with a cold start if the last iterate leads to no solution.
        """
        if self._latest is not None:
            last, mu, known = self._latest
            if mu == self.mu and np.array_equal(last, durations):
                return known
        self.solves += 1
        durations = np.ascontiguousarray(durations)
        # A barrier term for durations > 0 keeps free knots apart.
        slope = -self.mu / durations
        total, objective = -self.mu * float(np.log(durations).sum()), 0.0
        iterates = []
        for group in self.groups:
            result = self._solved(group, durations, warm=group.warm)
            if result is None and afresh and group.warm:
                result = self._solved(group, durations, warm=False)
            if result is None:
                return Value(np.inf, np.inf, slope)
            iterate, cost, change = result
            iterates.append(iterate)
            objective += cost
            slope += change
            total += cost - self.mu * float(np.log(iterate.slack[group.imposed.bounded]).sum())
        for group, iterate in zip(self.groups, iterates, strict=True):
            group.iterate, group.warm = iterate, True
        value = Value(total, objective, slope)
        self._latest = (durations.copy(), self.mu, value)
        return value

    def _solved(
        self, group: Group, durations: Floats, *, warm: bool
    ) -> tuple[Iterate, float, Floats] | None:
        """Return the solution of one group with J and its slope, or None without a solution."""
        chain, imposed, now = group.chain, group.imposed, group.iterate
        posed = chain.posed(durations, imposed)
        # The kernel's numbers are about 1, and its bounds are normalised rows.
        posed.cost[...] *= np.sqrt(2.0 / self.unit)
        units, mu = self.unit * posed.share, self.mu / self.unit
        fixed, known = chain.start(durations)
        trial = Iterate(
            np.where(fixed, known, now.knots), now.inner.copy(), now.slack, now.z / units
        )
        if warm:
            # Slacks at the new durations, but never far below the previous slacks.
            room = np.maximum(sides(posed, trial), 0.3 * now.slack * posed.share)
            trial = trial._replace(slack=np.where(imposed.bounded, room, 1.0))
        else:
            trial = smooth_start(posed, trial.knots, trial.inner)
            trial.z[...] *= mu
        allowed = FEASIBLE * imposed.scale * posed.share + 1e-14
        status, steps = centre(posed, trial, allowed, mu, self.accuracy, STEPS, self.flag)
        self.steps += steps
        if status != CONVERGED:
            return None
        slack = np.where(imposed.bounded, trial.slack / posed.share, 1.0)
        trial = Iterate(trial.knots, trial.inner, slack, trial.z * units)
        return trial, *chain.slope(durations, imposed, trial, trial.z[1] - trial.z[0])

    # -- bounds between the instants -------------------------------------------------------------

    def exchange(self, durations: Floats, threshold: float) -> int:
        """Impose bounds at violations by more than `threshold`, and return the number of instants.

        `durations` are those of the last :meth:`value`. The threshold is relative to the scale of
        the bound.
        """
        count = 0
        for group in self.groups:
            limits = group.chain.limits
            polynomials = limits.polynomials(group.powers(durations), durations)
            count += group.impose(outside(polynomials, limits, threshold)[0], self.mu)
        if count:
            self._latest = None
        return count

    def settle(self, durations: Floats, threshold: float, rounds: int = 25) -> Value:
        """Return the value at `durations` after imposing the bounds at all violations."""
        result = self.value(durations, afresh=True)
        for _ in range(rounds):
            if not np.isfinite(result.value) or not self.exchange(durations, threshold):
                break
            result = self.value(durations, afresh=True)
        return result

    def plan(self, durations: Floats) -> Trajectory | None:
        """Return the optimal trajectory at `durations`, with a negligible barrier, or None.

        The bounds hold at every instant. Instants added here are removed afterwards, so that the
        search does not depend on the times of calls.
        """
        kept, mu, latest = [replace(group) for group in self.groups], self.mu, self._latest
        try:
            powers = None
            result = self.settle(durations, BETWEEN)
            whole = self.unit + self.model.time_weight * float(durations.sum())
            least = SHARP * whole / self.pairs
            while np.isfinite(result.value):
                powers = [group.powers(durations) for group in self.groups]
                if self.mu <= least:
                    break
                self.mu = max(least, 1e-2 * self.mu)
                result = self.settle(durations, BETWEEN)
        finally:
            self.groups, self.mu, self._latest = kept, mu, latest
        if powers is None:
            return None
        # The groups are single axes in their order, or one group of all axes.
        return Trajectory(self.model.times(durations), np.concatenate(powers, axis=2))


#: Solver of the problem at given times, with ``value(durations)``, ``plan(durations)`` and the
#: counts ``solves`` and ``steps`` (Newton steps).
Inner: TypeAlias = Spline | Barrier


def inner_problem(model: TimeAllocation, flag: NDArray[np.int8]) -> Inner:
    """Return the solver of `model` at given durations. A nonzero `flag` stops it."""
    return Barrier(model, flag) if model.bounded else Spline(model)
