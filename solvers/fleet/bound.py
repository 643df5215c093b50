"""Lower bounds on the objective of fleet routing from relaxations.

The result is the greatest of these bounds:

* the round trip to one node, by shortest paths through the nodes;
* among more nodes than vehicles, two share a route, so the longest route is at least the shortest
  round trip to two of them. Among at most as many nodes as vehicles, either two share a route or all
  are separate, which increases the sum;
* without the depots, r routes through n nodes are a forest of n - r arcs, plus r arcs from and to the
  depots. Lagrange multipliers ("prices") relax the constraints that each node is left once and entered
  once. Subgradient steps raise the prices; the cheapest number of routes is taken. The optimum equals
  the bound of all subtour cuts. Nodes that share no route are roots of separate trees;
* for asymmetric distances, the cheapest assignment of a successor to each node.

The longest of r routes is at least their sum divided by r.

Sources: M. Held and R. M. Karp, "The traveling-salesman problem and minimum spanning trees",
Operations Research 18, 1970; its steps by T. Volgenant and R. Jonker, "A branch and bound algorithm
for the symmetric traveling salesman problem based on the 1-tree relaxation", European Journal of
Operational Research 9, 1982.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.fleet import FleetRouting, Objective
from ...models.fleet.data import LARGE, LEXICOGRAPHIC, Metric

__all__ = ["lower_bound", "spanning_tree", "trip_bound"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: Safety margins for rounding, relative to a bound and to the sum of its terms.
SAFE, ROUNDING = 1e-9, 1e-12
#: Subgradient steps per n^0.62 (Volgenant and Jonker), and maximum of steps times n².
STEPS, PAIRS = 20, 100_000_000
#: Minimum number of subgradient steps.
LEAST = 10
#: Number of sets of distant nodes that are tried, the largest first.
TRIES = 3
#: Largest number of nodes for all-pairs paths, pairs and assignments, which take n^3 steps.
MANY = 500
#: Share of the demands that may be unserved, above the tolerance of the capacity checks.
LEFT_OVER = 1e-4


def lower_bound(model: FleetRouting, flag: Flag) -> float:
    """Return a lower bound on the objective of every plan, in the unit of the objective.

    The capacity is the only limit considered, and the bound on a range is 0. A nonzero `flag` ends the
    computation with the best bound so far.
    """
    unit = float(model.distances.max())
    if model.objective is Objective.RANGE or unit == 0.0 or flag[0] != 0:
        return 0.0
    proof = _Proof.of(model, unit, flag)
    if flag[0] != 0:
        return 0.0
    longest, total = proof.round_trips()
    total = max(total, proof.assignment())
    value = 0.0
    if model.objective in (Objective.MAX, Objective.LEXICOGRAPHIC):
        longest = max(longest, total / proof.most)
        value = proof.apart(max(longest, proof.prices(total, each=True)), total)
    if model.objective is not Objective.MAX:
        weight = LEXICOGRAPHIC if model.objective is Objective.LEXICOGRAPHIC else 1.0
        value += weight * max(total, proof.prices(total, each=False))
    return value * (1.0 - SAFE) * unit


def trip_bound(model: FleetRouting) -> float:
    """Return the length of the longest round trip to one node; 0 for the objective "range".

    It bounds all other objectives from below. One shortest-path search per direction, from the
    nearest depot, makes it much faster than :func:`lower_bound`.
    """
    if model.objective is Objective.RANGE:
        return 0.0
    if model.size > LARGE and model.costs is None and model.metric is not Metric.GRID:
        if model.metric is Metric.ROUNDED:
            return 0.0  # a way through other nodes may be shorter
        trips = 2.0 * np.min(
            [model.legs(home, np.arange(model.size)) for home in np.unique(model.depots)], axis=0
        )
    else:
        distances = model.distances
        trips = _paths(distances[model.depots].min(axis=0), distances)
        if model.symmetric:
            trips *= 2.0
        else:
            trips += _paths(distances[:, model.depots].min(axis=1), distances.T)
    weight = 1.0 + LEXICOGRAPHIC if model.objective is Objective.LEXICOGRAPHIC else 1.0
    return weight * float(trips[model.customers].max()) * (1.0 - SAFE)


@dataclass
class _Proof:
    """Data of the relaxations, scaled so that the longest distance is 1.

    `costs`, shape (n, n), are distances between customers; `starts` and `ends`, shape (homes, n), those
    from each depot and back; `counts` the vehicles of each depot; `fewest` and `most` limit the number of
    routes.
    """

    costs: Floats
    starts: Floats
    ends: Floats
    counts: Ints
    fewest: int
    most: int
    symmetric: bool
    flag: Flag
    pairs: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, model: FleetRouting, unit: float, flag: Flag) -> Self:
        """Return the relaxation of `model`."""
        nodes, all_pairs = model.customers, model.distances
        homes, counts = np.unique(model.homes, return_counts=True)
        most = min(model.vehicles, nodes.size)
        fewest = most if model.use_all else 1
        if model.capacity is not None:
            assert model.demands is not None
            carried = np.cumsum(np.sort(model.capacity)[::-1])
            need = float(model.demands[nodes].sum()) * (1.0 - LEFT_OVER)
            fewest = min(max(fewest, 1 + int((carried[:most] < need).sum())), most)
        return cls(
            all_pairs[np.ix_(nodes, nodes)] / unit, all_pairs[np.ix_(homes, nodes)] / unit,
            all_pairs[np.ix_(nodes, homes)].T / unit, counts, fewest, most, model.symmetric, flag,
        )  # fmt: skip

    @property
    def size(self) -> int:
        """Number of customers."""
        return len(self.costs)

    @property
    def fixed(self) -> bool:
        """Whether every vehicle must have a route."""
        return self.fewest == int(self.counts.sum())

    @cached_property
    def depots(self) -> tuple[Floats, Floats, Ints]:
        """Starts, ends and counts; merged into one depot if vehicles may stay idle."""
        if self.fixed:
            return self.starts, self.ends, self.counts
        ways = (entry.min(axis=0, keepdims=True) for entry in (self.starts, self.ends))
        return *ways, np.array([self.most])

    def round_trips(self) -> tuple[float, float]:
        """Return bounds on the longest route and on the sum, by round trips to one or two nodes."""
        starts, ends, costs = self.starts, self.ends, self.costs
        pairs = self.size <= MANY and self.flag[0] == 0
        if pairs:
            costs = costs.copy()
            for k in range(self.size):
                np.minimum(costs, costs[:, k, None] + costs[k], out=costs)
            out, back = (
                np.array([(row[:, None] + way).min(axis=0) for row in rows])
                for rows, way in ((starts, costs), (ends, costs.T))
            )
        else:
            out, back = _paths(starts.min(axis=0), costs), _paths(ends.min(axis=0), costs.T)
        trips = np.atleast_2d(out + back)
        longest = float(trips.min(axis=0).max())
        total = longest
        if self.fixed and pairs:
            nearest = trips.min(axis=1)
            longest = max(longest, float(nearest.max()))
            total = max(total, float(nearest @ self.counts))
        if pairs:
            both = out.min(axis=0)[:, None] + costs + back.min(axis=0)
            self.pairs = np.minimum(both, both.T)
        return longest, max(longest, total)

    def assignment(self) -> float:
        """Return the assignment bound on the sum for asymmetric distances, 0 otherwise."""
        from scipy.optimize import linear_sum_assignment

        n, m = self.size, self.most
        if self.symmetric or n + m > 2 * MANY:
            return 0.0
        starts, ends, counts = self.depots
        matrix = np.full((n + m, n + m), np.inf)
        matrix[:n, :n] = self.costs
        matrix[n:, :n] = np.repeat(starts, counts, axis=0)
        matrix[:n, n:] = np.repeat(ends, counts, axis=0).T
        np.fill_diagonal(matrix, np.inf)
        idle = n + np.arange(m - self.fewest)
        matrix[idle, idle] = 0.0
        return float(matrix[linear_sum_assignment(matrix)].sum())

    def apart(self, longest: float, known: float) -> float:
        """Return a bound on the longest route from distant nodes, which share a route or are separate.

        `longest` and `known` are known bounds on the longest route and on the sum.
        """
        if not self.pairs.size or self.most == 1:
            return longest
        sets = _spread(self.pairs, min(self.most + 1, self.size), longest)
        if sets and len(sets[-1][1]) > self.most:
            longest = sets.pop()[0]
        for length, nodes in sets[: -TRIES - 1 : -1]:
            separate = self.prices(known, each=True, apart=nodes, enough=length)
            longest = max(longest, min(length, separate))
            if separate < length:
                break
        return longest

    def prices(
        self, known: float, each: bool, apart: Sequence[int] = (), enough: float = np.inf
    ) -> float:
        """Return the Lagrangian bound by node prices: on the mean of the used routes (`each`), or on the sum.

        A `known` bound on the sum scales the step length. The customers in `apart` are on different routes.
        The steps end early at the bound `enough`.
        """
        if self.flag[0] != 0:
            return 0.0
        n, roots = self.size, max(len(apart), 1)
        nodes = np.concatenate([np.array(apart, int), np.setdiff1d(np.arange(n), apart)])
        costs = self.costs[np.ix_(nodes, nodes)]
        starts, ends, counts = self.depots
        starts, ends = starts[:, nodes], ends[:, nodes]
        alone = len(counts) == 1
        pooled = alone and self.symmetric and self.most < n
        back = costs if self.symmetric else np.ascontiguousarray(costs.T)
        routes = np.arange(max(self.fewest, roots), self.most + 1)
        # Routes of each depot, one column for each number of routes.
        taken = routes[None] if alone else counts[:, None]
        share = routes if each else np.ones(1)
        tails, heads = np.empty((2, n - roots), np.int64)
        weights = np.empty(n - roots)
        leave, enter = prices = np.zeros((2, n))
        old, best, first = np.zeros((2, n)), 0.0, 0.0
        steps = int(max(min(STEPS * n**0.62, PAIRS / n**2), LEAST))
        for step in range(steps):
            if self.flag[0] != 0 or best >= enough:
                break
            spanning_tree(
                costs, back, leave, enter, tails, heads, weights, roots, not self.symmetric
            )
            order = np.argsort(weights)
            away, home = starts - enter, ends - leave
            outs, sum_out = _cheapest(away, taken)
            ins, sum_in = _cheapest(home, taken)
            values = np.append(0.0, np.cumsum(weights[order]))[n - routes] + sum_out + sum_in
            if pooled:
                # At least one route has two nodes, so its first and last node differ.
                ahead = away[0, outs[0]]
                values += ahead[routes] - ahead[routes - 1]
            values += prices.sum()
            pick = int(np.argmin(values / share))
            value, number = float(values[pick]), int(routes[pick])
            added = sum(float(np.abs(entry).sum()) for entry in (weights, prices, away, home))
            best = max(best, (value - ROUNDING * added) / (number if each else 1))
            used = order[: n - number]
            slope = 1.0 - np.array([np.bincount(x[used], minlength=n) for x in (tails, heads)])
            for h, count in enumerate(taken[:, pick if alone else 0].tolist()):
                slope[1, outs[h, :count]] -= 1.0
                slope[0, ins[h, : count - pooled]] -= 1.0
                slope[0, ins[h, count : count + pooled]] -= 1.0
            if self.symmetric:
                slope[:] = slope.mean(axis=0)
            if not slope.any():
                break
            if step == 0:
                first, old = max(value, known, float(costs.mean())) / n, slope
            prices += first * (1.0 - step / steps) ** 2 * (0.6 * slope + 0.4 * old)
            old = slope
        return best


def _cheapest(ways: Floats, taken: Ints) -> tuple[Ints, Floats]:
    """Return the columns of each row sorted by cost, and the cost of the cheapest `taken` of all rows."""
    rows, order = np.arange(len(ways))[:, None], np.argsort(ways, axis=1)
    return order, np.cumsum(ways[rows, order], axis=1)[rows, taken - 1].sum(axis=0)


def _paths(first: Floats, costs: Floats) -> Floats:
    """Return the lengths of shortest paths by Dijkstra's algorithm; `first` holds the first arcs."""
    lengths, open_nodes = first.copy(), np.ones(first.size, bool)
    for _ in range(first.size):
        node = int(np.where(open_nodes, lengths, np.inf).argmin())
        open_nodes[node] = False
        np.minimum(lengths, lengths[node] + costs[node], out=lengths)
    return lengths


