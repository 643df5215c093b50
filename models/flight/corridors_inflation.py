"""Inflation of one polytope of a corridor around a segment of a path.

Source: Wang, Wang, Zhou, Gao, Xu: "Fast iterative region inflation for computing large 2-D/3-D convex regions
of obstacle-free space" (2024). Each pass cuts the space by one plane per nearest obstacle, so that the plane
is as far as possible from the centre of an ellipsoid, in its metric, and keeps the segment inside (restrictive
inflation). The next ellipsoid is the largest one inside the resulting polytope.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .corridors_kernels import CUTS, approach, cover, least_norm
from .corridors_obstacles import Bodies

__all__ = ["Contact", "Inflation", "inflate", "largest_ball"]

Floats = NDArray[np.float64]

#: Growth of the ellipsoid's volume below which the passes end, as in the paper, and their maximum number.
_GROWTH, _PASSES = 1.02, 12
#: Margin of the planes from the segment, relative to its clearance, and its largest value, relative to the
#: window. Consecutive polytopes both contain a ball of this radius around their common point.
_MARGIN, _MOST_MARGIN = 0.3, 0.05
#: Distance from an obstacle, beyond the radius and relative to the window, that is treated as contact.
CONTACT = 1e-9
#: Maximum number of sweeps of the projections.
_SWEEPS = 60


class Contact(NamedTuple):
    """Obstacle that a segment touches or crosses: its index and the distance from it, m."""

    body: int
    distance: float


class Inflation(NamedTuple):
    """Polytope {x : normals @ x <= offsets} around a segment, and the margin from its planes, m."""

    normals: Floats
    offsets: Floats
    margin: float


class _Window(NamedTuple):
    """Bodies and the segment in coordinates of the window: centre 0 in the segment, longest side 1."""

    centres: Floats
    arms: Floats
    radius: float
    seeds: Floats

    def support(self, normals: Floats) -> Floats:
        """Return the lowest offsets at which planes touch the enlarged bodies, shape (n, planes)."""
        spread = np.abs(self.arms @ normals.T).sum(axis=1)
        offsets: Floats = self.centres @ normals.T - spread - self.radius
        return offsets


def inflate(
    bodies: Bodies, radius: float, seeds: Floats, low: Floats, high: Floats, passes: int = _PASSES
) -> Inflation | Contact:
    """Return a polytope that contains a segment and no body, or the body that the segment touches.

    `seeds`, shape (k, d), are the ends of the segment, and `low` and `high` the box of the polytope, which
    contains it; all in m. There are at most `passes` passes.
    """
    scale, middle = float((high - low).max()), seeds.mean(axis=0)
    guard = rounding(np.abs([low, high]).max() + radius)
    window = _Window(
        (bodies.centres - middle) / scale, bodies.arms / scale, (radius + guard) / scale,
        (seeds - middle) / scale,
    )  # fmt: skip
    box = np.concatenate([np.eye(len(low)), -np.eye(len(low))])
    edges = np.concatenate([high - middle, middle - low]) / scale
    kept = np.flatnonzero((window.support(box) < edges).all(axis=1))
    window = window._replace(centres=window.centres[kept], arms=window.arms[kept])
    away, clear = _directions(window)
    if not clear.min(initial=np.inf) > CONTACT:
        worst = int(clear.argmin())
        distance = float(clear[worst] + window.radius) * scale
        return Contact(int(kept[worst]), distance if distance > guard else 0.0)
    margin = min(_MARGIN * float(clear.min(initial=np.inf)), _MOST_MARGIN)
    result = np.empty((0, len(low))), np.empty(0)
    centre, metric, best = np.zeros(len(low)), np.eye(len(low)), 0.0
    for _ in range(passes):
        normals, owners = _cover(window, away, margin, centre, metric)
        offsets = window.support(normals)[owners, np.arange(len(owners))]
        if passes == 1:
            result = normals, offsets
            break
        ellipsoid = _largest_ellipsoid(np.r_[normals, box], np.r_[offsets, edges])
        volume = float(np.diag(ellipsoid[1]).prod()) if ellipsoid else 0.0
        if volume > best or not best:
            result = normals, offsets
        if ellipsoid is None or not volume > _GROWTH * best:
            break
        best, (centre, metric) = volume, ellipsoid
    normals, offsets = _needed(window, *result)
    return Inflation(
        np.concatenate([box, normals]),
        np.concatenate([high, -low, offsets * scale + normals @ middle]),
        margin * scale,
    )


def rounding(size: float) -> float:
    """Return a bound on the rounding errors of planes through points with coordinates up to `size`, m."""
    return 512 * float(np.finfo(float).eps) * float(size)


def _directions(window: _Window) -> tuple[Floats, Floats]:
    """Return unit normals that separate the segment from each body, and the distances along them.

    The nearest points of a body and the segment are computed by coordinate descent. If the distance is not
    accurate, least-norm planes refine it.
    """
    half = 0.5 * (window.seeds[-1] - window.seeds[0])
    count, _, axes = window.arms.shape
    arms = np.concatenate([window.arms, np.broadcast_to(half, (count, 1, axes))], axis=1)
    points = nearest(window.centres, arms)
    length = np.linalg.norm(points, axis=1)
    normals = points / np.maximum(length, 1e-300)[:, None]
    along = np.abs(arms @ normals[..., None]).sum(axis=(1, 2))
    clear = np.einsum("nd,nd->n", window.centres, normals) - along - window.radius
    upper = length - window.radius
    for body in np.flatnonzero((clear < 0.9 * upper) & (clear <= upper.min(initial=np.inf))):
        normal = _separation(window.centres[body], arms[body], points[body])
        if normal is not None:
            value = window.centres[body] @ normal - np.abs(arms[body] @ normal).sum()
            if value - window.radius > clear[body]:
                normals[body], clear[body] = normal, value - window.radius
    return normals, clear


def nearest(centres: Floats, arms: Floats, sweeps: int = _SWEEPS) -> Floats:
    """Return the points of bodies nearest to the origin, shape (n, d)."""
    points = np.zeros(centres.shape)
    approach(np.ascontiguousarray(centres), np.ascontiguousarray(arms), sweeps, points)
    return points


def _separation(centre: Floats, arms: Floats, start: Floats) -> Floats | None:
    """Return the unit normal of the widest slab between the origin and a body, or None if they meet."""
    rows, normal = np.array([start]), np.zeros(len(start))
    for _ in range(CUTS):
        if not least_norm(rows, np.ones(len(rows)), len(rows), normal):
            return None
        vertex = centre - np.sign(arms @ normal) @ arms
        if vertex @ normal > 1 - 1e-9:
            break
        rows = np.concatenate([rows, vertex[None]])
    return np.asarray(normal / np.linalg.norm(normal))


def _cover(
    window: _Window, away: Floats, margin: float, centre: Floats, metric: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Return unit normals of planes that separate all bodies, and the body that each plane touches.

    The bodies are processed in the order of their distance from the ellipsoid's centre.
    """
    inverse: Floats = np.linalg.inv(metric).astype(float)
    points = nearest((window.centres - centre) @ inverse.T, window.arms @ inverse.T, 4)
    order = np.argsort(np.linalg.norm(points, axis=1), kind="stable")
    normals, owners = np.zeros(points.shape), np.zeros(len(points), np.int64)
    count = cover(
        window.centres, window.arms, window.radius, window.seeds, away, margin, centre, inverse,
        points, order, normals, owners,
    )  # fmt: skip
    return normals[:count], owners[:count]


