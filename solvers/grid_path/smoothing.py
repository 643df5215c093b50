"""Shorter paths from a path along cells, by lines of sight.

Source: Algorithm 4 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for Multirobot
in Obstacle Environment", Wireless Communications and Mobile Computing, 2021. Its inner loop tests
``end > begin``, but assigns and decreases ``last``. Here ``last`` takes the place of ``end``, so that
each point is joined to the last later point of the path that it sees.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, show
from ...models.grid_path.sight import Sight, convex_corners

if TYPE_CHECKING:
    from ...models.grid_path.gridmap import GridMap

__all__ = ["How", "smooth", "straighten"]

Floats = NDArray[np.float64]
How = Literal["visibility", "greedy"]

#: Points along a path that a round has at the most; they are a cell apart or more.
SAMPLES = 1000
#: Rounds of shortest paths over points along the path and corners near it, at the most.
ROUNDS = 20
#: Relative gain of a round below which it was the last.
GAIN = 1e-9


def smooth(grid: GridMap, path: ArrayLike, how: How = "visibility") -> Floats:
    """Return a polyline with the same ends that is no longer, and keeps to free cells.

    Parameters
    ----------
    grid : GridMap
        The map.
    path : array-like, shape (k, 2)
        x, y (m): a polyline through free cells.
    how : {"visibility", "greedy"}
        "greedy" joins each point with the farthest later one that it sees (Algorithm 4);
        "visibility" takes the shortest path over what sees each other of points along the path and
        corners near it, and again along that, until it gets no shorter.

    Raises
    ------
    InvalidData
        A path that leads through blocked cells, or no path.
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
    """Return what :func:`smooth` does, all in cells of the padded map, until `flag` is not 0."""
    from .smoothing_kernels import farthest, first_hidden, shortest

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
        found = points[shortest(sight.blocked, points, sight.slack, flag)]
        if not len(found):
            break
        shorter = _length(found)
        if shorter < length:
            path = found
        if shorter >= length * (1.0 - GAIN):
            break
        length = shorter
    return path


def _length(path: Floats) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def without_collinear(path: Floats) -> Floats:
    """Return a path without the points at which it leads straight on."""
    step = np.diff(path, axis=0)
    path = path[np.append(True, step.any(axis=1))]
    step = np.diff(path, axis=0)
    turns = step[:-1, 0] * step[1:, 1] != step[:-1, 1] * step[1:, 0]
    turns |= (step[:-1] * step[1:]).sum(axis=1) < 0
    return path[np.concatenate([[True], turns, [True]])] if len(path) > 2 else path


def _around(corners: NDArray[np.int8], path: Floats) -> Floats:
    """Return points along a path and the corners near it, in their order."""
    steps = np.ceil(np.abs(np.diff(path, axis=0)).max(axis=1)).astype(int)
    share = np.concatenate([np.arange(n) / n for n in steps] or [np.zeros(0)])
    part = np.repeat(np.arange(len(steps)), steps)
    along = np.vstack([path[part] + share[:, None] * np.diff(path, axis=0)[part], path[-1]])
    # Of the lattice around each point, what is a corner; it stands where it is the nearest.
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
    # Before or after the nearest point, by the direction of the path there.
    ahead = along[np.minimum(place + 1, len(along) - 1)] - along[np.maximum(place - 1, 0)]
    side = 0.5 * np.sign(((near - along[place]) * ahead).sum(axis=1))
    turns = np.append(share == 0, True)
    kept = np.flatnonzero(turns | (np.arange(len(along)) % (len(along) // SAMPLES + 1) == 0))
    points = np.vstack([along[kept], near])
    order = np.concatenate([kept, np.clip(place + side, 0.25, len(along) - 1.25)])
    return points[np.argsort(order, kind="stable")]
