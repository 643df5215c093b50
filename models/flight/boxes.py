"""Distances of curves from boxes of equal size: cells of a map, or points.

A piece of a curve is safe if a plane separates the convex hull of its Bézier points from each box
nearby. The normal of the plane points from the nearest point of the box to the middle of the piece.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Boxes"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Number of bisections of a chord in the search for its deepest point.
SEARCH = 60


class Boxes:
    """Obstacles as a union of axis-parallel cubes, or of points.

    Parameters
    ----------
    centres : ndarray, shape (n, axes)
        Centres in metres.
    half : float
        Half of the side in metres; 0 for points.
    exposed : ndarray of bool, shape (n, axes, 2), optional
        Whether the lower and the upper face of each axis border on free space; all by default.
    buried : tuple of (ndarray of bool, ndarray), optional
        Cells of a map that are blocked like all their neighbours, and the lowest corner of the map. They
        are not among the boxes.
    """

    def __init__(
        self,
        centres: Floats,
        half: float = 0.0,
        exposed: Truths | None = None,
        buried: tuple[Truths, Floats] | None = None,
    ) -> None:
        from scipy.spatial import cKDTree

        self.centres, self.half, self.buried = centres, half, buried
        everything = np.ones((*centres.shape, 2), bool)
        self.exposed = everything if exposed is None else exposed
        self.open = np.asarray(self.exposed.any(axis=(1, 2)))
        #: Largest distance between a centre and a point of its box, m.
        self.corner = half * np.sqrt(centres.shape[1])
        self.tree = cKDTree(centres) if len(centres) else None

    @classmethod
    def of_cells(cls, blocked: Truths, cell: float, origin: Floats) -> Boxes:
        """Return the blocked cells of a map that border on free ones.

        `blocked` has one dimension per axis, `cell` is the side of a cell and `origin` the lowest corner, in metres.
        """
        from scipy.ndimage import binary_erosion

        # A blocked cell at the border continues outside, where the tolerance allows positions.
        blocked, origin = np.pad(blocked, 1, mode="edge"), origin - cell
        axes = blocked.ndim
        buried = binary_erosion(blocked, np.ones((3,) * axes, bool), border_value=1)
        cells = np.argwhere(blocked & ~buried)
        framed = np.pad(~blocked, 1)
        exposed = np.zeros((len(cells), axes, 2), bool)
        for axis in range(axes):
            for side in (0, 1):
                beside = cells + 1
                beside[:, axis] += 2 * side - 1
                exposed[:, axis, side] = framed[tuple(beside.T)]
        return cls(origin + (cells + 0.5) * cell, 0.5 * cell, exposed, (buried, origin))

    def __len__(self) -> int:
        return len(self.centres)

    # -- distances -------------------------------------------------------------------------------

    def _near(self, points: Floats, reach: float | Floats) -> tuple[Ints, Ints]:
        """Return the pairs (point, box) whose distance may be at most `reach`, m."""
        assert self.tree is not None
        lists = self.tree.query_ball_point(points, reach + self.corner * (1 + 1e-9))
        counts = np.fromiter(map(len, lists), np.int64, len(points))
        boxes = np.fromiter((box for row in lists for box in row), np.int64, int(counts.sum()))
        return np.repeat(np.arange(len(points)), counts), boxes

    def _signed(self, points: Floats, boxes: Ints) -> Floats:
        """Return the distance of each point from its box, m; inside, minus that to a free face."""
        off = points - self.centres[boxes]
        beyond = np.asarray(np.abs(off) - self.half)
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        faces = np.stack([-off, off], axis=2) - self.half
        shown = self.exposed[boxes] | ~self.open[boxes][:, None, None]
        inner = np.where(shown, faces, -np.inf).max(axis=(1, 2))
        return np.asarray(np.where(beyond.max(axis=1) <= 0.0, inner, outside))

    def _buried(self, points: Floats) -> Truths:
        """Return whether each point is in a buried cell."""
        if self.buried is None:
            return np.zeros(len(points), bool)
        cells, origin = self.buried
        with np.errstate(invalid="ignore"):
            index = np.floor((points - origin) / (2.0 * self.half))
            inside = np.asarray(((index >= 0) & (index < cells.shape)).all(axis=1))
        index = np.where(inside[:, None], index, 0).astype(np.int64)
        return np.asarray(inside & cells[tuple(index.T)])

    def depths(self, points: Floats, radius: float) -> Floats:
        """Return the penetration depth of points into boxes enlarged by `radius`, m, shape (n,).

        Negative values are clearances.
        """
        result = np.full(len(points), -np.inf)
        if self.tree is None or not len(points):
            return result
        finite = np.isfinite(points).all(axis=1)
        result[~finite] = np.inf
        rows = np.flatnonzero(finite)
        places = points[rows]
        away = np.full(len(rows), np.inf)
        nearest = self.tree.query(places)[1]
        reach = np.linalg.norm(
            np.maximum(np.abs(places - self.centres[nearest]) - self.half, 0.0), axis=1
        )
        who, boxes = self._near(places, reach)
        np.minimum.at(away, who, self._signed(places[who], boxes))
        # A point in a buried cell is deeper than the nearest box at the border is far.
        away = np.where(self._buried(places), -reach - self.half, away)
        result[rows] = radius - away
        return result

    def chord_depths(self, ends: Floats, radius: float) -> tuple[Floats, Floats]:
        """Return the depths of chords between `ends`, shape (n, 2, axes), and their places, m.

        The signed distance from a convex box is convex along a chord, so that a ternary search finds
        its minimum.
        """
        middles = ends.mean(axis=1)
        depths, places = self.depths(middles, radius), middles.copy()
        half = 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        who, boxes = self._near(middles, np.maximum(radius - depths, 0.0) + 2.0 * half)
        low, high = np.zeros(len(who)), np.ones(len(who))
        start, step = ends[who, 0], ends[who, 1] - ends[who, 0]

        def at(share: Floats) -> Floats:
            return self._signed(start + share[:, None] * step, boxes)

        for _ in range(SEARCH):
            third = (high - low) / 3.0
            left = at(low + third) <= at(high - third)
            low, high = np.where(left, low, low + third), np.where(left, high - third, high)
        share = 0.5 * (low + high)
        reached = radius - at(share)
        order = np.argsort(reached)  # the deepest is written last
        better = order[reached[order] > depths[who[order]]]
        depths[who[better]] = reached[better]
        places[who[better]] = (start + share[:, None] * step)[better]
        return depths, places

    def forbidden(self, radius: float, slack: float) -> _Near:
        """Return the region closer to boxes than radius - slack; smaller boxes if that is negative."""
        return _Near(self, radius - slack)


class _Near:
    """Region closer to boxes than `reach`, m; boxes smaller by -reach at free faces if it is negative."""

    def __init__(self, boxes: Boxes, reach: float) -> None:
        self.boxes, self.reach = boxes, max(reach, 0.0)
        shrink = np.where(boxes.exposed, max(-reach, 0.0), 0.0)
        self.low = boxes.centres - boxes.half + shrink[..., 0]
        self.high = boxes.centres + boxes.half - shrink[..., 1]

    def meets(self, control: Floats) -> NDArray[np.int64]:
        """Return the indices of the pieces whose hulls no plane separates from the region."""
        boxes = self.boxes
        assert boxes.tree is not None
        middle = 0.5 * (control.min(axis=1) + control.max(axis=1))
        size = np.linalg.norm(control - middle[:, None], axis=2).max(axis=1)
        far = boxes.tree.query(middle)[0] - boxes.corner > self.reach + size
        buried = boxes._buried(middle)
        # Long pieces are bisected first, because they would form many pairs.
        long = ~far & (size > max(2.0 * boxes.half, self.reach))
        met = buried | long
        rows = np.flatnonzero(~far & ~met)
        who, hits = boxes._near(middle[rows], self.reach + size[rows])
        apart = self._separated(control[rows[who]], middle[rows[who]], hits)
        met[rows[who[~apart]]] = True
        return np.flatnonzero(met)

    def _separated(self, control: Floats, middle: Floats, hits: Any) -> Truths:
        """Return whether a plane keeps each hull at least `reach` away from its box."""
        low, high = self.low[hits], self.high[hits]
        normal = middle - np.clip(middle, low, high)
        size = np.linalg.norm(normal, axis=1)
        normal /= np.maximum(size, 1e-300)[:, None]
        nearest = np.einsum("nka,na->nk", control, normal).min(axis=1)
        support = np.where(normal > 0, high, low)
        return np.asarray((size > 0) & (nearest - (support * normal).sum(axis=1) >= self.reach))
