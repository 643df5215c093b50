"""Number of samples of a written plan."""

from __future__ import annotations

import math
import sys
from typing import Any

from ..errors import InvalidData
from .specs import show

__all__ = ["MOST_SAMPLES", "sample_count"]

#: Largest number of samples in a table, about 300 MB of text.
MOST_SAMPLES = 1_000_000


def sample_count(duration: float, rate: Any) -> int:
    """Return the number of whole steps of length ``1 / rate`` in `duration`.

    Parameters
    ----------
    duration : float
        Duration in the plan's unit of time.
    rate : float
        Samples per unit of time, > 0 and finite.

    Raises
    ------
    InvalidData
        The rate is not positive and finite, or yields too many samples (:data:`MOST_SAMPLES`).
    """
    plain = isinstance(rate, int | float) and not isinstance(rate, bool)
    if not plain or not 0 < rate <= sys.float_info.max:
        raise InvalidData(f"rate must be > 0 and finite, got {show(rate)}", field="rate")
    steps = duration * float(rate) * (1.0 + 1e-12)
    if not steps < MOST_SAMPLES:
        raise InvalidData(
            f"rate must give at most {MOST_SAMPLES} samples, got {show(rate)}: {steps:.3g} samples in "
            f"a duration of {duration:g}",
            field="rate",
        )
    return math.floor(steps)
