"""Exact verification of corridors, independent of their construction apart from the reader of obstacles.

A face separates an obstacle from a polytope if all of the obstacle is beyond the face, at the distance r of
the vehicle's radius: n·x - b >= r |n|. All numbers are binary fractions, so rational arithmetic is exact, and
r (1 + n·n) / 2 is a rational upper bound on r |n|. Floating-point numbers decide alone if they exceed a
bound on their rounding errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..verification import Check, Verification
from .corridors_obstacles import Cells, ConvexObstacles, Edges, Points, fractions

__all__ = ["verify_corridor"]

Floats = NDArray[np.float64]
Exact = list[Fraction]

#: Bound on the rounding errors of a distance, relative to the coordinates; at most 20 operations each.
_ERROR = 32 * float(np.finfo(float).eps)
#: Number of obstacles per comparison, which limits the memory.
_CHUNK = 50_000


class _Polytope:
    """Polytope with its faces as fractions."""

    def __init__(self, normals: Floats, offsets: Floats, radius: float) -> None:
        self.normals, self.offsets, self.radius = normals, offsets, radius
        self.rows = [fractions(row) for row in normals]
        self.limits = fractions(offsets)
        # Upper bounds on the lengths of the normals.
        self.lengths = [(1 + _dot(row, row)) / 2 for row in self.rows]
        #: Lowest and greatest coordinate per axis by the axis-parallel faces; infinite without one.
        self.box = [(-self._limit(-axis), self._limit(axis)) for axis in np.eye(normals.shape[1])]

    def _limit(self, normal: Floats) -> Any:
        offsets = self.offsets[(self.normals == normal).all(axis=1)]
        return Fraction(float(offsets.min())) if offsets.size else np.inf

    def beyond(
        self, point: Sequence[Fraction], radius: Fraction, sides: Fraction = Fraction(0)
    ) -> Exact:
        """Return how far a cube is beyond each face at a distance; a point is its lowest corner."""
        return [
            _dot(row, point)
            + sides * sum((n for n in row if n < 0), Fraction(0))
            - offset
            - radius * length
            for row, offset, length in zip(self.rows, self.limits, self.lengths, strict=True)
        ]

    def beyond_float(self, centres: Floats, side: float = 0.0) -> tuple[Floats, float]:
        """Return the same of cubes in floating-point numbers, shape (n, faces), and a bound on the errors."""
        spread = 0.5 * side * np.abs(self.normals).sum(axis=1)
        size = centres.shape[1] * (np.abs(centres).max(initial=0.0) + side)
        error = _ERROR * float(size + np.abs(self.offsets).max() + self.radius)
        return centres @ self.normals.T - spread - self.offsets - self.radius, error


def _dot(first: Sequence[Fraction], second: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(first, second, strict=True)), Fraction(0))


def verify_corridor(corridor: Any, obstacles: ConvexObstacles) -> Verification:
    """Return the verification of a ``Corridor`` against obstacles; see its method ``verify``."""
    radius = corridor.radius
    polytopes = [_Polytope(normals, offsets, radius) for normals, offsets in corridor.polytopes]

    def each(function: Callable[..., Any], *others: Any) -> Check:
        places = ((f"polytope {k}", function(p, *others)) for k, p in enumerate(polytopes))
        return _check(function.__name__.strip("_").replace("_", " "), places)

    checks = (
        each(_obstacle, obstacles),
        each(_bounds, corridor, obstacles),
        _check("path", _path(polytopes, corridor, obstacles)),
        _check("overlap", _overlaps(polytopes, corridor)),
        each(_unit_normals),
    )
    return Verification(float(corridor.volumes.sum()), checks)


def _check(name: str, entries: Iterable[tuple[str, Any]]) -> Check:
    """Return the check of the largest violation, which must not be positive."""
    where, worst = max(entries, key=lambda entry: entry[1], default=("", 0))
    # An exact violation may be below the smallest float.
    amount = max(float(worst), 5e-324) if worst > 0 else 0.0
    return Check(name, "", amount, "m", 0.0, where, 0.0)


def _unit_normals(polytope: _Polytope) -> Any:
    """Return the largest difference of a squared length from 1 if it exceeds rounding."""
    worst = max(2 * abs(length - 1) for length in polytope.lengths)
    return worst if worst > Fraction(1, 10**9) else 0


def _bounds(polytope: _Polytope, corridor: Any, obstacles: ConvexObstacles) -> Any:
    """Return the largest distance of a polytope beyond the map and the bounds; infinite without a box."""
    worst: Any = 0 if np.isfinite(np.array(polytope.box, float)).all() else np.inf
    limits = [] if obstacles.limits is None else [obstacles.limits]
    if corridor.bounds is not None:
        ends = fractions(corridor.bounds)
        limits.append((tuple(ends[: len(ends) // 2]), tuple(ends[len(ends) // 2 :])))
    for lows, highs in limits:
        for (low, high), first, last in zip(polytope.box, lows, highs, strict=True):
            worst = max(worst, first - low, high - last)
    return worst


def _obstacle(polytope: _Polytope, obstacles: ConvexObstacles) -> Any:
    """Return the largest depth of an obstacle below all faces, m; not positive if faces separate all."""
    if isinstance(obstacles, Edges):
        return _edges(polytope, obstacles)
    if isinstance(obstacles, Points):
        return _cubes(polytope, obstacles.points, fractions)
    assert isinstance(obstacles, Cells)
    origin, side = fractions(obstacles.origin), Fraction(obstacles.cell)
    # The faces of the box separate the cells outside of this window.
    first, last = [0] * len(origin), list(obstacles.blocked.shape)
    for axis, (low, high) in enumerate(polytope.box):
        least, most = (
            (end + sign * Fraction(polytope.radius) - origin[axis]) / side
            if abs(end) < np.inf
            else end
            for end, sign in ((low, -1), (high, 1))
        )
        first[axis] = math.floor(min(max(least, first[axis]), last[axis]))
        last[axis] = math.ceil(max(min(most, last[axis]), first[axis]))
    window = tuple(slice(*ends) for ends in zip(first, last, strict=True))
    indices = np.argwhere(obstacles.blocked[window]) + first
    centres = obstacles.origin + (indices + 0.5) * obstacles.cell

    def corner(centre: Floats) -> Exact:
        steps = np.floor((centre - obstacles.origin) / obstacles.cell).astype(int)
        return [low + step * side for low, step in zip(origin, steps.tolist(), strict=True)]

    return _cubes(polytope, centres, corner, obstacles.cell)


def _cubes(
    polytope: _Polytope, centres: Floats, corner: Callable[[Floats], Exact], side: float = 0.0
) -> Any:
    """Return the largest depth of a cube, or of a point, below all faces, m."""
    worst: Any = 0
    for k in range(0, len(centres), _CHUNK):
        margins, error = polytope.beyond_float(centres[k : k + _CHUNK], side)
        best = margins.max(axis=1)
        if best.min() < -error:
            worst = max(worst, float(-best.min()))
        for row in np.flatnonzero(np.abs(best) <= error):
            exact = polytope.beyond(
                corner(centres[k + row]), Fraction(polytope.radius), Fraction(side)
            )
            worst = max(worst, -max(exact))
    return worst


def _edges(polytope: _Polytope, edges: Edges) -> Any:
    """Return the worst edge of polygons: each of its points must be beyond one of the faces."""
    worst: Any = 0
    (first, error), (last, other) = map(polytope.beyond_float, (edges.begins, edges.ends))
    best = np.minimum(first, last).max(axis=1, initial=-np.inf)
    for row in np.flatnonzero(best <= max(error, other)):
        ends = [fractions(points[row]) for points in (edges.begins, edges.ends)]
        begin, end = (polytope.beyond(point, Fraction(polytope.radius)) for point in ends)
        at = _gap(begin, end)
        if at is not None:
            worst = max(worst, -max(a + at * (b - a) for a, b in zip(begin, end, strict=True)))
    return worst


def _gap(begin: Exact, end: Exact) -> Fraction | None:
    """Return a share of an edge beyond no face, or None without one.

    Along the edge, the distance from face f changes linearly from begin[f] to end[f].
    """
    spans = []
    for a, b in zip(begin, end, strict=True):
        root = a / (a - b) if (a < 0) != (b < 0) else Fraction(0)
        if a >= 0 or b >= 0:
            spans.append((root if a < 0 else Fraction(0), root if b < 0 else Fraction(1)))
    done = Fraction(0)
    for low, high in sorted(spans):
        if low > done:
            break
        done = max(done, high)
    else:
        low = Fraction(1)
    return (low + done) / 2 if done < low or not spans else None


def _path(
    polytopes: list[_Polytope], corridor: Any, obstacles: ConvexObstacles
) -> Iterator[tuple[str, Any]]:
    """Yield the distance of the path from the polytopes that cover it, and whether it starts in a polygon."""
    points = [fractions(point) for point in corridor.path]
    points.append(points[-1])
    covers = [fractions(cover) for cover in corridor.covers]
    joints = [Fraction(0), *(end for _, end in covers)]
    joined = joints[-1] == len(points) - 2 and all(
        begin == joint <= end for (begin, end), joint in zip(covers, joints, strict=False)
    )
    yield "the parts of the path", 0 if joined else np.inf
    if not joined:
        return
    if isinstance(obstacles, Edges):
        inside = any(_contains(shape, points[0]) for shape in obstacles.polygons)
        yield "path[0], inside a polygon", np.inf if inside else 0
    for k, (polytope, (begin, end)) in enumerate(zip(polytopes, covers, strict=True)):
        for stop in [begin, *map(Fraction, range(int(begin) + 1, int(end) + 1)), end]:
            pair = points[int(stop) : int(stop) + 2]
            place = [a + (stop - int(stop)) * (b - a) for a, b in zip(*pair, strict=True)]
            excess = max(polytope.beyond(place, Fraction(0)))
            yield f"polytope {k}, waypoint {float(stop):g}", excess


def _contains(shape: Any, point: Exact) -> bool:
    """Return whether a polygon contains a point that is not on its edges, by the parity of crossings."""
    x, y = point
    inside = False
    for ring in (shape.shell, *shape.holes):
        corners = [fractions(corner) for corner in ring]
        for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
            if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
                inside = not inside
    return inside


def _overlaps(polytopes: list[_Polytope], corridor: Any) -> Iterator[tuple[str, Any]]:
    """Yield the excess of each ball over the faces of its polytopes, m; infinite without a radius."""
    for k, ball in enumerate(corridor.overlaps):
        *centre, radius = fractions(ball)
        for polytope in polytopes[k : k + 2]:
            excess = max(polytope.beyond(centre, -radius))
            yield f"polytopes {k} and {k + 1}", excess if radius > 0 else np.inf
