"""Routes through more than a thousand nodes: parts are annealed, and the rest of their routes is fixed.

A part holds the nearest nodes of a random one. The other nodes of their routes form fixed paths, each of
which is one node of the part with the path's length and demand. Source: E. D. Taillard and S. Voss,
"POPMUSIC - Partial optimization metaheuristic under special intensification conditions", in Essays and
Surveys in Metaheuristics, 2002. Distances are computed for one part at a time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetPlan, FleetRouting, Objective
from ...models.fleet.checks import loads_of, objective_of
from .candidate import Candidate, nearest_of, rules_of
from .fleet_kernels import Fleet
from .start import Routes

__all__ = ["Parts"]

#: Number of nodes of a part, and annealing steps per entry of it.
SIZE, STEPS = 300, 60
#: Initial temperature, relative to the energy of the part.
HOT = 0.003
#: Share of parts around a node of the longest route, if the objective depends on it.
LONG = 0.5
#: Relative increase of the objective that is due to rounding.
ROUNDING = 1e-12


class Parts:
    """Routes of a large fleet and their repeated improvement by parts; every node is in one route."""

    def __init__(self, model: FleetRouting, routes: Routes, draw: np.random.Generator) -> None:
        self.model, self.draw = model, draw
        self.routes = [np.array(stops, np.int64) for stops in routes]
        self.unit = model.longest or 1.0
        self.route = np.full(model.size, -1)
        for k, stops in enumerate(self.routes):
            self.route[stops] = k
        self.loads = loads_of(model, self.plan)
        self.near = self._finder()
        self.steps = 0

    @property
    def plan(self) -> FleetPlan:
        """The routes as a plan."""
        return FleetPlan(tuple(tuple(stops.tolist()) for stops in self.routes))

    @property
    def objective(self) -> float:
        """Objective of the routes."""
        return objective_of(self.model, self.loads)

    def _finder(self) -> Callable[[int], NDArray[np.int64]]:
        """Return a function for the nearest nodes of a node."""
        model, count = self.model, min(SIZE, len(self.model.customers))
        nodes = model.customers
        if model.points is not None and model.map is None:
            from scipy.spatial import cKDTree

            points = model.points
            tree = cKDTree(points[nodes])
            return lambda node: nodes[np.atleast_1d(tree.query(points[node], count)[1])]

        def by_length(node: int) -> NDArray[np.int64]:
            lengths = model.legs(node, nodes) + model.legs(nodes, node)
            return nodes[np.argpartition(lengths, count - 1)[:count]]

        return by_length

    def improve(self, flag: NDArray[np.int8], steps: int = 0) -> bool:
        """Anneal one part in `steps`, :data:`STEPS` per entry if 0; return whether the routes changed."""
        model, draw = self.model, self.draw
        pool = model.customers
        if model.objective in (Objective.MAX, Objective.LEXICOGRAPHIC) and draw.random() < LONG:
            pool = self.routes[int(self.loads.argmax())]
        inside = np.zeros(model.size, bool)
        inside[self.near(int(pool[int(draw.integers(0, pool.size))]))] = True
        touched = np.unique(self.route[inside])
        # A vehicle without a route may take over nodes.
        idle = np.flatnonzero([not stops.size for stops in self.routes])
        touched = np.union1d(touched, idle[:1])
        entries: list[NDArray[np.int64]] = []
        stops: list[list[int]] = []
        for k in touched.tolist():
            route = self.routes[k]
            free = inside[route]
            cuts = np.flatnonzero(free[1:] | free[:-1]) + 1
            pieces = np.split(route, cuts) if route.size else []
            stops.append(list(range(len(entries), len(entries) + len(pieces))))
            entries += pieces
        candidate = Candidate(self._part(entries, touched), stops)
        before = candidate.key
        self.steps += candidate.anneal(HOT, steps or STEPS * len(entries), flag, draw)
        if not candidate.key < before:
            return False
        return self._accept(
            touched,
            [
                np.concatenate([entries[i] for i in order] or [np.zeros(0, np.int64)])
                for order in candidate.stops()
            ],
            candidate.key[0] < before[0],
        )

    def _accept(
        self, touched: NDArray[np.int64], routes: list[NDArray[np.int64]], repaired: bool
    ) -> bool:
        """Replace the routes of vehicles unless the objective of all gets worse."""
        old, loads, objective = [self.routes[k] for k in touched], self.loads, self.objective
        for k, stops in zip(touched.tolist(), routes, strict=True):
            self.routes[k] = stops
        self.loads = loads.copy()
        for k in touched.tolist():
            ends = [int(self.model.homes[k])] if self.routes[k].size else []
            chain = np.array([*ends, *self.routes[k], *ends], np.int64)
            self.loads[k] = sum(self.model.legs(chain[:-1], chain[1:]).tolist())
        if not repaired and self.objective > objective * (1.0 + ROUNDING):
            for k, stops in zip(touched.tolist(), old, strict=True):
                self.routes[k] = stops
            self.loads = loads
            return False
        for k in touched.tolist():
            self.route[self.routes[k]] = k
        return True

    def _part(self, entries: list[NDArray[np.int64]], touched: NDArray[np.int64]) -> Fleet:
        """Return the fleet of the vehicles `touched` with `entries`, nodes or fixed paths, as its nodes."""
        model, count = self.model, len(entries)
        homes, home = np.unique(model.homes[touched], return_inverse=True)
        first = np.concatenate([[entry[0] for entry in entries], homes]).astype(np.int64)
        last = np.concatenate([[entry[-1] for entry in entries], homes]).astype(np.int64)
        gaps = model.legs(last[:, None], first) / self.unit
        np.fill_diagonal(gaps, 0.0)
        near = nearest_of(gaps, np.arange(count))
        inner, demands = np.zeros(len(first)), np.zeros(len(first))
        for i, entry in enumerate(entries):
            if entry.size > 1:
                inner[i] = model.legs(entry[:-1], entry[1:]).sum() / self.unit
            if model.demands is not None:
                demands[i] = model.demands[entry].sum()
        # A path's length belongs to the leg towards it.
        gaps += inner
        np.fill_diagonal(gaps, 0.0)
        limits, rules = rules_of(model, self.unit, touched)
        place = np.concatenate([np.arange(len(first)), count + home])
        return Fleet(
            np.arange(count), near, gaps, place, demands, limits, rules, model.use_all
        )  # fmt: skip
