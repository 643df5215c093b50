"""Routes without revisits from searches that allow them: decremental state-space relaxation.

The rounds are those of :mod:`crosstrack.solvers.resource_routing.elementary`. A label dominates another only if
its visited critical points are a subset of the other's. This is exact for "no critical point twice", as every
extension of the dominated label is an extension of the dominating one. Except for contrived instances, one
or two rounds suffice.

Labels with different visited critical points do not dominate each other; a chain of k binary choices
needs 2^k of them. But a distant point no longer matters if every route that returns to it is too long.
So :func:`simple_below` searches under a ceiling that starts just above the proven bound and increases
until a route is found. Under the ceiling most points are too far away to return to, and they are
dropped from the labels (see :mod:`.labels`). The remaining length to B is bounded by the shortest walk
for the carried error (:mod:`.way_kernels`), so the ceiling leaves little room for returns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..resource_routing.elementary import Found, elementary
from ..resource_routing.outcomes import FOUND, NOTHING
from .airspace import Airspace
from .grid import Grid, build
from .way_kernels import ways_on

__all__ = ["Found", "critical_bits", "elementary", "simple_below"]

#: First ceiling above the proven bound, relative to it, and the growth factor of that share.
FIRST, RISE = 1e-3, 2.2


def critical_bits(grid: Grid, critical: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the bit number of every slot (-1 if not critical) and the number of 64-bit words.

    `critical` are the indices of the critical points, ascending.
    """
    bits = np.full(len(grid.ids), -1)
    if critical.size:
        place = np.minimum(np.searchsorted(critical, grid.ids), critical.size - 1)
        bits = np.where(critical[place] == grid.ids, place, -1)
    return bits.astype(np.int64), (critical.size + 63) // 64


def simple_below(
    space: Airspace,
    critical: NDArray[np.int64],
    lower: float,
    cutoff: float,
    flag: NDArray[np.int8],
    search: Callable[..., tuple[int, NDArray[np.int64], float, float, int, int]],
) -> Found:
    """Return the shortest walk up to `cutoff` (m) that visits no critical point twice.

    `critical` are the indices of the critical points, ascending, and `lower` is a lower bound on the
    length (m), the base of the ceilings. `search` is a kernel that searches below a ceiling, such as
    :func:`.sweep_kernels.best_first`.
    """
    behind, ahead = (
        np.linalg.norm(space.points - space.points[end], axis=1) for end in (space.start, space.end)
    )
    made = settled = 0
    share, bound = FIRST, lower
    while True:
        ceiling = lower * (1.0 + share)
        if share > 4.0 or ceiling >= cutoff or ceiling == 0.0:
            ceiling = cutoff
        keep = behind + ahead <= ceiling * (1.0 + 1e-12)
        grid = build(space, keep)
        status, ways, labels, pruned = ways_on(space, grid, ceiling, flag)
        made += labels
        if status == FOUND:
            bits, words = critical_bits(grid, critical)
            result = Found(*search(space, grid, ways, bits, words, ceiling, flag))
            made, settled = made + result.made, settled + result.settled
        else:
            result = Found(status, np.empty(0, np.int64), np.inf, bound, 0, 0)
        if result.status != NOTHING or ceiling >= cutoff:
            return replace(result, bound=max(bound, result.bound), made=made, settled=settled)
        bound = ceiling
        # If nothing was pruned, a higher ceiling can only add returns to critical points.
        share = share * RISE if pruned or not keep.all() else np.inf
