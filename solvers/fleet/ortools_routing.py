"""OR-Tools' routing library, as the yardstick from practice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...models.fleet import FleetRouting, Objective
from ..backend import Feature, Option, Request
from .rivals import Best, FleetHeuristic, whole_demands, whole_distances

__all__ = ["OrToolsRouting"]

#: The longest distance and the largest demand in whole numbers.
LARGEST = 10**7
#: Nodes whose distances are handed over, as Python's integers.
MOST = 3000
#: How many times a difference of the longest route counts a difference of the sum.
SPAN = 100
#: Seconds after the deadline at which it ends by itself.
GRACE = 0.1


class OrToolsRouting(FleetHeuristic):
    """Guided local search of OR-Tools' routing library.

    It minimises the sum of all lengths and, unless the sum alone is asked for, 100 times the longest
    (q times for "sum-deviation"): it knows neither standard deviation nor range. The best plan by the
    model's own objective among all that it meets is kept. Where every vehicle must be used, it begins with
    a solution in which empty ones were given the nodes whose moves cost least. Capacity and battery are its dimensions;
    limits on the sum, the deviation and the range are held against plans, and not sought.
    """

    name = "ortools-routing"
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    requires = ("ortools",)
    extra = "ortools"
    # It loads OR-Tools' own libhighs.so.1: see MathOpt.
    conflict_group = "highs"
    natives = (
        "ortools.constraint_solver._pywrapcp",
        "ortools.math_opt.core.python.solver",
        "ortools.sat.python.cp_model_helper",
    )
    options: ClassVar[Mapping[str, Option]] = {
        "seconds": Option(10.0, "Seconds that it searches where no time limit is set.", lower=0.01),
        "solutions": Option(
            None, "Solutions after which it ends, the same on every machine.", int, lower=1
        ),
        "first": Option(
            "automatic",
            "How it finds a first solution.",
            str,
            ("automatic", "path_cheapest_arc", "parallel_cheapest_insertion", "savings"),
        ),
    }
    summary = "OR-Tools' routing library with guided local search"

    def refuses(self, problem: FleetRouting) -> str:
        """Return what is refused: more nodes than it is handed."""
        if problem.size > MOST:
            return f"more than {MOST} nodes, got {problem.size}"
        return ""

    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Search until the time is used up."""
        solutions = 0
        if best.problem.use_all:
            # First solutions were seen to fail where a vehicle must be used: so one without that is
            # filled, and searched on from.
            solutions += _solve(best, request, used=False, most=1)
        most = request.options["solutions"]
        if not request.control.stopped:
            solutions += _solve(best, request, used=best.problem.use_all, most=most)
        return {"solutions": solutions}


def _solve(best: Best, request: Request, *, used: bool, most: int | None) -> int:
    """Search on from the best plan, if any, where all vehicles are `used`; return the solutions met."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    problem, vehicles = best.problem, best.problem.vehicles
    homes = problem.homes.tolist()
    manager = pywrapcp.RoutingIndexManager(problem.size, vehicles, homes, homes)
    routing = pywrapcp.RoutingModel(manager)
    _declare(routing, problem)
    starts = [routing.Start(k) for k in range(vehicles)]
    solutions = 0

    def met() -> None:
        nonlocal solutions
        solutions += 1
        routes = []
        for start in starts:
            at, route = routing.NextVar(start).Value(), []
            while not routing.IsEnd(at):
                route.append(manager.IndexToNode(at))
                at = routing.NextVar(at).Value()
            routes.append(route)
        best.offer_filled(routes)

    routing.AddAtSolutionCallback(met)
    # It keeps the interpreter's lock, and so must look itself.
    routing.AddSearchMonitor(routing.solver().CustomLimit(lambda: request.control.stopped))
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = routing_enums_pb2.FirstSolutionStrategy.Value.Value(
        request.options["first"].upper()
    )
    parameters.local_search_metaheuristic = (
        routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    )
    left = request.left()
    seconds = request.options["seconds"] if left is None else left + GRACE
    parameters.time_limit.FromMilliseconds(max(1, round(1e3 * min(seconds, 1e9))))
    if most is not None:
        parameters.solution_limit = most
    start = None
    if used:
        for k, first in enumerate(starts):
            routing.NextVar(first).RemoveValue(routing.End(k))
        routing.CloseModelWithParameters(parameters)
        if best.plan is not None:
            routes = [[manager.NodeToIndex(node) for node in route] for route in best.plan.routes]
            start = routing.ReadAssignmentFromRoutes(routes, True)
    if start is None:
        routing.SolveWithParameters(parameters)
    else:
        routing.SolveFromAssignmentWithParameters(start, parameters)
    return solutions


def _declare(routing: Any, problem: FleetRouting) -> None:
    """State costs, limits and the use of vehicles."""
    distances, scale = whole_distances(problem, LARGEST)
    arc, span = 1, 0 if problem.objective is Objective.SUM else SPAN
    if problem.objective in (Objective.VARIANCE, Objective.DEVIATION):
        arc, span = SPAN, round(min(SPAN * problem.q, 1e6))
    lengths = routing.RegisterTransitMatrix(distances.tolist())
    costs = lengths if arc == 1 else routing.RegisterTransitMatrix((arc * distances).tolist())
    routing.SetArcCostEvaluatorOfAllVehicles(costs)
    most = int(distances.max()) * (problem.size + 1)
    longest = [most] * problem.vehicles
    if problem.battery is not None:
        longest = np.floor(np.minimum(problem.battery * scale, most)).astype(int).tolist()
    routing.AddDimensionWithVehicleCapacity(lengths, 0, longest, True, "length")
    routing.GetDimensionOrDie("length").SetGlobalSpanCostCoefficient(span)
    if problem.capacity is not None:
        demands, capacity = whole_demands(problem, LARGEST)
        taken = routing.RegisterUnaryTransitVector(demands)
        routing.AddDimensionWithVehicleCapacity(taken, 0, capacity, True, "demand")
