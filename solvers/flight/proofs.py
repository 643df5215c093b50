"""Statements about every plan of a flight: that no way exists, and least flight times."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.flight.model import Flight, FlightObjective
from ...models.flight.voxels import VoxelMap
from ...models.grid_path import as_shapely
from ...models.grid_path.gridmap import MOST, GridMap
from ...models.verification import TOLERANCE
from .course import top_speed

__all__ = ["Separation", "least_objective", "separations"]

Truths = NDArray[np.bool_]

#: Least reserve for the depth, in cells, to which a plan may enter obstacles, and reserve per tolerance.
SLACK, RESERVE = 1e-3, 10.0


class Separation(NamedTuple):
    """Two consecutive places of a flight that no curve connects, and the reason."""

    first: str
    second: str
    reason: str

    def __str__(self) -> str:
        return f"no way from the {self.first} to the {self.second}: {self.reason}"


def separations(model: Flight, tolerance: float = TOLERANCE) -> list[Separation]:
    """Return the consecutive places of a flight that are proven to be separated by obstacles.

    The free space is enlarged to cells, or to a polygon, that contain it. If two places are in different
    components of the enlarged space, no continuous curve connects them. `tolerance` is that of the verification.
    """
    slack = max(SLACK, RESERVE * tolerance)
    if slack >= 0.5:  # a plan may cross a cell
        return []
    names = ["start", *(f"waypoint {k}" for k in range(len(model.waypoints))), "goal"]
    regions = _polygon_regions if isinstance(model.map, tuple) else _cell_regions
    owners, describe = regions(model, slack)
    pairs = itertools.pairwise(zip(names, owners, strict=False))
    return [
        Separation(first, second, describe(min(one)))
        for (first, one), (second, other) in pairs
        if one and other and not one & other
    ]


def _cell_regions(model: Flight, slack: float) -> tuple[list[set[int]], Any]:
    """Return the components of the cells at each place, and a function that describes a component.

    There are no components if the cells are too many. A cell is closed if all its positions are forbidden.
    Cells that touch at a corner are connected for a vehicle without extent. Another one passes from cell to
    cell over common faces only.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt, label

    half = 0.5 * math.sqrt(model.dimensions)
    reach = model.radius / model.cell - slack
    if isinstance(model.map, GridMap | VoxelMap):
        origin, closed = model.map.origin, model.space.blocked.copy()
        if reach > half and closed.any():
            # The distance of a position from the centre of a blocked cell exceeds that from the cell.
            closed |= distance_transform_edt(~closed) + half < reach
    else:
        from scipy.spatial import cKDTree

        low, high = model.space.extent(model.places)
        count = np.ceil((high - low) / model.cell).astype(int) + 2
        if not len(model.map) or not np.prod(count, dtype=float) <= MOST:
            return [], str
        origin = low - model.cell  # a frame of free cells, as the space around is free
        places = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1) + 0.5
        away = cKDTree((model.map - origin) / model.cell).query(places.reshape(-1, len(count)))[0]
        closed = (away.reshape(count) + half) < reach
    everything = np.ones((3,) * closed.ndim, bool)
    is_lattice = isinstance(model.map, GridMap | VoxelMap)
    regions = label(~closed, None if is_lattice and reach > 0.0 else everything)[0]
    shifts = np.array(list(itertools.product((-slack, slack), repeat=closed.ndim)))
    owners = []
    for place in model.places:
        cells = np.floor((place - origin) / model.cell + shifts).astype(int)
        cells = cells[((cells >= 0) & (cells < closed.shape)).all(axis=1)]
        owners.append({int(region) for region in regions[tuple(cells.T)]} - {0})

    def describe(region: int) -> str:
        inside = regions == region
        wall = np.argwhere(binary_dilation(inside, everything) & closed)
        order = "row, column" if isinstance(model.map, GridMap) else "cell"
        shown = wall[:3, ::-1] if isinstance(model.map, GridMap) else wall[:3]
        return (
            f"its region has {inside.sum()} cells of {model.cell:g} m and is enclosed by {len(wall)} "
            f"forbidden cells and the bounds, among them {order} "
            + ", ".join(str(tuple(cell)) for cell in shown.tolist())
        )

    return owners, describe


def _polygon_regions(model: Flight, slack: float) -> tuple[list[set[int]], Any]:
    """Return the parts of the free space at each place, and a function that describes a part."""
    import shapely

    assert isinstance(model.map, tuple)
    slack *= model.cell
    # Arcs of a buffer are polygons inside the true arcs, so that the free space is not too small.
    solid = shapely.buffer(shapely.union_all(as_shapely(model.map)), model.radius - 2.0 * slack)
    low, high = model.space.extent(model.places)
    frame = shapely.box(*(low - slack), *(high + slack))
    parts = shapely.get_parts(shapely.difference(frame, solid))
    places = shapely.points(model.places)
    owners = [
        set(np.flatnonzero(shapely.distance(parts, place) <= slack).tolist()) for place in places
    ]
    owners = [{part + 1 for part in owner} for owner in owners]

    def describe(part: int) -> str:
        return (
            f"its part of the free space has an area of {shapely.area(parts[part - 1]):.4g} m² and "
            f"is one of {len(parts)} parts"
        )

    return owners, describe


def least_objective(model: Flight, tolerance: float = TOLERANCE) -> float:
    """Return a lower bound on the objective of every plan that the verification accepts at `tolerance`.

    It is the time along straight lines between the places within the limits of speed and acceleration, from
    rest to rest; no other way is shorter.
    """
    lengths = np.linalg.norm(np.diff(model.places, axis=0), axis=1)
    # Plans may miss each place by the tolerance.
    length = float(np.maximum(lengths - RESERVE * tolerance * model.cell, 0.0).sum())
    speed, push = _limits(model)
    at_rest = not (model.start_velocity.any() or model.goal_velocity.any())
    time = length / speed
    if at_rest and push < math.inf:
        time = 2.0 * math.sqrt(length / push)
        if length > speed**2 / push:
            time = length / speed + speed / push
    time *= max(1.0 - RESERVE * tolerance, 0.0)  # limits are kept within the tolerance
    return time if model.objective is FlightObjective.TIME else model.time_weight * time


def _limits(model: Flight) -> tuple[float, float]:
    """Return upper bounds on the speed and on the acceleration of the vehicle."""
    vehicle: Any = model.vehicle
    speed = top_speed(vehicle)
    push = getattr(vehicle, "acceleration", None)
    push = math.inf if push is None else push
    if getattr(vehicle, "thrust", None) is not None:
        drag = vehicle.drag * speed if vehicle.drag else 0.0
        push = min(push, (vehicle.thrust[1] + drag) / vehicle.mass + vehicle.gravity)
    wheel = getattr(vehicle, "wheel_acceleration", None)
    # The acceleration along the path is the mean of both wheels.
    return speed, min(push, math.inf if wheel is None else wheel)
