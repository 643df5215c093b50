"""How good a claimed optimum is: its residuals and its gap, computed from the program alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.programs.linear import QuadraticProgram
from ...models.verification import ROUNDING

__all__ = ["Quality", "measured"]

Vector = NDArray[np.float64]

#: Relative difference of two sums of the objective's terms that rounding explains.
NOISE = 1e-9
#: The same of sums that were computed exactly but for the last digits.
EXACT = 1e-13


@dataclass(frozen=True, eq=False)
class Quality:
    """A point with row multipliers, measured.

    Parameters
    ----------
    point, duals : ndarray
        What is measured.
    objective, bound : float
        The objective of the point and the lower bound that both prove.
    violation : float
        Largest violation, in the units of the tolerance that verification allows.
    stationarity : float
        Largest reduced cost that no bound of its column explains.
    terms : float
        Sum of the magnitudes of the objective's terms, against which rounding is measured.
    polished : bool
        Whether the point is not the solver's own, but that of :mod:`.polishing`.
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
        """Distance of both bounds, either way: a bound above the objective is wrong as well."""
        distance = abs(self.objective - self.bound)
        return distance if np.isfinite(distance) else np.inf

    @property
    def merit(self) -> float:
        """What a better answer has less of."""
        worst = max(self.violation, self.apart / max(1.0, abs(self.objective)))
        return worst if np.isfinite(worst) else np.inf

    @property
    def clean(self) -> bool:
        """Whether nothing is off by more than rounding.

        A flat objective hides large errors of the point in small ones of the value.
        """
        return self.violation <= ROUNDING and self.apart <= EXACT * max(1e-3, self.terms)

    def proves(self, gap: float, tolerance: float) -> bool:
        """Return whether this is an optimum within `gap`, and verifies at `tolerance`."""
        size = max(abs(self.objective), abs(self.bound))
        slack = NOISE * max(1.0, self.terms)
        return self.violation <= tolerance and self.apart <= gap * size + slack

    def describe(self) -> str:
        """Return the figures in words."""
        return (
            f"primal residual {self.violation:.2g}, dual residual {self.stationarity:.2g}, "
            f"objective {self.objective:.9g} above the bound {self.bound:.9g}"
        )


def measured(program: QuadraticProgram, point: Vector, duals: Vector | None) -> Quality | None:
    """Return the quality of `point`, put on its column bounds; None where it is no number.

    Missing multipliers count as 0.
    """
    if not np.isfinite(point).all():
        return None
    x = np.clip(point, program.column_lower, program.column_upper)
    y = np.zeros(program.row_count)
    if duals is not None and np.isfinite(duals).all():
        y = program.signed(duals)
    with np.errstate(over="ignore", invalid="ignore"):
        found = program.verify(x)
        violation = max((check.worst / check.scale for check in found.checks), default=0.0)
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
