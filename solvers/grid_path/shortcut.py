"""``shortcut-greedy`` and ``shortcut-visibility``: A* along neighbours, then lines of sight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.grid_path.model import Connectivity, GridPath
from ..contract.backend import Feature, Guarantee, Option, Request
from .free_paths import AnyDirection, Ground, Leg
from .smoothing import How, straighten

__all__ = ["ShortcutGreedy", "ShortcutVisibility"]

Floats = NDArray[np.float64]


class ShortcutGreedy(AnyDirection):
    """A* along neighbours, then Algorithm 4 of the paper; see :mod:`.smoothing`.

    The paper searches over four neighbours (eq. 4). The default is eight, which gives shorter paths.
    """

    name = "shortcut-greedy"
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "neighbours": Option("8", "Neighbours for A*; the paper has 4.", str, choices=("4", "8")),
    }
    summary = "A* along neighbours, then the farthest points in sight (Algorithm 4)"
    how: ClassVar[How] = "greedy"

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search along neighbours, and straighten the path."""
        from .exact import AStar

        cell = np.floor(goal[::-1]).astype(np.int64) - 1
        connectivity = Connectivity(request.options["neighbours"])
        along = GridPath(ground.problem.map, ground.problem.start, cell, connectivity)
        answer = request.within(AStar(), along)
        if answer.point is None:
            return Leg(None, stopped=answer.limit is not None)
        path = ground.sight.cells(answer.point.paths[0])
        flag = request.control.flag
        return Leg(straighten(ground.sight, ground.corners, path, self.how, flag))


class ShortcutVisibility(ShortcutGreedy):
    """A* along neighbours, then shortest paths over points of its path and nearby corners."""

    name = "shortcut-visibility"
    summary = "A* along neighbours, then shortest paths over lines of sight near it; ours"
    how: ClassVar[How] = "visibility"
