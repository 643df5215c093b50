"""Plans of paths on a map."""

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
    """Paths from the start to the goals.

    Parameters
    ----------
    paths : tuple of ndarray, each of shape (k, 2)
        Points x, y of each path, m. The plan has one path, or one per goal if the model's `reach` is
        "each".

    Raises
    ------
    InvalidData
        The paths are not a list of arrays with at least one point each.
    """

    paths: tuple[Floats, ...]

    def __post_init__(self) -> None:
        value = self.paths
        if isinstance(value, str | Mapping) or not isinstance(value, Sequence):
            raise InvalidData(f"paths must be a list of paths, got {show(value)}", field="paths")
        paths = tuple(Array((f"n{k}", 2)).coerce(f"paths[{k}]", p, {}) for k, p in enumerate(value))
        for k, path in enumerate(paths):
            if not len(path):
                raise InvalidData(f"paths[{k}] must have at least one point", field=f"paths[{k}]")
        object.__setattr__(self, "paths", paths)

    @property
    def length(self) -> float:
        """Total length of all paths, m."""
        return float(sum(np.hypot(*np.diff(path, axis=0).T).sum() for path in self.paths))

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"paths": [path.tolist() for path in self.paths]}

    @classmethod
    def from_data(cls, data: Any) -> GridPlan:
        """Return the plan from the data of :meth:`to_data`.

        Raises
        ------
        InvalidData
            The data is not an object with the key ``paths``, or a path is invalid.
        """
        if not isinstance(data, Mapping) or set(data) != {"paths"}:
            raise InvalidData(
                f"a plan must be an object with the key paths, got {show(data)}", field="plan"
            )
        return cls(data["paths"])

    def __str__(self) -> str:
        points = sum(len(path) for path in self.paths)
        several = f"{len(self.paths)} paths, " if len(self.paths) > 1 else ""
        return f"{several}{points} points, {self.length:.10g} m"
