"""Base classes of the native backends for error-correction routes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ..contract.backend import Request
from ..resource_routing.native import RouteSearch

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["PrintedSearch", "RoutingBackend"]

#: Points above which a run with a time limit begins with the paper's first stage.
FEW = 20


class RoutingBackend(RouteSearch):
    """Base of the exact native algorithms for one surviving error; a subclass only searches."""

    accepts = ErrorCorrectionRouting

    def refuses(self, problem: ErrorCorrectionRouting) -> str:
        """Return what of `problem` labels with one error do not cover."""
        if problem.is_plain:
            return ""
        what = "suspect points" if problem.corrections_limit is None else "a limit on corrections"
        return f"{what}: take resource-labelling"

    def starter(self, problem: Any) -> str:
        """Return the paper's first stage for instances whose search may not end in time."""
        return "labelling" if len(problem.points) > FEW else ""

    def find(
        self, problem: ErrorCorrectionRouting, cutoff: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Search the arrays of `problem`; a run with a time limit reports a first route before."""
        from .airspace import airspace

        if request.time_limit is not None:
            _report_first(problem, request)
        return self.search(airspace(problem), problem.revisits, cutoff, request)

    def measure(self, problem: ErrorCorrectionRouting, plan: Route) -> float:
        """Return the length of `plan`, its legs added exactly."""
        return problem.walk(plan)[-1].distance

    @abstractmethod
    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Return the best route no longer than `ceiling`, and statistics of the algorithm's own."""


def _report_first(problem: ErrorCorrectionRouting, request: Request) -> None:
    """Report a route that needs no compiled loops, if a search finds one."""
    from ..resource_routing.first import route_in_time

    route = route_in_time(problem.lower(), request)
    if route is None:
        return
    checked = problem.verify(route)
    if checked.ok and not checked.within_tolerance and checked.objective is not None:
        request.control.incumbent(checked.objective, route)


class PrintedSearch(RoutingBackend):
    """Base of the paper's algorithms, which return the route that the printed algorithm finds.

    Their dominance check does not compare the points of the routes, so it may drop the only label that the
    shortest route extends. The result is therefore compared with the shortest walk, which may visit points
    twice and is a lower bound: equal lengths are a proof. Otherwise the answer is a feasible route and that
    bound. The comparison takes milliseconds and is not part of ``search_seconds`` in the statistics.
    """

    def refuses(self, problem: ErrorCorrectionRouting) -> str:
        """Return which part of `problem` the paper's algorithms do not cover."""
        if problem.revisits:
            return "revisits, which the paper excludes: take label-setting"
        return super().refuses(problem)

    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the printed algorithm and compare its route with the shortest walk."""
        from .ceiling_kernels import climb
        from .elementary import Found
        from .outcomes import FOUND, NOTHING, OPEN, STOPPED

        found, own = self.find_as_printed(space, ceiling, request)
        if found.status not in (FOUND, NOTHING):
            return found, own
        least = min(ceiling, found.length) * (1 + 1e-12)
        walk = Found(*climb(space, least, request.control.flag))
        if walk.status == NOTHING:
            bound = min(walk.bound, found.length)
            return replace(found, bound=bound), own
        if walk.status == FOUND and walk.length >= found.length * (1 - 1e-12):
            return replace(found, bound=found.length), own
        status = OPEN if walk.status == FOUND else STOPPED
        return replace(found, status=status, bound=walk.bound), own

    @abstractmethod
    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Return the route of the printed algorithm and its statistics.

        Parameters
        ----------
        space : Airspace
            The problem.
        ceiling : float
            Length (m) that a route must not exceed; inf as printed.
        request : Request
            Options and stop flag.
        """
