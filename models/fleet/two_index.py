"""Two-index program of minimum total length: edges without vehicles.

Routes of identical vehicles from one depot are edges x_ij, each 0 or 1, and 0, 1 or 2 at the depot
(2 for a route to a single node). Two edges meet at each node, and 2 k at the depot for k routes.
Subtours are excluded by x(E(S)) <= |S| - 1 for every set S of nodes; violated cuts are added lazily.
Source: the vehicle-flow program of G. Laporte and Y. Nobert, "A cutting planes algorithm for the
m-salesmen problem", Journal of the Operational Research Society 31, 1980; eq. 15 is the objective.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ..fields import Array
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .cuts import Cut, CutFormulation, Edges, find_isolated_sets, find_weak_sets, merge_cuts
from .data import Objective
from .plan import FleetPlan

__all__ = ["TwoIndexFormulation"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TwoIndexFormulation(CutFormulation):
    """Program of edges without vehicles, with subtour cuts added at the root and lazily.

    Parameters
    ----------
    model : FleetRouting
        Model with the objective "sum", symmetric distances, one depot and no limit except a budget.
    root_rounds : int
        Maximum number of linear programs solved in advance to find root cuts. With 0, cuts are
        added only for solutions that violate them.

    Raises
    ------
    UnsupportedFormulation
        The vehicles of the model differ, the distances are asymmetric, or the objective or a limit
        is not covered.
    UnsupportedOption
        `root_rounds` is not a whole number >= 0.
    """

    root_rounds: int = 100

    name: ClassVar[str] = "two-index"
    work: ClassVar[int] = 1_000_000
    summary: ClassVar[str] = "edges without vehicles, lazy subtour cuts; the sum only"

    def __post_init__(self) -> None:
        super().__post_init__()
        model = self.model
        reasons = {
            f"the objective {str(model.objective)!r}": model.objective is not Objective.SUM,
            "several depots": np.unique(model.depots).size > 1,
            "distances that depend on the direction": not model.symmetric,
            **{name: name != "budget" for name in model.limits},
        }
        for what, applies in reasons.items():
            if applies:
                raise UnsupportedFormulation(
                    f"formulation {self.name!r} does not cover {what}: 'three-index' does"
                )

    @cached_property
    def _nodes(self) -> NDArray[np.int64]:
        """Customers, then the depot."""
        return np.append(self.model.customers, self.model.depots[0])

    @cached_property
    def _edges(self) -> Edges:
        return Edges(len(self.model.customers), directed=False)

    def _build(self, cuts: tuple[Cut, ...]) -> MixedIntegerProgram:
        model, edges = self.model, self._edges
        n, labels = edges.customers, self._nodes
        tails, heads = edges.ends
        lengths = edges.lengths(model.distances[np.ix_(labels, labels)])
        most = min(model.vehicles, n)
        b = ProgramBuilder()
        x = b.columns(
            "edge used", edges.size, upper=np.where(heads == n, 2, 1), cost=lengths, integral=True,
            template="edge {0}-{1}", index=np.column_stack([labels[tails], labels[heads]]),
        )  # fmt: skip
        k = b.columns(
            "routes", 1, lower=model.vehicles if model.use_all else 1, upper=most, integral=True
        )
        inner = heads < n
        b.rows(
            "two edges at each node", n, (tails, x, 1.0), (heads[inner], x[inner], 1.0),
            lower=2, upper=2, template="node {0}", index=labels[:n],
        )  # fmt: skip
        b.rows("edges at the depot", 1, (0, x[~inner], 1.0), (0, k, -2.0), lower=0, upper=0)
        if model.budget is not None:
            unit = model.length_unit
            b.rows("sum within budget", 1, (0, x, lengths), upper=model.budget, unit=unit)
        within = [edges.within(cut.members) for cut in cuts]
        rows = np.repeat(np.arange(len(cuts)), [part.size for part in within])
        b.rows(
            "no route without the depot", len(cuts),
            (rows, x[np.concatenate([np.empty(0, int), *within])], 1.0),
            upper=np.array([len(cut.members) - 1.0 for cut in cuts]),
        )  # fmt: skip
        return b.build(name=f"{model.name}:two-index" if model.name else "two-index")

    def _separate(self, point: Floats) -> Iterator[Cut]:
        """Yield cuts that a point of the relaxation violates."""
        edges, used = self._edges, point[: self._edges.size]
        subtours = find_isolated_sets(edges, used)
        if not subtours:
            subtours = [
                members for members, _ in find_weak_sets(edges, used, np.ones(edges.customers))
            ]
        yield from map(Cut, subtours)

    def refined(
        self, point: Floats, tolerance: float, duals: Floats | None = None
    ) -> TwoIndexFormulation | None:
        """Return the formulation that cuts off the routes of `point` that miss the depot."""
        subtours = find_isolated_sets(self._edges, np.rint(point[: self._edges.size]))
        cuts = merge_cuts(self.cuts, map(Cut, subtours))
        if len(cuts) == len(self.cuts):
            return None
        return self._changed(_added=cuts)

    def encode(self, plan: FleetPlan) -> Floats:
        """Return how often `plan` uses each edge, followed by the number of routes."""
        used = self._edges.of_routes(self._positions(plan))
        return np.append(used, sum(bool(route) for route in plan.routes))

    def decode(self, point: Floats) -> FleetPlan:
        """Return the routes formed by the used edges; raise for edges that miss the depot."""
        values = Array((self._edges.size + 1,)).coerce("point", point, {})
        routes_found = self._edges.routes(values[:-1])
        routes = [tuple(self._nodes[route].tolist()) for route in routes_found]
        idle = self.model.vehicles - len(routes)
        return FleetPlan((*routes, *[()] * max(idle, 0)))

    def statistics(self, plan: FleetPlan) -> dict[str, float | int | str]:
        """Return the number of subtour cuts."""
        return {"subtour cuts": len(self.cuts)}