def _spread(trips: Floats, most: int, enough: float) -> list[tuple[float, list[int]]]:
    """Return sets of 2, 3 … `most` distant nodes, each with the shortest trip to two of its nodes.

    Farthest-first insertion from each node; the best start is used for each size. `trips`, shape (n, n), is
    the shortest round trip to each pair; sets with a trip of at most `enough` are omitted.
    """
    np.fill_diagonal(trips, -np.inf)
    rows = np.arange(len(trips))
    chosen, least, length = [rows], trips.copy(), np.full(len(trips), np.inf)
    sets: list[tuple[float, list[int]]] = []
    while len(chosen) < most:
        chosen.append(least.argmax(axis=1))
        length = np.minimum(length, least[rows, chosen[-1]])
        start = int(length.argmax())
        if length[start] <= enough:
            break
        sets.append((float(length[start]), [int(nodes[start]) for nodes in chosen]))
        np.minimum(least, trips[chosen[-1]], out=least)
    return sets


@kernel(interpretable=True)
def spanning_tree(
    there: Floats,
    back: Floats,
    leave: Floats,
    enter: Floats,
    tails: Ints,
    heads: Ints,
    weights: Floats,
    roots: int,
    both: bool,
) -> None:
    """Compute a minimum spanning forest of costs `there` and their transpose `back` by Prim's algorithm.

    The weight of the arc from i to j is ``there[i, j] - leave[i] - enter[j]``, with the prices of leaving
    and entering a node. The lighter of two opposite arcs is used; `both` states whether they differ. The
    first `roots` nodes are in different trees. `tails`, `heads` and `weights`, shape (n - roots,), are
    outputs.
    """
    n = there.shape[0]
    key = np.empty(n)
    near = np.empty(n, np.int64)
    rest = np.empty(n, np.int64)
    for j in range(n):
        key[j] = math.inf
        near[j] = 0
        rest[j] = roots + j
    node = 0
    for step in range(n - 1):
        edge = step - roots + 1
        remaining = n - roots - max(edge, 0)
        best, place = math.inf, 0
        for k in range(remaining):
            j = rest[k]
            weight = there[node, j] - leave[node] - enter[j]
            if weight < key[j]:
                key[j] = weight
                near[j] = node
            if both:
                other = back[node, j] - leave[j] - enter[node]
                if other < key[j]:
                    key[j] = other
                    near[j] = -1 - node
            if key[j] < best:
                best, place = key[j], k
        if edge < 0:
            node = step + 1
            continue
        node = rest[place]
        rest[place] = rest[remaining - 1]
        weights[edge] = key[node]
        # A negative entry encodes an arc from the new node to the tree.
        if near[node] >= 0:
            tails[edge] = near[node]
            heads[edge] = node
        else:
            tails[edge] = node
            heads[edge] = -1 - near[node]
