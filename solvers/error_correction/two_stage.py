"""``two-stage``: the paper's own exact algorithm."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..backend import Request
from .labelling import WEIGHTS, sweep
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace
    from .elementary import Found

__all__ = ["TwoStage"]


class TwoStage(RoutingBackend):
    """Labelling gives an upper bound; a label search under it, on what it leaves, is exact.

    As we read the paper: stage 1 sweeps over the weights of ``labelling``. Stage 2 drops the
    points through which every way is longer than the route found, bounds what remains of a label
    by the shortest way to B over arcs that the thresholds alone allow, and searches best-first.
    Dominance that ignores visited points is exact only where revisits are allowed; where they are
    not, points that a walk repeats become critical (see :mod:`.elementary`).
    """

    name = "two-stage"
    summary = "the paper's: labelling for a bound, then an exact label search under it"

    def search(
        self, space: Airspace, revisits: bool, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the two stages."""
        from .elementary import Found, elementary, simple_below
        from .grid import build
        from .outcomes import FULL, NOTHING, STOPPED
        from .slots import critical_bits, shortest_ways
        from .sweep_kernels import best_first
        from .way_kernels import plain_ways

        flag = request.control.flag
        begin = time.perf_counter()
        grid = build(space, np.ones(len(space.points), np.bool_))
        ahead = shortest_ways(space, grid, flag)
        if not np.isfinite(ahead[-2]):
            return Found(NOTHING, np.empty(0, np.int64), np.inf, np.inf, 0, 0), {}
        first, length, made, hits, _ = sweep(space, grid, WEIGHTS, request)
        # The route found must stay below its own ceiling whatever rounding does.
        ceiling = min(ceiling, length * (1 + 1e-12))
        between = time.perf_counter()
        least = float(ahead[-2])
        through = ahead + shortest_ways(space, grid, flag, forward=True)
        keep = np.zeros(len(space.points), np.bool_)
        keep[grid.ids[np.isfinite(through) & (through <= ceiling * (1 + 1e-12))]] = True
        smaller = build(space, keep)
        left = np.full(len(space.points), np.inf)
        left[grid.ids] = ahead
        ahead = left[smaller.ids]

        def searched(critical: np.ndarray[Any, np.dtype[np.int64]], bound: float) -> Found:
            if critical.size:
                return simple_below(space, critical, bound, ceiling, flag, best_first)
            bits, words = critical_bits(smaller, critical)
            ways = plain_ways(ahead)
            return Found(*best_first(space, smaller, ways, bits, words, ceiling, flag))

        found = elementary(searched, revisits=revisits)
        if found.status in (STOPPED, FULL):
            # The first stage's route is at hand, and the way to B bounds every route.
            found = replace(
                found,
                route=found.route if found.route.size else first,
                length=min(found.length, length),
                bound=max(found.bound, least),
            )
        own = {
            "stage1_seconds": between - begin,
            "stage2_seconds": time.perf_counter() - between,
            "stage1 length": float(length) if first.size else "none",
            "stage1 labels": made,
            "stage1 weights with a route": hits,
            "points left": int(keep.sum()),
        }
        return found, own
