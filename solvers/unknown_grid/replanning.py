"""Optimistic replanning: the shortest way on what is known, where the unknown counts as free.

It is planned anew before each step. Of several shortest ways it takes the one that begins with the first
of up, down, left and right. What was seen to be blocked is blocked, so where no way is left on what is
known there is none. Images may deceive, though: where no way is left on what they showed, it is doubted,
and only what the vehicle met itself is kept.

A UAV that hovers does not see all that the vehicle comes to. A collision is remembered, so that a cell
that was never seen costs one at the most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import BLOCKED, Looks
from ..backend import Request
from .dstar_kernels import FAR, STUCK, descend, repair, search
from .native import GIVE_UP, NO_WAY, NavigationBackend, Policy

__all__ = ["AStarReplanning", "CurrentView", "DStarLite", "KnownMap", "Replanning"]

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]


class KnownMap:
    """What is known of the map of a scene: flat, with one blocked cell around it.

    Parameters
    ----------
    problem : UnknownGridNavigation
        Of which only sizes, start and target are looked at.
    scene : int
        Its number.

    Attributes
    ----------
    walls : ndarray of uint8, shape (cells,)
        1 where blocked as far as is known, and off the map.
    width : int
        Cells of a row, the frame included.
    cell, target : int
        Where the vehicle is, and where it is to go.
    moves : tuple of int
        How each action changes the number of a cell.
    """

    def __init__(self, problem: UnknownGridNavigation, scene: int) -> None:
        rows, columns = problem.shape.tolist()
        self.width: int = columns + 2
        self._walls = np.pad(np.zeros((rows, columns), np.uint8), 1, constant_values=1)
        self._sure = self._walls == 1  # no view can change these
        self.walls: Bytes = self._walls.reshape(-1)
        self.moves = (-self.width, self.width, -1, 1)
        self.cell = self._number(problem.starts[scene])
        self.target = self._number(problem.targets[scene])
        self._sure.flat[[self.cell, self.target]] = True

    def _number(self, cell: Ints) -> int:
        return (int(cell[0]) + 1) * self.width + int(cell[1]) + 1

    def notice(self, looks: Looks, expected: int) -> Ints:
        """Take in what is seen of the one scene of `looks`, and whether the vehicle collided.

        Parameters
        ----------
        looks : Looks
            Of one scene.
        expected : int
            The cell where the vehicle should be by now.

        Returns
        -------
        ndarray of int64
            Cells that are blocked now and were not, or the other way round.
        """
        self.cell = self._number(looks.positions[0])
        felt = np.array([expected, self.cell])
        before = self.walls[felt]
        # In this order, for the two are the same unless it collided.
        self.walls[expected], self.walls[self.cell] = 1, 0
        self._sure.flat[felt] = True
        changed = felt[before != self.walls[felt]]

        corner = looks.corners[0] + 1
        low = np.maximum(corner, 0)
        high = np.minimum(corner + looks.view.shape[1:], self._walls.shape)
        inside = slice(low[0], high[0]), slice(low[1], high[1])
        (top, left), (bottom, right) = low - corner, high - corner
        seen = looks.view[0, top:bottom, left:right] == BLOCKED
        differ = np.argwhere((seen != self._walls[inside]) & ~self._sure[inside]) + low
        cells = differ @ [self.width, 1]
        self.walls[cells] ^= 1
        return np.concatenate([changed, cells])

    def doubt(self) -> Ints:
        """Free the cells that were only seen to be blocked, and return them."""
        cells = np.flatnonzero((self.walls == 1) & ~self._sure.reshape(-1))
        self.walls[cells] = 0
        return cells


class Replanning:
    """A* on the known map before every step, in one scene.

    Parameters
    ----------
    problem : UnknownGridNavigation
        Its true maps are not looked at.
    scenes : ndarray of int, shape (1,)
        The scene.
    request : Request
        Whose control may stop it.

    Attributes
    ----------
    known : KnownMap
        What is known of the map.
    """

    def __init__(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> None:
        self._problem, self._scene = problem, int(scenes[0])
        self._flag = request.control.flag
        self.known = KnownMap(problem, self._scene)
        self._expected = self.known.cell

    def decide(self, looks: Looks) -> Ints:
        """Plan anew, and take the first action."""
        changed = self.known.notice(looks, self._expected)
        action = self._plan(changed)
        if action == STUCK and self._problem.camera is not None:
            action = self._plan(self.known.doubt())
        if self._flag[0]:
            return np.array([GIVE_UP])
        if action == STUCK:
            return np.array([NO_WAY])
        self._expected = self.known.cell + self.known.moves[action]
        return np.array([action])

    def _plan(self, changed: Ints) -> int:
        """Return the first action of a shortest way, or STUCK."""
        known = self.known
        steps = search(known.walls, known.width, known.cell, known.target, False, self._flag)
        return int(descend(known.walls, known.width, steps, known.cell))


class _Forgetting(Replanning):
    """The same on a map that holds the current look only."""

    def decide(self, looks: Looks) -> Ints:
        """Forget, plan and take the first action."""
        self.known = KnownMap(self._problem, self._scene)
        return super().decide(looks)


class _Repairing(Replanning):
    """The same by D* Lite, which repairs what it found before where the map changed."""

    def __init__(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> None:
        super().__init__(problem, scenes, request)
        size = self.known.walls.size
        self._g, self._rhs = np.full(size, FAR, np.int32), np.full(size, FAR, np.int32)
        self._heap, self._keys = np.empty(size, np.int64), np.empty(size, np.int64)
        self._where = np.zeros(size, np.int32)
        self._tally = np.array([0, 0, self.known.cell])
        self._new = [self.known.target]
        # With nothing to do: what is compiled or loaded is so before the first decision.
        self._repair(np.empty(0, np.int64))

    def _plan(self, changed: Ints) -> int:
        known = self.known
        self._repair(np.append(changed, self._new).astype(np.int64))
        self._new = []
        return int(descend(known.walls, known.width, self._g, known.cell))

    def _repair(self, changed: Ints) -> None:
        known = self.known
        repair(
            known.walls, known.width, known.cell, known.target, changed,
            self._g, self._rhs, self._heap, self._where, self._keys, self._tally, self._flag,
        )  # fmt: skip


class DStarLite(NavigationBackend):
    """Optimistic replanning on the remembered map by D* Lite: step for step as A* from scratch."""

    name = "d-star-lite"
    summary = "optimistic replanning on all that was seen, D* Lite"

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return what decides in one scene."""
        return _Repairing(problem, scenes, request)


class AStarReplanning(NavigationBackend):
    """Optimistic replanning on the remembered map by A* from scratch at every step."""

    name = "a-star-replanning"
    summary = "optimistic replanning on all that was seen, A* from scratch"

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return what decides in one scene."""
        return Replanning(problem, scenes, request)


class CurrentView(NavigationBackend):
    """Optimistic replanning on what is seen now, and on whether the latest step collided.

    It comes back to a pocket that is deeper than the view as soon as that is out of sight.
    """

    name = "current-view"
    summary = "optimistic replanning on the current view alone, A*"

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return what decides in one scene."""
        return _Forgetting(problem, scenes, request)
