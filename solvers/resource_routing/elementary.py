"""Routes without revisits from searches that allow them: decremental state-space relaxation.

A search whose dominance ignores visited points is exact if revisits are allowed, and a relaxation
otherwise: the best walk is no longer than the best simple route. A simple walk is optimal. Otherwise
its repeated points become *critical*: the next search forbids visiting them twice and stores them as
bits in its labels. Each search yields a lower bound on simple routes. The critical set grows with every
round, so the number of rounds is finite: if all points are critical, no walk repeats a point.

Source: G. Righini and M. Salani, "New dynamic programming algorithms for the resource constrained
elementary shortest path problem", Networks 51 (2008).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .outcomes import FULL, STOPPED

__all__ = ["Found", "elementary"]


@dataclass(frozen=True)
class Found:
    """Result of a search: its status, route, other longer routes, and numbers of labels made and extended.

    `status` is ``FOUND``, ``NOTHING``, ``STOPPED`` or ``FULL`` (out of memory for labels). `route` is empty
    without one; `length` is then inf, also if only longer walks than the first one are simple. `bound` is a lower
    bound on all routes, `rounds` the number of searches, and `critical` the number of critical points in the last
    one.
    """

    status: int
    route: NDArray[np.int64]
    length: float
    bound: float
    made: int
    settled: int
    rounds: int = 1
    critical: int = 0
    others: tuple[NDArray[np.int64], ...] = ()


def elementary(
    search: Callable[[NDArray[np.int64], float], Found],
    *,
    revisits: bool,
    learn: Callable[[NDArray[np.int64]], None] | None = None,
) -> Found:
    """Return the shortest route, simple unless `revisits`, with counts over all rounds.

    `search` takes the critical points and the lower bound of earlier rounds, and returns the shortest walk that
    visits none of these points twice. `learn` takes a walk that repeats points and forbids it to later searches;
    by default, these points become critical.
    """
    critical = np.empty(0, np.int64)
    made = settled = rounds = 0
    bound = -np.inf
    while True:
        result = search(critical, bound)
        # Every round is a relaxation, so bounds of earlier rounds remain valid.
        bound = max(bound, result.bound)
        made, settled, rounds = made + result.made, settled + result.settled, rounds + result.rounds
        repeated, simple = np.empty(0, np.int64), []
        for walk in (result.route, *result.others):
            points, times = np.unique(walk, return_counts=True)
            repeated = np.union1d(repeated, points[times > 1])
            if not (times > 1).any():
                simple.append(walk)
            elif learn is not None:
                learn(walk)
        total = replace(
            result, bound=bound, made=made, settled=settled, rounds=rounds, critical=critical.size
        )
        if revisits or repeated.size == 0:
            return total
        if result.status in (STOPPED, FULL):
            # The search cannot continue, and walks that repeat points are no routes.
            first, *others = simple or [np.empty(0, np.int64)]
            length = result.length if first is result.route else np.inf
            return replace(total, route=first, length=length, others=tuple(others))
        if learn is None:
            critical = np.union1d(critical, repeated)
