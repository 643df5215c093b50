"""Places in the plane with given distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["embed"]

Floats = NDArray[np.float64]

#: Largest number of nodes for a dense eigenvalue solver; above, Lanczos's method is used.
DENSE = 500


def embed(distances: Floats) -> Floats:
    """Return places, shape (n, 2), whose distances approximate the mean of both directions.

    Classical multidimensional scaling: W. S. Torgerson, "Multidimensional scaling: I. Theory and method",
    Psychometrika 17 (1952). The longest mean distance is the unit.
    """
    from scipy.linalg import eigh
    from scipy.sparse.linalg import eigsh

    n = len(distances)
    mean = (distances + distances.T) / 2
    squares = (mean / (float(mean.max()) or 1.0)) ** 2
    inner = -0.5 * (squares - squares.mean(axis=0) - squares.mean(axis=1)[:, None] + squares.mean())
    count = min(2, n)
    if n <= DENSE:
        values, vectors = eigh(inner, subset_by_index=[n - count, n - 1])
    else:
        # A fixed start vector makes the result reproducible.
        values, vectors = eigsh(inner, k=count, which="LA", v0=np.random.default_rng(0).random(n))
    order = np.argsort(-values, kind="stable")
    places = np.zeros((n, 2))
    places[:, :count] = vectors[:, order] * np.sqrt(np.maximum(values[order], 0.0))
    # The sign of an eigenvector depends on the library: make the largest entry positive.
    return places * np.where(places[np.abs(places).argmax(axis=0), [0, 1]] < 0, -1.0, 1.0)
