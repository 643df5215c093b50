"""Adapter of PyVRP, a benchmark from research."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...models.fleet import FleetRouting, Objective
from ..contract.backend import Option, Request
from .rivals import Best, FleetHeuristic, whole_demands, whole_distances

__all__ = ["PyVrpRouting"]

#: Whole number that represents the longest distance or the total demand.
LARGEST = 10**7
#: Minimum mean demand, so that no shorter route pays for an overload.
DEAR = 2000
#: Largest number of nodes, as PyVRP stores several copies of the matrices.
MOST = 5000
#: Length of a forbidden arc.
BARRED = 10**9
#: Initial and minimum relative reduction of the longest route.
STEP, LEAST = 0.1, 1e-4

Routes = list[list[int]]


class PyVrpRouting(FleetHeuristic):
    """PyVRP's iterated local search for the sum of all lengths, with a falling limit for the longest.

    Source: N. A. Wouda, L. Lan and W. Kool, "PyVRP: a high-performance VRP solver package", INFORMS
    Journal on Computing 36 (2024). PyVRP minimises the sum only. For "max" and "max-sum", repeated
    searches require all routes to be shorter than the incumbent's longest by a given share; the share
    is halved after a search without success. PyVRP cannot require that every vehicle is used. For the
    sum, each vehicle therefore has to visit a copy of its depot, with no arc back to a copy. For the
    longest route, an empty vehicle receives the node that is cheapest to move. Limits on the sum, the
    deviation and the range are checked but do not guide the search. A stop request takes effect after
    the first local search, which takes seconds for thousands of nodes.
    """

    name = "pyvrp"
    single_threaded = True
    requires = ("pyvrp",)
    extra = "routing"
    options: ClassVar[Mapping[str, Option]] = {
        "patience": Option(
            200,
            "Iterations without a better plan after which a search ends. The search for the sum ends "
            "after ten times as many, or at the time limit if there is one.",
            int,
            lower=1,
        ),
    }
    summary = "PyVRP: iterated local search for the sum, and for the longest route under a limit"

    def refuses(self, problem: FleetRouting) -> str:
        """Return the reason for refusal, "" for a supported model: rich features, objective or size."""
        if reason := super().refuses(problem):
            return reason
        if problem.objective is Objective.RANGE:
            return "the objective 'range'"
        if problem.q > 0:
            return f"the objective {str(problem.objective)!r} with q > 0"
        if problem.size > MOST:
            return f"more than {MOST} nodes, got {problem.size}"
        return ""

    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Minimise the sum, then reduce the longest route step by step if the objective needs it."""
        limited = best.problem.objective in (Objective.MAX, Objective.LEXICOGRAPHIC)
        posed = _Posed(best.problem, best.problem.use_all and not limited)
        endless = request.time_limit is not None
        patience, seed = request.options["patience"], request.seed or 0
        counts = {"searches": 1, "iterations": 0}

        def look(limit: float, start: Routes | None, patience: float, first: bool) -> Routes | None:
            """Return feasible routes of length <= `limit`: the first, or the best within `patience`."""
            solution, iterations = posed.search(
                limit, start, seed + counts["searches"] - 1, best.offer_filled,
                lambda: request.control.stopped, patience, first,
            )  # fmt: skip
            counts["iterations"] += iterations
            return solution

        whole = math.inf if endless else 10 * patience
        routes = look(math.inf, None, patience if limited else whole, False)
        if routes is None or not limited:
            return counts
        step = STEP
        while not request.control.stopped and (step >= LEAST or endless):
            counts["searches"] += 1
            longest = posed.longest(routes)
            limit = math.floor(longest * (1.0 - max(step, LEAST)))
            if not 0 < limit < longest:
                break
            result = look(limit, routes, patience, True)
            if result is None:
                step /= 2
            else:
                routes = result
        if best.problem.objective is Objective.LEXICOGRAPHIC and not request.control.stopped:
            counts["searches"] += 1
            look(posed.longest(routes), routes, patience, False)
        return counts


@dataclass
class _Kind:
    """Group of vehicles with the same depot, capacity and battery."""

    home: int
    capacity: int
    battery: float
    members: list[int]


