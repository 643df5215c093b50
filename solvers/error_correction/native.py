"""Base class of the native backends for error-correction routes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ..contract.backend import Request
from ..resource_routing.native import RouteSearch

if TYPE_CHECKING:
    from ..resource_routing.elementary import Found
    from .airspace import Airspace

__all__ = ["RoutingBackend"]

#: Points above which a run with a time limit begins with the paper's first stage.
FEW = 20


class RoutingBackend(RouteSearch):
    """Base of the exact native algorithms for one surviving error; a subclass only searches."""

    accepts = ErrorCorrectionRouting

    def refuses(self, problem: ErrorCorrectionRouting) -> str:
        """Return what of `problem` labels with one error do not cover."""
        return problem.additions and f"{problem.additions}: take resource-labelling"

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
        return self.search(problem, airspace(problem), cutoff, request)

    def measure(self, problem: ErrorCorrectionRouting, plan: Route) -> float:
        """Return the length of `plan`, its legs added exactly."""
        return problem.walk(plan)[-1].distance

    @abstractmethod
    def search(
        self, problem: ErrorCorrectionRouting, space: Airspace, ceiling: float, request: Request
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
