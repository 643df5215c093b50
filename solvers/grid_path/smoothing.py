"""Smoothing of a path by lines of sight, and the backends that smooth a path along neighbours.

Source: Algorithm 4 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for Multirobot
in Obstacle Environment", Wireless Communications and Mobile Computing, 2021. Its inner loop tests
``end > begin``, but assigns and decreases ``last``. Here ``last`` replaces ``end``, so that each point
connects to the last visible point of the path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...jit import kernel
from ...models.fields import Array, show
from ...models.grid_path.model import Connectivity, GridPath
from ...models.grid_path.sight import Sight, convex_corners, farthest, sees
from ..contract.backend import Feature, Guarantee, Option, Request
from .free_paths import AnyDirection, Ground, Leg
from .heap_kernels import back

if TYPE_CHECKING:
    from ...models.grid_path.gridmap import GridMap

__all__ = ["How", "ShortcutGreedy", "ShortcutVisibility", "smooth", "straighten"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]
Flag = NDArray[np.int8]
How = Literal["visibility", "greedy"]

#: Limit on the points along a path per round, at distances of at least a cell.
SAMPLES = 1000
#: Maximum number of rounds of shortest paths over points of the path and nearby corners.
ROUNDS = 20
#: Relative gain of a round below which the method stops.
GAIN = 1e-9
#: Minimum relative gain of a connection.
BETTER = 1e-12
#: Number of consecutive hidden points after which the scan stops.
LOST = 300


def smooth(grid: GridMap, path: ArrayLike, how: How = "visibility") -> Floats:
    """Return a polyline through free cells with the same ends and at most the same length.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.
    path : array-like, shape (k, 2)
        Points x, y of a polyline through free cells, m.
    how : {"visibility", "greedy"}, default "visibility"
        "greedy" connects each point with the farthest visible point (Algorithm 4). "visibility" returns
        the shortest path over lines of sight between points of the path and nearby corners, and repeats
        this until the path stops getting shorter.

    Returns
    -------
    ndarray, shape (n, 2)
        Points x, y, m.

    Raises
    ------
    InvalidData
        The path is empty or enters a blocked cell.
    """
    points = Array(("n", 2)).coerce("path", path, {})
    if not len(points):
        raise InvalidData("path must have at least one point, got none", field="path")
    if how not in ("visibility", "greedy"):
        raise InvalidData(f"how must be 'visibility' or 'greedy', got {show(how)}", field="how")
    sight = Sight(grid)
    corners, flag = convex_corners(sight.blocked), np.zeros(1, np.int8)
    return sight.metres(straighten(sight, corners, sight.cells(points), how, flag))


def straighten(
    sight: Sight, corners: NDArray[np.int8], path: Floats, how: How, flag: NDArray[np.int8]
) -> Floats:
    """Smooth a path in cells of the padded map, see :func:`smooth`.

    `corners` are those of :func:`~crosstrack.models.grid_path.sight.convex_corners`. A nonzero `flag` stops the
    method, which then returns a valid path.
    """
    hidden = int(first_hidden(sight.blocked, path, sight.slack))
    if hidden < len(path) - 1:
        a, b = sight.metres(path[hidden : hidden + 2]).tolist()
        raise InvalidData(
            f"path, segment {hidden} must keep to free cells, got one from {show(a)} to {show(b)}",
            field="path",
        )
    if how == "greedy":
        return path[farthest(sight.blocked, path, sight.slack, flag)]
    length = _length(path)
    for _ in range(ROUNDS):
        points = _around(corners, without_collinear(path))
        candidate = points[shortest(sight.blocked, points, sight.slack, flag)]
        if not len(candidate):
            break
        shorter = _length(candidate)
        if shorter < length:
            path = candidate
        if shorter >= length * (1.0 - GAIN):
            break
        length = shorter
    return path


def _length(path: Floats) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def without_collinear(path: Floats) -> Floats:
    """Return a path without duplicate and collinear points."""
    step = np.diff(path, axis=0)
    path = path[np.append(True, step.any(axis=1))]
    step = np.diff(path, axis=0)
    turns = step[:-1, 0] * step[1:, 1] != step[:-1, 1] * step[1:, 0]
    turns |= (step[:-1] * step[1:]).sum(axis=1) < 0
    return path[np.concatenate([[True], turns, [True]])] if len(path) > 2 else path


def _around(corners: NDArray[np.int8], path: Floats) -> Floats:
    """Return points of a path and nearby corners, in the order along the path."""
    steps = np.ceil(np.abs(np.diff(path, axis=0)).max(axis=1)).astype(int)
    share = np.concatenate([np.arange(n) / n for n in steps] or [np.zeros(0)])
    part = np.repeat(np.arange(len(steps)), steps)
    along = np.vstack([path[part] + share[:, None] * np.diff(path, axis=0)[part], path[-1]])
    # Corners of the lattice around each point. Each belongs to its nearest point.
    reach = np.arange(-1, 3)
    shift = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    near = np.floor(along).astype(np.int64)[:, None] + shift
    near = np.clip(near, 1, np.array(corners.shape)[::-1] - 1)
    is_corner = corners[near[..., 1], near[..., 0]] > 0
    place = np.nonzero(is_corner)[0]
    apart = np.hypot(*np.moveaxis(near - along[:, None], -1, 0))[is_corner]
    near = near[is_corner]
    order = np.lexsort((apart, near[:, 0], near[:, 1]))
    near, place = near[order], place[order]
    first = np.ones(len(near), bool)
    first[1:] = (near[1:] != near[:-1]).any(axis=1)
    near, place = near[first].astype(float), place[first]
    # The direction of the path decides between before and after the nearest point.
    ahead = along[np.minimum(place + 1, len(along) - 1)] - along[np.maximum(place - 1, 0)]
    side = 0.5 * np.sign(((near - along[place]) * ahead).sum(axis=1))
    turns = np.append(share == 0, True)
    chosen = np.flatnonzero(turns | (np.arange(len(along)) % (len(along) // SAMPLES + 1) == 0))
    points = np.vstack([along[chosen], near])
    order = np.concatenate([chosen, np.clip(place + side, 0.25, len(along) - 1.25)])
    return points[np.argsort(order, kind="stable")]


@kernel(interpretable=True)
def first_hidden(blocked: Truths, path: Floats, slack: float) -> int:
    """Return the index of the first segment of `path` that enters a blocked cell, or the number of segments."""
    for k in range(len(path) - 1):
        if not sees(blocked, path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1], slack):
            return k
    return max(len(path) - 1, 0)


@kernel(interpretable=True)
def shortest(blocked: Truths, points: Floats, slack: float, flag: Flag) -> Ints:
    """Return the indices of a shortest path from first to last point along forward lines of sight.

    The points are in the order of the path. The result is empty if `flag` stopped the search.
    """
    n = len(points)
    length = np.full(n, np.inf)
    before = np.full(n, -1, np.int64)
    length[0], before[0] = 0.0, 0
    for here in range(n - 1):
        if flag[0] != 0:
            return np.empty(0, np.int64)
        x, y = points[here, 0], points[here, 1]
        hidden = 0
        for there in range(here + 1, n):
            tx, ty = points[there, 0], points[there, 1]
            total = length[here] + math.sqrt((tx - x) ** 2 + (ty - y) ** 2)
            if total >= length[there] * (1.0 - BETTER):
                continue
            if sees(blocked, x, y, tx, ty, slack):
                length[there], before[there] = total, here
                hidden = 0
            else:
                hidden += 1
                if hidden > LOST:
                    break
    return back(before, n - 1)


class ShortcutGreedy(AnyDirection):
    """A* along neighbours, then Algorithm 4 of the paper, see :func:`smooth`.

    The paper searches over four neighbours (eq. 4). The default is eight, which gives shorter paths.
    """

    name = "shortcut-greedy"
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "neighbours": Option("8", "Neighbours for A*; the paper has 4.", str, choices=("4", "8")),
    }
    summary = "A* along neighbours, then the farthest points in sight (Algorithm 4)"
    how: ClassVar[How] = "greedy"

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search along neighbours, and straighten the path."""
        from .exact import AStar

        cell = np.floor(goal[::-1]).astype(np.int64) - 1
        connectivity = Connectivity(request.options["neighbours"])
        along = GridPath(ground.problem.map, ground.problem.start, cell, connectivity)
        answer = request.within(AStar(), along)
        if answer.point is None:
            return Leg(None, stopped=answer.limit is not None)
        path = ground.sight.cells(answer.point.paths[0])
        flag = request.control.flag
        return Leg(straighten(ground.sight, ground.corners, path, self.how, flag))


class ShortcutVisibility(ShortcutGreedy):
    """A* along neighbours, then shortest paths over points of its path and nearby corners."""

    name = "shortcut-visibility"
    summary = "A* along neighbours, then shortest paths over lines of sight near it; ours"
    how: ClassVar[How] = "visibility"
