"""Adapter of PyVRP, a benchmark from research."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from ...jit import clock
from ...models.fleet import FleetRouting, Objective
from ..contract.backend import Option, Request
from .pyvrp_data import Found, Posed, Unreachable
from .rivals import Best, FleetHeuristic
from .start import first_routes
from .whole import COMMON, is_fetched

__all__ = ["PyVrpRouting"]

#: Largest number of nodes, as PyVRP stores several copies of the matrices.
MOST = 5000
#: Initial and minimum relative reduction of the longest route.
STEP, LEAST = 0.1, 1e-4
#: Time between two incumbents in a search with a time limit, as a multiple of the time to check one.
SPACING = 20.0


class PyVrpRouting(FleetHeuristic):
    """PyVRP's iterated local search for the sum of all lengths or costs, with a falling limit for the longest.

    Source: N. A. Wouda, L. Lan and W. Kool, "PyVRP: a high-performance VRP solver package", INFORMS
    Journal on Computing 36 (2024). PyVRP minimises the sum, or the costs minus the prizes. For "max" and
    "max-sum", repeated searches require all routes to be shorter than the incumbent's longest by a given
    share; the share is halved after a search without success. PyVRP cannot require that every vehicle is
    used. For the sum, each vehicle therefore has to visit a copy of its depot, with no arc back to a copy.
    For the longest route, an empty vehicle receives the node that is cheapest to move. Limits on the sum,
    the deviation and the range only guide a stage that finds a first plan, and plans beyond them are
    repaired. Data of rich fleets is rounded to whole numbers such that every plan that PyVRP calls feasible
    is feasible, except that a window shorter than a unit becomes that unit, and that loads may exceed a
    capacity by 1e-7 of it. A unit is at most
    2^-20 of the longest arc. The times of the plan are those of the model's own schedule. A stop request
    takes effect after the first local search, which takes seconds for thousands of nodes.
    """

    name = "pyvrp"
    single_threaded = True
    requires = ("pyvrp",)
    extra = "routing"
    rich = COMMON
    options: ClassVar[Mapping[str, Option]] = {
        "patience": Option(
            200,
            "Iterations without a better plan after which a search ends. The search for the sum ends "
            "after ten times as many, or at the time limit if there is one.",
            int,
            lower=1,
        )
    }
    summary = (
        "PyVRP: iterated local search for the sum or the cost of rich fleets, and for the longest"
    )

    def refuses(self, problem: FleetRouting) -> str:
        """Return the reason for refusal, "" for a supported model: a feature, the objective or the size."""
        if reason := super().refuses(problem):
            return reason
        if problem.objective is Objective.RANGE:
            return "the objective 'range'"
        if problem.q > 0:
            return f"the objective {str(problem.objective)!r} with q > 0"
        if problem.size > MOST:
            return f"more than {MOST} nodes, got {problem.size}"
        return _refuses_rich(problem) if problem.is_rich else ""

    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Minimise the sum, then reduce the longest route step by step if the objective needs it."""
        limited = best.problem.objective in (Objective.MAX, Objective.LEXICOGRAPHIC)
        posed = Posed(best.problem, best.problem.use_all and (best.problem.is_rich or not limited))
        endless = request.time_limit is not None
        patience, seed = request.options["patience"], request.seed or 0
        counts = {"searches": 1, "iterations": 0}
        # With further limits, or another objective, an earlier plan may be better than the last one.
        free = not limited and {*best.problem.limits} <= {"battery", "capacity"}
        spacing = SPACING if endless and free else 0.0

        def look(limit: float, start: Found | None, patience: float, first: bool) -> Found | None:
            """Return feasible routes of length <= `limit`: the first, or the best within `patience`."""
            solution, iterations = _search(
                posed, limit, start, seed + counts["searches"] - 1, best.offer_filled,
                lambda: request.control.stopped, patience, first, spacing,
            )  # fmt: skip
            counts["iterations"] += iterations
            return solution

        whole = math.inf if endless else 10 * patience
        try:
            found = look(math.inf, None, patience if limited else whole, False)
        except Unreachable:
            best.offer([[]] * best.problem.vehicles)  # feasible if every node is optional
            best.broken = best.broken and "service within a window"
            return counts
        loads = best.problem.demands
        if found is None and loads is not None and loads.ndim == 1:
            # Routes without slack are a bin packing, which PyVRP may miss.
            draw = np.random.default_rng(seed)
            routes = first_routes(best.problem, draw, lambda: request.control.stopped)
            if routes is not None:
                best.offer_filled(routes)
        if found is None or not limited:
            return counts
        step = STEP
        while not request.control.stopped and (step >= LEAST or endless):
            counts["searches"] += 1
            longest = posed.longest(found)
            limit = math.floor(longest * (1.0 - max(step, LEAST)))
            if not 0 < limit < longest:
                break
            result = look(limit, found, patience, True)
            if result is None:
                step /= 2
            else:
                found = result
        if best.problem.objective is Objective.LEXICOGRAPHIC and not request.control.stopped:
            counts["searches"] += 1
            look(posed.longest(found), found, patience, False)
        return counts


