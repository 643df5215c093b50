"""J of the best trajectory at given durations, and its slope: what an allocation of times descends.

Without corridor and limits the banded solver gives both. With them a barrier problem does: its
value ``min J - μ Σ log slack`` is smooth in the durations wherever there is a path inside, so that
quasi-Newton steps are at home, and it falls to J with μ. The slope needs no second solve (the
envelope theorem): the derivatives at the knots are stationary.
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
    """J at some durations.

    Parameters
    ----------
    value : float
        What is minimised inside: J, less the barrier's share; inf where there is no path.
    objective : float
        J itself.
    slope : ndarray, shape (M,)
        The derivative of `value` by each duration.
    """

    value: float
    objective: float
    slope: Floats


def jets_of(model: TimeAllocation) -> tuple[Floats, Flags, Floats]:
    """Return the fixed derivatives below r, which they are, and where positions count from.

    Far from the origin, the differences that count would lose their digits.

    Returns
    -------
    values : ndarray, shape (axes, knots, r)
        0 where free; positions relative to `origin`.
    fixed : ndarray of bool, shape (axes, knots, r)
        Which are given.
    origin : ndarray, shape (axes,)
        The first position given.
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
    """No corridor and no limits: one banded solve."""

    def __init__(self, model: TimeAllocation) -> None:
        self.model = model
        self.values, self.fixed, self.origin = jets_of(model)
        self.weights = np.asarray(model.order_weights)
        self.solves = self.steps = 0

    def solve(self, durations: Floats) -> Any:
        """Return the banded solver's result, None where it has none."""
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
        """Return the spline itself."""
        found = self.solve(durations)
        if found is None:
            return None
        powers = jets_to_coefficients(durations, found.jets, found.moments)
        powers[:, 0] += self.origin
        return Trajectory(self.model.times(durations), powers)
