"""``shortcut-greedy`` and ``shortcut-visibility``: A* along neighbours, then lines of sight."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.grid_path.model import Connectivity, GridPath
from ..backend import Feature, Guarantee, Request
from .free_paths import AnyDirection, Ground, Leg
from .smoothing import How, straighten

__all__ = ["ShortcutGreedy", "ShortcutVisibility"]

Floats = NDArray[np.float64]


class ShortcutGreedy(AnyDirection):
    """A* with eight neighbours, then Algorithm 4 of the paper; see :mod:`.smoothing`."""

    name = "shortcut-greedy"
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    summary = "A* with 8 neighbours, then the farthest points in sight (Algorithm 4)"
    how: ClassVar[How] = "greedy"

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search along neighbours, and straighten what is found."""
        from .exact import AStar

        cell = np.floor(goal[::-1]).astype(np.int64) - 1
        along = GridPath(ground.problem.map, ground.problem.start, cell, Connectivity.EIGHT)
        answer = request.within(AStar(), along)
        if answer.point is None:
            return Leg(None, stopped=answer.limit is not None)
        path = ground.sight.cells(answer.point.paths[0])
        flag = request.control.flag
        return Leg(straighten(ground.sight, ground.corners, path, self.how, flag))


class ShortcutVisibility(ShortcutGreedy):
    """A* with eight neighbours, then shortest paths over points along it and corners near it."""

    name = "shortcut-visibility"
    summary = "A* with 8 neighbours, then shortest paths over lines of sight near it; ours"
    how: ClassVar[How] = "visibility"
