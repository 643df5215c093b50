"""The paper's three tasks: sizes of maps and views, and the numbers of obstacles."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["OBSTACLES", "STEPS", "TASKS", "Task"]

#: Obstacles of a scene, one column of Table VI each.
OBSTACLES = (2, 3, 4, 5)
#: Actions after which a run has failed.
STEPS = 40


class Task(NamedTuple):
    """A task of Table V.

    Parameters
    ----------
    side, view : int
        Rows and columns of the map (global scale), and of the UAV's view (observation range).
    """

    side: int
    view: int

    @property
    def ratio(self) -> float:
        """The observation ratio: view by map."""
        return self.view / self.side


#: The tasks by number.
TASKS = {1: Task(17, 11), 2: Task(17, 9), 3: Task(15, 9)}
