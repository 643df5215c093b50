"""Two-stage algorithm of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...jit import clock
from ..contract.backend import Request
from .labelling import FactorSearch, label_with_factors
from .native import PrintedSearch

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["TwoStage"]


class TwoStage(PrintedSearch, FactorSearch):
    """Two-stage algorithm: ``labelling``, then ``pulse`` with the length of its route as bound."""

    name = "two-stage"
    summary = "the paper's algorithm: labelling for a bound, then pulses below it"

    def starter(self, problem: Any) -> str:
        """Return "", as the first stage is a heuristic."""
        return ""

    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the two stages."""
        from .elementary import Found
        from .outcomes import FOUND, NOTHING
        from .printed_kernels import send_pulses

        begin = clock()
        first = label_with_factors(space, request.options.get("threshold_factor"), request)
        between = clock()
        has_route = first.route.size > 0 and first.length <= ceiling
        bound = first.length if has_route else ceiling
        found = Found(*send_pulses(space, bound, request.control.flag))
        if has_route and not found.route.size:
            status = FOUND if found.status == NOTHING else found.status
            found = replace(found, status=status, route=first.route, length=first.length)
        statistics = {
            "stage1_seconds": between - begin,
            "stage2_seconds": clock() - between,
            "search_seconds": clock() - begin,
            "stage1 length": float(first.length) if first.route.size else "none",
            "stage1 labels": first.made,
            "threshold factor": first.factor,
        }
        return found, statistics
