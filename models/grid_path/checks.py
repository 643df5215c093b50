"""Verification of paths on a map: every segment is clipped against the blocked cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..verification import Check, Verification, check_tolerance
from .gridmap import GridMap
from .plan import GridPlan

__all__ = ["depths", "verify_paths"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Function that makes a check of its name, violations in cells and the function of their places.
Measure = Callable[[str, list[float], Callable[[int], str]], Check]

#: Relative rounding error of a position.
DIGITS = 1e-13
#: Number of segments per batch.
MOST = 2**13


class PathModel(Protocol):
    """Fields of a model of paths that the checks use."""

    @property
    def map(self) -> GridMap: ...
    @property
    def start(self) -> NDArray[np.int64]: ...
    @property
    def goals(self) -> NDArray[np.int64]: ...
    @property
    def connectivity(self) -> str: ...
    @property
    def reach(self) -> str: ...
    @property
    def weights(self) -> Floats | None: ...


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
    walls = np.pad(grid.blocked, 1, constant_values=True)
    shifted = path + 1.0
    # The side between two adjacent blocked cells is blocked too, so pairs form larger boxes.
    boxes = (
        (walls, (1, 1)),
        (walls[:, :-1] & walls[:, 1:], (2, 1)),
        (walls[:-1] & walls[1:], (1, 2)),
    )
    for marked, extent in boxes:
        for segments, cells in _around(marked, shifted):
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


def _around(marked: NDArray[np.bool_], path: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield segments of `path` and, for each, a marked cell (x, y) in its bounding box.

    Short segments come in batches, long segments one by one.
    """
    size = marked.shape[::-1]
    window = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
    for begin in range(0, len(path) - 1, MOST):
        part = path[begin : begin + MOST + 1]
        low = np.floor(np.minimum(part[:-1], part[1:])).astype(int) - 1
        high = np.floor(np.maximum(part[:-1], part[1:])).astype(int) + 2
        low, high = np.clip(low, 0, size), np.clip(high, 0, size)
        short = (high - low <= 4).all(axis=1)
        places = low[short][:, None] + window
        mask = (places < high[short][:, None]).all(axis=2)
        mask[mask] = marked[tuple(places[mask][:, ::-1].T)]
        yield begin + np.flatnonzero(short)[np.nonzero(mask)[0]], places[mask]
        for k in np.flatnonzero(~short):
            box = marked[low[k, 1] : high[k, 1], low[k, 0] : high[k, 0]]
            cells = np.argwhere(box)[:, ::-1] + low[k]
            yield np.full(len(cells), begin + k), cells


def _squeezes(grid: GridMap, path: Floats, accepted: float) -> list[tuple[float, float]]:
    """Return the corners (x, y in cells) between two blocked cells that `path` passes through.

    Such a path crosses the diagonal of both cells within `accepted` of the corner, the accepted depth.
    """
    padded = np.pad(grid.blocked, 1, constant_values=True)
    around = [padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]]
    rising = around[0] & around[3] & ~around[1] & ~around[2]
    falling = around[1] & around[2] & ~around[0] & ~around[3]
    corners: list[tuple[float, float]] = []
    for both, slope in ((rising, 1.0), (falling, -1.0)):
        for segments, near in _around(both, path):
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


def verify_paths(model: PathModel, plan: GridPlan, tolerance: float) -> Verification:
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
    for k, path in enumerate(paths):
        begins.append(float(np.hypot(*(path[0] - start))))
        apart = np.hypot(*(goals - path[-1]).T)
        ends.append(float(apart[min(k, len(goals) - 1)] if each else apart.min()))
        depth, segment = depths(grid, path)
        deep.append(depth)
        segments.append(segment)
        passed = _squeezes(grid, path, tolerance + 2.0 * noise) if depth < 1.0 else []
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
        checks += _steps(model, paths, lengths)
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


def _steps(model: PathModel, paths: list[Floats], lengths: Measure) -> list[Check]:
    """Return the checks that paths connect the centres of neighbouring cells."""
    off: list[float] = []
    points: list[int] = []
    wrong: list[str] = []
    for k, path in enumerate(paths):
        cells = np.floor(path)
        apart = np.abs(path - cells - 0.5).max(axis=1)
        points.append(int(np.argmax(apart)))
        off.append(float(apart[points[k]]))
        steps = np.abs(np.diff(cells, axis=0))
        total = steps.sum(axis=1)
        good = (total == 1) | ((steps.max(axis=1, initial=0) <= 1) & (total == 2))
        if model.connectivity == "4":
            good = total == 1
        wrong += [f"path {k}, step {int(s)}" for s in np.flatnonzero(~good)]
        # Both cells beside the corner of a diagonal step; the row is y.
        turned = np.flatnonzero(good & (total == 2))
        before, after = cells[turned].astype(int), cells[turned + 1].astype(int)
        free = [
            model.map.holds(np.column_stack([y[:, 1], x[:, 0]]))
            for y, x in ((before, after), (after, before))
        ]
        wrong += [f"path {k}, step {int(s)} cuts a corner" for s in turned[~(free[0] & free[1])]]
    return [
        lengths("points at centres of cells", off, lambda k: f"path {k}, point {points[k]}"),
        Check.count("steps to neighbours", wrong),
    ]
