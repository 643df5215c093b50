"""Kernels of RRT*, with coordinates in cells of the padded map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.sight import sees

__all__ = ["Tree", "grow", "trunk"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]


class Tree(NamedTuple):
    """Tree of points.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Points x, y. The first is the root.
    parents : ndarray of int64, shape (n,)
        Index of the next point towards the root.
    ends : ndarray, shape (n,)
        Distance to the goal, infinite without a line of sight.
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
    """Return the points of the shortest path, from the last before the goal to the root, and its length.

    Parameters
    ----------
    tree : Tree
        Tree of points.
    size : int
        Number of points in the tree.
    """
    points, parents, ends = tree.points, tree.parents, tree.ends
    best, last = np.inf, -1
    for k in range(size):
        if ends[k] < best:
            total = ends[k] + _length(points, parents, k)
            if total < best:
                best, last = total, k
    path = np.empty(size, np.int64)
    count = 0
    while last >= 0:
        path[count] = last
        count += 1
        last = parents[last] if last > 0 else -1
    return path[:count], best


@kernel
def grow(
    tree: Tree, size: int, steps: int, blocked: Truths, cells: Ints, goal: Floats, bias: float,
    reach: float, gamma: float, slack: float, rng: np.random.Generator, flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Add random points to the tree and rewire it; return its number of points.

    Parameters
    ----------
    tree : Tree
        Tree, changed in place.
    size, steps : int
        Number of points in the tree, and of random points to draw.
    blocked : ndarray of bool, shape (rows + 2, columns + 2)
        Padded map.
    cells : ndarray of int64
        Flat indices of the free cells.
    goal : ndarray, shape (2,)
        Point x, y.
    bias : float
        Probability that the random point is the goal.
    reach : float
        Longest edge, cells.
    gamma : float
        Constant of the radius of rewiring.
    slack : float
        Distance, in cells, below which a segment passes through a corner.
    rng : numpy.random.Generator
        Source of random numbers.
    flag : ndarray of int8, shape (1,)
        Nonzero stops the growth.
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
