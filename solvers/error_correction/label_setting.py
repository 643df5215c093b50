"""Exact best-first label setting; ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.error_correction.model import ErrorCorrectionRouting
from ..contract.backend import Request
from ..resource_routing.elementary import Found
from ..resource_routing.labelling import ResourceLabelling
from ..resource_routing.outcomes import FOUND, NOTHING, OPEN
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace

__all__ = ["LabelSetting"]

#: Relative distance above the shortest walk within which a simple route is searched first.
NEAR = 0.02
#: Relative rounding error of a sum of lengths.
ROUNDING = 1e-12


class LabelSetting(RoutingBackend):
    """A* search with dominance on the length and the surviving error.

    With revisits the search is exact and polynomial. Without them, a simple walk is accepted. Otherwise the
    walk is a lower bound, and ``resource-labelling`` finds the shortest simple route. Dominance that ignores
    visited points would discard a longer label that can still visit a point needed later.

    A run that reaches its time limit returns the best of the routes of the starter and of
    :func:`~crosstrack.solvers.resource_routing.first.route_in_time`. It ends without a plan only if
    neither search found a route; above 2,000 points the starter alone searches.
    """

    name = "label-setting"
    summary = "best-first label setting with dominance on the surviving error; ours"

    def search(
        self, problem: ErrorCorrectionRouting, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Search under a rising ceiling, then for simple routes if the walk repeats points."""
        from .ceiling_kernels import climb

        begin = clock()
        result = Found(*climb(space, ceiling, request.control.flag))
        if not problem.revisits and len(np.unique(result.route)) < len(result.route):
            result = _find_simple(problem, space, result, ceiling, request)
        return result, {"search_seconds": clock() - begin}


def _find_simple(
    problem: ErrorCorrectionRouting, space: Airspace, walk: Found, ceiling: float, request: Request
) -> Found:
    """Return the shortest simple route up to `ceiling` (m), with the counts of `walk`, the shortest walk.

    Routes little longer than the walk are searched first, because they use fewer points. The shortest walks
    from the points to B bound the rest of a route. If the arcs need too much memory, the status is ``OPEN``,
    and the bound is the length of the walk, or that of the first search.
    """
    from .grid import build
    from .way_kernels import lengths_of_walks

    grid = build(space, np.ones(len(space.points), np.bool_))
    whole = replace(walk, status=OPEN, route=np.empty(0, np.int64), length=np.inf)
    for most in (min(ceiling, walk.length * (1.0 + NEAR)), ceiling):
        status, lengths, made = lengths_of_walks(
            space, grid, most * (1.0 + ROUNDING), request.control.flag
        )
        if status != FOUND:
            return replace(whole, status=status, made=whole.made + made)
        least = np.empty(len(space.points))
        least[grid.ids] = lengths
        try:
            part, _ = ResourceLabelling().find(problem.lower(), most, request, least)
        except UnsupportedFormulation:
            return replace(whole, status=OPEN)
        whole = replace(
            part,
            # Walks above the ceiling are unknown, so that no simple route up to it is no proof beyond it.
            bound=max(whole.bound, min(part.bound, most)),
            made=whole.made + made + part.made,
            settled=whole.settled + part.settled,
            rounds=whole.rounds + part.rounds,
        )
        if part.status != NOTHING or most == ceiling:
            break
    return whole
