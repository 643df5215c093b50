"""Fronts of several objectives: points that are not dominated, and the hypervolume."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

__all__ = ["hypervolume", "non_dominated"]

Floats = NDArray[np.float64]


def non_dominated(values: Floats) -> NDArray[np.bool_]:
    """Return whether no other row of objectives is at least as good in all and better in one, shape (n,)."""
    return np.array(
        [not ((values <= row).all(axis=1) & (values < row).any(axis=1)).any() for row in values],
        bool,
    ).reshape(len(values))


def hypervolume(values: Floats, reference: Floats) -> float:
    """Return the volume that rows of objectives dominate and `reference` bounds, exactly.

    The volume is the sum of slabs between consecutive values of the last objective. The base of a slab is stored as
    the heights, values of the last objective but one, over the grid of all others. The effort is O(n^(m - 1)) with
    one operation on arrays per row: 300 rows of 4 objectives take 0.02 s. Rows that are not better than the reference
    in all objectives add nothing.
    """
    padding = max(3 - len(reference), 0)
    rows = np.pad(values[(values < reference).all(axis=1)], ((0, 0), (padding, 0)))
    reference = np.pad(reference, (padding, 0), constant_values=1.0)
    # Powers of two as units keep the products of lengths finite without rounding.
    exponents = 1 + np.frexp((0.5 * reference - 0.5 * rows).max(axis=0, initial=0.0))[1]
    rows, reference = np.ldexp(rows, -exponents), np.ldexp(reference, -exponents)
    rows = rows[rows[:, -1].argsort()]
    edges = [np.unique(column) for column in rows[:, :-2].T]
    places = [np.searchsorted(*pair) for pair in zip(edges, rows[:, :-2].T, strict=True)]
    sides = [np.diff(edge, append=end) for edge, end in zip(edges, reference, strict=False)]
    cells = functools.reduce(np.multiply.outer, sides)
    heights = np.full(cells.shape, reference[-2])
    total = base = 0.0
    for k, thickness in enumerate(np.diff(rows[:, -1], append=reference[-1]).tolist()):
        beyond = tuple(slice(place[k], None) for place in places)
        lower = np.minimum(heights[beyond], rows[k, -2])
        base += float(((heights[beyond] - lower) * cells[beyond]).sum())
        heights[beyond] = lower
        total += base * thickness
    with np.errstate(over="ignore"):
        return float(np.ldexp(total, exponents.sum()))
