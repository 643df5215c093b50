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

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import BLOCKED, TARGET, Looks
from ..contract.backend import Request
from ..contract.option import Option
from .dstar_kernels import STUCK, descend, search
from .native import GIVE_UP, NavigationBackend, Policy

__all__ = ["BaselineOne", "BaselineOneReachable", "BaselineTwo", "BaselineTwoReachable"]

Ints = NDArray[np.int64]


class _Nearest:
    """Baseline policy in one scene.

    If `patient`, it executes the whole sequence of actions before the next decision. If `reachable`, it
    chooses only among cells that are reachable within the view. If `literal`, it plans from the latest
    chosen cell and gives up once the target is in the view (Table IV).
    """

    def __init__(
        self,
        problem: UnknownGridNavigation,
        scene: int,
        request: Request,
        patient: bool,
        reachable: bool,
        literal: bool,
    ) -> None:
        from scipy.ndimage import label  # here, to keep the import out of timed decisions

        self._label = label
        self._target, self._flag = problem.targets[scene], request.control.flag
        self._patient, self._reachable, self._literal = patient, reachable, literal
        self._current: Ints | None = None
        self._sequence: Iterator[int] = iter(())

    def decide(self, looks: Looks) -> Ints:
        """Return the next action of the sequence, or of a new sequence if it is exhausted."""
        action = next(self._sequence, GIVE_UP)
        if action == GIVE_UP:
            sequence = self._choose(looks)
            action = next(sequence, GIVE_UP)
            if self._patient:
                self._sequence = sequence
        return np.array([action])

    def _choose(self, looks: Looks) -> Iterator[int]:
        """Yield the actions to the chosen cell; the sequence ends early if the cell is unreachable."""
        corner = looks.corners[0]
        walls = np.pad(looks.view[0] == BLOCKED, 1, constant_values=True)
        start = looks.positions[0] if self._current is None else self._current
        row, column = start - corner + 1
        if self._literal and (looks.view == TARGET).any():
            return
        if not (0 < row < walls.shape[0] - 1 and 0 < column < walls.shape[1] - 1):
            return  # the vehicle has left the view of a hovering UAV
        allowed = ~walls
        if self._reachable:
            parts, _ = self._label(allowed)
            allowed = parts == parts[row, column]
        cells = np.argwhere(allowed)
        away = ((cells - 1 + corner - self._target) ** 2).sum(axis=1)
        chosen = cells[away.argmin()]
        if self._literal:
            self._current = chosen - 1 + corner
        width = walls.shape[1]
        flat = walls.astype(np.uint8).reshape(-1)
        cell, goal = int(row * width + column), int(chosen[0] * width + chosen[1])
        steps = search(flat, width, cell, goal, True, self._flag)
        while cell != goal:
            action = descend(flat, width, steps, cell)
            if action == STUCK:
                return
            yield int(action)
            cell += (-width, width, -1, 1)[action]


class BaselineOne(NavigationBackend):
    """Traditional Baseline 1: the whole sequence to the visible free cell nearest the target."""

    name = "baseline-1"
    summary = "whole sequences to the visible free cell nearest the target"
    patient, reachable = True, False

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of one scene."""
        literal = bool(request.options.get("literal", False))
        return _Nearest(problem, int(scenes[0]), request, self.patient, self.reachable, literal)


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
