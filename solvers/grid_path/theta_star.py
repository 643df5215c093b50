"""``theta-star``: A* along neighbours with any-angle parents."""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.grid_path.sight import SLACK, sees
from ..contract.backend import Feature, Guarantee, Request
from .free_paths import AnyDirection, Ground, Leg
from .heap_kernels import back

__all__ = ["ThetaStar", "theta"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]


@kernel(interpretable=True)
def theta(
    blocked: Truths, start: int, goal: int, slack: float, flag: NDArray[np.int8]
) -> tuple[Ints, int]:
    """Return the cells of a path from the start to the goal, and the number of expanded cells.

    The path is empty if the goal was not reached. `blocked` is the padded map, and `start` and `goal` are flat
    indices. A segment closer to a corner than `slack`, in cells, passes through it.
    """
    columns = blocked.shape[1]
    cost = np.full(blocked.size, np.inf)
    parent = np.full(blocked.size, -1, np.int64)
    done = np.zeros(blocked.size, np.bool_)
    goal_row, goal_column = goal // columns, goal % columns
    cost[start], parent[start] = 0.0, start
    heap = [(0.0, start)]
    expanded = 0
    while len(heap) > 0 and flag[0] == 0:
        _, here = heappop(heap)
        if done[here]:
            continue
        done[here] = True
        if here == goal:
            break
        expanded += 1
        row, column = here // columns, here % columns
        before = parent[here]
        y, x = before // columns, before % columns
        for down in range(-1, 2):
            for right in range(-1, 2):
                there = here + down * columns + right
                if blocked[row + down, column + right] or done[there]:
                    continue
                if blocked[row + down, column] and blocked[row, column + right]:
                    continue
                to_y, to_x = row + down, column + right
                total = cost[before] + math.sqrt((to_y - y) ** 2 + (to_x - x) ** 2)
                via = before
                if total < cost[there] and not sees(
                    blocked, x + 0.5, y + 0.5, to_x + 0.5, to_y + 0.5, slack
                ):
                    total = cost[here] + math.sqrt(down * down + right * right)
                    via = here
                if total < cost[there]:
                    cost[there], parent[there] = total, via
                    rest = math.sqrt((to_y - goal_row) ** 2 + (to_x - goal_column) ** 2)
                    heappush(heap, (total + rest, there))
    return back(parent, goal) if done[goal] else np.empty(0, np.int64), expanded


class ThetaStar(AnyDirection):
    """Theta* on the centres of cells.

    Source: A. Nash, K. Daniel, S. Koenig and A. Felner, "Theta*: any-angle path planning on grids",
    AAAI 2007. The parent of a neighbour is the parent of the expanded cell if it has a line of sight to the
    neighbour, otherwise the expanded cell.
    """

    name = "theta-star"
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    summary = "Theta* on the centres of cells"

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search, and trace the path back from the goal."""
        blocked, flag = ground.sight.blocked, request.control.flag
        columns = blocked.shape[1]
        start, end = (int(y) * columns + int(x) for x, y in (ground.start, goal))
        cells, expanded = theta(blocked, start, end, SLACK, flag)
        ground.count("cells expanded", expanded)
        if not len(cells):
            return Leg(None, stopped=request.control.stopped)
        return Leg(np.stack([cells % columns, cells // columns], axis=1) + 0.5)
