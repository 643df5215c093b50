"""Subtour cuts of fleet programs: where a point breaks them, and those that the root needs.

With x(E(S)) the edges used within a set S of nodes and y_i whether node i is visited, every tour
through the depot satisfies x(E(S)) <= y(S) - y_j for each j of S: what enters S is at least 2 y_j.
A point breaks one of them where the least cut between the depot and j is below 2 y_j.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse import csgraph

from ...errors import InvalidData, UnsupportedOption, show
from ..programs.linear import MixedIntegerProgram

__all__ = ["Cut", "Edges", "check_rounds", "grown", "isolated", "strengthened", "weak_sets"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: What a cut must be violated by to be added to a fractional point.
_VIOLATED = 1e-3
#: Capacities of the network are whole numbers, this many for 1.
_UNIT = 1_000_000
#: Columns above which the rounds end where the last few gained less than a share of the optimum.
_MANY, _LAST, _GAIN = 3000, 3, 1e-3
#: Vehicle of a cut that counts the edges of all of them.
ALL = -1


@dataclass(frozen=True)
class Cut:
    """x(E(S)) <= y(S) - y_j for one vehicle, or <= (nodes of S) - 1 for the sum of all.

    Parameters
    ----------
    members : tuple of int
        S, in ascending order.
    vehicle : int
        The vehicle, -1 for all together.
    node : int
        j; of no account for all together.
    """

    members: tuple[int, ...]
    vehicle: int = ALL
    node: int = -1


@dataclass(frozen=True)
class Edges:
    """The edges, or arcs, of n customers 0 … n-1 and the depot n.

    Parameters
    ----------
    customers : int
        n.
    directed : bool
        Whether there is an arc each way, rather than one edge.
    """

    customers: int
    directed: bool

    @cached_property
    def ends(self) -> tuple[Indices, Indices]:
        """Tails and heads."""
        size = self.customers + 1
        found = np.nonzero(~np.eye(size, dtype=bool)) if self.directed else np.triu_indices(size, 1)
        return found[0].astype(np.int64), found[1].astype(np.int64)

    @property
    def size(self) -> int:
        """How many there are."""
        return len(self.ends[0])

    @cached_property
    def at(self) -> Indices:
        """The number of each, by tail and head; -1 where there is none."""
        tails, heads = self.ends
        place = np.full((self.customers + 1, self.customers + 1), -1)
        place[tails, heads] = np.arange(self.size)
        if not self.directed:
            place[heads, tails] = np.arange(self.size)
        return place

    def lengths(self, distances: Floats) -> Floats:
        """Return the length of each, from the distances of customers and depot in this order."""
        return distances[self.ends]

    def within(self, members: Iterable[int]) -> Indices:
        """Return those with both ends among `members`."""
        inside = np.zeros(self.customers + 1, bool)
        inside[list(members)] = True
        tails, heads = self.ends
        return np.flatnonzero(inside[tails] & inside[heads])

    def of_routes(self, routes: Iterable[Iterable[int]]) -> Floats:
        """Return how often each is used by closed routes from the depot."""
        used = np.zeros(self.size)
        for route in routes:
            stops = [self.customers, *route, self.customers]
            for tail, head in itertools.pairwise(stops) if len(stops) > 2 else ():
                used[self.at[tail, head]] += 1
        return used

    def routes(self, used: Floats) -> list[list[int]]:
        """Return the closed routes from the depot that use the edges as often as `used` says.

        Raises
        ------
        InvalidData
            They make no routes from the depot, or leave some edges over.
        """
        count = np.rint(used).astype(int)
        tails, heads = self.ends
        ahead: dict[int, list[int]] = {}
        for edge in np.repeat(np.arange(self.size), np.maximum(count, 0)).tolist():
            ahead.setdefault(int(tails[edge]), []).append(edge)
            if not self.directed:
                ahead.setdefault(int(heads[edge]), []).append(edge)
        found = []
        depot = self.customers
        while ahead.get(depot):
            route, place = [], depot
            while True:
                if not ahead.get(place):
                    raise InvalidData(
                        "point: the edges make no closed routes from the depot", field="point"
                    )
                edge = ahead[place].pop()
                other = int(heads[edge]) if int(tails[edge]) == place else int(tails[edge])
                if not self.directed:
                    ahead[other].remove(edge)
                if other == depot:
                    break
                route.append(other)
                place = other
            found.append(route)
        if any(ahead.values()):
            raise InvalidData("point: some edges make a route without the depot", field="point")
        return found

    def network(self, weight: Floats) -> sp.csr_array:
        """Return edges of positive weight as a symmetric matrix; arcs both ways are added up."""
        take = weight > 1e-9
        tails, heads = (ends[take] for ends in self.ends)
        size = self.customers + 1
        one = sp.coo_array((weight[take], (tails, heads)), shape=(size, size))
        return sp.csr_array(one + one.T)


def isolated(edges: Edges, weight: Floats) -> list[tuple[int, ...]]:
    """Return the sets of connected customers, two or more, that the depot has no way to."""
    count, part = csgraph.connected_components(edges.network(weight), directed=False)
    groups = (np.flatnonzero(part == k) for k in range(count) if k != part[edges.customers])
    return [tuple(group.tolist()) for group in groups if group.size > 1]


def weak_sets(edges: Edges, weight: Floats, need: Floats) -> Iterator[tuple[tuple[int, ...], int]]:
    """Yield sets of customers that are entered by less than twice what one of them needs.

    Parameters
    ----------
    edges : Edges
        Edges or arcs.
    weight : ndarray, shape (edges,)
        How much each is used.
    need : ndarray, shape (customers,)
        y, how much each customer is visited.

    Yields
    ------
    tuple of int, int
        The set, and the one.
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


