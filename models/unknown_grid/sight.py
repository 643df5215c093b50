"""Positions of the UAV and cells seen, computed from the positions of the vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .camera import crop
from .moving import obstacle_tracks
from .scenes import Aspect, Hover, aspects_of
from .sensing import BLOCKED, FREE, TARGET, UNKNOWN, sense

if TYPE_CHECKING:
    from .model import UnknownGridNavigation

__all__ = ["first_seen", "readings", "uav_cells", "wrong_readings"]

Cells = NDArray[np.int8]
Ints = NDArray[np.int64]
_HIDING = frozenset({Aspect.OCCLUSION, Aspect.MOVING})


def readings(
    model: UnknownGridNavigation, scene: int, positions: Ints, centres: Ints, others: Ints | None = None,
    first: int = 0, exact: bool = False,
) -> Cells:  # fmt: skip
    """Return the readings of the views around `centres`, shape (n, rows, columns).

    `positions` are the cells of the vehicle after `first`, `first` + 1, … actions, and `others`, shape
    (n, moving, 2), those of the moving obstacles, computed by default.
    """
    corners = centres - model.view // 2
    blocked = np.array([crop(model.blocked[scene], corner, model.view) for corner in corners])
    true = np.where(blocked, BLOCKED, FREE).astype(np.int8)
    places = model.targets[scene] - corners
    inside = ((places >= 0) & (places < model.view)).all(axis=1)
    true[inside, places[inside, 0], places[inside, 1]] = TARGET
    taken = np.minimum(first + np.arange(len(positions)), model.steps)
    if others is None:
        others = obstacle_tracks(model)[scene][:, taken].swapaxes(0, 1)
    scenes = np.full(len(positions), scene)
    return sense(model, others, scenes, taken, positions, corners, true, exact)


def wrong_readings(
    model: UnknownGridNavigation, scene: int, position: Ints, centre: Ints, others: Ints, step: int
) -> Ints:
    """Return rows and columns of the cells that are read wrongly after `step` actions, shape (n, 2).

    `position`, `centre` and `others`, shape (moving, 2), are the cells of the vehicle, below the UAV and of the
    moving obstacles.
    """
    if Aspect.NOISE not in aspects_of(model):
        return np.empty((0, 2), np.int64)
    read, exact = (
        readings(model, scene, position[None], centre[None], others[None], step, each)[0]
        for each in (False, True)
    )
    return np.asarray(np.argwhere(read != exact) + centre - model.view // 2)


def uav_cells(model: UnknownGridNavigation, scene: int, positions: Ints) -> Ints:
    """Return the cells below the UAV, which follows the vehicle or hovers, shape (n, 2).

    `positions` are the cells of the vehicle before and after its actions. The maps of `model` are only used
    if obstacles may hide the target.
    """
    near = (np.abs(model.targets[scene] - positions) <= model.view // 2).all(axis=1)
    if aspects_of(model) & _HIDING and model.uav is Hover.PAPER:
        near = (readings(model, scene, positions, positions) == TARGET).any(axis=(1, 2))
    cells = positions.copy()
    if model.uav is Hover.PAPER and near.any():
        first = int(near.argmax())
        cells[first:] = positions[first]
    return cells


def first_seen(model: UnknownGridNavigation, scene: int, positions: Ints, middles: Ints) -> Ints:
    """Return the number of actions before each cell was first seen, shape (rows, columns).

    The entry of a cell that was never seen is the number of positions. The parameters are those and the result
    of :func:`uav_cells`.
    """
    half = model.view // 2
    lows = np.maximum(middles - half, 0).tolist()
    highs = np.minimum(middles + half + 1, model.shape).tolist()
    moves = np.diff(middles, axis=0)
    times = np.full(tuple(model.shape), len(positions), np.int64)
    if model.occlusion:
        seen = readings(model, scene, positions, middles) != UNKNOWN
        for k in range(len(positions))[::-1]:
            cells = np.argwhere(seen[k]) + middles[k] - half
            times[tuple(cells[((cells >= 0) & (cells < model.shape)).all(axis=1)].T)] = k
        return times
    # Backwards, so that the earliest time remains. A move reveals only the edge in front.
    for k in np.flatnonzero(moves.any(axis=1))[::-1].tolist():
        edges = zip(moves[k].tolist(), lows[k + 1], highs[k + 1], strict=True)
        times[tuple(slice(b - 1 if m > 0 else a, a + 1 if m < 0 else b) for m, a, b in edges)] = (
            k + 1
        )
    times[tuple(map(slice, lows[0], highs[0]))] = 0
    return times
