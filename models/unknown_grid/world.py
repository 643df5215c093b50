"""Simulator that moves the vehicles on the true maps and returns the view of the UAV."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import OutOfTime
from ..fields import show
from .camera import PIXELS
from .moving import meets, obstacle_tracks
from .plan import LETTERS, MOVES, NavigationRuns
from .scenes import Corners, Hover, Scenes, actions_of, aspects_of
from .sensing import BLOCKED, FREE, TARGET, UNKNOWN, sense

__all__ = [
    "BLOCKED", "FREE", "GOING", "LOOK", "OUT_OF_STEPS", "REACHED", "TARGET", "UNKNOWN", "Looks",
    "World",
]  # fmt: skip

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: States of a run.
GOING, REACHED, OUT_OF_STEPS = 0, 1, 2
#: Number of columns before the view in an answer.
_HEAD = 6
#: Action that requests an observation without a step.
LOOK = -1
_MOVES = np.array(MOVES)


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
        positions, corners = head[:, :2].copy(), head[:, 2:4].copy()
        size = tuple(problem.view.tolist()) if problem.camera is None else (PIXELS, PIXELS, 3)
        view = answers[:, _HEAD:].reshape(len(answers), *size)
        return cls(scenes, positions, corners, head[:, 4], head[:, 5], view)


class World:
    """Simulator of all scenes on their true maps. Every solve uses a new instance.

    A question is a row ``(scene, action)`` with the actions 0 … 3 for up, down, left and right, or -1
    for an observation without a step. An answer is a row: row and column of the vehicle, row and column
    of the view's first cell, state, collisions, and the view (see :class:`Looks`).

    Parameters
    ----------
    problem : UnknownGridNavigation
        Model with its true maps.
    scenes : ndarray of int, optional
        Scene of each run, by default one run per scene. Questions then have the number of a run as their scene.
    """

    def __init__(self, problem: Scenes, scenes: Ints | None = None) -> None:
        self.problem = problem
        total, (rows, columns) = len(problem.starts), problem.shape.tolist()
        #: Scene of each run. An entry may change before a restart of its run.
        self.scenes = np.arange(total) if scenes is None else scenes
        count = len(self.scenes)
        #: States of the runs: ``GOING``, ``REACHED`` or ``OUT_OF_STEPS``.
        self.states: Ints = np.empty(count, np.int64)
        self.positions: Ints = np.empty((count, 2), np.int64)
        self.taken: Ints = np.empty(count, np.int64)
        self.collisions: Ints = np.empty(count, np.int64)
        #: Cells below the UAV.
        self._centres = self.positions if problem.uav is Hover.FOLLOW else self.positions.copy()
        self._hovers = np.empty(count, bool)
        #: Actions per scene; only the first `taken` columns are used.
        self._actions = np.empty((count, 64), np.int8)
        # One frame of blocked cells represents all cells outside the map.
        self._cells = np.full((total, rows + 2, columns + 2), BLOCKED, np.int8)
        self._cells[:, 1:-1, 1:-1][~problem.blocked] = FREE
        self._cells[np.arange(total), *(problem.targets + 1).T] = TARGET
        self._columns = int(problem.view.prod()) if problem.camera is None else 3 * PIXELS**2
        self._aspects = aspects_of(problem)
        self._allowed = [LETTERS.index(letter) for letter in actions_of(problem)]
        self._limits = (np.array([0, LOOK]), np.array([count, self._allowed[-1] + 1]))
        self._tracks = obstacle_tracks(problem)
        #: Number of blocked cells that a diagonal step may pass.
        self._sides = list(Corners).index(problem.corners)
        self._half, self._last = problem.view // 2, problem.shape + 1
        self._offsets = [np.arange(side) - side // 2 + 1 for side in problem.view.tolist()]
        self.restart(np.arange(count))

    def restart(self, scenes: Ints) -> None:
        """Begin the runs `scenes`, which are distinct, again."""
        self.states[scenes], self.taken[scenes], self.collisions[scenes] = GOING, 0, 0
        self.positions[scenes] = self.problem.starts[self.scenes[scenes]]
        self._hovers[scenes] = False
        self._move_uav(scenes)

    def __call__(self, questions: Floats) -> Floats:
        """Return the answers to questions, shape (n, 2), in the same order.

        A scene may occur several times. Its steps are then executed one after another.

        Raises
        ------
        InvalidData
            The shape, a scene or an action is invalid, or the run of the scene has ended.
        OutOfTime
            The time limit of the run is reached. The steps without an answer are not executed.
        """
        scenes, actions = self._read(questions).T
        if len(scenes) > 1 and (scenes[1:] <= scenes[:-1]).any():
            return np.concatenate([self(row[None]) for row in questions])
        acts = actions != LOOK
        parts = (
            self.states,
            self.positions,
            self.taken,
            self.collisions,
            self._centres,
            self._hovers,
        )
        former = [part[scenes] for part in parts]
        try:
            if acts.any():
                self._act(scenes[acts], actions[acts])
            return self._answer(scenes)
        except OutOfTime:
            for part, values in zip(parts, former, strict=True):
                part[scenes] = values
            raise

    def state(self, scene: int) -> int:
        """Return the state of a scene's run: ``GOING``, ``REACHED`` or ``OUT_OF_STEPS``."""
        return int(self.states[scene])

    def contradiction(self, plan: NavigationRuns) -> str:
        """Return the first difference between `plan` and the simulated actions, or an empty string."""
        runs = zip(plan.actions, self._actions, self.taken.tolist(), strict=True)
        for scene, (claim, actions, taken) in enumerate(runs):
            if claim != "".join(LETTERS[action] for action in actions[:taken].tolist()):
                return f"the actions of scene {scene} are not those that the run took"
        return ""

    def _read(self, questions: Floats) -> Ints:
        """Return the scenes and actions of valid `questions`, shape (n, 2)."""
        if questions.ndim != 2 or questions.shape[1] != 2:
            raise InvalidData(
                f"questions must have shape (n, 2), got {questions.shape}", field="actions"
            )
        low, high = self._limits
        # Comparisons with NaN are false.
        valid = (questions >= low) & (questions < high) & (questions == np.floor(questions))
        if len(self._allowed) < high[1]:
            valid[:, 1] &= np.isin(questions[:, 1], [LOOK, *self._allowed])
        if not valid.all():
            row, column = np.argwhere(~valid)[0]
            what = (
                f"scene must be 0 … {high[0] - 1}",
                f"an action must be {_named(self._allowed)} or -1 (look)",
            )[column]
            value = show(questions[row, column].item())
            raise InvalidData(f"{what}, got {value}", field="actions")
        return questions.astype(np.int64)

    def _act(self, scenes: Ints, actions: Ints) -> None:
        """Execute one action in each of several different scenes."""
        ended = self.states[scenes] != GOING
        if ended.any():
            raise InvalidData(f"the run of scene {scenes[ended][0]} has ended", field="actions")
        taken = self.taken[scenes]
        if taken.max() == self._actions.shape[1]:
            self._actions = np.tile(self._actions, 2)
        self._actions[scenes, taken] = actions
        self.taken[scenes] = taken = taken + 1
        here = self.positions[scenes]
        cells = here + _MOVES[actions]
        values = self._values(scenes, cells)
        hits = values == BLOCKED
        if self._aspects:
            self._meet(scenes, cells, hits)
        self.collisions[scenes] += hits
        self.positions[scenes] = np.where(hits[:, None], here, cells)
        self._move_uav(scenes)
        self.states[scenes[taken >= self.problem.steps]] = OUT_OF_STEPS
        self.states[scenes[(values == TARGET) & ~hits]] = REACHED

    def _values(self, scenes: Ints, cells: Ints) -> NDArray[np.int8]:
        """Return the true values of cells, possibly one outside the map."""
        return np.asarray(self._cells[self.scenes[scenes], cells[:, 0] + 1, cells[:, 1] + 1])

    def _meet(self, scenes: Ints, cells: Ints, hits: NDArray[np.bool_]) -> None:
        """Mark steps that violate the rule of corners or meet moving obstacles, before the steps are executed."""
        here = self.positions[scenes]
        across = np.column_stack([here[:, 0], cells[:, 1]])
        down = np.column_stack([cells[:, 0], here[:, 1]])
        sides = sum((self._values(scenes, beside) == BLOCKED) + 0 for beside in (across, down))
        hits |= (here != cells).all(axis=1) & (sides > self._sides)
        times = self.taken[scenes]
        which = self.scenes[scenes]
        before, after = self._tracks[which, :, times - 1], self._tracks[which, :, times]
        hits |= meets(before, after, here, cells)

    def _move_uav(self, scenes: Ints) -> None:
        """Move the UAV above the vehicle, unless it hovers under the rule ``PAPER``."""
        if self.problem.uav is Hover.FOLLOW:
            return  # the centres are the positions
        scenes = scenes[~self._hovers[scenes]]
        self._centres[scenes] = positions = self.positions[scenes]
        if self._aspects:
            self._hovers[scenes] = (self.cells(scenes, positions) == TARGET).any(axis=(1, 2))
        else:
            away = np.abs(self.problem.targets[self.scenes[scenes]] - positions)
            self._hovers[scenes] = (away <= self._half).all(axis=1)

    def _answer(self, scenes: Ints) -> Floats:
        """Return the answers of several scenes, one row per scene."""
        problem, centres = self.problem, self._centres[scenes]
        corners = centres - self._half
        answers = np.empty((len(scenes), _HEAD + self._columns))
        answers[:, :2], answers[:, 2:4] = self.positions[scenes], corners
        answers[:, 4], answers[:, 5] = self.states[scenes], self.collisions[scenes]
        if problem.camera is None:
            answers[:, _HEAD:] = self.cells(scenes, centres).reshape(len(scenes), self._columns)
            return answers
        from .rendering import render

        for row, scene in enumerate(self.scenes[scenes].tolist()):
            seed = (problem.camera.seed, scene, int(self.taken[scenes[row]]))
            answers[row, _HEAD:] = render(
                problem.blocked[scene], problem.targets[scene], corners[row], problem.view,
                problem.camera.rendering, seed,
            ).ravel()  # fmt: skip
        return answers

    def cells(self, scenes: Ints, centres: Ints) -> NDArray[np.int8]:
        """Return the cells of the views around `centres`, shape (n, 2), one view per scene."""
        rows, columns = (
            np.minimum(
                np.maximum(centres[:, axis, None] + self._offsets[axis], 0), self._last[axis]
            )
            for axis in (0, 1)
        )
        which = self.scenes[scenes]
        views = self._cells[which[:, None, None], rows[:, :, None], columns[:, None, :]]
        if not self._aspects:
            return np.asarray(views)
        taken = self.taken[scenes]
        return sense(
            self.problem, self._tracks[which, :, taken], which, taken, self.positions[scenes],
            centres - self._half, views,
        )  # fmt: skip


def _named(actions: list[int]) -> str:
    """Return the allowed actions as text."""
    names = (
        "up", "down", "left", "right", "up left", "up right", "down left", "down right", "wait",
    )  # fmt: skip
    return ", ".join(f"{action} ({names[action]})" for action in actions)
