"""Data of a messenger tour: vehicles, UAV and start."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Optional, Real, Whole, declared, show
from ..inputs import Field, FloatArray, FloatsOrNone, Names, Numbers
from ..labels import Ids
from ..model import Model
from .plan import TourPlan
from .zones import Zones, is_inside

__all__ = ["TourData"]

Floats = NDArray[np.float64]


#: Default start of the path: x, y (m) and heading (rad).
START = (0.0, 0.0, 0.5 * math.pi)


class EachVehicle(Array):
    """One number per vehicle; a scalar is broadcast to all vehicles."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        given = self._numbers(name, value)
        if given.ndim == 0:
            given = np.full(sizes["n"][0], Real(self.lower).coerce(name, value, {}))
        return super().coerce(name, given, sizes)


class Crew(Array):
    """Start of each UAV, shape (m, 2) or (m, 3), or their number m, stored as shape (m, 0)."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        if not isinstance(value, list | tuple) and np.ndim(value) == 0:
            value = np.zeros((Whole(1, 10_000).coerce(name, value, {}), 0))
        starts = super().coerce(name, value, sizes)
        if not len(starts) or starts.shape[1] not in (0, 2, 3):
            raise InvalidData(
                f"{name} must be a number of UAVs, or x, y and possibly a heading per UAV, got "
                f"{show(value)}",
                field=name,
            )
        return starts

    def encode(self, value: NDArray[Any]) -> Any:
        return super().encode(value) if value.shape[1] else len(value)


@dataclass(frozen=True, eq=False, repr=False)
class TourData(Model[TourPlan]):
    """Data fields of :class:`~crosstrack.models.messenger.model.MessengerTour`, which documents them."""

    positions: FloatArray = declared(Array(("n", 2), unit="m"))
    velocities: Field[Numbers | None, Floats] = declared(
        Optional(Array(("n", 2), unit="m/s")), default=None
    )
    radius: FloatArray = declared(EachVehicle(("n",), lower=0, unit="m"), default=5.0)
    speed: float = declared(Real(lower=0, strict=True, unit="m/s"), default=10.0)
    turning_radius: float = declared(Real(lower=0, unit="m"), default=5.0)
    start: FloatsOrNone = declared(Optional(Array(("k",))), default=START)
    closed: bool = declared(Flag(), default=False)
    ids: Names = declared(Optional(Ids()), default=None)
    wind: FloatsOrNone = declared(Optional(Array((2,), unit="m/s")), default=None, added=True)
    home_velocity: FloatsOrNone = declared(
        Optional(Array((2,), unit="m/s")), default=None, added=True
    )
    uavs: Field[int | Numbers | None, Floats | None] = declared(
        Optional(Crew(("uavs", "columns"))), default=None, added=True
    )
    no_fly: Field[Any, tuple[Floats, ...] | None] = declared(
        Optional(Zones()), default=None, added=True
    )
    windows: FloatsOrNone = declared(
        Optional(Array(("n", 2), infinity=1, unit="s")), default=None, added=True
    )

    def check(self) -> None:
        """Fill in the velocities and validate vehicles and start."""
        if not self.size:
            raise InvalidData(
                "positions must hold at least one vehicle, got none", field="positions"
            )
        if self.velocities is None:
            rest = Array(("n", 2)).coerce("velocities", np.zeros((self.size, 2)), {})
            object.__setattr__(self, "velocities", rest)
        for name in ("wind", "home_velocity"):
            value = getattr(self, name)
            # Calm air and a home at rest are the defaults.
            if value is not None and not value.any():
                object.__setattr__(self, name, None)
        self._check_crew()
        self._check_zones()
        self._check_windows()
        fast = np.hypot(*self.drifts.T)
        relative = "" if self.wind is None else " relative to the air"
        if not (fast < self.speed).all():
            row = int(np.flatnonzero(~(fast < self.speed))[0])
            raise InvalidData(
                f"velocities[{row}] must be slower than the UAV, {self.speed:g} m/s{relative}: it might "
                f"never be caught; got {show(self.velocities[row].tolist())}, {fast[row]:g} "
                f"m/s{relative}",
                field="velocities",
            )
        self._check_home(relative)
        if self.start is None:
            if not self.closed or not self.at_rest or self.wind is not None:
                raise InvalidData(
                    "start must be given, got None: only a closed tour over vehicles at rest may "
                    "begin anywhere",
                    field="start",
                )
        elif self.start.size not in (2, 3):
            raise InvalidData(
                f"start must be x, y and possibly a heading, got {self.start.size} numbers",
                field="start",
            )

    def _check_crew(self) -> None:
        """Fill in the start of the first UAV, and reduce one UAV to the default."""
        if self.uavs is None:
            return
        given = () if self.start is None else tuple(self.start.tolist())
        own = self.uavs.shape[1] > 0
        first = Array(("k",)).coerce("start", self.uavs[0], {}) if own else self.start
        if first is None or (own and given not in (START, tuple(first.tolist()))):
            raise InvalidData(
                "start must be given for several UAVs, or omitted if uavs has the start of each; got "
                f"{show(self.start)}",
                field="start",
            )
        object.__setattr__(self, "start", first)
        if len(self.uavs) == 1:
            object.__setattr__(self, "uavs", None)

    def _check_zones(self) -> None:
        """Validate the no-fly zones, which are at rest in calm air and do not contain a start."""
        if not self.no_fly:
            object.__setattr__(self, "no_fly", None)
        elif self.wind is not None or self.home_velocity is not None:
            raise InvalidData(
                "no_fly must be None with wind or home_velocity: zones that move relative to the air are "
                f"not supported; got {len(self.no_fly)} zones",
                field="no_fly",
            )
        for row, zone in enumerate(self.no_fly or ()):
            for start in self.starts:
                if is_inside(zone, complex(*start[:2])):
                    raise InvalidData(
                        f"no_fly[{row}] must not contain the start {show(start[:2].tolist())}",
                        field="no_fly",
                    )

    def _check_windows(self) -> None:
        """Validate the time windows, and reduce windows without a limit to the default."""
        if self.windows is None:
            return
        begin, end = self.windows.T
        wrong = np.flatnonzero(~((begin <= end) & (end >= 0) & np.isfinite(begin)))
        if wrong.size:
            raise InvalidData(
                f"windows[{wrong[0]}] must be a finite earliest time and a latest time that is at least 0 and not "
                f"before it, in s; got {show(self.windows[wrong[0]].tolist())}",
                field="windows",
            )
        if (begin <= 0).all() and np.isinf(end).all():
            object.__setattr__(self, "windows", None)

    def _check_home(self, relative: str) -> None:
        """Validate the home, to which a closed tour returns."""
        if self.home_velocity is not None and not self.closed:
            raise InvalidData(
                f"home_velocity must be None unless closed is True: an open tour does not return; got "
                f"{show(self.home_velocity.tolist())}",
                field="home_velocity",
            )
        fast = float(np.hypot(*self.home_drift))
        if self.closed and not fast < self.speed:
            name = "wind" if self.home_velocity is None else "home_velocity"
            raise InvalidData(
                f"{name} must leave the home of a closed tour slower than the UAV, {self.speed:g} "
                f"m/s{relative}; got {show(getattr(self, name).tolist())}, a home at {fast:g} "
                f"m/s{relative}",
                field=name,
            )

    @property
    def size(self) -> int:
        """Number of vehicles."""
        return len(self.positions)

    def uncovered(self, carried: Set[str]) -> str:
        """Return the reason why a method that carries only the added fields `carried` cannot be used."""
        for field in fields(self):
            used = field.metadata.get("added") and getattr(self, field.name) is not None
            if used and field.name not in carried:
                detour = ": 'detour-search' does"
                other = {"uavs": ": 'crew-search' does", "no_fly": detour, "windows": detour}
                return f"the field {field.name} of a messenger tour{other.get(field.name, '')}"
        return ""

    @property
    def heading(self) -> float | None:
        """Heading at the start, in rad; None if it is free."""
        fixed = self.start is not None and self.start.size == 3
        return float(self.start[2]) if fixed and self.start is not None else None

    @property
    def at_rest(self) -> bool:
        """True if neither a vehicle nor the home moves over the ground."""
        return not self.velocities.any() and self.home_velocity is None

    @cached_property
    def drifts(self) -> Floats:
        """Velocities of the vehicles relative to the air, in m/s, shape (n, 2)."""
        return self.velocities if self.wind is None else self.velocities - self.wind

    @property
    def home_drift(self) -> Floats:
        """Velocity of the home relative to the air, in m/s, shape (2,)."""
        still = np.zeros(2)
        home = still if self.home_velocity is None else self.home_velocity
        return home - (still if self.wind is None else self.wind)

    @property
    def drift(self) -> Floats:
        """Displacement by the wind per metre flown through the air, shape (2,)."""
        return np.zeros(2) if self.wind is None else self.wind / self.speed

    @property
    def starts(self) -> list[Floats]:
        """Start of each UAV; empty if the start of the only one is free."""
        if self.uavs is not None and self.uavs.shape[1]:
            return list(self.uavs)
        count = 1 if self.uavs is None else len(self.uavs)
        return [] if self.start is None else [self.start] * count

    def share(self, uav: int, vehicles: Sequence[int]) -> Self:
        """Return the task of one UAV with some of the vehicles."""
        rows = list(vehicles)
        ids = [self.label(k) for k in rows] if len(set(rows)) == len(rows) else None
        return replace(
            self, positions=self.positions[rows], velocities=self.velocities[rows],
            radius=self.radius[rows], start=self.starts[uav], uavs=None, ids=ids,
            windows=None if self.windows is None else self.windows[rows],
        )  # fmt: skip

    def relative_to_air(self) -> Self:
        """Return the same task in the frame that moves with the air, which is an exact change of frame."""
        if self.wind is None:
            return self
        home = self.home_drift if self.closed else None
        return replace(self, velocities=self.drifts, home_velocity=home, wind=None)

    def to_ground(self, plan: TourPlan, sign: float = 1.0) -> TourPlan:
        """Return a plan of :meth:`relative_to_air` with its points over the ground; the inverse for -1."""
        if self.wind is None:
            return plan
        return replace(plan, points=plan.points + sign * plan.times[:, None] * self.wind)

    @cached_property
    def extent(self) -> float:
        """Diagonal of the bounding box of the start and of the vehicles at time 0, in m."""
        corners = [*self.positions, *([] if self.start is None else [self.start[:2]])]
        return float(np.hypot(*np.ptp(np.array(corners), axis=0)))

    @property
    def sparsity(self) -> float:
        """Sparsity κ_P: mean gap between the discs at time 0, divided by the turning radius."""
        from scipy.spatial.distance import pdist

        if self.size < 2 or self.turning_radius == 0:
            return math.inf
        gaps = float(pdist(self.positions).mean()) - 2 * float(self.radius.mean())
        return gaps / self.turning_radius

    def where(self, vehicle: int, time: float) -> Floats:
        """Return the position of `vehicle` at `time` (s), in m, shape (2,)."""
        place: Floats = self.positions[vehicle] + self.velocities[vehicle] * time
        return place

    def label(self, vehicle: int) -> str:
        """Return the name of `vehicle`: its id, or its index."""
        return str(vehicle if self.ids is None else self.ids[vehicle])
