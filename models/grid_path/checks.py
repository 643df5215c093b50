"""Verification of paths on a map: every segment is clipped against the blocked cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ..fields import required
from ..verification import Check, Verification, check_tolerance
from .gridmap import GridMap
from .plan import GridPlan

__all__ = ["depths", "length_along", "verify_paths"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Relative rounding error of a position.
DIGITS = 1e-13
#: Number of pieces of segments per batch.
MOST = 2**13


def depths(grid: GridMap, path: Floats) -> tuple[float, int]:
    """Return the depth of a polyline in a blocked cell or outside the map, and its segment.

    The points of `path` are x, y in cells, shape (k, 2); the map's corner is (0, 0). The depth is in cells,
    at most 1/2 inside the map.
    """
    rows, columns = grid.shape
    outside = np.maximum(-path, path - [columns, rows]).max(axis=1)
    worst, where = max(float(outside.max()), 0.0), max(int(np.argmax(outside)) - 1, 0)
    if not worst < 1.0:
        return worst, where
    shifted = path + 1.0
    # The side between two adjacent blocked cells is blocked too, so pairs form larger boxes.
    for extent in ((1, 1), (2, 1), (1, 2)):
        pattern = np.ones(extent[::-1], np.uint8)
        for segments, cells in _around(grid, pattern, shifted):
            a, b = shifted[segments], shifted[segments + 1]
            # Part of the segment within each box, as shares of its length.
            step = np.where(b - a == 0, 1e-300, b - a)
            first, last = (cells - a) / step, (cells + extent - a) / step
            enter = np.maximum(np.minimum(first, last).max(axis=1), 0.0)
            leave = np.minimum(np.maximum(first, last).min(axis=1), 1.0)
            met = enter <= leave
            segments = segments[met]
            deep = _deepest(a[met] - cells[met], (b - a)[met], extent, enter[met], leave[met])
            if deep.max(initial=0.0) > worst:
                worst, where = float(deep.max()), int(segments[np.argmax(deep)])
    return worst, where


def _deepest(
    at: Floats, step: Floats, extent: tuple[int, int], enter: Floats, leave: Floats
) -> Floats:
    """Return the maximum depth of each segment ``at + s * step`` in a box from 0 to `extent`, enter <= s <= leave.

    The depth is the minimum of the distances to four sides, each linear in s. Its maximum is therefore at an
    end, or at equal distances to two sides.
    """
    zero, far = at, extent - at
    sides = np.stack([zero[:, 0], zero[:, 1], far[:, 0], far[:, 1]])
    rates = np.stack([step[:, 0], step[:, 1], -step[:, 0], -step[:, 1]])
    first, other = np.triu_indices(4, 1)
    turns = rates[first] - rates[other]
    equal = (sides[other] - sides[first]) / np.where(turns == 0, np.inf, turns)
    shares = np.concatenate([[enter, leave], np.clip(equal, enter, leave)])
    depths: Floats = (sides[:, None] + rates[:, None] * shares).min(axis=0).max(axis=0)
    return depths


def _around(grid: GridMap, pattern: NDArray[np.uint8], path: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield segments of `path` and, for each, a place (x, y) of a pattern near it, in batches.

    The pattern is 1 for blocked cells, and is compared with the framed map from a place on. Segments are
    divided into pieces of at most one cell, so the work grows with the length of the path only.
    """
    height, width = grid.shape[0] + 2, grid.shape[1] + 2
    framed = grid.walls.reshape(height, width)
    size = np.array([width, height]) - pattern.shape[::-1] + 1
    window = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
    steps = np.diff(path, axis=0)
    counts = np.maximum(np.ceil(np.abs(steps).max(axis=1)), 1.0).astype(int)
    segments = np.repeat(np.arange(len(steps)), counts)
    pieces = np.arange(len(segments)) - np.repeat(np.cumsum(counts) - counts, counts)
    for begin in range(0, len(segments), MOST):
        part = segments[begin : begin + MOST]
        shares = (pieces[begin : begin + MOST, None] + [0.0, 1.0]) / counts[part][:, None]
        ends = path[part][:, None] + shares[..., None] * steps[part][:, None]
        low = np.clip(np.floor(ends.min(axis=1)).astype(int) - 1, 0, size)
        high = np.clip(np.floor(ends.max(axis=1)).astype(int) + 2, 0, size)
        x, y = np.moveaxis(low[:, None] + window, 2, 0)
        piece, place = np.nonzero((x < high[:, :1]) & (y < high[:, 1:]))
        x, y = x[piece, place], y[piece, place]
        marked = np.ones(len(x), bool)
        for (down, across), value in np.ndenumerate(pattern):
            marked &= framed[y + down, x + across] == value
        # The windows of pieces overlap.
        keys = np.unique((part[piece] * height + y)[marked] * width + x[marked])
        lines, x = np.divmod(keys, width)
        segment, y = np.divmod(lines, height)
        yield segment, np.column_stack([x, y])


