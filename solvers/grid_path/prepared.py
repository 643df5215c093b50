"""Maps prepared for many queries: verified shortest paths and distances, and changes of cells.

:func:`crosstrack.solve` builds a model, copies the map for the search and records the run, which takes many times
the time of a short search. Here the arrays of the searches are allocated once, and the work of a query
grows with the search and the path only.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import jit
from ...errors import InvalidData, UnsupportedOption
from ...models.grid_path.checks import DIGITS, length_along
from ...models.grid_path.gridmap import GridMap
from ...models.grid_path.model import Connectivity, GridPath, Reach
from ...models.grid_path.plan import GridPlan
from ...models.grid_path.search_kernels import CEILING, DIAGONAL, STRAIGHT, sweep_in, trace_in
from ...models.records import Member
from ...models.verification import TOLERANCE, Verification
from ..contract.backend import Request, Termination
from .any_angle import AnyAngle
from .changing import ChangingMap
from .heap_kernels import back, weighted
from .jump_kernels import jump_in
from .query_kernels import points_along, repair

__all__ = ["PathAnswer", "PreparedMap", "prepare_map"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

#: Number of distance fields that are kept.
FIELDS = 8
#: Shares of the cells that may lose their distance in a repair, and that may change before it. On maps of 66,000
#: to 262,000 cells, a repair takes 7 to 12 times the share of lost cells, relative to a new search, and a quarter
#: of a new search for 0.04 to 0.15 % of changed cells.
SHARE, CHANGED = 0.05, 0.002
#: Largest ceiling of a search, whose remainders are integers of 8 bytes.
LARGEST = 2**62
#: Cost, turns and expanded cells of a search without a path.
NOTHING: tuple[float, Ints, int] = (math.inf, np.empty(0, np.int64), 0)
#: Largest relative difference between the cost of a search and that of the verification.
SAME = 1e-9
_CONNECTIVITY, _REACH = Member(Connectivity), Member(Reach)


@dataclass(frozen=True, eq=False, repr=False)
class PathAnswer:
    """Answer to one query of a prepared map.

    Attributes
    ----------
    termination : Termination
        ``"optimal"``: the plan is verified and has the lowest cost. ``"infeasible"``: no path exists.
        ``"rejected"``: the verification found an error of the search, and no plan is returned.
    plan : GridPlan or None
        One path, or one per goal.
    objective : float
        Cost of the plan, computed by the verification, m; infinite without a plan.
    expanded : int
        Cells that the search expanded.
    seconds : float
        Time of the query, s.
    """

    termination: Termination
    plan: GridPlan | None
    objective: float
    expanded: int
    seconds: float
    _posed: Callable[[], GridPath]

    @property
    def ok(self) -> bool:
        """Whether the answer has a verified plan."""
        return self.plan is not None

    def verification(self, tolerance: float = TOLERANCE) -> Verification | None:
        """Return the checks of the plan on the present map as a :class:`GridPath`; None without a plan.

        After a change of cells, the answer of an earlier query may violate them.

        Parameters
        ----------
        tolerance : float
            Largest accepted violation, relative to the scale of each check.

        Raises
        ------
        InvalidData
            A change blocked the start or a goal.
        """
        return None if self.plan is None else self._posed().verify(self.plan, tolerance=tolerance)

    def __repr__(self) -> str:
        return f"<PathAnswer {self.termination}: {self.objective:.10g} m, {self.seconds:.3g} s>"


class PreparedMap:
    """Map that answers many queries and follows changes of its cells; created by :func:`crosstrack.prepare`.

    Calls from several threads run one after another.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.
    weights : array_like, shape (rows, columns), optional
        Cost per metre in each cell, > 0, see :class:`GridPath`.
    radius : float, default 0
        Radius of the robot, m. Cells nearer than it to a blocked cell are blocked, as by
        :meth:`GridMap.inflated`.

    Raises
    ------
    InvalidData
        The weights or the radius are invalid, or the radius leaves no cell free.
    """

    def __init__(
        self, grid: GridMap, weights: ArrayLike | None = None, radius: float = 0.0
    ) -> None:
        jit.compile_always()
        self._state = ChangingMap(grid, radius)
        present = self._state.map
        free = np.argwhere(~present.blocked)[0]
        self._weights = GridPath(present, free, free, weights=weights).weights  # type: ignore[arg-type]
        self._costs = np.empty((0, 0)) if self._weights is None else self._weights
        self._grid, self._width = grid, self._state.width
        self._corner = grid.origin.copy()
        noise = DIGITS * (np.abs(grid.origin).max() + grid.cell * max(grid.shape)) / grid.cell
        self._accepted = TOLERANCE + float(noise)
        cells = self._state.walls.size
        self._left, self._parents = np.zeros(cells, np.int64), np.zeros(cells, np.int64)
        self._ways = np.zeros((2, cells), np.uint8)
        self._ceiling, self._step = 0, 2 * cells * DIAGONAL
        self._flag, self._lock = np.zeros(1, np.int8), threading.RLock()
        self._fields: OrderedDict[tuple[int, bool], tuple[Ints, list[Ints]]] = OrderedDict()

    def __repr__(self) -> str:
        rows, columns = self._grid.shape
        return f"<PreparedMap {rows} × {columns} cells of {self._grid.cell:g} m>"

    @property
    def map(self) -> GridMap:
        """The present map, including the radius."""
        with self._lock:
            return self._state.map

    def path(
        self,
        start: ArrayLike,
        goals: ArrayLike,
        *,
        connectivity: str = Connectivity.EIGHT,
        reach: str = Reach.NEAREST,
    ) -> PathAnswer:
        """Return a shortest path, verified on the present map.

        Parameters
        ----------
        start, goals : array_like of int, shape (2,), or (k, 2) for goals
            Rows and columns of free cells.
        connectivity : {"8", "4", "any"}
            Allowed steps, see :class:`Connectivity`. Maps with weights refuse "any".
        reach : {"nearest", "each"}
            Whether to reach the goal of lowest cost, or each.

        Raises
        ------
        InvalidData
            A cell is blocked or outside the map, or an option is invalid.
        """
        begin = time.perf_counter()
        kind, each = connectivity, reach is Reach.EACH
        if type(kind) is not Connectivity:
            kind = _CONNECTIVITY.coerce("connectivity", connectivity, {})
        if type(reach) is not Reach:
            each = _REACH.coerce("reach", reach, {}) is Reach.EACH

        def posed() -> GridPath:
            cells = self._grid.cells_at(np.array([first, *ends]))
            return GridPath(self.map, cells[0], cells[1:], kind, reach, self._weights)

        with self._lock:
            (first,) = self._state.numbers_of("start", start)
            ends = self._state.numbers_of("goals", goals)
            if kind is Connectivity.ANY:
                status, plan, cost, count = self._any(posed())
            else:
                groups = [[end] for end in ends] if each else [ends]
                status, plan, cost, count = self._along(first, groups, kind is Connectivity.EIGHT)
        return PathAnswer(status, plan, cost, count, time.perf_counter() - begin, posed)

    def _along(
        self, first: int, groups: list[list[int]], diagonal: bool
    ) -> tuple[Termination, GridPlan | None, float, int]:
        """Return verified paths to the nearest goal of each group, their cost, and the expanded cells."""
        search = self._search if self._weights is None else self._search_weighted
        paths: list[Floats] = []
        total, count = 0.0, 0
        for group in groups:
            joined = [goal for goal in group if self._state.are_joined(first, goal)]
            cost, turns, expanded = NOTHING
            if joined:
                cost, turns, expanded = search(first, np.array(joined), diagonal)
            count += expanded
            if not turns.size:
                if joined:
                    self._state.number_components()
                return Termination.INFEASIBLE, None, math.inf, count
            points = points_along(turns, self._width, self._grid.cell, self._corner)
            goal, length = int(turns[-1]), -1.0
            if goal in group:
                ends = np.array([divmod(first, self._width), divmod(goal, self._width)]) - 1
                length = length_along(
                    self._state.blocked, self._costs, points, self._corner, self._grid.cell, ends,
                    diagonal, self._accepted,
                )  # fmt: skip
            if not (length >= 0.0 and abs(length - cost) <= SAME * cost):
                return Termination.REJECTED, None, math.inf, count
            paths.append(points)
            total += length * self._grid.cell
        return Termination.OPTIMAL, GridPlan(tuple(paths)), total, count

    def _search(self, first: int, goals: Ints, diagonal: bool) -> tuple[float, Ints, int]:
        """Return the cost of a shortest path in cells, its turns, empty without a path, and the expanded cells."""
        field = self._fields.get((first, diagonal))
        if field is not None and not field[1]:
            left, goal = field[0], int(goals[np.argmax(field[0][goals])])
            if left[goal] == 0:
                return NOTHING
            turns = trace_in(self._state.walls, self._width, left, CEILING, goal, diagonal)
            return (CEILING - int(left[goal])) / STRAIGHT, turns, 0
        # A new ceiling above all former remainders marks every cell as unvisited.
        self._ceiling += self._step
        if self._ceiling + self._step > LARGEST:
            self._left[:], self._ceiling = 0, self._step
        walls, width, left, ceiling = self._state.walls, self._width, self._left, self._ceiling
        if diagonal:
            _, goal, cost, expanded = jump_in(
                walls, left, self._parents, self._ways, ceiling, width, first, goals, self._flag
            )
            turns = back(self._parents, goal) if goal >= 0 else NOTHING[1]
            return cost / STRAIGHT, turns, expanded
        _, expanded, _ = sweep_in(
            walls, left, ceiling, width, first, goals, False, False, True, self._flag
        )
        goal = int(goals[np.argmax(left[goals])])
        cost = ceiling - int(left[goal])
        reached = cost < self._step // 2
        turns = trace_in(walls, width, left, ceiling, goal, False) if reached else NOTHING[1]
        return cost / STRAIGHT, turns, expanded

    def _search_weighted(self, first: int, goals: Ints, diagonal: bool) -> tuple[float, Ints, int]:
        """Return the result of :meth:`_search` with weights."""
        heaviest, scaled = self._scaled
        _, costs, parents, expanded, _ = weighted(
            self._state.walls, scaled, self._width, first, goals, False, diagonal, True, self._flag
        )
        goal = goals[np.argmin(costs[goals])]
        turns = back(parents, goal) if costs[goal] < np.inf else NOTHING[1]
        return float(costs[goal]) * heaviest, turns, expanded

    @cached_property
    def _scaled(self) -> tuple[float, Floats]:
        """The largest weight of a free cell, and the weights relative to it on the framed map."""
        heaviest = float(self._costs[~self._state.blocked].max())
        scaled = np.minimum(self._costs / heaviest, 1.0)
        return heaviest, np.pad(scaled, 1, constant_values=1.0).ravel()

    def _any(self, model: GridPath) -> tuple[Termination, GridPlan | None, float, int]:
        """Return a shortest path in any direction, verified by the model."""
        answer = AnyAngle().run(model, Request())
        count = int(answer.statistics.get("corners settled", 0))
        if answer.point is None:
            return Termination.INFEASIBLE, None, math.inf, count
        verification = model.verify(answer.point)
        if not verification.ok or verification.objective is None:
            return Termination.REJECTED, None, math.inf, count
        return Termination.OPTIMAL, answer.point, verification.objective, count

    def distances(self, start: ArrayLike, *, connectivity: str = "8") -> Floats:
        """Return the lengths of shortest paths from a cell to all cells.

        The last fields are kept, without weights. After changes of cells they are repaired if few cells
        lose their path. Queries from their starts need no search.

        Parameters
        ----------
        start : array_like of int, shape (2,)
            Row and column of a free cell.
        connectivity : {"8", "4"}
            Allowed steps.

        Returns
        -------
        ndarray, shape (rows, columns)
            Lengths, m; costs with weights. They are infinite at blocked and unreachable cells.

        Raises
        ------
        InvalidData
            The cell is blocked or outside the map, or the connectivity is "any" or invalid.
        """
        kind = _CONNECTIVITY.coerce("connectivity", connectivity, {})
        if kind is Connectivity.ANY:
            raise InvalidData(
                "connectivity must be '4' or '8' for distances, got 'any'", field="connectivity"
            )
        with self._lock:
            (first,) = self._state.numbers_of("start", start)
            lengths = self._distances(first, kind is Connectivity.EIGHT) * self._grid.cell
        return lengths.reshape(-1, self._width)[1:-1, 1:-1]

    def _distances(self, first: int, diagonal: bool) -> Floats:
        """Return the costs of all cells of the framed map, in cells."""
        # The corner of the frame as the goal is never reached, so the searches reach all cells.
        nowhere, width = np.zeros(1, np.int64), self._width
        how = (first, nowhere, True, diagonal, False, self._flag)
        if self._weights is not None:
            heaviest, scaled = self._scaled
            costs: Floats = weighted(self._state.walls, scaled, width, *how)[1] * heaviest
            return costs
        left, pending = self._fields.pop((first, diagonal), (None, []))
        if left is not None and pending:
            changed, most = np.unique(np.concatenate(pending)), int(SHARE * left.size)
            if repair(self._state.walls, width, left, changed, first, diagonal, most) < 0:
                left = None
        if left is None:
            left = np.zeros(self._state.walls.size, np.int64)
            sweep_in(self._state.walls, left, CEILING, width, *how)
        self._fields[first, diagonal] = left, []
        if len(self._fields) > FIELDS:
            self._fields.popitem(last=False)
        return np.where(left > 0, (CEILING - left) / STRAIGHT, np.inf)

    def change(self, cells: ArrayLike, blocked: ArrayLike) -> int:
        """Block or free cells; later queries use the new map.

        Parameters
        ----------
        cells : array_like of int, shape (2,) or (k, 2)
            Rows and columns of cells inside the map. The last state of a repeated cell counts.
        blocked : bool or array_like of bool, shape (k,)
            New state of each cell.

        Returns
        -------
        int
            Number of cells whose state differs, including cells within the radius.

        Raises
        ------
        InvalidData
            A cell is outside the map, a state is not Boolean, or no cell would be free. The map is
            unchanged.
        """
        with self._lock:
            numbers = self._state.change(cells, blocked)
            self.__dict__.pop("_scaled", None)
            for key, (left, pending) in list(self._fields.items()):
                if len(numbers):
                    pending.append(numbers)
                if sum(map(len, pending)) > CHANGED * left.size:
                    del self._fields[key]
        return len(numbers)


def prepare_map(model: GridMap | GridPath, **options: Any) -> PreparedMap:
    """Prepare a map, or the map and weights of a model; refuse other options than weights and radius."""
    refused = [name for name in options if name not in ("weights", "radius")]
    if refused:
        raise UnsupportedOption(
            f"prepare accepts the options weights and radius for a map, got {', '.join(refused)}"
        )
    if isinstance(model, GridPath):
        return PreparedMap(model.map, **{"weights": model.weights, **options})
    return PreparedMap(model, **options)
