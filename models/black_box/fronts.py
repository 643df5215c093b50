"""Fronts of several objectives: points that are not dominated, and the hypervolume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["hypervolume", "non_dominated"]

Floats = NDArray[np.float64]


def non_dominated(values: Floats) -> NDArray[np.bool_]:
    """Return whether no other row is at least as good in all objectives and better in one.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Objectives, minimised. Of equal rows all are kept.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for rows of the front.
    """
    return np.array(
        [not ((values <= row).all(axis=1) & (values < row).any(axis=1)).any() for row in values],
        bool,
    ).reshape(len(values))


def hypervolume(values: Floats, reference: Floats) -> float:
    """Return the volume that is dominated by `values` and bounded by `reference`, exactly.

    The volume is the sum of slabs between consecutive values of the last objective; each slab is the
    hypervolume of the other objectives. The effort is O(n^(m - 1) log n).

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Objectives, minimised. Rows that are not better than the reference in all objectives add nothing.
    reference : ndarray, shape (m,)
        Reference point.

    Returns
    -------
    float
        The hypervolume, 0 without any contribution.
    """
    rows = values[(values < reference).all(axis=1)]
    if not len(rows):
        return 0.0
    if rows.shape[1] == 1:
        return float(reference[0] - rows.min())
    rows = rows[np.lexsort(rows.T)]
    if rows.shape[1] == 2:
        heights = np.minimum.accumulate(rows[:, 0])
        return float(
            ((reference[0] - heights) * np.diff(np.append(rows[:, 1], reference[1]))).sum()
        )
    thickness = np.diff(np.append(rows[:, -1], reference[-1]))
    return float(
        sum(
            hypervolume(rows[: k + 1, :-1], reference[:-1]) * thickness[k]
            for k in np.flatnonzero(thickness > 0).tolist()
        )
    )
