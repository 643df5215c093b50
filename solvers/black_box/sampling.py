"""Sample of the unit cube."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["latin_hypercube"]

Floats = NDArray[np.float64]


def latin_hypercube(generator: np.random.Generator, count: int, dimension: int) -> Floats:
    """Return points of the unit cube, shape (count, dimension), one in each slice of each variable.

    SciPy's sampler would import its statistics, which takes longer than most searches.
    """
    slices = np.tile(np.arange(count), (dimension, 1))
    points: Floats = generator.permuted(slices, axis=1).T + generator.random((count, dimension))
    return points / count
