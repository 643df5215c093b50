"""Maps of a flight: cells, voxels, polygons or points, and the free space that they leave."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Spec, show
from ..fleet_mission.collision import Obstacles, Solids
from ..grid_path.gridmap import GridMap
from ..grid_path.polygons import Polygon, Polygons, as_shapely
from .boxes import Boxes
from .voxels import VoxelMap

__all__ = ["FlightMap", "Maps", "Space"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]
#: Map in one of its four forms: cells, voxels, polygons, or points of shape (n, axes).
FlightMap: TypeAlias = GridMap | VoxelMap | tuple[Polygon, ...] | Floats

#: Keys of the four forms in JSON.
_GRID, _VOXELS, _POLYGONS, _POINTS = _KEYS = ("grid", "voxels", "polygons", "points")
#: Enlargement of unlimited space for the planners, relative to its extent.
_BEYOND = 0.25


@dataclass(frozen=True)
class Maps(Spec):
    """Field of a map: a GridMap, a VoxelMap, a list of polygons, or an array of points (n, 2 or 3).

    In JSON it is an object with one of the keys grid, voxels, polygons and points.
    """

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> FlightMap:
        if isinstance(value, GridMap | VoxelMap):
            return value
        key = _POLYGONS
        if isinstance(value, Mapping):
            if len(value) != 1 or next(iter(value)) not in _KEYS:
                raise InvalidData(
                    f"{name} must be an object with one of the keys {', '.join(_KEYS)}, got "
                    f"{show(value)}",
                    field=name,
                )
            key, value = next(iter(value.items()))
        elif _depth(value) == 2:
            key = _POINTS
        try:
            if key == _GRID:
                return value if isinstance(value, GridMap) else GridMap.from_data(value)
            if key == _VOXELS:
                return value if isinstance(value, VoxelMap) else VoxelMap.from_data(value)
            if key == _POLYGONS:
                polygons: tuple[Polygon, ...] = Polygons().coerce(name, value, {})
                return polygons
            points: Floats = Array(("points", "axes")).coerce(name, value, {})
        except InvalidData as error:
            raise InvalidData(f"{name}.{key}: {error}", field=name) from None
        if points.shape[1] not in (2, 3) or not len(points):
            raise InvalidData(
                f"{name} must hold at least one point of 2 or 3 coordinates, got shape {points.shape}",
                field=name,
            )
        return points

    def encode(self, value: FlightMap) -> dict[str, Any]:
        if isinstance(value, GridMap | VoxelMap):
            return {_GRID if isinstance(value, GridMap) else _VOXELS: value.data()}
        if isinstance(value, tuple):
            return {_POLYGONS: Polygons().encode(value)}
        return {_POINTS: value.tolist()}

    def feed(self, value: FlightMap) -> Iterable[bytes]:
        if isinstance(value, GridMap | VoxelMap):
            return value._feed()
        if isinstance(value, tuple):
            return Polygons().feed(value)
        return Array(("points", "axes")).feed(value)

    def refreeze(self, value: FlightMap) -> FlightMap:
        if isinstance(value, GridMap | VoxelMap):
            return value
        spec: Spec = Polygons() if isinstance(value, tuple) else Array(("points", "axes"))
        result: FlightMap = spec.refreeze(value)
        return result


def _depth(value: Any) -> int:
    """Return the depth of nested lists and arrays along their first entries."""
    depth = 0
    while isinstance(value, list | tuple) and len(value) and depth < 4:
        depth, value = depth + 1, value[0]
    return depth + (value.ndim if isinstance(value, np.ndarray) else 0)


class Space:
    """Free space of a map for a robot of a given radius.

    Parameters
    ----------
    source : FlightMap
        The map.
    radius : float
        Radius of the robot in metres.
    bounds : ndarray, shape (2, axes), or None
        Limits of the robot's centre in metres. None means those of a map of cells, else none.
    """

    def __init__(self, source: FlightMap, radius: float, bounds: Floats | None) -> None:
        self.source, self.radius = source, radius
        self.axes = 3 if isinstance(source, VoxelMap) else 2
        if isinstance(source, np.ndarray):
            self.axes = source.shape[1]
        self.bounds = np.array([[-np.inf] * self.axes, [np.inf] * self.axes])
        if isinstance(source, GridMap | VoxelMap):
            self.bounds = source.origin + np.array([[0.0] * self.axes, self.blocked.shape]) * (
                source.cell
            )
        if bounds is not None:
            low, high = np.maximum(bounds[0], self.bounds[0]), np.minimum(bounds[1], self.bounds[1])
            self.bounds = np.stack([low, high])

    @cached_property
    def blocked(self) -> Truths:
        """Blocked cells of a map of cells, with one dimension per axis: x, y, z."""
        source = self.source
        assert isinstance(source, GridMap | VoxelMap)
        return source.blocked.T if isinstance(source, GridMap) else source.blocked

    @cached_property
    def solids(self) -> Obstacles:
        """Obstacles, for distances."""
        if isinstance(self.source, GridMap | VoxelMap):
            return Boxes.of_cells(self.blocked, self.source.cell, self.source.origin)
        if isinstance(self.source, np.ndarray):
            return Boxes(self.source)
        return Solids(as_shapely(self.source))

    def extent(self, places: Floats) -> Floats:
        """Return the lowest and highest corner of the region for a planner, m, shape (2, axes).

        Parameters
        ----------
        places : ndarray, shape (n, axes)
            Points within the region, m.
        """
        corners = places
        if isinstance(self.source, tuple):
            corners = np.concatenate([places, *(polygon.shell for polygon in self.source)])
        elif isinstance(self.source, np.ndarray):
            corners = np.concatenate([places, self.source])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = _BEYOND * (high - low).max() + 4.0 * self.radius
        low, high = low - margin, high + margin
        return np.stack([np.maximum(low, self.bounds[0]), np.minimum(high, self.bounds[1])])
