r"""Exact routes of a fleet by column generation, cuts and branching; ours.

The linear program over all routes is solved with few of them: its dual prices define reduced costs, and a
labelling returns routes of negative reduced cost (G. Desaulniers, J. Desrosiers, M. Solomon, "Column
generation", 2005). For prices :math:`\pi` of the rows with right-hand sides b, and the least reduced cost
:math:`c_k` of the routes of each kind of vehicle, :math:`\pi b + \sum_k m_k \min(c_k, 0)` is a lower
bound for every :math:`\pi` (Lagrange). So no tolerance of the linear program enters the bound; the
possible rounding error of the sums is subtracted.

The longest route is at least T if no m routes of length up to T visit all nodes. The linear program then
minimises the number of visits that are missing. A positive Lagrangian bound proves that T is too small.
Bisection finds the largest such T.

Branching fixes edges, the number of routes per kind of vehicle, and the kind of vehicle of a node. The
prices are smoothed (A. Pessoa and others, "Automation and combination of linear-programming based
stabilization techniques in column generation", INFORMS Journal on Computing 30, 2018).
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.fleet import FleetPlan, FleetRouting, Objective
from ...models.fleet.checks import LIMITS
from ..contract.backend import (
    Answer,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from .bound import lower_bound, trip_bound
from .fleet_search import FleetSearch
from .rivals import FleetBackend
from .route_master import Master
from .route_pricing import Network, Pricing, kinds_of

__all__ = ["ColumnGeneration"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Largest number of nodes: the arrays of arcs and the labels grow with its square.
MOST = 400
#: Share of the time limit, and seconds without limit, for the heuristic that provides first routes.
START, START_SECONDS = 0.1, 10.0
#: Weight of the best prices in the smoothed prices.
SMOOTH = 0.6
#: Cost of a missing visit in units of the longest distance: first value, factor and largest value.
PENALTY, RAISE, HIGHEST = 2.0, 10.0, 1e9
#: Seconds of the search for the best plan of known routes, and numbers of nodes after which it runs.
COMBINE, COMBINATIONS = 5.0, (1, 5, 20, 60, 200, 600, 2000)
#: Largest number of missing visits of a feasible linear program.
FEASIBLE = 1e-9
#: Relative difference of the linear program and its bound at which it is solved.
SOLVED = 1e-7
#: Relative width of the interval of the longest route at which bisection ends.
WIDTH = 5e-4
#: Least relative increase of the bound by a round of cuts, and rounds without it that end the cuts.
GAIN, ROUNDS = 2e-4, 2
#: Rounds of cuts for each tried length.
ROUNDS_AT_LENGTH = 6
#: Rounding error of one operation.
EPSILON = 2.0**-52
#: Distance of a value to a whole number that counts as integral.
INTEGRAL = 1e-6


class ColumnGeneration(FleetBackend):
    """Exact solver: linear programs over priced routes, cuts, and branch and bound."""

    name = "column-generation"
    rich = frozenset(
        {
            "times", "speed", "service", "windows", "shifts", "dimensions", "ends", "requires",
            "skills", "prizes", "fixed_cost", "distance_cost", "cost",
        }
    )  # fmt: skip
    guarantee = Guarantee.EXACT
    features = frozenset(
        {
            Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.WARM_START,
            Feature.DUAL_BOUND, Feature.GAP,
        }
    )  # fmt: skip
    single_threaded = True
    is_automatic = False  # as a search, fleet-search finds better plans within a short limit
    requires = ("highspy",)
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "cuts": Option(True, "Whether to add capacity and subset-row cuts.", bool),
        "branch": Option(True, "Whether to branch after the bound of the root.", bool),
    }
    summary = "exact for the sum and the longest route, by column generation and branching; ours"

    def refuses(self, problem: Any) -> str:
        """Return the reason for refusal, "" for a supported model: objective, limits or size."""
        if missing := super().refuses(problem):
            return missing
        if problem.objective not in (Objective.SUM, Objective.MAX, Objective.COST):
            return f"the objective {str(problem.objective)!r}, only 'sum', 'max' and 'cost'"
        if any(spans is not None and len(spans) > 1 for spans in problem.windows or ()):
            return "several windows of one node"
        for rule in LIMITS:
            if rule.field != "battery" and rule.field in problem.limits:
                return f"the limit {rule.field}"
        if len(problem.customers) > MOST:
            return f"more than {MOST} nodes, got {len(problem.customers)}"
        return ""

    def run(self, problem: FleetRouting, request: Request) -> Answer:
        """Solve the model to proven optimality or until a stop."""
        if reason := self.refuses(problem):
            raise UnsupportedFormulation(f"backend {self.name!r} does not cover {reason}")
        begin = clock()
        search = _Search(problem, request)
        search.solve()
        plan, bound, limit = search.plan, search.bound, None
        if search.infeasible:
            termination, bound = Termination.INFEASIBLE, None
        elif plan is not None and search.closed:
            termination = Termination.OPTIMAL
        else:
            termination = Termination.NO_SOLUTION if plan is None else Termination.FEASIBLE
            if request.control.stopped or request.left() == 0.0:
                limit = request.control.reason or Limit.TIME
        return Answer(
            termination, limit, plan, None if plan is None else search.value, bound,
            seconds={"solve": clock() - begin}, statistics=search.statistics,
        )  # fmt: skip


@dataclass(frozen=True)
class _Node:
    """Node of the tree: forbidden arcs of each kind, required edges and numbers of routes."""

    forbidden: Mask
    required: frozenset[tuple[int, int]]
    counts: tuple[tuple[float, float], ...]


@dataclass
class _Relaxed:
    """Solution of a node's linear program: its bound, and values of the columns if it was solved."""

    bound: float
    value: float = math.inf
    values: Floats | None = None
    complete: bool = True


