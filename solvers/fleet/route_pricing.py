"""Cheapest routes of each kind of vehicle at given prices, by joined labels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting
from .route_kernels import CUTS, FULL, Graph, Labels, grow, join, make

__all__ = ["Kind", "Network", "Prices", "Pricing", "kinds_of"]

Floats = NDArray[np.float64]

#: Relative excess over a limit due to rounding of sums in another order.
ROUNDING = 1e-12
#: Number of buckets for the first half of the first resource.
BUCKETS = 24
#: First and largest number of labels of one search.
ROOM, MOST_ROOM = 1 << 16, 1 << 22
#: Number of nodes in an ng-set, of 6 … 12: the bound of X-n101-k25 differs by 0.1 %.
NEAR = 9
#: Largest number of routes returned per kind of vehicle, and of those that visit the same nodes.
ROUTES, SHARED = 100, 5


@dataclass(frozen=True)
class Kind:
    """Vehicles with the same depot, capacity and battery; `forbidden` nodes are in none of their routes."""

    home: int
    vehicles: tuple[int, ...]
    capacity: float
    battery: float


def kinds_of(model: FleetRouting) -> list[Kind]:
    """Return the kinds of vehicles of `model`."""
    none = np.full(model.vehicles, math.inf)
    columns = (
        model.homes, none if model.capacity is None else model.capacity,
        none if model.battery is None else model.battery,
    )  # fmt: skip
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, key in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        groups.setdefault(key, []).append(k)
    return [
        Kind(int(home), tuple(vehicles), capacity, battery)
        for (home, capacity, battery), vehicles in groups.items()
    ]


@dataclass
class Network:
    """Distances, demands and ng-sets of the nodes to visit; nodes are numbered 0 … n - 1, the depot n.

    Attributes
    ----------
    lengths : ndarray, shape (kinds, n + 1, n + 1)
        Distances of each kind of vehicle.
    near : ndarray of bool, shape (n, n)
        Row j is the ng-set of node j.
    """

    model: FleetRouting
    kinds: list[Kind]
    lengths: Floats = field(init=False)
    demands: Floats = field(init=False)
    near: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        nodes = self.model.customers
        n = nodes.size
        self.lengths = np.array(
            [
                self.model.distances[np.ix_(*2 * [np.append(nodes, kind.home)])]
                for kind in self.kinds
            ]
        )
        demands = np.zeros(self.model.size) if self.model.demands is None else self.model.demands
        self.demands = np.append(demands[nodes], 0.0)
        between = self.lengths[0, :n, :n] + self.lengths[0, :n, :n].T
        order = np.argsort(between - 2.0 * between.max() * np.eye(n), axis=1, kind="stable")
        self.near = np.zeros((n, n), bool)
        np.put_along_axis(self.near, order[:, :NEAR], True, axis=1)

    @property
    def size(self) -> int:
        """Number of nodes to visit."""
        return len(self.near)

    @property
    def symmetric(self) -> bool:
        """Whether each route has the same length in both directions."""
        return self.model.symmetric

    def resources(self, k: int, longest: float) -> tuple[Floats, Floats]:
        """Return use and limits of the resources of kind `k`; routes are at most `longest` long.

        The first resource increases on every arc between nodes: load or length, whichever has the smaller
        limit relative to its mean use, or else the number of visits.
        """
        n, kind = self.size, self.kinds[k]
        apart = ~np.eye(n, dtype=bool)
        entries = []
        if math.isfinite(kind.capacity) and self.demands.any():
            entries.append((0.5 * (self.demands[:, None] + self.demands), kind.capacity))
        longest = min(longest, kind.battery)
        if math.isfinite(longest):
            entries.append((self.lengths[k], longest))
        entries.sort(key=lambda entry: entry[1] / max(float(entry[0][:n, :n].mean()), 1e-300))
        increasing = [
            e for e in entries if (e[0][:n, :n][apart] > 1e-6 * e[1]).all() and e[1] > 0.0
        ]
        if increasing:
            entries.sort(key=lambda entry: entry is not increasing[0])
        else:
            visits = np.ones((n + 1, n + 1))
            visits[n] = visits[:, n] = 0.5
            entries.insert(0, (visits, float(n)))
        use = np.ascontiguousarray([entry[0] for entry in entries])
        return use, np.array([entry[1] for entry in entries]) * (1.0 + ROUNDING)


@dataclass
class Prices:
    """Dual prices: of visits, of arcs, and of subset-row cuts with members and memories.

    Attributes
    ----------
    nodes : ndarray, shape (n,)
        Price of each visit.
    arcs : ndarray, shape (n + 1, n + 1)
        Price of each arc, for all kinds of vehicles.
    members, memory : ndarray of uint64, shape (n,)
        Cuts of each node, one bit each.
    penalty : ndarray, shape (64,)
        Prices of the cuts, at least 0.
    """

    nodes: Floats
    arcs: Floats
    members: NDArray[np.uint64]
    memory: NDArray[np.uint64]
    penalty: Floats = field(default_factory=lambda: np.zeros(CUTS))


class Pricing:
    """Search for routes of least reduced cost.

    Attributes
    ----------
    labels : int
        Labels of all searches.
    """

    def __init__(self, network: Network, flag: NDArray[np.int8]) -> None:
        self.network, self.flag = network, flag
        self.labels = 0
        self.room = ROOM

    def reduced(
        self, k: int, costs: Floats, prices: Prices, forbidden: NDArray[np.bool_]
    ) -> Floats:
        """Return the reduced costs of all arcs; `forbidden` arcs, shape (n + 1, n + 1), are infinite."""
        half = 0.5 * np.append(prices.nodes, 0.0)
        reduced = costs - half[:, None] - half - prices.arcs
        np.fill_diagonal(reduced, math.inf)
        reduced[forbidden] = math.inf
        return reduced

    def best(
        self, k: int, costs: Floats, prices: Prices, forbidden: NDArray[np.bool_], longest: float,
        most: float, exact: bool,
    ) -> tuple[float, list[tuple[int, ...]]] | None:  # fmt: skip
        """Return a bound on the reduced costs below `most` and the cheapest routes; None after a stop.

        Parameters
        ----------
        k : int
            Kind of the vehicle.
        costs : ndarray, shape (n + 1, n + 1)
            Costs of the arcs.
        prices : Prices
            Dual prices.
        forbidden : ndarray of bool, shape (n + 1, n + 1)
            Arcs without a route.
        longest : float
            Largest length of a route.
        most : float
            Routes of this reduced cost or more are not returned.
        exact : bool
            Whether no route of an ng-relaxation is cheaper than the bound. Without it, dominance ignores the
            visited nodes.
        """
        network = self.network
        n = network.size
        reduced = self.reduced(k, costs, prices, forbidden)
        use, limit = network.resources(k, longest)
        words = (n + 63) // 64
        own = np.zeros((n, 64 * words), np.uint8)
        own[np.arange(n), np.arange(n)] = 1
        near = np.zeros_like(own)
        near[:, :n] = network.near
        own, near = (
            np.packbits(bits, axis=1, bitorder="little").view(np.uint64) for bits in (own, near)
        )
        low, high = np.zeros((len(limit), n + 1)), np.repeat(limit[:, None], n + 1, axis=1)
        graph = Graph(
            reduced, use, low, high, limit, own, near, prices.members, prices.memory,
            prices.penalty,
        )  # fmt: skip
        ahead = self._labels(graph, exact)
        if ahead is None:
            return None
        behind = ahead
        if not (np.array_equal(reduced, reduced.T) and (use == use.transpose(0, 2, 1)).all()):
            behind = self._labels(
                graph._replace(
                    cost=np.ascontiguousarray(reduced.T),
                    use=np.ascontiguousarray(use.transpose(0, 2, 1)),
                ),
                exact,
            )
            if behind is None:
                return None
        value, pairs = np.full((n + 1, n + 1), most), np.full((n + 1, n + 1, 2), -2)
        (first, starts), (second, ends) = _sorted(ahead, n), _sorted(behind, n)
        if not join(
            graph, ahead[0], behind[0], first, second, starts, ends, value, pairs, self.flag
        ):
            return None
        routes, visits = dict[tuple[int, ...], None](), np.zeros(n, np.int64)
        rows, columns = np.nonzero(pairs[:, :, 0] > -2)
        order = np.argsort(value[rows, columns], kind="stable")
        for i, j in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
            f, b = pairs[i, j].tolist()
            route = (*_walk(ahead[0], f)[::-1], *_walk(behind[0], b))
            if network.symmetric and route[::-1] < route:
                route = route[::-1]
            if (visits[list(route)] >= SHARED).all():
                continue
            visits[list(route)] += 1
            routes[route] = None
            if len(routes) == ROUTES:
                break
        return float(value.min()), list(routes)

    def _labels(self, graph: Graph, exact: bool) -> tuple[Labels, int] | None:
        """Return the labels of half of the routes, and their number; None after a stop."""
        half = 0.5 * float(graph.limit[0]) * (1.0 + ROUNDING)
        while True:
            labels = make(self.room, BUCKETS, graph)
            used = int(grow(graph, labels, max(half, 1e-300), exact, self.flag))
            if used >= 0:
                self.labels += used
                return labels, used
            if used != FULL or self.room >= MOST_ROOM:
                return None
            self.room *= 4


def _sorted(found: tuple[Labels, int], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the active labels by node and cost, with -1 for the depot, and the begin of each node."""
    labels, used = found
    active = np.flatnonzero(labels.alive[:used])
    order = active[np.lexsort((labels.cost[active], labels.node[active]))]
    begins = np.searchsorted(labels.node[order], np.arange(n + 1))
    return np.append(order, -1), np.append(begins, order.size + 1)


def _walk(labels: Labels, label: int) -> list[int]:
    """Return the nodes of a label, the last one first."""
    nodes = []
    while label >= 0:
        nodes.append(int(labels.node[label]))
        label = int(labels.parent[label])
    return nodes
