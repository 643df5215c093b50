"""A*, Dijkstra's algorithm and jump point search, exact by integer costs.

If cells have weights, costs are floats.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.grid_path.model import Connectivity, GridPath
from .native import Field, Ints, NeighbourSearch, Search

__all__ = ["AStar", "Dijkstra", "JumpPoint"]


class AStar(NeighbourSearch):
    """A*: expands cells in the order of their cost plus a lower bound on the remaining cost.

    The bound is the cost to the goals' bounding rectangle on a map without blocked cells, times the
    smallest weight. With one goal, it is the Manhattan or octile distance.
    """

    name = "a-star"
    summary = "A* with octile or Manhattan distance, exact"
    guided = True

    def search(self, field: Field, goals: Ints, every: bool, flag: NDArray[np.int8]) -> Search:
        """Search with buckets, or with a heap if cells have weights."""
        from ...models.grid_path.search_kernels import CEILING, STOPPED, STRAIGHT, sweep, trace
        from .heap_kernels import back, weighted

        walls, width, diagonal = field.walls, field.width, field.diagonal
        how = (width, field.start, goals, every, diagonal, self.guided, flag)
        if field.problem.weights is not None:
            status, costs, parents, expanded, bound = weighted(walls, field.weights, *how)
            return Search(
                status == STOPPED, costs[goals], bound, lambda goal: back(parents, goal), expanded
            )
        status, left, expanded, least = sweep(walls, *how)
        return Search(
            status == STOPPED,
            np.where(left[goals] > 0, (CEILING - left[goals]) / STRAIGHT, np.inf),
            least / STRAIGHT,
            lambda goal: trace(walls, width, left, goal, diagonal),
            expanded,
        )


class Dijkstra(AStar):
    """Dijkstra's algorithm: one search in the order of cost for all goals."""

    name = "dijkstra"
    summary = "Dijkstra's algorithm, one search for all goals, exact"
    guided = False
    shared = True


class JumpPoint(NeighbourSearch):
    """Jump point search without cutting corners: A* over jump points, the cells at which a path may turn."""

    name = "jump-point"
    summary = "jump point search for 8 neighbours without weights, exact"

    def refuses(self, problem: GridPath) -> str:
        """Return the feature of a problem that jump point search does not support, or an empty string."""
        if problem.connectivity is Connectivity.FOUR:
            return "connectivity '4': its runs go on diagonally"
        if problem.weights is not None:
            return "weights: its runs take all cells for equal"
        return super().refuses(problem)

    def search(self, field: Field, goals: Ints, every: bool, flag: NDArray[np.int8]) -> Search:
        """Search for the nearest goal. If `every`, `goals` has one entry, because `shared` is False."""
        from ...models.grid_path.search_kernels import STOPPED, STRAIGHT
        from .jump_kernels import jump, unroll

        status, goal, cost, parents, expanded = jump(
            field.walls, field.width, field.start, goals, flag
        )
        return Search(
            status == STOPPED,
            np.where(goals == goal, cost / STRAIGHT, np.inf),
            cost / STRAIGHT,
            lambda end: unroll(parents, field.width, end),
            expanded,
        )
