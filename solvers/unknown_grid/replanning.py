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
from ...models.unknown_grid.moving import FAR
from ...models.unknown_grid.scenes import Aspect, aspects_of
from ...models.unknown_grid.world import BLOCKED, Looks
from ..contract.backend import Request
from ..contract.option import Option
from .dstar_kernels import plan, replan
from .native import GIVE_UP, MOST_TOGETHER, NavigationBackend, Policy
from .searching import RepairingSearch, Searching, SearchingEach

__all__ = ["AStarReplanning", "CurrentView", "DStarLite", "Replanning"]

Ints = NDArray[np.int64]


class Replanning:
    """A* on the known maps of several scenes before every step. The control of `request` may stop the search.

    A map is a flat row of `walls` with a frame of blocked cells and `width` cells per row of the map: 1 for
    known obstacles and the frame. The `ends` are the cells of start and target.
    """

    def __init__(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> None:
        self._first, self._flag = int(scenes[0]), request.control.flag
        self._doubts = problem.camera is not None
        self.width = int(problem.shape[1]) + 2
        ends = np.stack([problem.starts[scenes], problem.targets[scenes]], axis=1)
        self.ends: Ints = self.cells(ends)
        self._frame = np.pad(np.zeros(problem.shape, np.uint8), 1, constant_values=1).reshape(-1)
        self.walls = np.empty((len(scenes), self._frame.size), np.uint8)
        self._sure = np.empty_like(self.walls)  # cells that no view can change
        self.forget(np.arange(len(scenes)))
        #: Cells of the vehicles if their last steps caused no collision.
        self._expected = self.ends[:, 0].copy()
        self._changed = np.empty(self._frame.size + 3, np.int64)

    def cells(self, places: Ints) -> Ints:
        """Return the numbers of cells given by row and column, shape (…, 2)."""
        return np.asarray((places[..., 0] + 1) * self.width + places[..., 1] + 1)

    def forget(self, rows: Ints) -> None:
        """Reset the maps of the scenes `rows` to their frames."""
        self.walls[rows] = self._sure[rows] = self._frame
        self._sure[rows[:, None], self.ends[rows]] = 1

    def decide(self, looks: Looks) -> Ints:
        """Replan in all scenes and return the first actions."""
        actions = np.empty(len(looks.scenes), np.int64)
        self._plan(
            looks.scenes - self._first, self.cells(looks.positions), looks.corners, looks.view == BLOCKED,
            actions,
        )  # fmt: skip
        if self._flag[0]:
            actions[:] = GIVE_UP
        return actions  # STUCK equals NO_WAY

    def _plan(
        self, rows: Ints, cells: Ints, corners: Ints, obstacles: NDArray[np.bool_], actions: Ints
    ) -> None:
        plan(
            rows, cells, corners, obstacles, self.width, self.ends, self._doubts,
            self.walls, self._sure, self._expected, self._changed, actions, self._flag,
        )  # fmt: skip


class _Forgetting(Replanning):
    """A* on the current views only."""

    def decide(self, looks: Looks) -> Ints:
        """Reset the maps, plan and return the first actions."""
        self.forget(looks.scenes - self._first)
        return super().decide(looks)


class _Repairing(Replanning):
    """D* Lite on the known maps, which repairs the previous search after changes."""

    def __init__(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> None:
        super().__init__(problem, scenes, request)
        shape = self.walls.shape
        self._g, self._rhs = np.full(shape, FAR, np.int32), np.full(shape, FAR, np.int32)
        self._heap, self._keys = np.empty(shape, np.int64), np.empty(shape, np.int64)
        self._where = np.zeros(shape, np.int32)
        self._tally = np.zeros((len(scenes), 3), np.int64)
        self._tally[:, 2] = self._expected

    def _plan(
        self, rows: Ints, cells: Ints, corners: Ints, obstacles: NDArray[np.bool_], actions: Ints
    ) -> None:
        replan(
            rows, cells, corners, obstacles, self.width, self.ends, self._doubts,
            self.walls, self._sure, self._expected, self._changed, actions, self._flag,
            self._g, self._rhs, self._heap, self._where, self._keys, self._tally,
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
    together = MOST_TOGETHER
    replanning: ClassVar[type[Replanning]] = Replanning
    searching: ClassVar[type[Searching]] = Searching
    #: Default of the option ``forget``.
    forget: ClassVar[int | None] = None
    supports = frozenset(Aspect)
    options: ClassVar[Mapping[str, Option]] = {**NavigationBackend.options, "forget": _FORGET}

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of several scenes."""
        forget = request.options.get("forget", self.forget)
        if aspects_of(problem) or (forget is not None and self.forget is None):
            return SearchingEach(problem, scenes, request, forget, self.searching)
        return self.replanning(problem, scenes, request)


class DStarLite(AStarReplanning):
    """Optimistic replanning on the remembered map by D* Lite, with the same steps as A* from scratch."""

    name = "d-star-lite"
    summary = "optimistic replanning on all that was seen, D* Lite"
    replanning = _Repairing
    searching = RepairingSearch


class CurrentView(AStarReplanning):
    """Optimistic replanning on the current view and the collision of the latest step.

    The policy returns to a dead end deeper than the view as soon as the dead end is out of view.
    """

    name = "current-view"
    summary = "optimistic replanning on the current view alone, A*"
    replanning = _Forgetting
    supports = frozenset(Aspect) - {Aspect.SEARCH}
    options = NavigationBackend.options
    forget = 0