def strengthened(
    program: Callable[[tuple[Cut, ...]], MixedIntegerProgram],
    separate: Callable[[Floats], Iterable[Cut]],
    rounds: int,
    *,
    hurry: bool = False,
) -> tuple[Cut, ...]:
    """Return the cuts that the linear relaxation's optimum needs, found round by round.

    Parameters
    ----------
    program : callable
        The program with given cuts; its rows end with one a cut.
    separate : callable
        Cuts that a point breaks.
    rounds : int
        Linear programs that are solved at the most.
    hurry : bool
        Whether a large program ends the rounds where they gain little.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    cuts: tuple[Cut, ...] = ()
    optima: list[float] = []
    for _ in range(rounds):
        posed = program(cuts)
        rows = LinearConstraint(posed.matrix, posed.row_lower, posed.row_upper)
        answer = milp(
            posed.cost, constraints=rows, bounds=Bounds(posed.column_lower, posed.column_upper)
        )
        if answer.x is None:
            return cuts
        optima.append(float(answer.fun))
        former = optima[-1 - _LAST] if len(optima) > _LAST else -np.inf
        if hurry and posed.size > _MANY and optima[-1] <= former + _GAIN * abs(former):
            return cuts
        # Cuts that the point does not need may go: they come back where they are missed.
        slack = (posed.row_upper - posed.matrix @ answer.x)[posed.row_count - len(cuts) :]
        kept = tuple(cut for cut, room in zip(cuts, slack, strict=True) if room < 0.1)
        finer = grown(kept, separate(answer.x))
        if len(finer) == len(kept):
            return kept
        cuts = finer
    return cuts


def grown(cuts: tuple[Cut, ...], more: Iterable[Cut]) -> tuple[Cut, ...]:
    """Return `cuts` with those of `more` that are new."""
    return tuple(dict.fromkeys((*cuts, *more)))


def check_rounds(formulation: str, value: object) -> None:
    """Raise :class:`UnsupportedOption` unless `value` is a whole number, 0 or more."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise UnsupportedOption(
            f"formulation {formulation!r}: root_rounds must be a whole number >= 0, got {show(value)}"
        )
