"""Loop of the reclassification of samples by cluster centres (Algorithm 3, lines 5-11)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["reclassify"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Relative excess over the share due to rounding.
ROUNDING = 1e-12


@kernel(interpretable=True)
def reclassify(
    points: Floats, centres: Floats, weights: Floats, share: float, labels: Ints
) -> None:
    """Fill `labels` with the cluster of each sample (Algorithm 3, lines 6-10; eq. 20).

    Each centre in turn takes the nearest unassigned samples while the sum of their weights is at most
    `share`. The last centre takes the rest. If there are enough samples, a centre takes at least one
    and leaves one for each later centre.

    Parameters
    ----------
    points : ndarray, shape (n, dims)
        The samples, n >= 1.
    centres : ndarray, shape (m, dims)
        Cluster centres.
    weights : ndarray, shape (n,)
        Weight of each sample, R_i of eq. 18.
    share : float
        Largest sum of the weights of a cluster, R / m.
    labels : ndarray of int, shape (n,)
        Output: the cluster of each sample.
    """
    n, m = points.shape[0], centres.shape[0]
    gaps = np.empty(n)
    for i in range(n):
        labels[i] = -1
    free = n
    for k in range(m):
        for i in range(n):
            total = 0.0
            for j in range(points.shape[1]):
                total += (points[i, j] - centres[k, j]) * (points[i, j] - centres[k, j])
            gaps[i] = total
        weight, count = 0.0, 0
        while free > 0 and (count == 0 or free > m - 1 - k):
            near, least = -1, math.inf
            for i in range(n):
                if labels[i] < 0 and (near < 0 or gaps[i] < least):
                    near, least = i, gaps[i]
            weight += weights[near]
            if k < m - 1 and count > 0 and weight > share * (1.0 + ROUNDING):
                break
            labels[near] = k
            count += 1
            free -= 1
