"""Subtour cuts of fleet programs: separation, and the cuts active at the root node.

With x(E(S)) the edges used within a set S of nodes and y_i whether node i is visited, every tour
through the depot satisfies x(E(S)) <= y(S) - y_j for each j of S: at least 2 y_j edges enter S.
A point violates one of these cuts if the minimum cut between the depot and j is below 2 y_j.
"""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse import csgraph

from ...errors import InvalidData, UnsupportedFormulation, UnsupportedOption, show
from ..fields import required
from ..formulation import Formulation
from ..programs.linear import MixedIntegerProgram
from .features import list_unsupported
from .model import FleetRouting
from .plan import FleetPlan

__all__ = [
    "Cut",
    "CutFormulation",
    "Edges",
    "add_root_cuts",
    "find_isolated_sets",
    "find_weak_sets",
    "merge_cuts",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Smallest violation for which a cut is added at a fractional point.
_VIOLATED = 1e-3
#: Integer capacity that represents 1: the maximum flow needs whole numbers.
_UNIT = 1_000_000
#: Value of :attr:`Cut.vehicle` for a cut on the edges of all vehicles together.
ALL = -1


@dataclass(frozen=True)
class Cut:
    """Subtour cut x(E(S)) <= y(S) - y_j of one vehicle, or x(E(S)) <= (nodes of S) - 1 of all together.

    `members` is S in ascending order, `vehicle` is -1 for all together, and `node` is j.
    """

    members: tuple[int, ...]
    vehicle: int = ALL
    node: int = -1


@dataclass(frozen=True)
class Edges:
    """Complete graph on n customers 0 … n-1 and the depot n, with two arcs per pair if `directed`."""

    customers: int
    directed: bool

    @cached_property
    def ends(self) -> tuple[Indices, Indices]:
        """Tails and heads, each of shape (edges,)."""
        size = self.customers + 1
        pairs = np.nonzero(~np.eye(size, dtype=bool)) if self.directed else np.triu_indices(size, 1)
        return pairs[0].astype(np.int64), pairs[1].astype(np.int64)

    @property
    def size(self) -> int:
        """Number of edges."""
        return len(self.ends[0])

    @cached_property
    def at(self) -> Indices:
        """Index of each edge by tail and head, shape (n + 1, n + 1); -1 for absent edges."""
        tails, heads = self.ends
        place = np.full((self.customers + 1, self.customers + 1), -1)
        place[tails, heads] = np.arange(self.size)
        if not self.directed:
            place[heads, tails] = np.arange(self.size)
        return place

    def lengths(self, distances: Floats) -> Floats:
        """Return the length of each edge; `distances` lists the customers, then the depot."""
        return distances[self.ends]

    def within(self, members: Iterable[int]) -> Indices:
        """Return the indices of the edges with both ends in `members`."""
        inside = np.zeros(self.customers + 1, bool)
        inside[list(members)] = True
        tails, heads = self.ends
        return np.flatnonzero(inside[tails] & inside[heads])

    def of_routes(self, routes: Iterable[Iterable[int]]) -> Floats:
        """Return how often each edge is used by closed routes from the depot, shape (edges,)."""
        used = np.zeros(self.size)
        for route in routes:
            stops = [self.customers, *route, self.customers]
            for tail, head in itertools.pairwise(stops) if len(stops) > 2 else ():
                used[self.at[tail, head]] += 1
        return used

    def routes(self, used: Floats) -> list[list[int]]:
        """Return closed routes from the depot that use each edge `used` times, else raise."""
        count = np.rint(used).astype(int)
        tails, heads = self.ends
        unused: dict[int, list[int]] = {}
        for edge in np.repeat(np.arange(self.size), np.maximum(count, 0)).tolist():
            unused.setdefault(int(tails[edge]), []).append(edge)
            if not self.directed:
                unused.setdefault(int(heads[edge]), []).append(edge)
        routes = []
        depot = self.customers
        while unused.get(depot):
            route, place = [], depot
            while True:
                if not unused.get(place):
                    raise InvalidData(
                        "point: the edges make no closed routes from the depot", field="point"
                    )
                edge = unused[place].pop()
                other = int(heads[edge]) if int(tails[edge]) == place else int(tails[edge])
                if not self.directed:
                    unused[other].remove(edge)
                if other == depot:
                    break
                route.append(other)
                place = other
            routes.append(route)
        if any(unused.values()):
            raise InvalidData("point: some edges make a route without the depot", field="point")
        return routes

    def network(self, weight: Floats) -> sp.csr_array:
        """Return the edges of positive weight as a symmetric matrix; opposite arcs are summed."""
        positive = weight > 1e-9
        tails, heads = (ends[positive] for ends in self.ends)
        size = self.customers + 1
        half = sp.coo_array((weight[positive], (tails, heads)), shape=(size, size))
        return sp.csr_array(half + half.T)


def find_isolated_sets(edges: Edges, weight: Floats) -> list[tuple[int, ...]]:
    """Return the connected components of two or more customers that exclude the depot."""
    count, part = csgraph.connected_components(edges.network(weight), directed=False)
    groups = (np.flatnonzero(part == k) for k in range(count) if k != part[edges.customers])
    return [tuple(group.tolist()) for group in groups if group.size > 1]


def find_weak_sets(
    edges: Edges, weight: Floats, need: Floats
) -> Iterator[tuple[tuple[int, ...], int]]:
    """Yield sets of customers whose subtour cut is violated, by minimum cuts from the depot, and its node j.

    `weight`, shape (edges,), is the value of x for each edge, and `need`, shape (customers,), that of y.
    """
    graph, depot = edges.network(weight), edges.customers
    capacity = sp.csr_array(
        (np.rint(graph.data * _UNIT).astype(np.int32), graph.indices, graph.indptr), graph.shape
    )
    covered = np.zeros(depot, bool)
    for node in np.argsort(-need, kind="stable").tolist():
        if need[node] <= _VIOLATED or covered[node]:
            continue
        flow = csgraph.maximum_flow(capacity, depot, node)
        if flow.flow_value >= (2 * need[node] - _VIOLATED) * _UNIT:
            continue
        left = sp.csr_array(capacity - flow.flow)
        left.eliminate_zeros()
        reached = csgraph.breadth_first_order(left, depot, return_predecessors=False)
        members = np.setdiff1d(np.arange(depot), reached)
        covered[members] = True
        if members.size > 1:
            yield tuple(members.tolist()), node


def add_root_cuts(
    program: Callable[[tuple[Cut, ...]], MixedIntegerProgram],
    separate: Callable[[Floats], Iterable[Cut]],
    rounds: int,
    work: int,
) -> tuple[Cut, ...]:
    """Return the cuts active at the optimum of the linear relaxation.

    `program` builds the program for given cuts, one per row at its end, and `separate` returns the cuts
    that a point violates. At most `rounds` linear programs with at most `work` columns together are solved.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    cuts: tuple[Cut, ...] = ()
    linear = program(cuts)
    for _ in range(min(rounds, work // linear.size)):
        rows = LinearConstraint(linear.matrix, linear.row_lower, linear.row_upper)
        result = milp(
            linear.cost, constraints=rows, bounds=Bounds(linear.column_lower, linear.column_upper)
        )
        if result.x is None:
            return cuts
        # Drop slack cuts: separation returns them if a later point violates them.
        slack = (linear.row_upper - linear.matrix @ result.x)[linear.row_count - len(cuts) :]
        active = tuple(cut for cut, room in zip(cuts, slack, strict=True) if room < 0.1)
        extended = merge_cuts(active, separate(result.x))
        if len(extended) == len(active):
            return active
        cuts = extended
        linear = program(cuts)
    return cuts


def merge_cuts(cuts: tuple[Cut, ...], more: Iterable[Cut]) -> tuple[Cut, ...]:
    """Return `cuts` followed by the new cuts of `more`."""
    return tuple(dict.fromkeys((*cuts, *more)))


@dataclass(frozen=True, eq=False)
class CutFormulation(Formulation[FleetRouting, FleetPlan]):
    """Base of the programs with subtour cuts, which are added at the root and lazily.

    A subclass builds the program for given cuts and finds the cuts that a point violates.
    """

    root_rounds: int = 30
    _added: tuple[Cut, ...] | None = field(default=None, init=False, repr=False)

    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram
    #: Columns of the linear programs at the root together: a few seconds.
    work: ClassVar[int]

    def __post_init__(self) -> None:
        value = self.root_rounds
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise UnsupportedOption(
                f"formulation {self.name!r}: root_rounds must be a whole number >= 0, got {show(value)}"
            )
        if features := list_unsupported(self.model, frozenset()):
            raise UnsupportedFormulation(f"formulation {self.name!r} does not cover {features}")

    @abstractmethod
    def _build(self, cuts: tuple[Cut, ...]) -> MixedIntegerProgram: ...

    @abstractmethod
    def _separate(self, point: Floats) -> Iterable[Cut]: ...

    @cached_property
    def cuts(self) -> tuple[Cut, ...]:
        """Subtour cuts of the program."""
        if self._added is not None:
            return self._added
        return add_root_cuts(self._build, self._separate, self.root_rounds, self.work)

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the module's docstring."""
        return self._build(self.cuts)

    def _positions(self, plan: FleetPlan) -> list[list[int]]:
        """Return the places of the stops of each route among the customers; raise for other nodes."""
        required("plan", plan, FleetPlan)
        place = {node: k for k, node in enumerate(self.model.customers.tolist())}
        for k, route in enumerate(plan.routes):
            for stop, node in enumerate(route):
                if node not in place:
                    raise InvalidData(
                        f"routes[{k}][{stop}] must be a node to visit, got {node}", field="routes"
                    )
        return [[place[node] for node in route] for route in plan.routes]
