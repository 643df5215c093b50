"""``any-angle``: the shortest path in any direction, proven."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..backend import Feature, Guarantee, Request
from .free_paths import AnyDirection, Ground, Leg
from .smoothing import without_collinear

__all__ = ["AnyAngle"]

Floats = NDArray[np.float64]

#: Cells above which a run with a time limit begins with a shortened path along neighbours.
LARGE = 40_000


class AnyAngle(AnyDirection):
    """A* over the convex corners of blocked cells, which are found as they come into sight.

    Any shortest path turns only around such corners, so the search is exact; see
    :mod:`.any_angle_kernels`.
    """

    name = "any-angle"
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    summary = "shortest paths in any direction, by A* over corners in sight; ours"

    def starter(self, problem: Any) -> str:
        """Return the shortened path along neighbours for maps whose search may not end in time."""
        return "shortcut-greedy" if problem.map.blocked.size > LARGE else ""

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search, and walk back from the goal."""
        from .any_angle_kernels import ABSENT, STOPPED, search

        blocked, corners = ground.sight.blocked, ground.corners
        runs, onward = ground.tables
        status, bound, turns, settled = search(
            blocked, runs, corners, onward, ground.start, goal, ceiling, request.control.flag
        )
        ground.count("corners settled", settled)
        if status == STOPPED:
            return Leg(None, float(bound), stopped=True)
        if status == ABSENT:
            return Leg(None, math.inf)
        points = np.stack([turns[::-1] % blocked.shape[1], turns[::-1] // blocked.shape[1]], axis=1)
        path = np.vstack([ground.start, points, goal]).astype(float)
        return Leg(without_collinear(path), float(bound))
