"""Robot paths among obstacles as a black box with the coordinates of waypoints as variables.

The value of a free path is its length, as minimised in section 5 of the paper. The length within
obstacles is penalised in addition, so that every point has a value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import kernel
from ..declaration import Nested
from ..fields import Array, Optional, Real, Whole, declared, required, show
from ..grid_path import GridMap, GridPath, GridPlan, path_between
from ..inputs import Field, FloatArray
from .functions import BlackBoxFunction
from .model import MOST, BlackBoxMinimisation
from .plan import BlackBoxPoint

__all__ = ["WaypointPath", "as_grid_plan", "path_problem"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Distance from a side of the cells, in cells, below which a point is on the side, as in lines of
#: sight, and relative precision of coordinates.
_SLACK, _DIGITS = 2e-9, 1e-13
#: Distance of a path, in cells, beyond which its entire length is blocked.
_FAR = 1e9


@dataclass(frozen=True, eq=False, repr=False)
class WaypointPath(BlackBoxFunction):
    """Length of the path from a start through waypoints to a goal, with a penalty for blocked parts.

    The variables are x and y of one waypoint after another, in metres. The value is the length of the polyline,
    plus `penalty` times its length in blocked cells, on a side between two of them, and outside of the
    map. A path may touch blocked cells, as with any direction in :class:`~crosstrack.models.GridPath`.
    A move between free cells across a corner at which two blocked cells touch, or a turn at such a
    corner, has a blocked length of at least the side of a cell.

    With the default penalty, every path through blocked cells has a larger value than the shortest
    free path, for any number of waypoints. If less than a side is blocked between two free cells, the
    path along the sides of the blocked cell is free and at most √2 times as long, so a penalty above
    √2 - 1 suffices. Any other blocked part costs the penalty of a side in addition to the straight
    line from start to goal. The sum is longer than the path along neighbours, from which the default
    is computed. If the waypoints are too few for the shortest free path, a path that cuts a corner may
    still have a lower value than every free path with as many waypoints. No penalty of this kind
    prevents that, but more waypoints do.

    Parameters
    ----------
    map : GridMap
        Free and blocked cells.
    start, goal : ndarray, shape (2,)
        x and y in metres, in free cells or on their borders.
    waypoints : int
        Number of waypoints, >= 1.
    penalty : float, optional
        Penalty per blocked metre, in metres, >= 0. By default 1 plus the difference, in sides of
        cells, between the shortest path along neighbours and the straight line.

    Raises
    ------
    InvalidData
        An end is blocked, outside of the map, or at a corner of two touching blocked cells.

    Examples
    --------
    >>> import numpy as np
    >>> from crosstrack.models.black_box import WaypointPath
    >>> path = WaypointPath({"blocked": [".@.", "..."]}, (0.5, 0.5), (2.5, 0.5), waypoints=1)
    >>> print(path.values(np.array([[1.5, 1.5], [1.5, 0.5]])).round(3))  # around the cell, through it
    [2.828 5.   ]
    """

    map: Field[GridMap | Mapping[str, Any], GridMap] = declared(Nested(GridMap))
    start: FloatArray = declared(Array((2,), unit="m"))
    goal: FloatArray = declared(Array((2,), unit="m"))
    waypoints: int = declared(Whole(1, MOST // 2), default=5)
    penalty: Field[float | None, float] = declared(Optional(Real(lower=0)), default=None)

    type: ClassVar[str] = "waypoints"

    def check(self) -> None:
        """Raise if a robot cannot be at one of the ends."""
        homes = self._homes - 1
        if self.penalty is None:
            # Stored here, so that the default and the same explicit value have equal digests.
            object.__setattr__(self, "penalty", self._default(homes[:2], homes[2:]))

    def check_dimension(self, dimension: int) -> None:
        """Raise unless there are two variables per waypoint."""
        if dimension != 2 * self.waypoints:
            raise InvalidData(
                f"a path of {self.waypoints} waypoints has {2 * self.waypoints} variables, got bounds "
                f"of {dimension}",
                field="function",
            )

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is no value
    def values(self, points: Floats) -> Floats:
        """Return the length of each path, including the penalty."""
        lines = self.polylines(points)
        steps = np.diff(lines, axis=1)
        lengths = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)
        cells = self._cells(lines)
        near = np.asarray((np.abs(cells) <= _FAR).all(axis=(1, 2)))
        sides = np.empty(int(near.sum()))
        _count_blocked(self._padded, cells[near], self._homes, sides)
        blocked = lengths.copy()
        blocked[near] = sides * self.map.cell
        result: Floats = lengths + self.penalty * blocked
        return result

    def polylines(self, points: Floats) -> Floats:
        """Return the paths of `points`, shape (m, 2 waypoints), as shape (m, waypoints + 2, 2), m."""
        lines = np.empty((len(points), self.waypoints + 2, 2))
        lines[:, 0], lines[:, -1] = self.start, self.goal
        lines[:, 1:-1] = points.reshape(len(points), self.waypoints, 2)
        return lines

    def _cells(self, points: Floats) -> Floats:
        """Return points in cells of the map with a frame, rounded to integers within the precision."""
        grid = self.map
        corner = float(np.abs(grid.origin).max()) + grid.cell * max(grid.shape)
        result = (points - grid.origin) / grid.cell + 1.0
        rounded = np.round(result)
        slack = _SLACK + _DIGITS * corner / grid.cell
        return np.where(np.abs(result - rounded) <= slack, rounded, result)

    @cached_property
    def _padded(self) -> Truths:
        return np.pad(self.map.blocked, 1, constant_values=True)

    @cached_property
    def _homes(self) -> Ints:
        return np.concatenate([self._home("start"), self._home("goal")])

    def _home(self, name: str) -> Ints:
        """Return row and column, in the map with a frame, of a free cell that contains start or goal."""
        x, y = self._cells(getattr(self, name)).tolist()
        rows, columns = self.map.shape
        reason = "lies outside of the map"
        if 1 <= x <= columns + 1 and 1 <= y <= rows + 1:
            low = math.ceil(y) - 1, math.ceil(x) - 1
            around = self._padded[low[0] : math.floor(y) + 1, low[1] : math.floor(x) + 1]
            free = np.argwhere(~around)
            if len(free) != 2 or np.abs(free[1] - free[0]).sum() == 1:
                if len(free):
                    result: Ints = free[0] + low
                    return result
                reason = "is blocked"
            else:
                reason = "lies where two blocked cells touch"
        raise InvalidData(
            f"{name} must lie in a free cell or on its border, got {show(getattr(self, name).tolist())}"
            f", which {reason}",
            field=name,
        )

    def _default(self, start: Ints, goal: Ints) -> float:
        """Return a penalty for which the shortest path is free."""
        cells = path_between(self.map, start, goal)
        if not len(cells):
            return 1.0 + sum(self.map.shape)
        line = np.vstack([self.start, self.map.centres(cells), self.goal])
        excess = np.hypot(*np.diff(line, axis=0).T).sum() - np.hypot(*(self.goal - self.start))
        return 1.0 + max(float(excess), 0.0) / self.map.cell


def path_problem(
    grid: GridPath,
    waypoints: int = 5,
    *,
    budget: int = 10_000,
    penalty: float | None = None,
    name: str | None = None,
) -> BlackBoxMinimisation:
    """Return the search for a path with few waypoints on a map as a black box.

    Parameters
    ----------
    grid : GridPath
        Map, start and single goal; its connectivity must be "any".
    waypoints : int
        Number of points at which the path may turn.
    budget : int
        Largest number of evaluations of a run.
    penalty : float, optional
        See :class:`WaypointPath`.
    name : str, optional
        Name of the model; by default that of `grid`.

    Returns
    -------
    BlackBoxMinimisation
        Model with the bounds of the map.

    Raises
    ------
    InvalidData
        `grid` has several goals, or its paths follow neighbours.
    """
    required("grid", grid, GridPath)
    if len(grid.goals) != 1 or grid.connectivity != "any":
        raise InvalidData(
            "grid must have one goal and connectivity 'any', got "
            f"{len(grid.goals)} with connectivity {str(grid.connectivity)!r}",
            field="grid",
        )
    grid_map: GridMap = grid.map
    start, goal = grid_map.centres([grid.start, grid.goals[0]])
    function = WaypointPath(grid_map, start, goal, waypoints, penalty)
    box = np.column_stack(
        [grid_map.origin, grid_map.origin + grid_map.cell * np.array(grid_map.shape[::-1])]
    )
    bounds = np.tile(box, (function.waypoints, 1))
    return BlackBoxMinimisation(function, bounds, budget, name=grid.name if name is None else name)


def as_grid_plan(model: BlackBoxMinimisation, plan: Any) -> GridPlan:
    """Return the path of a point of `model`, for the verification by a ``GridPath``.

    Parameters
    ----------
    model : BlackBoxMinimisation
        Model whose function is a :class:`WaypointPath`.
    plan : BlackBoxPoint, Solution or JSON data
        Plan of the model.

    Returns
    -------
    GridPlan
        The path.

    Raises
    ------
    InvalidData
        The function is not a waypoint path, or the point has another number of variables.
    """
    function = required(
        "function", required("model", model, BlackBoxMinimisation).function, WaypointPath
    )
    x = np.array(required("plan", model.as_plan(plan), BlackBoxPoint).x)
    if x.size != model.dimension:
        raise InvalidData(f"x must have {model.dimension} entries, got {x.size}", field="x")
    return GridPlan((function.polylines(x[None])[0],))


# -- blocked lengths -----------------------------------------------------------------------------


@kernel
def _touch(blocked: Truths, row: int, column: int, to_row: int, to_column: int) -> bool:
    """Return whether two cells touch at the corner of two blocked ones."""
    if abs(row - to_row) != 1 or abs(column - to_column) != 1:
        return False
    return bool(blocked[row, to_column] and blocked[to_row, column])


@kernel
def _pinched(blocked: Truths, x: float, y: float) -> bool:
    """Return whether two blocked cells touch at a point, with two free cells opposite."""
    if x != math.floor(x) or y != math.floor(y):
        return False
    i, j = int(x), int(y)
    if not (0 < i < blocked.shape[1] and 0 < j < blocked.shape[0]):
        return False
    a, b = blocked[j - 1, i - 1], blocked[j, i - 1]
    return bool(a == blocked[j, i] and b == blocked[j - 1, i] and a != b)


@kernel
def _crossing(at: float, step: float) -> float:
    """Return the next line between cells for a coordinate at `at` that moves by `step`."""
    return math.floor(at) + 1.0 if step > 0.0 else math.ceil(at) - 1.0


@kernel(interpretable=True)
def _count_blocked(blocked: Truths, lines: Floats, homes: Ints, found: Floats) -> None:
    """Write the blocked lengths of polylines x, y, shape (m, k, 2), to `found`, in sides of cells.

    The map has a frame of blocked cells, its corner is (1, 1). `homes` are row and column of the free cells at the start
    and at the end.
    """
    right, top = blocked.shape[1] - 1.0, blocked.shape[0] - 1.0
    for line in range(lines.shape[0]):
        total, inside, least = 0.0, 0.0, 0.0
        row, column = homes[0], homes[1]
        for k in range(lines.shape[1] - 1):
            ax, ay = lines[line, k, 0], lines[line, k, 1]
            dx, dy = lines[line, k + 1, 0] - ax, lines[line, k + 1, 1] - ay
            length = math.hypot(dx, dy)
            # Range of the segment within the map, as shares of its length.
            begin, end = 0.0, 1.0
            if dx != 0.0:
                begin = max(begin, min((1.0 - ax) / dx, (right - ax) / dx))
                end = min(end, max((1.0 - ax) / dx, (right - ax) / dx))
            elif not 1.0 <= ax <= right:
                end = 0.0
            if dy != 0.0:
                begin = max(begin, min((1.0 - ay) / dy, (top - ay) / dy))
                end = min(end, max((1.0 - ay) / dy, (top - ay) / dy))
            elif not 1.0 <= ay <= top:
                end = 0.0
            if begin >= end:
                inside += length
                continue
            inside += begin * length
            at = begin
            x_line, y_line = 0.0, 0.0
            x_at, y_at = math.inf, math.inf
            if dx != 0.0:
                x_line = _crossing(ax + begin * dx, dx)
                x_at = (x_line - ax) / dx
            if dy != 0.0:
                y_line = _crossing(ay + begin * dy, dy)
                y_at = (y_line - ay) / dy
            while length > 0.0 and at < end:
                to = min(end, min(x_at, y_at))
                if to > at:
                    x, y = ax + 0.5 * (at + to) * dx, ay + 0.5 * (at + to) * dy
                    j, i = math.floor(y), math.floor(x)
                    if blocked[j, i]:  # on a line between two cells, check the other cell as well
                        if dx == 0.0 and x == math.floor(x):
                            i -= 1
                        elif dy == 0.0 and y == math.floor(y):
                            j -= 1
                    if blocked[j, i]:
                        inside += (to - at) * length
                    else:
                        if _touch(blocked, row, column, j, i):
                            least = 1.0
                        total += max(inside, least)
                        inside, least = 0.0, 0.0
                        row, column = j, i
                    at = to
                if x_at <= at:
                    x_line += 1.0 if dx > 0.0 else -1.0
                    x_at = (x_line - ax) / dx
                if y_at <= at:
                    y_line += 1.0 if dy > 0.0 else -1.0
                    y_at = (y_line - ay) / dy
            inside += (1.0 - end) * length
            if _pinched(blocked, lines[line, k + 1, 0], lines[line, k + 1, 1]):
                least = 1.0
        if _touch(blocked, row, column, homes[2], homes[3]):
            least = 1.0
        found[line] = total + max(inside, least)