class _Stop(Exception):
    """A stop was requested, or labels do not fit into memory."""


class _Search:
    """State of one run. Costs are relative to the `unit` of the network."""

    def __init__(self, model: FleetRouting, request: Request) -> None:
        self.model, self.request, self.control = model, request, request.control
        self.plan: FleetPlan | None = request.warm_start
        self.value = math.inf
        self.bound: float | None = None
        self.infeasible = self.complete = False
        self.statistics: dict[str, float | int | str] = {}
        distances = model.distances
        self.whole = bool((distances == np.floor(distances)).all() and distances.max() < 2**40)
        self.whole &= model.objective is not Objective.COST
        self.longest = math.inf
        self.priced = model.objective is not Objective.MAX
        prizes = np.full(model.size, np.nan) if model.prizes is None else model.prizes
        self.prizes = np.where(np.isnan(prizes), math.inf, prizes)[model.customers]
        self.offset = -math.fsum(self.prizes[np.isfinite(self.prizes)].tolist())
        self.edges = dict[tuple[int, int], int]()
        self.nodes = 0

    # -- incumbent and bound ---------------------------------------------------------------------

    @property
    def closed(self) -> bool:
        """Whether the gap of the incumbent is at most the requested gap, or the tree is complete."""
        if self.plan is None or self.bound is None:
            return False
        return self.complete or self.value - self.bound <= self.request.gap * abs(self.value)

    @property
    def target(self) -> float:
        """Value at or above which a lower bound closes the gap."""
        if not math.isfinite(self.value):
            return math.inf
        target = self.value - self.request.gap * abs(self.value)
        return min(target, self.value - 1.0 + INTEGRAL) if self.whole else target

    def prove(self, bound: float) -> None:
        """Report a lower bound, rounded up if all distances are whole numbers."""
        if self.whole and math.isfinite(bound):
            bound = math.ceil(bound)
        if math.isfinite(bound) and (self.bound is None or bound > self.bound):
            self.bound = min(bound, self.value)
            self.control.prove(self.bound)

    def offer(self, routes: list[tuple[int, tuple[int, ...]]]) -> bool:
        """Make routes of kinds, with nodes 0 … n - 1, the incumbent if better; return whether feasible."""
        stops: list[tuple[int, ...]] = [()] * self.model.vehicles
        free = [list(kind.vehicles) for kind in self.network.kinds]
        seen = set[int]()
        for kind, route in routes:
            if not free[kind]:
                return False
            once = [node for node in dict.fromkeys(route) if node not in seen]
            seen.update(once)
            stops[free[kind].pop(0)] = tuple(int(self.model.customers[node]) for node in once)
        if self.model.use_all:
            self._fill(stops)
        return self.keep(self.model.with_schedule(stops))

    def _fill(self, stops: list[tuple[int, ...]]) -> None:
        """Give each idle vehicle the last node of a route with several nodes."""
        for k, route in enumerate(stops):
            donor = max(range(len(stops)), key=lambda other: len(stops[other]))
            if not route and len(stops[donor]) > 1:
                stops[k], stops[donor] = stops[donor][-1:], stops[donor][:-1]

    def keep(self, plan: FleetPlan) -> bool:
        """Make a feasible plan the incumbent if it is better; return whether it is feasible."""
        checked = self.model.verify(plan, tolerance=FEASIBLE)
        if not checked.ok or checked.objective is None:
            return False
        if checked.objective >= self.value:
            return True
        self.plan, self.value = plan, checked.objective
        self.control.incumbent(self.value, plan)
        return True

    # -- solution --------------------------------------------------------------------------------

    def solve(self) -> None:
        """Find first routes, the bound of the root, and branch."""
        model, request = self.model, self.request
        start, self.plan = self.plan, None
        if start is not None:
            self.keep(start)
        self.network = Network(model, kinds_of(model))
        self.unit = self.network.unit
        self._start()
        if self.closed or self.control.stopped:
            return
        network, kinds = self.network, self.network.kinds
        self.pricing = Pricing(network, self.control.flag)
        triangle = all(_keeps_triangles(entry) for entry in network.lengths)
        # Otherwise, an idle vehicle takes a node from another route, which becomes no longer.
        exact_counts = model.use_all and (self.priced or len(kinds) > 1 or not triangle)
        counts = tuple(
            (float(len(kind.vehicles)) if exact_counts else 0.0, float(len(kind.vehicles)))
            for kind in kinds
        )
        covering = triangle and not exact_counts and not model.is_rich
        prizes = self.prizes / self.unit
        self.master = Master(network, covering, np.array(counts), PENALTY, prizes)
        self.root = _Node(network.barred, frozenset(), counts)
        self._first_columns()
        try:
            relaxed = self._root() if self.priced else self._bisect()
            if relaxed.values is not None and not self.closed and self.priced:
                self._combine()
            if not self.closed and not self.infeasible and request.options.get("branch", True):
                self._branch(relaxed.bound if self.priced else 0.0)
        except _Stop:
            pass
        self.statistics |= {
            "routes": len(self.master.columns), "labels": self.pricing.labels, "nodes": self.nodes,
            "capacity cuts": len(self.master.arcs) - len(self.edges),
            "subset-row cuts": len(self.master.triples),
        }  # fmt: skip

    def _start(self) -> None:
        """Run the heuristic and the bounds of relaxations."""
        heuristic = FleetSearch()
        if heuristic.refuses(self.model):
            return
        if not self.model.is_rich:
            self.prove(trip_bound(self.model))
        left = self.request.left()
        seconds = START_SECONDS if left is None else min(START * left, START_SECONDS)
        if len(self.model.customers) <= 12:
            seconds = min(seconds, 0.2)
        answer = self.request.within(
            heuristic, self.model, time_limit=seconds, options={"bound": False},
            warm_start=self.plan, threads=1,
        )  # fmt: skip
        if answer.point is not None:
            self.keep(answer.point)
        if not self.control.stopped and not self.closed and not self.model.is_rich:
            self.prove(lower_bound(self.model, self.control.flag))

    def _first_columns(self) -> None:
        """Add the routes of the incumbent, and single nodes."""
        place = {int(node): k for k, node in enumerate(self.model.customers)}
        for k in range(len(self.network.kinds)):
            for node in range(self.network.size):
                if self.network.fits(k, (node,)):
                    self.master.add(k, (node,))
        if self.plan is None:
            return
        for k, kind in enumerate(self.network.kinds):
            for vehicle in kind.vehicles:
                route = tuple(place[node] for node in self.plan.routes[vehicle])
                if route:
                    if self.network.symmetric:
                        route = min(route, route[::-1])
                    self.master.add(k, route)

    def _root(self) -> _Relaxed:
        """Solve the linear program of the root with cuts."""
        best, idle = -math.inf, 0
        while True:
            relaxed = self._converge(self.root)
            if relaxed.bound >= self.impossible:
                self.infeasible = True
                return relaxed
            self.prove(relaxed.bound * self.unit + self.offset)
            if relaxed.values is None or self._integral(relaxed.values):
                return relaxed
            idle = 0 if relaxed.bound - best > GAIN * abs(relaxed.bound) else idle + 1
            best = max(best, relaxed.bound)
            if idle > ROUNDS or not self._cut(relaxed.values):
                return relaxed

    def _cut(self, values: Floats) -> int:
        """Add violated cuts and return their number."""
        if not self.request.options.get("cuts", True):
            return 0
        return self.master.cut_capacity(values) or self.master.cut_triples(values)

    def _bisect(self) -> _Relaxed:
        """Find the largest T that the linear program refutes, and report it as the bound."""
        low, high = self.bound or 0.0, self.value
        if not math.isfinite(high):
            relaxed = self._converge(self.root)
            self.infeasible = relaxed.bound > 0.0
            return relaxed
        relaxed = _Relaxed(0.0)
        while high - low > WIDTH * high and not self.closed:
            tried = 0.5 * (low + high)
            if self.whole:
                tried = math.floor(tried)
            if tried <= low:
                break
            self.longest = tried
            for _ in range(ROUNDS_AT_LENGTH):
                relaxed = self._converge(self.root)
                if relaxed.values is None or self._integral(relaxed.values):
                    break
                if not self._cut(relaxed.values):
                    break
            if relaxed.bound > 0.0:
                low = tried
                self.prove(tried + 1.0 if self.whole else tried)
            else:
                high = min(tried, self.value)
        return relaxed

    # -- one linear program ----------------------------------------------------------------------

    @property
    def impossible(self) -> float:
        """Value above those of all plans."""
        return 2.0 * (self.network.size + self.model.vehicles) if self.priced else 0.0

    def _apply(self, node: _Node) -> None:
        """Pass the limits of a node to the linear program."""
        master, n = self.master, self.network.size
        for k, (low, high) in enumerate(node.counts):
            master.bound_row(n + k, low, high)
        for edge, row in self.edges.items():
            master.bound_row(row, 1.0 if edge in node.required else -math.inf, math.inf)
        most = self.longest * (1.0 + 1e-12)
        allowed = [
            column.length <= most
            and not node.forbidden[column.kind, column.tails, column.heads].any()
            and _remembers(column.route, self.network.near)
            for column in master.columns
        ]
        master.allow(np.array(allowed, bool))

    def _pruned(self, bound: float) -> bool:
        """Return whether a bound excludes better plans from a node."""
        if not self.priced:
            return bound > 0.0
        return bound >= min((self.target - self.offset) / self.unit, self.impossible)

    def _converge(self, node: _Node) -> _Relaxed:
        """Solve the linear program of a node, or stop once its bound prunes the node."""
        self._apply(node)
        master, bound, guide, exact = self.master, -math.inf, -math.inf, False
        master.set_penalty(PENALTY if self.priced else 1.0)
        center: Floats | None = None
        while True:
            value, values, duals, lacking = self._solved()
            if not self.priced and value <= FEASIBLE:
                return _Relaxed(0.0, value, values)
            mixed = 0.0 if center is None else SMOOTH
            while True:
                prices = mixed * _wide(center, duals) + (1.0 - mixed) * duals if mixed else duals
                below, added = self._price(node, prices, exact)
                if center is None or below > guide:
                    center, guide = prices, below
                bound = max(bound, below) if exact else bound
                if self._pruned(bound):
                    return _Relaxed(bound, value)
                if added:
                    exact = False
                    break
                if mixed:
                    mixed = 0.0
                elif not exact:
                    exact, mixed, guide = True, SMOOTH, bound
                elif lacking > FEASIBLE and self.priced:
                    if master.penalty > HIGHEST:
                        raise _Stop
                    master.set_penalty(RAISE * master.penalty)
                    center, exact = None, False
                    break
                else:
                    return _Relaxed(bound, value, values)
            if self.priced and value - bound <= SOLVED * abs(value) and lacking <= FEASIBLE:
                return _Relaxed(bound, value, values)

    def _solved(self) -> tuple[float, Floats, Floats, float]:
        """Return the solution of the linear program over the known routes."""
        solved = None if self.control.stopped else self.master.solve(self.request.left())
        if solved is None:
            raise _Stop
        value, values, duals, lacking = solved
        return value, values, self.master.signed(duals), lacking

    def _price(self, node: _Node, duals: Floats, exact: bool) -> tuple[float, int]:
        """Return the Lagrangian bound of prices, valid if `exact`, and the number of new routes."""
        master, n = self.master, self.network.size
        prices = master.prices(duals)
        terms, added = master.terms(duals), 0
        # Every label sums at most n + 1 reduced costs, each of which sums the prices of all rows.
        size = float(self.network.costs.max()) + math.fsum(np.abs(duals).tolist())
        error = EPSILON * (n + 4) * (n + len(duals) + 8) * size
        for k, (low, high) in enumerate(node.counts):
            offset = float(duals[n + k])
            found = self.pricing.best(k, prices, node.forbidden[k], self.longest, offset, exact)
            if found is None:
                raise _Stop
            least, routes = found
            least = min(least, offset) - error
            terms.append(least * (low if least > 0.0 else high))
            added += sum(master.add(k, route) for route in routes)
        return math.fsum(terms) - EPSILON * len(terms) * math.fsum(map(abs, terms)), added

    def _combine(self) -> None:
        """Search for the best plan of known routes, after a linear program."""
        left = self.request.left()
        seconds = COMBINE if left is None else min(COMBINE, 0.2 * left)
        most = math.inf
        if self.priced and self.bound is not None:
            most = (self.value - self.bound) / self.unit
        columns = self.master.whole(most, seconds, lambda: self.control.stopped)
        if columns:
            self.offer([(column.kind, column.route) for column in columns])

    # -- branching -------------------------------------------------------------------------------

    def _integral(self, values: Floats) -> bool:
        """Return whether the columns are whole routes, and offer them."""
        if (np.abs(values - np.round(values)) > INTEGRAL).any():
            return False
        columns = [self.master.columns[k] for k in np.flatnonzero(values > 0.5)]
        if not self.offer([(column.kind, column.route) for column in columns]):
            raise _Stop  # a limit is exceeded by rounding
        return True

    def _branch(self, below: float) -> None:
        """Branch and bound from the root, the node of least bound first."""
        for row in range(self.network.size):
            self.master.bound_row(row, 1.0, 1.0)
        counter = itertools.count()
        queue = [(below, next(counter), self.root)]
        leaves = math.inf
        while queue and not self.closed:
            below, _, node = heapq.heappop(queue)
            if self.priced:
                self.prove(min(below, leaves) * self.unit + self.offset)
                if self._pruned(below):
                    leaves = min(leaves, below)
                    break
            else:
                self.longest = self.target
            self.nodes += 1
            relaxed = self._converge(node)
            for _ in range(ROUNDS):
                if relaxed.values is None or self._integral(relaxed.values):
                    break
                if not self._cut(relaxed.values):
                    break
                relaxed = self._converge(node)
            if relaxed.values is not None and self.nodes in COMBINATIONS:
                self._combine()
            below = max(below, relaxed.bound)
            if relaxed.values is None:
                leaves = min(leaves, below)
            elif self._integral(relaxed.values):
                if self.priced:
                    leaves = min(leaves, below)
                else:  # the limit on the length is lower now
                    heapq.heappush(queue, (below, next(counter), node))
            else:
                for child in self._children(node, relaxed.values):
                    heapq.heappush(queue, (below, next(counter), child))
        if self.closed:
            return
        if self.plan is None:
            self.infeasible = True
            return
        self.complete = True
        self.prove(
            leaves * self.unit + self.offset if self.priced and not self.whole else self.target
        )

    def _children(self, node: _Node, values: Floats) -> list[_Node]:
        """Return the two parts of a node with a fractional solution."""
        network, n = self.network, self.network.size
        flow = self.master.flows(values)[:n, :n]
        flow = np.triu(flow + flow.T) if network.symmetric else flow
        away = np.abs(flow - np.round(flow))
        if away.max(initial=0.0) > INTEGRAL:
            i, j = (int(x) for x in np.unravel_index(away.argmax(), away.shape))
            return self._split_edge(node, i, j)
        visits = np.zeros((len(network.kinds), n))
        counts = np.zeros(len(network.kinds))
        for k in np.flatnonzero(values > 0.0):
            column = self.master.columns[k]
            np.add.at(visits[column.kind], list(column.route), values[k])
            counts[column.kind] += values[k]
        away = np.abs(counts - np.round(counts))
        if away.max() > INTEGRAL:
            k = int(away.argmax())
            low, high = node.counts[k]
            parts = (low, math.floor(counts[k])), (math.ceil(counts[k]), high)
            return [
                replace(node, counts=(*node.counts[:k], part, *node.counts[k + 1 :]))
                for part in parts
            ]
        away = np.abs(visits - np.round(visits))
        if away.max() > INTEGRAL:
            k, i = (int(x) for x in np.unravel_index(away.argmax(), away.shape))
            without, only = node.forbidden.copy(), node.forbidden.copy()
            without[k, i] = without[k, :, i] = True
            others = [other for other in range(len(network.kinds)) if other != k]
            only[others, i] = only[others, :, i] = True
            return [replace(node, forbidden=without), replace(node, forbidden=only)]
        if not self._remember(values):
            raise _Stop
        return [node]

    def _split_edge(self, node: _Node, i: int, j: int) -> list[_Node]:
        """Return the nodes without and with an edge (an arc if distances are asymmetric)."""
        forbidden = node.forbidden.copy()
        forbidden[:, i, j] = True
        matrix = np.zeros(forbidden.shape[1:])
        matrix[i, j] = 1.0
        if self.network.symmetric:
            forbidden[:, j, i] = True
            matrix[j, i] = 1.0
        if (i, j) not in self.edges:
            self.edges[i, j] = self.master.add_arcs(matrix, 1.0, math.inf)
        required = node.required | {(i, j)}
        return [replace(node, forbidden=forbidden), replace(node, required=required)]

    def _remember(self, values: Floats) -> bool:
        """Enlarge the ng-sets so that they exclude the cycles of a solution; return whether it has one."""
        changed = False
        for k in np.flatnonzero(values > 0.0):
            route = self.master.columns[k].route
            last = dict[int, int]()
            for place, stop in enumerate(route):
                if stop in last:
                    self.network.near[list(route[last[stop] : place]), stop] = True
                    changed = True
                last[stop] = place
        return changed


def _remembers(route: tuple[int, ...], near: Mask) -> bool:
    """Return whether a route repeats a node only after it left the ng-sets of that node."""
    if len(set(route)) == len(route):
        return True
    seen = np.zeros(len(near), bool)
    for stop in route:
        if seen[stop]:
            return False
        seen &= near[stop]
        seen[stop] = True
    return True


def _keeps_triangles(lengths: Floats) -> bool:
    """Return whether no detour over one node is shorter."""
    return all(
        bool((lengths <= lengths[:, k, None] + lengths[k]).all()) for k in range(len(lengths))
    )


def _wide(center: Floats | None, duals: Floats) -> Floats:
    """Return the prices `center` with zeros for the rows added since."""
    assert center is not None
    return np.concatenate([center, np.zeros(duals.size - center.size)])
