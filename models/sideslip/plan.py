"""Estimate of the sideslip angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..arrays import NumberTuple
from ..declaration import Plan
from ..fields import Array, declared, show
from ..records import Several

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
    grip_lost : tuple of (begin, end)
        Time ranges in seconds, in order, while an axle slides and more slip would add no force. They are estimated by
        ``unscented-filter`` and empty for other backends. A sensor that fails for several samples may cause false ones.
    """

    sideslip: Floats = declared(Array(("n",)))
    deviation: Floats = declared(Array(("n",), lower=0.0))
    grip_lost: tuple[tuple[float, float], ...] = declared(
        Several(NumberTuple((2,), unit="s")), default=(), added=True
    )

    def check(self) -> None:
        """Raise :class:`InvalidData` if the times of `grip_lost` are not in order."""
        times = [time for span in self.grip_lost for time in span]
        if times != sorted(times):
            text = f"grip_lost must be in order of time, got {show(self.grip_lost)}"
            raise InvalidData(text, field="grip_lost")

    def __len__(self) -> int:
        return len(self.sideslip)

    def __str__(self) -> str:
        if not len(self):
            return "no samples"
        most = float(np.degrees(np.abs(self.sideslip).max()))
        usual = float(np.degrees(np.median(self.deviation)))
        spans = [f"{begin:.6g}-{end:.6g} s" for begin, end in self.grip_lost]
        lost = f", grip lost at {', '.join(spans[:4])}" + ", …" * (len(spans) > 4) if spans else ""
        return f"{len(self)} samples, at most {most:.3g}°, deviation about {usual:.2g}°{lost}"
