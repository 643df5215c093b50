"""Plans of paths on a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import Array, declared
from ..records import Several

__all__ = ["GridPlan"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GridPlan(Plan):
    """Paths from the start to the goals.

    Parameters
    ----------
    paths : tuple of ndarray, each of shape (k, 2)
        Points x, y of each path in metres. The plan has one path, or one per goal if the model's `reach` is
        "each".

    Raises
    ------
    InvalidData
        The paths are not a list of arrays with at least one point each.
    """

    paths: tuple[Floats, ...] = declared(Several(Array(("points", 2))))

    def check(self) -> None:
        """Reject paths without a point."""
        for k, path in enumerate(self.paths):
            if not len(path):
                raise InvalidData(f"paths[{k}] must have at least one point", field=f"paths[{k}]")

    @property
    def length(self) -> float:
        """Total length of all paths, m."""
        return float(sum(np.hypot(*np.diff(path, axis=0).T).sum() for path in self.paths))

    def __str__(self) -> str:
        points = sum(len(path) for path in self.paths)
        several = f"{len(self.paths)} paths, " if len(self.paths) > 1 else ""
        return f"{several}{points} points, {self.length:.10g} m"
