"""What the native routing backends share: preparation, timing, and the answer's form."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["RoutingBackend"]


class RoutingBackend(Backend):
    """Base of the exact native algorithms; a subclass only searches.

    They are deterministic, so that every seed gives the same plan, and solve to a gap of zero.
    """

    accepts = ErrorCorrectionRouting
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.CUTOFF, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True

    @abstractmethod
    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Return the best route no longer than `ceiling`, and statistics of the algorithm's own."""

    def run(self, problem: ErrorCorrectionRouting, request: Request) -> Answer:
        """Search, and say what the end of the search proves."""
        from .airspace import airspace
        from .outcomes import FOUND, FULL, STOPPED

        begin = time.perf_counter()
        cutoff = float("inf") if request.cutoff is None else request.cutoff * (1 + 1e-9)
        found, own = self.search(airspace(problem), problem.revisits, cutoff, request)
        seconds = {"solve": time.perf_counter() - begin}
        plan = Route(tuple(found.route.tolist())) if found.route.size else None
        statistics = {
            "labels made": found.made,
            "labels extended": found.settled,
            "rounds": found.rounds,
            "critical points": found.critical,
            **own,
        }
        termination, limit, message = Termination.INFEASIBLE, None, ""
        # An interpreted kernel returns NumPy's numbers.
        primal = None if plan is None else float(found.length)
        bound = float(found.bound) if math.isfinite(found.bound) else None
        if found.status == FOUND:
            termination = Termination.OPTIMAL
        elif found.status in (STOPPED, FULL):
            termination = Termination.NO_SOLUTION if plan is None else Termination.FEASIBLE
            limit = request.control.reason or Limit.INTERRUPTED
            if found.status == FULL:
                limit, message = Limit.MEMORY, "no room for more labels"
        elif request.cutoff is not None:
            termination, bound = Termination.NO_SOLUTION, request.cutoff
            message = "no plan better than the cutoff"
        return Answer(
            termination,
            limit,
            plan,
            primal,
            bound,
            seconds=seconds,
            statistics=statistics,
            message=message,
        )
