"""The paper's traditional baselines: to the visible cell nearest the target, again and again.

The paper was not to be had; this is a reading of the words "whole sequence to the visible cell nearest the
target" (Traditional Baseline 1) and "one action at a time" (2). Nearest is by straight line, the first
in rows and then columns among equals. The way there is a shortest one within the view, and remembers
nothing of earlier views. The literal versions choose among all free cells of the view, and give up where
the chosen one cannot be reached within the view. The others choose among those that can be reached.
All give up where they are nearest themselves: nothing would ever change.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import BLOCKED, Looks
from ..backend import Request
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
    """

    def __init__(
        self,
        problem: UnknownGridNavigation,
        scene: int,
        request: Request,
        patient: bool,
        reachable: bool,
    ) -> None:
        from scipy.ndimage import label  # here, so that no decision waits for it

        self._label = label
        self._target, self._flag = problem.targets[scene], request.control.flag
        self._patient, self._reachable = patient, reachable
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
        row, column = looks.positions[0] - corner + 1
        if not (0 < row < walls.shape[0] - 1 and 0 < column < walls.shape[1] - 1):
            return  # it left the view of a UAV that hovers
        allowed = ~walls
        if self._reachable:
            parts, _ = self._label(allowed)
            allowed = parts == parts[row, column]
        cells = np.argwhere(allowed)
        away = ((cells - 1 + corner - self._target) ** 2).sum(axis=1)
        chosen = cells[away.argmin()]
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
        return _Nearest(problem, int(scenes[0]), request, self.patient, self.reachable)


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


class BaselineTwoReachable(BaselineOneReachable):
    """The same to the nearest of the cells that can be reached within the view."""

    name = "baseline-2-reachable"
    summary = "one action at a time to the reachable visible cell nearest the target"
    patient = False
