"""What the paper prints of its three tasks: sizes, and successes of 100 scenes."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["OBSTACLES", "STEPS", "TASKS", "Task"]

#: Obstacles in a scene, a column of table VI each.
OBSTACLES = (2, 3, 4, 5)
#: Actions after which a run has failed.
STEPS = 40


class Task(NamedTuple):
    """A task of the paper, and its rows of table VI.

    Parameters
    ----------
    side, view : int
        Rows and columns of the map, and of what the UAV sees.
    mcgn, macn : tuple of int
        Successes of 100 scenes with 2, 3, 4 and 5 obstacles.
    """

    side: int
    view: int
    mcgn: tuple[int, ...]
    macn: tuple[int, ...]


#: The tasks by number.
TASKS = {
    1: Task(17, 11, (93, 85, 84, 85), (84, 70, 70, 72)),
    2: Task(17, 9, (88, 83, 79, 77), (79, 65, 64, 60)),
    3: Task(15, 9, (90, 82, 82, 79), (82, 68, 65, 64)),
}
