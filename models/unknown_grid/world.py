"""Simulator that moves the vehicles on the true maps and returns the view of the UAV."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from .camera import PIXELS, crop
from .plan import ACTIONS, STEPS, NavigationRuns
from .scenes import Hover, Scenes

__all__ = [
    "BLOCKED",
    "FREE",
    "GOING",
    "LOOK",
    "OUT_OF_STEPS",
    "REACHED",
    "TARGET",
    "UNKNOWN",
    "Looks",
    "World",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Values of cells of a map or a view.
UNKNOWN, FREE, BLOCKED, TARGET = -1, 0, 1, 2
#: States of a run.
GOING, REACHED, OUT_OF_STEPS = 0, 1, 2
#: Number of columns before the view in an answer.
_HEAD = 6
#: Action that requests an observation without a step.
LOOK = -1


class Looks(NamedTuple):
    """Observations of n scenes after their latest steps.

    Parameters
    ----------
    scenes : ndarray of int, shape (n,)
        Indices of the scenes.
    positions : ndarray of int, shape (n, 2)
        Row and column of the vehicle.
    corners : ndarray of int, shape (n, 2)
        Row and column of the view's first cell, possibly outside the map.
    states : ndarray of int, shape (n,)
        ``GOING``, ``REACHED`` or ``OUT_OF_STEPS``.
    collisions : ndarray of int, shape (n,)
        Number of steps into obstacles or off the map so far.
    view : ndarray, shape (n, m, n') or (n, 256, 256, 3)
        Cells of the view: ``FREE``, ``BLOCKED`` (also outside the map) or ``TARGET``. If
        the model has a camera, its image with red, green and blue from 0 to 1.
    """

    scenes: Ints
    positions: Ints
    corners: Ints
    states: Ints
    collisions: Ints
    view: Floats

    @classmethod
    def read(cls, problem: Scenes, scenes: Ints, answers: Floats) -> Looks:
        """Return the observations in the answers of a :class:`World`."""
        head = answers[:, :_HEAD].astype(np.int64)
        size = tuple(problem.view.tolist()) if problem.camera is None else (PIXELS, PIXELS, 3)
        view = answers[:, _HEAD:].reshape(len(answers), *size)
        return cls(scenes, head[:, :2], head[:, 2:4], head[:, 4], head[:, 5], view)


class World:
    """Simulator of all scenes on their true maps. Every solve uses a new instance.

    A question is a row ``(scene, action)`` with the actions 0 … 3 for up, down, left and right, or -1
    for an observation without a step. An answer is a row: row and column of the vehicle, row and column
    of the view's first cell, state, collisions, and the view (see :class:`Looks`).

    Parameters
    ----------
    problem : Scenes
        Model with its true maps.
    """

    def __init__(self, problem: Scenes) -> None:
        self.problem = problem
        self._half = problem.view // 2
        self.positions: Ints = problem.starts.copy()
        count = len(problem.starts)
        self._centres: Ints = problem.starts.copy()
        away = np.abs(problem.targets - problem.starts)
        self._hovers = (problem.uav is Hover.PAPER) & np.asarray((away <= self._half).all(axis=1))
        self.taken = np.zeros(count, np.int64)
        self._actions: list[list[str]] = [[] for _ in range(count)]
        self.collisions = np.zeros(count, np.int64)
        self._columns = int(problem.view.prod()) if problem.camera is None else 3 * PIXELS**2

    def __call__(self, questions: Floats) -> Floats:
        """Return the answers to questions, shape (n, 2), in the same order.

        Raises
        ------
        InvalidData
            The shape, a scene or an action is invalid, or the run of the scene has ended.
        """
        if questions.ndim != 2 or questions.shape[1] != 2:
            raise InvalidData(
                f"questions must have shape (n, 2), got {questions.shape}", field="actions"
            )
        answers = np.empty((len(questions), _HEAD + self._columns))
        for row, (scene, action) in enumerate(questions.tolist()):
            if scene not in range(len(self.positions)):
                raise InvalidData(
                    f"scene must be 0 … {len(self.positions) - 1}, got {show(scene)}",
                    field="actions",
                )
            self._act(int(scene), action)
            self._write_answer(int(scene), answers[row])
        return answers

    def state(self, scene: int) -> int:
        """Return the state of a scene's run: ``GOING``, ``REACHED`` or ``OUT_OF_STEPS``."""
        if (self.positions[scene] == self.problem.targets[scene]).all():
            return REACHED
        return OUT_OF_STEPS if self.taken[scene] >= self.problem.steps else GOING

    def contradiction(self, plan: NavigationRuns) -> str:
        """Return the first difference between `plan` and the simulated actions, or an empty string."""
        for scene, (claim, letters) in enumerate(zip(plan.actions, self._actions, strict=True)):
            if claim != "".join(letters):
                return f"the actions of scene {scene} are not those that the run took"
        return ""

    def _act(self, scene: int, action: float) -> None:
        if action == LOOK:
            return
        if action not in range(4):
            raise InvalidData(
                f"an action must be 0 (up), 1 (down), 2 (left), 3 (right) or -1 (look), got "
                f"{show(action)}",
                field="actions",
            )
        if self.state(scene) != GOING:
            raise InvalidData(f"the run of scene {scene} has ended", field="actions")
        self.taken[scene] += 1
        self._actions[scene].append(ACTIONS[int(action)])
        cell = self.positions[scene] + STEPS[int(action)]
        inside = (cell >= 0).all() and (cell < self.problem.shape).all()
        if not inside or self.problem.blocked[scene, cell[0], cell[1]]:
            self.collisions[scene] += 1
            return
        self.positions[scene] = cell
        self._move_uav(scene)

    def _move_uav(self, scene: int) -> None:
        """Move the UAV above the vehicle, unless it hovers under the rule ``PAPER``."""
        if self._hovers[scene]:
            return
        self._centres[scene] = self.positions[scene]
        away = np.abs(self.problem.targets[scene] - self._centres[scene])
        self._hovers[scene] = self.problem.uav is Hover.PAPER and (away <= self._half).all()

    def _write_answer(self, scene: int, answer: Floats) -> None:
        problem = self.problem
        corner = self._centres[scene] - self._half
        answer[:2], answer[2:4] = self.positions[scene], corner
        answer[4], answer[5] = self.state(scene), self.collisions[scene]
        if problem.camera is None:
            answer[_HEAD:] = self.cells(scene, corner).ravel()
            return
        from .rendering import render

        seed = (problem.camera.seed, scene, int(self.taken[scene]))
        answer[_HEAD:] = render(
            problem.blocked[scene], problem.targets[scene], corner, problem.view,
            problem.camera.rendering, seed,
        ).ravel()  # fmt: skip

    def cells(self, scene: int, corner: Ints) -> Floats:
        """Return the cells of the view whose first cell is `corner`, shape of the view."""
        blocked = crop(self.problem.blocked[scene], corner, self.problem.view)
        window = np.where(blocked, float(BLOCKED), float(FREE))
        row, column = self.problem.targets[scene] - corner
        if 0 <= row < len(window) and 0 <= column < window.shape[1]:
            window[row, column] = TARGET
        return window
