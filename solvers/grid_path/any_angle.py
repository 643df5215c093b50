"""``any-angle``: the shortest path in any direction, proven."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..backend import Feature, Guarantee, Request
from .free_paths import AnyDirection, Ground, Leg
from .smoothing import without_collinear

__all__ = ["AnyAngle", "line_tables"]

Floats = NDArray[np.float64]


def line_tables(
    blocked: NDArray[np.bool_], corners: NDArray[np.int8]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return runs of cells and next corners, line by line, as :mod:`.any_angle_kernels` says.

    Parameters
    ----------
    blocked : ndarray of bool, shape (rows, columns)
        The padded map.
    corners : ndarray of int8, shape (rows, columns)
        Where shortest paths may turn.

    Returns
    -------
    runs : ndarray of int32, shape (2, rows, columns + 1)
        First columns of runs, and those beyond them.
    onward : ndarray of int32, shape (rows, columns + 1)
        The next corner from each column on.
    """
    rows, columns = blocked.shape
    place = np.arange(columns + 1, dtype=np.int32)
    runs = np.full((2, rows, columns + 1), columns, np.int32)
    differs = blocked[:, 1:] != blocked[:, :-1]
    first, beyond = runs[0, :, :columns], runs[1, :, :columns]
    first[:, 0] = 0
    first[:, 1:] = np.where(differs, place[1:columns], 0)
    np.maximum.accumulate(first, axis=1, out=first)
    first[blocked] = -1
    beyond[:, :-1] = np.where(differs, place[1:columns], columns)
    beyond[:] = np.minimum.accumulate(beyond[:, ::-1], axis=1)[:, ::-1]
    onward = np.full((rows, columns + 1), columns, np.int32)
    onward[:, :columns] = np.where(corners > 0, place[:columns], columns)
    onward[:] = np.minimum.accumulate(onward[:, ::-1], axis=1)[:, ::-1]
    return runs, onward


class AnyAngle(AnyDirection):
    """A* over the convex corners of blocked cells, which are found as they come into sight.

    Any shortest path turns only around such corners, so the search is exact; see
    :mod:`.any_angle_kernels`.
    """

    name = "any-angle"
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    summary = "shortest paths in any direction, by A* over corners in sight; ours"

    def leg(self, ground: Ground, goal: Floats, ceiling: float, request: Request) -> Leg:
        """Search, and walk back from the goal."""
        from .any_angle_kernels import ABSENT, STOPPED, search

        blocked, corners = ground.sight.blocked, ground.corners
        runs, onward = ground.tables
        status, bound, turns, settled = search(
            blocked, runs, corners, onward, ground.start, goal, ceiling, request.control.flag
        )
        ground.count("corners settled", settled)
        if status == STOPPED:
            return Leg(None, float(bound), stopped=True)
        if status == ABSENT:
            return Leg(None, math.inf)
        points = np.stack([turns[::-1] % blocked.shape[1], turns[::-1] // blocked.shape[1]], axis=1)
        path = np.vstack([ground.start, points, goal]).astype(float)
        return Leg(without_collinear(path), float(bound))
