"""Random generators of the instances.

Instances draw with ``Generator.random`` or ``Generator.integers`` only and round what they compute, so
that a seed gives the same instance on every platform.
"""

from __future__ import annotations

import numpy as np

from ..errors import InvalidData
from ..models.fields import show

__all__ = ["seeded"]


def seeded(seed: int) -> np.random.Generator:
    """Return the random generator of a non-negative integer seed, or raise :class:`InvalidData`."""
    if (
        isinstance(seed, bool | np.timedelta64)
        or not isinstance(seed, int | np.integer)
        or seed < 0
    ):
        raise InvalidData(f"seed must be a whole number >= 0, got {show(seed)}", field="seed")
    return np.random.default_rng(int(seed))
