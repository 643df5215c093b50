"""Front of the feasible points of a run with several objectives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.black_box.fronts import hypervolume, non_dominated

__all__ = ["Archive"]

Floats = NDArray[np.float64]


class Archive:
    """Points that do not dominate one another, at most `size`, with the largest hypervolume so far.

    Parameters
    ----------
    reference : ndarray, shape (objectives,)
        Reference point.
    size : int
        Largest number of points.

    Attributes
    ----------
    x, values : ndarray, shapes (n, d) and (n, objectives)
        Points and their objectives.
    volume : float
        Hypervolume of the points.
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
        while len(rows) > self.size:
            drop = int(self._room(rows).argmin())
            points, rows = np.delete(points, drop, axis=0), np.delete(rows, drop, axis=0)
        volume = hypervolume(rows, self.reference)
        if volume <= self.volume:
            return False
        self.x, self.values, self.volume = points, rows, volume
        return True

    def _room(self, rows: Floats) -> Floats:
        """Return the hypervolume that each row adds; for more than two objectives its distance to others.

        The rows are sorted by the first objective.
        """
        if rows.shape[1] == 2:
            width = np.diff(np.append(rows[:, 0], self.reference[0]))
            height = -np.diff(np.append(self.reference[1], rows[:, 1]))
            return width * height
        extent = np.ptp(rows, axis=0)
        scaled = rows / np.where(extent > 0, extent, 1.0)
        distances = np.linalg.norm(scaled[:, None] - scaled, axis=2)
        np.fill_diagonal(distances, np.inf)
        distances.sort(axis=1)
        result: Floats = distances[:, 0] + 1e-3 * distances[:, 1]
        result[rows.argmin(axis=0)] = np.inf  # the best of each objective stays
        return result

    def compromise(self) -> Floats:
        """Return the point that alone has the largest hypervolume."""
        result: Floats = self.x[np.prod(self.reference - self.values, axis=1).argmax()]
        return result
