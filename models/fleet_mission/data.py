"""Data of a fleet mission: obstacles, nodes, robots, limits, and derived quantities."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, Whole, declared, frozen, show
from ..fleet.data import Deviation
from ..grid_path.gridmap import GridMap
from ..grid_path.polygons import Polygon, Polygons, as_shapely
from ..inputs import Field, FloatArray, Names
from ..labels import Ids
from ..model import Model
from ..records import Member, Several
from .moving import Movers, MovingObstacle
from .plan import MissionPlan

if TYPE_CHECKING:
    from .collision import Solids

__all__ = ["MissionData", "MissionObjective"]

Floats = NDArray[np.float64]

#: Maximum number of robots, as the separation check compares all pairs.
MOST = 200
#: Largest radius and coordinate of a moving obstacle, m.
FARTHEST = 1e100


class MissionObjective(StrEnum):
    """Objective to minimise: the time of return, or a function of the lengths L_1 … L_m of the curves."""

    SUM = "sum"  #: Σ L_k (eq. 15)
    MAX = "max"  #: max L_k
    VARIANCE = "sum-variance"  #: Σ L_k + q Y, with their variance Y (eq. 15 and 16)
    DEVIATION = "sum-deviation"  #: Σ L_k + q s, with their standard deviation s
    RANGE = "range"  #: max L_k - min L_k
    LEXICOGRAPHIC = "max-sum"  #: max L_k, then Σ L_k: max L_k + 1e-6 Σ L_k
    MAKESPAN = "makespan"  #: time at which the last robot is back, counted from 0, in seconds


class Goal(Member):
    """Objective of a mission, with the digest of fleet routing's names, of which it once was a member."""

    def feed(self, value: StrEnum) -> Iterable[bytes]:
        yield f"<Objective.{value.name}: {value.value!r}>".encode()


