"""Base of the backends for paths in any direction: prepared map, goals and answer."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.grid_path.model import GridPath
from ...models.grid_path.plan import GridPlan
from ...models.grid_path.sight import SLACK, Sight, convex_corners, sees
from ..contract.backend import Answer, Backend, Guarantee, Limit, Request, Termination

__all__ = ["AnyDirection", "Ground", "Leg", "line_tables"]

Floats = NDArray[np.float64]

#: Relative difference of sums of the same lengths, in cells and in metres.
ROUNDING = 1e-9


def line_tables(
    blocked: NDArray[np.bool_], corners: NDArray[np.int8]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the runs of cells and the next corners of each line of a padded map, for :func:`.any_angle.search`.

    The runs, shape (2, rows, columns + 1), are the first column of the run of free cells that contains
    each cell, -1 for blocked cells, and the first column after the run of cells in the same state. The
    second result, shape (rows, columns + 1), is the column of the next corner of a line from each column
    on, or `columns`.
    """
    rows, columns = blocked.shape
    place = np.arange(columns + 1, dtype=np.int32)
    runs = np.full((2, rows, columns + 1), columns, np.int32)
    differs = blocked[:, 1:] != blocked[:, :-1]
    first, beyond = runs[0, :, :columns], runs[1, :, :columns]
    first[:, 0] = 0
    first[:, 1:] = np.where(differs, place[1:columns], 0)
    np.maximum.accumulate(first, axis=1, out=first)
    first[blocked] = -1
    beyond[:, :-1] = np.where(differs, place[1:columns], columns)
    beyond[:] = np.minimum.accumulate(beyond[:, ::-1], axis=1)[:, ::-1]
    onward = np.full((rows, columns + 1), columns, np.int32)
    onward[:, :columns] = np.where(corners > 0, place[:columns], columns)
    onward[:] = np.minimum.accumulate(onward[:, ::-1], axis=1)[:, ::-1]
    return runs, onward


@dataclass
class Leg:
    """Result of a search for a path to one goal.

    `path` has points x, y in cells of the padded map, shape (k, 2); None without a path. `bound` is a
    lower bound on the length of every path, in cells; infinite is a proof that no path exists.
    """

    path: Floats | None
    bound: float = 0.0
    stopped: bool = False

    @property
    def length(self) -> float:
        """Length of the path in cells, infinite without a path."""
        if self.path is None:
            return math.inf
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum())


class Ground:
    """Problem with connectivity "any" in cells of the padded map; the control of `request` receives incumbents."""

    def __init__(self, problem: GridPath, request: Request) -> None:
        self.problem, self.request = problem, request
        self.statistics: dict[str, float | int | str] = {}
        self.sight = Sight(problem.map)
        self.start: Floats = problem.start[::-1].astype(np.float64) + 1.5
        self.goals: Floats = problem.goals[:, ::-1].astype(np.float64) + 1.5
        self.rng = np.random.default_rng(request.seed or 0)
        self.offered = math.inf

    @cached_property
    def corners(self) -> NDArray[np.int8]:
        """Corners at which shortest paths may turn, shape (rows + 2, columns + 2)."""
        return convex_corners(self.sight.blocked)

    @cached_property
    def tables(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Result of :func:`line_tables`."""
        return line_tables(self.sight.blocked, self.corners)

    def plan(self, paths: list[Floats]) -> GridPlan:
        """Return the plan of paths given in cells."""
        return GridPlan(tuple(self.sight.metres(path) for path in paths))

    def offer(self, path: Floats) -> None:
        """Report a path as the incumbent if it is the shortest so far and the plan has one path."""
        if self.problem.reach == "nearest" or len(self.goals) == 1:
            plan = self.plan([path])
            if plan.length < self.offered:
                self.offered = plan.length
                self.request.control.incumbent(plan.length, plan)

    def sees(self, a: Floats, b: Floats) -> bool:
        """Return whether a segment between centres, in cells, stays in free cells."""
        (ax, ay), (bx, by) = a.tolist(), b.tolist()
        return bool(sees(self.sight.blocked, ax, ay, bx, by, SLACK))

    def count(self, name: str, more: int) -> None:
        """Add `more` to the statistic `name`."""
        self.statistics[name] = int(self.statistics.get(name, 0)) + int(more)


class AnyDirection(Backend):
    """Base of the backends for paths in any direction. A subclass implements :meth:`leg`."""

    accepts = GridPath
    deterministic = True
    single_threaded = True

    @abstractmethod
    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search for a path to a goal (x, y in cells) that is shorter than `ceiling` (cells).

        :meth:`run` calls it only if the start has no line of sight to the goal.
        """

    def refuses(self, problem: GridPath) -> str:
        """Return the reason to refuse a problem with paths along neighbours, or an empty string."""
        if problem.connectivity != "any":
            return f"connectivity {str(problem.connectivity)!r}: paths may lead in any direction"
        return ""

    def run(self, problem: GridPath, request: Request) -> Answer:
        """Search for each goal, or for the nearest with the shortest length so far as the ceiling."""
        self.require_support(problem)
        begin = clock()
        ground = Ground(problem, request)
        each = problem.reach == "each"
        straight = np.hypot(*(ground.goals - ground.start).T)
        bounds = straight.copy()
        legs: dict[int, Leg] = {}
        best = math.inf
        for k in range(len(bounds)) if each else np.argsort(straight, kind="stable").tolist():
            if request.control.stopped:
                break
            ceiling = math.inf if each else best
            if straight[k] >= ceiling:
                break  # the remaining goals are farther away
            legs[k] = leg = self._leg(ground, ground.goals[k], ceiling, request)
            bounds[k] = leg.bound
            best = min(best, leg.length)
            if each and leg.path is None:
                break
        seconds = {"solve": clock() - begin}
        paths = {k: leg.path for k, leg in legs.items() if leg.path is not None}
        stopped = request.control.stopped or any(leg.stopped for leg in legs.values())
        limit = (request.control.reason or Limit.INTERRUPTED) if stopped else None
        bound = float(bounds.sum() if each else bounds.min()) * problem.map.cell
        exact = self.guarantee is Guarantee.EXACT
        common: dict[str, Any] = {"seconds": seconds, "statistics": dict(ground.statistics)}
        if len(paths) < (len(bounds) if each else 1):
            if exact and math.isinf(bound):
                return Answer(Termination.INFEASIBLE, **common)
            return Answer(
                Termination.NO_SOLUTION, limit, dual_bound=bound if exact else None, **common
            )
        chosen = range(len(bounds)) if each else [min(paths, key=lambda k: legs[k].length)]
        plan = ground.plan([paths[k] for k in chosen])
        if not exact:
            return Answer(Termination.FEASIBLE, limit, plan, plan.length, **common)
        if bound >= plan.length * (1.0 - ROUNDING):  # optimal even if a stop arrived at the end
            return Answer(Termination.OPTIMAL, None, plan, plan.length, plan.length, **common)
        return Answer(Termination.FEASIBLE, limit, plan, plan.length, bound, **common)

    def _leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Return the straight segment if it is a line of sight, otherwise search."""
        if (goal == ground.start).all():
            return Leg(ground.start[None], 0.0)
        if ground.sees(ground.start, goal):
            return Leg(np.stack([ground.start, goal]), float(np.hypot(*(goal - ground.start))))
        return self.leg(ground, goal, ceiling, request)
