"""``pulse``: the depth-first algorithm that the paper compares with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..backend import Request
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["Pulse"]


class Pulse(RoutingBackend):
    """Depth-first search with three prunings: by infeasibility, by bound, by dominance.

    The bound on what remains is the shortest way to B over arcs that the thresholds alone allow.
    Dominance that ignores visited points is exact only where revisits are allowed; where they are
    not, points that a walk repeats become critical (see :mod:`.elementary`).
    """

    name = "pulse"
    summary = "depth-first pulses pruned by infeasibility, bound and dominance"

    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Send pulses from A."""
        from .elementary import Found, elementary, simple_below
        from .grid import build
        from .pulse_kernels import pulse
        from .slots import critical_bits, shortest_ways
        from .way_kernels import plain_ways

        flag = request.control.flag
        grid = build(space, np.ones(len(space.points), np.bool_))
        ahead = shortest_ways(space, grid, flag)
        if not np.isfinite(ahead[-2]):
            return Found(0, np.empty(0, np.int64), np.inf, np.inf, 0, 0), {}

        def searched(critical: np.ndarray[Any, np.dtype[np.int64]], bound: float) -> Found:
            if critical.size:
                return simple_below(space, critical, bound, ceiling, flag, pulse)
            bits, words = critical_bits(grid, critical)
            return Found(*pulse(space, grid, plain_ways(ahead), bits, words, ceiling, flag))

        return elementary(searched, revisits=revisits), {}