def _squeezes(grid: GridMap, path: Floats, accepted: float) -> list[tuple[float, float]]:
    """Return the corners (x, y in cells) between two blocked cells that `path` passes through.

    Such a path crosses the diagonal of both cells within `accepted` of the corner, the accepted depth.
    """
    rising = np.eye(2, dtype=np.uint8)
    corners: list[tuple[float, float]] = []
    for pattern, slope in ((rising, 1.0), (1 - rising, -1.0)):
        for segments, near in _around(grid, pattern, path):
            ends = np.stack([path[segments], path[segments + 1]]) - near
            # Coordinates of the ends across and along the diagonal.
            across = ends[..., 0] - slope * ends[..., 1]
            along = 0.5 * (ends[..., 0] + slope * ends[..., 1])
            change = across[0] - across[1]
            share = across[0] / np.where(change == 0, np.inf, change)
            place = np.abs(along[0] + share * (along[1] - along[0]))
            crosses = (across[0] * across[1] <= 0) & (change != 0) & (place <= accepted)
            corners += [(float(x), float(y)) for x, y in near[crosses]]
    return corners


def verify_paths(model: Any, plan: GridPlan, tolerance: float) -> Verification:
    """Return the cost of `plan` (m) and the checks of all constraints, see :meth:`.Model.verify`."""
    check_tolerance(tolerance)
    required("plan", plan, GridPlan)
    grid = model.map
    each = model.reach == "each"
    required_paths = len(model.goals) if each else 1
    noise = DIGITS * float(np.abs(grid.origin).max() + grid.cell * max(grid.shape)) / grid.cell
    paths = [(path - grid.origin) / grid.cell for path in plan.paths]
    start = model.start[::-1] + 0.5
    goals = model.goals[:, ::-1] + 0.5
    begins, ends, deep = [], [], []
    segments: list[int] = []
    squeezes: list[str] = []
    along = [_along(model, path) for path in paths] if model.connectivity != "any" else []
    for k, path in enumerate(paths):
        begins.append(float(np.hypot(*(path[0] - start))))
        apart = np.hypot(*(goals - path[-1]).T)
        ends.append(float(apart[min(k, len(goals) - 1)] if each else apart.min()))
        # Such steps stay in free cells, and pass corners of four free cells only.
        is_clear = k < len(along) and along[k][3]
        depth, segment = (0.0, 0) if is_clear else depths(grid, path)
        deep.append(depth)
        segments.append(segment)
        passed = []
        if not is_clear and depth < 1.0:
            passed = _squeezes(grid, path, tolerance + 2.0 * noise)
        squeezes += [f"path {k}, x {x:g}, y {y:g} cells" for x, y in passed]

    def lengths(name: str, cells: list[float], where: Callable[[int], str]) -> Check:
        """Return the check of lengths in cells; without a violation, its place is empty."""
        violations = grid.cell * np.array(cells)
        place = where if violations.any() else ""
        return Check.largest(
            name, violations, grid.cell, "m", place, tolerance, noise=noise * grid.cell
        )

    checks = [
        Check.count(
            "one path for each goal" if each else "one path", abs(len(paths) - required_paths)
        ),
        lengths("starts at its cell", begins, lambda k: f"path {k}"),
        lengths("ends at its goal", ends, lambda k: f"path {k}"),
        lengths("keeps to free cells", deep, lambda k: f"path {k}, segment {segments[k]}"),
        Check.count("not between cells that touch", squeezes),
    ]
    if model.connectivity != "any":
        off, points = [entry[0] for entry in along], [entry[1] for entry in along]
        place = "path {}, point {}".format
        wrong = [f"path {k}, step {text}" for k, entry in enumerate(along) for text in entry[2]]
        checks += [
            lengths("points at centres of cells", off, lambda k: place(k, points[k])),
            Check.count("steps to neighbours", wrong),
        ]
    cost = 0.0
    for path in paths:
        steps = np.hypot(*np.diff(path, axis=0).T) * grid.cell
        if model.weights is not None and len(path) > 1:
            rows, columns = grid.shape
            cells = np.clip(np.floor(path).astype(int), 0, [columns - 1, rows - 1])
            weight = model.weights[cells[:, 1], cells[:, 0]]
            steps = steps * 0.5 * (weight[1:] + weight[:-1])
        cost += float(steps.sum())
    return Verification(cost, tuple(checks), scale=0.0)


