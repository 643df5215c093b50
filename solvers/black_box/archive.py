"""Front of the feasible points of a run with several objectives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ...models.black_box.fronts import hypervolume, non_dominated

__all__ = ["Archive"]

Floats = NDArray[np.float64]


class Archive:
    """Points `x` that do not dominate one another, at most `size`, with the largest hypervolume so far.

    Attributes `values`, shape (n, objectives), and `volume` are their objectives and their hypervolume.
    """

    def __init__(self, reference: Floats, size: int) -> None:
        self.reference, self.size, self.volume = reference, size, 0.0
        self.x, self.values = np.empty((0, 0)), np.empty((0, len(reference)))

    def add(self, x: Floats, values: Floats, feasible: NDArray[np.bool_]) -> bool:
        """Add points, and return whether the hypervolume has increased.

        Points that are not better than the reference in all objectives are ignored.
        """
        useful = feasible & (values < self.reference).all(axis=1)
        if not useful.any():
            return False
        points = np.vstack([self.x.reshape(-1, x.shape[1]), x[useful]])
        rows, first = np.unique(np.vstack([self.values, values[useful]]), axis=0, return_index=True)
        keep = non_dominated(rows)
        points, rows = points[first[keep]], rows[keep]
        if len(rows) > self.size:
            chosen = self._thinned(rows)
            points, rows = points[chosen], rows[chosen]
        volume = hypervolume(rows, self.reference)
        if volume <= self.volume:
            return False
        self.x, self.values, self.volume = points, rows, volume
        return True

    def _thinned(self, rows: Floats) -> list[int]:
        """Return `size` of the rows, which are sorted by the first objective: the one with the least room is dropped.

        Room is the hypervolume that a row adds, or for more than two objectives its distance to others.
        """
        keep = list(range(len(rows)))
        if rows.shape[1] == 2:
            while len(keep) > self.size:
                left = rows[keep]
                width = np.diff(left[:, 0], append=self.reference[0])
                height = -np.diff(left[:, 1], prepend=self.reference[1])
                del keep[int((width * height).argmin())]
            return keep
        extent = np.ptp(rows, axis=0)
        scaled = rows / np.where(extent > 0, extent, 1.0)
        distances = cdist(scaled, scaled)
        np.fill_diagonal(distances, np.inf)
        nearest = np.sort(distances, axis=1)[:, :2]
        extremes = rows.argmin(axis=0)  # the best of each objective stays
        while len(keep) > self.size:
            room = nearest[:, 0] + 1e-3 * nearest[:, 1]
            room[extremes] = np.inf
            drop = keep.pop(int(room[keep].argmin()))
            changed = np.flatnonzero(distances[:, drop] <= nearest[:, 1])
            distances[:, drop] = np.inf
            nearest[changed] = np.sort(distances[changed], axis=1)[:, :2]
        return keep

    def compromise(self) -> Floats:
        """Return the point that alone has the largest hypervolume."""
        result: Floats = self.x[np.prod(self.reference - self.values, axis=1).argmax()]
        return result
