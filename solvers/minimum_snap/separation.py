"""Separation of violated bounds: local extremes of polynomials from the roots of the slopes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.polynomials import bernstein_matrix, critical_points, horner

__all__ = ["outside"]

Floats = NDArray[np.float64]


def outside(
    powers: Floats,
    lower: Floats,
    upper: Floats,
    low_scale: Floats,
    high_scale: Floats,
    threshold: float,
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the local extremes that violate a bound.

    Parameters
    ----------
    powers : ndarray, shape (N, degree + 1)
        Ascending powers of s in [0, 1].
    lower, upper : ndarray, shape (N,)
        Bounds; infinite for unbounded rows.
    low_scale, high_scale : ndarray, shape (N,)
        Scales of violations from below and from above.
    threshold : float
        Smallest violation reported, relative to the scales.

    Returns
    -------
    tuple
        Row, argument and relative violation of each extreme.
    """
    control = powers @ bernstein_matrix(powers.shape[1] - 1).T
    # The control polygon encloses the curve, so only rows whose polygon violates a bound matter.
    near = np.flatnonzero((control.min(axis=1) < lower) | (control.max(axis=1) > upper))
    places = np.sort(critical_points(powers[near]), axis=1)
    value = horner(powers[near][:, :, None], places)
    share = np.maximum(
        (lower[near, None] - value) / low_scale[near, None],
        (value - upper[near, None]) / high_scale[near, None],
    )
    # Of adjacent candidates, keep the largest violation. The others are not extremes or repeat it.
    edge = np.full((near.size, 1), -np.inf)
    peak = share >= np.concatenate([edge, share[:, :-1]], axis=1)
    peak &= share > np.concatenate([share[:, 1:], edge], axis=1)
    row, column = np.nonzero(peak & (share > threshold))
    return near[row].astype(np.int64), places[row, column], share[row, column]
