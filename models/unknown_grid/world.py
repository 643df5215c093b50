"""The simulator: it moves the vehicles on the true maps, and says what the UAV sees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from .camera import PIXELS
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

#: What a cell of a map or of a view holds.
UNKNOWN, FREE, BLOCKED, TARGET = -1, 0, 1, 2
#: How a run stands.
GOING, REACHED, OUT_OF_STEPS = 0, 1, 2
#: Columns of an answer before the view.
_HEAD = 6
#: The question that only looks.
LOOK = -1


class Looks(NamedTuple):
    """What is known after the latest step of some scenes.

    Parameters
    ----------
    scenes : ndarray of int, shape (n,)
        Their numbers.
    positions : ndarray of int, shape (n, 2)
        Row and column of the vehicle.
    corners : ndarray of int, shape (n, 2)
        Row and column of the view's first cell, which may lie off the map.
    states : ndarray of int, shape (n,)
        :data:`GOING`, :data:`REACHED` or :data:`OUT_OF_STEPS`.
    collisions : ndarray of int, shape (n,)
        Steps into obstacles or off the map so far.
    view : ndarray, shape (n, m, n') or (n, 256, 256, 3)
        The cells of the view (:data:`FREE`, :data:`BLOCKED`, which is also what lies off the map, or
        :data:`TARGET`); with a camera its image, red, green and blue from 0 to 1.
    """

    scenes: Ints
    positions: Ints
    corners: Ints
    states: Ints
    collisions: Ints
    view: Floats

    @classmethod
    def read(cls, problem: Scenes, scenes: Ints, answers: Floats) -> Looks:
        """Return what the answers of a :class:`World` say."""
        head = answers[:, :_HEAD].astype(np.int64)
        size = tuple(problem.view.tolist()) if problem.camera is None else (PIXELS, PIXELS, 3)
        view = answers[:, _HEAD:].reshape(len(answers), *size)
        return cls(scenes, head[:, :2], head[:, 2:4], head[:, 4], head[:, 5], view)


class World:
    """The true maps and where the vehicles are on them; made anew for each run.

    A question is a row ``(scene, action)`` with the actions 0 … 3 for up, down, left and right, and -1,
    which only looks. An answer is a row: row and column of the vehicle, row and column of the view's
    first cell, state, collisions, and the view (see :class:`Looks`). Nothing else is ever said.

    Parameters
    ----------
    problem : Scenes
        With its true maps.
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
        """Return the answers to questions, shape (n, 2), in their order."""
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
            self._say(int(scene), answers[row])
        return answers

    def state(self, scene: int) -> int:
        """Return how the run of a scene stands."""
        if (self.positions[scene] == self.problem.targets[scene]).all():
            return REACHED
        return OUT_OF_STEPS if self.taken[scene] >= self.problem.steps else GOING

    def contradiction(self, plan: NavigationRuns) -> str:
        """Return where the actions of `plan` are not those that were taken here, nothing where they are."""
        for scene, (said, done) in enumerate(zip(plan.actions, self._actions, strict=True)):
            if said != "".join(done):
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
        to = self.positions[scene] + STEPS[int(action)]
        inside = (to >= 0).all() and (to < self.problem.shape).all()
        if not inside or self.problem.blocked[scene, to[0], to[1]]:
            self.collisions[scene] += 1
            return
        self.positions[scene] = to
        self._see(scene)

    def _see(self, scene: int) -> None:
        """Move the UAV, which stays once it has seen the target where the rule says so."""
        if self._hovers[scene]:
            return
        self._centres[scene] = self.positions[scene]
        away = np.abs(self.problem.targets[scene] - self._centres[scene])
        self._hovers[scene] = self.problem.uav is Hover.PAPER and (away <= self._half).all()

    def _say(self, scene: int, answer: Floats) -> None:
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
        """Return the cells of a view whose first cell is `corner`."""
        found = np.full(tuple(self.problem.view), float(BLOCKED))
        low = np.maximum(corner, 0)
        high = np.minimum(corner + self.problem.view, self.problem.shape)
        rows, columns = slice(low[0], high[0]), slice(low[1], high[1])
        at = low - corner, high - corner
        found[at[0][0] : at[1][0], at[0][1] : at[1][1]] = self.problem.blocked[scene, rows, columns]
        row, column = self.problem.targets[scene] - corner
        if 0 <= row < len(found) and 0 <= column < found.shape[1]:
            found[row, column] = TARGET
        return found
