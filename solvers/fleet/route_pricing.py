"""Cheapest routes of each kind of vehicle at given prices, by joined labels."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective
from .route_kernels import CUTS, FULL, Graph, Labels, grow, join, make, measure, trace

__all__ = ["Kind", "Network", "Prices", "Pricing", "Resource", "kinds_of"]

Floats = NDArray[np.float64]

#: Relative excess over a limit due to rounding of sums in another order.
ROUNDING = 1e-12
#: Least use of the first resource by each arc, relative to its limit.
LEAST = 1e-6
#: Number of buckets for the first half of the first resource.
BUCKETS = 24
#: First and largest number of labels of one search.
ROOM, MOST_ROOM = 1 << 16, 1 << 22
#: Number of nodes in an ng-set, of 6 … 12: the bound of X-n101-k25 differs by 0.1 %.
NEAR = 9
#: Number of remembered nodes that each heuristic search compares, before the exact search compares all.
TIERS = (0, 4)
#: Largest number of routes returned per kind of vehicle, and of those that visit the same nodes, in heuristic
#: searches, and the factor for the exact search.
ROUTES, SHARED, MORE = 100, 5, 4


@dataclass(frozen=True)
class Kind:
    """Vehicles that have the same routes at the same cost; `finish` is -1 for open routes."""

    vehicles: tuple[int, ...]
    home: int
    finish: int
    battery: float
    fixed: float
    rate: float
    speed: float
    early: float
    late: float
    capacity: tuple[float, ...]
    skills: frozenset[str]


def kinds_of(model: FleetRouting) -> list[Kind]:
    """Return the kinds of vehicles of `model`."""
    m = model.vehicles

    def each(values: Any, default: float) -> Any:
        return np.full(m, default) if values is None else values

    shifts = np.tile([0.0, math.inf], (m, 1)) if model.shifts is None else model.shifts
    capacity = each(model.capacity, math.inf).reshape(m, -1)
    skills = [frozenset(names) for names in model.skills or [()] * m]
    columns = (
        model.homes, model.finishes, each(model.battery, math.inf), each(model.fixed_cost, 0.0),
        each(model.distance_cost, 1.0), model.speeds, *shifts.T,
    )  # fmt: skip
    groups: dict[tuple[Any, ...], list[int]] = {}
    for k, key in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        groups.setdefault((*key, tuple(capacity[k].tolist()), skills[k]), []).append(k)
    return [Kind(tuple(vehicles), *key) for key, vehicles in groups.items()]


class Resource(NamedTuple):
    """Use of each arc, limits on the level on arrival, and the limit on the whole route."""

    use: Floats
    low: Floats
    high: Floats
    limit: float


@dataclass
class Network:
    """Arcs and ng-sets of the nodes to visit; nodes are numbered 0 … n - 1, the depot n.

    `lengths`, `costs` and `barred`, shape (kinds, n + 1, n + 1), are distances, costs in the objective divided
    by `unit`, and arcs of nodes that a kind cannot visit. Row j of `near`, shape (n, n), is the ng-set of node
    j.
    """

    model: FleetRouting
    kinds: list[Kind]
    unit: float = field(init=False)
    lengths: Floats = field(init=False)
    costs: Floats = field(init=False)
    barred: NDArray[np.bool_] = field(init=False)
    near: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        model, nodes = self.model, self.model.customers
        n = nodes.size
        self.lengths = np.array([self._arcs(model.distances, kind) for kind in self.kinds])
        scales = [self.lengths.max()]
        self.costs = np.zeros_like(self.lengths)
        if self.priced:
            for k, kind in enumerate(self.kinds):
                rate = kind.rate if model.objective is Objective.COST else 1.0
                self.costs[k] = rate * self.lengths[k]
                # Half each way, so that costs remain symmetric.
                self.costs[k, n] += 0.5 * kind.fixed
                self.costs[k, :, n] += 0.5 * kind.fixed
            scales = [self.costs.max()]
        if model.prizes is not None:
            scales.append(np.nanmax(model.prizes, initial=0.0))
        self.unit = float(max(scales)) or 1.0
        self.costs /= self.unit
        self.barred = np.zeros(self.lengths.shape, bool)
        for k, kind in enumerate(self.kinds):
            lacks = np.zeros(n + 1, bool)
            if model.requires is not None:
                lacks[:n] = [not kind.skills.issuperset(model.requires[i]) for i in nodes]
            self.barred[k] = lacks[:, None] | lacks | (self._shift(kind) is None)
        between = self.lengths[0, :n, :n] + self.lengths[0, :n, :n].T
        order = np.argsort(between - 2.0 * between.max() * np.eye(n), axis=1, kind="stable")
        self.near = np.zeros((n, n), bool)
        np.put_along_axis(self.near, order[:, :NEAR], True, axis=1)
        self.tiers = [np.zeros_like(self.near) for _ in TIERS]
        for tier, count in zip(self.tiers, TIERS, strict=True):
            np.put_along_axis(tier, order[:, :count], True, axis=1)
        self.stored = dict[tuple[int, float], list[Resource]]()

    @property
    def size(self) -> int:
        """Number of nodes to visit."""
        return len(self.near)

    @property
    def priced(self) -> bool:
        """Whether routes have costs: always, except that the longest of several routes is minimised."""
        return self.model.objective is not Objective.MAX or self.model.vehicles == 1

    @property
    def keeps_triangles(self) -> bool:
        """Whether no detour over one node to visit is shorter."""
        rows = self.model.distances
        return all(bool((rows <= rows[:, k, None] + rows[k]).all()) for k in self.model.customers)

    @property
    def symmetric(self) -> bool:
        """Whether each route has the same length, and is as feasible, in both directions."""
        plain = not self.model.has_times and (self.model.finishes == self.model.homes).all()
        return bool(plain and self.model.symmetric)

    def _arcs(self, values: Floats, kind: Kind) -> Floats:
        """Return the values of the arcs from the depot, between the nodes, and to the end."""
        nodes = self.model.customers
        stops = np.append(nodes, kind.home)
        arcs: Floats = values[np.ix_(stops, stops)]
        arcs[:-1, -1] = values[nodes, kind.finish] if kind.finish >= 0 else 0.0
        return arcs

    def window(self, node: int) -> tuple[float, float]:
        """Return the begin and end of the window of a node of the model."""
        windows = self.model.windows
        spans = None if windows is None else windows[node]
        return (-math.inf, math.inf) if spans is None else (spans[0][0], spans[-1][1])

    def _shift(self, kind: Kind) -> tuple[float, float] | None:
        """Return the earliest departure and the latest return; None if no route is feasible."""
        begin, end = self.window(kind.home)
        early, late = max(kind.early, begin), kind.late
        if kind.finish >= 0:
            first, last = self.window(kind.finish)
            late = min(late, last)
            if first > late:
                return None
        return None if early > end or early > late else (early, late)

    def resources(self, k: int, longest: float) -> list[Resource]:
        """Return the resources of kind `k`; routes are at most `longest` long.

        The first resource increases on every arc between nodes. It is the load, length or time with the
        smallest limit relative to its mean use, or else the number of visits.
        """
        if (k, longest) in self.stored:
            return self.stored[k, longest]
        n, kind, model = self.size, self.kinds[k], self.model
        entries = []
        if model.demands is not None:
            loads = np.zeros((n + 1, len(kind.capacity)))
            loads[:n] = model.demands.reshape(model.size, -1)[model.customers]
            for column, capacity in zip(loads.T, kind.capacity, strict=True):
                if column.any():
                    entries.append(_additive(0.5 * (column[:, None] + column), capacity))
        if math.isfinite(min(longest, kind.battery)):
            entries.append(_additive(self.lengths[k], min(longest, kind.battery)))
        shift = self._shift(kind)
        if model.has_times and shift is not None:
            entries.append(self._times(kind, *shift))
        entries.sort(key=lambda entry: entry.limit / max(float(entry.use[:n, :n].mean()), 1e-300))
        apart = ~np.eye(n, dtype=bool)
        for entry in entries:
            if entry.limit > 0.0 and (entry.use[:n, :n][apart] > LEAST * entry.limit).all():
                entries.sort(key=lambda other: other is not entry)
                break
        else:
            visits = np.ones((n + 1, n + 1))
            visits[n] = visits[:, n] = 0.5
            entries.insert(0, _additive(visits, float(n)))
        self.stored[k, longest] = entries
        return entries

    def _times(self, kind: Kind, early: float, late: float) -> Resource:
        """Return time since the departure as a resource; arcs contain the service at their tail."""
        n, nodes, model = self.size, self.model.customers, self.model
        use = self._arcs(model.base_times, kind) / kind.speed
        if model.service is not None:
            use[:n] += model.service[nodes][:, None]
        spans = np.array([self.window(int(node)) for node in nodes])
        low = np.append(np.maximum(spans[:, 0] - early, 0.0), 0.0)
        high = np.append(spans[:, 1] - early, math.inf)
        if not math.isfinite(late):
            finite = high[np.isfinite(high)].max(initial=0.0)
            late = early + max(low.max(), finite) + (n + 1) * float(use.max())
        limit = (late - early) * (1.0 + ROUNDING)
        return Resource(use, low, np.minimum(high + ROUNDING * limit, limit), limit)

    def fits(self, k: int, route: tuple[int, ...]) -> bool:
        """Return whether kind `k` can visit the nodes of a route in their order."""
        stops = [self.size, *route, self.size]
        if self.barred[k][stops[:-1], stops[1:]].any():
            return False
        for resource in self.resources(k, math.inf):
            level = 0.0
            for tail, head in itertools.pairwise(stops):
                level = max(level + resource.use[tail, head], resource.low[head])
                if level > resource.high[head]:
                    return False
        return True


def _words(rows: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Return each row as words of 64 bits."""
    n = len(rows)
    bits = np.zeros((n, -(-n // 64) * 64), bool)
    bits[:, :n] = rows
    return np.packbits(bits, axis=1, bitorder="little").view(np.uint64)


def _additive(use: Floats, limit: float) -> Resource:
    """Return a resource that is only limited on the whole route."""
    limit *= 1.0 + ROUNDING
    n = len(use)
    return Resource(use, np.zeros(n), np.full(n, limit), limit)


@dataclass
class Prices:
    """Dual prices of visits, shape (n,), of arcs, shape (n + 1, n + 1), and of subset-row cuts.

    `members` and `memory` have one bit per cut at each node; `penalty`, shape (64,), are its prices, at least
    0.
    """

    nodes: Floats
    arcs: Floats
    members: NDArray[np.uint64]
    memory: NDArray[np.uint64]
    penalty: Floats = field(default_factory=lambda: np.zeros(CUTS))


class Pricing:
    """Search for routes of least reduced cost; `labels` counts those of all searches."""

    def __init__(self, network: Network, flag: NDArray[np.int8]) -> None:
        self.network, self.flag = network, flag
        self.labels = 0
        self.room = ROOM

    def best(
        self, k: int, prices: Prices, forbidden: NDArray[np.bool_], longest: float,
        most: float, tier: int,
    ) -> tuple[float, list[tuple[int, ...]]] | None:  # fmt: skip
        """Return a bound on the reduced costs below `most` and the cheapest routes; None after a stop.

        Routes of kind `k` avoid the arcs `forbidden`, shape (n + 1, n + 1), and are at most `longest` long. In
        the last `tier`, no route of an ng-relaxation is cheaper than the bound. In earlier ones, dominance
        ignores most of the visited nodes.
        """
        network = self.network
        n = network.size
        graph = self._graph(k, prices, forbidden, longest, tier)
        halves = self._halves(graph, tier == len(TIERS))
        if halves is None:
            return None
        ahead, behind = halves
        value, pairs = np.full((n + 1, n + 1), most), np.full((n + 1, n + 1, 2), -2)
        (first, starts), (second, ends) = _sorted(ahead, n), _sorted(behind, n)
        if not join(
            graph, ahead[0], behind[0], first, second, starts, ends, value, pairs, self.flag
        ):
            return None
        routes, visits = dict[tuple[int, ...], None](), np.zeros(n, np.int64)
        factor = MORE if tier == len(TIERS) else 1
        rows, columns = np.nonzero(pairs[:, :, 0] > -2)
        order = np.argsort(value[rows, columns], kind="stable")
        for i, j in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
            f, b = pairs[i, j].tolist()
            route = (*_walk(ahead[0], f)[::-1], *_walk(behind[0], b))
            if network.symmetric and route[::-1] < route:
                route = route[::-1]
            if (visits[list(route)] >= factor * SHARED).all():
                continue
            visits[list(route)] += 1
            routes[route] = None
            if len(routes) == factor * ROUTES:
                break
        return float(value.min()), list(routes)

    def useful(
        self, k: int, prices: Prices, forbidden: NDArray[np.bool_], longest: float, most: float
    ) -> NDArray[np.bool_] | None:
        """Return a mask of the arcs of all routes with reduced costs below `most`; None after a stop.

        The mask, shape (n + 1, n + 1), may contain more arcs. The other arguments are those of :meth:`best`.
        """
        n = self.network.size
        graph = self._graph(k, prices, forbidden, longest, len(TIERS))
        halves = self._halves(graph, True, store=True)
        if halves is None:
            return None
        (ahead, used), (behind, count) = halves
        # The last entry belongs to the depot, which has no label.
        before, after = np.full(used + 1, most), np.full(count + 1, most)
        value = np.full((n + 1, n + 1), most)
        (first, starts), (second, ends) = _sorted(halves[0], n), _sorted(halves[1], n)
        if not measure(
            graph, ahead, behind, first, second, starts, ends, before, after, value, self.flag
        ):
            return None
        trace(graph, ahead, used, before, value)
        reverse = np.ascontiguousarray(value.T)
        trace(graph, behind, count, after, reverse)
        mask = most > reverse.T
        # A route and its reverse may differ by rounding; both stay, so that costs remain symmetric.
        return mask | mask.T if self.network.symmetric else mask

    def _graph(
        self, k: int, prices: Prices, forbidden: NDArray[np.bool_], longest: float, tier: int
    ) -> Graph:
        """Return the network of kind `k` at reduced costs."""
        network = self.network
        n = network.size
        half = 0.5 * np.append(prices.nodes, 0.0)
        reduced = network.costs[k] - half[:, None] - half - prices.arcs
        np.fill_diagonal(reduced, math.inf)
        reduced[forbidden] = math.inf
        resources = zip(*network.resources(k, longest), strict=True)
        use, low, high, limit = (np.array(values) for values in resources)
        near = _words(network.near)
        return Graph(
            reduced, use, low, high, limit, _words(np.eye(n, dtype=bool)), near, prices.members,
            prices.memory, prices.penalty, [*map(_words, network.tiers), near][tier],
        )  # fmt: skip

    def _halves(
        self, graph: Graph, exact: bool, store: bool = False
    ) -> tuple[tuple[Labels, int], tuple[Labels, int]] | None:
        """Return the forward and the backward labels, and their numbers; None after a stop."""
        ahead = self._labels(graph, exact, store)
        if ahead is None or (self.network.symmetric and np.array_equal(graph.cost, graph.cost.T)):
            return None if ahead is None else (ahead, ahead)
        behind = self._labels(
            graph._replace(
                cost=np.ascontiguousarray(graph.cost.T),
                use=np.ascontiguousarray(graph.use.transpose(0, 2, 1)),
                low=graph.limit[:, None] - graph.high,
                high=graph.limit[:, None] - graph.low,
            ),
            exact, store,
        )  # fmt: skip
        return None if behind is None else (ahead, behind)

    def _labels(self, graph: Graph, exact: bool, store: bool) -> tuple[Labels, int] | None:
        """Return the labels of half of the routes, and their number; None after a stop."""
        half = 0.5 * float(graph.limit[0]) * (1.0 + ROUNDING)
        while True:
            labels = make(self.room, BUCKETS, graph)
            used = int(grow(graph, labels, max(half, 1e-300), exact, store, self.flag))
            if used >= 0:
                self.labels += used
                return labels, used
            if used != FULL or self.room >= MOST_ROOM:
                return None
            self.room *= 4


def _sorted(found: tuple[Labels, int], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the active labels by node and cost, with -1 for the depot, and the begin of each node."""
    labels, used = found
    active = np.flatnonzero(labels.better[:used] < 0)
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
