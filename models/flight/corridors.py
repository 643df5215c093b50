"""Corridors: chains of convex polytopes along a path that contain no obstacle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Optional, Real, declared, frozen, show
from ..inputs import Field, FloatArray, FloatsOrNone, Numbers
from ..verification import Verification
from .corridors_inflation import Contact, Inflation, inflate, largest_ball
from .corridors_obstacles import ConvexObstacles, as_obstacles
from .corridors_proof import verify_corridor

__all__ = ["METHODS", "Corridor", "corridor"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bounded = TypeVar("Bounded", bound=Any)

#: Methods, and the maximum number of passes of the inflation.
METHODS = {"firi": 12, "one-pass": 1}
#: Maximum number of polytopes.
MOST = 100_000
#: Least and greatest side of a box, m, and its least size relative to the coordinates, because of rounding.
_SIZES, _FINEST = (1e-100, 1e100), 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Corridor(Declared):
    """Chain of convex polytopes along a path. :func:`corridor` computes it.

    The union of the polytopes contains the path, and no polytope contains a point nearer than `radius` to an
    obstacle in its interior. :meth:`verify` proves both by exact arithmetic.

    Parameters
    ----------
    path : ndarray, shape (waypoints, d)
        Waypoints of the path, m.
    covers : ndarray, shape (polytopes, 2)
        Part of the path in each polytope: first and last waypoint, with the share of a segment as fraction. The
        number 1.5 is the middle of the second segment. Each part begins at the end of the previous one.
    owners : ndarray of int, shape (faces,)
        Polytope of each face, not decreasing.
    normals : ndarray, shape (faces, d)
        Outer unit normals of the faces.
    offsets : ndarray, shape (faces,)
        Offsets of the faces, m: the polytope is ``normals @ x <= offsets``.
    overlaps : ndarray, shape (polytopes - 1, d + 1)
        Centre and radius of a ball in the intersection of consecutive polytopes, m.
    radius : float, default 0
        Radius of the vehicle, m.
    bounds : ndarray, shape (2 d,), optional
        Lowest coordinates and greatest coordinates of the vehicle's centre, m.

    Raises
    ------
    InvalidData
        Shapes differ. The message names the field.
    """

    path: FloatArray = declared(Array(("waypoints", "axes"), unit="m"))
    covers: FloatArray = declared(Array(("polytopes", 2), lower=0))
    owners: Field[Numbers, Ints] = declared(Array(("faces",), int, lower=0))
    normals: FloatArray = declared(Array(("faces", "axes")))
    offsets: FloatArray = declared(Array(("faces",), unit="m"))
    overlaps: FloatArray = declared(Array(("balls", "columns"), unit="m"))
    radius: float = declared(Real(lower=0, unit="m"), default=0.0)
    bounds: FloatsOrNone = declared(Optional(Array(("ends",), unit="m")), default=None)

    def check(self) -> None:
        """Raise if the sizes of fields contradict one another."""
        count, axes = len(self.covers), self.path.shape[1]
        if not self.overlaps.size:
            object.__setattr__(self, "overlaps", frozen(np.empty((0, axes + 1))))
        fits = {
            "path": len(self.path) > 0,
            "owners": count > 0
            and np.array_equal(np.unique(self.owners), np.arange(count))
            and bool((np.diff(self.owners) >= 0).all()),
            "overlaps": self.overlaps.shape == (count - 1, axes + 1),
            "bounds": self.bounds is None or self.bounds.size == 2 * axes,
        }
        for name, good in fits.items():
            if not good:
                raise InvalidData(
                    f"{name} must fit {count} polytopes with {axes} axes in the order of their faces, got "
                    f"shape {getattr(self, name).shape}",
                    field=name,
                )

    def __len__(self) -> int:
        return len(self.covers)

    @cached_property
    def polytopes(self) -> list[tuple[Floats, Floats]]:
        """Normals, shape (faces, d), and offsets, shape (faces,), of each polytope."""
        cuts = np.flatnonzero(np.diff(self.owners)) + 1
        return list(zip(*(np.split(x, cuts) for x in (self.normals, self.offsets)), strict=True))

    @cached_property
    def knots(self) -> Floats:
        """Start of the path, centres of the overlaps and end of the path, m, shape (polytopes + 1, d)."""
        return frozen(np.concatenate([self.path[:1], self.overlaps[:, :-1], self.path[-1:]]))

    @cached_property
    def corners(self) -> list[Floats]:
        """Corners of each polytope, m, shape (corners, d); none if it is unbounded or has no interior."""
        from scipy.spatial import HalfspaceIntersection

        corners = []
        for normals, offsets in self.polytopes:
            low, high = _box(normals, offsets)
            scale, middle, depth = float((high - low).max()), low, 0.0
            if np.isfinite(scale):
                middle, depth = largest_ball(normals, offsets, 0.5 * (low + high))
            points = np.empty((0, len(low)))
            if depth > 0:
                local = np.column_stack([normals, (normals @ middle - offsets) / scale])
                points = middle + scale * HalfspaceIntersection(local, 0.0 * low).intersections
            corners.append(points)
        return corners

    @cached_property
    def volumes(self) -> Floats:
        """Volume of each polytope, m³, or area, m², shape (polytopes,); NaN without corners."""
        from scipy.spatial import ConvexHull

        volumes = np.full(len(self), np.nan)
        for k, points in enumerate(self.corners):
            if len(points):
                scale = float(np.ptp(points, axis=0).max())
                size = ConvexHull((points - points[0]) / scale).volume
                volumes[k] = size * scale ** points.shape[1]
        return frozen(volumes)

    def fields(self, polytopes: ArrayLike | None = None) -> dict[str, Any]:
        """Return the fields of :class:`~crosstrack.models.MinimumDerivative` for trajectories inside.

        Parameters
        ----------
        polytopes : array-like of int, shape (segments,), optional
            Polytope of each segment of the trajectory. By default, segment k is in polytope k.

        Returns
        -------
        dict
            The fields ``polytope_segments``, ``polytope_normals`` and ``polytope_offsets``.

        Raises
        ------
        InvalidData
            A number is not that of a polytope.
        """
        chosen = Array(("segments",), int, lower=0, upper=len(self) - 1).coerce(
            "polytopes", np.arange(len(self)) if polytopes is None else polytopes, {}
        )
        parts = [self.polytopes[k] for k in chosen]
        return {
            "polytope_segments": np.repeat(np.arange(len(chosen)), [len(b) for _, b in parts]),
            "polytope_normals": np.concatenate([normals for normals, _ in parts]),
            "polytope_offsets": np.concatenate([offsets for _, offsets in parts]),
        }

    def bounded(self, model: Bounded, polytopes: ArrayLike | None = None) -> Bounded:
        """Return a model of a trajectory with the polytopes of :meth:`fields`."""
        return replace(model, **self.fields(polytopes))

    def verify(self, obstacles: Any) -> Verification:
        """Prove that the polytopes contain the path and no obstacle, by exact arithmetic.

        The obstacles are read again, by the same reader as for the construction, but without its bodies. Each
        blocked cell, point or edge must be separated from the polytope by its faces with the distance `radius`.
        Coordinates are rational numbers; floats decide if their rounding errors cannot change the result.

        Parameters
        ----------
        obstacles : GridMap, VoxelMap, list of polygons, or array-like, shape (n, d)
            Obstacles as in :func:`corridor`.

        Returns
        -------
        Verification
            The objective is the total volume. The checks have no tolerance.
        """
        return verify_corridor(self, as_obstacles(obstacles, self.path.shape[1]))

    def __repr__(self) -> str:
        return f"<Corridor of {len(self)} polytopes, {len(self.offsets)} faces, {self.path.shape[1]}-D>"


def _box(normals: Floats, offsets: Floats) -> tuple[Floats, Floats]:
    """Return the lowest and the greatest coordinates that the axis-parallel faces allow."""
    axes = np.eye(normals.shape[1])
    high = [offsets[(normals == axis).all(axis=1)].min(initial=np.inf) for axis in axes]
    low = [-offsets[(normals == -axis).all(axis=1)].min(initial=np.inf) for axis in axes]
    return np.array(low), np.array(high)


def corridor(
    obstacles: Any,
    path: ArrayLike,
    *,
    radius: float = 0.0,
    bounds: ArrayLike | None = None,
    method: str = "firi",
    reach: float | None = None,
    pause: Callable[[], Any] = bool,
) -> Corridor:
    """Return a chain of convex polytopes along a path that contain no obstacle.

    Each polytope is inflated around a segment of the path by restrictive inflation and largest inscribed
    ellipsoids (Wang et al. 2024), until the ellipsoid grows by less than 2 %. It is maximal in this sense:
    each face belongs to its box, or touches an obstacle at the distance `radius` that no other face
    separates. Consecutive polytopes share a ball of positive radius.

    Parameters
    ----------
    obstacles : GridMap, VoxelMap, list of polygons, or array-like, shape (n, d)
        Obstacles, m. Polygons are in any form that :class:`~crosstrack.models.grid_path.Polygons` accepts. An
        array with two axes is a cloud of points.
    path : array-like, shape (k, d)
        Waypoints, m, with d = 2 or 3 axes. Equal consecutive waypoints and a single one are allowed. The path
        must keep a distance greater than `radius` from all obstacles, by 1e-9 of `reach`.
    radius : float, default 0
        Radius of the vehicle, m.
    bounds : array-like, shape (2 d,), optional
        Lowest coordinates and greatest coordinates of the vehicle's centre, m. The path may touch them. A map
        bounds the centre as well.
    method : {"firi", "one-pass"}
        ``"one-pass"`` omits the ellipsoids: polytopes are computed faster and are smaller.
    reach : float, optional
        Longest side of the box around each polytope, m. Segments longer than half of it are split. By default
        half of the largest extent of the bounds or the map, or of the obstacles and the path.
    pause : callable, optional
        Function to call before each polytope; an exception from it ends the computation.

    Returns
    -------
    Corridor
        Polytopes, which :meth:`Corridor.verify` accepts.

    Raises
    ------
    InvalidData
        The path touches or crosses an obstacle or leaves the bounds: the message names the segment, the
        obstacle and the distance. Or an argument is invalid.
    """
    points = Array(("waypoints", "axes"), unit="m").coerce("path", path, {})
    if not len(points) or points.shape[1] not in (2, 3):
        raise InvalidData(
            f"path must have at least 1 row and 2 or 3 columns, got shape {points.shape}",
            field="path",
        )
    solids = as_obstacles(obstacles, points.shape[1])
    size = Real(lower=0, unit="m").coerce("radius", radius, {})
    if method not in METHODS:
        raise InvalidData(
            f"method must be one of {', '.join(METHODS)}, got {show(method)}", field="method"
        )
    frame = None if bounds is None else Array((2 * points.shape[1],)).coerce("bounds", bounds, {})
    limits = _limits(solids, frame, points)
    side = _reach(reach, limits, solids, points, size)
    inside = solids.containing(points[0])
    if inside:
        raise InvalidData(
            f"path[0] must be outside all obstacles, but is inside {inside}", field="path"
        )
    stops = _stops(points, side)
    covers, parts = _chain(solids, points, stops, size, limits, side, METHODS[method], pause)
    balls = [_overlap(first, second) for first, second in pairwise(parts)]
    return Corridor(
        path=points, covers=covers, owners=np.repeat(np.arange(len(parts)), [len(p.offsets) for p in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        offsets=np.concatenate([part.offsets for part in parts]),
        overlaps=np.reshape(balls, (-1, points.shape[1] + 1)), radius=size, bounds=frame,
    )  # fmt: skip


def _limits(solids: ConvexObstacles, frame: Floats | None, points: Floats) -> Floats:
    """Return the lowest and greatest coordinates of the centre, shape (2, d), rounded inward."""
    limits = np.array([[-np.inf], [np.inf]]).repeat(axes := points.shape[1], axis=1)
    if solids.limits is not None:
        for axis in range(axes):
            low, high = solids.limits[0][axis], solids.limits[1][axis]
            first, last = float(low), float(high)
            limits[0, axis] = math.nextafter(first, math.inf) if first < low else first
            limits[1, axis] = math.nextafter(last, -math.inf) if last > high else last
    if frame is not None:
        limits[0] = np.maximum(limits[0], frame[:axes])
        limits[1] = np.minimum(limits[1], frame[axes:])
        if not (limits[0] < limits[1]).all():
            raise InvalidData(
                "bounds must be lowest and greatest coordinates with a volume inside the map, got "
                f"{show(frame.tolist())}",
                field="bounds",
            )
    outside = ((points < limits[0]) | (points > limits[1])).any(axis=1)
    if outside.any():
        k = int(outside.argmax())
        raise InvalidData(
            f"path[{k}] must be within {limits[0].tolist()} and {limits[1].tolist()} (the map and the "
            f"bounds), got {points[k].tolist()}",
            field="path",
        )
    return limits


def _reach(
    reach: float | None, limits: Floats, solids: ConvexObstacles, points: Floats, size: float
) -> float:
    """Return the side of the box around a polytope, m."""
    extent = np.concatenate([solids.extent, points])
    if reach is None:
        low = np.where(np.isfinite(limits[0]), limits[0], extent.min(axis=0))
        high = np.where(np.isfinite(limits[1]), limits[1], extent.max(axis=0))
        side = max(0.5 * float((high - low).max()), 4 * size) or 1.0
    else:
        side = Real(lower=0, strict=True, unit="m").coerce("reach", reach, {})
    least = max(_SIZES[0], _FINEST * float(np.abs(points).max()))
    if not least <= side <= _SIZES[1]:
        raise InvalidData(
            f"reach must be between {least:g} m and {_SIZES[1]:g} m for coordinates of the path up to "
            f"{np.abs(points).max():g} m, got {side:g} m",
            field="reach",
        )
    return side


def _stops(points: Floats, side: float) -> list[float]:
    """Return the parts of the path, as waypoint numbers with fractions, of at most half a side each."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    counts = np.ceil(steps / (0.5 * side))
    if not counts.sum() <= MOST:
        raise InvalidData(
            f"reach must divide the path into at most {MOST} parts, got {side:g} m for a path of "
            f"{steps.sum():g} m",
            field="reach",
        )
    stops = [0.0]
    for k, count in enumerate(counts.astype(int).tolist()):
        stops += [k + j / count for j in range(1, count)] + [k + 1.0] * (count > 0)
    return stops


