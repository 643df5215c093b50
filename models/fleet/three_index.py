"""Three-index program of a fleet: edges per vehicle, for every objective.

Vehicle k uses the edge between i and j x_ij^k times, visits i if y_i^k = 1, and leaves its depot if
z^k = 1. Its route has the length L_k = Σ d_ij x_ij^k, in a unit near the largest distance. Asymmetric
distances have two arcs instead of each edge. Subtours are excluded by x^k(E(S)) <= y^k(S) - y_j^k;
violated cuts are added lazily. The standard deviation of the lengths is convex and therefore bounded
below by its tangents; violated tangents are added lazily, too.

Permutations of identical vehicles are excluded: a vehicle may visit a node only if the identical
vehicle before it visits a node of earlier rank.
Source: the three-index program of T. Bektas, "The multiple traveling salesman problem: an overview of
formulations and solution procedures", Omega 34, 2006; eq. 15 and 16 are parts of the objective.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, required
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .checks import deviation_of, variance_of
from .cuts import Cut, CutFormulation, Edges, find_isolated_sets, find_weak_sets, merge_cuts
from .data import LEXICOGRAPHIC, Deviation, Objective
from .plan import FleetPlan

__all__ = ["ThreeIndexFormulation"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Largest number of vehicles for which tangents at all 0-1 length vectors are initial rows.
_FEW = 6
#: Violation of a tangent attributed to rounding, relative to the objective and to the lengths.
_EXACT, _ROUNDING = 1e-8, 1e-12
#: Weight of each route length in objectives.
_WEIGHTS = {
    Objective.SUM: 1.0,
    Objective.VARIANCE: 1.0,
    Objective.DEVIATION: 1.0,
    Objective.LEXICOGRAPHIC: LEXICOGRAPHIC,
}
#: Objectives that contain the longest route.
_LONGEST = (Objective.MAX, Objective.LEXICOGRAPHIC, Objective.RANGE)


@dataclass(frozen=True, eq=False)
class ThreeIndexFormulation(CutFormulation):
    """Program of edges per vehicle, with subtour cuts and tangents added at the root and lazily.

    Parameters
    ----------
    model : FleetRouting
        Any fleet model.
    root_rounds : int
        Maximum number of linear programs solved in advance to find root cuts. With 0, cuts are
        added only for solutions that violate them.

    Raises
    ------
    UnsupportedOption
        `root_rounds` is not a whole number >= 0.
    """

    _more: tuple[tuple[float, ...], ...] = field(default=(), init=False, repr=False)

    name: ClassVar[str] = "three-index"
    work: ClassVar[int] = 60_000
    summary: ClassVar[str] = "edges per vehicle, lazy subtour cuts and tangents"

    @cached_property
    def _edges(self) -> Edges:
        return Edges(len(self.model.customers), directed=not self.model.symmetric)

    @cached_property
    def unit(self) -> float:
        """Unit of lengths in the program, a power of 2, as solvers' tolerances are absolute."""
        return float(2.0 ** np.round(np.log2(self.model.distances.max() or 1.0)))

    @cached_property
    def _lengths(self) -> Floats:
        """Length of each edge for each vehicle, in units, shape (vehicles, edges)."""
        nodes = [np.append(self.model.customers, home) for home in self.model.homes]
        distances = self.model.distances / self.unit
        return np.array([self._edges.lengths(distances[np.ix_(a, a)]) for a in nodes])

    @cached_property
    def _ranks(self) -> Indices:
        """Rank of each customer in the symmetry-breaking order; the farthest has rank 0."""
        ranks = np.empty(self._edges.customers, np.int64)
        ranks[np.argsort(-self.model.round_trips[0], kind="stable")] = np.arange(ranks.size)
        return ranks

    @cached_property
    def _groups(self) -> list[list[int]]:
        """Groups of identical vehicles: same depot, capacity and battery."""
        model, groups = self.model, dict[Any, list[int]]()
        for k in range(model.vehicles):
            limits = (None if a is None else float(a[k]) for a in (model.capacity, model.battery))
            groups.setdefault((int(model.homes[k]), *limits), []).append(k)
        return list(groups.values())

    @property
    def _spreads(self) -> list[tuple[str, float, float]]:
        """Columns of deviation and variance that the model needs: name, cost and upper bound."""
        model, unit = self.model, self.unit
        squared = model.objective is Objective.VARIANCE
        spreads = []
        if model.deviation_limit is not None or (model.q > 0 and not squared):
            limit = np.inf if model.deviation_limit is None else model.deviation_limit / unit
            spreads.append(("deviation", 0.0 if squared else model.q * unit, limit))
        if model.q > 0 and squared:
            spreads.append(("variance", model.q * unit**2, np.inf))
        return spreads

    @cached_property
    def tangents(self) -> tuple[tuple[float, ...], ...]:
        """Vectors of route lengths at which the deviation or variance has a tangent row."""
        m = self.model.vehicles
        if not self._spreads or m < 2:
            return ()
        if m <= _FEW:
            ways = list(itertools.product((0.0, 1.0), repeat=m))[1:-1]
        else:
            ways = [tuple(sign * row) for sign in (1.0, -1.0) for row in np.eye(m)]
        return (*ways, *self._more)

    def _build(self, cuts: tuple[Cut, ...]) -> MixedIntegerProgram:
        model, b = self.model, ProgramBuilder()
        x, y, lengths = self._route_rows(b)
        self._order_rows(b, y)
        self._limit_rows(b, y, lengths)
        edges = self._edges
        terms: list[tuple[Any, Any, Any]] = []
        for row, cut in enumerate(cuts):
            columns = x[:, edges.within(cut.members)]
            if cut.vehicle < 0:
                terms.append((row, columns, 1.0))
            else:
                others = [node for node in cut.members if node != cut.node]
                terms += [(row, columns[cut.vehicle], 1.0), (row, y[cut.vehicle, others], -1.0)]
        upper = [len(cut.members) - 1.0 if cut.vehicle < 0 else 0.0 for cut in cuts]
        b.rows("no route without the depot", len(cuts), *terms, upper=np.array(upper))
        return b.build(name=f"{model.name}:three-index" if model.name else "three-index")

    def _route_rows(self, b: ProgramBuilder) -> tuple[Indices, Indices, Indices]:
        """Add columns and rows of edges, nodes and route lengths; return the columns."""
        model, edges = self.model, self._edges
        m, n, size = model.vehicles, edges.customers, edges.size
        tails, heads = edges.ends
        labels = np.array([np.append(model.customers, home) for home in model.homes])
        each = np.arange(m)[:, None]
        twice = (heads == n) & (not edges.directed)
        x = b.columns(
            "edge used", m * size, upper=np.tile(np.where(twice, 2, 1), m), integral=True,
            template="vehicle {0}, edge {1}-{2}",
            index=np.column_stack(
                [np.repeat(np.arange(m), size), labels[:, tails].ravel(), labels[:, heads].ravel()]
            ),
        ).reshape(m, size)  # fmt: skip
        pairs = np.column_stack([np.repeat(np.arange(m), n), labels[:, :n].ravel()])
        y = b.columns(
            "node visited", m * n, upper=1, integral=True, template="vehicle {0}, node {1}",
            index=pairs,
        ).reshape(m, n)  # fmt: skip
        z = b.columns(
            "vehicle used", m, lower=float(model.use_all), upper=1, integral=True,
            template="vehicle {0}",
        )  # fmt: skip
        loads = b.columns(
            "length of the route", m, template="vehicle {0}",
            cost=self.unit * _WEIGHTS.get(model.objective, 0.0),
        )  # fmt: skip
        b.rows(
            "each node visited once", n, (np.arange(n), y, 1.0), lower=1, upper=1,
            template="node {0}", index=model.customers,
        )  # fmt: skip
        held = np.hstack([y, z[:, None]])
        row = each * (n + 1) + np.arange(n + 1)
        places = np.column_stack([np.repeat(np.arange(m), n + 1), labels.ravel()])
        sides: list[tuple[str, tuple[Any, ...], float]]
        sides = [("edges at each node", ((tails, x), (heads, x)), 2.0)]
        if edges.directed:
            sides = [("arcs out", ((tails, x),), 1.0), ("arcs in", ((heads, x),), 1.0)]
        for name, ends, count in sides:
            b.rows(
                name, m * (n + 1), *((each * (n + 1) + end, used, 1.0) for end, used in ends),
                (row, held, -count), lower=0, upper=0, template="vehicle {0}, node {1}",
                index=places,
            )  # fmt: skip
        b.rows(
            "only vehicles that are used", m * n, (each * n + np.arange(n), y, 1.0),
            (each * n + np.arange(n), z[:, None], -1.0), upper=0, template="vehicle {0}, node {1}",
            index=pairs,
        )  # fmt: skip
        b.rows(
            "length of the route", m, (each, x, self._lengths), (np.arange(m), loads, -1.0),
            lower=0, upper=0, template="vehicle {0}",
        )  # fmt: skip
        return x, y, loads

    def _order_rows(self, b: ProgramBuilder, y: Indices) -> None:
        """Add rows that order identical vehicles by the first-ranked node of each."""
        order = np.argsort(self._ranks)
        n = order.size
        after, before = np.nonzero(np.tri(n, k=-1, dtype=bool))
        for group in self._groups:
            for former, k in itertools.pairwise(group):
                b.rows(
                    f"vehicle {k} after vehicle {former}", n, (np.arange(n), y[k, order], 1.0),
                    (after, y[former, order[before]], -1.0), upper=0, template="node {0}",
                    index=self.model.customers[order],
                )  # fmt: skip

    def _limit_rows(self, b: ProgramBuilder, y: Indices, loads: Indices) -> None:
        """Add the rows of the limits and of the objective."""
        model, unit = self.model, self.unit
        each = np.arange(model.vehicles)
        if model.capacity is not None:
            assert model.demands is not None
            b.rows(
                "demands within capacity", each.size,
                (each[:, None], y, model.demands[model.customers]), upper=model.capacity,
                template="vehicle {0}",
            )  # fmt: skip
        if model.battery is not None:
            b.rows(
                "route within battery", each.size, (each, loads, 1.0), upper=model.battery / unit,
                template="vehicle {0}",
            )  # fmt: skip
        if model.budget is not None:
            b.rows("sum within budget", 1, (0, loads, 1.0), upper=model.budget / unit)
        for name, sign in self._extremes:
            least = float(model.round_trips.min(axis=0).max()) / unit if sign > 0 else 0.0
            counted = (
                model.objective in _LONGEST if sign > 0 else model.objective is Objective.RANGE
            )
            cost = sign * counted
            column = b.columns(name, 1, lower=least, cost=cost * unit)
            b.rows(
                f"{name} of all", each.size, (each, column, sign), (each, loads, -sign), lower=0,
                template="vehicle {0}",
            )  # fmt: skip
            if sign < 0 and model.range_limit is not None:
                b.rows(
                    "range within limit", 1, (0, column - 1, 1.0), (0, column, -1.0),
                    upper=model.range_limit / unit,
                )  # fmt: skip
        for name, cost, limit in self._spreads:
            equation = "16" if name == "variance" else ""
            s = b.columns(name, 1, upper=limit, cost=cost, equation=equation)
            slopes = np.array([self._slope(name, way) for way in self.tangents])
            slopes = slopes.reshape(-1, each.size)
            # Y >= Y(a) + g (L - a) = g L - Y(a) for the variance; the deviation is homogeneous.
            levels = [variance_of(np.array(way)) for way in self.tangents if equation]
            b.rows(
                f"tangent of the {name}", len(slopes),
                (np.arange(len(slopes))[:, None], loads, slopes),
                (np.arange(len(slopes)), s, -1.0), upper=np.array(levels) if levels else 0.0,
                equation=equation,
            )  # fmt: skip

    @property
    def _extremes(self) -> list[tuple[str, float]]:
        """Columns of the longest and shortest route length that the model needs, with signs."""
        model = self.model
        if model.objective is Objective.RANGE or model.range_limit is not None:
            return [("longest", 1.0), ("shortest", -1.0)]
        return [("longest", 1.0)] if model.objective in _LONGEST else []

    def _slope(self, name: str, loads: tuple[float, ...]) -> Floats:
        """Return the gradient of the deviation or variance at `loads`, shape (vehicles,)."""
        away = np.array(loads) - np.mean(loads)
        if name == "variance":
            return np.asarray(2.0 * away / len(loads))
        share = len(loads) - (self.model.deviation is Deviation.SAMPLE)
        slope: Floats = away / (np.sqrt(share) * np.linalg.norm(away))
        return slope

    def _separate(self, point: Floats) -> Iterator[Cut]:
        """Yield cuts that a point of the relaxation violates."""
        edges, m = self._edges, self.model.vehicles
        n = edges.customers
        used = point[: m * edges.size].reshape(m, -1)
        visited = point[used.size : used.size + m * n].reshape(m, n)
        together = used.sum(axis=0)
        subtours = find_isolated_sets(edges, together)
        yield from map(Cut, subtours)
        if not subtours:
            for members, _ in find_weak_sets(edges, together, np.ones(n)):
                yield Cut(members)
        for k in range(m):
            for members, node in find_weak_sets(edges, used[k], visited[k]):
                yield Cut(members, k, node)

    def refined(
        self, point: Floats, tolerance: float, duals: Floats | None = None
    ) -> ThreeIndexFormulation | None:
        """Return the formulation with the cuts and tangent that `point` violates; None without any."""
        edges, model = self._edges, self.model
        m = model.vehicles
        used = np.rint(point[: m * edges.size]).reshape(m, -1)
        cuts = merge_cuts(
            self.cuts, (Cut(s) for entry in used for s in find_isolated_sets(edges, entry))
        )
        more = self._more
        loads = (used * self._lengths).sum(axis=1)
        rounding = _ROUNDING * float(loads.max())
        spreads = self._spreads
        for k, (name, cost, limit) in enumerate(spreads):
            spread, weight = self._spread(name, loads), cost / self.unit
            missed = weight * (spread - point[k - len(spreads)]) > max(
                _EXACT * (loads.sum() + weight * spread), rounding
            )
            way = tuple(loads.tolist())
            if way not in (*self.tangents, *more) and (
                missed or spread > limit * (1 + tolerance / 2) + rounding
            ):
                more = (*more, way)
        if len(cuts) == len(self.cuts) and len(more) == len(self._more):
            return None
        return self._changed(_added=cuts, _more=more)

    def encode(self, plan: FleetPlan) -> Floats:
        """Return the columns of `plan`; routes of identical vehicles may be exchanged."""
        required("plan", plan, FleetPlan)
        model, edges = self.model, self._edges
        m, n = model.vehicles, edges.customers
        if len(plan.routes) != m:
            raise InvalidData(f"routes must be {m}, got {len(plan.routes)}", field="routes")
        positions = self._positions(plan)
        routes: list[list[int]] = [[]] * m
        for group in self._groups:
            ranked = sorted(
                (positions[k] for k in group), key=lambda r: min((int(self._ranks[i]) for i in r), default=n)
            )  # fmt: skip
            for k, stops in zip(group, ranked, strict=True):
                routes[k] = stops
        used = np.array([edges.of_routes([route]) for route in routes])
        visited = np.zeros((m, n))
        for k, stops in enumerate(routes):
            np.add.at(visited[k], stops, 1.0)
        loads = (used * self._lengths).sum(axis=1)
        parts = [used.ravel(), visited.ravel(), visited.any(axis=1), loads]
        extremes = {1.0: loads.max(), -1.0: loads.min()}
        parts += [[extremes[sign]] for _, sign in self._extremes]
        parts += [[self._spread(name, loads)] for name, _, _ in self._spreads]
        return np.concatenate(parts)

    def _spread(self, name: str, loads: Floats) -> float:
        """Return the deviation or variance of the route lengths, in the program's unit."""
        return variance_of(loads) if name == "variance" else deviation_of(self.model, loads)

    def decode(self, point: Floats) -> FleetPlan:
        """Return the routes formed by the used edges; raise for edges that miss the depot."""
        edges, model = self._edges, self.model
        m = model.vehicles
        values = Array((self.program.size,)).coerce("point", point, {})
        routes = []
        for k, used in enumerate(values[: m * edges.size].reshape(m, -1)):
            parts = edges.routes(used)
            if len(parts) > 1:
                raise InvalidData(f"point: vehicle {k} has {len(parts)} routes", field="point")
            routes.append(tuple(model.customers[parts[0]].tolist()) if parts else ())
        return FleetPlan(tuple(routes))

    def statistics(self, plan: FleetPlan) -> dict[str, float | int | str]:
        """Return the number of subtour cuts, and of tangents."""
        counts: dict[str, float | int | str] = {"subtour cuts": len(self.cuts)}
        return {**counts, "tangents": len(self.tangents)} if self._spreads else counts
