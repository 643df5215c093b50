"""Subdivision of polynomial curves: convex hulls, lengths and least distances.

A piece of a polynomial is inside the convex hull of its Bézier points. The hull converges to the curve
with the square of the piece's duration. A property proven for the hulls holds for the curve.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..minimum_snap.polynomials import bernstein_matrix, derived, gauss_legendre
from ..minimum_snap.trajectory import Trajectory

__all__ = [
    "Near",
    "Pieces",
    "coefficients_between",
    "hulls_of",
    "lengths_of",
    "nearest",
    "pieces_of",
]

Floats = NDArray[np.float64]

#: Quadrature nodes of a length, and maximum number of bisections of a piece.
NODES, HALVINGS = 16, 40
#: Maximum number of pieces in a search for the least distance.
MOST = 100_000


class Pieces(NamedTuple):
    """Pieces of polynomial curves in Bézier form.

    `control`, shape (n, degree + 1, axes), are the Bézier points, m, `times`, shape (n, 2), start and end, s,
    and `owner`, shape (n,), is the index of the curve, or pair of curves.
    """

    control: Floats
    times: Floats
    owner: NDArray[np.int64]

    def take(self, rows: Any) -> Pieces:
        """Return the pieces selected by `rows`."""
        return Pieces(self.control[rows], self.times[rows], self.owner[rows])

    def halve(self) -> Pieces:
        """Return both halves of each piece: all first halves, then all second halves."""
        left, right = _halving(self.control.shape[1] - 1)
        middle = self.times.mean(axis=1)
        return Pieces(
            np.concatenate([left @ self.control, right @ self.control]),
            np.concatenate(
                [
                    np.stack([self.times[:, 0], middle], axis=1),
                    np.stack([middle, self.times[:, 1]], axis=1),
                ]
            ),
            np.concatenate([self.owner, self.owner]),
        )

    def middles(self) -> Floats:
        """Return the points at half time, m, shape (n, axes)."""
        left, _ = _halving(self.control.shape[1] - 1)
        return np.asarray(left[-1] @ self.control)

    def sizes(self) -> Floats:
        """Return the diagonals of the bounding boxes, m, shape (n,)."""
        return np.asarray(np.linalg.norm(np.ptp(self.control, axis=1), axis=1))

    def bends(self) -> Floats:
        """Return a bound on the distance of each curve from its chord, m, shape (n,)."""
        share = np.linspace(0.0, 1.0, self.control.shape[1])[:, None]
        first, last = self.control[:, :1], self.control[:, -1:]
        off = self.control - (first + share * (last - first))
        return np.asarray(np.linalg.norm(off, axis=2).max(axis=1))


@cache
def _halving(degree: int) -> tuple[Floats, Floats]:
    """Return the matrices that map Bézier points to those of the two halves."""
    left = np.array(
        [
            [math.comb(i, j) / 2.0**i if j <= i else 0.0 for j in range(degree + 1)]
            for i in range(degree + 1)
        ]
    )
    return left, left[::-1, ::-1].copy()


def hulls_of(points: Floats) -> Any:
    """Return the convex hulls of points, shape (n, k, 2), as an array of shapely's geometries."""
    import shapely

    count, each, _ = points.shape
    together = shapely.multipoints(points.reshape(-1, 2), indices=np.repeat(np.arange(count), each))
    return shapely.convex_hull(together)


def pieces_of(trajectory: Trajectory, owner: int = 0) -> Pieces:
    """Return the pieces of a trajectory, one per segment."""
    times = np.stack([trajectory.times[:-1], trajectory.times[1:]], axis=1)
    return Pieces(trajectory.bezier(), times, np.full(trajectory.segments, owner))


def lengths_of(trajectory: Trajectory, relative: float = 1e-12) -> Floats:
    """Return the length of each segment, m, by adaptive quadrature of the speed.

    Parameters
    ----------
    trajectory : Trajectory
        The curve.
    relative : float
        Change by bisection, relative to the total length, at which a piece is accepted.

    Returns
    -------
    ndarray, shape (segments,)
        Lengths, m.
    """
    nodes, weights = gauss_legendre(NODES)
    speed = derived(trajectory.coefficients, 1)

    def quadrature(row: NDArray[np.int64], begin: Floats, width: Floats) -> Floats:
        s = begin[:, None] + width[:, None] * nodes
        rate = np.einsum("nsp,npd->nsd", s[..., None] ** np.arange(speed.shape[1]), speed[row])
        return np.asarray((np.hypot(rate[..., 0], rate[..., 1]) @ weights) * width)

    total = np.zeros(trajectory.segments)
    row = np.arange(trajectory.segments)
    begin, width = np.zeros(row.size), np.ones(row.size)
    coarse = quadrature(row, begin, width)
    allowed = relative * float(coarse.sum())
    for _ in range(HALVINGS):
        width = width / 2.0
        first, second = quadrature(row, begin, width), quadrature(row, begin + width, width)
        rough = np.abs(first + second - coarse) > allowed * width
        np.add.at(total, row[~rough], (first + second)[~rough])
        row, later = row[rough], (begin + width)[rough]
        if not row.size:
            return total
        begin, width = begin[rough], width[rough]
        coarse = np.concatenate([first[rough], second[rough]])
        if row.size > MOST:  # cancellation prevents convergence
            break
        row, width = np.concatenate([row, row]), np.concatenate([width, width])
        begin = np.concatenate([begin, later])
    np.add.at(total, row if row.size == coarse.size else np.concatenate([row, row]), coarse)
    return total


