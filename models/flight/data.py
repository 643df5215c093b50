"""Data of a flight: map, ends, vehicle, and derived quantities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Listed
from ..fields import Array, Optional, Real, Whole, declared, frozen, show
from ..fleet_mission.moving import MovingObstacle
from ..grid_path.gridmap import GridMap
from ..inputs import Field, FloatArray, FloatsOrNone, Numbers
from ..minimum_snap.trajectory import Trajectory
from ..minimum_snap.vehicles import Vehicle, VehicleSpec
from ..model import Model
from ..records import Member
from .obstacles import FlightMap, Maps, Space
from .plan import FlightPlan
from .voxels import VoxelMap

__all__ = ["FlightData", "FlightObjective"]

Floats = NDArray[np.float64]

#: Number of planner cells along the longest side of a map without cells, by the number of axes.
CELLS = {2: 200.0, 3: 64.0}
#: Quantities that depend on the jerk, which is free at the start.
_JERKY = ("rate", "wheel acceleration")
_ENDS = ("start_velocity", "start_acceleration", "goal_velocity", "goal_acceleration")


class FlightObjective(StrEnum):
    """Objective of a flight."""

    TIME = "time"  #: The flight time T.
    #: J + ρ T with J = ∫ (x^(r))² dt over all axes and the weight ρ.
    WEIGHTED = "weighted"


@dataclass(frozen=True, eq=False, repr=False)
class FlightData(Model[FlightPlan]):
    """Fields of :class:`~crosstrack.models.Flight`, documented there."""

    map: Field[FlightMap | Mapping[str, Any] | list[Any], FlightMap] = declared(Maps())
    start: FloatArray = declared(Array(("axes",), unit="m"))
    goal: FloatArray = declared(Array(("axes",), unit="m"))
    vehicle: Field[Vehicle | Mapping[str, Any], Vehicle] = declared(VehicleSpec())
    radius: float = declared(Real(lower=0, unit="m"), default=0.0)
    start_velocity: Field[Numbers | None, Floats] = declared(
        Optional(Array(("axes",), unit="m/s")), default=None
    )
    start_acceleration: Field[Numbers | None, Floats] = declared(
        Optional(Array(("axes",), unit="m/s²")), default=None
    )
    goal_velocity: Field[Numbers | None, Floats] = declared(
        Optional(Array(("axes",), unit="m/s")), default=None
    )
    goal_acceleration: Field[Numbers | None, Floats] = declared(
        Optional(Array(("axes",), unit="m/s²")), default=None
    )
    waypoints: FloatArray = declared(Array(("stops", "axes"), unit="m"), default=())
    order: int = declared(Whole(3, 4), default=3)
    objective: Field[str, FlightObjective] = declared(
        Member(FlightObjective), default=FlightObjective.TIME
    )
    time_weight: float = declared(Real(lower=0, strict=True), default=20.0)
    bounds: FloatsOrNone = declared(Optional(Array(("sides",), unit="m")), default=None)
    cell: Field[float | None, float] = declared(
        Optional(Real(lower=0, strict=True, unit="m")), default=None
    )
    moving: Field[Sequence[Any], tuple[MovingObstacle, ...]] = declared(
        Listed(MovingObstacle), default=()
    )

    @property
    def objective_unit(self) -> str:  # type: ignore[override]
        """Unit of the objective."""
        return "s" if self.objective is FlightObjective.TIME else f"m²/s^{2 * self.order - 1}"

    # -- checks ----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # distances that overflow are refused
    def check(self) -> None:
        """Fill in the defaults and refuse data that contradict each other."""
        axes = self._space_axes()
        if self.start.size != axes:
            raise InvalidData(
                f"start must have {axes} coordinates, as the map, got {self.start.size}",
                field="start",
            )
        self.vehicle.require_axes(axes, "map")
        for name in _ENDS:
            if getattr(self, name) is None:
                object.__setattr__(self, name, frozen(np.zeros(axes)))
        if isinstance(self.map, np.ndarray) and self.radius == 0:
            raise InvalidData("radius must be > 0 m with a map of points, got 0", field="radius")
        if self.bounds is not None and (
            self.bounds.size != 2 * axes or not (self.bounds[:axes] < self.bounds[axes:]).all()
        ):
            raise InvalidData(
                f"bounds must hold {axes} lowest, then {axes} higher coordinates, got "
                f"{show(self.bounds.tolist())}",
                field="bounds",
            )
        for k, obstacle in enumerate(self.moving):
            if obstacle.dimensions != axes:
                raise InvalidData(
                    f"moving[{k}] must have {axes} axes, as the map, got {obstacle.dimensions}",
                    field="moving",
                )
        if self.objective is FlightObjective.TIME and not self.vehicle.limits:
            raise InvalidData(
                "vehicle must have a limit with the objective 'time', got none: pass a speed or an "
                "acceleration, or objective='weighted'",
                field="vehicle",
            )
        self._complete_cell()
        self._check_places()
        self._check_ends()

    def _space_axes(self) -> int:
        return Space(self.map, self.radius, None).axes

    def _complete_cell(self) -> None:
        """Set the side of the planner's cells, or refuse one that differs from the map's."""
        if isinstance(self.map, GridMap | VoxelMap):
            if self.cell is not None and self.cell != self.map.cell:
                raise InvalidData(
                    f"cell must be that of the map, {self.map.cell:g} m, or None, got "
                    f"{self.cell:g}",
                    field="cell",
                )
            object.__setattr__(self, "cell", self.map.cell)
        largest = float(np.abs(self.places).max())
        if self.cell is None:
            side = float(np.ptp(self.space.extent(self.places), axis=0).max())
            side = side / CELLS[self.space.axes] or 1e-3 * largest or 1.0
            object.__setattr__(self, "cell", max(side, 1e-8 * largest))
        if not (np.isfinite(largest) and self.cell >= 1e-9 * largest):
            raise InvalidData(
                f"start, goal and waypoints must be nearer than 1e9 cells of {self.cell:g} m to the "
                f"origin, got {largest:g} m",
                field="start",
            )

    def _check_places(self) -> None:
        """Refuse places out of bounds or too near to an obstacle."""
        low, high = self.space.bounds
        depths = self.space.solids.depths(self.places, self.radius)
        names = ["start", *(f"waypoints[{k}]" for k in range(len(self.waypoints))), "goal"]
        for name, place, depth in zip(names, self.places, depths.tolist(), strict=True):
            at = f"{name} at {show(place.tolist())}"
            field = name.partition("[")[0]
            if (place < low).any() or (place > high).any():
                raise InvalidData(
                    f"{at} must be within {show(low.tolist())} … {show(high.tolist())} m",
                    field=field,
                )
            if not depth <= 1e-9 * self.cell:  # contact is allowed
                raise InvalidData(
                    f"{at} must be at least radius = {self.radius:g} m away from obstacles, got "
                    f"{self.radius - depth:g} m"
                    + (" (inside an obstacle)" if depth > self.radius else ""),
                    field=field,
                )

    def _check_ends(self) -> None:
        """Refuse velocities and accelerations at the ends that exceed the vehicle's limits."""
        for end in ("start", "goal"):
            velocity, push = (
                getattr(self, f"{end}_{what}") for what in ("velocity", "acceleration")
            )
            sizes = float(np.linalg.norm(velocity)), float(np.linalg.norm(push))
            if not any(sizes):
                continue
            # The motion changes by a millionth within this time.
            brief = 1e-6 * (sizes[0] / sizes[1] if all(sizes) else 1.0)
            terms = np.stack([0.0 * velocity, velocity * brief, 0.5 * push * brief**2])
            motion = Trajectory(np.array([0.0, brief]), terms[None])
            for extreme in self.vehicle.check_curve(motion):
                name, worst, limit = extreme.name, extreme.amount, extreme.limit
                if any(word in name for word in _JERKY) or worst <= 1e-5 * abs(limit):
                    continue
                field = f"{end}_{'velocity' if 'speed' in name else 'acceleration'}"
                raise InvalidData(
                    f"{field} = {show(getattr(self, field).tolist())} must keep the vehicle's limit "
                    f"of {name}, {limit:g} {extreme.unit}, got {worst:g} {extreme.unit} beyond it",
                    field=field,
                )

    # -- derived quantities ----------------------------------------------------------------------

    @cached_property
    def space(self) -> Space:
        """Free space of the map."""
        bounds = None if self.bounds is None else self.bounds.reshape(2, -1)
        return Space(self.map, self.radius, bounds)

    @cached_property
    def places(self) -> Floats:
        """Positions of the start, the waypoints and the goal, m, shape (k + 2, axes)."""
        return frozen(np.concatenate([self.start[None], self.waypoints, self.goal[None]]))

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        return int(self.start.size)
