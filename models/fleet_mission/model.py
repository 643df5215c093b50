"""Mission of a fleet: trajectories among polygonal obstacles within all limits.

Source: sections 2 and 3 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for
Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..verification import TOLERANCE, Verification
from .checks import verify_mission
from .data import MissionData, MissionObjective
from .plan import MissionPlan

__all__ = ["FleetMission"]


class FleetMission(MissionData):
    r"""Trajectories of m round robots that share the nodes among obstacles and balance their lengths.

    Every robot starts at rest at the depot, passes its nodes and returns to rest. Every node is
    passed once. The model minimises `objective` of the lengths L_k of the curves, by default
    :math:`\sum_k L_k + q s` with the standard deviation s of all L_k. The curves are piecewise
    polynomials. Their derivatives up to `continuity` are 0 at both ends and continuous at the knots;
    eq. 23-25 of the paper require 2, the acceleration. At every instant the curves keep a distance of
    at least the radius from all obstacles and satisfy the limits of velocity and acceleration.

    Parameters
    ----------
    obstacles : list of polygons
        Each a ring of shape (k, 2) in metres, or ``{"shell": ring, "holes": [ring, …]}``; they may touch,
        overlap and nest.
    bounds : ndarray, shape (4,)
        Minimum x and y, maximum x and y of the robots' centres in metres.
    nodes : ndarray, shape (n, 2)
        Positions x, y of the nodes in metres.
    depot : ndarray, shape (2,)
        Start and end x, y of all routes in metres. The depot has a queue off the map: a robot waits there
        before its departure and after its return and takes no room.
    vehicles : int
        Number of robots m; each visits at least one node.
    cell : float
        Side of the cells of :attr:`map`, in metres, and length scale of the tolerance of positions; 1 by
        default.
    radius : float
        Radius of each robot in metres; 0 by default.
    velocity_limit, acceleration_limit : float or ndarray, shape (2,)
        Largest absolute value of each component, in metres per second and metres per second
        squared; 1 by default.
    separation : float, optional
        Least distance of the centres of two robots under way, in metres; two radii by default. With 0 no
        distance is required, and the verification reports it.
    depot_radius : float, optional
        Deprecated and without effect: robots near the depot keep the separation as well.
    objective : {"sum-deviation", "sum-variance", "sum", "max", "range", "max-sum", "makespan"}
        Objective of the lengths L_k, as in :class:`~crosstrack.models.FleetRouting`. The paper's is
        "sum-variance". "makespan" is the time at which the last robot is back, in seconds from 0.
    q : float
        Weight of the deviation or of the variance, for the objectives that have one.
    deviation : {"sample", "population"}
        Divisor in the standard deviation: m - 1, as in Table 3 of the paper, or m.
    ids : sequence of int or str, optional
        Names of the nodes.
    continuity : {3, 2}
        Highest derivative that is continuous at the knots and 0 at both ends: 2 as in eq. 23-25, 3
        adds the jerk.
    moving : sequence of MovingObstacle
        Obstacles whose motion is known, in the plane. Robots under way keep a distance of both radii
        between the centres at every instant. With moving obstacles or the objective "makespan", no robot
        departs before time 0.

    Raises
    ------
    InvalidData
        A field is invalid; the error names field, row and value. Examples: a self-intersecting
        polygon, more robots than nodes, NaN, no free cell, or a node or depot that is out of bounds,
        in an obstacle, closer than `radius` to one, in a cell that is not entirely free, or
        unreachable.

    Examples
    --------
    >>> from crosstrack.models import FleetMission
    >>> model = FleetMission(
    ...     [[[4, 4], [6, 4], [5, 6]]], (0, 0, 10, 10), [[8, 8], [8, 2], [2, 8]], (1, 1), 2, cell=0.5
    ... )
    >>> print(model.describe())
    2 robots, 3 nodes, 1 obstacle, sum-deviation
    """

    kind: ClassVar[str] = "fleet-mission"
    plan_type: ClassVar[type] = MissionPlan

    @property
    def objective_unit(self) -> str:  # type: ignore[override]
        """Unit of the objective: metres, or seconds for the makespan."""
        return "s" if self.objective is MissionObjective.MAKESPAN else "m"

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # overflow yields NaN, which the checks treat as a violation
    def verify(self, plan: MissionPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Compute the objective and check every constraint on the curves themselves.

        Lengths are computed by quadrature, limits at exact extremes, distances by shapely with hulls
        of bisected pieces. The tolerance of a position is `tolerance` times the side of a cell.
        """
        return verify_mission(self, plan, tolerance)

    def describe(self) -> str:
        """Return a one-line summary: robots, nodes, obstacles and objective."""

        def several(count: int, word: str) -> str:
            return f"{count} {word}" + "s" * (count != 1)

        moving = f"{several(len(self.moving), 'moving obstacle')}, " if self.moving else ""
        return (
            f"{several(self.vehicles, 'robot')}, {several(len(self.nodes), 'node')}, "
            f"{several(len(self.obstacles), 'obstacle')}, {moving}{self.objective}"
        )
