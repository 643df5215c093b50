"""Shortest route from a start to an end with resources that are used and reset.

Sources: S. Irnich and G. Desaulniers, "Shortest path problems with resource constraints", 2005
(the problem); "Model and algorithm of UAV path planning considering error correction points",
Computer Integrated Manufacturing Systems, 2022, doi 10.13196/j.cims.2022.04.003 (a special case).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from ..verification import TOLERANCE, Verification
from .checks import verify_route, walk_route
from .data import RoutingData
from .route import Route, route_from_data, route_to_data

__all__ = ["ResourceRouting"]


class ResourceRouting(RoutingData):
    """Shortest route from `start` to `end` within the limits of all resources, less collected prizes.

    Parameters
    ----------
    kinds : sequence of str, length n
        Kind of each point, any word; it selects limits, gains and resets.
    resources : sequence of Resource
        Resources, possibly empty.
    start, end : int
        First and last point of the route, which visits neither in between.
    points : ndarray, shape (n, d), optional
        Coordinates. Without `lengths`, the length of an arc is the straight line.
    arcs : ndarray of int, shape (m, 2), optional
        Tails and heads of the arcs, all different; by default all pairs of points are arcs.
    lengths : ndarray, shape (m,), optional
        Length of each arc in `arcs`, of either sign if no resource has a rate.
    uses : ndarray, shape (m, r), optional
        Use of each resource on each arc in `arcs`, in addition to the rate times the length.
    revisits : bool
        Whether a point may be visited more than once; False by default.
    ids : sequence of int or str, optional
        Names of the points; 0 … n-1 by default.
    prizes : ndarray, shape (n,), optional
        Prize that each point of the route subtracts from the length, in its unit; negative for a toll.
    routes : int
        Number of shortest routes to find, 1 by default. The plan has the others in ``others``.

    Raises
    ------
    InvalidData
        A field is invalid; the error names field, place and value. Examples: arcs to missing points,
        unknown kinds, neither points nor lengths, two resources with the same name, or revisits with prizes.

    Examples
    --------
    >>> from crosstrack.models import Resource, ResourceRouting
    >>> fuel = Resource("fuel", rate=1.0, limits={"town": 3, "station": 3}, resets={"station": 0})
    >>> model = ResourceRouting(
    ...     ["town", "station", "town"], [fuel], start=0, end=2, points=[[0, 0], [2, 1], [4, 0]]
    ... )
    >>> print(model.verify(model.as_plan([0, 2])).summary())
    violated: fuel at town
    >>> print(model.verify(model.as_plan([0, 1, 2])).summary())
    ok
    """

    kind: ClassVar[str] = "resource-routing"
    formulations: ClassVar[dict[str, Any]] = {
        "arc-flow": ".models.resource_routing.arc_flow:ResourceFlowFormulation",
    }
    default_formulation: ClassVar[str] = "arc-flow"
    objective_unit: ClassVar[str] = ""
    plan_type: ClassVar[type] = Route

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data, without optional fields that are None."""
        return {key: value for key, value in super().data().items() if value is not None}

    def describe(self) -> str:
        """Return a one-line summary: points, arcs and resources."""
        arcs = "" if self.arcs is None else f", {len(self.arcs)} arcs"
        names = ", ".join(resource.name for resource in self.resources) or "none"
        return f"{len(self.kinds)} points{arcs}, resources: {names}"

    @classmethod
    def remark(cls, plan: Route) -> str:
        """Return the number of intermediate points in words."""
        return f"{plan.corrections} point{'' if plan.corrections == 1 else 's'} on the way"

    # -- plans -----------------------------------------------------------------------------------

    def plan_to_data(self, plan: Route) -> dict[str, Any]:
        """Return ``{"route": [indices]}``, with ``"ids"`` if the points have names."""
        return route_to_data(plan, self.ids)

    def plan_from_data(self, data: Any) -> Route:
        """Return the route in `data`: a list of indices, ``{"route": […]}`` or ``{"ids": […]}``."""
        return route_from_data(data, len(self.kinds), self.ids)

    def details(self, plan: Route) -> list[dict[str, Any]]:
        """Return every stop with its levels on arrival and on leaving, and its limits."""
        rows = []
        for stop, visit in enumerate(walk_route(self, plan)[0]):
            row: dict[str, Any] = {
                "point": self.label(visit.point),
                "kind": self.kinds[visit.point],
                "length": visit.distance,
            }
            for k, resource in enumerate(self.resources):
                name = f"{resource.name} ({resource.unit})" if resource.unit else resource.name
                limit = float(self.limits[self.codes[visit.point], k])
                row[name] = visit.arrival[k]
                row[f"limit of {resource.name}"] = limit if stop and limit < math.inf else None
                row[f"{resource.name} after"] = visit.leaving[k]
            rows.append(row)
        return rows

    def verify(self, plan: Route, *, tolerance: float = TOLERANCE) -> Verification:
        """Compute the length and check every limit from the raw data."""
        return verify_route(self, plan, tolerance)
