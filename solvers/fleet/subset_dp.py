"""Exact dynamic program over subsets of the nodes for small fleets; ours.

The shortest tour through a vehicle's nodes is optimal if the objective never decreases when a route
gets longer. This holds for the sum and the longest route. For Σ L_k + q s, the derivative by L_k is
1 + q (L_k - mean) / (√D ‖L - mean‖), with D = m - 1 or m. No entry of a vector that sums to 0 is less
than -√((m - 1) / m) times its norm. So the condition holds for q up to √(D m / (m - 1)), which is √m
for the sample deviation. A detour may pay for larger q, for the range, and under limits on deviation
or range; such models are refused.

Tours are computed by the dynamic program of M. Held and R. M. Karp, "A dynamic programming approach to
sequencing problems", Journal of SIAM 10, 1962, once per depot. A second program over subsets assigns
them to vehicles.

For rich fleets, :mod:`.rich_tours` computes the tours, and sets without optional nodes are complete, too.

A set is a whole number with one bit per node. ``tours[k, S]`` is the length of the shortest route of
vehicle k through S, infinite if the route is infeasible.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import clock, kernel
from ...models.fleet.checks import LIMITS, value_of
from ...models.fleet.data import LEXICOGRAPHIC, Deviation, FleetData, Objective
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ..contract.backend import Answer, Feature, Guarantee, Limit, Request, Termination
from .bound import trip_bound
from .rich_tours import MOST_RICH, best_routes, first_routes, refuse_rich, value_of_sets
from .rivals import FleetBackend
from .start import first_plan
from .whole import COMMON

__all__ = ["SubsetDP", "best_spread", "least_sums", "shortest_tours"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Maximum number of customers and of vehicles: 3^15 pairs of set and subset take 1 s per vehicle.
MOST = 15
#: Largest number of customers for which the tables take less than about a second.
SOON = 10
#: Largest number of customers for which the tables take milliseconds.
FEW = 6
#: Relative excess over a limit due to rounding of sums in another order.
_ROUNDING = 1e-12


class SubsetDP(FleetBackend):
    """Exact solver: Held and Karp's tours of all subsets, assigned to vehicles by dynamic programming."""

    name = "subset-dp"
    rich = COMMON | {"stations", "makespan"}
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.INCUMBENTS, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    summary = f"exact, over all subsets of at most {MOST} nodes, {MOST_RICH} for rich fleets; ours"

    def refuses(self, problem: Any) -> str:
        """Return the reason for refusal, "" for a supported model: features, size, or a detour may pay."""
        if reason := super().refuses(problem) or (refuse_rich(problem) if problem.is_rich else ""):
            return reason
        size, vehicles = len(problem.customers), problem.vehicles
        if max(size, vehicles) > MOST:
            return f"more than {MOST} nodes or vehicles, got {size} and {vehicles}"
        for rule in LIMITS:
            if rule.field in problem.limits and not rule.monotone:
                return f"{rule.field}, for which a detour may pay"
        squared = problem.objective is Objective.VARIANCE and problem.q > 0
        if squared or problem.objective is Objective.RANGE:
            return f"the objective {str(problem.objective)!r}, for which a detour may pay"
        largest = math.sqrt(_share(problem) * vehicles / max(vehicles - 1, 0.5))
        if problem.q > largest and vehicles > 1:
            return (
                f"q = {problem.q:g}: it takes q up to {largest:.6g}, beyond which a detour may pay"
            )
        return ""

    def starter(self, problem: Any) -> str:
        """Return the search that provides a first plan while large tables are computed."""
        return "fleet-search" if len(problem.customers) > SOON else ""

    def run(self, problem: FleetRouting, request: Request) -> Answer:
        """Solve the model to proven optimality or until a stop."""
        self.require_support(problem)
        begin = clock()
        search = _Search(problem, request)
        search.solve()
        plan, stopped = search.plan, request.control.stopped
        termination = Termination.INFEASIBLE
        if stopped and not search.done:
            termination = Termination.NO_SOLUTION if plan is None else Termination.FEASIBLE
        elif plan is not None:
            termination = Termination.OPTIMAL
        ended = termination in (Termination.INFEASIBLE, Termination.OPTIMAL)
        bound = search.value if termination is Termination.OPTIMAL else search.bound
        return Answer(
            termination,
            None if ended else request.control.reason or Limit.INTERRUPTED,
            plan,
            search.value if plan is not None else None,
            bound if math.isfinite(bound) else None,
            seconds={"solve": clock() - begin},
            statistics=search.statistics,
        )


