"""Paths of many robots on the cells of a grid in unit steps, without conflicts in vertices and swaps.

Each robot is planned on layers of time, with waits inside the map: a layer contains the least number of conflicts with
which a cell can be reached. Robots that are still in conflict are planned again in small groups, in a random order,
as in large neighbourhood search (Li et al., MAPF-LNS2, AAAI 2022).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosstrack.errors import InvalidData
from crosstrack.models.fields import Array, show

__all__ = ["CellPlanner"]

Cells = NDArray[np.int64]
Counts = NDArray[np.int16]

#: Number of robots that are planned again together.
GROUP = 8
#: Cost of cells that cannot be reached; three times the cost fits into the type of the layers.
NEVER = 10_000
#: Steps of time that are reserved per cell of the map's half perimeter.
HORIZON = 6


class CellPlanner:
    """Conflict-free paths of robots that are added one by one.

    Parameters
    ----------
    blocked : ndarray of bool, shape (rows, columns)
        Blocked cells.
    seed : int
        Seed of the groups and orders.

    Examples
    --------
    >>> import numpy as np
    >>> planner = CellPlanner(np.array([[0, 0, 0], [1, 0, 1]], bool))
    >>> for start, goal in (((0, 0), (0, 2)), ((0, 2), (0, 0))):
    ...     planner.add(start, goal)
    >>> planner.solve(lambda: False)
    True
    >>> planner.makespan
    4
    """

    def __init__(self, blocked: Any, seed: int = 0) -> None:
        grid = np.asarray(blocked)
        if grid.ndim != 2 or not grid.size or grid.dtype != bool:
            raise InvalidData(
                f"blocked must be a matrix of Booleans, got {show(blocked)}", field="blocked"
            )
        # Rows are joined to one line; the border separates them.
        padded = np.pad(grid, 1, constant_values=True)
        self.width = padded.shape[1]
        self._free = ~padded.ravel()
        self._wall = np.where(self._free, 0, NEVER).astype(np.int16)
        self._moves = (0, 1, -1, self.width, -self.width)
        self._draw = np.random.default_rng(seed)
        self.ends: list[tuple[int, int]] = []
        self.paths: list[Cells] = []
        self._reserve(HORIZON * sum(grid.shape))

    def _reserve(self, steps: int) -> None:
        """Allocate the reservations of cells and of moves for a number of steps."""
        self.steps = steps
        self._used: Counts = np.zeros((steps + 1, self._free.size), np.int16)
        self._moved: Counts = np.zeros((4, steps, self._free.size), np.int16)

    def _index(self, name: str, cell: Any) -> int:
        row, column = Array((2,), int).coerce(name, cell, {}).tolist()
        rows = self._free.size // self.width - 2
        if not (0 <= row < rows and 0 <= column < self.width - 2):
            raise InvalidData(f"{name} must be a cell of the map, got {show(cell)}", field=name)
        index = int((row + 1) * self.width + column + 1)
        if not self._free[index]:
            raise InvalidData(f"{name} must be a free cell, got {show(cell)}", field=name)
        return index

    def add(self, start: Any, goal: Any) -> None:
        """Add a robot, whose path may be in conflict until :meth:`solve`.

        Parameters
        ----------
        start, goal : (int, int)
            Row and column.

        Raises
        ------
        InvalidData
            A cell is blocked or outside of the map, another robot has the same start or goal, or the goal
            cannot be reached.
        """
        ends = self._index("start", start), self._index("goal", goal)
        for name, side in (("start", 0), ("goal", 1)):
            if ends[side] in {entry[side] for entry in self.ends}:
                raise InvalidData(
                    f"{name} must differ between robots, got {show((start, goal))}", field=name
                )
        path = self._plan(*ends)
        if path is None:
            raise InvalidData(f"goal must be reachable from start, got {show(goal)}", field="goal")
        self.ends.append(ends)
        self.paths.append(path)
        self._mark(path, 1)

    def _mark(self, path: Cells, sign: int) -> None:
        """Add or remove the reservations of a path; the robot stays at its goal."""
        times = np.arange(len(path))
        self._used[times, path] += sign
        self._used[len(path) :, path[-1]] += sign
        for side, step in enumerate(self._moves[1:]):
            moving = np.flatnonzero(np.diff(path) == step)
            self._moved[side, moving, path[moving]] += sign

    def _plan(self, start: int, goal: int) -> Cells | None:
        """Return the path with the fewest conflicts, and the earliest of those."""
        later = np.cumsum(self._used[::-1, goal], dtype=np.int64)[::-1]
        layer = np.full(self._free.size, NEVER, np.int16)
        layer[start] = self._used[0, start]
        layers = [layer]
        best, at = NEVER, -1
        waits = 0
        for time in range(self.steps):
            cost = int(layer[goal]) + int(later[time + 1])
            if cost < best and layer[goal] < NEVER:
                best, at, waits = cost, time, 0
            waits += 1
            if best == 0 or (at >= 0 and waits > len(self.paths) + self.width):
                break
            after = layer.copy()
            for side, step in enumerate(self._moves[1:]):
                # The opposite move out of the cell of arrival is a swap.
                swaps = self._moved[side ^ 1, time]
                if step > 0:
                    np.minimum(after[step:], layer[:-step] + swaps[step:], out=after[step:])
                else:
                    np.minimum(after[:step], layer[-step:] + swaps[:step], out=after[:step])
            after += self._used[time + 1]
            after += self._wall
            np.minimum(after, NEVER, out=after)
            layer = after
            layers.append(layer)
        if at < 0:
            return None
        path = [goal]
        for time in range(at - 1, -1, -1):
            here = path[-1]
            costs = [int(layers[time][here])]
            costs += [
                int(layers[time][here - step]) + int(self._moved[side ^ 1, time, here])
                for side, step in enumerate(self._moves[1:])
            ]
            path.append(here - self._moves[int(np.argmin(costs))])
        return np.array(path[::-1])

    def conflicts(self) -> list[set[int]]:
        """Return the robots in conflict with each robot."""
        long = max(map(len, self.paths), default=1)
        whole = np.array([np.pad(path, (0, long - len(path)), "edge") for path in self.paths])
        result: list[set[int]] = [set() for _ in self.paths]
        for keys in (whole.T, _swaps(whole, self._free.size)):
            for row in keys:
                order = np.argsort(row, kind="stable")
                same = np.flatnonzero((np.diff(row[order]) == 0) & (row[order[1:]] >= 0))
                for one, other in zip(order[same].tolist(), order[same + 1].tolist(), strict=True):
                    result[one].add(other)
                    result[other].add(one)
        return result

    def solve(self, stopped: Callable[[], bool]) -> bool:
        """Remove conflicts until none is left or `stopped` returns True; return whether none is left."""
        conflicts = self.conflicts()
        while any(conflicts):
            if stopped():
                return False
            touched = [k for k, others in enumerate(conflicts) if others]
            seed = touched[int(self._draw.integers(len(touched)))]
            group = [seed, *conflicts[seed]]
            others = self._draw.permutation(len(self.paths))
            group = list(dict.fromkeys([*group, *others[:GROUP].tolist()]))[:GROUP]
            before = [self.paths[k] for k in group]
            for path in before:
                self._mark(path, -1)
            for k in self._draw.permutation(group).tolist():
                again = self._plan(*self.ends[k])
                self.paths[k] = self.paths[k] if again is None else again
                self._mark(self.paths[k], 1)
            result = self.conflicts()
            if sum(map(len, result)) <= sum(map(len, conflicts)):
                conflicts = result
                continue
            for k, path in zip(group, before, strict=True):
                self._mark(self.paths[k], -1)
                self.paths[k] = path
                self._mark(path, 1)
        return True

    @property
    def makespan(self) -> int:
        """Number of steps until the last robot is at its goal."""
        return max(map(len, self.paths), default=1) - 1

    def cells(self) -> list[Cells]:
        """Return rows and columns of each path, shape (steps + 1, 2)."""
        return [np.column_stack(np.divmod(path, self.width)) - 1 for path in self.paths]


def _swaps(whole: Cells, size: int) -> Cells:
    """Return a key of each edge that a robot moves along per step, or different negative numbers for waits."""
    before, after = whole[:, :-1].T, whole[:, 1:].T
    keys = np.minimum(before, after) * size + np.maximum(before, after)
    return np.where(before == after, -1, keys)
