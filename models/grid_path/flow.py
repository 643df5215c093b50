"""Shortest path as a minimum-cost flow with one column per step between neighbours.

The start supplies one unit of flow per path. Flow is conserved at every cell, except for the flow that
ends there. The constraint matrix is a network matrix, so every vertex is integral and no column needs to
be an integer. If several paths are shortest, a point may mix them, and :meth:`FlowFormulation.decode`
returns a shortest path among the steps that carry flow.
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

#: Maximum number of free cells of a map.
MOST = 20_000
#: Minimum flow on a step of a path. A mixture of many paths still carries more.
LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class FlowFormulation(Formulation[GridPath, GridPlan]):
    """Minimum-cost flow along neighbours with one unit per path.

    Parameters
    ----------
    model : GridPath
        Model with connectivity "4" or "8" and at most 20,000 free cells.

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
        """Index of each cell among the free cells, with a frame; -1 for blocked cells and the frame."""
        numbers = np.full(np.add(self.model.map.shape, 2), -1)
        numbers[tuple((self._free + 1).T)] = np.arange(len(self._free))
        return numbers

    @cached_property
    def _arcs(self) -> tuple[Ints, Ints, Floats]:
        """Tails and heads (indices of free cells, sorted) and costs (m) of all steps."""
        model, cells, number = self.model, self._free + 1, self._number
        tails, heads, costs = [], [], []
        weights = np.ones(len(cells))
        if model.weights is not None:
            weights = model.weights[tuple(self._free.T)]
        for step in np.argwhere(np.ones((3, 3))) - 1:
            turned = abs(step).sum() == 2
            if not step.any() or (turned and model.connectivity is Connectivity.FOUR):
                continue
            targets = number[tuple((cells + step).T)]
            beside = [number[tuple((cells + step * axis).T)] >= 0 for axis in ((0, 1), (1, 0))]
            (tail,) = np.nonzero((targets >= 0) & beside[0] & beside[1])
            tails.append(tail)
            heads.append(targets[tail])
            length = float(np.hypot(*step)) * model.map.cell
            costs.append(length * 0.5 * (weights[tail] + weights[targets[tail]]))
        order = np.lexsort((np.concatenate(heads), np.concatenate(tails)))
        tail, head, cost = (np.concatenate(parts)[order] for parts in (tails, heads, costs))
        return tail, head, cost

    @cached_property
    def _goals(self) -> tuple[Ints, Ints]:
        """Distinct goals as indices of free cells, and the number of occurrences of each."""
        indices = self._number[tuple((self.model.goals + 1).T)]
        unique = np.unique(indices, return_counts=True)
        return unique[0], unique[1]

    @property
    def _start(self) -> int:
        return int(self._number[tuple(self.model.start + 1)])

    def build(self) -> MixedIntegerProgram:
        """Return the linear program described in the docstring of this module."""
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
        """Return the number of paths on each step and at each goal, as a point of the program."""
        required("plan", plan, GridPlan)
        (tail, head, _), (goals, _) = self._arcs, self._goals
        flow, ends = np.zeros(len(tail)), np.zeros(len(goals))
        size = len(self._free)
        for k, path in enumerate(plan.paths):
            cells = self.model.map.cells_of(path)
            if not self.model.map.holds(cells).all():
                raise InvalidData(f"paths[{k}] leaves the free cells", field="paths")
            indices = self._number[tuple((cells + 1).T)]
            keys = indices[:-1] * size + indices[1:]
            arcs = np.searchsorted(tail * size + head, keys)
            known = arcs < len(tail)
            known[known] = (tail * size + head)[arcs[known]] == keys[known]
            if not known.all():
                step = int(np.argmin(known))
                raise InvalidData(f"paths[{k}], step {step} is to no neighbour", field="paths")
            np.add.at(flow, arcs, 1.0)
            end = np.flatnonzero(goals == indices[-1])
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
            ends = self._number[tuple((self.model.goals + 1).T)]
        else:
            ends = goals[[int(np.argmin(far[goals]))]]
        if not np.isfinite(far[ends]).all():
            raise InvalidData("the steps that carry flow do not lead to a goal", field="point")
        paths = []
        for end in ends.tolist():
            path = [end]
            while path[-1] != self._start:
                path.append(int(before[path[-1]]))
            paths.append(self.model.map.centres(self._free[path[::-1]]))
        return GridPlan(tuple(paths))
