"""Exact verification of corridors, independent of their construction.

A face separates an obstacle from a polytope if its whole extent is beyond the face, at the distance r of the
vehicle's radius: n·x - b >= r |n|. All numbers are binary fractions, so rational arithmetic is exact, and
r (1 + n·n) / 2 is a rational upper bound on r |n|. Floating-point numbers decide alone if they exceed a
bound on their rounding errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..verification import Check, Verification
from .corridors_obstacles import Cells, Edges, Obstacles, Points, fractions

if TYPE_CHECKING:
    from .corridors import Corridor

__all__ = ["verify_corridor"]

Floats = NDArray[np.float64]

#: Bound on the rounding errors of an offset, relative to the coordinates; at most 20 operations each.
_ERROR = 32 * float(np.finfo(float).eps)
#: Number of obstacles per comparison, which limits the memory.
_CHUNK = 50_000

Exact = list[Fraction]


class _Polytope:
    """Polytope with its faces as fractions."""

    def __init__(self, normals: Floats, offsets: Floats, radius: float) -> None:
        self.normals, self.offsets, self.radius = normals, offsets, radius
        self.rows = [fractions(row) for row in normals]
        # Offset beyond which a point is at least the radius away from the polytope.
        self.beyond = [
            Fraction(b) + Fraction(radius) * (1 + _dot(row, row)) / 2
            for b, row in zip(offsets.tolist(), self.rows, strict=True)
        ]

    def edge(self, axis: int, sign: int) -> Fraction | None:
        """Return the exact limit of a coordinate by the axis-parallel faces, or None without one."""
        unit = sign * np.eye(self.normals.shape[1])[axis]
        values = self.offsets[(self.normals == unit).all(axis=1)]
        return sign * Fraction(float(values.min())) if values.size else None

    def margins(self, supports: Floats, size: float) -> tuple[Floats, float]:
        """Return supports minus limits, shape (n, faces), and the bound on their errors."""
        error = _ERROR * (size + float(np.abs(self.offsets).max()) + self.radius)
        return supports - self.offsets - self.radius, error

    def excess(self, point: Exact) -> Fraction:
        """Return the largest distance of a point beyond the faces; not positive inside."""
        return max(
            _dot(row, point) - Fraction(b)
            for row, b in zip(self.rows, self.offsets.tolist(), strict=True)
        )


def _dot(first: Iterable[Fraction], second: Iterable[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(first, second, strict=True)), Fraction(0))


def verify_corridor(corridor: Corridor, obstacles: Obstacles) -> Verification:
    """Return the verification of a corridor against obstacles; see :meth:`Corridor.verify`."""
    polytopes = [_Polytope(*part, corridor.radius) for part in corridor.polytopes]
    names = [f"polytope {k}" for k in range(len(polytopes))]
    free = [_deepest(polytope, obstacles) for polytope in polytopes]
    checks = [
        _check("obstacle", zip(names, free, strict=True)),
        _check("bounds", zip(names, _outside(polytopes, corridor, obstacles), strict=True)),
        _check("path", _path(polytopes, corridor, obstacles)),
        _check("overlap", _overlaps(polytopes, corridor)),
        _check("unit normals", zip(names, (_norms(p) for p in polytopes), strict=True)),
    ]
    with np.errstate(all="ignore"):
        volume = float(corridor.volumes.sum())
    return Verification(volume, tuple(checks))


def _check(name: str, entries: Iterable[tuple[str, Any]]) -> Check:
    """Return the check of the largest violation, which must not be positive."""
    where, worst = max(entries, key=lambda entry: entry[1], default=("", 0))
    amount = float(worst)
    if worst > 0:
        amount = max(amount, 5e-324)  # an exact violation may be below the smallest float
    return Check(name, "", max(amount, 0.0), "m", 0.0, where, 0.0)


def _norms(polytope: _Polytope) -> Fraction | float:
    worst = max(abs(_dot(row, row) - 1) for row in polytope.rows)
    return worst if worst > Fraction(1, 10**9) else 0.0


def _outside(polytopes: list[_Polytope], corridor: Corridor, obstacles: Obstacles) -> Iterator[Any]:
    """Yield the largest distance of each polytope beyond the map and the bounds."""
    axes = corridor.path.shape[1]
    limits = [] if obstacles.limits is None else [obstacles.limits]
    if corridor.bounds is not None:
        ends = fractions(corridor.bounds)
        limits.append((tuple(ends[:axes]), tuple(ends[axes:])))
    for polytope in polytopes:
        edges = [(polytope.edge(axis, -1), polytope.edge(axis, 1)) for axis in range(axes)]
        if any(low is None or high is None for low, high in edges):
            yield np.inf
            continue
        yield max(
            (
                max(first[i] - low, high - last[i])
                for first, last in limits
                for i, (low, high) in enumerate(edges)
            ),
            default=0,
        )


def _deepest(polytope: _Polytope, obstacles: Obstacles) -> Any:
    """Return the largest distance by which an obstacle is not separated from a polytope, m."""
    if isinstance(obstacles, Cells):
        return _deepest_cell(polytope, obstacles)
    if isinstance(obstacles, Edges):
        return _deepest_edge(polytope, obstacles)
    assert isinstance(obstacles, Points)
    worst: Any = 0
    for rows in _chunks(len(obstacles.points)):
        points = obstacles.points[rows]
        margins, error = polytope.margins(points @ polytope.normals.T, _size(points))
        for k in np.flatnonzero(margins.max(axis=1) <= error):
            worst = max(worst, _miss(polytope, [fractions(points[k])], margins[k] > -4 * error))
    return worst


def _size(points: Floats) -> float:
    return points.shape[1] * float(np.abs(points).max(initial=0.0))


def _chunks(count: int) -> Iterator[slice]:
    return (slice(k, k + _CHUNK) for k in range(0, count, _CHUNK))


def _miss(polytope: _Polytope, corners: list[Exact], faces: NDArray[np.bool_]) -> Fraction:
    """Return the distance by which no face separates a body, at least 0; exact if it is separated."""
    chosen = np.flatnonzero(faces) if faces.any() else np.arange(len(faces))
    best = max(
        min(_dot(polytope.rows[f], corner) for corner in corners) - polytope.beyond[f]
        for f in chosen
    )
    return max(-best, Fraction(0))


def _deepest_cell(polytope: _Polytope, cells: Cells) -> Any:
    axes = cells.dimensions
    edges = [(polytope.edge(axis, -1), polytope.edge(axis, 1)) for axis in range(axes)]
    ends = np.array(
        [[-np.inf if a is None else a, np.inf if b is None else b] for a, b in edges], float
    )
    spare = polytope.radius * 1.001
    indices = cells.indices(ends[:, 0] - spare, ends[:, 1] + spare)
    spread = 0.5 * cells.cell * np.abs(polytope.normals).sum(axis=1)
    worst: Any = 0
    for rows in _chunks(len(indices)):
        centres = cells.origin + (indices[rows] + 0.5) * cells.cell
        size = _size(centres) + axes * cells.cell
        margins, error = polytope.margins(centres @ polytope.normals.T - spread, size)
        for k in np.flatnonzero(margins.max(axis=1) <= error):
            low = [
                x + int(i) * Fraction(cells.cell)
                for x, i in zip(fractions(cells.origin), indices[rows][k], strict=True)
            ]
            corners = [
                [x + (j >> i & 1) * Fraction(cells.cell) for i, x in enumerate(low)]
                for j in range(2**axes)
            ]
            worst = max(worst, _miss(polytope, corners, margins[k] > -4 * error))
    return worst


def _deepest_edge(polytope: _Polytope, edges: Edges) -> Any:
    """Return the worst edge: each point of an edge must be beyond one of the faces."""
    worst: Any = 0
    both = []
    for points in (edges.begins, edges.ends):
        margins, error = polytope.margins(points @ polytope.normals.T, _size(points))
        both.append(margins)
    least = np.minimum(*both)
    for k in np.flatnonzero(least.max(axis=1, initial=-np.inf) <= error):
        begin, end = fractions(edges.begins[k]), fractions(edges.ends[k])
        first = [
            _dot(row, begin) - beyond
            for row, beyond in zip(polytope.rows, polytope.beyond, strict=True)
        ]
        last = [
            _dot(row, end) - beyond
            for row, beyond in zip(polytope.rows, polytope.beyond, strict=True)
        ]
        at = _gap(first, last)
        if at is not None:
            worst = max(worst, -max(a + at * (b - a) for a, b in zip(first, last, strict=True)))
    return worst


def _gap(first: Exact, last: Exact) -> Fraction | None:
    """Return a share of an edge beyond no face, or None if faces separate all of it.

    Along the edge, the distance from face f changes linearly from first[f] to last[f].
    """
    spans = []
    for a, b in zip(first, last, strict=True):
        if a >= 0 or b >= 0:
            root = a / (a - b) if (a < 0) != (b < 0) else Fraction(0)
            spans.append((root if a < 0 else Fraction(0), root if b < 0 else Fraction(1)))
    done = Fraction(0)
    for low, high in sorted(spans):
        if low > done:
            return (low + done) / 2
        done = max(done, high)
    return (done + 1) / 2 if done < 1 or not spans else None


def _path(
    polytopes: list[_Polytope], corridor: Corridor, obstacles: Obstacles
) -> Iterator[tuple[str, Any]]:
    """Yield the distance of the path from the polytopes that cover it, and of its first point from polygons."""
    points = [fractions(point) for point in corridor.path]
    covers = [fractions(cover) for cover in corridor.covers]
    ends = [Fraction(0), *(end for _, end in covers)]
    joined = ends[-1] == len(points) - 1 and all(
        begin == before <= end for (begin, end), before in zip(covers, ends, strict=False)
    )
    yield "the parts of the path", 0 if joined else np.inf
    if not joined:
        return
    if isinstance(obstacles, Edges):
        inside = any(_contains(shape, points[0]) for shape in obstacles.polygons)
        yield "path[0], inside a polygon", np.inf if inside else 0
    for k, (polytope, (begin, end)) in enumerate(zip(polytopes, covers, strict=True)):
        stops = {begin, end, *map(Fraction, range(-(-begin // 1), end // 1 + 1))}
        for stop in sorted(stops):
            j = min(int(stop), max(len(points) - 2, 0))
            after = points[min(j + 1, len(points) - 1)]
            place = [a + (stop - j) * (b - a) for a, b in zip(points[j], after, strict=True)]
            yield f"polytope {k}, waypoint {float(stop):g}", polytope.excess(place)


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


def _overlaps(polytopes: list[_Polytope], corridor: Corridor) -> Iterator[tuple[str, Any]]:
    """Yield the distance by which each ball is outside of its polytopes; infinite without a radius."""
    for k, ball in enumerate(corridor.overlaps):
        *centre, radius = fractions(ball)
        for polytope in polytopes[k : k + 2]:
            rows = zip(polytope.rows, polytope.offsets.tolist(), strict=True)
            excess = max(
                _dot(n, centre) + radius * (1 + _dot(n, n)) / 2 - Fraction(b) for n, b in rows
            )
            yield f"polytopes {k} and {k + 1}", excess if radius > 0 else np.inf
