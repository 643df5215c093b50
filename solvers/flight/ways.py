"""Paths of a flight over the free cells of its map."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fleet_mission.collision import deepest
from ...models.fleet_mission.curves import Pieces
from ...models.flight.model import Flight
from ...models.flight.voxels import VoxelMap
from ...models.grid_path.gridmap import MOST, GridMap, enlarged

__all__ = ["Lattice", "is_safe", "lattice", "way"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Margin of a line of sight in cells.
MARGIN = 0.3
#: Number of free cells near a place that are tried as ends of a straight segment to the place.
NEAREST = 64
#: Largest number of cells of a map whose cells are divided.
FINEST = 2**24
#: Largest number of pairs of a cell and a point per step of the rasterisation of points.
_CHUNK = 2_000_000


class Lattice(NamedTuple):
    """Cells of a planner.

    Parameters
    ----------
    blocked : ndarray of bool, one dimension per axis
        Whether a position in the cell may be forbidden for the vehicle's centre.
    cell : float
        Side of a cell in metres.
    origin : ndarray, shape (axes,)
        Lowest corner in metres.
    """

    blocked: Truths
    cell: float
    origin: Floats

    def centres(self, cells: Ints) -> Floats:
        """Return the centres of cells, shape (n, axes), m."""
        return np.asarray(self.origin + (cells + 0.5) * self.cell)


def lattice(model: Flight, parts: int = 1) -> Lattice | None:
    """Return the cells of a flight's map that are safe for the vehicle's centre, each side in `parts`.

    None if they are too many, or none of them is free.
    """
    space, source, cell = model.space, model.map, model.cell / parts
    most = MOST if parts == 1 else FINEST
    if isinstance(source, GridMap | VoxelMap):
        blocked = space.blocked
        if blocked.size * parts**blocked.ndim > most:
            return None
        for axis in range(blocked.ndim if parts > 1 else 0):
            blocked = blocked.repeat(parts, axis=axis)
        blocked = enlarged(blocked, model.radius / cell * (1 - 1e-12))
        origin = source.origin
    else:
        low, high = space.extent(model.places)
        count = np.maximum(np.ceil((high - low) / cell), 1.0)
        if not count.prod() <= most:
            return None
        origin = low
        if isinstance(source, tuple):
            try:
                corners = np.concatenate([low, low + count * cell])
                blocked = GridMap.from_polygons(source, corners, cell, model.radius).blocked.T
            except InvalidData:  # no cell is free
                return None
        else:
            blocked = _near_points(source, count.astype(int), cell, origin, model.radius)
    low, high = ((corner - origin) / cell for corner in space.bounds)
    for axis, size in enumerate(blocked.shape):
        index = np.arange(size)
        beyond = (index < low[axis] - 1e-9) | (index + 1 > high[axis] + 1e-9)
        if beyond.any():
            blocked = blocked | beyond.reshape(
                [-1 if k == axis else 1 for k in range(blocked.ndim)]
            )
    return Lattice(blocked, cell, origin) if not blocked.all() else None


def _near_points(points: Floats, count: Ints, cell: float, origin: Floats, radius: float) -> Truths:
    """Return the cells with a position nearer than `radius`, m, to a point."""
    blocked = np.zeros(count, bool)
    reach = int(np.ceil(radius / cell)) + 1
    shifts = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * len(count)), axis=-1)
    shifts = shifts.reshape(-1, len(count))
    scaled = (points - origin) / cell
    for begin in range(0, len(points), max(_CHUNK // len(shifts), 1)):
        part = scaled[begin : begin + max(_CHUNK // len(shifts), 1), None]
        cells = np.floor(part) + shifts
        gaps = np.maximum(np.maximum(cells - part, part - cells - 1.0), 0.0)
        near = (gaps * gaps).sum(axis=2) < (radius / cell) ** 2 * (1 - 1e-12)
        near &= ((cells >= 0) & (cells < count)).all(axis=2)
        blocked[tuple(cells[near].astype(int).T)] = True
    return blocked


def way(model: Flight, cells: Lattice, flag: NDArray[np.int8]) -> tuple[Floats, Ints] | None:
    """Return a polyline over free cells from the start past the waypoints to the goal.

    It has the points, m, shape (n, axes), and the index of the start, of each waypoint and of the goal among
    them. None if a place is not connected. A nonzero `flag` stops the search.
    """
    from .kernels import shortened, walk

    blocked, axes = cells.blocked, model.dimensions
    solid = blocked if axes == 3 else blocked[:, :, None]
    walls = np.pad(solid, 1, constant_values=True).astype(np.uint8)
    rows, layers = walls.shape[1:]
    flat = walls.ravel()
    margin = np.array([MARGIN, MARGIN, MARGIN if axes == 3 else 0.0])
    doors = [_door(model, cells, place) for place in model.places]
    points, stops = [model.places[0]], [0]
    for k, (first, last) in enumerate(itertools.pairwise(doors)):
        if first is None or last is None:
            return None
        start, goal = model.places[k], model.places[k + 1]
        if np.linalg.norm(goal - start) <= 1e-9 * model.cell:
            stops.append(stops[-1])
            continue
        begin, end = (_number(door, rows, layers) for door in (first, last))
        route = walk(flat, rows, layers, begin, end, flag)[::-1]
        if not len(route):
            return None
        index = np.stack([route // (rows * layers), route // layers % rows, route % layers], axis=1)
        scaled = index + 0.5
        whole = np.ones((2, 3)) * 1.5
        whole[:, :axes] = (np.stack([start, goal]) - cells.origin) / cells.cell + 1.0
        scaled = np.concatenate([whole[:1], scaled, whole[1:]])
        kept = shortened(flat, rows, layers, scaled, margin)
        leg = cells.origin + (scaled[kept, :axes] - 1.0) * cells.cell
        leg[-1] = goal
        apart = np.linalg.norm(np.diff(leg, axis=0), axis=1) > 1e-6 * cells.cell
        apart[-1] = True
        points += list(leg[1:][apart])
        stops.append(len(points) - 1)
    return np.array(points), np.array(stops)


def _number(cell: Ints, rows: int, layers: int) -> int:
    """Return the number of a cell in the framed map."""
    x, y, z = [*(cell + 1).tolist(), 1][:3]
    return int((x * rows + y) * layers + z)


def _door(model: Flight, cells: Lattice, place: Floats) -> Ints | None:
    """Return a free cell near a place with a safe straight segment between its centre and the place."""
    index = np.floor((place - cells.origin) / cells.cell).astype(int)
    index = np.clip(index, 0, np.subtract(cells.blocked.shape, 1))
    reach = 4 + int(min(model.radius / cells.cell, max(cells.blocked.shape)))
    low = np.maximum(index - reach, 0)
    part = cells.blocked[tuple(slice(a, b) for a, b in zip(low, index + reach + 1, strict=True))]
    free = np.argwhere(~part) + low
    if not len(free):
        return None
    centres = cells.centres(free)
    order = np.argsort(np.linalg.norm(centres - place, axis=1), kind="stable")[:NEAREST]
    for k in order.tolist():
        if is_safe(model, np.stack([place, centres[k]])):
            result: Ints = free[k]
            return result
    return None


def is_safe(model: Flight, points: Floats) -> bool:
    """Return whether a polyline, shape (n, axes), is away from all obstacles and within the bounds."""
    if not len(points) > 1:
        return True
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    times = np.arange(len(pairs), dtype=float)
    pieces = Pieces(pairs, np.stack([times, times + 1.0], axis=1), np.zeros(len(pairs), np.int64))
    slack = 1e-8 * model.cell + 1e-13 * float(np.abs(points).max())
    low, high = model.space.bounds
    if (points < low - slack).any() or (points > high + slack).any():
        return False
    return deepest([pieces], model.space.solids, model.radius, slack, model.cell)[0] <= slack
