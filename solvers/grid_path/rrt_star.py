"""``rrt-star``: trees of random points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..backend import Feature, Guarantee, Option, Request
from .free_paths import AnyDirection, Ground, Leg

__all__ = ["RRTStar"]

Floats = NDArray[np.float64]

#: Steps between reports.
BATCH = 500
#: Share of the map's longer side that an edge may have, unless an option says how long.
REACH = 0.1
#: How much more than the least constant of Karaman and Frazzoli the radius of rewiring has.
MARGIN = 1.1


class RRTStar(AnyDirection):
    """RRT*: a tree of random points in free cells, rewired where that shortens it.

    Source: S. Karaman and E. Frazzoli, "Sampling-based algorithms for optimal motion planning",
    International Journal of Robotics Research 30 (2011) 846-894, Algorithm 6: of n points, those
    nearer than gamma sqrt(log(n) / n) are rewired, with gamma above
    2 sqrt(3 / 2) sqrt(free area / pi), and no farther than the longest edge. What sees the goal is
    joined with it.

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
        """Grow a tree from the start, and report paths as they get shorter."""
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
            found, total = trunk(tree, size)
            if total < length:
                length = total
                path = np.vstack([tree.points[found[::-1]], goal])
                ground.offer(path)
            if request.control.stopped:
                break
        ground.count("points", size)
        # The last edge may end where the goal is.
        if path is not None and len(path) > 1 and (path[-2] == path[-1]).all():
            path = path[:-1]
        return Leg(path)
