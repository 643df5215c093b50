"""Penetration depth of curves into obstacles enlarged by a robot's radius."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .curves import Pieces, hulls_of

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Obstacles", "Region", "Solids", "deepest"]

Floats = NDArray[np.float64]

#: Maximum number of pieces after a violation is proven: further pieces only refine its depth.
MOST = 20_000
#: Maximum number of bisections.
HALVINGS = 200


class Region(Protocol):
    """Forbidden region of a robot's centre."""

    def meets(self, control: Floats) -> NDArray[np.int64]:
        """Return the indices of pieces whose hulls may intersect it, control (n, degree + 1, axes)."""


class Obstacles(Protocol):
    """Obstacles of any shape and dimension, as :func:`deepest` uses them."""

    def __len__(self) -> int: ...

    def depths(self, points: Floats, radius: float) -> Floats:
        """Return the penetration depth of points into obstacles enlarged by `radius`, m, shape (n,)."""

    def chord_depths(self, ends: Floats, radius: float) -> tuple[Floats, Floats]:
        """Return the depths of chords between `ends`, shape (n, 2, axes), and their places, m."""

    def forbidden(self, radius: float, slack: float) -> Region:
        """Return the forbidden region of points, reduced by `slack`."""


class Solids:
    """Obstacles as a union of disjoint polygons; the given ones may touch, overlap and nest."""

    def __init__(self, polygons: Any) -> None:
        import shapely

        self.parts = shapely.get_parts(shapely.union_all(polygons))
        self.tree = shapely.STRtree(self.parts)
        self.edges = shapely.boundary(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    def depths(self, points: Floats, radius: float) -> Floats:
        """Return the penetration depth of points into obstacles enlarged by `radius`, m, shape (n,).

        Inside an obstacle, the distance to its edge is added. Negative values are clearances.
        """
        import shapely

        if not len(self.parts):
            return np.full(len(points), -np.inf)
        places = shapely.points(points)
        (rows, hits), distances = self.tree.query_nearest(
            places, return_distance=True, all_matches=False
        )
        depths = np.full(len(points), np.inf)  # points with NaN are violations
        depths[rows] = radius - distances
        inside = np.flatnonzero(distances == 0.0)
        depths[rows[inside]] += shapely.distance(places[rows[inside]], self.edges[hits[inside]])
        return depths

    def forbidden(self, radius: float, slack: float) -> _Forbidden:
        """Return the forbidden region of points, reduced by `slack`."""
        return _Forbidden(self, radius, slack)

    def chord_depths(self, ends: Floats, radius: float) -> tuple[Floats, Floats]:
        """Return the penetration depths of chords, shape (n, 2, 2), and their places, m."""
        import shapely

        chords = shapely.linestrings(ends)
        nearest = self.tree.query_nearest(chords, return_distance=True, all_matches=False)
        (rows, hits), distance = nearest
        depths = np.full(len(chords), -np.inf)
        depths[rows] = radius - distance
        places = shapely.get_coordinates(
            shapely.line_interpolate_point(chords, 0.5, normalized=True)
        )
        crossing = np.flatnonzero(distance == 0.0)
        if crossing.size:
            within = shapely.intersection(chords[rows[crossing]], self.parts[hits[crossing]])
            middle = shapely.centroid(within)
            depths[rows[crossing]] += shapely.distance(middle, self.edges[hits[crossing]])
            places[rows[crossing]] = shapely.get_coordinates(middle)
        return depths, places


class _Forbidden:
    """Region closer to obstacles than radius - slack; shrunk obstacles if that is negative."""

    def __init__(self, solids: Solids, radius: float, slack: float) -> None:
        import shapely

        self.reach = radius - slack
        self.parts, self.tree = solids.parts, solids.tree
        if self.reach <= 0.0:
            shrunk = shapely.get_parts(shapely.buffer(solids.parts, self.reach))
            self.parts = shrunk[~shapely.is_empty(shrunk)]
            self.tree = shapely.STRtree(self.parts)

    def meets(self, control: Floats) -> NDArray[np.int64]:
        """Return the indices of the pieces whose convex hulls intersect the region."""
        geometries = hulls_of(control)
        if self.reach > 0.0:
            rows = self.tree.query(geometries, predicate="dwithin", distance=self.reach)[0]
        else:
            rows = self.tree.query(geometries, predicate="intersects")[0]
        return np.unique(rows)


def deepest(
    curves: Sequence[Pieces], solids: Obstacles, radius: float, slack: float, cell: float
) -> tuple[float, int, float, tuple[float, ...]]:
    """Return the largest penetration of curves into obstacles enlarged by `radius` (m), and its place.

    A piece is safe if its convex hull is. Other pieces are bisected until the chord approximates the curve. A
    penetration up to `slack` (m) may remain undetected, and the depth is accurate to a hundredth of `cell` (m).
    The result is the depth (m; 0 if all curves are safe), the curve, the time (s) and the position (m).
    """
    pieces = Pieces(*(np.concatenate(parts) for parts in zip(*curves, strict=True)))
    best: tuple[float, int, float, tuple[float, ...]]
    best = (0.0, int(pieces.owner[0]), float(pieces.times[0, 0]), (0.0,) * pieces.control.shape[2])
    beyond = ~np.isfinite(pieces.control).all(axis=(1, 2))
    if beyond.any():
        k = int(np.argmax(beyond))
        return np.inf, int(pieces.owner[k]), float(pieces.times[k, 0]), (np.nan,) * len(best[3])
    if not len(solids):
        return best
    forbidden = solids.forbidden(radius, slack)
    fine = 0.01 * cell

    def note(depths: Floats, owners: Any, times: Floats, places: Floats) -> None:
        nonlocal best
        k = int(np.argmax(depths))
        if depths[k] > best[0]:
            place = tuple(places[k].tolist())
            best = (float(depths[k]), int(owners[k]), float(times[k]), place)

    for _ in range(HALVINGS):
        pieces = pieces.take(forbidden.meets(pieces.control))
        if not len(pieces.times):
            break
        middles, sizes = pieces.middles(), pieces.sizes()
        depths = solids.depths(middles, radius)
        note(depths, pieces.owner, pieces.times.mean(axis=1), middles)
        small = (sizes <= fine) & (pieces.bends() <= 0.01 * slack)
        if small.any():
            last = pieces.take(small)
            reach, near = solids.chord_depths(last.control[:, [0, -1]], radius)
            note(reach, last.owner, last.times.mean(axis=1), near)
        # After a violation is proven, only its depth is refined.
        wide = sizes > fine
        open_ = ~small & (wide | (depths <= slack))
        if best[0] > slack:
            open_ &= wide & (depths + sizes > best[0] + fine)
        pieces = pieces.take(open_)
        if best[0] > slack and len(pieces.times) > MOST:
            break
        pieces = pieces.halve()
    return best
