"""The paper's traditional baselines: to the visible cell nearest the target, again and again.

Table III (Traditional Baseline 1) executes whole sequences, Table IV (2) one action at a time. Nearest is by straight
line, the first in rows and then columns among equals. A* plans within the view and remembers nothing of earlier views.
The paper does not say whether ``SearchMinDis2Target`` looks only at cells that can be reached: ``baseline-1`` and
``baseline-2`` choose among all free cells of the view and give up if A* finds no path, the others choose among the cells
that can be reached. All give up at the nearest cell itself: nothing would change any more.

As printed, Table IV continues from the cell it was heading for, although only one action was executed, and ends when
the target comes into the view. So it never reaches a target. By default ``baseline-2`` continues from where the
vehicle is and has the last stage of Table III; its option ``literal`` runs Table IV as printed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import BLOCKED, TARGET, Looks
from ..backend import Request
from ..option import Option
from .dstar_kernels import STUCK, descend, search
from .native import GIVE_UP, NavigationBackend, Policy

__all__ = ["BaselineOne", "BaselineOneReachable", "BaselineTwo", "BaselineTwoReachable"]

Ints = NDArray[np.int64]


class _Nearest:
    """The policy in one scene.

    Parameters
    ----------
    patient : bool
        Whether the whole sequence of actions is taken before the next look counts.
    reachable : bool
        Whether only cells are chosen that can be reached within the view.
    literal : bool
        Whether to plan from the latest chosen cell and to give up once the target is in the view (Table IV).
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
        from scipy.ndimage import label  # here, so that no decision waits for it

        self._label = label
        self._target, self._flag = problem.targets[scene], request.control.flag
        self._patient, self._reachable, self._literal = patient, reachable, literal
        self._current: Ints | None = None
        self._sequence: Iterator[int] = iter(())

    def decide(self, looks: Looks) -> Ints:
        """Go on with the sequence, or choose the next one."""
        action = next(self._sequence, GIVE_UP)
        if action == GIVE_UP:
            sequence = self._choose(looks)
            action = next(sequence, GIVE_UP)
            if self._patient:
                self._sequence = sequence
        return np.array([action])

    def _choose(self, looks: Looks) -> Iterator[int]:
        """Return the actions that lead to the cell chosen; none where that is not possible."""
        corner = looks.corners[0]
        walls = np.pad(looks.view[0] == BLOCKED, 1, constant_values=True)
        start = looks.positions[0] if self._current is None else self._current
        row, column = start - corner + 1
        if self._literal and (looks.view == TARGET).any():
            return
        if not (0 < row < walls.shape[0] - 1 and 0 < column < walls.shape[1] - 1):
            return  # it left the view of a UAV that hovers
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
        at, goal = int(row * width + column), int(chosen[0] * width + chosen[1])
        steps = search(flat, width, at, goal, True, self._flag)
        while at != goal:
            action = descend(flat, width, steps, at)
            if action == STUCK:
                return
            yield int(action)
            at += (-width, width, -1, 1)[action]


class BaselineOne(NavigationBackend):
    """Traditional Baseline 1: the whole sequence to the visible free cell nearest the target."""

    name = "baseline-1"
    summary = "whole sequences to the visible free cell nearest the target"
    patient, reachable = True, False

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return what decides in one scene."""
        literal = bool(request.options.get("literal", False))
        return _Nearest(problem, int(scenes[0]), request, self.patient, self.reachable, literal)


class BaselineOneReachable(BaselineOne):
    """The same to the nearest of the cells that can be reached within the view."""

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
    """The same to the nearest of the cells that can be reached within the view."""

    name = "baseline-2-reachable"
    summary = "one action at a time to the reachable visible cell nearest the target"
    patient = False
