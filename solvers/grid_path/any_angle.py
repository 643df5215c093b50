"""``any-angle``: provably shortest paths in any direction, by A* over convex corners in sight.

A shortest path turns only at convex corners of blocked cells, and only around them. After an arrival at a
corner in some direction, only the wedge from this direction to the wall of the turn matters. The search
scans the wedge along the lines of the lattice. Blocked cells clip and split it.

Coordinates are multiples of 1/2 in cells of the padded map. Rays are slopes, cells across per line. Each
slope is one quotient of exact numbers, so equal slopes compare equal and different slopes differ.
Visibility is therefore exact.

Sources: D. Harabor, A. Grastien, D. Öz and V. Aksakalli, "Optimal any-angle pathfinding in
practice", Journal of Artificial Intelligence Research 56 (2016) 89-118, for intervals and taut turns;
S. Oh and H. W. Leong, "Edge N-level sparse visibility graphs", SoCS 2017, for taut searches.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ..contract.backend import Feature, Guarantee, Request
from .free_paths import AnyDirection, Ground, Leg
from .native import LARGE
from .smoothing import without_collinear

__all__ = ["ABSENT", "FOUND", "STOPPED", "AnyAngle", "search"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Shorts = NDArray[np.int32]
Corners = NDArray[np.int8]
Truths = NDArray[np.bool_]
Flag = NDArray[np.int8]

#: Status of a search: shortest path found, no path below the ceiling, or stopped.
FOUND, ABSENT, STOPPED = 0, 1, 2


@kernel
def _turn(kind: int, dx: float, dy: float) -> int:
    """Return the possible turn of a path that reaches a corner in direction (dx, dy).

    0 is no turn, 1 a turn towards the vertical wall, 2 a turn towards the horizontal wall.
    """
    across = dx if kind == 2 or kind == 4 else -dx
    along = dy if kind >= 3 else -dy
    if across < 0.0 and along >= 0.0:
        return 1
    return 2 if across >= 0.0 and along < 0.0 else 0


@kernel
def _note(
    corners: Corners, onward: Shorts, line: int, first: int, last: int, dx: float, dy: float,
    seen: Ints, count: int,
) -> int:  # fmt: skip
    """Append the corners of a line from `first` to `last` that allow a turn; return the new count."""
    width = corners.shape[1]
    x = onward[line, first]
    while x <= last:
        if _turn(corners[line, x], dx + x, dy) > 0:
            seen[count] = line * width + x
            count += 1
        x = onward[line, x + 1]
    return count


@kernel
def _sweep(
    runs: Shorts, corners: Corners, onward: Shorts, x0: float, y0: float, step: int,
    lower: float, upper: float, goal: Floats, wedges: Floats, seen: Ints, count: int,
) -> int:  # fmt: skip
    """Append the corners visible from (x0, y0) upwards (step 1) or downwards (-1) between two slopes.

    Return the new count, or -1 - count if the goal is visible, too. `wedges`, shape (2, 2, columns + 2), is
    a work array of slopes at the current and at the next line.
    """
    width = runs.shape[2] - 1
    goal_visible = False
    row = math.floor(y0) if step > 0 else math.ceil(y0) - 1
    line = row + 1 if step > 0 else row
    far = abs(line - y0)
    # First run of free cells. At a corner, it contains the cell of the wedge.
    cell = math.floor(x0) if x0 != math.floor(x0) or upper > 0.0 else int(x0) - 1
    a, b = runs[0, row, cell], runs[1, row, cell]
    low, high = max(lower, (a - x0) / far), min(upper, (b - x0) / far)
    if row == math.floor(goal[1]) and goal[1] != y0 and a < goal[0] < b:
        goal_visible = lower <= (goal[0] - x0) / abs(goal[1] - y0) <= upper
    here = 0
    wedges[0, 0, 0], wedges[0, 1, 0] = low, high
    size = 1 if low <= high else 0
    while size > 0:
        following = 0
        row += step
        for k in range(size):
            low, high = wedges[here, 0, k], wedges[here, 1, k]
            # Corners on this line. Rounding affects the floor only if a slope meets the lattice.
            first = math.ceil(x0 + low * far - 1e-6)
            if (first - x0) / far < low:
                first += 1
            last = math.floor(x0 + high * far + 1e-6)
            if (last - x0) / far > high:
                last -= 1
            count = _note(corners, onward, line, first, last, -x0, float(line - y0), seen, count)
            if low == high:
                continue
            cell = math.floor(x0 + low * far + 1e-6)
            if (cell - x0) / far > low:
                cell -= 1
            a = runs[0, row, cell]
            if a < 0:  # blocked
                a = runs[1, row, cell]
            while a < width and (a - x0) / far < high:
                b = runs[1, row, a]
                left, right = max(low, (a - x0) / far), min(high, (b - x0) / far)
                if row == math.floor(goal[1]) and a < goal[0] < b:
                    goal_visible = (
                        goal_visible or left <= (goal[0] - x0) / abs(goal[1] - y0) <= right
                    )
                left = max(left, (a - x0) / (far + 1.0))
                right = min(right, (b - x0) / (far + 1.0))
                if left <= right:
                    wedges[1 - here, 0, following], wedges[1 - here, 1, following] = left, right
                    following += 1
                a = runs[1, row, b]
        here, size = 1 - here, following
        line += step
        far += 1.0
    return -1 - count if goal_visible else count


@kernel
def _slide(
    blocked: Truths, corners: Corners, x: int, y: int, step: int, seen: Ints, count: int
) -> int:
    """Append the corners visible along the line of a corner to the right (step 1) or left (-1)."""
    width = corners.shape[1]
    beside = x if step > 0 else x - 1
    above, below = blocked[y, beside], blocked[y - 1, beside]
    while not (above and below):
        x += step
        beside += step
        was_above, was_below = above, below
        above, below = blocked[y, beside], blocked[y - 1, beside]
        if above == was_below and below == was_above and above != below:
            break  # between two diagonal blocked cells
        if corners[y, x] > 0 and _turn(corners[y, x], float(step), 0.0) > 0:
            seen[count] = y * width + x
            count += 1
    return count


@kernel
def _visible(
    blocked: Truths, runs: Shorts, corners: Corners, onward: Shorts, x: int, y: int, dx: float,
    dy: float, goal: Floats, wedges: Floats, seen: Ints,
) -> int:  # fmt: skip
    """Collect the corners visible from a corner reached in direction (dx, dy); see :func:`_sweep`."""
    kind = corners[y, x]
    right = 1 if kind == 2 or kind == 4 else -1
    up = 1 if kind >= 3 else -1
    count = 0
    if _turn(kind, dx, dy) == 1:  # turn towards the vertical wall
        step, side = up, -right
        steep, flat = 0.0, np.inf if dy == 0.0 else abs(dx / dy)
    else:
        step, side = -up, right
        steep, flat = abs(dx / dy), np.inf
        count = _slide(blocked, corners, x, y, right, seen, count)
    lower, upper = (steep, flat) if side > 0 else (-flat, -steep)
    return _sweep(
        runs, corners, onward, float(x), float(y), step, lower, upper, goal, wedges, seen, count
    )


@kernel(interpretable=True)
def search(
    blocked: Truths, runs: Shorts, corners: Corners, onward: Shorts, start: Floats, goal: Floats,
    ceiling: float, flag: Flag,
) -> tuple[int, float, Ints, int]:  # fmt: skip
    """Search for a shortest path between centres of cells without a line of sight.

    `blocked` is the padded map. `runs` and `onward` are the tables of :func:`.free_paths.line_tables`,
    and `corners` the kinds of :func:`crosstrack.models.grid_path.sight.convex_corners`. The path must be
    shorter than `ceiling`, in cells. A nonzero `flag` stops the search.

    The result is the status, the length of the path or a lower bound on it, in cells, the corners of the
    path from the last to the first, as y times the map's columns plus x, and the number of expanded
    points.
    """
    rows, columns = corners.shape
    total = 0
    for line in range(rows):
        place = onward[line, 0]
        while place < columns:
            total += 1
            place = onward[line, place + 1]
    seen = np.empty(total + 1, np.int64)
    wedges = np.empty((2, 2, columns + 2))
    length = np.full(rows * columns, np.inf)
    parent = np.full(rows * columns, -2, np.int64)
    best, last = ceiling, -2
    settled = 0
    heap = [(math.sqrt((goal[0] - start[0]) ** 2 + (goal[1] - start[1]) ** 2), -1)]
    while len(heap) > 0:
        bound, here = heap[0]
        if bound >= best:
            break
        if flag[0] != 0:
            return STOPPED, bound, np.empty(0, np.int64), settled
        heappop(heap)
        if here < 0:
            x, y, gone = float(start[0]), float(start[1]), 0.0
            count = _sweep(runs, corners, onward, x, y, 1, -np.inf, np.inf, goal, wedges, seen, 0)
            count = _sweep(
                runs, corners, onward, x, y, -1, -np.inf, np.inf, goal, wedges, seen, count
            )
        else:
            x, y, gone = float(here % columns), float(here // columns), length[here]
            if gone < 0.0:  # settled
                continue
            length[here] = -1.0 - gone
            before = parent[here]
            bx, by = start[0], start[1]
            if before >= 0:
                bx, by = float(before % columns), float(before // columns)
            count = _visible(
                blocked, runs, corners, onward, int(x), int(y), x - bx, y - by, goal, wedges, seen
            )
        settled += 1
        if count < 0:
            count = -1 - count
            whole = gone + math.sqrt((goal[0] - x) ** 2 + (goal[1] - y) ** 2)
            if whole < best:
                best, last = whole, here
        for k in range(count):
            there = seen[k]
            tx, ty = float(there % columns), float(there // columns)
            so_far = gone + math.sqrt((tx - x) ** 2 + (ty - y) ** 2)
            if so_far < length[there]:
                bound = so_far + math.sqrt((goal[0] - tx) ** 2 + (goal[1] - ty) ** 2)
                if bound < best:
                    length[there], parent[there] = so_far, here
                    heappush(heap, (bound, there))
    if last == -2:
        return ABSENT, best, np.empty(0, np.int64), settled
    path = np.empty(settled, np.int64)
    size = 0
    while last >= 0:
        path[size] = last
        size += 1
        last = parent[last]
    return FOUND, best, path[:size], settled


class AnyAngle(AnyDirection):
    """A* over the convex corners of blocked cells, generated by lines of sight during the search.

    Every shortest path turns only around such corners, so the search is exact.
    """

    name = "any-angle"
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    summary = "shortest paths in any direction, by A* over corners in sight; ours"

    def starter(self, problem: Any) -> str:
        """Return the name of the backend for a first path on large maps, or an empty string."""
        return "shortcut-greedy" if problem.map.blocked.size > LARGE else ""

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search, and trace the path back from the goal."""
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