class _Posed:
    """PyVRP's model of the problem: node i is location i, and each customer is a client.

    If `forced`, each vehicle must first visit a copy of its depot. A copy is an additional client with an
    additional load type; a vehicle has capacity for one. Arcs lead from it to nodes only.
    """

    def __init__(self, model: FleetRouting, forced: bool) -> None:
        self.forced = forced
        self.distances, scale = whole_distances(model, LARGEST)
        self.customers = model.customers.tolist()
        self.index = {node: k for k, node in enumerate(self.customers)}
        self.vehicles, self.homes = model.vehicles, model.homes.tolist()
        self.demands: list[int] | None = None
        capacity = [0] * self.vehicles
        if model.capacity is not None:
            demands, capacity = whole_demands(model, LARGEST)
            # PyVRP's penalty per unit of overload is at most 1e5, so demands must be large numbers.
            factor = max(1, round(DEAR * len(self.customers) / max(sum(demands), 1)))
            self.demands = [factor * entry for entry in demands]
            capacity = [factor * entry for entry in capacity]
        battery = [math.inf] * self.vehicles
        if model.battery is not None:
            battery = np.floor(model.battery * scale * (1 + 1e-12)).tolist()
        kinds: dict[Any, _Kind] = {}
        for k, key in enumerate(zip(self.homes, capacity, battery, strict=True)):
            kinds.setdefault(key, _Kind(*key, [])).members.append(k)
        self.kinds = list(kinds.values())
        self.kind_of = {k: i for i, kind in enumerate(self.kinds) for k in kind.members}

    def longest(self, routes: Routes) -> int:
        """Return the length of the longest route, in whole-number units."""
        return max(
            int(self.distances[[home, *route], [*route, home]].sum())
            for home, route in zip(self.homes, routes, strict=True)
        )

    def search(
        self, limit: float, start: Routes | None, seed: int, tell: Callable[[Routes], object],
        stopped: Callable[[], bool], patience: float, first: bool,
    ) -> tuple[Routes | None, int]:  # fmt: skip
        """Return the best feasible routes or None, and the number of iterations."""
        from pyvrp import (
            IteratedLocalSearchParams,
            Route,
            Solution,
            SolveParams,
            solve,
        )  # fmt: skip
        from pyvrp.exceptions import PenaltyBoundWarning
        from pyvrp.IteratedLocalSearch import IteratedLocalSearchCallbacks

        data = self._data(limit)
        outcome: list[Routes] = []
        since = 0
        read = self._read

        class Listener(IteratedLocalSearchCallbacks):
            def on_best(self, best: Any) -> None:
                nonlocal since
                since = 0
                if best.is_feasible():
                    outcome.append(read(best))
                    tell(outcome[-1])

        def over(best_cost: int) -> bool:
            nonlocal since
            since += 1
            return stopped() or since > patience + 1 or (first and bool(outcome))

        initial = None
        if start is not None:
            routes = [
                Route(data, [self.index[node] for node in route], self.kind_of[k])
                for k, route in enumerate(start)
                if route
            ]
            initial = Solution(data, routes)
        params = SolveParams(ils=IteratedLocalSearchParams(callbacks=Listener()))
        with warnings.catch_warnings():
            # PyVRP warns if its maximum penalty cannot enforce a limit: the search then fails anyway.
            warnings.simplefilter("ignore", PenaltyBoundWarning)
            result = solve(
                data,
                over,
                seed % 2**31,
                collect_stats=False,
                params=params,
                initial_solution=initial,
            )
        if result.is_feasible() and not outcome:  # the initial solution was never improved
            outcome.append(read(result.best))
            tell(outcome[-1])
        return (outcome[-1] if outcome else None), result.num_iterations

    def _data(self, limit: float) -> Any:
        from pyvrp import Client, Depot, Location, ProblemData, VehicleType

        anything = int(np.iinfo(np.int64).max)
        homes = sorted({kind.home for kind in self.kinds})
        loads = [[] if self.demands is None else [self.demands[node]] for node in self.customers]
        lengths, places = self.distances, list(self.customers)
        if self.forced:
            loads = [[*load, 0] for load in loads]
            n, nothing = len(lengths), [0] * (self.demands is not None)
            lengths = np.full((n + len(homes),) * 2, BARRED)
            lengths[:n, :n] = self.distances
            np.fill_diagonal(lengths, 0)
            for copy, home in enumerate(homes, n):
                lengths[home, copy] = 0
                lengths[copy, self.customers] = self.distances[home, self.customers]
            for home in self.homes:
                places.append(n + homes.index(home))
                loads.append([*nothing, DEAR])
        types = []
        for kind in self.kinds:
            longest = min(kind.battery, limit)
            place = homes.index(kind.home)
            capacity = [kind.capacity] * (self.demands is not None) + [DEAR] * self.forced
            types.append(
                VehicleType(
                    len(kind.members), capacity, place, place,
                    max_distance=anything if math.isinf(longest) else int(longest),
                )
            )  # fmt: skip
        matrices: list[Any] = [lengths]
        return ProblemData(
            [Location(0, 0) for _ in lengths],
            [Client(place, load) for place, load in zip(places, loads, strict=True)],
            [Depot(home) for home in homes], types, matrices, [0 * entry for entry in matrices],
        )  # fmt: skip

    def _read(self, solution: Any) -> Routes:
        """Return the route of each vehicle in `solution`."""
        routes: Routes = [[] for _ in range(self.vehicles)]
        free: list[Iterable[int]] = [iter(kind.members) for kind in self.kinds]
        for route in solution.routes():
            vehicle = next(iter(free[route.vehicle_type()]))
            clients = [stop.idx for stop in route if stop.is_client()]
            routes[vehicle] = [self.customers[k] for k in clients if k < len(self.customers)]
        return routes
