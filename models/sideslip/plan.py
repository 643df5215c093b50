"""Estimate of the sideslip angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..declaration import Plan
from ..fields import Array, declared

__all__ = ["SideslipEstimate"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SideslipEstimate(Plan):
    """Estimated angle at every sample, with its claimed standard deviation.

    Parameters
    ----------
    sideslip : ndarray, shape (n,)
        Estimated angle in radians.
    deviation : ndarray, shape (n,)
        Standard deviation claimed by the estimator, in radians, >= 0.
    """

    sideslip: Floats = declared(Array(("n",)))
    deviation: Floats = declared(Array(("n",), lower=0.0))

    def __len__(self) -> int:
        return len(self.sideslip)

    def __str__(self) -> str:
        if not len(self):
            return "no samples"
        most = float(np.degrees(np.abs(self.sideslip).max()))
        usual = float(np.degrees(np.median(self.deviation)))
        return f"{len(self)} samples, at most {most:.3g}°, deviation about {usual:.2g}°"
