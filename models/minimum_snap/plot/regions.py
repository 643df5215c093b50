"""Regions that a corridor allows for segments: polygons in a plane, bodies in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from .data import Scene

__all__ = ["regions"]

Floats = NDArray[np.float64]

#: Components of normals of length 1 below this value are treated as 0.
_TILT = 1e-9


def regions(
    scene: Scene, shown: tuple[int, ...], low: Floats, high: Floats, most: int | None = None
) -> tuple[list[list[Floats]], int, bool]:
    """Return the regions of the corridor in two or three axes, clipped at a box over all axes.

    `most` is the largest number of regions, selected at equal steps; all by default.

    Returns
    -------
    list of lists of ndarray, each of shape (corners, shown axes)
        Faces of each nonempty region: one polygon in a plane, the faces of a body in space.
    int
        Number of distinct regions.
    bool
        Whether half-spaces were omitted because they depend on an axis that is not shown.
    """
    boxes, spaces = scene.bounds_of(0), scene.halfspaces
    lower = np.broadcast_to(low, (scene.segments, low.size)).copy()
    upper = np.broadcast_to(high, lower.shape).copy()
    bounded = np.zeros(scene.segments, bool)
    for box in boxes:
        lower, upper = np.maximum(lower, box.lower), np.minimum(upper, box.upper)
        bounded |= (np.isfinite(box.lower) | np.isfinite(box.upper))[:, shown].any(axis=1)
    # Rows of the half-spaces of each segment.
    members: dict[int, list[int]] = {}
    for row, segment in enumerate([] if spaces is None else spaces.segments.tolist()):
        members.setdefault(segment, []).append(row)
        bounded[segment] = True
    # Segments with equal boxes share one region.
    selection: list[int] = []
    keys: set[bytes] = set()
    for segment in np.flatnonzero(bounded).tolist():
        key = lower[segment].tobytes() + upper[segment].tobytes()
        if segment in members or key not in keys:
            selection.append(segment)
        if segment not in members:
            keys.add(key)
    total = len(selection)
    if most is not None and total > most:
        selection = [selection[k] for k in np.linspace(0, total - 1, most).round().astype(int)]
    result, omitted = [], False
    axes = list(shown)
    for segment in selection:
        normals, offsets = np.zeros((0, low.size)), np.zeros(0)
        if spaces is not None and segment in members:
            normals, offsets = spaces.normals[members[segment]], spaces.offsets[members[segment]]
        tilted = (np.abs(np.delete(normals, axes, axis=1)) > _TILT).any(axis=1)
        if tilted.any() and low.size == 3:
            faces = _body(lower[segment], upper[segment], normals, offsets)
            faces = _hull(np.concatenate(faces)[:, axes]) if faces else []
        else:
            omitted |= bool((tilted & (np.abs(normals[:, axes]) > _TILT).any(axis=1)).any())
            part = normals[~tilted][:, axes]
            ends = lower[segment, axes], upper[segment, axes]
            faces = (_body if len(axes) == 3 else _polygon)(*ends, part, offsets[~tilted])
        if faces:
            result.append(faces)
    return result, total, omitted


def _polygon(lower: Floats, upper: Floats, normals: Floats, offsets: Floats) -> list[Floats]:
    """Return the intersection of a rectangle and half-planes as one polygon, or an empty list."""
    if (lower > upper).any():
        return []
    (left, bottom), (right, top) = lower, upper
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    for normal, offset in zip(normals, offsets, strict=True):
        corners = _clip(corners, normal, offset)
    return [corners] if len(corners) else []


def _body(lower: Floats, upper: Floats, normals: Floats, offsets: Floats) -> list[Floats]:
    """Return the faces of a box cut by half-spaces, or an empty list."""
    if (lower > upper).any():
        return []
    normals = np.vstack([np.eye(3), -np.eye(3), normals])
    offsets = np.concatenate([upper, -lower, offsets])
    middle, reach = (lower + upper) / 2, 2 * float(np.linalg.norm(upper - lower)) + 1e-9
    faces = []
    for row, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        # A square in the plane of the face, larger than the box, clipped by all other planes.
        u = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        centre = middle + (offset - middle @ normal) * normal
        face = centre + reach * np.array([u + v, v - u, -u - v, u - v])
        for k in range(len(normals)):
            if k != row and len(face):
                face = _clip(face, normals[k], offsets[k])
        if len(face) >= 3:
            faces.append(face)
    return faces


def _clip(corners: Floats, normal: Floats, offset: float) -> Floats:
    """Return the part of a convex polygon in ``normal @ x <= offset`` (Sutherland, Hodgman)."""
    if not len(corners):
        return corners
    slack = offset - corners @ normal
    inside = slack >= -1e-12 * max(1.0, abs(offset))
    if inside.all():
        return corners
    clipped = []
    for k in range(len(corners)):
        if inside[k - 1] != inside[k]:
            share = slack[k - 1] / (slack[k - 1] - slack[k])
            clipped.append(corners[k - 1] + share * (corners[k] - corners[k - 1]))
        if inside[k]:
            clipped.append(corners[k])
    return np.array(clipped).reshape(-1, corners.shape[1])


def _hull(points: Floats) -> list[Floats]:
    """Return the convex hull of points in a plane, or an empty list if they are collinear."""
    ordered = np.unique(points.round(12), axis=0)
    size = np.abs(ordered).max(initial=1.0)
    if np.linalg.matrix_rank(ordered[1:] - ordered[:1], tol=1e-9 * size) < 2:
        return []
    return [ordered[ConvexHull(ordered).vertices]]
