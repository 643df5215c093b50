"""Base of the exact searches along neighbours: the map as arrays, and the answer."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.grid_path.model import Connectivity, GridPath, Reach
from ...models.grid_path.plan import GridPlan
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

__all__ = ["Field", "Found", "NeighbourSearch"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Field:
    """Arrays of a problem for the kernels: a flat map with a blocked frame, and numbers of cells.

    Parameters
    ----------
    problem : GridPath
        Model with connectivity "4" or "8".
    """

    problem: GridPath

    @cached_property
    def walls(self) -> NDArray[np.uint8]:
        """Flat map, 1 if blocked, shape (cells,)."""
        return self.problem.map.walls

    @cached_property
    def width(self) -> int:
        """Number of cells per row, including the frame."""
        return self.problem.map.shape[1] + 2

    @cached_property
    def start(self) -> int:
        """Number of the start."""
        return int(self.problem.map.numbers_of(self.problem.start))

    @cached_property
    def goals(self) -> Ints:
        """Numbers of the goals."""
        return self.problem.map.numbers_of(self.problem.goals)

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


@dataclass(frozen=True)
class Found:
    """Result of one search.

    Parameters
    ----------
    stopped : bool
        Whether the flag stopped the search. The other fields are then undefined.
    costs : ndarray, shape (goals,)
        Costs in cells, infinite without a path. If the search was for the nearest goal, only the
        smallest cost is exact.
    path : callable
        Function that returns the cells of the path to a goal; goals and cells are numbers.
    expanded : int
        Number of expanded cells.
    """

    stopped: bool
    costs: Floats
    path: Callable[[int], Ints]
    expanded: int


class NeighbourSearch(Backend):
    """Base of the exact searches. A subclass implements :meth:`search`.

    The searches are deterministic and solve to a gap of zero.
    """

    accepts = GridPath
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    #: Whether one search serves all goals. Otherwise, each goal has its own search.
    shared = False

    @abstractmethod
    def search(self, field: Field, goals: Ints, every: bool, flag: NDArray[np.int8]) -> Found:
        """Return shortest paths to all of `goals` if `every`, otherwise to the nearest."""

    def refuses(self, problem: GridPath) -> str:
        """Return the feature of a problem that the search does not support, or an empty string."""
        if problem.connectivity is Connectivity.ANY:
            return "connectivity 'any': its paths lead along neighbours"
        return ""

    def run(self, problem: GridPath, request: Request) -> Answer:
        """Return optimal paths, or ``INFEASIBLE`` if a required goal is unreachable."""
        refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(f"backend {self.name!r} does not cover {refusal}")
        begin = clock()
        field = Field(problem)
        every = problem.reach is Reach.EACH
        groups = np.split(field.goals, len(field.goals)) if every and not self.shared else None
        costs: list[float] = []
        paths: list[Ints] = []
        expanded = 0
        for goals in groups or [field.goals]:
            result = self.search(field, goals, every, request.control.flag)
            expanded += result.expanded
            if result.stopped:
                break
            for k in range(len(goals)) if every else [int(np.argmin(result.costs))]:
                costs.append(float(result.costs[k]))
                if np.isfinite(costs[-1]):
                    paths.append(result.path(int(goals[k])))
            if len(paths) < len(costs):
                break
        seconds = {"solve": clock() - begin}
        statistics = {"cells expanded": expanded}
        if len(paths) < len(costs):
            return Answer(Termination.INFEASIBLE, seconds=seconds, statistics=statistics)
        if result.stopped:
            limit = request.control.reason or Limit.INTERRUPTED
            return Answer(Termination.NO_SOLUTION, limit, seconds=seconds, statistics=statistics)
        grid = problem.map
        plan = GridPlan(tuple(grid.centres(grid.cells_at(path)) for path in paths))
        cost = sum(costs) * grid.cell * field.heaviest
        return Answer(
            Termination.OPTIMAL, None, plan, cost, cost, seconds=seconds, statistics=statistics
        )
