"""Routes without revisits from searches that allow them: decremental state-space relaxation.

A search whose dominance ignores visited points is exact where revisits are allowed, and a
relaxation where they are not: the best walk is no longer than the best simple route. If that walk
is simple, it is the answer. If it is not, the points that it visits twice become *critical*: the
next search forbids visiting them twice, keeps them as bits in its labels, and lets a label dominate
another only if its critical points are among the other's. This is exact for "no critical point
twice" (a way that continues the dominated label continues the dominating one as well, for it needs
no critical point that the latter has used and the former has not), so each search again bounds
the simple routes from below. The critical set grows with every round and is contained in the
points, so the rounds end, at the latest with every point critical, where no walk repeats a point.
In all but contrived instances the first or second round is the last.

Labels that have visited different critical points do not dominate each other, and a chain of k
places where a choice is made would need 2^k of them. But a point far behind matters no more, because
no route that returns to it is short enough. So :func:`simple_below` searches under a ceiling that
begins just above what is proven and rises until there is a route; below it the way back to most points
is too long, and they are forgotten (see :mod:`.labels`). What remains to B is bounded by the shortest
walk for the error carried (:mod:`.way_kernels`), so that what the route loses against the walk is
all that the ceiling leaves for ways back.

Source: G. Righini and M. Salani, "New dynamic programming algorithms for the resource constrained
elementary shortest path problem", Networks 51 (2008).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..resource_routing.elementary import Found, elementary
from .airspace import Airspace
from .grid import build
from .outcomes import FOUND, NOTHING
from .slots import critical_bits
from .way_kernels import ways_on

__all__ = ["Found", "elementary", "simple_below"]

#: First ceiling above what is proven, and the factor by which it rises, in shares of that.
FIRST, RISE = 1e-3, 2.2


def simple_below(
    space: Airspace,
    critical: NDArray[np.int64],
    lower: float,
    cutoff: float,
    flag: NDArray[np.int8],
    search: Callable[..., tuple[int, NDArray[np.int64], float, float, int, int]],
) -> Found:
    """Return the shortest walk up to `cutoff` that visits no critical point twice.

    Parameters
    ----------
    space : Airspace
        The problem.
    critical : ndarray of int64
        Indices of the critical points, ascending.
    lower : float
        Lower bound on the length (m), from which the ceiling rises.
    cutoff : float
        Length above which nothing is wanted; inf for none.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the search.
    search : callable
        The kernel that searches below a ceiling, such as :func:`.sweep_kernels.best_first`.
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
            found = Found(*search(space, grid, ways, bits, words, ceiling, flag))
            made, settled = made + found.made, settled + found.settled
        else:
            found = Found(status, np.empty(0, np.int64), np.inf, bound, 0, 0)
        if found.status != NOTHING or ceiling >= cutoff:
            return replace(found, bound=max(bound, found.bound), made=made, settled=settled)
        bound = ceiling
        # Where nothing was left out, a higher ceiling would only make more ways back count.
        share = share * RISE if pruned or not keep.all() else np.inf
