"""Quality of a claimed optimum: residuals and gap, computed from the program alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.programs.linear import QuadraticProgram
from ...models.verification import ROUNDING

__all__ = ["Quality", "measured"]

Vector = NDArray[np.float64]

#: Relative difference between two sums of the objective's terms that is due to rounding.
NOISE = 1e-9
#: The same for sums that are exact up to the last digits.
EXACT = 1e-13


@dataclass(frozen=True, eq=False)
class Quality:
    """Measured quality of a point with row multipliers.

    `bound` is the lower bound that both prove, `violation` the largest one in units of the verification's tolerance,
    `stationarity` the largest reduced cost that no bound of its column explains, and `terms` the sum of the magnitudes
    of the objective's terms, the scale of rounding errors. `polished` marks a point of :mod:`.polishing`.
    """

    point: Vector
    duals: Vector
    objective: float
    bound: float
    violation: float
    stationarity: float
    terms: float
    polished: bool = False

    @property
    def apart(self) -> float:
        """Distance between objective and bound, in both directions: a bound above is wrong, too."""
        distance = abs(self.objective - self.bound)
        return distance if np.isfinite(distance) else np.inf

    @property
    def merit(self) -> float:
        """Largest violation or relative distance; lower is better."""
        worst = max(self.violation, self.apart / max(1.0, abs(self.objective)))
        return worst if np.isfinite(worst) else np.inf

    @property
    def clean(self) -> bool:
        """Whether all errors are due to rounding.

        The limit is strict because a flat objective turns large errors of the point into small ones
        of its value.
        """
        return self.violation <= ROUNDING and self.apart <= EXACT * max(1e-3, self.terms)

    def proves(self, gap: float, tolerance: float) -> bool:
        """Return True if this is an optimum within `gap` that verifies at `tolerance`."""
        size = max(abs(self.objective), abs(self.bound))
        slack = NOISE * max(1.0, self.terms)
        return self.violation <= tolerance and self.apart <= gap * size + slack

    def describe(self) -> str:
        """Return the residuals, the objective and the bound as text."""
        return (
            f"primal residual {self.violation:.2g}, dual residual {self.stationarity:.2g}, "
            f"objective {self.objective:.9g} above the bound {self.bound:.9g}"
        )


def measured(program: QuadraticProgram, point: Vector, duals: Vector | None) -> Quality | None:
    """Return the quality of `point`, clipped to its column bounds; None if it is not finite.

    Missing multipliers are 0.
    """
    if not np.isfinite(point).all():
        return None
    x = np.clip(point, program.column_lower, program.column_upper)
    y = np.zeros(program.row_count)
    if duals is not None and np.isfinite(duals).all():
        y = program.signed(duals)
    with np.errstate(over="ignore", invalid="ignore"):
        verification = program.verify(x)
        violation = max((check.worst / check.scale for check in verification.checks), default=0.0)
        objective = program.objective(x)
        linear = float(program.cost @ x)
        terms = (
            abs(objective - linear - program.offset)
            + float(np.abs(program.cost) @ np.abs(x))
            + abs(program.offset)
        )
        return Quality(
            x,
            y,
            objective,
            program.dual_bound(y, x),
            float(violation),
            program.dual_residual(x, y),
            terms,
        )
