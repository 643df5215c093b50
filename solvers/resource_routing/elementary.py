"""Routes without revisits from searches that allow them: decremental state-space relaxation.

A search whose dominance ignores visited points is exact where revisits are allowed, and a
relaxation where they are not: the best walk is no longer than the best simple route. If that walk
is simple, it is the answer. If it is not, the points that it visits twice become *critical*: the
next search forbids visiting them twice and keeps them as bits in its labels. Each search again bounds
the simple routes from below. The critical set grows with every round and is contained in the
points, so the rounds end, at the latest with every point critical, where no walk repeats a point.

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
    """What a search found.

    Parameters
    ----------
    status : int
        ``FOUND``, ``NOTHING``, ``STOPPED`` or ``FULL`` (out of room for labels).
    route : ndarray of int64
        Points from start to end, empty without one.
    length : float
        Its length, inf without one.
    bound : float
        A lower bound on every route's length.
    made, settled : int
        Labels made and labels extended.
    rounds, critical : int
        Searches run, and critical points in the last one.
    """

    status: int
    route: NDArray[np.int64]
    length: float
    bound: float
    made: int
    settled: int
    rounds: int = 1
    critical: int = 0


def elementary(search: Callable[[NDArray[np.int64], float], Found], *, revisits: bool) -> Found:
    """Return the best route, simple unless `revisits`.

    Parameters
    ----------
    search : callable
        Takes the critical points and what earlier rounds have proven of the length, and returns the
        best walk that visits none of these points twice.
    revisits : bool
        Whether the first walk will do, whatever it visits.
    """
    critical = np.empty(0, np.int64)
    made = settled = rounds = 0
    bound = -np.inf
    while True:
        found = search(critical, bound)
        # Every round is a relaxation: what an earlier one has proven stands.
        bound = max(bound, found.bound)
        made, settled, rounds = made + found.made, settled + found.settled, rounds + found.rounds
        points, times = np.unique(found.route, return_counts=True)
        twice = points[times > 1]
        total = replace(
            found, bound=bound, made=made, settled=settled, rounds=rounds, critical=critical.size
        )
        if revisits or twice.size == 0:
            return total
        if found.status in (STOPPED, FULL):
            # The walk at hand is no route, and there is no time to mend it.
            return replace(total, route=np.empty(0, np.int64), length=np.inf)
        critical = np.union1d(critical, twice)
