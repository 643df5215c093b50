"""The tour of a messenger UAV over moving ground vehicles.

Source: "A Memetic Algorithm for Curvature-Constrained Path Planning of Messenger UAV in Air-Ground
Coordination", IEEE Transactions on Automation Science and Engineering, doi
10.1109/TASE.2021.3135044.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Optional, Real, declared, show
from ..labels import Ids
from ..model import Model
from ..verification import TOLERANCE, Verification
from .checks import verify_tour
from .plan import TourPlan

__all__ = ["MessengerTour"]

Floats = NDArray[np.float64]


class EachVehicle(Array):
    """One number a vehicle, or one for all; the full table is kept."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        if np.ndim(value) == 0 and not isinstance(value, str | dict | set):
            value = np.full(sizes["n"][0], Real(self.lower).coerce(name, value, {}))
        return super().coerce(name, value, sizes)


@dataclass(frozen=True, eq=False, repr=False)
class MessengerTour(Model[TourPlan]):
    r"""The shortest flight of a fixed-wing UAV that comes within radio range of every vehicle.

    Vehicle i drives along the known line P_i + V_i t. The UAV flies at a constant speed v along a
    path whose curvature is at most 1/r_min, and meets vehicle i once, at a time t_i at which it is
    no further than r_i from it. Minimise the length v T of the path, up to the last encounter, or
    back to where it began. Known as the Dubins travelling salesman problem with dynamic
    neighbourhoods.

    Vehicles at rest make it the Dubins problem with neighbourhoods, radii of 0 the one with moving
    targets, and a turning radius of 0 the Euclidean one, where the UAV may turn on the spot.

    Parameters
    ----------
    positions : ndarray, shape (n, 2)
        P_i, where the vehicles are at time 0, m.
    velocities : ndarray, shape (n, 2)
        V_i, m/s; at rest by default. Each must be slower than the UAV.
    radius : ndarray, shape (n,)
        r_i, how near the UAV must come, m; one number counts for all (paper: r_com).
    speed : float
        v, the speed of the UAV, m/s (paper: v_A).
    turning_radius : float
        r_min, m; 0 where it may turn on the spot.
    start : ndarray, shape (2,) or (3,), optional
        Where the path begins: x, y (m) and the heading (rad, counter-clockwise from the x axis);
        without a heading any will do. None lets it begin anywhere, which only a closed tour over
        vehicles at rest may.
    closed : bool
        Whether the path leads back to the position and the heading with which it began.
    ids : sequence of int or str, optional
        Names of the vehicles.

    Raises
    ------
    InvalidData
        Naming field, row and value: no vehicle, one that is as fast as the UAV, negative radii,
        NaN, wrong shapes, ids that repeat.

    Examples
    --------
    >>> from crosstrack.models import MessengerTour
    >>> model = MessengerTour([[60, 20], [10, 70]], [[1, 0], [0, -2]])
    >>> print(model.describe())
    2 vehicles, radius 5 m, turning radius 5 m
    """

    positions: Floats = declared(Array(("n", 2)))
    velocities: Floats = declared(Optional(Array(("n", 2))), default=None)
    radius: Floats = declared(EachVehicle(("n",), lower=0), default=5.0)
    speed: float = declared(Real(lower=0, strict=True, unit="m/s"), default=10.0)
    turning_radius: float = declared(Real(lower=0, unit="m"), default=5.0)
    start: Floats | None = declared(Optional(Array(("k",))), default=(0.0, 0.0, 0.5 * math.pi))
    closed: bool = declared(Flag(), default=False)
    ids: tuple[int | str, ...] | None = declared(Optional(Ids()), default=None)

    kind: ClassVar[str] = "messenger-tour"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = TourPlan

    def check(self) -> None:
        """Fill in velocities, and refuse what no tour can be found for or no path begins at."""
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
                f"caught; got {show(self.velocities[row])}, {fast[row]:g} m/s",
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
        """The number of vehicles."""
        return len(self.positions)

    @property
    def heading(self) -> float | None:
        """The heading at the start, rad; None where any will do."""
        fixed = self.start is not None and self.start.size == 3
        return float(self.start[2]) if fixed and self.start is not None else None

    @property
    def at_rest(self) -> bool:
        """Whether no vehicle moves."""
        return not self.velocities.any()

    @cached_property
    def extent(self) -> float:
        """The diagonal of the box around the vehicles at time 0 and the start, m."""
        corners = [*self.positions, *([] if self.start is None else [self.start[:2]])]
        return float(np.hypot(*np.ptp(np.array(corners), axis=0)))

    @property
    def sparsity(self) -> float:
        """κ_P, the mean distance of vehicles at time 0 beyond their radii, by the turning radius."""
        from scipy.spatial.distance import pdist

        if self.size < 2 or self.turning_radius == 0:
            return math.inf
        gaps = float(pdist(self.positions).mean()) - 2 * float(self.radius.mean())
        return gaps / self.turning_radius

    def where(self, vehicle: int, time: float) -> Floats:
        """Return where a vehicle is at a time, m, shape (2,)."""
        place: Floats = self.positions[vehicle] + self.velocities[vehicle] * time
        return place

    def label(self, vehicle: int) -> str:
        """Return the name of `vehicle`: its id, or its index."""
        return str(vehicle if self.ids is None else self.ids[vehicle])

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # what overflows is no number, and so is violated
    def verify(self, plan: TourPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the length and every constraint, from the primitives integrated anew.

        The end of each primitive follows from its turn and length alone, in NumPy and apart from
        the kernels that backends use. A position may be off by `tolerance` times the vehicle's
        radius, or for a radius of 0 times the mean distance between vehicles that the field leaves.
        """
        return verify_tour(self, plan, tolerance)

    def plan_to_data(self, plan: TourPlan) -> Any:
        """Return ``{"order", "times", "points", "start", "primitives"}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> TourPlan:
        """Return the plan in `data`."""
        return TourPlan.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""
        low, high = self.radius.min(), self.radius.max()
        radius = f"{low:g}" if low == high else f"{low:g} … {high:g}"
        kind = ", closed" if self.closed else ""
        rest = ", at rest" if self.at_rest else ""
        return (
            f"{self.size} vehicle{'s' * (self.size > 1)}{rest}, radius {radius} m, "
            f"turning radius {self.turning_radius:g} m{kind}"
        )
