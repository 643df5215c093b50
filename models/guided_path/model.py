"""Tour of a guided vehicle along a path with precedence constraints.

Source: "Exact and Heuristic Algorithms for Routing AGV on Path with Precedence Constraints",
Mathematical Problems in Engineering 2016, article 5040513, doi 10.1155/2016/5040513.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..verification import TOLERANCE, Verification
from .checks import verify_tour
from .data import GuidedPathData
from .extensions import check_extensions, extensions_of
from .plan import GuidedPathPlan
from .schedule import labels_of, walk_of

__all__ = ["GuidedPathTour"]


class GuidedPathTour(GuidedPathData):
    r"""Shortest tour along a line from the start through all customers and back.

    With the coordinates :math:`x_i` and the order :math:`\pi` of service, minimise
    :math:`|x_{\pi_1} - x_0| + \sum_k |x_{\pi_{k+1}} - x_{\pi_k}| + |x_0 - x_{\pi_n}|` subject to
    the precedence constraints. The problem is known as the travelling salesman problem on a path
    with precedence constraints (TSPP-PC). It is strongly NP-hard, by reduction from the shortest
    common supersequence of binary words.

    Parameters
    ----------
    coordinates : ndarray, shape (n + 1,)
        Positions of the start (entry 0) and of the customers 1 … n along the path, in metres; of any
        sign, not necessarily distinct.
    chains : list of lists of int
        Customers of each chain in their order of service. A customer may be in at most one chain.
    precedence : ndarray of int, shape (p, 2)
        Additional pairs (i, j): i must be served before j. Any acyclic relation, in addition to
        chains or instead of them.
    ids : sequence of int or str, optional
        Names of the start and the customers.
    end : None, "free" or float
        End of the tour: the start, the last customer, or a coordinate in metres.
    loads : ndarray, shape (n + 1,), optional
        Load at the start (entry 0) and the signed change at each customer, in any unit. The load must
        stay in 0 … `capacity`. With several vehicles, each one starts with entry 0.
    capacity : float, optional
        Largest load; None for no limit.
    speed : float, optional
        Speed in metres per second. It determines times; windows need it.
    service : ndarray, shape (n + 1,), optional
        Duration of service in seconds; entry 0 before the departure.
    windows : ndarray, shape (n + 1, 2), optional
        Earliest and latest begin of service in seconds; infinity (null in JSON) for no latest time.
        The vehicle may wait. Row 0: earliest begin at the start, and latest time at the end of the tour.
        Windows are constraints; the objective remains the length.
    track : "line", Track or dict
        ``{"loop": length}`` in metres: coordinates are distances from the origin of the loop, and the vehicle
        takes the shorter way. ``{"tree": edges, "at": edge of each stop}``: edges are triples of two nodes
        from 0 and a length in metres, and coordinates are distances from the first node of the edge.
    vehicles : ndarray, shape (m,), optional
        Starts of all vehicles on the line in ascending order, in metres, the first at ``coordinates[0]``. They
        cannot pass one another, and each returns to its start. A chain is served by one vehicle. The
        objective is the total length, including the ways on which a vehicle makes room for another one.

    Raises
    ------
    InvalidData
        No customers, an unknown customer number, a customer in two chains, a cycle, NaN, or optional
        fields that contradict one another. The message contains field, place and value.

    Examples
    --------
    >>> from crosstrack.models import GuidedPathTour
    >>> model = GuidedPathTour([0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]])
    >>> print(model.describe())
    4 customers, 2 chains
    >>> print(model.verify(model.as_plan({"order": [3, 4, 2, 1]})).objective)
    8.0
    """

    kind: ClassVar[str] = "guided-path-tour"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = GuidedPathPlan
    formulations: ClassVar[dict[str, Any]] = {
        "sweeps": ".models.guided_path.sweeps:SweepsFormulation",
        "arcs": ".models.guided_path.arcs:ArcsFormulation",
    }
    default_formulation: ClassVar[str] = "sweeps"

    def check(self) -> None:
        """Validate the relation and the optional fields."""
        super().check()
        check_extensions(self)

    @property
    def preferred_backend(self) -> str:
        """``track-search`` for optional fields, dynamic programming for two chains; otherwise empty.

        The dynamic program is 4 to 6 times faster than A* for two chains.
        """
        if extensions_of(self):
            return "track-search"
        heads = sum(
            not came and bool(goes) for came, goes in zip(self.before, self.after, strict=True)
        )
        return "dynamic-programming" if heads == 2 and self.is_disjoint else ""

    @np.errstate(all="ignore")  # overflow yields inf or NaN, which is a violation
    def verify(self, plan: GuidedPathPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the length and the violation of every constraint, by walking the path.

        Parameters
        ----------
        plan : GuidedPathPlan
            The plan.
        tolerance : float
            Largest relative violation accepted.

        Returns
        -------
        Verification
            Objective (m) and checks.
        """
        return verify_tour(self, plan, tolerance)

    def describe(self) -> str:
        """Return a short description of the size."""
        customers = self.size - 1
        words = [f"{customers} customer{'s' if customers > 1 else ''}"]
        for count, noun in ((len(self.chains), "chain"), (len(self.precedence), "pair")):
            words += [f"{count} {noun}{'s' if count > 1 else ''}"] * (count > 0)
        if self.vehicles is not None:
            words.append(f"{len(self.vehicles)} vehicles")
        words += [name for name in extensions_of(self) if name != "vehicles"]
        return ", ".join(words)

    def details(self, plan: GuidedPathPlan) -> list[dict[str, Any]]:
        """Return one row per stop with vehicle, place, distance, time and load; see :meth:`.Model.details`."""
        if not extensions_of(self) and self.speed is None:
            return []
        walk = walk_of(self, plan)
        rows = zip(labels_of(self, walk), walk.vehicles, walk.places, walk.walked, strict=True)
        return [
            {
                "stop": k,
                "customer": name,
                "vehicle": vehicle,
                "position": float(place),
                "walked": float(walked),
                "begin": None if self.speed is None else float(walk.begin[k]),
                "load": None if self.loads is None else float(walk.load[k]),
            }
            for k, (name, vehicle, place, walked) in enumerate(rows)
        ]
