"""Estimated parameters with their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Estimate"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters with their uncertainty.

    Parameters
    ----------
    names : tuple of str
        Names of the parameters, one per entry, without data.
    values : ndarray, shape (parameters,)
        Estimates.
    covariance : ndarray, shape (parameters, parameters)
        Covariance of the estimates. Rows of parameters at a bound are 0.
    variance : float
        Variance of a measurement, estimated from the residuals: their sum of squares per degree of
        freedom.
    freedom : int
        Degrees of freedom: number of residuals minus that of estimated quantities, which include free
        initial states and controls.
    """

    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    variance: float
    freedom: int

    @property
    def deviations(self) -> Floats:
        """Standard deviations of the estimates, shape (parameters,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Floats:
        """Correlations of the estimates; NaN for parameters at a bound."""
        with np.errstate(invalid="ignore"):
            result: Floats = self.covariance / np.outer(self.deviations, self.deviations)
        return result

    def __str__(self) -> str:
        """Return one estimate after the other, ± one standard deviation."""
        rows = zip(self.names, self.values, self.deviations, strict=True)
        return ", ".join(f"{name} = {value:.6g} ± {off:.2g}" for name, value, off in rows)
