"""Barrier problem for corridor and limits at given durations: value and slope."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.polynomials import factorials
from ...models.minimum_snap.time_allocation import TimeAllocation
from ...models.minimum_snap.trajectory import Trajectory
from .separation import outside
from .time_held import Group, Iterate, forms_of, groups_of
from .time_inner import Spline, Value
from .time_kernels import SETTLED, evaluate
from .time_rows import knot_scales

__all__ = ["Barrier", "Inner", "inner_problem"]

Floats = NDArray[np.float64]

#: Largest number of Newton steps for one barrier problem.
STEPS = 40
#: Relative error of slack times multiplier, and of the gradient with respect to the coordinates.
ACCURACY = 1e-6
#: Largest violation of an imposed bound, relative to its scale.
FEASIBLE = 1e-10
#: Relative complementarity of a plan, and its largest relative violation between the instants.
SHARP, BETWEEN = 1e-9, 2e-10


class Barrier:
    """Barrier problem of all groups, each warm-started from its last iterate.

    Parameters
    ----------
    model : TimeAllocation
        Problem with free times.
    flag : ndarray of int8, shape (1,)
        Stop flag. A nonzero value stops the Newton steps.

    Attributes
    ----------
    mu : float
        Slack times multiplier, in units of J.
    unit : float
        A typical J.
    """

    def __init__(self, model: TimeAllocation, flag: NDArray[np.int8]) -> None:
        self.model, self.flag = model, flag
        self.solves = self.steps = 0
        self.mu = self.unit = 1.0
        self.accuracy = ACCURACY
        self.forms = forms_of(model)
        self.groups = groups_of(self.forms)
        self._latest: tuple[Floats, float, Value] | None = None

    @property
    def pairs(self) -> int:
        """Number of slacks of all groups."""
        return max(sum(group.pairs for group in self.groups), 1)

    # -- values ----------------------------------------------------------------------------------

    def value(self, durations: Floats, *, afresh: bool = False) -> Value:
        """Return the value of the barrier problem and its slope. Store the iterate for warm starts.

        Parameters
        ----------
        durations : ndarray, shape (M,)
            T_k, s.
        afresh : bool
            Whether to retry with a cold start if the last iterate leads to no solution.
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
        found = []
        for group in self.groups:
            trial, own = group.iterate.copied(), np.zeros(durations.size)
            status, cost, logs = self._solved(group, durations, trial, own, warm=group.warm)
            if status != SETTLED and afresh and group.warm:
                trial, own = group.iterate.copied(), np.zeros(durations.size)
                status, cost, logs = self._solved(group, durations, trial, own, warm=False)
            if status != SETTLED:
                return Value(np.inf, np.inf, slope)
            slope += own
            objective += cost
            total += cost - self.mu * logs
            found.append(trial)
        for group, trial in zip(self.groups, found, strict=True):
            group.iterate, group.warm = trial, True
        value = Value(total, objective, slope)
        self._latest = (durations.copy(), self.mu, value)
        return value

    def _solved(
        self, group: Group, durations: Floats, trial: Iterate, slope: Floats, *, warm: bool
    ) -> tuple[int, float, float]:
        """Solve one group in place. Return status, J and the sum of the logarithms of the slacks."""
        forms, rows = self.forms, group.rows
        status, steps, cost, logs = evaluate(
            durations, self.model.order, len(group.axes), forms.unit_cost, forms.cost_orders,
            rows.unit, rows.mix, rows.derivative, rows.start, rows.lower, rows.upper,
            rows.low_scale, rows.high_scale, group.fixed, group.values, trial.knots, trial.inner, trial.below, trial.above,
            trial.z_below, trial.z_above, warm, self.unit, self.mu, FEASIBLE, self.accuracy,
            STEPS, self.flag, slope,
        )  # fmt: skip
        self.steps += steps
        return status, cost, logs

    # -- bounds between the instants -------------------------------------------------------------

    def _powers(self, group: Group, durations: Floats) -> Floats:
        """Return the iterate as ascending powers of s, shape (M, degree + 1, axes)."""
        knots, inner = group.iterate.knots, group.iterate.inner
        scales, order = knot_scales(durations), np.arange(self.model.order)
        jets = knots.reshape(len(knots), -1, order.size)
        begin = (durations / scales[:-1])[:, None, None] ** order * jets[:-1]
        end = (durations / scales[1:])[:, None, None] ** order * jets[1:]
        # Positions relative to the start: the Hermite functions subtract positions.
        start = jets[:-1, :, 0]
        begin[:, :, 0] = 0.0
        end[:, :, 0] -= start
        local = np.concatenate([begin, end, inner.reshape(*start.shape, -1)], axis=2)
        powers: Floats = np.moveaxis(local @ self.forms.basis.T, 2, 1)
        powers[:, 0] += start
        return powers

    def _bounded(self, group: Group, durations: Floats) -> Floats:
        """Return the bounded values as polynomials in s, padded to shape (N, degree + 1)."""
        segment, spans = group.owners.segment, group.spans
        powers = np.einsum("npa,na->np", self._powers(group, durations)[segment], spans.mix)
        rows = np.zeros(powers.shape)
        for j in np.unique(spans.derivative):
            take = np.flatnonzero(spans.derivative == j)
            scale = durations[segment[take]] ** -float(j)
            padded = powers[take, j:] * factorials(powers.shape[1] - 1, int(j)) * scale[:, None]
            rows[take, : padded.shape[1]] = padded
        return rows

    def exchange(self, durations: Floats, threshold: float) -> int:
        """Impose violated bounds at the instants of violation, and return their number.

        Parameters
        ----------
        durations : ndarray, shape (M,)
            Durations of the last :meth:`value`, s.
        threshold : float
            Smallest violation considered, relative to its scale.
        """
        count = 0
        for group in self.groups:
            spans, owners = group.spans, group.owners
            polynomials = self._bounded(group, durations)
            row, s, _ = outside(
                polynomials, spans.lower, spans.upper, spans.low_scale, spans.high_scale, threshold
            )
            if row.size:
                fresh = owners.taken(row)._replace(s=s)
                count += group.hold(self.forms, fresh, self.mu)
        if count:
            self._latest = None
        return count

    def settle(self, durations: Floats, threshold: float, rounds: int = 25) -> Value:
        """Return the value at `durations` after imposing the bounds at all violations."""
        found = self.value(durations, afresh=True)
        for _ in range(rounds):
            if not np.isfinite(found.value):
                break
            if not self.exchange(durations, threshold):
                break
            found = self.value(durations, afresh=True)
        return found

    def plan(self, durations: Floats) -> Trajectory | None:
        """Return the optimal trajectory at `durations`, with a negligible barrier, or None.

        The bounds hold at every instant. Instants added here are removed afterwards, so that the
        search does not depend on the times of calls.
        """
        kept, mu = [replace(group) for group in self.groups], self.mu
        latest = self._latest
        try:
            powers = None
            found = self.settle(durations, BETWEEN)
            least = SHARP * (
                self.unit + self.model.time_weight * float(durations.sum())
            ) / self.pairs  # fmt: skip
            while np.isfinite(found.value):
                powers = self._joined(durations)
                if self.mu <= least:
                    break
                self.mu = max(least, 1e-2 * self.mu)
                found = self.settle(durations, BETWEEN)
        finally:
            self.groups, self.mu = kept, mu
            self._latest = latest
        return None if powers is None else Trajectory(self.model.times(durations), powers)

    def _joined(self, durations: Floats) -> Floats:
        """Return the powers of all axes, shape (M, degree + 1, dimensions)."""
        model = self.model
        powers = np.zeros((model.segments, model.degree + 1, model.dimensions))
        for group in self.groups:
            powers[:, :, list(group.axes)] = self._powers(group, durations)
        powers[:, 0] += self.forms.origin
        return powers


#: Solver of the problem at given times, with ``value(durations)``, ``plan(durations)`` and the
#: counts ``solves`` and ``steps`` (Newton steps).
Inner: TypeAlias = Spline | Barrier


def inner_problem(model: TimeAllocation, flag: NDArray[np.int8]) -> Inner:
    """Return the solver of `model` at given durations. A nonzero `flag` stops it."""
    return Barrier(model, flag) if model.bounded else Spline(model)
