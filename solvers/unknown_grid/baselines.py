"""The paper's traditional baselines: repeated moves to the visible cell nearest the target.

Table III (Traditional Baseline 1) executes whole sequences of actions, Table IV (Traditional Baseline 2) one action at
a time. The distance is Euclidean. Ties go to the lower row, then to the lower column. A* plans within the current view.
The paper leaves open whether ``SearchMinDis2Target`` considers only reachable cells. ``baseline-1`` and ``baseline-2``
choose among all free cells of the view and give up if A* finds no path. The other two choose among the reachable
cells. All give up on the nearest cell itself, because the next decision would be the same.

As printed, Table IV continues from the chosen cell although only one action was executed, and ends when the target
enters the view, so it never reaches a target. By default, ``baseline-2`` continues from the cell of the vehicle and has
the last stage of Table III. Its option ``literal`` runs Table IV as printed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.moving import FAR, Grid, descend, spread
from ...models.unknown_grid.world import BLOCKED, Looks
from ..contract.backend import Request
from ..contract.option import Option
from .native import GIVE_UP, MOST_TOGETHER, NavigationBackend, Policy

__all__ = ["BaselineOne", "BaselineOneReachable", "BaselineTwo", "BaselineTwoReachable"]

Bytes = NDArray[np.int8]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]


class _Nearest:
    """Baseline policy in several scenes.

    If `patient`, it executes the whole sequence of actions before the next decision. If `reachable`, it
    chooses only among cells that are reachable within the view. If `literal`, it plans from the latest
    chosen cell and gives up once the target is in the view (Table IV).
    """

    def __init__(
        self,
        problem: UnknownGridNavigation,
        scenes: Ints,
        request: Request,
        patient: bool,
        reachable: bool,
        literal: bool,
    ) -> None:
        self._first = int(scenes[0])
        self._targets = problem.targets[scenes]
        self._rules = (patient, reachable, literal)
        #: Latest chosen cells, sequences of actions, and their numbers of executed and of all actions.
        self._chosen = problem.starts[scenes]
        self._sequences = np.empty((len(scenes), int(problem.view.prod())), np.int8)
        self._done = np.zeros((len(scenes), 2), np.int64)

    def decide(self, looks: Looks) -> Ints:
        """Return the next actions of the sequences, or of new sequences if they are exhausted."""
        actions = np.empty(len(looks.scenes), np.int64)
        approach(
            looks.scenes - self._first, looks.positions, looks.corners, looks.view == BLOCKED,
            self._targets, *self._rules, self._chosen, self._sequences, self._done, actions,
        )  # fmt: skip
        return actions


@kernel(interpretable=True, in_place=True)
def approach(
    rows: Ints, positions: Ints, corners: Ints, obstacles: Truths, targets: Ints,
    patient: bool, reachable: bool, literal: bool,
    chosen: Ints, sequences: Bytes, done: Ints, actions: Ints,
) -> None:  # fmt: skip
    """Compute the `actions` of several scenes; `rows` are their indices in the arrays of :class:`_Nearest`."""
    for index in range(len(rows)):
        row = rows[index]
        if not literal:
            chosen[row, 0], chosen[row, 1] = positions[index, 0], positions[index, 1]
        if done[row, 0] == done[row, 1]:
            done[row, 0] = 0
            done[row, 1] = choose(
                obstacles[index], corners[index], targets[row], reachable, literal, chosen[row],
                sequences[row],
            )  # fmt: skip
        if done[row, 0] == done[row, 1]:
            actions[index] = GIVE_UP
            continue
        actions[index] = sequences[row, done[row, 0]]
        done[row, 0] = done[row, 0] + 1 if patient else done[row, 1]


@kernel
def choose(
    obstacles: Truths, corner: Ints, target: Ints, reachable: bool, literal: bool, cell: Ints,
    sequence: Bytes,
) -> int:  # fmt: skip
    """Replace `cell`, where the path begins, by the chosen cell; return the length of the `sequence` to it.

    The sequence ends early if the chosen cell is unreachable.
    """
    rows, columns = obstacles.shape
    width = columns + 2
    aim_row, aim_column = target[0] - corner[0], target[1] - corner[1]
    if literal and 0 <= aim_row < rows and 0 <= aim_column < columns:
        return 0
    row, column = cell[0] - corner[0], cell[1] - corner[1]
    if not (0 <= row < rows and 0 <= column < columns):
        return 0  # the vehicle has left the view of a hovering UAV
    walls = np.ones((rows + 2) * width, np.uint8)
    for i in range(rows):
        for j in range(columns):
            walls[(i + 1) * width + j + 1] = 1 if obstacles[i, j] else 0
    at = (row + 1) * width + column + 1
    grid = Grid(walls, width, np.array((-width, width, -1, 1)), 0)
    steps = np.zeros(walls.size, np.int64)
    if reachable:
        steps = spread(grid, np.array([at]))
    goal, least = at, -1
    for i in range(rows):
        for j in range(columns):
            near = (i + 1) * width + j + 1
            away = (i - aim_row) ** 2 + (j - aim_column) ** 2
            if walls[near] == 0 and steps[near] < FAR and (least < 0 or away < least):
                goal, least = near, away
    cell[0], cell[1] = goal // width - 1 + corner[0], goal % width - 1 + corner[1]
    steps = spread(grid, np.array([goal]))
    count = 0
    while at != goal:
        action = descend(grid, steps, at)
        if action < 0:
            break
        sequence[count] = action
        count += 1
        at += grid.moves[action]
    return count


class BaselineOne(NavigationBackend):
    """Traditional Baseline 1: the whole sequence to the visible free cell nearest the target."""

    name = "baseline-1"
    summary = "whole sequences to the visible free cell nearest the target"
    together = MOST_TOGETHER
    patient, reachable = True, False

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of several scenes."""
        literal = bool(request.options.get("literal", False))
        return _Nearest(problem, scenes, request, self.patient, self.reachable, literal)


class BaselineOneReachable(BaselineOne):
    """Traditional Baseline 1, restricted to cells that are reachable within the view."""

    name = "baseline-1-reachable"
    summary = "whole sequences to the reachable visible cell nearest the target"
    reachable = True


class BaselineTwo(BaselineOne):
    """Traditional Baseline 2: one action towards the visible free cell nearest the target."""

    name = "baseline-2"
    summary = "one action at a time to the visible free cell nearest the target"
    patient = False
    options = {
        **BaselineOne.options,
        "literal": Option(False, "Table IV as printed: plan from the latest chosen cell, no last stage", bool),
    }  # fmt: skip


class BaselineTwoReachable(BaselineOneReachable):
    """Traditional Baseline 2, restricted to cells that are reachable within the view."""

    name = "baseline-2-reachable"
    summary = "one action at a time to the reachable visible cell nearest the target"
    patient = False
