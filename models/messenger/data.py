"""Data of a messenger tour: vehicles, UAV and start."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Optional, Real, declared, show
from ..inputs import Field, FloatArray, FloatsOrNone, Names, Numbers
from ..labels import Ids
from ..model import Model
from .plan import TourPlan

__all__ = ["TourData"]

Floats = NDArray[np.float64]


class EachVehicle(Array):
    """One number per vehicle; a scalar is broadcast to all vehicles."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        given = self._numbers(name, value)
        if given.ndim == 0:
            given = np.full(sizes["n"][0], Real(self.lower).coerce(name, value, {}))
        return super().coerce(name, given, sizes)


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
    start: FloatsOrNone = declared(Optional(Array(("k",))), default=(0.0, 0.0, 0.5 * math.pi))
    closed: bool = declared(Flag(), default=False)
    ids: Names = declared(Optional(Ids()), default=None)

    def check(self) -> None:
        """Fill in the velocities and validate vehicles and start."""
        if not self.size:
            raise InvalidData(
                "positions must hold at least one vehicle, got none", field="positions"
            )
        if self.velocities is None:
            rest = Array(("n", 2)).coerce("velocities", np.zeros((self.size, 2)), {})
            object.__setattr__(self, "velocities", rest)
        fast = np.hypot(*self.velocities.T)
        if (fast >= self.speed).any():
            row = int(np.flatnonzero(fast >= self.speed)[0])
            raise InvalidData(
                f"velocities[{row}] must be slower than the UAV, {self.speed:g} m/s: it might never be "
                f"caught; got {show(self.velocities[row].tolist())}, {fast[row]:g} m/s",
                field="velocities",
            )
        if self.start is None:
            if not self.closed or self.velocities.any():
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

    @property
    def size(self) -> int:
        """Number of vehicles."""
        return len(self.positions)

    @property
    def heading(self) -> float | None:
        """Heading at the start, in rad; None if it is free."""
        fixed = self.start is not None and self.start.size == 3
        return float(self.start[2]) if fixed and self.start is not None else None

    @property
    def at_rest(self) -> bool:
        """True if no vehicle moves."""
        return not self.velocities.any()

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
