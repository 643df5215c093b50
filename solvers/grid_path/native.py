"""Base of the exact searches along neighbours: the map as arrays, a first plan, and the answer."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime, clock
from ...models.grid_path.model import Connectivity, GridPath, Reach
from ...models.grid_path.plan import GridPlan
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

__all__ = ["LARGE", "Field", "NeighbourSearch", "Search"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

#: Number of cells above which a run with a time limit starts with a quick search for a first plan, and
#: the largest share of the time for it. The exact searches take about 2 ms at this size.
LARGE, FIRST = 40_000, 0.3


class Field:
    """Arrays of a problem for the kernels: a flat map with a blocked frame, and numbers of cells."""

    def __init__(self, problem: GridPath) -> None:
        grid = problem.map
        self.problem, self.walls, self.width = problem, grid.walls, grid.shape[1] + 2
        self.start = int(grid.numbers_of(problem.start))
        self.goals: Ints = grid.numbers_of(problem.goals)

    @cached_property
    def weights(self) -> Floats:
        """Weights divided by `heaviest`, shape (cells,); 1 for the frame."""
        assert self.problem.weights is not None
        scaled = np.minimum(self.problem.weights / self.heaviest, 1.0)
        return np.pad(scaled, 1, constant_values=1.0).ravel()

    @cached_property
    def heaviest(self) -> float:
        """Largest weight of a free cell, 1 without weights."""
        weights = self.problem.weights
        return 1.0 if weights is None else float(weights[~self.problem.map.blocked].max())

    @property
    def diagonal(self) -> bool:
        """Whether steps may be diagonal."""
        return self.problem.connectivity is Connectivity.EIGHT

    def straight(self) -> Floats:
        """Lower bounds on the costs of the goals from their distances, shape (goals,)."""
        apart = np.abs(self.problem.goals - self.problem.start)
        low, high = apart.min(axis=1), apart.max(axis=1)
        cells = high + (np.sqrt(2.0) - 1.0) * low if self.diagonal else high + low
        if self.problem.weights is None:
            return np.asarray(cells, float)
        return np.asarray(cells * self.weights[self.walls == 0].min())

    def plan(self, paths: list[Ints]) -> GridPlan:
        """Return the plan of paths of cell numbers."""
        grid = self.problem.map
        return GridPlan(tuple(grid.centres(grid.cells_at(path)) for path in paths))

    def first_plan(self, request: Request) -> tuple[float, GridPlan] | None:
        """Return the cost and a plan by greedy searches and report it, or None if the share of the time ends.

        An unreachable goal also gives None, because the exact search proves it.
        """
        from .heap_kernels import back, greedy

        every = self.problem.reach is Reach.EACH
        assert request.time_limit is not None
        paths = []
        with request.control.stage(FIRST * request.time_limit) as stage:
            for goals in np.split(self.goals, len(self.goals)) if every else [self.goals]:
                _, goal, parents = greedy(
                    self.walls, self.width, self.start, goals, self.diagonal, stage.flag
                )
                if goal < 0:
                    return None
                paths.append(back(parents, goal))
        plan = self.plan(paths)
        cost = self.problem.verify(plan).objective
        assert cost is not None
        request.control.incumbent(cost, plan)
        return cost, plan


@dataclass(frozen=True)
class Search:
    """Result of one search; its paths are undefined if it was `stopped`.

    `costs`, in cells, are those of the goals, infinite without a path. If the search was for the nearest
    goal, only the smallest is exact. If it was stopped, costs below `bound` are exact, and `bound` is a
    lower bound on the others. `path` returns the cells of the path to a goal; goals and cells are
    numbers.
    """

    stopped: bool
    costs: Floats
    bound: float
    path: Callable[[int], Ints]
    expanded: int


class NeighbourSearch(Backend):
    """Base of the exact searches. A subclass implements :meth:`search`.

    The searches are deterministic and solve to a gap of zero. On large maps, a run with a time limit begins
    with greedy searches, whose plan is the answer if the limit stops the exact search.
    """

    accepts = GridPath
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    #: Whether one search serves all goals. Otherwise, each goal has its own search.
    shared = False

    @abstractmethod
    def search(self, field: Field, goals: Ints, every: bool, flag: NDArray[np.int8]) -> Search:
        """Return shortest paths to all of `goals` if `every`, otherwise to the nearest."""

    def refuses(self, problem: GridPath) -> str:
        """Return the feature of a problem that the search does not support, or an empty string."""
        if problem.connectivity is Connectivity.ANY:
            return "connectivity 'any': its paths lead along neighbours"
        return ""

    def run(self, problem: GridPath, request: Request) -> Answer:
        """Return optimal paths, or ``INFEASIBLE`` if a required goal is unreachable."""
        self.require_support(problem)
        begin = clock()
        field = Field(problem)
        first = None
        if request.time_limit is not None and field.walls.size > LARGE:
            # The exact search may be compiled or interpreted in time if the greedy one is not.
            with suppress(OutOfTime):
                first = field.first_plan(request)
        every = problem.reach is Reach.EACH
        count = len(field.goals)
        groups = np.split(np.arange(count), count if every and not self.shared else 1)
        bounds = field.straight()
        paths: list[Ints] = []
        expanded = 0
        for group in groups:
            result = self.search(field, field.goals[group], every, request.control.flag)
            expanded += result.expanded
            if result.stopped:
                open_bounds = np.minimum(result.costs, result.bound)
                bounds[group] = np.maximum(bounds[group], open_bounds)
                break
            bounds[group] = result.costs
            ends = group if every else group[[np.argmin(result.costs)]]
            if not np.isfinite(bounds[ends]).all():
                break
            paths += [result.path(int(field.goals[k])) for k in ends]
        bound = float(bounds.sum() if every else bounds.min()) * problem.map.cell * field.heaviest
        common: dict[str, Any] = {
            "seconds": {"solve": clock() - begin}, "statistics": {"cells expanded": expanded},
        }  # fmt: skip
        if result.stopped:
            limit = request.control.reason or Limit.INTERRUPTED
            if first is None:
                return Answer(Termination.NO_SOLUTION, limit, dual_bound=bound, **common)
            cost, plan = first
            return Answer(Termination.FEASIBLE, limit, plan, cost, bound, **common)
        if not np.isfinite(bound):
            return Answer(Termination.INFEASIBLE, **common)
        return Answer(Termination.OPTIMAL, None, field.plan(paths), bound, bound, **common)
