"""``rrt-star``: random trees with rewiring."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..contract.backend import Feature, Guarantee, Option, Request
from .free_paths import AnyDirection, Ground, Leg

__all__ = ["RRTStar"]

Floats = NDArray[np.float64]

#: Number of steps between reports.
BATCH = 500
#: Default of the longest edge, as a share of the map's longer side.
REACH = 0.1
#: Factor on the smallest constant of Karaman and Frazzoli for the radius of rewiring.
MARGIN = 1.1


class RRTStar(AnyDirection):
    """RRT*: tree of random points in free cells with rewiring to shorter paths.

    Source: S. Karaman and E. Frazzoli, "Sampling-based algorithms for optimal motion planning",
    International Journal of Robotics Research 30 (2011) 846-894, Algorithm 6. With n points, the radius
    of rewiring is the smaller of gamma sqrt(log(n) / n) and the longest edge, with gamma above
    2 sqrt(3 / 2) sqrt(free area / pi). Every point with a line of sight to the goal connects to it.

    The paper on fleets names RRT (Algorithm 1, line 20) without steps or parameters.
    """

    name = "rrt-star"
    guarantee = Guarantee.HEURISTIC
    deterministic = False
    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "steps": Option(5000, "Random points for each goal.", int, lower=1, upper=1_000_000),
        "bias": Option(0.05, "Share of the points that are the goal.", lower=0, upper=1),
        "reach": Option(
            0.0, "Longest edge, in cells; 0 means a tenth of the map's longer side.", lower=0
        ),
    }
    summary = "RRT*: a tree of random points, rewired where that shortens it"

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Grow a tree from the start, and report each shorter path."""
        from .rrt_kernels import Tree, grow, trunk

        steps, bias = request.options["steps"], request.options["bias"]
        blocked = ground.sight.blocked
        reach = request.options["reach"] or max(REACH * max(blocked.shape), 2.0)
        cells = np.flatnonzero(~blocked)
        gamma = MARGIN * 2.0 * math.sqrt(1.5 * len(cells) / math.pi)
        tree = Tree(
            np.empty((steps + 1, 2)), np.zeros(steps + 1, np.int64), np.full(steps + 1, np.inf)
        )
        tree.points[0] = ground.start
        size, path, length = 1, None, math.inf
        for done in range(0, steps, BATCH):
            size = grow(
                tree, size, min(BATCH, steps - done), blocked, cells, goal, bias, float(reach),
                gamma, ground.sight.slack, ground.rng, request.control.flag,
            )  # fmt: skip
            nodes, total = trunk(tree, size)
            if total < length:
                length = total
                path = np.vstack([tree.points[nodes[::-1]], goal])
                ground.offer(path)
            if request.control.stopped:
                break
        ground.count("points", size)
        # The last point of the tree may coincide with the goal.
        if path is not None and len(path) > 1 and (path[-2] == path[-1]).all():
            path = path[:-1]
        return Leg(path)