def _along(model: Any, path: Floats) -> tuple[float, int, list[str], bool]:
    """Return how well a path, in cells, connects the centres of neighbouring cells.

    The result is the largest distance to a centre (cells), its point, the wrong steps, and whether the path
    is clear: it has no wrong step, only free cells, and all points within a quarter of a cell of their centres.
    """
    cells = np.floor(path)
    apart = np.abs(path - cells - 0.5).max(axis=1)
    point = int(np.argmax(apart))
    steps = np.abs(np.diff(cells, axis=0))
    total = steps.sum(axis=1)
    good = (total == 1) | ((steps.max(axis=1, initial=0) <= 1) & (total == 2))
    if model.connectivity == "4":
        good = total == 1
    wrong = [f"{int(s)}" for s in np.flatnonzero(~good)]
    # Both cells beside the corner of a diagonal step; the row is y.
    turned = np.flatnonzero(good & (total == 2))
    before, after = cells[turned].astype(int), cells[turned + 1].astype(int)
    free = [
        model.map.holds(np.column_stack([y[:, 1], x[:, 0]]))
        for y, x in ((before, after), (after, before))
    ]
    wrong += [f"{int(s)} cuts a corner" for s in turned[~(free[0] & free[1])]]
    is_clear = not wrong and apart[point] <= 0.25
    return (
        float(apart[point]),
        point,
        wrong,
        bool(is_clear and model.map.holds(cells[:, ::-1].astype(int)).all()),
    )


@kernel(interpretable=True)
def length_along(
    blocked: NDArray[np.bool_],
    weights: Floats,
    points: Floats,
    corner: Floats,
    cell: float,
    ends: Ints,
    diagonal: bool,
    accepted: float,
) -> float:
    """Return the cost of a path along neighbouring cells, in cells, or -1 if it violates a constraint.

    The constraints are those of :func:`verify_paths` for connectivity "4" or, if `diagonal`, "8". The work is
    proportional to the number of points x, y, m. `corner` is the corner of the map with the lowest x and y and `cell`
    the side of a cell, m. `ends` are rows and columns of start and goal. Without `weights`, shape (0, 0), a length costs
    1. `accepted` is the largest accepted distance of a point from the centre of its cell, in cells.
    """
    rows, columns = blocked.shape
    last = len(points) - 1
    before_row, before_column = 0, 0
    straight, turned, cost = 0, 0, 0.0
    for k in range(len(points)):
        x, y = (points[k, 0] - corner[0]) / cell, (points[k, 1] - corner[1]) / cell
        if not (0.0 <= x < columns and 0.0 <= y < rows):
            return -1.0
        row, column = int(y), int(x)
        away = (x - column - 0.5) ** 2 + (y - row - 0.5) ** 2
        if away > accepted**2 or blocked[row, column]:
            return -1.0
        if k == 0 and (row != ends[0, 0] or column != ends[0, 1]):
            return -1.0
        if k == last and (row != ends[1, 0] or column != ends[1, 1]):
            return -1.0
        if k > 0:
            down, across = abs(row - before_row), abs(column - before_column)
            most = 2 if diagonal else 1
            if down > 1 or across > 1 or not 0 < down + across <= most:
                return -1.0
            if blocked[row, before_column] or blocked[before_row, column]:
                return -1.0
            if weights.size > 0:
                mean = 0.5 * (weights[row, column] + weights[before_row, before_column])
                cost += mean * math.sqrt(down + across)
            elif down + across == 2:
                turned += 1
            else:
                straight += 1
        before_row, before_column = row, column
    return cost + straight + turned * math.sqrt(2.0)
