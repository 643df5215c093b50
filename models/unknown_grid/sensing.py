"""Sensor model of the view: moving obstacles, occlusion and wrong readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .scenes import Scenes

__all__ = ["BLOCKED", "FREE", "TARGET", "UNKNOWN", "in_sight", "sense"]

Cells = NDArray[np.int8]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Values of cells of a map or a view.
UNKNOWN, FREE, BLOCKED, TARGET = -1, 0, 1, 2
#: Constants of SplitMix64 (G. Steele, D. Lea, C. Flood, OOPSLA 2014).
_STEP, _MIX = 0x9E3779B97F4A7C15, ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))


@kernel(interpretable=True)
def in_sight(blocked: Truths, seen: Truths) -> None:
    """Compute which cells of views, shape (n, rows, columns), are in line of sight of the middle cell.

    The segment between the centres of both cells must not pass through a blocked cell or between two blocked
    cells that touch at a corner; the last cell may be blocked. It may touch the corner of one blocked cell.
    """
    count, rows, columns = blocked.shape
    for k in range(count):
        for row in range(rows):
            for column in range(columns):
                r, c = rows // 2, columns // 2
                high, wide = abs(row - r), abs(column - c)
                down, across = 1 if row > r else -1, 1 if column > c else -1
                i, j, clear = 0, 0, True
                while clear and i + j < high + wide:
                    # The segment crosses the next border of a row or that of a column first, or a corner.
                    ahead = (2 * i + 1) * wide - (2 * j + 1) * high
                    if ahead == 0:
                        clear = not (blocked[k, r + down, c] and blocked[k, r, c + across])
                    if ahead <= 0:
                        i, r = i + 1, r + down
                    if ahead >= 0:
                        j, c = j + 1, c + across
                    if blocked[k, r, c] and i + j < high + wide:
                        clear = False
                seen[k, row, column] = clear


def sense(
    model: Scenes, others: Ints, scenes: Ints, taken: Ints, vehicles: Ints, corners: Ints,
    views: Cells, exact: bool = False,
) -> Cells:  # fmt: skip
    """Return the readings of the sensor in the views of n scenes, shape (n, rows, columns).

    `others`, shape (n, moving, 2), are the cells of the moving obstacles, `taken` the numbers of steps so far,
    `vehicles` their cells, `corners` the first cells of the views, and `views` the true cells. If `exact`, no reading is wrong.

    A moving obstacle appears blocked and hides the target. Occluded cells of the map are ``UNKNOWN``. The cell of
    the vehicle is never wrong, nor is ``TARGET``. The random number of a reading depends on seed, scene, number of
    steps and cell, so a repeated run yields equal readings.
    """
    views = views.copy()
    rows, columns = (corners[:, axis, None] + np.arange(views.shape[axis + 1]) for axis in (0, 1))
    inside = ((rows >= 0) & (rows < model.shape[0]))[:, :, None]
    inside = inside & ((columns >= 0) & (columns < model.shape[1]))[:, None]
    own = (rows == vehicles[:, :1])[:, :, None] & (columns == vehicles[:, 1:])[:, None]
    if model.moving:
        places = others - corners[:, None]
        shown = ((places >= 0) & (places < views.shape[1:])).all(axis=-1)
        views[np.nonzero(shown)[0], *places[shown].T] = BLOCKED
        views[own & (views == BLOCKED)] = FREE
    if model.occlusion:
        seen = np.empty(views.shape, bool)
        in_sight(views == BLOCKED, seen)
        views[inside & ~seen & ~own] = UNKNOWN
    if max(model.false_obstacles, model.missed_obstacles) > 0 and not exact:
        state = np.full((len(scenes), 1, 1), model.world_seed, np.uint64)
        numbers = (scenes[:, None, None], taken[:, None, None], rows[:, :, None], columns[:, None])
        for number in numbers:
            state = state * np.uint64(_STEP) + number.astype(np.uint64) + np.uint64(_STEP)
            for shift, factor in _MIX:
                state = (state ^ (state >> np.uint64(shift))) * np.uint64(factor)
        uniform = (state >> np.uint64(11)) * 2.0**-53
        flips = inside & ~own
        free, blocked = views == FREE, views == BLOCKED
        views[flips & free & (uniform < model.false_obstacles)] = BLOCKED
        views[flips & blocked & (uniform < model.missed_obstacles)] = FREE
    return views