def _refuses_rich(model: FleetRouting) -> str:
    """Return which combination of features PyVRP cannot represent, "" if none."""
    fetched = is_fetched(model)
    windows = [spans or () for spans in model.windows or ()]
    for node, spans in enumerate(windows):
        if len(spans) > 1 and (fetched[node] or node in model.homes or node in model.finishes):
            what = "a pair" if fetched[node] else "a depot"
            return f"several windows of a node of {what}, got {len(spans)} for node {model.label(node)}"
    if model.releases is not None and (model.releases[fetched] > 0).any():
        return "releases of nodes of a pair"
    if any(fetched[node] for group in model.groups or () for node in group):
        return "groups with nodes of a pair"
    return ""


def _search(
    posed: Posed, limit: float, start: Found | None, seed: int, tell: Callable[[list[list[int]]], object],
    stopped: Callable[[], bool], patience: float, first: bool, spacing: float,
) -> tuple[Found | None, int]:  # fmt: skip
    """Return the best feasible routes or None, and the number of iterations; `tell` receives better routes."""
    from pyvrp import IteratedLocalSearchParams, PenaltyParams, Route, Solution, SolveParams, solve
    from pyvrp.exceptions import PenaltyBoundWarning
    from pyvrp.IteratedLocalSearch import IteratedLocalSearchCallbacks

    data = posed.data(limit)
    outcome: list[Found] = []
    newest: Any = None  # best solution, not passed to `tell` yet
    since, ready = 0, 0.0

    def flush() -> None:
        nonlocal newest, ready
        begin = clock()
        outcome[:] = [posed.read(newest)]
        newest = None
        tell(outcome[0].routes)
        ready = clock() + spacing * (clock() - begin)

    class Listener(IteratedLocalSearchCallbacks):
        def on_best(self, best: Any) -> None:
            nonlocal since, newest
            since = 0
            if best.is_feasible():
                newest = best
                if clock() >= ready:
                    flush()

    def over(best_cost: int) -> bool:
        nonlocal since
        since += 1
        if newest is not None and clock() >= ready and not stopped():
            flush()
        return stopped() or since > patience + 1 or (first and bool(outcome))

    routes = [Route(data, stops, kind) for kind, stops in start.activities] if start else []
    params = SolveParams(
        IteratedLocalSearchParams(callbacks=Listener()), PenaltyParams(max_penalty=posed.penalty)
    )
    with warnings.catch_warnings():
        # PyVRP warns if its maximum penalty cannot enforce a limit: the search then fails anyway.
        warnings.simplefilter("ignore", PenaltyBoundWarning)
        result = solve(
            data,
            over,
            seed % 2**31,
            collect_stats=False,
            params=params,
            initial_solution=Solution(data, routes) if start else None,
        )
    if result.is_feasible() and not outcome:  # the initial solution was never improved
        newest = result.best
    if newest is not None:
        flush()
    return (outcome[0] if outcome else None), result.num_iterations
