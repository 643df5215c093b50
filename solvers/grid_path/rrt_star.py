"""``rrt-star``: random trees with rewiring."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.sight import sees
from ..contract.backend import Feature, Guarantee, Option, Request
from .free_paths import AnyDirection, Ground, Leg
from .heap_kernels import back

__all__ = ["RRTStar", "Tree", "grow", "trunk"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Number of steps between reports.
BATCH = 500
#: Default of the longest edge, as a share of the map's longer side.
REACH = 0.1
#: Factor on the smallest constant of Karaman and Frazzoli for the radius of rewiring.
MARGIN = 1.1


class Tree(NamedTuple):
    """Tree of points x, y, shape (n, 2). The first point is the root.

    `parents` are the indices of the next points towards the root, and `ends` the distances to the goal,
    infinite without a line of sight.
    """

    points: Floats
    parents: Ints
    ends: Floats


@kernel
def _apart(points: Floats, k: int, x: float, y: float) -> float:
    return math.sqrt((points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2)


@kernel
def _length(points: Floats, parents: Ints, k: int) -> float:
    """Return the length of the path from the root to a point, in cells."""
    total = 0.0
    while k > 0:
        before = parents[k]
        total += _apart(points, before, points[k, 0], points[k, 1])
        k = before
    return total


@kernel
def trunk(tree: Tree, size: int) -> tuple[Ints, float]:
    """Return the points of the shortest path, from the root to the last before the goal, and its length."""
    points, parents, ends = tree.points, tree.parents, tree.ends
    best, last = np.inf, -1
    for k in range(size):
        if ends[k] < best:
            total = ends[k] + _length(points, parents, k)
            if total < best:
                best, last = total, k
    return back(parents, last) if last >= 0 else np.empty(0, np.int64), best


@kernel
def grow(
    tree: Tree, size: int, steps: int, blocked: Truths, cells: Ints, goal: Floats, bias: float,
    reach: float, gamma: float, slack: float, rng: np.random.Generator, flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Add up to `steps` random points to the tree of `size` points and rewire it; return its number of points.

    `cells` are the flat indices of the free cells of the padded map, and `bias` is the probability that
    the random point is the goal. `reach` is the longest edge and `gamma` the constant of the radius of
    rewiring, both in cells. A segment closer to a corner than `slack`, in cells, passes through it.
    """
    points, parents, ends = tree.points, tree.parents, tree.ends
    columns = blocked.shape[1]
    near = np.empty(len(points), np.int64)
    gaps = np.empty(len(points))
    for _ in range(steps):
        if flag[0] != 0:
            break
        x, y = goal[0], goal[1]
        if rng.random() >= bias:
            cell = cells[int(rng.random() * len(cells))]
            x = cell % columns + rng.random()
            y = cell // columns + rng.random()
        closest, gap = 0, np.inf
        for k in range(size):
            apart = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
            if apart < gap:
                closest, gap = k, apart
        gap = math.sqrt(gap)
        from_x, from_y = points[closest, 0], points[closest, 1]
        if gap > reach:
            x, y = from_x + (x - from_x) * reach / gap, from_y + (y - from_y) * reach / gap
        if gap == 0.0 or not sees(blocked, from_x, from_y, x, y, slack):
            continue
        # Visible neighbours, and the best parent among them.
        radius = min(gamma * math.sqrt(math.log(size + 1.0) / (size + 1.0)), reach)
        count, best = 0, np.inf
        for k in range(size):
            if abs(points[k, 0] - x) > radius and k != closest:
                continue
            gap = _apart(points, k, x, y)
            if k == closest or (
                gap <= radius and sees(blocked, points[k, 0], points[k, 1], x, y, slack)
            ):
                near[count], gaps[count] = k, gap
                count += 1
                total = _length(points, parents, k) + gap
                if total < best:
                    best, parents[size] = total, k
        points[size, 0], points[size, 1] = x, y
        ends[size] = np.inf
        if sees(blocked, x, y, goal[0], goal[1], slack):
            ends[size] = math.sqrt((goal[0] - x) ** 2 + (goal[1] - y) ** 2)
        for m in range(count):
            if best + gaps[m] < _length(points, parents, near[m]) * (1.0 - 1e-12):
                parents[near[m]] = size
        size += 1
    return size


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
                path = np.vstack([tree.points[nodes], goal])
                ground.offer(path)
            if request.control.stopped:
                break
        ground.count("points", size)
        # The last point of the tree may coincide with the goal.
        if path is not None and len(path) > 1 and (path[-2] == path[-1]).all():
            path = path[:-1]
        return Leg(path)
