"""Adapter of OR-Tools' routing library, a benchmark from practice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.fleet import FleetRouting
from ..contract.backend import Feature, Option, Request
from ..programs.highs_library import ORTOOLS_MARKS
from .ortools_data import Posed
from .rivals import Best, FleetHeuristic
from .whole import COMMON

__all__ = ["OrToolsRouting"]

#: Largest number of nodes, as the distances are passed as Python integers.
MOST = 3000
#: Time after the deadline at which the library ends the search itself, s.
GRACE = 0.1


class OrToolsRouting(FleetHeuristic):
    """Guided local search of OR-Tools' routing library.

    The library has neither standard deviation nor range. It minimises the sum of all lengths and,
    unless the objective is "sum", 100 times the longest (q times for "sum-deviation"). The answer is
    the best plan by the model's objective among all solutions. If every vehicle must be used, the
    search starts from a solution whose empty vehicles receive the nodes that are cheapest to move.
    Capacity, battery, times and the features of rich fleets are dimensions, disjunctions and
    constraints of the library. Each reload and station has copies: one per node to visit in small fleets,
    two per vehicle in large ones. Limits on the sum, the deviation and the range only guide a stage that
    finds a first plan. For the makespan, departures later than the shift do not guide the search, with a
    limit on durations or releases.
    """

    name = "ortools-routing"
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    requires = ("ortools",)
    extra = "ortools"
    # OR-Tools loads its bundled libhighs.so.1: see MathOpt.
    conflict_group = "highs"
    natives = ORTOOLS_MARKS
    rich = COMMON | {"stations", "makespan"}
    options: ClassVar[Mapping[str, Option]] = {
        "seconds": Option(10.0, "Seconds without a limit; first plans add up to 60 %.", lower=0.01),
        "solutions": Option(None, "Number of solutions after which the search ends.", int, lower=1),
        "first": Option(
            "automatic",
            "Heuristic of the first solution.",
            str,
            ("automatic", "path_cheapest_arc", "parallel_cheapest_insertion", "savings"),
        ),
    }
    summary = "OR-Tools' routing library with guided local search"

    def refuses(self, problem: FleetRouting) -> str:
        """Return the reason for refusal, "" for a supported model: features, or too many nodes."""
        if reason := super().refuses(problem):
            return reason
        if problem.releases is not None and problem.reloads:
            return "releases with reloads"
        if problem.size > MOST:
            return f"more than {MOST} nodes, got {problem.size}"
        return ""

    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Search until the time limit or the solution limit."""
        solutions = 0
        if best.problem.use_all:
            # The library often finds no first solution if vehicles must be used. So find one without
            # this constraint, fill the empty vehicles and continue from there.
            solutions += _solve(best, request, used=False, solution_limit=1)
        most = request.options["solutions"]
        if not request.control.stopped:
            solutions += _solve(best, request, used=best.problem.use_all, solution_limit=most)
        return {"solutions": solutions}


def _solve(best: Best, request: Request, *, used: bool, solution_limit: int | None) -> int:
    """Search from the incumbent, if any, and return the number of solutions, at most `solution_limit`.

    Every vehicle must be used if `used`. Each better solution updates the incumbent.
    """
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    problem, vehicles = best.problem, best.problem.vehicles
    posed = Posed(problem)
    places = posed.places
    manager = pywrapcp.RoutingIndexManager(len(places), vehicles, posed.homes, posed.ends)
    routing = pywrapcp.RoutingModel(manager)
    posed.declare(routing, manager)
    starts = [routing.Start(k) for k in range(vehicles)]
    solutions = 0

    def report_solution() -> None:
        nonlocal solutions
        solutions += 1
        routes = []
        for start in starts:
            at, route = routing.NextVar(start).Value(), []
            while not routing.IsEnd(at):
                route.append(places[manager.IndexToNode(at)])
                at = routing.NextVar(at).Value()
            routes.append(route)
        best.offer_filled(routes)

    routing.AddAtSolutionCallback(report_solution)
    # The library holds the GIL, so its search has to poll the stop flag.
    routing.AddSearchMonitor(routing.solver().CustomLimit(lambda: request.control.stopped))
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    first = request.options["first"]
    if first == "automatic" and (posed.reloads or posed.stations):
        # The library's choice finds no solution if 8 nodes need 3 reloads.
        first = "parallel_cheapest_insertion"
    strategies = routing_enums_pb2.FirstSolutionStrategy
    parameters.first_solution_strategy = strategies.Value.Value(first.upper())
    searches = routing_enums_pb2.LocalSearchMetaheuristic
    parameters.local_search_metaheuristic = searches.GUIDED_LOCAL_SEARCH
    remaining = request.left()
    seconds = request.options["seconds"] if remaining is None else remaining + GRACE
    parameters.time_limit.FromMilliseconds(max(1, round(1e3 * min(seconds, 1e9))))
    if solution_limit is not None:
        parameters.solution_limit = solution_limit
    if used:
        for k, first in enumerate(starts):
            routing.NextVar(first).RemoveValue(routing.End(k))
    start = None
    routes = None if best.plan is None else posed.places_of(best.plan.routes)
    if routes is not None:
        routing.CloseModelWithParameters(parameters)
        indices = [[manager.NodeToIndex(place) for place in route] for route in routes]
        start = routing.ReadAssignmentFromRoutes(indices, True)
    if start is None:
        routing.SolveWithParameters(parameters)
    else:
        routing.SolveFromAssignmentWithParameters(start, parameters)
    return solutions
