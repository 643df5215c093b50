"""What the native routing backends share: preparation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ..backend import Request
from ..resource_routing.native import RouteSearch

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["RoutingBackend"]


class RoutingBackend(RouteSearch):
    """Base of the exact native algorithms for one surviving error; a subclass only searches."""

    accepts = ErrorCorrectionRouting

    def refuses(self, problem: ErrorCorrectionRouting) -> str:
        """Return what of `problem` labels with one error do not cover."""
        if problem.is_plain:
            return ""
        what = "suspect points" if problem.corrections_limit is None else "a limit on corrections"
        return f"{what}: take resource-labelling"

    def find(
        self, problem: ErrorCorrectionRouting, cutoff: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Search the arrays of `problem`."""
        from .airspace import airspace

        return self.search(airspace(problem), problem.revisits, cutoff, request)

    def measure(self, problem: ErrorCorrectionRouting, plan: Route) -> float:
        """Return the length of `plan`, its legs added exactly."""
        return problem.walk(plan)[-1].distance

    @abstractmethod
    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Return the best route no longer than `ceiling`, and statistics of the algorithm's own."""
