"""``dynamic-programming``: the paper's dynamic program with its efficiency test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..backend import Request
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["DynamicProgramming"]


class DynamicProgramming(RoutingBackend):
    """Label correcting, first in, first out; only dominated labels are dropped.

    As we read the paper's efficiency test: of the labels of a point, those are kept that no other
    one beats in both length and error. Nothing bounds the search but a route that is known
    beforehand, which makes it the slow one of the exact algorithms. Dominance that ignores visited points is exact only where revisits are
    allowed; where they are not, points that a walk repeats become critical
    (see :mod:`.elementary`).
    """

    name = "dynamic-programming"
    summary = "the paper's dynamic program: label correcting with the efficiency test"

    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Correct labels until none changes."""
        from .elementary import Found, elementary, simple_below
        from .grid import build
        from .slots import critical_bits
        from .steps import distances_to
        from .sweep_kernels import first_in
        from .way_kernels import plain_ways

        flag = request.control.flag
        grid = build(space, np.ones(len(space.points), np.bool_))

        def searched(critical: np.ndarray[Any, np.dtype[np.int64]], bound: float) -> Found:
            if critical.size:
                return simple_below(space, critical, bound, ceiling, flag, first_in)
            bits, words = critical_bits(grid, critical)
            ways = plain_ways(distances_to(grid, len(grid.x) - 1))
            return Found(*first_in(space, grid, ways, bits, words, ceiling, flag))

        return elementary(searched, revisits=revisits), {}
