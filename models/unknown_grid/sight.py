"""Positions of the UAV and cells seen, computed from the positions of the vehicle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .scenes import Hover, Scenes

__all__ = ["first_seen", "uav_cells"]

Ints = NDArray[np.int64]


def uav_cells(model: Scenes, scene: int, positions: Ints) -> Ints:
    """Return the cells below the UAV, which follows the vehicle or hovers, shape (n, 2).

    `positions` are the cells of the vehicle before and after its actions. The maps of `model` are not
    used.
    """
    near = (np.abs(model.targets[scene] - positions) <= model.view // 2).all(axis=1)
    cells = positions.copy()
    if model.uav is Hover.PAPER and near.any():
        first = int(near.argmax())
        cells[first:] = positions[first]
    return cells


def first_seen(model: Scenes, scene: int, positions: Ints) -> Ints:
    """Return the number of actions before each cell was first seen, shape (rows, columns).

    The entry of a cell that was never seen is the number of positions. The parameters are those of
    :func:`uav_cells`.
    """
    middles = uav_cells(model, scene, positions)
    half = model.view // 2
    lows = np.maximum(middles - half, 0).tolist()
    highs = np.minimum(middles + half + 1, model.shape).tolist()
    moves = np.diff(middles, axis=0)
    times = np.full(tuple(model.shape), len(positions), np.int64)
    # Backwards, so that the earliest time remains. A move reveals only the edge in front.
    for k in np.flatnonzero(moves.any(axis=1))[::-1].tolist():
        edges = zip(moves[k].tolist(), lows[k + 1], highs[k + 1], strict=True)
        times[tuple(slice(b - 1 if m > 0 else a, a + 1 if m < 0 else b) for m, a, b in edges)] = (
            k + 1
        )
    times[tuple(map(slice, lows[0], highs[0]))] = 0
    return times
