"""Obstacles of corridors as convex bodies: boxes of blocked cells, edges of polygons, and points.

A body is the set {c + Σ t_j g_j : -1 <= t_j <= 1} of a centre c and arms g_j, enlarged by the radius of the
vehicle. Its extent in a direction n is n·c ± Σ |n·g_j|.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array
from ..grid_path import GridMap, Polygon, Polygons, as_shapely
from .voxels import VoxelMap

__all__ = ["Bodies", "Cells", "ConvexObstacles", "Edges", "Points", "as_obstacles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Bodies(NamedTuple):
    """Convex bodies in a window: centres, shape (n, d), arms, shape (n, k, d), and names in messages."""

    centres: Floats
    arms: Floats
    name: Callable[[int], str]


class ConvexObstacles(ABC):
    """Base of the kinds of obstacles, which consist of convex bodies."""

    #: Name of one obstacle.
    noun: str
    dimensions: int
    #: Lowest and greatest coordinates of the vehicle's centre, shape (2, d), if they are limited.
    limits: tuple[tuple[Fraction, ...], tuple[Fraction, ...]] | None = None
    #: Lowest and greatest coordinates of the obstacles, shape (2, d).
    extent: Floats

    @abstractmethod
    def within(self, low: Floats, high: Floats) -> Bodies:
        """Return bodies that cover the obstacles inside a box."""

    def containing(self, point: Floats) -> str:
        """Return the name of an obstacle whose interior contains a point, or an empty string."""
        return ""


class Cells(ConvexObstacles):
    """Blocked cells of a grid or of a voxel map, with indices in the order of the axes."""

    noun = "blocked cell"

    def __init__(self, source: GridMap | VoxelMap) -> None:
        self.planar = isinstance(source, GridMap)
        self.blocked = source.blocked.T if self.planar else source.blocked
        self.cell, self.origin = source.cell, source.origin
        self.dimensions = self.blocked.ndim
        size = Fraction(self.cell)
        low = tuple(fractions(self.origin))
        self.limits = (
            low,
            tuple(x + n * size for x, n in zip(low, self.blocked.shape, strict=True)),
        )
        self.extent = np.array(self.limits, float)

    def indices(self, low: Floats, high: Floats) -> Ints:
        """Return the indices of the blocked cells that meet a box, shape (n, d)."""
        first = np.clip(np.floor((low - self.origin) / self.cell) - 1, 0, self.blocked.shape)
        last = np.clip(np.ceil((high - self.origin) / self.cell) + 1, 0, self.blocked.shape)
        window = tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
        return np.asarray(np.argwhere(self.blocked[window]) + first.astype(np.int64))

    def within(self, low: Floats, high: Floats) -> Bodies:
        boxes = self.indices(low, high).repeat(2, axis=1).reshape(-1, self.dimensions, 2)
        for axis in reversed(range(self.dimensions)):
            boxes = _merged(boxes, axis)
        half = 0.5 * self.cell * (boxes[..., 1] - boxes[..., 0] + 1)
        centres = self.origin + 0.5 * self.cell * (boxes.sum(axis=2) + 1)
        return Bodies(
            centres, half[:, :, None] * np.eye(self.dimensions), lambda k: self._name(boxes[k])
        )

    def _name(self, box: Ints) -> str:
        first, last = (tuple(end[::-1] if self.planar else end) for end in box.T.tolist())
        where = "(row, column)" if self.planar else "(i, j, k)"
        return f"blocked cells {where} {first}" + (f" to {last}" if first != last else "")


def fractions(values: Any) -> list[Fraction]:
    """Return numbers as exact fractions."""
    return [Fraction(value) for value in np.asarray(values).tolist()]


def _merged(boxes: Ints, axis: int) -> Ints:
    """Join boxes of cells, shape (n, d, 2), that continue one another along an axis."""
    others = np.delete(boxes, axis, axis=1).reshape(len(boxes), 2 * boxes.shape[1] - 2)
    order = np.lexsort((boxes[:, axis, 0], *others.T))
    boxes, others = boxes[order], others[order]
    same = (others[1:] == others[:-1]).all(axis=1)
    begins = np.r_[True, ~(same & (boxes[1:, axis, 0] == boxes[:-1, axis, 1] + 1))][: len(boxes)]
    starts = np.flatnonzero(begins)
    joined = boxes[starts].copy()
    joined[:, axis, 1] = boxes[np.r_[starts[1:], len(boxes)] - 1, axis, 1] if len(boxes) else 0
    return joined


class Edges(ConvexObstacles):
    """Edges of polygons. A connected set that starts outside and meets no edge stays outside."""

    noun, dimensions = "edge of a polygon", 2

    def __init__(self, polygons: tuple[Polygon, ...]) -> None:
        self.polygons = polygons
        rings = [
            (k, ring) for k, shape in enumerate(polygons) for ring in (shape.shell, *shape.holes)
        ]
        self.owners = np.array([k for k, ring in rings for _ in ring], int)
        self.begins = np.concatenate([np.empty((0, 2)), *(ring for _, ring in rings)])
        ends = [np.roll(ring, -1, axis=0) for _, ring in rings]
        self.ends = np.concatenate([np.empty((0, 2)), *ends])
        self.extent = _extent(self.begins)

    def within(self, low: Floats, high: Floats) -> Bodies:
        step = self.ends - self.begins
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts = np.stack([low - self.begins, high - self.begins], axis=2) / step[..., None]
        flat = step == 0
        outside = flat & ((self.begins < low) | (self.begins > high))
        first = np.where(flat, -np.inf, cuts.min(axis=2)).max(axis=1, initial=0.0)
        last = np.where(flat, np.inf, cuts.max(axis=2)).min(axis=1, initial=1.0)
        rows = np.flatnonzero((first <= last) & ~outside.any(axis=1))
        begin, end = first[rows, None], last[rows, None]
        centres = self.begins[rows] + 0.5 * (begin + end) * step[rows]
        arms = 0.5 * (end - begin) * step[rows]
        return Bodies(centres, arms[:, None], lambda k: f"polygons[{self.owners[rows[k]]}]")

    def containing(self, point: Floats) -> str:
        import shapely

        inside = shapely.contains_xy(as_shapely(self.polygons), *point)
        return f"polygons[{int(inside.argmax())}]" if inside.any() else ""


class Points(ConvexObstacles):
    """Points of a cloud."""

    noun = "point"

    def __init__(self, points: Floats) -> None:
        self.points = points
        self.dimensions = points.shape[1]
        self.extent = _extent(points)

    def within(self, low: Floats, high: Floats) -> Bodies:
        rows = np.flatnonzero(((self.points >= low) & (self.points <= high)).all(axis=1))
        arms = np.zeros((len(rows), 0, self.dimensions))
        return Bodies(self.points[rows], arms, lambda k: f"obstacles[{rows[k]}]")


def _extent(points: Floats) -> Floats:
    if not len(points):
        return np.empty((0, points.shape[1]))
    return np.stack([points.min(axis=0), points.max(axis=0)])


def as_obstacles(value: Any, dimensions: int) -> ConvexObstacles:
    """Return the obstacles of a map, of polygons or of points in metres, for a path with `dimensions` axes.

    In two dimensions, an array of shape (n, 2) is a list of points, and every other list contains polygons. Raise
    :class:`InvalidData` if the obstacles are invalid or have another number of axes.
    """
    obstacles: ConvexObstacles
    if isinstance(value, Mapping | Polygon) or hasattr(value, "exterior"):
        value = [value]  # a single polygon
    if isinstance(value, GridMap | VoxelMap):
        obstacles = Cells(value)
    elif dimensions == 2 and not _is_table(value):
        obstacles = Edges(Polygons().coerce("obstacles", value, {}))
    else:
        obstacles = Points(Array(("points", "axes")).coerce("obstacles", value, {}))
        if not len(obstacles.points):
            obstacles = Points(np.empty((0, dimensions)))
    if obstacles.dimensions != dimensions:
        raise InvalidData(
            f"path must have {obstacles.dimensions} columns as the obstacles, got {dimensions}",
            field="path",
        )
    return obstacles


def _is_table(value: Any) -> bool:
    """Return whether a value is an array of numbers with two axes."""
    try:
        array = np.asarray(value)
    except Exception:  # ragged lists are polygons
        return False
    return array.ndim == 2 and array.dtype.kind in "iuf"
