"""Paths on a map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, show

__all__ = ["GridPlan"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GridPlan:
    """Polylines from the start.

    Parameters
    ----------
    paths : tuple of ndarray, each of shape (k, 2)
        The points of each path, x, y (m): one path, or one a goal where each is to be reached.
    """

    paths: tuple[Floats, ...]

    def __post_init__(self) -> None:
        given = self.paths
        if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
            raise InvalidData(f"paths must be a list of paths, got {show(given)}", field="paths")
        paths = tuple(Array((f"n{k}", 2)).coerce(f"paths[{k}]", p, {}) for k, p in enumerate(given))
        for k, path in enumerate(paths):
            if not len(path):
                raise InvalidData(f"paths[{k}] must have at least one point", field=f"paths[{k}]")
        object.__setattr__(self, "paths", paths)

    @property
    def length(self) -> float:
        """The length of all paths, m."""
        return float(sum(np.hypot(*np.diff(path, axis=0).T).sum() for path in self.paths))

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"paths": [path.tolist() for path in self.paths]}

    @classmethod
    def from_data(cls, data: Any) -> GridPlan:
        """Return the plan that :meth:`to_data` wrote; bad data raises ``InvalidData``."""
        if not isinstance(data, Mapping) or set(data) != {"paths"}:
            raise InvalidData(
                f"a plan must be an object with the key paths, got {show(data)}", field="plan"
            )
        return cls(data["paths"])

    def __str__(self) -> str:
        points = sum(len(path) for path in self.paths)
        several = f"{len(self.paths)} paths, " if len(self.paths) > 1 else ""
        return f"{several}{points} points, {self.length:.10g} m"
