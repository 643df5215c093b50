"""Exact best-first label setting; ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...jit import clock
from ..contract.backend import Request
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["LabelSetting"]


class LabelSetting(RoutingBackend):
    """A* search with dominance on the length and the surviving error.

    With revisits the search is exact and polynomial. Without them, a simple walk is accepted; otherwise
    the repeated points become critical (see :mod:`.elementary`). Dominance that ignores visited points
    would discard a longer label that can still visit a point needed later.

    A run that reaches its time limit returns the best of the routes of the starter and of
    :func:`~crosstrack.solvers.resource_routing.first.route_in_time`. It ends without a plan only if
    neither search found a route; above 2,000 points the starter alone searches.
    """

    name = "label-setting"
    summary = "best-first label setting with dominance on the surviving error; ours"

    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Search under a rising ceiling, then with critical points if the walk repeats some."""
        from .ceiling_kernels import climb
        from .elementary import Found, elementary, simple_below
        from .sweep_kernels import best_first

        flag = request.control.flag

        def search_once(critical: np.ndarray[Any, np.dtype[np.int64]], bound: float) -> Found:
            if critical.size == 0:
                return Found(*climb(space, ceiling, flag))
            return simple_below(space, critical, bound, ceiling, flag, best_first)

        begin = clock()
        result = elementary(search_once, revisits=revisits)
        return result, {"search_seconds": clock() - begin}
