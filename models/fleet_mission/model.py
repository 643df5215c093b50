"""The whole mission of a fleet: from obstacles as polygons to trajectories that keep all limits.

Source: sections 2 and 3 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for
Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..model import Model
from ..verification import TOLERANCE, Verification
from .checks import verify_mission
from .data import MissionData
from .plan import MissionPlan

__all__ = ["FleetMission"]


@dataclass(frozen=True, eq=False, repr=False)
class FleetMission(MissionData, Model[MissionPlan]):
    r"""Trajectories of m round robots that share the nodes among obstacles and balance their lengths.

    Every robot leaves the depot from rest, passes its nodes and comes back to rest. Every node is
    passed once. The model minimises `objective` of the lengths L_k of the curves, by default
    :math:`\sum_k L_k + q s` with the standard deviation s of all L_k. The curves are piecewise
    polynomials. Their derivatives up to `continuity` are 0 at both ends and continuous at the knots;
    eq. 23-25 of the paper ask for 2, the acceleration. The curves keep the robot's radius away from
    all obstacles at every instant, and keep the limits of velocity and acceleration.

    Parameters
    ----------
    obstacles : list of polygons
        Each a ring of shape (k, 2), m, or ``{"shell": ring, "holes": [ring, …]}``; they may touch,
        overlap and nest.
    bounds : ndarray, shape (4,)
        Least x and y, greatest x and y, m, of where the robots' centres may be.
    nodes : ndarray, shape (n, 2)
        x, y, m.
    depot : ndarray, shape (2,)
        x, y, m, of the begin and end of all routes. It is the gate of a queue: before its departure and
        after its return a robot waits there, off the map, and takes no room.
    vehicles : int
        m, the number of robots; each has a node at least.
    cell : float
        Side of the cells of :attr:`map`, m, and what violated positions are held against.
    radius : float
        Of each robot, m.
    velocity_limit, acceleration_limit : float or ndarray, shape (2,)
        Largest absolute value of each component, m/s and m/s².
    separation : float, optional
        Least distance of the centres of two robots that are under way, m; two radii by default. With
        0 no distance is required, and the verification states it.
    depot_radius : float, optional
        Deprecated and without effect: robots near the depot keep the separation as well.
    objective : {"sum-deviation", "sum-variance", "sum", "max", "range", "max-sum"}
        Objective of the lengths L_k, as in :class:`~crosstrack.models.FleetRouting`. The paper's is
        "sum-variance".
    q : float
        Weight of the deviation or of the variance, for the objectives that have one.
    deviation : {"sample", "population"}
        Divisor in the standard deviation: m - 1, as in Table 3 of the paper, or m.
    ids : sequence of int or str, optional
        Names of the nodes.
    continuity : {3, 2}
        Highest derivative that is continuous at the knots and 0 at both ends: 2 as in eq. 23-25, 3
        adds the jerk.

    Raises
    ------
    InvalidData
        Naming field, row and value: polygons that cross themselves, a node or the depot out of
        bounds, within an obstacle, nearer than `radius` to one, in a cell that is not free as a
        whole, or beyond reach; more robots than nodes, NaN, no free cell.

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
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = MissionPlan

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # what overflows is no number, and so is violated
    def verify(self, plan: MissionPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and every constraint, of the curves themselves.

        Lengths come from quadrature, limits from exact extremes, distances from shapely; between
        instants the hulls of ever shorter pieces decide. A position may be off by `tolerance` times
        the side of a cell.
        """
        return verify_mission(self, plan, tolerance)

    def plan_to_data(self, plan: MissionPlan) -> Any:
        """Return ``{"routes": […], "trajectories": […], "visits": […]}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> MissionPlan:
        """Return the plan in `data`."""
        return MissionPlan.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""

        def several(count: int, word: str) -> str:
            return f"{count} {word}" + "s" * (count != 1)

        return (
            f"{several(self.vehicles, 'robot')}, {several(len(self.nodes), 'node')}, "
            f"{several(len(self.obstacles), 'obstacle')}, {self.objective}"
        )
