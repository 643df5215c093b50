"""Exact routes of a fleet by column generation, cuts and branching; ours.

The linear program over all routes is solved with few of them: its dual prices define reduced costs, and a
labelling returns routes of negative reduced cost (G. Desaulniers, J. Desrosiers, M. Solomon, "Column
generation", 2005).

The longest route is at least T if no m routes of length up to T visit all nodes. The linear program then
minimises the number of visits that are missing. A positive Lagrangian bound proves that T is too small.
Bisection finds the largest such T.

Branching fixes edges, the number of routes per kind of vehicle, and the kind of vehicle of a node.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.fleet import FleetPlan, FleetRouting, Objective
from ...models.fleet.checks import LIMITS
from ...timing import OutOfTime
from ..contract.backend import Answer, Feature, Guarantee, Option, Request, Termination
from .bound import lower_bound, trip_bound
from .fleet_search import FleetSearch
from .pyvrp_routing import PyVrpRouting
from .rivals import FleetBackend
from .route_master import Master
from .route_pricing import Network, kinds_of
from .route_start import fill_idle, insert_nodes, list_columns
from .route_tree import FEASIBLE, INTEGRAL, PENALTY, Node, Relaxed, Stopped, Tree

__all__ = ["ColumnGeneration"]

Floats = NDArray[np.float64]

#: Largest number of nodes, and of arcs of all kinds of vehicles: arrays of 1e7 arcs take 0.6 s.
MOST, MOST_ARCS = 400, 4_000_000
#: Share of the time limit for the heuristic that provides first routes, the seconds without a limit, and
#: seconds granted within half of a short limit: 0.2 s of PyVRP gave longest routes that were 8 % longer.
START, START_SECONDS, SHORT = 0.1, 10.0, 1.0
#: Seconds of the search for the best plan of known routes, and numbers of nodes after which it runs.
COMBINE, COMBINATIONS = 5.0, (1, 5, 20, 60, 200, 600, 2000)
#: Relative width of the interval of the longest route at which bisection ends.
WIDTH = 5e-4
#: Least relative increase of the bound by a round of cuts, and rounds without it that end the cuts.
GAIN, ROUNDS = 2e-4, 2
#: Rounds of cuts without a bound after each round with it.
QUICK = 2
#: Rounds of cuts for each tried length.
ROUNDS_AT_LENGTH = 6


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
        if (nodes := len(problem.customers)) > MOST:
            return f"more than {MOST} nodes, got {nodes}"
        if (arcs := len(kinds_of(problem)) * nodes**2) > MOST_ARCS:
            return f"more than {MOST_ARCS} arcs of all kinds of vehicles, got {arcs}"
        return ""

    def run(self, problem: FleetRouting, request: Request) -> Answer:
        """Solve the model to proven optimality or until a stop."""
        self.require_support(problem)
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
            limit = request.limit
        return Answer(
            termination, limit, plan, None if plan is None else search.value, bound,
            seconds={"solve": clock() - begin}, statistics=search.statistics,
        )  # fmt: skip


class _Search:
    """State of one run. Costs are relative to the `unit` of the network."""

    def __init__(self, model: FleetRouting, request: Request) -> None:
        self.model, self.request, self.control = model, request, request.control
        self.plan: FleetPlan | None = None
        self.value = math.inf
        self.bound: float | None = None
        self.infeasible = self.complete = False
        self.statistics: dict[str, float | int | str] = {}
        distances = model.distances
        self.whole = bool((distances == np.floor(distances)).all() and distances.max() < 2**40)
        self.whole &= model.objective is not Objective.COST
        prizes = np.full(model.size, np.nan) if model.prizes is None else model.prizes
        self.prizes = np.where(np.isnan(prizes), math.inf, prizes)[model.customers]
        self.offset = 0.0 - math.fsum(self.prizes[np.isfinite(self.prizes)].tolist())
        self.nodes = 0

    @property
    def closed(self) -> bool:
        """Whether the gap of the incumbent is at most the requested gap, or the tree is complete."""
        if self.plan is None or self.bound is None:
            return False
        return self.complete or self.value - self.bound <= self.request.gap * abs(self.value)

    @property
    def target(self) -> float:
        """Value at or above which a lower bound closes the gap; below the incumbent."""
        if not math.isfinite(self.value):
            return math.inf
        target = self.value - max(self.request.gap, FEASIBLE) * abs(self.value)
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
            fill_idle(stops)
        return self.keep(self.model.with_schedule(stops))

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

    def solve(self) -> None:
        """Find first routes, the bound of the root, and branch."""
        model, request = self.model, self.request
        if request.warm_start is not None:
            self.keep(request.warm_start)
        self.network = network = Network(model, kinds_of(model))
        self.unit, self.priced = network.unit, network.priced
        #: Relative value above those of all plans.
        self.impossible = 2.0 * (network.size + model.vehicles)
        self.prove(self.offset)  # no cost is negative
        self._start()
        if self.closed or self.control.stopped:
            return
        kinds = network.kinds
        triangle = not model.is_rich and network.keeps_triangles
        # Otherwise, an idle vehicle takes a node from another route, which becomes no longer.
        exact_counts = model.use_all and (self.priced or len(kinds) > 1 or not triangle)
        counts = tuple(
            (float(len(kind.vehicles)) if exact_counts else 0.0, float(len(kind.vehicles)))
            for kind in kinds
        )
        covering = triangle and not exact_counts
        prizes = self.prizes / self.unit
        self.master = Master(network, covering, np.array(counts), PENALTY, prizes)
        self.tree = Tree(network, self.master, request, self.priced)
        self.root = Node(network.barred, frozenset(), counts)
        try:
            for column in list_columns(network, self.plan):
                if self.control.stopped:
                    raise Stopped
                self.master.add(*column)
            relaxed = self._root() if self.priced else self._bisect()
            if not self.closed and not self.infeasible and request.options.get("branch", True):
                self._branch(relaxed.bound if self.priced else 0.0)
        except Stopped:
            pass
        self.statistics |= {
            "routes": len(self.master.columns), "labels": self.tree.pricing.labels, "nodes": self.nodes,
            "capacity cuts": len(self.master.arcs) - len(self.tree.edges),
            "subset-row cuts": len(self.master.triples),
        }  # fmt: skip

    def _start(self) -> None:
        """Run a heuristic and the bounds of relaxations."""
        if not self.model.is_rich:
            self.prove(trip_bound(self.model))
        heuristic: FleetBackend = FleetSearch()
        options: dict[str, Any] = {"bound": False}
        if heuristic.refuses(self.model):
            self._insert()
            heuristic, options = PyVrpRouting(), {}
            if heuristic.missing() or heuristic.refuses(self.model):
                return
        left = self.request.left()
        seconds = START_SECONDS
        if left is not None:
            seconds = min(seconds, max(START * left, min(SHORT, 0.5 * left)))
        if len(self.model.customers) <= 12:  # the proof takes less
            seconds = min(seconds, 0.05)
        with suppress(OutOfTime):  # the kernels are not compiled in time
            answer = self.request.within(
                heuristic, self.model, time_limit=seconds, options=options,
                warm_start=self.plan, threads=1,
            )  # fmt: skip
            if answer.point is not None:
                self.keep(answer.point)
        if self.plan is None:
            self._insert()
        if not self.control.stopped and not self.closed and not self.model.is_rich:
            self.prove(lower_bound(self.model, self.control.flag))

    def _insert(self) -> None:
        """Offer routes by cheapest insertion."""
        prizes = self.prizes / self.unit
        routes = insert_nodes(self.network, prizes, self.priced, lambda: self.control.stopped)
        if routes:
            self.offer(routes)

    def _root(self) -> Relaxed:
        """Solve the linear program of the root with cuts."""
        best, idle = -math.inf, 0
        while True:
            relaxed = self._relax(self.root)
            self.root = relaxed.node
            if relaxed.bound >= self.impossible and self.plan is None:
                self.infeasible = True
                return relaxed
            self.prove(relaxed.bound * self.unit + self.offset)
            if relaxed.values is None or self._integral(relaxed.values):
                return relaxed
            if best == -math.inf:
                self._combine()
            idle = 0 if relaxed.bound - best > GAIN * abs(relaxed.bound) else idle + 1
            best = max(best, relaxed.bound)
            if idle > ROUNDS or not self._cut(relaxed.values, idle > 0):
                return relaxed
            for _ in range(QUICK):
                quick = self._relax(self.root, quick=True)
                if quick.values is None or self._integral(quick.values):
                    break
                if not self._cut(quick.values, idle > 0):
                    break

    def _cut(self, values: Floats, both: bool = False) -> int:
        """Add violated capacity cuts, with `both` or without them subset-row cuts, else enlarge ng-sets."""
        if not self.request.options.get("cuts", True):
            return 0
        count = self.master.cut_capacity(values)
        if both or not count:
            count += self.master.cut_triples(values, lambda: self.control.stopped)
        return count or int(self.tree.remember(values))

    def _bisect(self) -> Relaxed:
        """Find the largest T that the linear program refutes, and report it as the bound."""
        low, high = self.bound or 0.0, self.value
        if not math.isfinite(high):
            relaxed = self._relax(self.root)
            self.infeasible = relaxed.bound > 0.0
            return relaxed
        relaxed = Relaxed(self.root, 0.0)
        while high - low > WIDTH * high and not self.closed:
            tried = 0.5 * (low + high)
            if self.whole:
                tried = math.floor(tried)
            if tried <= low:
                break
            self.tree.longest = tried
            for _ in range(ROUNDS_AT_LENGTH):
                relaxed = self._relax(self.root)
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

    def _relax(self, node: Node, quick: bool = False) -> Relaxed:
        """Solve the linear program of a node, unless its bound excludes better plans; without it if `quick`."""
        self.tree.enough = min((self.target - self.offset) / self.unit, self.impossible)
        return self.tree.converge(node, quick)

    def _combine(self) -> None:
        """Search for the best plan of known routes, after a linear program."""
        left = self.request.left()
        seconds = COMBINE if left is None else min(COMBINE, 0.2 * left)
        most = math.inf
        if self.priced and self.bound is not None:
            most = (self.value - self.bound) / self.unit
        longest = self.tree.longest
        columns = self.master.whole(most, longest, seconds, lambda: self.control.stopped)
        if columns:
            self.offer([(column.kind, column.route) for column in columns])

    def _integral(self, values: Floats) -> bool:
        """Return whether the columns are whole routes, and offer them."""
        if (np.abs(values - np.round(values)) > INTEGRAL).any():
            return False
        columns = [self.master.columns[k] for k in np.flatnonzero(values > 0.5)]
        if not self.offer([(column.kind, column.route) for column in columns]):
            raise Stopped  # a limit is exceeded by rounding
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
                if self.tree.prunes(below):
                    leaves = min(leaves, below)
                    break
            else:
                self.tree.longest = self.target
            self.nodes += 1
            relaxed = self._relax(node)
            for _ in range(ROUNDS):
                if relaxed.values is None or self._integral(relaxed.values):
                    break
                if not self._cut(relaxed.values):
                    break
                relaxed = self._relax(relaxed.node)
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
                for child in self.tree.children(relaxed.node, relaxed.values):
                    heapq.heappush(queue, (below, next(counter), child))
        if not self.closed:
            self.infeasible = self.plan is None
            self.complete = True
            self.prove(leaves * self.unit + self.offset if self.priced else self.target)
