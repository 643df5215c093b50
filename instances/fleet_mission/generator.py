"""Seeded missions with the paper's numbers: irregular polygons, and nodes that can be reached."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...models.fields import Array
from ...models.fleet_mission.model import FleetMission
from ...models.grid_path.gridmap import GridMap
from ..grid_path.generators import random_nodes, random_polygons

__all__ = ["random_mission"]


def random_mission(
    nodes: int = 75,
    obstacles: int = 28,
    vehicles: int = 4,
    seed: int = 0,
    *,
    bounds: ArrayLike = (0.0, 0.0, 200.0, 200.0),
    cell: float = 1.0,
    radius: float = 1.0,
    velocity_limit: float = 3.0,
    acceleration_limit: float = 2.0,
    separation: float | None = None,
    size: float = 1.0,
    depot: ArrayLike | None = None,
) -> FleetMission:
    """Return a mission over nodes drawn at random among irregular polygons.

    Parameters
    ----------
    nodes, obstacles : int
        Their numbers (section 4.4 of the paper: 75 and 28).
    vehicles : int
        Number of robots (section 4.4 of the paper: 4).
    seed : int
        Seed of the polygons and the nodes.
    bounds : array-like, shape (4,)
        Least x and y, greatest x and y, m.
    cell, radius, velocity_limit, acceleration_limit, separation
        Those of :class:`~crosstrack.models.FleetMission`.
    size : float
        Factor on the size of polygons, which otherwise cover about 15 % of the map.
    depot : array-like, shape (2,), optional
        x, y, m; by default the middle of the bounds. Figure 2 of the paper has it at the bottom left.

    Returns
    -------
    FleetMission

    Raises
    ------
    InvalidData
        The map has no room for so many polygons or nodes.
    """
    corners = Array((4,)).coerce("bounds", bounds, {})
    place = 0.5 * (corners[:2] + corners[2:])
    if depot is not None:
        place = Array((2,)).coerce("depot", depot, {})
    # A robot passes between any two polygons, wherever the lines of the grid are.
    gap = 2.0 * radius + 2.0 * cell
    polygons = random_polygons(obstacles, seed, corners, keep=[place], gap=gap, size=size)
    grid = GridMap.from_polygons(polygons, corners, cell, radius)
    return FleetMission(
        obstacles=polygons,
        bounds=corners,
        nodes=random_nodes(grid, place, nodes, seed),
        depot=np.asarray(place),
        vehicles=vehicles,
        cell=cell,
        radius=radius,
        velocity_limit=np.full(2, velocity_limit),
        acceleration_limit=np.full(2, acceleration_limit),
        separation=2.0 * radius if separation is None else separation,
    )
