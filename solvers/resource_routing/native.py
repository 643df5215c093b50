"""Base class of the exact native searches for routes."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...jit import clock
from ...models.resource_routing.route import Route
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

if TYPE_CHECKING:
    from .elementary import Found

__all__ = ["RouteSearch"]


class RouteSearch(Backend):
    """Base class of the exact native algorithms; subclasses implement :meth:`find`.

    The algorithms are deterministic, so every seed gives the same plan, and solve to a gap of zero.
    """

    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.CUTOFF, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True

    @abstractmethod
    def find(
        self, problem: Any, cutoff: float, request: Request
    ) -> tuple[Found, Mapping[str, float | int | str]]:
        """Return the best route no longer than `cutoff`, and the statistics of the algorithm."""

    @abstractmethod
    def measure(self, problem: Any, plan: Route) -> float:
        """Return the correctly rounded length of `plan`."""

    def run(self, problem: Any, request: Request) -> Answer:
        """Run the search and return its answer."""
        from .outcomes import FOUND, FULL, OPEN, STOPPED

        self.require_support(problem)
        begin = clock()
        cutoff = math.inf if request.cutoff is None else request.cutoff + 1e-9 * abs(request.cutoff)
        result, details = self.find(problem, cutoff, request)
        seconds = {"solve": clock() - begin}
        plan = None
        if result.route.size:
            # Searches sum lengths in another order, and equal ones may differ by rounding.
            ways = [tuple(way.tolist()) for way in (result.route, *result.others)]
            ways.sort(key=lambda way: self.measure(problem, Route(way)))
            plan = Route(ways[0], tuple(ways[1:]))
        termination, limit, message = Termination.INFEASIBLE, None, ""
        # Rounding must not lift the bound above the correctly rounded length.
        primal = None if plan is None else self.measure(problem, plan)
        least = float(result.bound) if primal is None else min(float(result.bound), primal)
        bound = least if math.isfinite(least) else None
        if result.status == FOUND:
            termination = Termination.OPTIMAL
        elif result.status in (STOPPED, FULL, OPEN):
            termination = Termination.NO_SOLUTION if plan is None else Termination.FEASIBLE
            if result.status == OPEN:
                message = (
                    "the search ended without a proof: a walk that visits points twice is shorter"
                )
            else:
                limit = request.control.reason or Limit.INTERRUPTED
            if result.status == FULL:
                limit, message = Limit.MEMORY, "no room for more labels"
        elif request.cutoff is not None:
            termination, bound = Termination.NO_SOLUTION, request.cutoff
            message = "no plan better than the cutoff"
        statistics = {
            "labels made": result.made,
            "labels extended": result.settled,
            "rounds": result.rounds,
            "critical points": result.critical,
            **details,
        }
        return Answer(
            termination, limit, plan, primal, bound,
            seconds=seconds, statistics=statistics, message=message,
        )  # fmt: skip
