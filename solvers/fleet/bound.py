"""Lower bounds on the routes of a fleet, proven without a search.

Routes cost no less than what they are relaxed to, of which the greatest bound counts:

* the way to a node and back, by shortest paths through the nodes;
* of more nodes than vehicles, some two share a route, so the longest is as long as the shortest round
  trip to two of them; of no more nodes than vehicles, either some two do, or none, which makes the sum
  greater;
* with the depots taken apart, r routes through n nodes are n - r arcs without a circle and r arcs from
  and to the depots. Each node is left once and entered once, which prices relax; the prices are raised
  step by step, and the number of routes is whichever is cheapest. Their best is the bound of all
  subtour cuts. Nodes that share no route are roots of trees apart;
* where ways back differ from ways there, the cheapest assignment of a next node to each node.

The longest of r routes is at least their sum over r.

Sources: M. Held and R. M. Karp, "The traveling-salesman problem and minimum spanning trees",
Operations Research 18, 1970; its steps by T. Volgenant and R. Jonker, "A branch and bound algorithm
for the symmetric traveling salesman problem based on the 1-tree relaxation", European Journal of
Operational Research 9, 1982.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective
from ...models.fleet.data import LEXICOGRAPHIC
from .bound_kernels import spanning_tree

__all__ = ["lower_bound", "trip_bound"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: Share of a bound, and of the sum of all numbers that it was added up from, left for their rounding.
SAFE, ROUNDING = 1e-9, 1e-12
#: Steps of the prices: so many times n^0.62 (Volgenant and Jonker), but no more pairs than these in all.
STEPS, PAIRS = 20, 100_000_000
#: Steps at the least, whatever the number of pairs.
LEAST = 10
#: Sets of nodes far apart that are tried, the largest first.
TRIES = 3
#: Nodes above which paths through others, pairs and assignments are left out, for their n^3 steps.
MANY = 500
#: Share of the demands that may be left over: what the checks of capacities tolerate, and more.
LEFT_OVER = 1e-4


def lower_bound(model: FleetRouting, flag: Flag) -> float:
    """Return a number that the objective of no plan is below.

    Parameters
    ----------
    model : FleetRouting
        Any. Of the limits only the capacity is looked at, and of a range nothing is said but 0.
    flag : ndarray of int8, shape (1,)
        Not 0 ends the work with what is proven by then.
    """
    unit = float(model.distances.max())
    if model.objective is Objective.RANGE or unit == 0.0 or flag[0] != 0:
        return 0.0
    proof = _Proof.of(model, unit, flag)
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
    """Return the length of the longest trip to one node and back, a lower bound on every objective but the range.

    It takes the shortest paths from the nearest depot and back, one search each way, and is computed before
    anything that takes longer.
    """
    if model.objective is Objective.RANGE:
        return 0.0
    distances, homes = model.distances, model.depots
    trips = _paths(distances[homes].min(axis=0), distances)
    if model.symmetric:
        trips *= 2.0
    else:
        trips += _paths(distances[:, homes].min(axis=1), distances.T)
    weight = 1.0 + LEXICOGRAPHIC if model.objective is Objective.LEXICOGRAPHIC else 1.0
    return weight * float(trips[model.customers].max()) * (1.0 - SAFE)


@dataclass
class _Proof:
    """What the bounds are made of, in units in which the longest distance is 1.

    Parameters
    ----------
    costs : ndarray, shape (n, n)
        From one customer to another.
    starts, ends : ndarray, shape (homes, n)
        From each depot to each customer, and back.
    counts : ndarray of int, shape (homes,)
        The vehicles of each.
    fewest, most : int
        The number of routes.
    symmetric : bool
        Whether every way back is as long as the way there.
    flag : ndarray of int8
        Not 0 asks to stop.
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
        """The number of customers."""
        return len(self.costs)

    @property
    def fixed(self) -> bool:
        """Whether each vehicle has a route."""
        return self.fewest == int(self.counts.sum())

    @cached_property
    def depots(self) -> tuple[Floats, Floats, Ints]:
        """Starts, ends and counts as they are, or of all depots in one where vehicles may stay idle."""
        if self.fixed:
            return self.starts, self.ends, self.counts
        ways = (one.min(axis=0, keepdims=True) for one in (self.starts, self.ends))
        return *ways, np.array([self.most])

    def round_trips(self) -> tuple[float, float]:
        """Return bounds on the longest route and on all, by trips to one node and to two."""
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
        """Return a bound on the sum: the cheapest next node of each, where directions differ."""
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
        """Return a bound on the longest route, by nodes far apart: two share a route, or none do.

        Parameters
        ----------
        longest, known : float
            Bounds on the longest route and on the sum.
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
        """Return a bound by priced nodes.

        Parameters
        ----------
        known : float
            Another bound on the sum, from which the length of the steps is taken.
        each : bool
            Whether the mean of the routes that are used is bounded, rather than their sum.
        apart : sequence of int
            Customers of which no two share a route.
        enough : float
            A bound beyond which there is nothing to be gained.
        """
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
                # Some route has two nodes, so that not all r cheapest are both first and last.
                ahead = away[0, outs[0]]
                values += ahead[routes] - ahead[routes - 1]
            values += prices.sum()
            pick = int(np.argmin(values / share))
            value, number = float(values[pick]), int(routes[pick])
            added = sum(float(np.abs(one).sum()) for one in (weights, prices, away, home))
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
    """Return each row's columns by cost, and the sums of the cheapest `taken`, added over the rows."""
    rows, order = np.arange(len(ways))[:, None], np.argsort(ways, axis=1)
    return order, np.cumsum(ways[rows, order], axis=1)[rows, taken - 1].sum(axis=0)


def _paths(first: Floats, costs: Floats) -> Floats:
    """Return the shortest paths to all nodes, by Dijkstra, from what `first` is the way from."""
    found, left = first.copy(), np.ones(first.size, bool)
    for _ in range(first.size):
        at = int(np.where(left, found, np.inf).argmin())
        left[at] = False
        np.minimum(found, found[at] + costs[at], out=found)
    return found


def _spread(trips: Floats, most: int, enough: float) -> list[tuple[float, list[int]]]:
    """Return sets of 2, 3 … `most` nodes far apart, each with the least trip to two of its nodes.

    Nodes are added to each node in turn, that first which is farthest from those chosen.

    Parameters
    ----------
    trips : ndarray, shape (n, n)
        The shortest to each two nodes.
    most : int
        Nodes of the largest set.
    enough : float
        Sets that are no farther apart than this are left out.
    """
    np.fill_diagonal(trips, -np.inf)
    rows = np.arange(len(trips))
    chosen, least, length = [rows], trips.copy(), np.full(len(trips), np.inf)
    found: list[tuple[float, list[int]]] = []
    while len(chosen) < most:
        chosen.append(least.argmax(axis=1))
        length = np.minimum(length, least[rows, chosen[-1]])
        start = int(length.argmax())
        if length[start] <= enough:
            break
        found.append((float(length[start]), [int(nodes[start]) for nodes in chosen]))
        np.minimum(least, trips[chosen[-1]], out=least)
    return found