def _needed(window: _Window, normals: Floats, offsets: Floats) -> tuple[Floats, Floats]:
    """Move planes outward, the farthest first, to the nearest body that no other plane separates.

    Planes without such a body are dropped.
    """
    extents = window.support(normals)
    separated, moved = extents >= offsets, offsets.copy()
    for k in np.argsort(-offsets):
        alone = separated[:, k] & (separated.sum(axis=1) == 1)
        moved[k] = extents[alone, k].min(initial=np.inf)
        separated[:, k] = extents[:, k] >= moved[k]
    keep = np.isfinite(moved)
    return normals[keep], moved[keep]


def _largest_ellipsoid(normals: Floats, offsets: Floats) -> tuple[Floats, Floats] | None:
    """Return the centre p and the lower factor L of the largest {p + L u : |u| <= 1} in a polytope.

    The conic program maximises Σ log L_ii subject to |Lᵀ n| + n·p <= b for each plane.
    """
    import clarabel  # type: ignore[import-untyped]
    from scipy.sparse import csc_matrix

    count, axes = normals.shape
    row, column = np.tril_indices(axes)
    size = axes + len(row) + axes
    table = np.zeros((count, axes + 1, size))
    table[:, 0, :axes] = normals
    for k, (i, j) in enumerate(zip(row.tolist(), column.tolist(), strict=True), axes):
        table[:, 1 + j, k] = -normals[:, i]
    right = np.zeros((count, axes + 1))
    right[:, 0] = offsets
    logs = np.zeros((axes, 3, size))
    for i, k in enumerate(np.flatnonzero(row == column).tolist()):
        logs[i, 0, size - axes + i] = logs[i, 2, axes + k] = -1.0
    ones = np.tile([0.0, 1.0, 0.0], axes)
    matrix = csc_matrix(np.concatenate([table.reshape(-1, size), logs.reshape(-1, size)]))
    cost = np.zeros(size)
    cost[-axes:] = -1.0
    cones: list[Any] = [clarabel.SecondOrderConeT(axes + 1)] * count
    cones += [clarabel.ExponentialConeT()] * axes
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-6
    solver = clarabel.DefaultSolver(
        csc_matrix((size, size)), cost, matrix, np.r_[right.ravel(), ones], cones, settings
    )
    solution = solver.solve()
    if "Solved" not in str(solution.status):
        return None
    values = np.array(solution.x)
    factor = np.zeros((axes, axes))
    factor[row, column] = values[axes : size - axes]
    return values[:axes], factor


def largest_ball(normals: Floats, offsets: Floats, middle: Floats) -> tuple[Floats, float]:
    """Return the centre and the radius of the largest ball in a polytope near a point, m.

    The radius is reduced by the rounding errors. It is not positive if the polytope has no interior.
    """
    from scipy.optimize import linprog

    local = offsets - normals @ middle
    scale = max(float(np.abs(local).max()), 1e-300)
    table = np.column_stack([normals, np.ones(len(normals))])
    cost = np.zeros(table.shape[1])
    cost[-1] = -1.0
    free = [(None, None)] * table.shape[1]
    answer = linprog(cost, A_ub=table, b_ub=local / scale, bounds=free)
    if answer.x is None:
        return middle, 0.0
    centre = middle + scale * answer.x[:-1]
    radius = float((offsets - normals @ centre).min())
    return centre, radius - rounding(np.abs(centre).max() + abs(radius))
