"""Routing of several robots through shared task nodes, with balanced energy.

Source: section 2 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for Multirobot
in Obstacle Environment", Wireless Communications and Mobile Computing, 2021.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np

from ..verification import TOLERANCE, Verification, check_entries
from .checks import LIMITS, loads_of, measure_of, verify_routes
from .data import Objective
from .features import list_unsupported
from .plan import FleetPlan
from .rich_data import RichData
from .schedule import schedule_route

__all__ = ["FleetRouting"]

#: Largest number of nodes solved by branch and bound in about a minute: the sum, other objectives.
SUM_NODES, BALANCE_NODES = 100, 12
#: Largest number of nodes of a rich fleet that column generation usually solves in seconds.
RICH_NODES = 25


class FleetRouting(RichData):
    r"""Routes of m vehicles from their depots through all nodes, each visited once.

    With L_k the length of the route of vehicle k, from its depot and back, minimise one of

    * ``"sum"``: :math:`\sum_k L_k` (eq. 15),
    * ``"max"``: :math:`\max_k L_k`,
    * ``"sum-variance"``: :math:`\sum_k L_k + q Y`, with the variance Y of all L_k (eq. 15 and 16),
    * ``"sum-deviation"``: :math:`\sum_k L_k + q s`, with the standard deviation s of all L_k,
    * ``"range"``: :math:`\max_k L_k - \min_k L_k`,
    * ``"max-sum"``: max L_k and then the sum, stated as :math:`\max_k L_k + 10^{-6} \sum_k L_k`,
    * ``"cost"``: fixed, distance and time costs of the used vehicles, minus the prizes collected,
    * ``"makespan"``: the latest return, in seconds.

    Known as the multiple travelling salesman problem. A vehicle that stays at its depot has
    length 0. The fields from `times` on describe rich fleets; all of them are optional, and one number
    applies to all vehicles.

    Parameters
    ----------
    vehicles : int
        Number of vehicles m.
    costs : ndarray, shape (n, n), optional
        Costs d_ij >= 0 from node i to node j, with a zero diagonal; may be asymmetric.
    points : ndarray, shape (n, 2), optional
        Positions of the nodes in metres, instead of `costs`.
    map : GridMap, optional
        Map under the points; paths then avoid blocked cells.
    metric : {"euclidean", "rounded", "paper", "grid"}, optional
        Distance between points, see :class:`~crosstrack.models.fleet.Metric`. The default is "grid"
        with a map and "euclidean" without.
    depots : int or ndarray of int, shape (1,) or (vehicles,)
        Start and end node of all routes, or one node per vehicle; 0 by default.
    use_all : bool
        Whether every vehicle must visit at least one node. The default is True for plain models, and
        False for models with a field from `times` on, with loads in several dimensions, or with the
        objectives "cost" and "makespan".
    objective : {"max", "sum", "sum-variance", "sum-deviation", "range", "max-sum", "cost", "makespan"}
        Objective to minimise; "max" by default.
    q : float
        Weight of the variance, per metre, or of the standard deviation (no unit), for the objectives
        "sum-variance" and "sum-deviation".
    deviation : {"sample", "population"}
        Divisor in the standard deviation: m - 1, as in the paper's Table 3, or m. The variance of
        "sum-variance" always divides by m (eq. 16).
    demands, capacity : ndarray, shape (n,) and (vehicles,), optional
        Amount delivered at each node, on board since the start of its trip, and capacity of each
        vehicle; one number applies to all vehicles. With several dimensions, the shapes are (n, c) and
        (vehicles, c).
    battery : float or ndarray, shape (vehicles,), optional
        Upper limit on the route length of each vehicle, in metres or in the unit of `costs`; one
        number applies to all vehicles. With `stations`, the limit on the length between two of them.
    budget, deviation_limit, range_limit : float, optional
        Upper limits on the sum, the standard deviation and the range of the route lengths, in metres or in
        the unit of `costs`.
    ids : sequence of int or str, optional
        Names of the nodes.
    times : ndarray, shape (n, n), optional
        Travel times at speed 1, in seconds, with a zero diagonal. The distances by default.
    speed : float or ndarray, shape (vehicles,), optional
        Divisor of the travel times of each vehicle: metres per second if `times` is not given.
    service : ndarray, shape (n,), optional
        Duration of the service at each node, in seconds. It is ignored at the ends of a route.
    windows : sequence, optional
        For each node None, one window (begin, end) or a list of windows, in seconds. A service begins
        inside one of them; a vehicle may wait. The windows of a depot limit departures and returns.
        An end of None or infinity is open.
    releases : ndarray, shape (n,), optional
        Times at which the goods of each node become available, in seconds. A trip from the depot or a reload to
        the next reload or the end departs no earlier than the releases of its nodes.
    pickups : ndarray, shape (n,) or (n, c), optional
        Amount picked up at each node, on board until the end of the trip. The load stays within the
        capacity at every moment.
    backhauls : bool
        Whether nodes with pickups only come after all others of their trip, and no trip begins with one.
    pairs : ndarray of int, shape (p, 2), optional
        Pickup node and delivery node, visited by one trip in this order, or both skipped. The amount is
        that of `pickups` at the first node; other amounts of the two nodes do not count.
    fixed_cost, distance_cost, time_cost : float or ndarray, shape (vehicles,), optional
        Costs per used vehicle (0 by default), per metre (1) and per second between departure and return
        (0), for the objective "cost".
    shifts : ndarray, shape (2,) or (vehicles, 2), optional
        Earliest departure and latest return, in seconds; 0 and infinity by default.
    max_duration : float or ndarray, shape (vehicles,), optional
        Upper limit on the time between departure and return, in seconds.
    ends : int or ndarray of int, shape (vehicles,), optional
        Node at which each vehicle ends: -1 for an open route that ends at its last node. `depots` by
        default.
    requires, skills : sequence of sequence of str, optional
        Names that each node requires, and names that each vehicle has: it needs all of them.
    prizes : ndarray, shape (n,), optional
        Prize for a visit, for the objective "cost". NaN or None: the node must be visited. A number,
        also 0: the node is optional.
    groups : sequence of sequence of int, optional
        Groups of alternative nodes. Exactly one node of a group without prizes is visited, and at most one
        of a group with prizes.
    reloads : sequence of int, optional
        Nodes at which a vehicle may begin a new trip, any number of times; depots are allowed.
    max_reloads : int or ndarray of int, shape (vehicles,), optional
        Upper limit on the reloads of each vehicle.
    stations : sequence of int, optional
        Nodes at which a vehicle may renew its battery, any number of times.

    Raises
    ------
    InvalidData
        A field is invalid; the error names field, row and value. Examples: neither costs nor points,
        more vehicles than nodes, NaN, a node in a blocked cell, or an unreachable node.

    Examples
    --------
    >>> from crosstrack.models import FleetRouting
    >>> model = FleetRouting(2, points=[[0, 0], [3, 0], [0, 4], [5, 5]])
    >>> print(model.describe())
    2 vehicles, 3 nodes, max
    >>> timed = FleetRouting(
    ...     2, points=[[0, 0], [3, 0], [0, 4], [5, 5]], windows=[None, (5, 9), None, None]
    ... )
    >>> print(timed.describe())
    2 vehicles, 3 nodes, max, features: windows
    >>> print(timed.with_schedule([[1], [2, 3]]).starts[0])
    (2.0, 5.0, 8.0)
    """

    kind: ClassVar[str] = "fleet-routing"
    plan_type: ClassVar[type] = FleetPlan
    formulations: ClassVar[dict[str, Any]] = {
        "two-index": ".models.fleet.two_index:TwoIndexFormulation",
        "three-index": ".models.fleet.three_index:ThreeIndexFormulation",
    }
    default_formulation: ClassVar[str] = "three-index"
    second_objectives: ClassVar[dict[str, str]] = {rule.measure: rule.field for rule in LIMITS}

    @property
    def objective_unit(self) -> str:  # type: ignore[override]
        """Unit of the objective: metres, seconds for the makespan, and none for costs."""
        units = {Objective.MAKESPAN: "s", Objective.COST: ""}
        return units.get(self.objective, "m")

    @property
    def limits(self) -> tuple[str, ...]:
        """Names of the limits of the model."""
        names = ("capacity", *(rule.field for rule in LIMITS))
        return tuple(name for name in names if getattr(self, name) is not None)

    @property
    def preferred_formulation(self) -> str:
        """Name "two-index" if it covers the model, as it has far fewer columns, else "three-index"."""
        plain = self.objective is Objective.SUM and not self.is_rich
        covered = (
            plain and set(self.limits) <= {"budget"} and self.depots.size == 1 and self.symmetric
        )
        return "two-index" if covered else self.default_formulation

    @property
    def has_program(self) -> bool:
        """False for rich fleets, whose features no formulation covers."""
        return not self.is_rich

    @property
    def preferred_backend(self) -> str:
        """Name of the exact backend for rich fleets of up to 25 nodes; empty for others."""
        small = self.is_rich and len(self.customers) <= RICH_NODES
        return "column-generation" if small else ""

    @property
    def prefers_native(self) -> bool:
        """Whether a native algorithm is preferred: for more than 100 nodes, or 12 with balance."""
        limit = SUM_NODES if self.preferred_formulation == "two-index" else BALANCE_NODES
        return len(self.customers) > limit

    @np.errstate(all="ignore")  # overflow yields NaN, which the checks treat as a violation
    def verify(self, plan: FleetPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Compute the objective and check every constraint from the distances and routes alone."""
        return verify_routes(self, plan, tolerance)

    def with_schedule(self, routes: Iterable[Iterable[int]]) -> FleetPlan:
        """Return the plan of `routes` with an exact schedule; without times if the model has none.

        The return is the earliest one, and the departure the latest one for it. If the duration has a
        cost, the duration is the least possible. If a route has no feasible schedule, its services are
        as early as possible, and the verification names the violated limits.

        Parameters
        ----------
        routes : iterable of iterable of int
            Nodes of the route of each vehicle, without the depots.
        """
        rows = tuple(tuple(int(node) for node in route) for route in routes)
        plan = FleetPlan(rows)
        if not self.has_times or len(rows) != self.vehicles:
            return plan
        for k, route in enumerate(rows):
            check_entries(f"routes[{k}]", route, 0, self.size - 1, "routes")
        return FleetPlan(rows, tuple(schedule_route(self, k, row) for k, row in enumerate(rows)))

    def second_objective(self, name: str, plan: FleetPlan) -> float:
        """Return the "max", "sum", "deviation" or "range" of the route lengths."""
        return measure_of(self, name, loads_of(self, plan))

    def describe(self) -> str:
        """Return a one-line summary: vehicles, nodes, objective, limits and rich features."""
        several = f"{self.vehicles} vehicles" if self.vehicles > 1 else "1 vehicle"
        what = str(self.objective)
        if self.objective in (Objective.VARIANCE, Objective.DEVIATION):
            what += f", q {self.q:g}"
        limits = ", ".join(name.replace("_limit", "") for name in self.limits)
        more = f", limits: {limits}" if limits else ""
        # An objective is named above.
        features = list_unsupported(self, frozenset({"cost", "makespan"}))
        more += f", features: {features}" if features else ""
        return f"{several}, {len(self.customers)} nodes, {what}{more}"
