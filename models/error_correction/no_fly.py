"""Legs that cross no-fly polygons, decided exactly.

A polygon is a column of any height. A leg crosses it if a point of the leg, seen from above, is in the open
interior. A leg may therefore touch a corner, follow an edge, and end on the boundary. Each polygon is considered
separately: a leg may follow the common edge of two polygons.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ..grid_path.polygons import Polygon

__all__ = ["crosses", "free_legs"]

#: Maximum number of points whose pairs are listed.
MOST_POINTS = 4000
#: Rounding error of an orientation relative to the sum of its two products (J. R. Shewchuk 1997), and its
#: absolute error if products underflow.
_RELATIVE, _ABSOLUTE = 1e-15, 1e-300

Floats = NDArray[np.float64]
Place = tuple[Fraction, Fraction]


def _edges(polygon: Polygon) -> tuple[Floats, Floats]:
    """Return first and last points of the edges of all rings, shape (edges, 2)."""
    rings = (polygon.shell, *polygon.holes)
    return np.concatenate(rings), np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])


def crosses(first: Iterable[float], last: Iterable[float], polygon: Polygon) -> bool:
    """Return whether a leg meets the open interior of a polygon, by rational arithmetic.

    The leg is given by the first two coordinates of its ends, m. It is divided at its common points with the
    boundary. Each part is inside, outside or on the boundary, as its midpoint is.
    """
    px, py, *_ = map(Fraction, map(float, first))
    qx, qy, *_ = map(Fraction, map(float, last))
    dx, dy = qx - px, qy - py
    edges = [
        ((Fraction(ax), Fraction(ay)), (Fraction(bx), Fraction(by)))
        for (ax, ay), (bx, by) in zip(*map(np.ndarray.tolist, _edges(polygon)), strict=True)
    ]
    cuts = {Fraction(0), Fraction(1)}
    for (ax, ay), (bx, by) in edges:
        ex, ey = bx - ax, by - ay
        turn = dx * ey - dy * ex
        if turn:
            along = ((ax - px) * ey - (ay - py) * ex) / turn
            across = ((ax - px) * dy - (ay - py) * dx) / turn
            cuts |= {along} if 0 <= along <= 1 and 0 <= across <= 1 else set()
        elif (dx or dy) and (ax - px) * dy == (ay - py) * dx:
            shares = [
                ((x - px) * dx + (y - py) * dy) / (dx**2 + dy**2) for x, y in ((ax, ay), (bx, by))
            ]
            cuts |= {share for share in shares if 0 < share < 1}
    middles = ((low + high) / 2 for low, high in pairwise(sorted(cuts)))
    return any(_inside((px + dx * share, py + dy * share), edges) for share in middles)


def _inside(place: Place, edges: list[tuple[Place, Place]]) -> bool:
    """Return whether a point is in the open interior, by the number of edges to its right."""
    x, y = place
    inside = False
    for (ax, ay), (bx, by) in edges:
        turn = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        if turn == 0 and min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
            return False
        if (ay > y) != (by > y) and (turn > 0) == (by > ay):
            inside = not inside
    return inside


def free_legs(points: Floats, polygons: tuple[Polygon, ...]) -> NDArray[np.bool_]:
    """Return which legs between pairs of different points cross no polygon, shape (n, n).

    Floating-point numbers decide the pairs whose orientations are certain, and :func:`crosses` the others. Raise
    ``UnsupportedFormulation`` for more than 4,000 points.
    """
    count = len(points)
    if count > MOST_POINTS:
        raise UnsupportedFormulation(
            f"no_fly is supported for at most {MOST_POINTS:,} points, as all pairs are tested, got {count:,}"
        )
    free = ~np.eye(count, dtype=bool)
    flat = points[:, :2]
    for polygon in polygons:
        low, high = polygon.shell.min(axis=0), polygon.shell.max(axis=0)
        for i in range(count - 1):
            others = flat[i + 1 :]
            near = (np.minimum(others, flat[i]) < high) & (np.maximum(others, flat[i]) > low)
            heads = i + 1 + np.flatnonzero(near.all(axis=1) & free[i, i + 1 :])
            if heads.size:
                blocked = heads[_crossing(flat[i], flat[heads], polygon)]
                free[i, blocked] = free[blocked, i] = False
    return free


def _crossing(tail: Floats, heads: Floats, polygon: Polygon) -> NDArray[np.bool_]:
    """Return which legs from `tail` to `heads`, shape (k, 2), cross `polygon`."""
    if crosses(tail, tail, polygon):
        return np.ones(len(heads), bool)
    first, last = _edges(polygon)
    ends = heads[:, None]
    before, after = _sides(tail, ends, first), _sides(tail, ends, last)
    start, end = _sides(first, last, tail), _sides(first, last, ends)
    result = np.asarray(((before * after < 0) & (start * end < 0)).any(axis=1))
    apart = ((before * after > 0) | (start * end > 0)).all(axis=1)
    for k in np.flatnonzero(~result & ~apart):
        result[k] = crosses(tail, heads[k], polygon)
    return result


def _sides(a: Any, b: Any, c: Any) -> NDArray[np.int8]:
    """Return the signs of the orientations of a, b, c; 0 if rounding may change the sign."""
    with np.errstate(all="ignore"):
        left = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
        right = (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        size = _RELATIVE * (np.abs(left) + np.abs(right)) + _ABSOLUTE
        sign: NDArray[np.int8] = np.where(
            np.abs(left - right) > size, np.sign(left - right), 0
        ).astype(np.int8)
    return sign
