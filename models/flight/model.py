"""Flight from a start to a goal on a map, within a vehicle's limits.

Sources: Wang, Zhou, Xu and Gao, "Geometrically constrained trajectory optimization for multicopters",
IEEE Transactions on Robotics 38(5), 2022 (objective and pipeline); Liu et al., "Planning dynamically
feasible trajectories for quadrotors using safe flight corridors in 3-D complex environments", IEEE
Robotics and Automation Letters 2(3), 2017 (path, corridor, curve).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..grid_path.gridmap import GridMap
from ..verification import TOLERANCE, Verification
from .checks import verify_flight
from .data import FlightData, FlightObjective
from .plan import FlightPlan
from .voxels import VoxelMap

__all__ = ["Flight", "FlightObjective"]


class Flight(FlightData):
    """Curve of a round vehicle from a start to a goal that avoids all obstacles of a map.

    The curve is a piecewise polynomial that is continuous up to the derivative of order r - 1. At every
    instant its distance from the obstacles is at least `radius`, and the vehicle keeps its limits.

    Parameters
    ----------
    map : GridMap, VoxelMap, list of polygons, or ndarray of shape (n, 2) or (n, 3)
        Obstacles: blocked cells, blocked voxels, polygons (rings of shape (k, 2) in metres or
        ``{"shell": ring, "holes": [ring, …]}``), or points in metres, which require a radius. The
        vehicle's centre stays within a map of cells.
    start, goal : ndarray, shape (axes,)
        Positions in metres.
    vehicle : PointMass, Quadrotor or DifferentialDrive
        Vehicle with its limits.
    radius : float
        Radius of the vehicle in metres; 0 by default.
    start_velocity, goal_velocity : ndarray, shape (axes,), optional
        Velocities at both ends in metres per second; 0 by default.
    start_acceleration, goal_acceleration : ndarray, shape (axes,), optional
        Accelerations at both ends in metres per second squared; 0 by default.
    waypoints : ndarray, shape (k, axes), optional
        Points to pass on the way, in this order, in metres.
    order : int
        Order r of the derivative in the objective "weighted": 3 jerk (default) or 4 snap.
    objective : {"time", "weighted"}
        Objective, see :class:`~crosstrack.models.flight.FlightObjective`.
    time_weight : float
        Cost ρ of a second for "weighted", in square metres per second to the power 2r; 20 by default.
    bounds : ndarray, shape (2 axes,), optional
        Lowest, then highest coordinates of the vehicle's centre in metres.
    cell : float, optional
        Side of the planner's cells in metres, and length scale of the tolerance of positions: that of
        the map, by default a 200th (2-D) or a 64th (3-D) of a map without cells.
    moving : sequence of MovingObstacle, optional
        Discs or balls with known motion. The flight then begins at time 0 or later, at rest before it.

    Raises
    ------
    InvalidData
        A field is invalid; the error names field and value. Examples: a start outside the map, in an
        obstacle or closer to one than `radius`, a vehicle for another number of axes, a velocity or an
        acceleration at an end beyond the vehicle's limits, NaN.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import Flight, PointMass
    >>> model = Flight([[[4, -3], [6, -3], [6, 3], [4, 3]]], (0, 0), (10, 0), PointMass(2.0, 1.0))
    >>> print(model.describe())
    point-mass among 1 polygon, 10 m apart, time
    >>> ct.solve(model).verification.ok
    True
    """

    kind: ClassVar[str] = "flight"
    plan_type: ClassVar[type] = FlightPlan

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # overflow yields NaN, which the checks treat as a violation
    def verify(self, plan: FlightPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Compute the objective and check every constraint on the curve itself.

        Distances from obstacles are proven by convex hulls of bisected pieces, limits of the vehicle at
        exact extremes or by subdivision. The tolerance of a position is `tolerance` times `cell`.
        """
        return verify_flight(self, plan, tolerance)

    def describe(self) -> str:
        """Return a one-line summary: vehicle, obstacles, distance and objective."""
        if isinstance(self.map, GridMap | VoxelMap):
            shape = " × ".join(map(str, self.space.blocked.shape))
            what = f"{shape} cells, {self.space.blocked.mean():.0%} blocked"
        else:
            word = "polygon" if isinstance(self.map, tuple) else "point"
            what = f"{len(self.map)} {word}" + "s" * (len(self.map) != 1)
        apart = float(np.linalg.norm(np.diff(self.places, axis=0), axis=1).sum())
        return f"{self.vehicle.kind} among {what}, {apart:.4g} m apart, {self.objective}"
