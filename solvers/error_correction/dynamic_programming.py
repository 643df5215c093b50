"""DP Algorithm of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...jit import clock
from ..contract.backend import Request
from .native import PrintedSearch

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["DynamicProgramming"]


class DynamicProgramming(PrintedSearch):
    """Label correcting with labels that carry their route, section 4.

    EFF keeps the labels of a point that no other label dominates in length and both errors. No bound on
    the length limits the search. As printed, a point enters the set E if it has any label, and the algorithm
    never ends; here a point enters E if its labels have changed.
    """

    name = "dynamic-programming"
    summary = "the paper's dynamic program: label correcting with routes in the labels"

    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Correct labels until no label changes."""
        from .elementary import Found
        from .printed_kernels import correct_labels

        begin = clock()
        found = Found(*correct_labels(space, ceiling, request.control.flag))
        return found, {"search_seconds": clock() - begin}
