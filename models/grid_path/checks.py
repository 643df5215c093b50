"""The independent check of paths on a map: every segment is clipped against the blocked cells."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..verification import Check, Verification, check_tolerance
from .gridmap import GridMap
from .plan import GridPlan

__all__ = ["depths", "verify_paths"]

Floats = NDArray[np.float64]
#: Makes the check called so of the worst violation and its place.
Measure = Callable[[str, float, str], Check]

#: Digits that coordinates leave of a position.
DIGITS = 1e-13


class Asked(Protocol):
    """What a model of paths holds."""

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
    """Return how deep a polyline enters a blocked cell or leaves the map, in cells.

    Parameters
    ----------
    grid : GridMap
        The map.
    path : ndarray, shape (k, 2)
        x, y in cells: (0, 0) is the map's corner.

    Returns
    -------
    float, int
        The depth, at most half a cell within the map, and the segment where it is.
    """
    rows, columns = grid.shape
    outside = np.maximum(-path, path - [columns, rows]).max(axis=1)
    worst, where = max(float(outside.max()), 0.0), max(int(np.argmax(outside)) - 1, 0)
    if not np.isfinite(path).all() or worst >= 1.0:
        return (worst if np.isfinite(worst) else np.inf), where
    for k, (a, b) in enumerate(itertools.pairwise(path)):
        low = np.clip(np.floor(np.minimum(a, b)).astype(int) - 1, 0, [columns, rows])
        high = np.clip(np.floor(np.maximum(a, b)).astype(int) + 2, 0, [columns, rows])
        found = np.argwhere(grid.blocked[low[1] : high[1], low[0] : high[0]])[:, ::-1] + low
        if not len(found):
            continue
        # The part of the segment within each blocked cell, as shares of its length.
        step = np.where(b - a == 0, 1e-300, b - a)
        first, last = (found - a) / step, (found + 1 - a) / step
        enter = np.maximum(np.minimum(first, last).max(axis=1), 0.0)
        leave = np.minimum(np.maximum(first, last).min(axis=1), 1.0)
        within = np.flatnonzero(enter <= leave)
        if not within.size:
            continue
        middle = a + 0.5 * (enter + leave)[within, None] * (b - a)
        deep = np.minimum(middle - found[within], found[within] + 1 - middle).min(axis=1)
        if deep.max() > worst:
            worst, where = float(deep.max()), k
    return worst, where


def _squeezes(grid: GridMap, path: Floats, slack: float) -> list[tuple[float, float]]:
    """Return the corners (x, y in cells) between two blocked cells that `path` passes through."""
    padded = np.pad(grid.blocked, 1, constant_values=True)
    around = [padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]]
    both = (around[0] & around[3] & ~around[1] & ~around[2]) | (
        around[1] & around[2] & ~around[0] & ~around[3]
    )
    corners = np.argwhere(both)[:, ::-1].astype(float)
    found = []
    for a, b in itertools.pairwise(path):
        near = corners[
            ((corners >= np.minimum(a, b) - slack) & (corners <= np.maximum(a, b) + slack)).all(
                axis=1
            )
        ]
        length = float(np.hypot(*(b - a)))
        if not len(near) or length == 0:
            continue
        off = np.abs((b[0] - a[0]) * (near[:, 1] - a[1]) - (b[1] - a[1]) * (near[:, 0] - a[0]))
        found += [(float(x), float(y)) for x, y in near[off <= slack * length]]
    return found


def verify_paths(model: Asked, plan: GridPlan, tolerance: float) -> Verification:
    """Return the cost of `plan` and every constraint of `model`."""
    check_tolerance(tolerance)
    required("plan", plan, GridPlan)
    grid = model.map
    each = model.reach == "each"
    wanted = len(model.goals) if each else 1
    noise = DIGITS * float(np.abs(grid.origin).max() + grid.cell * max(grid.shape)) / grid.cell
    paths = [(path - grid.origin) / grid.cell for path in plan.paths]
    start = model.start[::-1] + 0.5
    goals = model.goals[:, ::-1] + 0.5
    begin = ends = depth = 0.0
    began = ended = deep = ""
    squeezes: list[str] = []
    for k, path in enumerate(paths):
        off = float(np.hypot(*(path[0] - start)))
        if not off <= begin:
            begin, began = off, f"path {k}"
        apart = np.hypot(*(goals - path[-1]).T)
        off = float(apart[min(k, len(goals) - 1)] if each else apart.min())
        if not off <= ends:
            ends, ended = off, f"path {k}"
        off, segment = depths(grid, path)
        if not off <= depth:
            depth, deep = off, f"path {k}, segment {segment}"
        squeezes += [
            f"path {k}, x {x:g}, y {y:g} cells" for x, y in _squeezes(grid, path, 1e-9 + noise)
        ]

    def lengths(name: str, worst: float, where: str) -> Check:
        return Check.scaled(
            name, "", worst * grid.cell, "m", where, tolerance, grid.cell, noise=noise * grid.cell
        )

    def count(name: str, worst: float, where: str) -> Check:
        return Check(name, "", worst, "", 0.0, where, 0.0)

    checks = [
        count("one path for each goal" if each else "one path", abs(len(paths) - wanted), ""),
        lengths("starts at its cell", begin, began),
        lengths("ends at its goal", ends, ended),
        lengths("keeps to free cells", depth, deep),
        count("not between cells that touch", len(squeezes), squeezes[0] if squeezes else ""),
    ]
    if model.connectivity != "any":
        checks += _steps(model, paths, lengths, count)
    cost = 0.0
    for path in paths:
        steps = np.hypot(*np.diff(path, axis=0).T) * grid.cell
        if model.weights is not None and len(path) > 1:
            rows, columns = grid.shape
            at = np.clip(np.floor(path).astype(int), 0, [columns - 1, rows - 1])
            weight = model.weights[at[:, 1], at[:, 0]]
            steps = steps * 0.5 * (weight[1:] + weight[:-1])
        cost += float(steps.sum())
    return Verification(cost, tuple(checks), scale=0.0)


def _steps(model: Asked, paths: list[Floats], lengths: Measure, count: Measure) -> list[Check]:
    """Return the checks that paths lead from the centres of cells to those of neighbours."""
    off, where, wrong = 0.0, "", []
    for k, path in enumerate(paths):
        cells = np.floor(path)
        apart = np.abs(path - cells - 0.5).max(axis=1)
        if not apart.max() <= off:
            off, where = float(apart.max()), f"path {k}, point {int(np.argmax(apart))}"
        steps = np.abs(np.diff(cells, axis=0))
        total = steps.sum(axis=1)
        good = (total == 1) | ((steps.max(axis=1, initial=0) <= 1) & (total == 2))
        if model.connectivity == "4":
            good = total == 1
        wrong += [f"path {k}, step {int(s)}" for s in np.flatnonzero(~good)]
        for s in np.flatnonzero(good & (total == 2)):
            # Both cells beside the corner; rows are y.
            beside = np.array([[cells[s, 1], cells[s + 1, 0]], [cells[s + 1, 1], cells[s, 0]]])
            if not model.map.holds(beside.astype(int)).all():
                wrong.append(f"path {k}, step {int(s)} cuts a corner")
    return [
        lengths("points at centres of cells", off, where),
        count("steps to neighbours", len(wrong), wrong[0] if wrong else ""),
    ]
