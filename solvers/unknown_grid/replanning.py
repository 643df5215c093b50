"""Policies that plan as if unknown cells were free, and again before every step.

Each cell has an evidence, the logarithm of the odds of an obstacle, as in occupancy grids (H. Moravec, A. Elfes,
ICRA 1985). Unseen cells have 0. A cell is an obstacle for the search if its evidence is positive. Readings add
the logarithm of their likelihood ratio; exact readings and collisions are certain. With images or moving obstacles the
evidence of readings is limited, so that later readings change it, and obstacles are assumed to stay. If no path remains,
evidence that is not certain is discarded.

Until the target is seen, an unknown target is searched for at the nearest unseen cell (B. Yamauchi, "A
frontier-based approach for autonomous exploration", CIRA 1997).

A* is that of P. Hart, N. Nilsson and B. Raphael, "A formal basis for the heuristic determination of minimum cost paths",
IEEE Transactions on Systems Science and Cybernetics 4, 1968; D* Lite that of :mod:`.dstar_kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.grid_path import Connectivity
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.moving import FAR
from ...models.unknown_grid.plan import MOVES
from ...models.unknown_grid.scenes import Aspect, Corners
from ...models.unknown_grid.world import Looks
from ..contract.backend import Request
from ..contract.option import Option
from .dstar_kernels import Search
from .native import GIVE_UP, MOST_TOGETHER, NavigationBackend, Policy
from .replanning_kernels import ACTION, EXPECTED, GOAL, LAST, WAITS, Known, Rules, plan

__all__ = ["AStarReplanning", "CurrentView", "DStarLite", "Replanning"]

Ints = NDArray[np.int64]

#: Limit of the evidence of cells that may change, from OctoMap (A. Hornung and others, Autonomous Robots, 2013).
_LIMIT = 3.5


class Replanning:
    """Search on the known maps of several scenes before every step. The control of `request` may stop the search.

    A map is a flat row of `walls` with a frame of blocked cells and `width` cells per row of the map: 1 for
    known obstacles and the frame. The `ends` are the cells of start and target.

    Parameters
    ----------
    problem, scenes, request
        Model without its hidden fields, indices of the scenes, and request with the flag that stops the search.
    forget : int, optional
        Number of steps after which a cell that was not seen again is forgotten; None for never.
    repairs : bool
        Whether D* Lite repairs the previous search. Otherwise each search is from scratch.
    """

    def __init__(
        self,
        problem: UnknownGridNavigation,
        scenes: Ints,
        request: Request,
        forget: int | None,
        repairs: bool,
    ) -> None:
        self._first, self._flag, self.repairs = int(scenes[0]), request.control.flag, repairs
        self.width = int(problem.shape[1]) + 2
        count = 8 if problem.connectivity is Connectivity.EIGHT else 4
        moves = (np.array(MOVES) @ [self.width, 1])[:count]
        images, moving = problem.camera is not None, problem.moving > 0
        wrong, missed = problem.false_obstacles, problem.missed_obstacles
        with np.errstate(divide="ignore"):
            odds = np.log([missed / (1.0 - wrong), (1.0 - missed) / wrong if wrong else np.inf])
        uncertain = images or moving or max(wrong, missed) > 0
        limit = _LIMIT if images or moving else np.inf
        certain = _LIMIT if moving else np.inf
        self._rules = Rules(
            self.width, moves, list(Corners).index(problem.corners), repairs, moving, uncertain, images,
            -1 if forget is None else forget, np.array([*odds, limit, certain]),
        )  # fmt: skip
        known = problem.targets if problem.target_known else problem.starts  # others are hidden
        ends = np.stack([problem.starts[scenes], known[scenes]], axis=1)
        self.ends: Ints = self.cells(ends)
        frame = np.pad(np.zeros(problem.shape), 1, constant_values=np.inf).reshape(-1)
        evidence = np.tile(frame, (len(scenes), 1))
        if images:  # an image may show another value
            evidence[np.arange(len(scenes))[:, None], self.ends] = -np.inf
        self.walls = (evidence > 0).astype(np.uint8)
        shape, kept = evidence.shape, evidence.shape if repairs else (1, 1)
        tally = np.zeros((len(scenes), 8), np.int64)
        tally[:, LAST] = tally[:, EXPECTED] = self.ends[:, 0]
        tally[:, GOAL] = self.ends[:, 1] if problem.target_known else -1
        tally[:, ACTION] = WAITS
        self._memory = Known(
            evidence, self.walls, np.full(shape, -1, np.int32), np.empty(shape, np.int32),
            np.zeros(shape, np.uint8), tally,
        )  # fmt: skip
        self._search = Search(
            np.full(kept, FAR, np.int32), np.full(kept, FAR, np.int32), np.empty(kept, np.int64),
            np.zeros(kept, np.int32), np.empty(kept, np.int64), tally,
        )  # fmt: skip

    def cells(self, places: Ints) -> Ints:
        """Return the numbers of cells given by row and column, shape (…, 2)."""
        return np.asarray((places[..., 0] + 1) * self.width + places[..., 1] + 1)

    def decide(self, looks: Looks) -> Ints:
        """Replan in all scenes and return the first actions."""
        actions = np.empty(len(looks.scenes), np.int64)
        plan(
            looks.scenes - self._first, self.cells(looks.positions), looks.corners,
            np.ascontiguousarray(looks.view, dtype=np.float64), self._rules, self.ends, self._memory,
            self._search, actions, self._flag,
        )  # fmt: skip
        if self._flag[0]:
            actions[:] = GIVE_UP
        return actions  # STUCK equals NO_WAY


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
    #: Whether D* Lite repairs the previous search, and default of the option ``forget``.
    repairs: ClassVar[bool] = False
    forget: ClassVar[int | None] = None
    supports = frozenset(Aspect)
    options: ClassVar[Mapping[str, Option]] = {**NavigationBackend.options, "forget": _FORGET}

    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of several scenes."""
        forget = request.options.get("forget", self.forget)
        return Replanning(problem, scenes, request, forget, self.repairs)


class DStarLite(AStarReplanning):
    """Optimistic replanning on the remembered map by D* Lite, with the same steps as A* from scratch."""

    name = "d-star-lite"
    summary = "optimistic replanning on all that was seen, D* Lite"
    repairs = True


class CurrentView(AStarReplanning):
    """Optimistic replanning on the current view and the collision of the latest step.

    The policy returns to a dead end deeper than the view as soon as the dead end is out of view.
    """

    name = "current-view"
    summary = "optimistic replanning on the current view alone, A*"
    supports = frozenset(Aspect) - {Aspect.SEARCH}
    options = NavigationBackend.options
    forget = 0