class EachAxis(Array):
    """Array with one positive number per axis; a scalar applies to both."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        array = self._numbers(name, value)
        numbers = super().coerce(name, np.full(2, array) if array.ndim == 0 else array, sizes)
        self._refuse(name, numbers, numbers <= 0, "must be > 0")
        return numbers


@dataclass(frozen=True, eq=False, repr=False)
class MissionData(Model[MissionPlan]):
    """Fields of :class:`~crosstrack.models.FleetMission`, documented there."""

    obstacles: Field[Iterable[Any], tuple[Polygon, ...]] = declared(Polygons())
    bounds: FloatArray = declared(Array((4,), unit="m"))
    nodes: FloatArray = declared(Array(("n", 2), unit="m"))
    depot: FloatArray = declared(Array((2,), unit="m"))
    vehicles: int = declared(Whole(1, MOST))
    cell: float = declared(Real(lower=0, strict=True, unit="m"), default=1.0)
    radius: float = declared(Real(lower=0, unit="m"), default=0.0)
    velocity_limit: FloatArray = declared(EachAxis((2,), unit="m/s"), default=1.0)
    acceleration_limit: FloatArray = declared(EachAxis((2,), unit="m/s²"), default=1.0)
    separation: Field[float | None, float] = declared(
        Optional(Real(lower=0, unit="m")), default=None
    )
    depot_radius: Field[float | None, float] = declared(
        Optional(Real(lower=0, unit="m")), default=None
    )
    objective: Field[str, MissionObjective] = declared(
        Goal(MissionObjective), default=MissionObjective.DEVIATION
    )
    q: float = declared(Real(lower=0), default=0.4)
    deviation: Field[str, Deviation] = declared(Member(Deviation), default=Deviation.SAMPLE)
    ids: Names = declared(Optional(Ids()), default=None)
    continuity: int = declared(Whole(2, 3), default=3, added=True)
    moving: Field[Iterable[Any], tuple[MovingObstacle, ...]] = declared(
        Several(Movers(MovingObstacle)), default=(), added=True
    )

    # -- checks ----------------------------------------------------------------------------------

    def check(self) -> None:
        """Refuse places without room for a robot, and unreachable nodes."""
        if self.separation is None:
            # Resolved here, so that the default and the same explicit value have the same digest.
            object.__setattr__(self, "separation", 2.0 * self.radius)
        if self.depot_radius is not None:
            warnings.warn(
                "depot_radius has no effect any more: robots under way keep the separation "
                "everywhere, and wait in the depot's queue before and after",
                DeprecationWarning,
                stacklevel=2,
            )
            object.__setattr__(self, "depot_radius", None)
        count = len(self.nodes)
        if not count:
            raise InvalidData("nodes must hold at least one node, got none", field="nodes")
        if self.vehicles > count:
            raise InvalidData(
                f"vehicles must be at most the {count} nodes to visit, got {self.vehicles}",
                field="vehicles",
            )
        grid = self.map
        if not self.cell >= 1e-9 * float(np.abs(self.nodes).max()):
            raise InvalidData(
                f"nodes must be nearer than 1e9 cells of {self.cell:g} m to the origin",
                field="nodes",
            )
        for k, item in enumerate(self.moving):
            extent = max(item.radius, float(np.abs(item.trajectory.coefficients).max()))
            if extent > FARTHEST:  # squares would overflow
                raise InvalidData(
                    f"moving[{k}] must have radius and positions up to {FARTHEST:g} m, got {extent:g} m",
                    field="moving",
                )
        places = [("depot", "depot", self.depot)]
        places += [
            ("nodes", f"nodes[{k}] (node {self.label(k)})", node)
            for k, node in enumerate(self.nodes)
        ]
        points = np.concatenate([self.depot[None], self.nodes])
        self._check_room(places, points)
        blocked = np.flatnonzero(~grid.holds(self.cells))
        if blocked.size:
            field, name, place = places[int(blocked[0])]
            raise InvalidData(
                f"{name} at {show(place.tolist())} must lie in a cell that is free as a whole: cells "
                f"of {self.cell:g} m are too coarse there, take a smaller cell",
                field=field,
            )
        regions = self._regions
        components = regions[self.cells[:, 0], self.cells[:, 1]]
        cut_off = np.flatnonzero(components != components[0])
        if cut_off.size:
            k = int(cut_off[0]) - 1
            raise InvalidData(
                f"nodes[{k}] (node {self.label(k)}) at {show(self.nodes[k].tolist())} cannot be "
                f"reached from the depot by a robot of radius {self.radius:g} m over cells of "
                f"{self.cell:g} m",
                field="nodes",
            )

    def _check_room(self, places: list[tuple[str, str, Floats]], points: Floats) -> None:
        """Refuse places out of bounds, within obstacles or too near to one."""
        depths = self.solids.depths(points, self.radius)
        within = np.asarray(self.solids.depths(points, 0.0) > 0)
        beyond = (points < self.bounds[:2]) | (points > self.bounds[2:])
        outside = np.asarray(beyond.any(axis=1))
        # Contact is allowed; the tolerance absorbs rounding.
        near = np.asarray(depths > 1e-9 * self.cell)
        for k in np.flatnonzero(outside | within | near)[:1].tolist():
            field, name, place = places[k]
            at = f"{name} at {show(place.tolist())}"
            if outside[k]:
                message = f"{at} must lie within the bounds {show(self.bounds.tolist())}"
            elif within[k]:
                message = f"{at} must not lie within an obstacle, got one {depths[k]:g} m deep"
            else:
                message = (
                    f"{at} must be at least radius = {self.radius:g} m away from obstacles, got "
                    f"{self.radius - depths[k]:g} m"
                )
            raise InvalidData(message, field=field)

    # -- derived quantities ----------------------------------------------------------------------

    @cached_property
    def map(self) -> GridMap:
        """Grid map whose free cells are safe for a robot's centre."""
        try:
            return GridMap.from_polygons(self.obstacles, self.bounds, self.cell, self.radius)
        except InvalidData as error:
            if error.field != "blocked":
                raise
            raise InvalidData(
                f"obstacles must leave a cell of {self.cell:g} m free for a robot of radius "
                f"{self.radius:g} m, got none within the bounds",
                field="obstacles",
            ) from None

    @cached_property
    def solids(self) -> Solids:
        """Obstacles as disjoint shapely polygons."""
        from .collision import Solids

        return Solids(as_shapely(self.obstacles))

    @cached_property
    def places(self) -> Floats:
        """Positions of the depot and the nodes, m, shape (n + 1, 2)."""
        return frozen(np.concatenate([self.depot[None], self.nodes]))

    @cached_property
    def _regions(self) -> NDArray[np.signedinteger[Any]]:
        """Connected component of each free cell, 0 for blocked cells."""
        from scipy.ndimage import label

        # Diagonal steps must not cut corners, so four neighbours give the same components as eight.
        return np.asarray(label(~self.map.blocked)[0])

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """Rows and columns of the cells of :attr:`places`, shape (n + 1, 2).

        A place between cells gets a free cell, connected to the depot's cell if possible.
        """
        shifts = 1e-9 * np.array([(x, y) for x in (0.0, -1.0, 1.0) for y in (0.0, -1.0, 1.0)])
        beside = self.map.cells_of(self.places + self.cell * shifts[:, None])
        free = self.map.holds(beside)
        safe = np.where(free[..., None], beside, 0)
        region = np.where(free, self._regions[safe[..., 0], safe[..., 1]], 0)
        first = np.argmax(free, axis=0)
        home = region[first[0], 0]
        chosen = np.where((region == home).any(axis=0), np.argmax(region == home, axis=0), first)
        return frozen(beside[chosen, np.arange(len(self.places))])

    def label(self, node: int) -> str:
        """Return the name of `node`: its id, or its index."""
        return str(node if self.ids is None else self.ids[node])
