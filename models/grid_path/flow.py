"""A minimum-cost flow that is a shortest path: a column for each step between neighbours.

A unit leaves the start for each path that is wanted, and what arrives at a cell leaves it, but for
what ends there. Rows are those of a network, so that every vertex of the program is whole and no
column need be integral; where several paths are equally short a point may mix them, and
:meth:`FlowFormulation.decode` takes a shortest one among the steps that carry flow.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ..fields import required
from ..formulation import Formulation
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .model import Connectivity, GridPath, Reach
from .plan import GridPlan

__all__ = ["FlowFormulation"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

#: Free cells that a map may have at the most.
MOST = 20_000
#: Flow that counts as one; a path mixed of many still carries more.
LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class FlowFormulation(Formulation[GridPath, GridPlan]):
    """A unit of flow along neighbours for each path.

    Parameters
    ----------
    model : GridPath
        The model, with connectivity "4" or "8".

    Raises
    ------
    UnsupportedFormulation
        The model allows any direction, or has more than 20,000 free cells.
    """

    name: ClassVar[str] = "flow"
    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram
    summary: ClassVar[str] = "minimum-cost flow along neighbours, a linear program"

    def __post_init__(self) -> None:
        if self.model.connectivity is Connectivity.ANY:
            raise UnsupportedFormulation(
                "formulation 'flow' leads along neighbours, but the model has connectivity 'any'; "
                "set it to '8' or '4', or use a native backend"
            )
        if len(self._free) > MOST:
            raise UnsupportedFormulation(
                f"formulation 'flow' takes at most {MOST} free cells, the map has {len(self._free)}; "
                "use a native backend"
            )

    @cached_property
    def _free(self) -> Ints:
        """Rows and columns of the free cells, shape (n, 2)."""
        return np.argwhere(~self.model.map.blocked)

    @cached_property
    def _number(self) -> Ints:
        """The place of each cell among the free ones, -1 where blocked or in the frame of the map."""
        found = np.full(np.add(self.model.map.shape, 2), -1)
        found[tuple((self._free + 1).T)] = np.arange(len(self._free))
        return found

    @cached_property
    def _arcs(self) -> tuple[Ints, Ints, Floats]:
        """Tails and heads, among the free cells in order of both, and costs (m) of all steps."""
        model, at, number = self.model, self._free + 1, self._number
        tails, heads, costs = [], [], []
        weights = np.ones(len(at))
        if model.weights is not None:
            weights = model.weights[tuple(self._free.T)]
        for step in np.argwhere(np.ones((3, 3))) - 1:
            turned = abs(step).sum() == 2
            if not step.any() or (turned and model.connectivity is Connectivity.FOUR):
                continue
            to = number[tuple((at + step).T)]
            beside = [number[tuple((at + step * axis).T)] >= 0 for axis in ((0, 1), (1, 0))]
            (tail,) = np.nonzero((to >= 0) & beside[0] & beside[1])
            tails.append(tail)
            heads.append(to[tail])
            length = float(np.hypot(*step)) * model.map.cell
            costs.append(length * 0.5 * (weights[tail] + weights[to[tail]]))
        order = np.lexsort((np.concatenate(heads), np.concatenate(tails)))
        tail, head, cost = (np.concatenate(one)[order] for one in (tails, heads, costs))
        return tail, head, cost

    @cached_property
    def _goals(self) -> tuple[Ints, Ints]:
        """Different goals among the free cells, and how often each is named."""
        at = self._number[tuple((self.model.goals + 1).T)]
        found = np.unique(at, return_counts=True)
        return found[0], found[1]

    @property
    def _start(self) -> int:
        return int(self._number[tuple(self.model.start + 1)])

    def build(self) -> MixedIntegerProgram:
        """Return the program described at the head of this module."""
        free, (tail, head, cost), (goals, times) = self._free, self._arcs, self._goals
        each = self.model.reach is Reach.EACH
        b = ProgramBuilder()
        x = b.columns(
            "step",
            len(tail),
            cost=cost,
            template="from {0}, {1} to {2}, {3}",
            index=np.hstack([free[tail], free[head]]),
        )
        y = b.columns(
            "end",
            len(goals),
            lower=times if each else 0,
            upper=times if each else 1,
            template="at {0}, {1}",
            index=free[goals],
        )
        supply = np.zeros(len(free))
        supply[self._start] = times.sum() if each else 1
        b.rows(
            "what arrives leaves or ends",
            len(free),
            (tail, x, 1.0),
            (head, x, -1.0),
            (goals, y, 1.0),
            lower=supply,
            upper=supply,
            template="at {0}, {1}",
            index=free,
        )
        return b.build(name=f"{self.model.name}:flow" if self.model.name else "flow")

    def encode(self, plan: GridPlan) -> Floats:
        """Return how many paths take each step and end at each goal."""
        required("plan", plan, GridPlan)
        (tail, head, _), (goals, _) = self._arcs, self._goals
        flow, ends = np.zeros(len(tail)), np.zeros(len(goals))
        size = len(self._free)
        for k, path in enumerate(plan.paths):
            cells = self.model.map.cells_of(path)
            if not self.model.map.holds(cells).all():
                raise InvalidData(f"paths[{k}] leaves the free cells", field="paths")
            at = self._number[tuple((cells + 1).T)]
            keys = at[:-1] * size + at[1:]
            arcs = np.searchsorted(tail * size + head, keys)
            known = arcs < len(tail)
            known[known] = (tail * size + head)[arcs[known]] == keys[known]
            if not known.all():
                step = int(np.argmin(known))
                raise InvalidData(f"paths[{k}], step {step} is to no neighbour", field="paths")
            np.add.at(flow, arcs, 1.0)
            end = np.flatnonzero(goals == at[-1])
            if not end.size:
                raise InvalidData(f"paths[{k}] ends at no goal", field="paths")
            ends[end] += 1.0
        return np.concatenate([flow, ends])

    def decode(self, point: Floats) -> GridPlan:
        """Return shortest paths among the steps that carry flow."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        (tail, head, cost), (goals, _) = self._arcs, self._goals
        if point.size != len(tail) + len(goals):
            raise InvalidData(
                f"point must have {len(tail) + len(goals)} entries, got {point.size}", field="point"
            )
        size, used = len(self._free), point[: len(tail)] > LEAST
        graph = csr_array((cost[used], (tail[used], head[used])), shape=(size, size))
        far, before = dijkstra(graph, indices=self._start, return_predecessors=True)
        if self.model.reach is Reach.EACH:
            wanted = self._number[tuple((self.model.goals + 1).T)]
        else:
            wanted = goals[[int(np.argmin(far[goals]))]]
        if not np.isfinite(far[wanted]).all():
            raise InvalidData("the steps that carry flow do not lead to a goal", field="point")
        paths = []
        for end in wanted.tolist():
            path = [end]
            while path[-1] != self._start:
                path.append(int(before[path[-1]]))
            paths.append(self.model.map.centres(self._free[path[::-1]]))
        return GridPlan(tuple(paths))
