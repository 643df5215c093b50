"""Rest of a search for a flight, from a state in the air."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.trajectory import Trajectory
from ..minimum_snap.minco import Search, coefficients_of
from ..minimum_snap.minco_limits import Task

__all__ = ["SHORTEST", "curve_of", "tail_of"]

Floats = NDArray[np.float64]

#: Least duration of the first segment, relative to the mean.
SHORTEST = 0.05


def curve_of(search: Any) -> Trajectory:
    """Return the curve of a search, which begins at time 0."""
    times = np.concatenate([[0.0], np.cumsum(search.durations)])
    return Trajectory(times, coefficients_of(search, search.jets()[0]))


def tail_of(search: Any, k: int, share: float, state: Floats) -> Any:
    """Return the search for the segments from number k, whose first knot has a given state."""
    task: Task = search.task
    segments = len(task.nodes)
    durations = search.durations[k:]
    left = (1.0 - share) * float(durations[0])
    if left < SHORTEST * float(durations.mean()):
        rows = slice(int(task.start[k + 1]), int(task.start[min(k + 2, segments)]))
        passes = k + 1 < segments and task.first[k + 2] > task.first[k + 1]  # no waypoint
        if passes and (task.normal[rows] @ state[0] <= task.offset[rows]).all():
            k, left = k + 1, left + float(durations[1])  # the rest is part of the next segment
        else:
            left = SHORTEST * float(durations.mean())
    first, row = int(task.first[k + 1]), int(task.start[k])
    jets, free = task.jets[k:].copy(), task.free[k:].copy()
    jets[0, :3], free[0] = state[: jets.shape[1]], False
    if jets.shape[1] > 3:
        jets[0, 3:] = 0.0
        free[0, 3:] = True
    kind, centre = task.kind[k:].copy(), task.centre[k:].copy()
    kind[0], centre[0] = 0, state[0]
    rest = task._replace(
        nodes=task.nodes[: segments - k], place=task.place[: segments - k + 1], jets=jets, free=free,
        kind=kind, first=np.append(0, task.first[k + 1 :] - first), centre=centre,
        reach=task.reach[first:], start=task.start[k:] - row, order=task.order[row:],
        normal=task.normal[row:], offset=task.offset[row:], size=task.size[row:],
    )  # fmt: skip
    x = np.concatenate([search.x[k:segments], search.x[segments + first :]])
    x[0] = np.log(left)
    result = Search(rest, x, search.flag)
    result.vehicle, result.rows = search.vehicle[k:].copy(), search.rows[row:].copy()
    result.margins = search.margins[0][k:].copy(), search.margins[1][row:].copy()
    return result
