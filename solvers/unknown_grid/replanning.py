"""Optimistic replanning: shortest paths on the known map, with unknown cells treated as free.

The policy replans before each step. Ties between shortest paths go to the first action in the order up,
down, left, right. Observed obstacles are certain, so the target is unreachable if the known map has no
path. Cells detected from images may be wrong. If they leave no path, the policy discards them and keeps
only the cells that the vehicle visited or collided with.

A hovering UAV does not show all cells around the vehicle. The policy stores collisions, so an unseen
obstacle costs at most one step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.scenes import Aspect, aspects_of
from ...models.unknown_grid.world import BLOCKED, Looks
from ..contract.backend import Request
from ..contract.option import Option
from .dstar_kernels import FAR, STUCK, descend, repair, search
from .native import GIVE_UP, NO_WAY, NavigationBackend, Policy
from .searching import Searching

__all__ = ["AStarReplanning", "CurrentView", "DStarLite", "KnownMap", "Replanning"]

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]


class KnownMap:
    """Known map of a scene as a flat array with a frame of blocked cells.

    `walls` is 1 for known obstacles and the frame, and `width` the number of cells per row, including
    the frame. `cell` and `target` are the cells of vehicle and target, and `moves` the change of the
    cell number by each action.
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
        """Update the map with an observation and a possible collision; return the cells whose state changed.

        `expected` is the cell of the vehicle if its last step caused no collision.
        """
        self.cell = self._number(looks.positions[0])
        visited = np.array([expected, self.cell])
        before = self.walls[visited]
        # The order matters: without a collision, both are the same cell, which is free.
        self.walls[expected], self.walls[self.cell] = 1, 0
        self._sure.flat[visited] = True
        changed = visited[before != self.walls[visited]]

        corner = looks.corners[0] + 1
        low = np.maximum(corner, 0)
        high = np.minimum(corner + looks.view.shape[1:], self._walls.shape)
        inside = slice(low[0], high[0]), slice(low[1], high[1])
        (top, left), (bottom, right) = low - corner, high - corner
        window = looks.view[0, top:bottom, left:right] == BLOCKED
        differ = np.argwhere((window != self._walls[inside]) & ~self._sure[inside]) + low
        cells = differ @ [self.width, 1]
        self.walls[cells] ^= 1
        return np.concatenate([changed, cells])

    def doubt(self) -> Ints:
        """Free all obstacles known only from images, and return their cells."""
        cells = np.flatnonzero((self.walls == 1) & ~self._sure.reshape(-1))
        self.walls[cells] = 0
        return cells


class Replanning:
    """A* on the known map before every step, in one scene. The control of `request` may stop the search."""

    def __init__(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> None:
        self._problem, self._scene = problem, int(scenes[0])
        self._flag = request.control.flag
        self.known = KnownMap(problem, self._scene)
        self._expected = self.known.cell

    def decide(self, looks: Looks) -> Ints:
        """Replan and return the first action."""
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
        """Return the first action of a shortest path, or STUCK."""
        known = self.known
        steps = search(known.walls, known.width, known.cell, known.target, False, self._flag)
        return int(descend(known.walls, known.width, steps, known.cell))


class _Forgetting(Replanning):
    """A* on the current view only."""

    def decide(self, looks: Looks) -> Ints:
        """Reset the map, plan and return the first action."""
        self.known = KnownMap(self._problem, self._scene)
        return super().decide(looks)


class _Repairing(Replanning):
    """D* Lite on the known map, which repairs the previous search after changes."""

    def __init__(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> None:
        super().__init__(problem, scenes, request)
        size = self.known.walls.size
        self._g, self._rhs = np.full(size, FAR, np.int32), np.full(size, FAR, np.int32)
        self._heap, self._keys = np.empty(size, np.int64), np.empty(size, np.int64)
        self._where = np.zeros(size, np.int32)
        self._tally = np.array([0, 0, self.known.cell])
        self._new = [self.known.target]
        # A call without changes compiles or loads the kernel before the first decision.
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


_FORGET = Option(
    None,
    "steps after which a cell that was not seen again is forgotten; None for never",
    int,
    lower=0,
)


class AStarReplanning(NavigationBackend):
    """Optimistic replanning on the remembered map by A* from scratch at every step."""

    name = "a-star-replanning"
    summary = "optimistic replanning on all that was seen, A* from scratch"
    replanning: ClassVar[type[Replanning]] = Replanning
    searching: ClassVar[type[Searching]] = Searching
    supports = frozenset(Aspect)
    options: ClassVar[Mapping[str, Option]] = {**NavigationBackend.options, "forget": _FORGET}

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of one scene."""
        forget = request.options.get("forget")
        if aspects_of(problem) or forget is not None:
            return self.searching(problem, int(scenes[0]), request, forget)
        return self.replanning(problem, scenes, request)


class DStarLite(AStarReplanning):
    """Optimistic replanning on the remembered map by D* Lite, with the same steps as A* from scratch."""

    name = "d-star-lite"
    summary = "optimistic replanning on all that was seen, D* Lite"
    replanning = _Repairing


class CurrentView(AStarReplanning):
    """Optimistic replanning on the current view and the collision of the latest step.

    The policy returns to a dead end deeper than the view as soon as the dead end is out of view.
    """

    name = "current-view"
    summary = "optimistic replanning on the current view alone, A*"
    replanning = _Forgetting
    supports = frozenset(Aspect) - {Aspect.SEARCH}
    options = NavigationBackend.options

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of one scene."""
        if aspects_of(problem):
            return Searching(problem, int(scenes[0]), request, 0)
        return super().policy(problem, scenes, request)