def coefficients_between(trajectory: Trajectory, knots: Floats, degree: int) -> Floats:
    """Return the coefficients on the intervals between `knots`, shape (intervals, degree + 1, axes).

    No knot of the trajectory may be inside an interval, and `degree` is at least that of the trajectory.
    """
    middle, powers = 0.5 * (knots[:-1] + knots[1:]), np.arange(degree + 1)
    index = np.searchsorted(trajectory.times, middle, "right") - 1
    index = np.clip(index, 0, trajectory.segments - 1)
    long = trajectory.durations[index]
    s = (knots[:-1] - trajectory.times[index]) / long
    former = np.zeros((len(middle), degree + 1, trajectory.dimensions))
    former[:, : trajectory.degree + 1] = trajectory.coefficients[index]
    binomial = np.array([[float(math.comb(k, j)) for k in powers] for j in powers])
    shift = binomial * s[:, None, None] ** np.maximum(powers - powers[:, None], 0)
    scale = (np.diff(knots) / long)[:, None] ** powers
    return np.asarray(scale[:, :, None] * (shift @ former))


class Near(NamedTuple):
    """Closest approach of two curves: distance (m), time (s) and indices of the curves.

    The distance is infinite if no two robots are under way at the same time.
    """

    distance: float
    time: float
    pair: tuple[int, int]


def _common(
    trajectories: list[Trajectory], pairs: NDArray[np.int64]
) -> tuple[Pieces, Pieces] | None:
    """Return both curves of each pair, split into pieces with common times; None without overlap."""
    sides: list[list[Pieces]] = [[], []]
    degree = max(entry.degree for entry in trajectories)
    matrix = bernstein_matrix(degree)
    for number, pair in enumerate(pairs):
        both = [trajectories[int(k)] for k in pair]
        begin, end = (
            f(*(entry.times[side] for entry in both)) for f, side in ((max, 0), (min, -1))
        )
        knots = np.unique(np.concatenate([entry.times for entry in both]))
        knots = knots[(knots >= begin) & (knots <= end)]
        if knots.size < 2:
            continue
        times = np.stack([knots[:-1], knots[1:]], axis=1)
        for entry, pieces in zip(both, sides, strict=True):
            control = matrix @ coefficients_between(entry, knots, degree)
            pieces.append(Pieces(control, times, np.full(len(times), number)))
    if not sides[0]:
        return None
    first, second = (
        Pieces(*(np.concatenate(parts) for parts in zip(*side, strict=True))) for side in sides
    )
    return first, second


def nearest(
    trajectories: list[Trajectory], slack: float, pairs: NDArray[np.int64] | None = None
) -> Near:
    """Return the closest approach of any two robots under way at the same time.

    Branch and bound in time: the hull of the Bézier points of a difference bounds it from below. A robot is
    under way between its first and its last knot. The least distance is at least the returned one minus `slack`
    (m). `pairs`, shape (n, 2), are the curves to compare; all pairs by default.
    """
    import shapely

    if pairs is None:
        pairs = np.array([[a, b] for b in range(len(trajectories)) for a in range(b)], int)
    best = Near(math.inf, 0.0, (0, 0))
    common = _common(trajectories, pairs) if pairs.size else None
    if common is None:
        return best
    first, second = common
    origin = shapely.Point(0.0, 0.0)
    while len(first.times):
        places = [
            (first.control[:, 0], second.control[:, 0], first.times[:, 0]),
            (first.middles(), second.middles(), first.times.mean(axis=1)),
            (first.control[:, -1], second.control[:, -1], first.times[:, 1]),
        ]
        for a, b, times in places:
            distance = np.linalg.norm(a - b, axis=1)
            k = int(np.argmin(distance))
            if distance[k] < best.distance:
                robot, other = pairs[first.owner[k]].tolist()
                best = Near(float(distance[k]), float(times[k]), (robot, other))
        between = first.control - second.control
        # Bounding boxes are cheap, so they are tested first.
        box = np.maximum(np.maximum(between.min(axis=1), -between.max(axis=1)), 0.0)
        sizes = np.linalg.norm(box, axis=1)
        open_ = np.flatnonzero(sizes < best.distance - slack)
        if between.shape[2] == 2:
            lower = shapely.distance(hulls_of(between[open_]), origin)
        else:  # the extent of the hull along its middle is a bound in any dimension
            middle = between[open_].mean(axis=1)
            middle /= np.maximum(np.linalg.norm(middle, axis=1), 1e-300)[:, None]
            lower = np.einsum("nkd,nd->nk", between[open_], middle).min(axis=1)
        open_ = open_[lower < best.distance - slack]
        long = first.times[open_, 1] - first.times[open_, 0]
        # Drop pieces whose duration is below floating-point resolution.
        size = np.abs(first.times[open_]).max(axis=1)
        open_ = open_[long > 1e-14 * np.maximum(size, 1e-300)]
        if open_.size > MOST:
            k = open_[int(np.argmin(sizes[open_]))]
            robot, other = pairs[first.owner[k]].tolist()
            return Near(float(sizes[k]), float(first.times[k].mean()), (robot, other))
        first, second = first.take(open_).halve(), second.take(open_).halve()
    return best
