"""Lines of sight on a map: straight segments within free cells.

A segment is a line of sight if each of its points is in a free cell or on its border, and no point is
the common corner of two diagonal blocked cells. It may touch blocked cells and follow their sides,
except a side between two blocked cells.

Kernels take coordinates in cells of the *padded* map, which has a frame of blocked cells: the map's
corner is (1, 1). The results are exact for multiples of 1/2, such as corners and centres of cells, on
maps of fewer than 2**26 cells. Otherwise, a segment closer to a corner than `slack` passes through it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...jit import kernel
from .checks import DIGITS

if TYPE_CHECKING:
    from .gridmap import GridMap

__all__ = ["SLACK", "Sight", "convex_corners", "farthest", "free_at", "line_of_sight", "sees"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Distance, in cells, below which a segment passes through a corner. The check of a plan uses half.
SLACK = 2e-9


@kernel
def _at(blocked: Truths, turned: bool, major: int, minor: int) -> bool:
    """Return whether a cell is blocked. Rows are the major coordinate if `turned`."""
    return bool(blocked[major, minor] if turned else blocked[minor, major])


@kernel
def _pinched(blocked: Truths, turned: bool, major: int, minor: int) -> bool:
    """Return whether exactly two diagonal cells at a corner of the lattice are blocked."""
    a, b = _at(blocked, turned, major - 1, minor - 1), _at(blocked, turned, major, minor - 1)
    c, d = _at(blocked, turned, major - 1, minor), _at(blocked, turned, major, minor)
    return a == d and b == c and a != b


@kernel
def free_at(blocked: Truths, x: float, y: float) -> bool:
    """Return whether a point is in a free cell or on its border, except between two blocked cells."""
    columns, rows = blocked.shape[1], blocked.shape[0]
    if not (1.0 <= x <= columns - 1.0 and 1.0 <= y <= rows - 1.0):
        return False
    if x == math.floor(x) and y == math.floor(y) and _pinched(blocked, False, int(x), int(y)):
        return False
    for j in range(math.ceil(y) - 1, math.floor(y) + 1):
        for i in range(math.ceil(x) - 1, math.floor(x) + 1):
            if not blocked[j, i]:
                return True
    return False


@kernel
def _snapped(value: float, slack: float) -> float:
    """Return `value`, rounded to an integer if the difference is at most `slack`."""
    near = float(math.floor(value + 0.5))
    return near if abs(value - near) <= slack else value


@kernel(interpretable=True)
def sees(blocked: Truths, ax: float, ay: float, bx: float, by: float, slack: float) -> bool:
    """Return whether a straight segment, in cells of the padded map, stays in free cells.

    It passes through a corner that is closer than `slack`, in cells.
    """
    rows, columns = float(blocked.shape[0] - 1), float(blocked.shape[1] - 1)
    if not (min(ax, bx) >= 1.0 and max(ax, bx) <= columns):
        return False
    if not (min(ay, by) >= 1.0 and max(ay, by) <= rows):
        return False
    if ax == bx and ay == by:
        return free_at(blocked, ax, ay)
    turned = abs(by - ay) > abs(bx - ax)
    if turned:
        ax, ay, bx, by = ay, ax, by, bx
    if ax > bx:
        ax, ay, bx, by = bx, by, ax, ay
    # Along the longer coordinate, the segment crosses at most two cells per column.
    left, right, y = ax, ax, ay
    for column in range(math.floor(ax), math.ceil(bx)):
        if left == column and y == math.floor(y) and _pinched(blocked, turned, column, int(y)):
            return False
        right = min(column + 1.0, bx)
        end = by if right == bx else _snapped(ay + (right - ax) * (by - ay) / (bx - ax), slack)
        low, high = min(y, end), max(y, end)
        if low == high and low == math.floor(low):  # along a line of the lattice
            row = int(low)
            if _at(blocked, turned, column, row - 1) and _at(blocked, turned, column, row):
                return False
        else:
            for row in range(math.floor(low), math.ceil(high)):
                if _at(blocked, turned, column, row):
                    return False
        left, y = right, end
    return not (right == math.floor(right) and y == math.floor(y)) or not _pinched(
        blocked, turned, int(right), int(y)
    )


@kernel(interpretable=True)
def farthest(
    blocked: Truths, path: Floats, slack: float, flag: NDArray[np.int8]
) -> NDArray[np.int64]:
    """Return the indices of points that remain if each connects to its farthest visible point.

    `blocked` is the padded map, and `slack` the distance, in cells, below which a segment passes through a
    corner. If `flag` is nonzero, the remaining points stay.
    """
    n = len(path)
    chosen = np.empty(n, np.int64)
    size, here = 1, 0
    chosen[0] = 0
    while here < n - 1:
        x, y = path[here, 0], path[here, 1]
        there = n - 1 if flag[0] == 0 else here + 1
        while there > here + 1 and not sees(blocked, x, y, path[there, 0], path[there, 1], slack):
            there -= 1
        here = there
        chosen[size] = here
        size += 1
    return chosen[:size]


def convex_corners(blocked: Truths) -> NDArray[np.int8]:
    """Return the corners of blocked cells of a padded map at which a shortest path may turn.

    The result has the kind of the corner at each y and x. 0 means that the path cannot turn. Otherwise
    exactly one of the four cells is blocked: 1 at lower x and y, 2 at greater x, 3 at greater y, 4 at
    greater x and y. Row and column 0 are always 0.
    """
    around = [blocked[:-1, :-1], blocked[:-1, 1:], blocked[1:, :-1], blocked[1:, 1:]]
    kinds = np.zeros(blocked.shape, np.int8)
    single = sum(cells.astype(np.int8) for cells in around) == 1
    for k, cells in enumerate(around):
        kinds[1:, 1:][single & cells] = k + 1
    return kinds


class Sight:
    """Map prepared for many tests of lines of sight.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.

    Attributes
    ----------
    blocked : ndarray of bool, shape (rows + 2, columns + 2)
        Padded map.
    slack : float
        Distance, in cells, below which points are snapped to the lattice.
    """

    def __init__(self, grid: GridMap) -> None:
        self.grid = grid
        self.blocked: Truths = np.pad(grid.blocked, 1, constant_values=True)
        corner = float(np.abs(grid.origin).max()) + grid.cell * max(grid.shape)
        self.slack = SLACK + DIGITS * corner / grid.cell

    def cells(self, points: ArrayLike) -> Floats:
        """Return points x, y (m) in cells of the padded map, snapped to multiples of 1/2 within `slack`."""
        exact = (np.asarray(points, float) - self.grid.origin) / self.grid.cell + 1.0
        halves = np.round(2 * exact) / 2
        return np.where(np.abs(exact - halves) <= self.slack, halves, exact)

    def metres(self, cells: ArrayLike) -> Floats:
        """Return x, y (m) of points in cells of the padded map, shape (…, 2)."""
        points: Floats = self.grid.origin + (np.asarray(cells, float) - 1.0) * self.grid.cell
        return points

    def between(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return whether the segment between two points x, y (m) stays in free cells."""
        (ax, ay), (bx, by) = self.cells(a).tolist(), self.cells(b).tolist()
        return bool(sees(self.blocked, ax, ay, bx, by, self.slack))


def line_of_sight(grid: GridMap, a: ArrayLike, b: ArrayLike) -> bool:
    """Return whether a straight segment stays in free cells.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells. For many segments, :class:`Sight` is faster.
    a, b : array-like, shape (2,)
        Ends of the segment, x, y, m.

    Returns
    -------
    bool
        True if the segment may touch, but does not enter, blocked cells.

    Examples
    --------
    >>> from crosstrack.models import GridMap
    >>> from crosstrack.models.grid_path import line_of_sight
    >>> grid = GridMap([".@", ".."])
    >>> line_of_sight(grid, (0.5, 0.5), (1.5, 1.5))  # touches a blocked cell's corner
    True
    >>> line_of_sight(GridMap([".@", "@."]), (0.5, 0.5), (1.5, 1.5))
    False
    """
    return Sight(grid).between(a, b)
