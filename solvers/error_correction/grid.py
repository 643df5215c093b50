"""Uniform spatial grid over the correction points, with a radius search.

The points are sorted by kind and cell. Cells along the longest side of the bounding box are adjacent in
memory, so a ball is scanned as a few contiguous runs, one per row of cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .airspace import HORIZONTAL, VERTICAL, Airspace

__all__ = ["Grid", "build", "near", "near_beyond", "reach"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Minimum mean number of points per cell; with fewer, scanning rows costs more than it saves.
CROWD = 4
#: Cells per largest reach: finer cells enclose a ball more tightly, coarser ones are fewer.
FINENESS = 3.0
#: Slack of cell borders in cell widths, so that rounding loses no point.
BORDER = 1e-9


class Grid(NamedTuple):
    """Points by *slot*: correction points in the order of the grid, then A, then B.

    `x`, `y`, `z`, `kinds` and `ids` are coordinates, kinds and indices of the points by slot; `x` is the
    axis along which the bounding box is longest. `first` is the first slot of each (kind, cell), closed
    by the number of correction points. `shape` is the number of cells along each axis, `origin` the
    corner of the first cell and `width` the size of a cell. No two points are further apart than `span`,
    the diameter of the bounding box.
    """

    x: Floats
    y: Floats
    z: Floats
    kinds: NDArray[np.int8]
    ids: Integers
    first: Integers
    shape: Integers
    origin: Floats
    width: Floats
    span: float


@kernel
def reach(space: Airspace, kind: int) -> float:
    """Return the length of the longest arc to a point of `kind` under its thresholds, m.

    The value is rounded up, so callers must still test the thresholds.
    """
    longest = np.inf
    for error in range(2):
        limit = space.limits[kind, error]
        if space.rates[error] > 0.0 or limit < 0.0:
            longest = min(longest, limit / space.rates[error])
    return longest * (1.0 + 1e-9)


@kernel
def cell(coordinate: float, origin: float, width: float, count: int) -> int:
    """Return the cell index of `coordinate` along one axis, clipped to the box."""
    where = (coordinate - origin) / width
    if not where > 0.0:
        return 0
    if where >= count:
        return count - 1
    return int(where)


@kernel(interpretable=True)
def build(space: Airspace, keep: NDArray[np.bool_]) -> Grid:
    """Return the grid of the correction points marked in `keep`, with A and B."""
    points, kinds = space.points, space.kinds
    n = len(points)
    low, high, extent = np.empty(3), np.empty(3), np.empty(3)
    for axis in range(3):
        low[axis] = min(points[space.start, axis], points[space.end, axis])
        high[axis] = max(points[space.start, axis], points[space.end, axis])
    m = 0
    for i in range(n):
        if keep[i] and (kinds[i] == HORIZONTAL or kinds[i] == VERTICAL):
            m += 1
            for axis in range(3):
                low[axis] = min(low[axis], points[i, axis])
                high[axis] = max(high[axis], points[i, axis])
    run, square = 0, 0.0
    for axis in range(3):
        extent[axis] = high[axis] - low[axis]
        square += extent[axis] * extent[axis]
        if extent[axis] > extent[run]:
            run = axis
    axes = (run, (run + 1) % 3, (run + 2) % 3)
    span = np.sqrt(square) * (1.0 + 1e-9)

    # Cells of a fraction of the reach, doubled until each holds a few points on average.
    size = min(max(reach(space, HORIZONTAL), reach(space, VERTICAL)), span) / FINENESS
    size = max(size, span * 1e-3)
    shape = np.empty(3, np.int64)
    shape[0] = shape[1] = shape[2] = 1
    while size > 0.0:
        for axis in range(3):
            shape[axis] = int(extent[axes[axis]] / size) + 1
        if shape[0] * shape[1] * shape[2] * CROWD <= max(m, CROWD):
            break
        size *= 1.25
    origin = np.empty(3)
    width = np.empty(3)
    for axis in range(3):
        origin[axis] = low[axes[axis]]
        width[axis] = max(extent[axes[axis]] / shape[axis], 1e-300)

    # Counting sort by (kind, cell).
    per_kind = shape[0] * shape[1] * shape[2]
    first = np.zeros(2 * per_kind + 1, np.int64)
    home = np.empty(n, np.int64)
    for i in range(n):
        if keep[i] and (kinds[i] == HORIZONTAL or kinds[i] == VERTICAL):
            cx = cell(points[i, axes[0]], origin[0], width[0], shape[0])
            cy = cell(points[i, axes[1]], origin[1], width[1], shape[1])
            cz = cell(points[i, axes[2]], origin[2], width[2], shape[2])
            home[i] = (((kinds[i] - HORIZONTAL) * shape[2] + cz) * shape[1] + cy) * shape[0] + cx
            first[home[i] + 1] += 1
        else:
            home[i] = -1
    for c in range(2 * per_kind):
        first[c + 1] += first[c]
    ids = np.empty(m + 2, np.int64)
    filled = np.empty(2 * per_kind, np.int64)
    for c in range(2 * per_kind):
        filled[c] = first[c]
    for i in range(n):
        if home[i] >= 0:
            ids[filled[home[i]]] = i
            filled[home[i]] += 1
    ids[m] = space.start
    ids[m + 1] = space.end
    x, y, z = np.empty(m + 2), np.empty(m + 2), np.empty(m + 2)
    slot_kinds = np.empty(m + 2, np.int8)
    for s in range(m + 2):
        x[s] = points[ids[s], axes[0]]
        y[s] = points[ids[s], axes[1]]
        z[s] = points[ids[s], axes[2]]
        slot_kinds[s] = kinds[ids[s]]
    return Grid(x, y, z, slot_kinds, ids, first, shape, origin, width, span)


@kernel
def gap(coordinate: float, origin: float, width: float, index: int) -> float:
    """Return a lower bound on the distance between `coordinate` and cell `index` along one axis."""
    low = origin + (index - BORDER) * width
    high = origin + (index + 1 + BORDER) * width
    return max(low - coordinate, coordinate - high, 0.0)


@kernel
def near(grid: Grid, slot: int, kind: int, radius: float, found: Integers, away: Floats) -> int:
    """Collect the points of `kind` within `radius` of `slot`, excluding `slot`; return their number.

    Slots are written to `found` and distances to `away`, both of at least the number of slots.
    """
    return near_beyond(grid, slot, kind, radius, slot, -1.0, found, away)


@kernel
def near_beyond(
    grid: Grid, slot: int, kind: int, radius: float, middle: int, inner: float, found: Integers,
    away: Floats,
) -> int:  # fmt: skip
    """Collect points like :func:`near`, without those in cells that are within `inner` of slot `middle`."""
    if radius < 0.0:
        return 0
    radius = min(radius, grid.span)
    x, y, z = grid.x[slot], grid.y[slot], grid.z[slot]
    square = radius * radius * (1.0 + 1e-12)
    nx, ny, nz = grid.shape[0], grid.shape[1], grid.shape[2]
    ox, oy, oz = grid.origin[0], grid.origin[1], grid.origin[2]
    wx, wy, wz = grid.width[0], grid.width[1], grid.width[2]
    z_low = cell(z - radius - BORDER * wz, oz, wz, nz)
    z_high = cell(z + radius + BORDER * wz, oz, wz, nz)
    y_low = cell(y - radius - BORDER * wy, oy, wy, ny)
    y_high = cell(y + radius + BORDER * wy, oy, wy, ny)
    count = 0
    for cz in range(z_low, z_high + 1):
        gap_z = gap(z, oz, wz, cz)
        for cy in range(y_low, y_high + 1):
            gap_y = gap(y, oy, wy, cy)
            left = square - gap_y * gap_y - gap_z * gap_z
            if left < 0.0:
                continue
            half = np.sqrt(left) + BORDER * wx
            row = (((kind - HORIZONTAL) * nz + cz) * ny + cy) * nx
            low, high = cell(x - half, ox, wx, nx), cell(x + half, ox, wx, nx) + 1
            skip, resume = high, high
            if inner > 0.0:
                skip, resume = covered(grid, middle, inner, cy, cz, low, high)
            for part in range(2):
                begin = grid.first[row + (low if part == 0 else resume)]
                stop = grid.first[row + (skip if part == 0 else high)]
                for s in range(begin, stop):
                    dx, dy, dz = grid.x[s] - x, grid.y[s] - y, grid.z[s] - z
                    d = dx * dx + dy * dy + dz * dz
                    # Write always and advance only for near points: no branch in the innermost loop.
                    found[count] = s
                    away[count] = d
                    count += int(d <= square and s != slot)
    for k in range(count):
        away[k] = np.sqrt(away[k])
    return count


@kernel
def covered(
    grid: Grid, slot: int, radius: float, cy: int, cz: int, low: int, high: int
) -> tuple[int, int]:
    """Return the first cell of a row, from `low` on, that is within a ball, and the first one beyond, at most `high`.

    Without such a cell both are `high`.
    """
    radius *= 1.0 - 1e-9
    far_y = farthest(grid.y[slot], grid.origin[1], grid.width[1], cy)
    far_z = farthest(grid.z[slot], grid.origin[2], grid.width[2], cz)
    left = radius * radius - far_y * far_y - far_z * far_z
    if left <= 0.0:
        return high, high
    half, width = np.sqrt(left), grid.width[0]
    middle = grid.x[slot] - grid.origin[0]
    begin = max((middle - half) / width + BORDER, low)
    end = min((middle + half) / width - BORDER, high)
    first, beyond = int(np.ceil(begin)), int(np.floor(end))
    if beyond <= first:
        return high, high
    return first, beyond


@kernel
def farthest(coordinate: float, origin: float, width: float, index: int) -> float:
    """Return an upper bound on the distance between `coordinate` and points of cell `index` along one axis."""
    low = origin + (index - BORDER) * width
    high = origin + (index + 1 + BORDER) * width
    return max(coordinate - low, high - coordinate)
