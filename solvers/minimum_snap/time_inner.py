"""Optimal J at given durations and its slope: the function that time allocation minimises.

Without corridor and limits the banded solver computes both. Otherwise they follow from a barrier
problem. Its value ``min J - μ Σ log slack`` is smooth in the durations if a strictly feasible path
exists, as quasi-Newton steps require, and converges to J with μ. The slope requires no second solve
(envelope theorem), because the derivatives at the knots are stationary.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.time_allocation import TimeAllocation
from ...models.minimum_snap.trajectory import Trajectory
from .banded import solve_hermite
from .hermite import Outcome, duration_gradient, jets_to_coefficients

__all__ = ["Spline", "Value", "jets_of"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Value:
    """J at given durations, with its slope.

    Parameters
    ----------
    value : float
        Minimum of the inner problem: J plus the barrier term; inf without a path.
    objective : float
        J without the barrier term.
    slope : ndarray, shape (M,)
        Derivative of `value` by each duration.
    """

    value: float
    objective: float
    slope: Floats


def jets_of(model: TimeAllocation) -> tuple[Floats, Flags, Floats]:
    """Return the fixed derivatives below order r, their mask and the origin of positions.

    Relative positions retain the digits of differences far from the coordinate origin.

    Returns
    -------
    values : ndarray, shape (axes, knots, r)
        Fixed values, 0 for free entries; positions are relative to `origin`.
    fixed : ndarray of bool, shape (axes, knots, r)
        Mask of the fixed entries.
    origin : ndarray, shape (axes,)
        First fixed position of each axis, m.
    """
    r = model.order
    rows = min(r, model.conditions.shape[1])
    table = np.full((model.dimensions, len(model.waypoints), r), np.inf)
    table[:, :, :rows] = np.moveaxis(model.conditions[:, :rows], 2, 0)
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
        found = solve_hermite(durations, self.values, self.fixed, self.weights, continuity)
        return found if found.outcome is Outcome.SOLVED else None

    def value(self, durations: Floats) -> Value:
        """Return J and its slope at `durations`."""
        found = self.solve(durations)
        if found is None:
            return Value(np.inf, np.inf, np.zeros(durations.size))
        objective = float(found.objective.sum())
        return Value(objective, objective, duration_gradient(durations, found.jets, self.weights))

    def plan(self, durations: Floats) -> Trajectory | None:
        """Return the optimal spline at `durations`, or None without a solution."""
        found = self.solve(durations)
        if found is None:
            return None
        powers = jets_to_coefficients(durations, found.jets, found.moments)
        powers[:, 0] += self.origin
        return Trajectory(self.model.times(durations), powers)
