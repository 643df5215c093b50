"""Constraints of black boxes, in one place: the values that searches of one objective receive.

Searches that only compare values use the feasibility rules of K. Deb, "An efficient constraint handling method
for genetic algorithms", Computer Methods in Applied Mechanics and Engineering 186 (2000). Searches that use the
size of values use an augmented Lagrangian: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., ch. 17.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.black_box.model import BlackBoxMinimisation

__all__ = ["FLOOR", "PARTS", "Constraints"]

Floats = NDArray[np.float64]

#: Number of parts of a run; each one ends with an update of the multipliers.
PARTS = 10
#: Value of an infeasible point whose violation is 1: larger than feasible values.
_INFEASIBLE = 1e120
#: Smallest value of an infeasible point.
FLOOR = 1e100
#: Reserve of an inequality in the Lagrangian, as a share of its typical violation: its minima are feasible.
_RESERVE = 1e-6
#: Factor of the penalties if the violation has not decreased to a quarter.
_GROWTH = 100.0


class Constraints:
    """Merit of points of a model with constraints.

    `multipliers` and `penalties`, shape (constraints,), are the state of the augmented Lagrangian; without multipliers
    the feasibility rules apply. `best` is the smallest Lagrangian since the last update, its point and its scaled constraints.
    """

    def __init__(self, problem: BlackBoxMinimisation) -> None:
        self.first = problem.objectives
        self.last = problem.objectives + problem.inequalities
        self.tolerance = problem.equality_tolerance
        #: Typical violation of each constraint: the median of the first request that violates it, 0 before.
        self.scales = np.zeros(problem.columns - problem.objectives)
        self.multipliers: Floats | None = None
        self.penalties = np.zeros_like(self.scales)
        self.best: tuple[float, Floats, Floats] | None = None

    def limits(self) -> tuple[Floats, Floats]:
        """Return lower and upper limits of scaled constraints, with the reserve of inequalities."""
        inequality = np.arange(len(self.scales)) < self.last - self.first
        return np.where(inequality, -np.inf, 0.0), np.where(inequality, -_RESERVE, 0.0)

    def excess(self, table: Floats) -> Floats:
        """Return g and |h| - tolerance, at most 0 if a constraint holds, shape (m, constraints)."""
        equalities = np.abs(table[:, self.last :]) - self.tolerance
        result: Floats = np.hstack([table[:, self.first : self.last], equalities])
        return np.where(np.isnan(result), np.inf, result)

    def feasible(self, table: Floats) -> NDArray[np.bool_]:
        """Return whether rows of columns have values and hold all constraints."""
        violated = np.maximum(self.excess(table), 0.0).sum(axis=1)
        result: NDArray[np.bool_] = (violated == 0) & np.isfinite(table.sum(axis=1))
        return result

    @np.errstate(all="ignore")  # no value gives infinity
    def violation(self, table: Floats) -> Floats:
        """Return the sum of violations, each relative to its scale, shape (m,)."""
        excess = np.maximum(self.excess(table), 0.0)
        for k in np.flatnonzero(self.scales == 0).tolist():
            positive = excess[(excess[:, k] > 0) & np.isfinite(excess[:, k]), k]
            self.scales[k] = np.median(positive) if positive.size else 0.0
        scaled = excess / np.where(self.scales > 0, self.scales, 1.0)
        result: Floats = scaled.sum(axis=1)
        return result

    @np.errstate(all="ignore")
    def merit(self, x: Floats, table: Floats) -> Floats:
        """Return the value of points for a search, from their columns, shape (m,); infinite for no value.

        With the rules, it is the objective of feasible points, and for others a larger number that increases with the
        violation. Otherwise it is the augmented Lagrangian.
        """
        objective, missing = table[:, 0], ~np.isfinite(table.sum(axis=1))
        violation = self.violation(table)
        if self.multipliers is None:
            # The power keeps the order and the range of floats.
            worse = _INFEASIBLE * np.clip(violation, 1e-100, 1e100) ** 0.2
            values = np.where(self.feasible(table), objective, worse)
        else:
            scaled = self._scaled(table)
            raised = scaled * self.penalties + self.multipliers
            inequality = np.arange(len(self.scales)) < self.last - self.first
            raised = np.where(inequality, np.maximum(raised, 0.0), raised)
            terms = (raised**2 - self.multipliers**2) / (2 * self.penalties)
            values = objective + terms.sum(axis=1)
        result: Floats = np.where(missing | np.isnan(values), np.inf, values)
        if self.multipliers is not None and len(x):
            k = int(result.argmin())
            if result[k] < (np.inf if self.best is None else self.best[0]):
                self.best = float(result[k]), x[k], scaled[k]
        return result

    def _scaled(self, table: Floats) -> Floats:
        scale = np.where(self.scales > 0, self.scales, 1.0)
        reserve = np.where(np.arange(len(scale)) < self.last - self.first, _RESERVE, 0.0)
        result: Floats = table[:, self.first :] / scale + reserve
        return result

    def begin(self, table: Floats) -> None:
        """Begin an augmented Lagrangian with the penalties that the columns of a sample of the cube suggest."""
        self.violation(table)
        # An earlier search may have ended between two updates.
        self.best, self._previous = None, np.full_like(self.scales, np.inf)
        objective = table[np.isfinite(table[:, 0]), 0]
        low, high = np.quantile(objective, [0.25, 0.75]) if objective.size else (0.0, 0.0)
        self.multipliers = np.zeros_like(self.scales)
        self.penalties = np.full_like(self.scales, 10 * (high - low) if high > low else 1.0)

    @np.errstate(all="ignore")
    def update(self) -> None:
        """Update multipliers and penalties at the best point since the last update."""
        if self.best is None or self.multipliers is None:
            return
        scaled = self.best[2]
        inequality = np.arange(len(self.scales)) < self.last - self.first
        raised = self.multipliers + self.penalties * scaled
        size = np.where(inequality, np.maximum(scaled, -self.multipliers / self.penalties), scaled)
        self.multipliers = np.where(inequality, np.maximum(raised, 0.0), raised)
        grows = (np.abs(size) > 0.25 * self._previous) & (np.abs(size) > _RESERVE)
        self.penalties = np.where(grows, _GROWTH * self.penalties, self.penalties)
        self._previous, self.best = np.abs(size), None
