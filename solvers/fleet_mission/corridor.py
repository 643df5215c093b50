"""Corridor of boxes along a robot's route, and a short polyline inside it.

Each box consists of free cells, so all its points are safe. Consecutive boxes share at least one cell.
A curve that rests at a point of each intersection is feasible, so a feasible curve always exists.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.grid_path.gridmap import GridMap

__all__ = ["Cell", "Corridor", "corridor", "crossed"]

Floats = NDArray[np.float64]
Cell = tuple[int, int]
Box = tuple[int, int, int, int]

#: Distance in cells at which a path touches a grid line.
SLACK = 1e-9
#: Sweeps over the knots that shorten the polyline.
SWEEPS = 60
#: Inset of boxes as a share of a cell, for violations of bounds within solver tolerances.
INSET = 1e-5


class Corridor(NamedTuple):
    """Boxes along a robot's route and a short polyline within them, all in m.

    `lower` and `upper`, shape (k, 2), bound the box of each segment, `knots`, shape (k + 1, 2), are the
    polyline, and `stops` are its knots at the depot and the nodes, in order; coinciding places share a knot.
    """

    lower: Floats
    upper: Floats
    knots: Floats
    stops: NDArray[np.int64]


def crossed(grid: GridMap, path: Floats) -> list[Cell] | None:
    """Return the free cells crossed by a polyline, shape (k, 2), in m; consecutive cells share an edge.

    The polyline may touch blocked cells and turn at their corners. None if it crosses a blocked cell, or passes
    between two that touch at a corner.
    """
    free = ~np.pad(grid.blocked, 1, constant_values=True)

    def is_free(row: int, column: int) -> bool:
        rows, columns = grid.shape
        return bool(free[min(max(row, -1), rows) + 1, min(max(column, -1), columns) + 1])

    chain: list[Cell] = []
    points = (path - grid.origin) / grid.cell
    for a, b in itertools.pairwise(points):
        cuts = [0.0, 1.0]
        for axis in (0, 1):
            low, high = sorted((a[axis], b[axis]))
            if high - low > SLACK:
                lines = np.arange(np.ceil(low), np.floor(high) + 1)
                cuts += ((lines - a[axis]) / (b[axis] - a[axis])).tolist()
        shares = np.unique(np.clip(cuts, 0.0, 1.0))
        long = float(np.hypot(*(b - a)))
        for begin, end in itertools.pairwise(shares.tolist()):
            if (end - begin) * long <= SLACK:
                continue
            x, y = (a + 0.5 * (begin + end) * (b - a)).tolist()
            cell = _cell(x, y, chain[-1] if chain else None, is_free)
            if cell is None or not _append(chain, cell, is_free):
                return None
    if not chain:
        x, y = points[0].tolist()
        cell = _cell(x, y, None, is_free)
        return None if cell is None else [cell]
    return chain


def _cell(x: float, y: float, before: Cell | None, is_free: object) -> Cell | None:
    """Return the free cell of a point; on a grid line, the cell nearest to `before`."""

    def sides(value: float) -> list[int]:
        line = round(value)
        return [line - 1, line] if abs(value - line) <= SLACK else [int(np.floor(value))]

    cells = [(r, c) for r in sides(y) for c in sides(x) if is_free(r, c)]  # type: ignore[operator]
    if not cells:
        return None
    if before is None:
        return cells[-1]
    return min(cells, key=lambda cell: abs(cell[0] - before[0]) + abs(cell[1] - before[1]))


def _append(chain: list[Cell], cell: Cell, is_free: object) -> bool:
    """Append a cell, with an intermediate one for a diagonal step; return whether it is possible."""
    if chain and chain[-1] != cell:
        row, column = chain[-1]
        steps = abs(cell[0] - row) + abs(cell[1] - column)
        if steps == 2 and cell[0] != row and cell[1] != column:
            beside = [c for c in ((row, cell[1]), (cell[0], column)) if is_free(*c)]  # type: ignore[operator]
            if not beside:
                return False
            chain.append(beside[0])
        elif steps > 1:
            return False
    if not chain or chain[-1] != cell:
        chain.append(cell)
    return True


def _boxes(grid: GridMap, chain: list[Cell], reach: int) -> list[Box]:
    """Return rectangles of free cells (minimum and maximum row and column) that cover a chain.

    Each rectangle contains the last cell of the chain in the previous one.
    """
    total = np.pad(grid.blocked.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    rows, columns = grid.shape

    def free(box: Box) -> bool:
        r, c, s, d = box
        if r < 0 or c < 0 or s >= rows or d >= columns:
            return False
        inner = total[s + 1, d + 1] - total[r, d + 1] - total[s + 1, c] + total[r, c]
        return not inner

    boxes: list[Box] = []
    begin = 0
    while True:
        end, box = begin, (*chain[begin], *chain[begin])
        while end + 1 < len(chain):
            row, column = chain[end + 1]
            wider = (min(box[0], row), min(box[1], column), max(box[2], row), max(box[3], column))
            if not free(wider):
                break
            box, end = wider, end + 1
        sides = [True] * 4
        for _ in range(reach):
            for side in range(4):
                grown = list(box)
                grown[side] += -1 if side < 2 else 1
                if sides[side] and free((grown[0], grown[1], grown[2], grown[3])):
                    box = (grown[0], grown[1], grown[2], grown[3])
                else:
                    sides[side] = False
        boxes.append(box)
        while end + 1 < len(chain) and (
            box[0] <= chain[end + 1][0] <= box[2] and box[1] <= chain[end + 1][1] <= box[3]
        ):
            end += 1
        if end + 1 == len(chain):
            return boxes
        begin = end


def corridor(
    grid: GridMap, places: Floats, chains: Sequence[list[Cell]], margin: float, reach: int = 12
) -> Corridor:
    """Return the corridor of a route over `places`, shape (stops, 2), m: depot, nodes and depot again.

    `chains` are the cells from each place to the next, empty if both coincide. Boxes extend at most `margin`
    (m) beyond the polyline, and at most `reach` cells beyond the chain.
    """
    lower, upper = [], []
    stops = [0]
    fixed = {0: places[0]}
    for place, chain in zip(places[1:], chains, strict=True):
        if chain:
            for row, column, last_row, last_column in _boxes(grid, chain, reach):
                lower.append((column, row))
                upper.append((last_column + 1, last_row + 1))
        stops.append(len(lower))
        fixed[len(lower)] = place
    if not lower:
        empty = np.empty((0, 2))
        return Corridor(empty, empty, places[:1], np.array(stops))
    inset = INSET * grid.cell
    low = grid.origin + np.array(lower, float) * grid.cell + inset
    high = grid.origin + np.array(upper, float) * grid.cell - inset
    fixed_knots = np.array(sorted(fixed))
    # Places on an edge of their cell are safe, too.
    for side in (0, -1):
        rows = np.clip(fixed_knots + side, 0, len(low) - 1)
        for knot, row in zip(fixed_knots.tolist(), rows.tolist(), strict=True):
            low[row] = np.minimum(low[row], fixed[knot])
            high[row] = np.maximum(high[row], fixed[knot])
    knots = _string(low, high, {knot: fixed[knot] for knot in fixed_knots.tolist()})
    minimum, maximum = np.minimum(knots[:-1], knots[1:]), np.maximum(knots[:-1], knots[1:])
    low, high = np.maximum(low, minimum - margin), np.minimum(high, maximum + margin)
    return Corridor(low, high, knots, np.array(stops))


def _string(low: Floats, high: Floats, fixed: dict[int, Floats]) -> Floats:
    """Return a short polyline with one knot in each intersection of consecutive boxes.

    Coordinate descent: each knot minimises the sum of distances to its neighbours, by a straight line
    through the intersection or by the law of reflection on one of its edges.
    """
    count = len(low)
    below = np.concatenate([low[:1], np.maximum(low[:-1], low[1:]), low[-1:]])
    above = np.concatenate([high[:1], np.minimum(high[:-1], high[1:]), high[-1:]])
    for knot, place in fixed.items():
        below[knot] = above[knot] = place
    knots: Floats = 0.5 * (below + above)
    for _ in range(SWEEPS):
        for first in (1, 2):
            rows = np.arange(first, count, 2)
            if not rows.size:
                continue
            a, b, bottom, top = knots[rows - 1], knots[rows + 1], below[rows], above[rows]
            options = [_through(a, b, bottom, top)]
            for axis, edge in itertools.product((0, 1), (bottom, top)):
                other = 1 - axis
                before = np.abs(a[:, axis] - edge[:, axis])
                after = np.abs(b[:, axis] - edge[:, axis])
                apart = before + after
                share = np.divide(before, apart, out=np.full_like(before, 0.5), where=apart > 0)
                place = np.empty_like(a)
                place[:, axis] = edge[:, axis]
                place[:, other] = a[:, other] + share * (b[:, other] - a[:, other])
                options.append(np.clip(place, bottom, top))
            each = np.stack(options)
            cost = np.hypot(*np.moveaxis(each - a, -1, 0)) + np.hypot(*np.moveaxis(each - b, -1, 0))
            best = np.argmin(cost * (1 + 1e-12 * (np.arange(5) > 0))[:, None], axis=0)
            knots[rows] = each[best, np.arange(rows.size)]
    return knots


def _through(a: Floats, b: Floats, bottom: Floats, top: Floats) -> Floats:
    """Return the midpoint of each segment's part inside its box, or a clipped point if it misses."""
    step = np.where(b == a, 1e-300, b - a)
    to_bottom, to_top = (bottom - a) / step, (top - a) / step
    enter = np.maximum(np.minimum(to_bottom, to_top).max(axis=1), 0.0)
    leave = np.minimum(np.maximum(to_bottom, to_top).min(axis=1), 1.0)
    share = np.where(enter <= leave, 0.5 * (enter + leave), 0.5)
    return np.asarray(np.clip(a + share[:, None] * (b - a), bottom, top))
