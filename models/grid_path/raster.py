"""Rasterisation of polygons to blocked cells by a quadtree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SHRINK", "rasterise"]

#: Margin by which cells shrink on every side for the comparison with polygons, as a share of their
#: side. Contact therefore does not block a cell, despite rounding.
SHRINK = 1e-9
#: Number of pairs of a box and a polygon per comparison, which limits the memory.
_CHUNK = 100_000

Integers = NDArray[np.int64]
Truths = NDArray[np.bool_]


def rasterise(
    polygons: NDArray[np.object_], shape: tuple[int, int], radius: float = 0.0
) -> NDArray[np.bool_]:
    """Return whether each cell is blocked by polygons in cells, shape (rows, columns).

    The cell in row r and column c covers x from c to c + 1, and y from r to r + 1. A cell is blocked if
    one of its points is nearer to a polygon than `radius` (cells) or, with radius 0, inside a polygon.
    Cells are smaller by :data:`SHRINK` on every side.

    The algorithm refines pairs of a square box and a polygon. A box inside the polygon is finished, a
    box outside is dropped, and any other box is split into four. The time grows with the number of cells
    along the outlines, and with the logarithm of the number of points of a polygon.
    """
    import shapely

    shapely.prepare(polygons)
    bounds = shapely.bounds(polygons) + np.array([-radius, -radius, radius, radius])
    # A polygon meets at most 2 × 2 boxes of its first level.
    extent = np.maximum(bounds[:, 2:] - bounds[:, :2], 1.0).max(axis=1, initial=1.0)
    top = max(max(shape) - 1, 0).bit_length()
    levels = np.minimum(np.ceil(np.log2(extent)), top).astype(int)
    full = np.zeros((1, 1), bool)
    boxes, owners = np.empty((0, 2), np.int64), np.empty(0, np.int64)
    for level in range(top, -1, -1):
        side = 2**level
        here = (-(-shape[0] // side), -(-shape[1] // side))
        full = full.repeat(2, axis=0).repeat(2, axis=1)[: here[0], : here[1]].copy()
        new = np.flatnonzero(levels == level)
        entering, whose = _entering(bounds[new], side, here)
        boxes = np.concatenate([boxes, entering])
        owners = np.concatenate([owners, new[whose]])
        keep = ~full[boxes[:, 0], boxes[:, 1]]
        boxes, owners = boxes[keep], owners[keep]
        met, filled = _compare(polygons, bounds, boxes, owners, side, radius)
        done = filled | (met if side == 1 else False)
        full[boxes[done, 0], boxes[done, 1]] = True
        keep = met & ~full[boxes[:, 0], boxes[:, 1]]
        if side > 1:
            inner = (boxes[keep, None] * 2 + [[0, 0], [0, 1], [1, 0], [1, 1]]).reshape(-1, 2)
            on_map = (inner * (side // 2) < shape).all(axis=1)
            boxes, owners = inner[on_map], owners[keep].repeat(4)[on_map]
    return full


def _entering(
    bounds: NDArray[np.float64], side: int, here: tuple[int, int]
) -> tuple[Integers, NDArray[np.int64]]:
    """Return the boxes (row, column) that the bounds of polygons meet, and the polygon of each."""
    last = np.array(here) - 1
    low = np.clip(np.floor(bounds[:, 1::-1] / side), 0, last + 1).astype(np.int64)
    high = np.clip(np.floor(bounds[:, :1:-1] / side), -1, last).astype(np.int64)
    boxes, whose = [np.empty((0, 2), np.int64)], [np.empty(0, np.int64)]
    counts = (high - low).max(axis=0, initial=-1) + 1
    for row in range(int(counts[0])):
        for column in range(int(counts[1])):
            box: Integers = low + np.array([row, column])
            inside = np.flatnonzero((box <= high).all(axis=1))
            boxes.append(box[inside])
            whose.append(inside)
    return np.concatenate(boxes), np.concatenate(whose)


def _compare(
    polygons: NDArray[np.object_], bounds: NDArray[np.float64], boxes: Integers, owners: Integers,
    side: int, radius: float,
) -> tuple[Truths, Truths]:  # fmt: skip
    """Return whether each box meets its polygon, and whether it is inside the polygon."""
    import shapely

    met, filled = np.zeros(len(boxes), bool), np.zeros(len(boxes), bool)
    low = boxes[:, ::-1] * float(side) + SHRINK
    high = low + side - 2 * SHRINK
    near = ((low <= bounds[owners, 2:]) & (high >= bounds[owners, :2])).all(axis=1)
    places = np.flatnonzero(near)
    diagonal = np.sqrt(2.0) * side
    for chunk in np.split(places, range(_CHUNK, len(places), _CHUNK)):
        squares = shapely.box(*low[chunk].T, *high[chunk].T)
        whole = polygons[owners[chunk]]
        if radius > 0:
            met[chunk] = shapely.dwithin(whole, squares, radius)
            if radius > diagonal:
                filled[chunk] = shapely.dwithin(whole, squares, radius - diagonal)
        else:
            met[chunk] = shapely.intersects(whole, squares)
        if side > 1:
            rest = met[chunk] & ~filled[chunk]
            filled[chunk[rest]] = shapely.covers(whole[rest], squares[rest])
    return met, filled
