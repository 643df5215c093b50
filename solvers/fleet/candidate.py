"""Routes of a fleet in the arrays of the kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import Deviation, FleetRouting, Objective
from .fleet_kernels import Fleet, Routes, measure, workspace
from .search_kernels import anneal

__all__ = ["CODES", "PENALTY", "Candidate", "nearest_of", "rules_of", "scaled"]

Floats = NDArray[np.float64]

#: Number of nearest nodes next to which a node may be inserted.
NEIGHBOURS = 20
#: Initial and final temperature at most, in mean edges of the objective.
HOT_EDGES, COLD_EDGES = 1.5, 0.015
#: Final temperature relative to the energy.
COLD = 3e-4
#: Weight of the mean load in the energy if the objective depends on the longest route.
MEAN = 0.03
#: Penalty for a violation as large as its limit, in units of mean plus longest load.
PENALTY = 10.0
#: Codes of the objectives in the kernels.
CODES = {
    Objective.SUM: 0, Objective.MAX: 1, Objective.DEVIATION: 2, Objective.RANGE: 3,
    Objective.LEXICOGRAPHIC: 4, Objective.VARIANCE: 5,
}  # fmt: skip


def nearest_of(distances: Floats, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the nearest other `nodes` of each of them, by the way there and back; -1 beyond the last."""
    width = max(1, min(NEIGHBOURS, len(nodes) - 1))
    near = np.full((len(distances), width), -1, np.int64)
    for place, i in enumerate(nodes):
        both = distances[i, nodes] + distances[nodes, i]
        both[place] = math.inf
        # Only entries up to the last neighbour are sorted; ties keep the order of the nodes.
        picked = np.flatnonzero(both <= np.partition(both, width - 1)[width - 1])
        picked = picked[picked != place]
        order = nodes[picked[np.argsort(both[picked], kind="stable")][:width]]
        near[i, : order.size] = order
    return near


def rules_of(
    model: FleetRouting, unit: float, vehicles: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Return batteries and capacities of `vehicles`, and the rules of :class:`~.fleet_kernels.Fleet`."""
    m, none = len(vehicles), math.inf
    divisor = m - 1 if model.deviation is Deviation.SAMPLE else m
    # The variance is in squared units.
    scale = unit if model.objective is Objective.VARIANCE else 1.0
    weight = 1e-6 if model.objective is Objective.LEXICOGRAPHIC else model.q * scale
    flat = model.objective in (Objective.MAX, Objective.LEXICOGRAPHIC)
    # In the order of the kernels. Limits over all vehicles do not apply to some of them.
    limits = [model.budget, model.deviation_limit, model.range_limit]
    if m < model.vehicles:
        limits = [None] * 3
    rules = [
        float(CODES[model.objective]), weight, float(divisor), MEAN if flat else 0.0,
        *(none if limit is None else limit / unit for limit in limits), PENALTY, -none,
        float(model.capacity is not None or model.battery is not None),
    ]  # fmt: skip

    def each(limit: Floats | None, scale: float) -> Floats:
        return np.full(m, none) if limit is None else limit[vehicles] / scale

    return np.array([each(model.battery, unit), each(model.capacity, 1.0)]), np.array(rules)


def scaled(model: FleetRouting, annealed: bool = True) -> Fleet:
    """Return the data of `model` for the kernels; without nearest nodes unless it is `annealed`."""
    n, nodes = model.size, model.customers
    unit = float(model.distances.max()) or 1.0
    distances = np.ascontiguousarray(model.distances / unit)
    limits, rules = rules_of(model, unit, np.arange(model.vehicles))
    near = nearest_of(distances, nodes) if annealed else np.full((n, 1), -1, np.int64)
    return Fleet(
        nodes, near, distances, np.concatenate([np.arange(n), model.homes]),
        np.zeros(n) if model.demands is None else np.array(model.demands), limits, rules,
        model.use_all,
    )  # fmt: skip


class Candidate:
    """Routes with their key, the violation of limits and the objective; infinite if nodes are missing.

    `stops` lists the nodes of each vehicle. Annealing inserts the missing nodes.
    """

    def __init__(self, fleet: Fleet, stops: list[list[int]]) -> None:
        self.fleet = fleet
        self.assign(stops)

    def assign(self, stops: list[list[int]]) -> None:
        """Set the stops of each vehicle."""
        fleet, m = self.fleet, self.fleet.limits.shape[1]
        n = len(fleet.place) - m
        marks = np.concatenate([np.zeros(n, np.int64), n + np.arange(m)])
        none = np.full(n + m, -1, np.int64)
        self.routes = routes = Routes(np.array([marks, marks, none]), np.zeros((3, m)))
        after, before, route = routes.links
        self.key = (math.inf, math.inf)
        for k, nodes in enumerate(stops):
            chain = np.array([n + k, *nodes, n + k])
            after[chain[:-1]], before[chain[1:]] = chain[1:], chain[:-1]
            route[nodes] = k
            legs = fleet.distances[fleet.place[chain[:-1]], fleet.place[chain[1:]]]
            routes.values[:, k] = legs.sum(), fleet.demands[nodes].sum(), len(nodes)
        if (route[fleet.nodes] >= 0).all():
            self._measure()

    def _measure(self) -> None:
        _, objective, broken = measure(self.fleet, self.routes, workspace(self.routes))
        self.key = (float(broken), float(objective))

    def stops(self) -> list[list[int]]:
        """Return the stops of each vehicle."""
        after, m = self.routes.links[0].tolist(), self.fleet.limits.shape[1]
        n = len(after) - m
        routes = []
        for k in range(m):
            stops, node = [], after[n + k]
            while node < n:
                stops.append(node)
                node = after[node]
            routes.append(stops)
        return routes

    def anneal(
        self, hot: float, steps: int, flag: NDArray[np.int8], draw: np.random.Generator
    ) -> int:
        """Anneal the routes, set them to the best ones found and return the number of steps."""
        m = self.fleet.limits.shape[1]
        single = self.fleet.rules[0] in (1, 3, 4)  # the objective depends on single routes
        edges = 1 + len(self.fleet.nodes) / m if single else m + len(self.fleet.nodes)
        hot, cold = min(hot, HOT_EDGES / edges), min(COLD, COLD_EDGES / edges)
        links, values = self.routes
        now, top = (Routes(links.copy(), values.copy()) for _ in range(2))
        work = workspace(self.routes)
        done, _, _ = anneal(self.fleet, self.routes, now, top, work, hot, cold, steps, flag, draw)
        self._measure()
        return int(done)
