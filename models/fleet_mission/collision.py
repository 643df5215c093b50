"""Penetration depth of curves into obstacles enlarged by a robot's radius."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .curves import Pieces, hulls_of

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Solids", "deepest"]

Floats = NDArray[np.float64]

#: Maximum number of pieces after a violation is proven: further pieces only refine its depth.
MOST = 20_000
#: Maximum number of bisections.
HALVINGS = 200


class Solids:
    """Obstacles as a union of disjoint polygons.

    Parameters
    ----------
    polygons : sequence of shapely.Polygon
        Obstacles; they may touch, overlap and nest.
    """

    def __init__(self, polygons: Any) -> None:
        import shapely

        self.parts = shapely.get_parts(shapely.union_all(polygons))
        self.tree = shapely.STRtree(self.parts)
        self.edges = shapely.boundary(self.parts)

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

    def meets(self, geometries: Any) -> NDArray[np.int64]:
        """Return the indices of the geometries that intersect the region."""
        if self.reach > 0.0:
            rows = self.tree.query(geometries, predicate="dwithin", distance=self.reach)[0]
        else:
            rows = self.tree.query(geometries, predicate="intersects")[0]
        return np.unique(rows)


def deepest(
    curves: Sequence[Pieces], solids: Solids, radius: float, slack: float, cell: float
) -> tuple[float, int, float, tuple[float, float]]:
    """Return the largest penetration of curves into obstacles enlarged by `radius`, and its place.

    A piece is safe if its convex hull is. Other pieces are bisected until the chord approximates the
    curve.

    Parameters
    ----------
    curves : sequence of Pieces
        The curves.
    solids : Solids
        The obstacles.
    radius : float
        Radius of the robots, m.
    slack : float
        Penetration that may remain undetected, m.
    cell : float
        Length scale, m: the depth is accurate to a hundredth of it.

    Returns
    -------
    depth : float
        Largest penetration, m; 0 if all curves are safe.
    owner : int
        Curve with the largest penetration.
    time : float
        Its time, s.
    place : (float, float)
        Its position x, y, m.
    """
    import shapely

    pieces = Pieces(*(np.concatenate(parts) for parts in zip(*curves, strict=True)))
    best = (0.0, int(pieces.owner[0]), float(pieces.times[0, 0]), (0.0, 0.0))
    beyond = ~np.isfinite(pieces.control).all(axis=(1, 2))
    if beyond.any():
        k = int(np.argmax(beyond))
        return np.inf, int(pieces.owner[k]), float(pieces.times[k, 0]), (np.nan, np.nan)
    if not len(solids.parts):
        return best
    forbidden = solids.forbidden(radius, slack)
    fine = 0.01 * cell

    def note(depths: Floats, owners: Any, times: Floats, places: Floats) -> None:
        nonlocal best
        k = int(np.argmax(depths))
        if depths[k] > best[0]:
            x, y = places[k].tolist()
            best = (float(depths[k]), int(owners[k]), float(times[k]), (x, y))

    for _ in range(HALVINGS):
        pieces = pieces.take(forbidden.meets(hulls_of(pieces.control)))
        if not len(pieces.times):
            break
        middles, sizes = pieces.middles(), pieces.sizes()
        depths = solids.depths(middles, radius)
        note(depths, pieces.owner, pieces.times.mean(axis=1), middles)
        small = (sizes <= fine) & (pieces.bends() <= 0.01 * slack)
        if small.any():
            last = pieces.take(small)
            chords = shapely.linestrings(last.control[:, [0, -1]])
            _meet(last, chords, solids, radius, note)
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


def _meet(pieces: Pieces, chords: Any, solids: Solids, radius: float, note: Any) -> None:
    """Record the penetration depths of the chords of nearly straight pieces."""
    import shapely

    nearest = solids.tree.query_nearest(chords, return_distance=True, all_matches=False)
    (rows, hits), distance = nearest
    depths = radius - distance
    places = shapely.get_coordinates(shapely.line_interpolate_point(chords, 0.5, normalized=True))
    crossing = np.flatnonzero(distance == 0.0)
    if crossing.size:
        within = shapely.intersection(chords[rows[crossing]], solids.parts[hits[crossing]])
        middle = shapely.centroid(within)
        depths[crossing] += shapely.distance(middle, solids.edges[hits[crossing]])
        places[rows[crossing]] = shapely.get_coordinates(middle)
    note(depths, pieces.owner[rows], pieces.times[rows].mean(axis=1), places[rows])
