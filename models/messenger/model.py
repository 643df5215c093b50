"""The tour of a messenger UAV over moving ground vehicles.

Source: "A Memetic Algorithm for Curvature-Constrained Path Planning of Messenger UAV in Air-Ground
Coordination", IEEE Transactions on Automation Science and Engineering, doi
10.1109/TASE.2021.3135044.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..model import Model
from ..verification import TOLERANCE, Verification
from .checks import verify_tour
from .data import TourData
from .plan import TourPlan

__all__ = ["MessengerTour"]


@dataclass(frozen=True, eq=False, repr=False)
class MessengerTour(TourData, Model[TourPlan]):
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

    kind: ClassVar[str] = "messenger-tour"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = TourPlan
    formulations: ClassVar[dict[str, Any]] = {
        "primitives": ".models.messenger.primitives:PrimitivesFormulation"
    }
    default_formulation: ClassVar[str] = "primitives"

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # what overflows is no number, and so is violated
    def verify(self, plan: TourPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the length and every constraint, from the primitives integrated anew.

        The end of each primitive follows from its turn and length alone, in NumPy and apart from
        the kernels that backends use. A position may be off by `tolerance` times the vehicle's
        radius, or for a radius of 0 times the mean distance between vehicles that the field leaves.
        """
        return verify_tour(self, plan, tolerance)

    @property
    def preferred_backend(self) -> str:
        """The search that proves a bound. Solvers of programs, all local, are not even loaded."""
        return "tour-search"

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
