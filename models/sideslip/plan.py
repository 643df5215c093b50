"""Estimate of the sideslip angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, declared, show

__all__ = ["SideslipEstimate"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SideslipEstimate(Declared):
    """Estimated angle at every sample, with its claimed standard deviation.

    Parameters
    ----------
    sideslip : ndarray, shape (n,)
        Estimated angle, rad.
    deviation : ndarray, shape (n,)
        Standard deviation claimed by the estimator, rad, >= 0.
    """

    sideslip: Floats = declared(Array(("n",)))
    deviation: Floats = declared(Array(("n",), lower=0.0))

    @classmethod
    def from_data(cls, data: Any) -> SideslipEstimate:
        """Return the estimate in the JSON data of ``data()``.

        Parameters
        ----------
        data : mapping
            Object with the keys ``sideslip`` and ``deviation``.

        Returns
        -------
        SideslipEstimate

        Raises
        ------
        InvalidData
            The data is no such object, or an entry is invalid.
        """
        if not isinstance(data, Mapping):
            raise InvalidData(
                f"a plan must be an object with the keys sideslip and deviation, got {show(data)}",
                field="plan",
            )
        return cls._from_data(data)

    def __len__(self) -> int:
        return len(self.sideslip)

    def __str__(self) -> str:
        if not len(self):
            return "no samples"
        most = float(np.degrees(np.abs(self.sideslip).max()))
        usual = float(np.degrees(np.median(self.deviation)))
        return f"{len(self)} samples, at most {most:.3g}°, deviation about {usual:.2g}°"
