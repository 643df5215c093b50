"""Pulse algorithm of the paper, without a route from stage 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...jit import clock
from ..contract.backend import Request
from .native import PrintedSearch

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["Pulse"]


class Pulse(PrintedSearch):
    """Depth-first search with the paper's three checks: feasibility, dominance and bound.

    Section 3.2. The bound on the rest of a route is the straight line to B.
    """

    name = "pulse"
    summary = "the paper's pulse algorithm: depth first, straight line to B as bound"

    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the pulse algorithm from A without a known route."""
        from .elementary import Found
        from .printed_kernels import send_pulses

        begin = clock()
        found = Found(*send_pulses(space, ceiling, request.control.flag))
        return found, {"search_seconds": clock() - begin}
