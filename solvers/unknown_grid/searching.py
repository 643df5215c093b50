"""Replanning for models with further aspects: neighbours, uncertain readings, moving obstacles, unknown targets.

Each cell has an evidence, the logarithm of the odds of an obstacle, as in occupancy grids (H. Moravec, A. Elfes,
ICRA 1985). Unseen cells have 0. A cell is an obstacle for the search if its evidence is positive. Readings add
the logarithm of their likelihood ratio; exact readings and collisions are certain. With moving obstacles the
evidence is limited, so that later readings change it, and obstacles are assumed to stay.

Until the target is seen, an unknown target is searched for at the nearest unseen cell (B. Yamauchi, "A
frontier-based approach for autonomous exploration", CIRA 1997).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.grid_path import Connectivity
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.moving import FAR, descend, spread
from ...models.unknown_grid.plan import MOVES, WAIT
from ...models.unknown_grid.scenes import Corners
from ...models.unknown_grid.world import BLOCKED, TARGET, UNKNOWN, Looks
from ..contract.backend import Request
from .dstar_kernels import repair
from .native import GIVE_UP, NO_WAY

__all__ = ["RepairingSearch", "Searching", "SearchingEach"]

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


#: Limit of the evidence of cells that may change, from OctoMap (A. Hornung and others, Autonomous Robots, 2013).
_LIMIT = 3.5


class Searching:
    """Policy of one scene that replans before every step by a breadth-first search.

    Parameters
    ----------
    problem, scene, request
        Model without its hidden fields, index of the scene, and request with the flag that stops the search.
    forget : int, optional
        Number of steps after which the policy forgets a cell that was not seen again; None for never.
    """

    def __init__(
        self, problem: UnknownGridNavigation, scene: int, request: Request, forget: int | None
    ) -> None:
        rows, columns = problem.shape.tolist()
        self._flag, self._forget = request.control.flag, forget
        self._width, self._moving, self._view = columns + 2, problem.moving > 0, problem.view
        #: Limit of the evidence, so that later readings can change it.
        self._limit = _LIMIT if self._moving or problem.camera is not None else np.inf
        count = 8 if problem.connectivity is Connectivity.EIGHT else 4
        self._moves = np.array(MOVES) @ [self._width, 1]
        self._allowed = self._moves[:count]
        self._sides = list(Corners).index(problem.corners)
        self._evidence = np.full((rows + 2, columns + 2), np.inf)
        self._inner = (slice(1, -1),) * 2
        self._evidence[self._inner] = 0.0
        self._stamps = np.full(
            self._evidence.shape, -1
        )  # time of the latest reading, -1 for unseen cells
        self._time = 0
        wrong, missed = problem.false_obstacles, problem.missed_obstacles
        with np.errstate(divide="ignore"):
            odds = np.log([missed / (1.0 - wrong), (1.0 - missed) / wrong if wrong else np.inf])
        #: Evidence of a free and of a blocked reading.
        self._weights = odds
        self._cell = self._expected = self._number(problem.starts[scene])
        self._action = WAIT
        self._target = self._number(problem.targets[scene]) if problem.target_known else -1

    def _number(self, cell: Ints) -> int:
        return int((cell[0] + 1) * self._width + cell[1] + 1)

    def decide(self, looks: Looks) -> int:
        """Update the evidence, plan and return the first action."""
        self._cell = self._number(looks.positions[0])
        straight = self._note_step()
        self._note_view(looks)
        if self._forget is not None:
            old = self._stamps[self._inner] < self._time - self._forget
            self._evidence[self._inner][old] = 0.0
            self._stamps[self._inner][old] = -1
        self._time += 1
        moves = self._moves[:4] if straight else self._allowed
        action = self._plan(moves)
        if action == NO_WAY:  # discard what is not certain
            self._evidence[np.isfinite(self._evidence)] = 0.0
            if self._moving:
                self._note_view(looks)
            action = self._plan(moves)
        if self._flag[0]:
            return GIVE_UP
        if action == NO_WAY and self._moving:
            action = WAIT
        self._action, self._expected = action, self._cell + int(self._moves[action])
        return action

    def _note_step(self) -> bool:
        """Store the result of the latest step; return whether the next one must not be diagonal."""
        evidence = self._evidence.reshape(-1)
        hit = self._cell != self._expected
        # The obstacle of a diagonal step may be beside it. A straight step tells.
        diagonal = hit and self._action >= 4 and self._sides < 2
        if hit and not diagonal:
            evidence[self._expected] = self._limit
        evidence[self._cell] = -self._limit
        self._stamps.flat[[self._cell] if diagonal else [self._cell, self._expected]] = self._time
        return diagonal

    def _note_view(self, looks: Looks) -> None:
        """Add the readings of the view to the evidence."""
        corner = looks.corners[0] + 1
        low = np.maximum(corner, 1)
        high = np.minimum(corner + self._view, np.subtract(self._evidence.shape, 1))
        part = tuple(map(slice, low, np.maximum(low, high)))
        readings = looks.view[0][tuple(map(slice, low - corner, np.maximum(low, high) - corner))]
        found = np.argwhere(readings == TARGET)
        if len(found):
            self._target = self._number(found[0] + low - 1)
        known = readings != UNKNOWN
        evidence, gained = self._evidence[part], self._weights[(readings == BLOCKED).astype(int)]
        gained = evidence + np.where(np.isinf(evidence), 0.0, gained)
        gained = np.clip(gained, -self._limit, self._limit)
        self._evidence[part] = np.where(known, gained, evidence)
        self._stamps[part][known] = self._time

    def _plan(self, moves: Ints) -> int:
        """Return the first action of a shortest path to the target or to the nearest unseen cell, or ``NO_WAY``."""
        walls = (self._evidence > 0).astype(np.uint8).reshape(-1)
        if self._target < 0:
            goals = np.flatnonzero((self._stamps.reshape(-1) < 0) & (walls == 0))
        else:  # an obstacle may be on the target
            goals = np.array([self._target] if walls[self._target] == 0 else [], np.int64)
        if not len(goals):
            return NO_WAY
        steps = self._steps(walls, goals, moves)
        return int(descend(walls, self._width, moves, self._sides, steps, self._cell))

    def _steps(self, walls: Bytes, goals: Ints, moves: Ints) -> Any:
        """Return the steps to the nearest goal from all cells."""
        return spread(walls, self._width, moves, self._sides, goals)


class RepairingSearch(Searching):
    """Policy that repairs the previous search by D* Lite, as soon as the target is known."""

    def __init__(
        self, problem: UnknownGridNavigation, scene: int, request: Request, forget: int | None
    ) -> None:
        super().__init__(problem, scene, request, forget)
        size = self._evidence.size
        self._walls = np.zeros(size, np.uint8)
        self._g, self._rhs = np.full(size, FAR, np.int32), np.full(size, FAR, np.int32)
        self._heap, self._keys = np.empty(size, np.int64), np.empty(size, np.int64)
        self._where = np.zeros(size, np.int32)
        self._tally: Ints | None = None

    def _steps(self, walls: Bytes, goals: Ints, moves: Ints) -> Any:
        if self._target < 0 or len(moves) < len(self._allowed):
            return super()._steps(walls, goals, moves)
        changed = np.flatnonzero(walls != self._walls)
        if self._tally is None:
            self._tally = np.array([0, 0, self._cell])
            changed = goals  # all other cells are far, as if no cell had been blocked before
        self._walls = walls
        repair(
            walls, self._width, self._cell, self._target, changed, self._g, self._rhs, self._heap,
            self._where, self._keys, self._tally, self._flag, moves, self._sides,
        )  # fmt: skip
        return self._g


class SearchingEach:
    """Policies of several scenes, one of the class `kind` per scene; see :class:`Searching`."""

    def __init__(
        self, problem: UnknownGridNavigation, scenes: Ints, request: Request, forget: int | None,
        kind: type[Searching],
    ) -> None:  # fmt: skip
        self._policies = {scene: kind(problem, scene, request, forget) for scene in scenes.tolist()}

    def decide(self, looks: Looks) -> Ints:
        """Return the first actions of all scenes."""
        rows = (Looks._make(array[[row]] for array in looks) for row in range(len(looks.scenes)))
        return np.array([self._policies[int(row.scenes[0])].decide(row) for row in rows])