def _chain(
    solids: ConvexObstacles, points: Floats, stops: list[float], size: float, limits: Floats, side: float,
    passes: int, pause: Callable[[], Any],
) -> tuple[list[tuple[float, float]], list[Inflation]]:  # fmt: skip
    """Return the polytopes along the path and the part of the path in each.

    A polytope that contains the next parts as well, with half of its margin, covers them.
    """
    places = np.stack([np.interp(stops, np.arange(len(points)), x) for x in points.T], axis=1)
    covers: list[tuple[float, float]] = []
    parts, k = list[Inflation](), 0
    while not parts or k < len(stops) - 1:
        pause()
        seeds = places[k : k + 2]
        middle = 0.5 * (seeds[0] + seeds[-1])
        low = np.maximum(middle - 0.5 * side, limits[0])
        high = np.minimum(middle + 0.5 * side, limits[1])
        around = solids.within(low - 1.001 * size - 1e-9 * side, high + 1.001 * size + 1e-9 * side)
        part = inflate(around, size, seeds, low, high, passes)
        if isinstance(part, Contact):
            raise InvalidData(
                f"path must keep a distance > {size:g} m (radius) from all obstacles, but segment "
                f"{min(int(stops[k]), max(len(points) - 2, 0))}, near "
                f"({', '.join(f'{x:g}' for x in middle)}), is at {part.distance:g} m from "
                f"{around.name(part.body)}; move the path away or reduce the radius",
                field="path",
            )
        last = k + 1
        # The path may touch the limits of the vehicle's centre, but no other face.
        touching = np.concatenate([high == limits[1], low == limits[0]])
        room = part.offsets - 0.5 * part.margin
        room[: len(touching)][touching] = part.offsets[: len(touching)][touching]
        while last + 1 < len(stops) and (part.normals @ places[last + 1] <= room).all():
            last += 1
        # The last part ends at the last waypoint, also if that repeats the one before.
        covers.append((stops[k], stops[last] if last + 1 < len(stops) else len(points) - 1.0))
        parts.append(part)
        k = last
    return covers, parts


def _overlap(first: Inflation, second: Inflation) -> Floats:
    """Return the centre and the radius of the largest ball in two polytopes."""
    normals, offsets = (np.concatenate(pair) for pair in zip(first[:2], second[:2], strict=True))
    high, low = second.offsets[: 2 * normals.shape[1]].reshape(2, -1)
    return np.append(*largest_ball(normals, offsets, 0.5 * (high - low)))
