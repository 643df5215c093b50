"""How many samples a plan is written with."""

from __future__ import annotations

import math
import sys
from typing import Any

from ..errors import InvalidData
from .fields import show

__all__ = ["MOST_SAMPLES", "sample_count"]

#: Samples above which a table is refused: some 300 MB of text.
MOST_SAMPLES = 1_000_000


def sample_count(duration: float, rate: Any) -> int:
    """Return how many steps of ``1 / rate`` lie in `duration`.

    Raises
    ------
    InvalidData
        The rate is no finite number > 0, or gives more than :data:`MOST_SAMPLES` samples.
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
