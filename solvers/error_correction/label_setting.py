"""``label-setting``: our own exact search, best-first, from coordinates to a proven route."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...jit import clock
from ..backend import Request
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["LabelSetting"]


class LabelSetting(RoutingBackend):
    """A* with dominance on length and the one error that survives a correction.

    With revisits allowed the search is exact as it is, and polynomial; without them, the walk it
    finds is accepted if it is simple, and otherwise the points it repeats become critical (see
    :mod:`.elementary`), because dominance that ignores visited points would discard a longer way
    that has not yet used a point which the shorter one needs again.

    A run that reaches its time limit returns the best of the routes of the starter and of
    :func:`~crosstrack.solvers.resource_routing.first.route_in_time`. It ends without a plan only if
    neither search found a route; above 2,000 points the starter alone searches.
    """

    name = "label-setting"
    summary = "best-first label setting with dominance on the surviving error; ours"

    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Search under a rising ceiling, then with critical points where a walk repeats some."""
        from .ceiling_kernels import climb
        from .elementary import Found, elementary, simple_below
        from .sweep_kernels import best_first

        flag = request.control.flag

        def searched(critical: np.ndarray[Any, np.dtype[np.int64]], bound: float) -> Found:
            if critical.size == 0:
                return Found(*climb(space, ceiling, flag))
            return simple_below(space, critical, bound, ceiling, flag, best_first)

        begin = clock()
        found = elementary(searched, revisits=revisits)
        return found, {"search_seconds": clock() - begin}
