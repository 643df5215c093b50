"""Tour of a messenger UAV over moving ground vehicles.

Source: "A Memetic Algorithm for Curvature-Constrained Path Planning of Messenger UAV in Air-Ground
Coordination", IEEE Transactions on Automation Science and Engineering, doi
10.1109/TASE.2021.3135044.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..fields import required
from ..verification import TOLERANCE, Verification
from .checks import verify_tour
from .crew import verify_crew
from .data import TourData
from .plan import TourPlan

__all__ = ["MessengerTour"]


class MessengerTour(TourData):
    r"""Shortest flight of a fixed-wing UAV that comes within radio range of every vehicle.

    Vehicle i drives along the known line P_i + V_i t. The UAV flies at a constant speed v along a
    path of curvature at most 1/r_min, and meets each vehicle i once, at a time t_i at which their
    distance is at most r_i. Minimise the length v T of the path up to the last encounter, or, for a
    closed tour, back to its start. The problem is known as the Dubins travelling salesman problem
    with dynamic neighbourhoods.

    Special cases: with vehicles at rest, the Dubins problem with neighbourhoods; with radii of 0,
    the problem with moving targets; with a turning radius of 0, the Euclidean problem, in which the
    UAV turns on the spot.

    Parameters
    ----------
    positions : ndarray, shape (n, 2)
        Positions P_i of the vehicles at time 0 in metres.
    velocities : ndarray, shape (n, 2)
        Velocities V_i in metres per second; 0 by default. Each vehicle must be slower than the UAV.
    radius : ndarray, shape (n,)
        Largest distance r_i at an encounter in metres; a scalar applies to all vehicles (paper:
        r_com).
    speed : float
        Speed v of the UAV in metres per second (paper: v_A).
    turning_radius : float
        Smallest turning radius r_min in metres; 0 if the UAV can turn on the spot.
    start : ndarray, shape (2,) or (3,), optional
        Start of the path: x and y in metres, and the heading in radians, counter-clockwise
        from the x axis.
        Without a heading, the heading is free. None leaves the start free, which is allowed only
        for a closed tour over vehicles at rest.
    closed : bool
        Whether the path returns to its initial position and heading.
    ids : sequence of int or str, optional
        Names of the vehicles.
    wind : ndarray, shape (2,), optional
        Velocity w of the air over the ground in metres per second. Speed, turning radius, headings
        and the length v T are relative to the air, so the objective is still the time times the
        speed. Each vehicle, and the home of a closed tour, must be slower than the UAV relative to the
        air.
    home_velocity : ndarray, shape (2,), optional
        Velocity of the home over the ground in metres per second, for example that of a carrier. The
        path of a closed tour ends at the home, with its initial heading.
    uavs : int or ndarray, shape (m, 2) or (m, 3), optional
        Number of UAVs that begin at `start`, or the start of each one. Each vehicle is met by one
        UAV, a UAV may stay at its start, and the objective is v T for the latest finish T.
    no_fly : list of ndarray, optional
        Zones that the path avoids: x, y and radius of a disc in metres, shape (3,), or the corners of a
        polygon, shape (k, 2). The wind must be calm, the home at rest, and the starts outside.
    windows : ndarray, shape (n, 2), optional
        Earliest and latest time of each encounter in seconds; infinity without a latest time. A UAV
        that would arrive early takes a longer path.

    Raises
    ------
    InvalidData
        No vehicle, a vehicle at least as fast as the UAV, a negative radius, NaN, a wrong shape or
        a repeated id. The message contains field, row and value.

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

    @np.errstate(all="ignore")  # overflow yields inf or NaN, which is a violation
    def verify(self, plan: TourPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the length and the violation of every constraint.

        The poses are integrated from the turns and lengths of the primitives in NumPy,
        independently of the kernels of the solvers. A position may be off by `tolerance` times the
        vehicle's radius; for a radius of 0, by `tolerance` times the extent of the field per
        vehicle.

        Parameters
        ----------
        plan : TourPlan
            The tour.
        tolerance : float
            Largest relative violation accepted.

        Returns
        -------
        Verification
            Objective (m) and checks.
        """
        if self.uavs is not None:
            return verify_crew(self, required("plan", plan, TourPlan), tolerance)
        return verify_tour(self, plan, tolerance)

    @property
    def preferred_backend(self) -> str:
        """The search that proves a bound. Solvers of programs, all local, are not even loaded."""
        if self.uavs is not None:
            return "crew-search"
        plain = self.no_fly is None and self.windows is None
        return "tour-search" if plain else "detour-search"

    def describe(self) -> str:
        """Return a short description of the size."""
        low, high = self.radius.min(), self.radius.max()
        radius = f"{low:g}" if low == high else f"{low:g} … {high:g}"
        kind = ", closed" if self.closed else ""
        for name, value in (("wind", self.wind), ("home at", self.home_velocity)):
            kind += "" if value is None else f", {name} {np.hypot(*value):.4g} m/s"
        rest = ", at rest" if self.at_rest else ""
        if self.no_fly is not None:
            kind += f", {len(self.no_fly)} no-fly zone{'s' * (len(self.no_fly) > 1)}"
        kind += "" if self.windows is None else ", time windows"
        kind += "" if self.uavs is None else f", {len(self.starts)} UAVs"
        return (
            f"{self.size} vehicle{'s' * (self.size > 1)}{rest}, radius {radius} m, "
            f"turning radius {self.turning_radius:g} m{kind}"
        )
