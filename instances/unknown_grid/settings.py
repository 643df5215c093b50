"""Tasks of the paper: sizes of maps and views, and numbers of obstacles."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["OBSTACLES", "STEPS", "TASKS", "Task"]

#: Numbers of obstacles per scene, one per column of Table VI.
OBSTACLES = (2, 3, 4, 5)
#: Maximum number of actions per run.
STEPS = 40


class Task(NamedTuple):
    """Task of Table V: side of the map (global scale) and of the UAV's view (observation range), cells."""

    side: int
    view: int

    @property
    def ratio(self) -> float:
        """Observation ratio: side of the view divided by side of the map."""
        return self.view / self.side


#: Tasks by number.
TASKS = {1: Task(17, 11), 2: Task(17, 9), 3: Task(15, 9)}
