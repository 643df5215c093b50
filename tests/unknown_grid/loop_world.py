"""Simulator with a loop over the scenes, the reference of the simulator on arrays."""

import numpy as np

from crosstrack.errors import InvalidData
from crosstrack.models.fields import show
from crosstrack.models.unknown_grid.camera import PIXELS, crop
from crosstrack.models.unknown_grid.plan import ACTIONS, STEPS
from crosstrack.models.unknown_grid.scenes import Hover
from crosstrack.models.unknown_grid.world import (
    BLOCKED,
    FREE,
    GOING,
    LOOK,
    OUT_OF_STEPS,
    REACHED,
    TARGET,
)

_HEAD = 6


class LoopWorld:
    """Simulator of all scenes on their true maps. Every solve uses a new instance.

    A question is a row ``(scene, action)`` with the actions 0 … 3 for up, down, left and right, or -1
    for an observation without a step. An answer is a row: row and column of the vehicle, row and column
    of the view's first cell, state, collisions, and the view (see :class:`Looks`).

    Parameters
    ----------
    problem
        Model with its true maps.
    """

    def __init__(self, problem):
        self.problem = problem
        self._half = problem.view // 2
        self.positions = problem.starts.copy()
        count = len(problem.starts)
        self._centres = problem.starts.copy()
        away = np.abs(problem.targets - problem.starts)
        self._hovers = (problem.uav is Hover.PAPER) & np.asarray((away <= self._half).all(axis=1))
        self.taken = np.zeros(count, np.int64)
        self._actions = [[] for _ in range(count)]
        self.collisions = np.zeros(count, np.int64)
        self._columns = int(problem.view.prod()) if problem.camera is None else 3 * PIXELS**2

    def __call__(self, questions):
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

    def state(self, scene):
        """Return the state of a scene's run: ``GOING``, ``REACHED`` or ``OUT_OF_STEPS``."""
        if (self.positions[scene] == self.problem.targets[scene]).all():
            return REACHED
        return OUT_OF_STEPS if self.taken[scene] >= self.problem.steps else GOING

    def contradiction(self, plan):
        """Return the first difference between `plan` and the simulated actions, or an empty string."""
        for scene, (claim, letters) in enumerate(zip(plan.actions, self._actions, strict=True)):
            if claim != "".join(letters):
                return f"the actions of scene {scene} are not those that the run took"
        return ""

    def _act(self, scene, action):
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

    def _move_uav(self, scene):
        """Move the UAV above the vehicle, unless it hovers under the rule ``PAPER``."""
        if self._hovers[scene]:
            return
        self._centres[scene] = self.positions[scene]
        away = np.abs(self.problem.targets[scene] - self._centres[scene])
        self._hovers[scene] = self.problem.uav is Hover.PAPER and (away <= self._half).all()

    def _write_answer(self, scene, answer):
        problem = self.problem
        corner = self._centres[scene] - self._half
        answer[:2], answer[2:4] = self.positions[scene], corner
        answer[4], answer[5] = self.state(scene), self.collisions[scene]
        if problem.camera is None:
            answer[_HEAD:] = self.cells(scene, corner).ravel()
            return
        from crosstrack.models.unknown_grid.rendering import render

        seed = (problem.camera.seed, scene, int(self.taken[scene]))
        answer[_HEAD:] = render(
            problem.blocked[scene], problem.targets[scene], corner, problem.view,
            problem.camera.rendering, seed,
        ).ravel()  # fmt: skip

    def cells(self, scene, corner):
        """Return the cells of the view whose first cell is `corner`, shape of the view."""
        blocked = crop(self.problem.blocked[scene], corner, self.problem.view)
        window = np.where(blocked, float(BLOCKED), float(FREE))
        row, column = self.problem.targets[scene] - corner
        if 0 <= row < len(window) and 0 <= column < window.shape[1]:
            window[row, column] = TARGET
        return window