def _share(model: FleetData) -> float:
    """Return the divisor of the sum of squares."""
    return float(max(model.vehicles - (model.deviation is Deviation.SAMPLE), 1))


def shortest_tours(distances: Floats) -> Floats:
    """Return the lengths of shortest paths from the depot through each set, and of the tours.

    `distances`, shape (n + 1, n + 1), are those of n customers and the depot, which is last. In the result,
    shape (2^n, n + 1), column j is the path through set S that ends at j in S, and the last column the
    tour.
    """
    n = len(distances) - 1
    sets = np.arange(2**n)
    counts = ((sets[:, None] >> np.arange(n)) & 1).sum(axis=1)
    lengths = np.full((2**n, n + 1), np.inf)
    lengths[1 << np.arange(n), np.arange(n)] = distances[n, :n]
    for count in range(2, n + 1):
        for j in range(n):
            chosen = sets[(counts == count) & (sets >> j & 1 == 1)]
            lengths[chosen, j] = (lengths[chosen ^ (1 << j), :n] + distances[:n, j]).min(axis=1)
    lengths[:, n] = (lengths[:, :n] + distances[:n, n]).min(axis=1)
    lengths[0, n] = 0.0
    return lengths


class _Search:
    """Tables of one model, and the incumbent."""

    def __init__(self, model: FleetRouting, request: Request) -> None:
        self.model, self.control = model, request.control
        self.plan: FleetPlan | None = None
        self.value, self.done = math.inf, False
        self.bound = self.floor = -math.inf if model.is_rich else trip_bound(model)
        self.statistics: dict[str, float | int | str] = {"programs over subsets": 0}
        self.ways: dict[int, tuple[Floats, Floats]] = {}
        self.routes: list[dict[int, tuple[int, ...]]] = []
        n = model.customers.size
        #: Value of each set of visited nodes: negative prizes, inf if a node is missing.
        self.values = np.full(2**n, math.inf)
        self.values[-1] = 0.0
        self.tours = np.empty((model.vehicles, 2**n))
        self.sums = np.empty((model.vehicles + 1, 2**n))
        self.choice = np.empty((model.vehicles, 2**n), np.int64)

    def _shortest(self) -> None:
        """Fill the table of the tours of a plain fleet."""
        model, customers = self.model, self.model.customers
        n = customers.size
        bits = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
        for k, home in enumerate(model.homes.tolist()):
            if home not in self.ways:
                nodes = np.append(customers, home)
                distances = model.distances[np.ix_(nodes, nodes)]
                self.ways[home] = shortest_tours(distances), distances
            tours = self.ways[home][0][:, n].copy()
            if model.battery is not None:
                tours[tours > model.battery[k] * (1 + _ROUNDING)] = np.inf
            if model.capacity is not None:
                assert model.demands is not None
                carried = bits @ model.demands[customers]
                tours[carried > model.capacity[k] * (1 + _ROUNDING)] = np.inf
            if model.use_all:
                tours[0] = np.inf
            self.tours[k] = tours

    def _rich(self) -> bool:
        """Fill the table of the tours of a rich fleet; return False after a stop."""
        n, vehicles = self.model.customers.size, self.model.vehicles
        for most in {n, -(-n // vehicles)}:  # few per vehicle, if each must have a route
            plan = self.model.with_schedule(first_routes(self.model, most))
            if self.model.verify(plan, tolerance=_ROUNDING).ok:
                self._offer_plan(plan)
        tables = best_routes(self.model, lambda: self.control.stopped)
        if tables is None:
            return False
        self.tours[:], self.routes = (
            np.array([table[0] for table in tables]),
            [table[1] for table in tables],
        )
        if self.model.objective is Objective.MAKESPAN and not self.model.use_all:
            # An idle vehicle does not return, so its entry must not exceed a negative return.
            self.tours[:, 0] = self.tours.min()
        self.values = value_of_sets(self.model)
        return True

    def solve(self) -> None:
        """Find the best plan; `done` remains False after a stop."""
        objective = self.model.objective
        if not self.model.is_rich:
            self._shortest()
            self._start()
        elif not self._rich():
            return
        least = self._sum(math.inf)
        if least is None:
            return
        self.bound = least  # bound on the sum; replaced below for other objectives
        if objective in (Objective.MAX, Objective.LEXICOGRAPHIC, Objective.MAKESPAN):
            self.bound = self.floor
            if math.isfinite(least) and not self._longest(least):
                return
        elif objective is Objective.DEVIATION and self.model.q > 0 and math.isfinite(least):
            if not self._spread():
                return
        self.done = True

    def _start(self) -> None:
        """Make heuristic routes the incumbent, for a stop before the tables are complete."""
        if len(self.model.customers) <= FEW:
            return
        first = first_plan(self.model, np.random.default_rng(0), lambda: self.control.stopped)
        if first is not None:
            self.plan, self.value = first
            self.control.incumbent(self.value, self.plan)

    def _sum(self, limit: float) -> float | None:
        """Return the least sum with routes up to `limit`, inf if infeasible; None after a stop."""
        model = self.model
        self.statistics["programs over subsets"] = int(self.statistics["programs over subsets"]) + 1
        if not least_sums(self.tours, limit, self.sums, self.choice, self.control.flag):
            return None
        totals = self.sums[0] + self.values
        best = int(np.argmin(totals))
        least = float(totals[best])
        if model.budget is not None and least > model.budget * (1 + _ROUNDING):
            return math.inf
        if math.isfinite(least):
            owned, left = [], best
            for k in range(model.vehicles):
                owned.append(int(self.choice[k, left]))
                left ^= owned[-1]
            self._offer(owned)
        return least

    def _offer(self, owned: list[int]) -> None:
        """Make the plan with the sets `owned` the incumbent if it is better."""
        routes = tuple(self._route(k, entry) for k, entry in enumerate(owned))
        self._offer_plan(self.model.with_schedule(routes))

    def _offer_plan(self, plan: FleetPlan) -> None:
        value = value_of(self.model, plan)
        if value is not None and value < self.value:
            self.plan, self.value = plan, value
            self.control.incumbent(value, plan)

    def _route(self, k: int, owned: int) -> tuple[int, ...]:
        """Return the shortest tour of vehicle k through the set `owned`."""
        if self.routes:
            return self.routes[k][owned]
        ways, distances = self.ways[int(self.model.homes[k])]
        at, route = len(distances) - 1, list[int]()
        while owned:
            at = int(np.argmin(ways[owned, :-1] + distances[:-1, at]))
            route.append(int(self.model.customers[at]))
            owned ^= 1 << at
        return tuple(route[::-1])

    def _longest(self, total: float) -> bool:
        """Minimise the longest route by bisection; return False after a stop."""
        lengths = np.unique(self.tours[np.isfinite(self.tours)])
        low, high, best_total = 0, lengths.size - 1, total
        while low < high:
            middle = (low + high) // 2
            total_at_limit = self._sum(float(lengths[middle]))
            if total_at_limit is None:
                return False
            if math.isfinite(total_at_limit):
                high, best_total = middle, total_at_limit
            else:
                low = middle + 1
                self.bound = max(self.floor, float(lengths[low]))
        self.bound = float(lengths[high])
        if self.model.objective is Objective.LEXICOGRAPHIC:
            # A longer route may pay up to the possible decrease of the sum.
            reach = self.bound + LEXICOGRAPHIC * (best_total - total)
            for limit in lengths[(lengths > lengths[high]) & (lengths <= reach)].tolist():
                if self._sum(limit) is None:
                    return False
        return True

    def _spread(self) -> bool:
        """Minimise the sum plus q times the deviation; return False after a stop."""
        model = self.model
        limits = (model.homes, model.capacity, model.battery)
        kinds = list(zip(*(a.tolist() for a in limits if a is not None), strict=True))
        alike = np.array([len(set(kinds[k:])) == 1 for k in range(len(kinds))], np.int8)
        owned = np.full(len(kinds), -1)
        budget = 1e300 if model.budget is None else model.budget * (1 + _ROUNDING)
        _, tried = best_spread(
            self.tours, self.sums, alike, model.q, _share(model), budget, self.value, owned,
            self.control.flag,
        )  # fmt: skip
        self.statistics["parts tried"] = int(tried)
        if owned[0] >= 0:
            self._offer(owned.tolist())
        return not self.control.stopped


@kernel(interpretable=True)
def least_sums(
    tours: Floats, limit: float, sums: Floats, choice: Ints, flag: NDArray[np.int8]
) -> bool:
    """Compute the least total length for vehicles k, k + 1, … to visit S, for all k and S.

    Routes are at most `limit` long. `sums`, shape (vehicles + 1, sets), are the lengths, infinite if
    infeasible, and `choice`, shape (vehicles, sets), the sets that vehicle k takes. Return whether the
    tables are complete; a nonzero `flag` requests a stop.
    """
    vehicles, size = tours.shape
    for s in range(size):
        sums[vehicles, s] = math.inf
    sums[vehicles, 0] = 0.0
    for k in range(vehicles - 1, -1, -1):
        for s in range(size):
            if flag[0] != 0:
                return False
            best, taken, part = math.inf, 0, s
            while True:
                if tours[k, part] <= limit:
                    total = tours[k, part] + sums[k + 1, s ^ part]
                    if total < best:
                        best, taken = total, part
                if part == 0:
                    break
                part = (part - 1) & s
            sums[k, s] = best
            choice[k, s] = taken
    return True


@kernel
def _objective(loads: Floats, count: int, rest: float, q: float, share: float) -> float:
    """Return Σ L + q s if the lengths from index `count` on are equal and sum to `rest`."""
    vehicles = len(loads)
    each = rest / (vehicles - count) if count < vehicles else 0.0
    total = rest if count < vehicles else 0.0
    for k in range(count):
        total += loads[k]
    mean, squares = total / vehicles, 0.0
    for k in range(count):
        squares += (loads[k] - mean) ** 2
    squares += (vehicles - count) * (each - mean) ** 2
    return total + q * math.sqrt(squares / share)


@kernel(interpretable=True)
def best_spread(
    tours: Floats, sums: Floats, alike: NDArray[np.int8], q: float, share: float, budget: float,
    ceiling: float, owned: Ints, flag: NDArray[np.int8],
) -> tuple[float, int]:  # fmt: skip
    """Return the least Σ L + q s over all partitions of the nodes, by branch and bound, and the sets tried.

    The objective increases with every length. It is bounded below by equal lengths of the remaining
    vehicles with the least total length. ``alike[k]`` states whether vehicle k and all later ones are
    identical: then k takes the first remaining node. `share` is the divisor of the sum of squares, and
    `budget` the largest total length. Only objectives below `ceiling` are considered; the sets of the best
    partition are written to `owned`. A nonzero `flag` requests a stop.
    """
    vehicles, size = tours.shape
    loads, left = np.zeros(vehicles), np.zeros(vehicles, np.int64)
    part, best, tried, k = np.zeros(vehicles, np.int64), ceiling, 0, 0
    left[0] = part[0] = size - 1
    while k >= 0:
        if flag[0] != 0:
            break
        now = part[k]
        if now < 0:
            k -= 1
            continue
        part[k] = -1 if now == 0 else (now - 1) & left[k]
        first = left[k] & -left[k]
        if (alike[k] != 0 and now & first != first) or tours[k, now] == math.inf:
            continue
        rest = sums[k + 1, left[k] ^ now]
        loads[k] = tours[k, now]
        total = rest
        for other in range(k + 1):
            total += loads[other]
        if not total <= budget:
            continue
        tried += 1
        if _objective(loads, k + 1, rest, q, share) >= best:
            continue
        if k + 1 == vehicles:
            best = _objective(loads, vehicles, 0.0, q, share)
            for other in range(vehicles):
                owned[other] = left[other] ^ (left[other + 1] if other + 1 < vehicles else 0)
        else:
            k += 1
            left[k] = part[k] = left[k - 1] ^ now
    return best, tried
