"""What the UAV has shown of a map, by the rules of the simulator, from where the vehicle was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .scenes import Hover, Scenes

__all__ = ["first_seen", "uav_cells"]

Ints = NDArray[np.int64]


def uav_cells(model: Scenes, scene: int, positions: Ints) -> Ints:
    """Return the cells above which the UAV was: above the vehicle, or where it hovers.

    Parameters
    ----------
    model : Scenes
        Its target, view and rule count; the map does not.
    scene : int
        Its number.
    positions : ndarray of int, shape (n, 2)
        Row and column of the vehicle before and after its actions.

    Returns
    -------
    ndarray of int, shape (n, 2)
    """
    near = (np.abs(model.targets[scene] - positions) <= model.view // 2).all(axis=1)
    found = positions.copy()
    if model.uav is Hover.PAPER and near.any():
        first = int(near.argmax())
        found[first:] = positions[first]
    return found


def first_seen(model: Scenes, scene: int, positions: Ints) -> Ints:
    """Return after how many actions each cell was first seen, shape (rows, columns).

    Cells that were not seen have the number of all positions. The parameters are those of
    :func:`uav_cells`.
    """
    middles = uav_cells(model, scene, positions)
    half = model.view // 2
    lows = np.maximum(middles - half, 0).tolist()
    highs = np.minimum(middles + half + 1, model.shape).tolist()
    moves = np.diff(middles, axis=0)
    found = np.full(tuple(model.shape), len(positions), np.int64)
    # Backwards, so that the earliest time stays; after a move only the edge in front is new.
    for k in np.flatnonzero(moves.any(axis=1))[::-1].tolist():
        edges = zip(moves[k].tolist(), lows[k + 1], highs[k + 1], strict=True)
        found[tuple(slice(b - 1 if m > 0 else a, a + 1 if m < 0 else b) for m, a, b in edges)] = (
            k + 1
        )
    found[tuple(map(slice, lows[0], highs[0]))] = 0
    return found
