"""What the exact searches along neighbours share: the map as arrays, and the answer's form."""

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
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

__all__ = ["Field", "Found", "NeighbourSearch"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Field:
    """A problem as the kernels want it: numbers of cells on a flat map with a blocked frame.

    Parameters
    ----------
    problem : GridPath
        Connectivity "4" or "8".
    """

    problem: GridPath

    @cached_property
    def walls(self) -> NDArray[np.uint8]:
        """1 where blocked."""
        return self.problem.map.walls

    @cached_property
    def width(self) -> int:
        """Cells of a row, the frame included."""
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
        """Weights, 1 for the frame; those of free cells are at most 1."""
        assert self.problem.weights is not None
        scaled = np.minimum(self.problem.weights / self.heaviest, 1.0)
        return np.pad(scaled, 1, constant_values=1.0).ravel()

    @cached_property
    def heaviest(self) -> float:
        """The largest weight of a free cell."""
        weights = self.problem.weights
        return 1.0 if weights is None else float(weights[~self.problem.map.blocked].max())

    @property
    def diagonal(self) -> bool:
        """Whether steps may be diagonal."""
        return self.problem.connectivity is Connectivity.EIGHT


@dataclass(frozen=True)
class Found:
    """What one search found.

    Parameters
    ----------
    stopped : bool
        Whether it was stopped from outside, and the rest means nothing.
    costs : ndarray, shape (goals,)
        In cells; infinite where there is no path. Only the least is right where the nearest goal
        was wanted.
    path : callable
        Gives the numbers of the cells to a goal, by its number.
    expanded : int
        How often a cell was expanded.
    """

    stopped: bool
    costs: Floats
    path: Callable[[int], Ints]
    expanded: int


class NeighbourSearch(Backend):
    """Base of the exact searches; a subclass only searches.

    They are deterministic, so that every seed gives the same plan, and solve to a gap of zero.
    """

    accepts = GridPath
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    #: Whether one search reaches many goals as fast as one; else each has a search of its own.
    shared = False

    @abstractmethod
    def search(self, field: Field, goals: Ints, every: bool, flag: NDArray[np.int8]) -> Found:
        """Return shortest paths to all of `goals`, or to the nearest."""

    def refuses(self, problem: GridPath) -> str:
        """Return what no search along neighbours covers."""
        if problem.connectivity is Connectivity.ANY:
            return "connectivity 'any': its paths lead along neighbours"
        return ""

    def run(self, problem: GridPath, request: Request) -> Answer:
        """Search, and answer with the paths or that a goal cannot be reached."""
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
            found = self.search(field, goals, every, request.control.flag)
            expanded += found.expanded
            if found.stopped:
                break
            for k in range(len(goals)) if every else [int(np.argmin(found.costs))]:
                costs.append(float(found.costs[k]))
                if np.isfinite(costs[-1]):
                    paths.append(found.path(int(goals[k])))
            if len(paths) < len(costs):
                break
        seconds = {"solve": clock() - begin}
        statistics = {"cells expanded": expanded}
        if len(paths) < len(costs):
            return Answer(Termination.INFEASIBLE, seconds=seconds, statistics=statistics)
        if found.stopped:
            limit = request.control.reason or Limit.INTERRUPTED
            return Answer(Termination.NO_SOLUTION, limit, seconds=seconds, statistics=statistics)
        grid = problem.map
        plan = GridPlan(tuple(grid.centres(grid.cells_at(path)) for path in paths))
        cost = sum(costs) * grid.cell * field.heaviest
        return Answer(
            Termination.OPTIMAL, None, plan, cost, cost, seconds=seconds, statistics=statistics
        )
