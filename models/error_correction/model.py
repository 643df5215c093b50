"""A UAV route with error-correction points.

Source: "Model and algorithm of UAV path planning considering error correction points", Computer
Integrated Manufacturing Systems, 2022, doi 10.13196/j.cims.2022.04.003.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...errors import InvalidData
from ..resource_routing.model import ResourceRouting
from ..resource_routing.resource import Resource
from ..resource_routing.route import Route, route_from_data, route_to_data
from ..verification import TOLERANCE, Verification
from .checks import Stop, verify_route, walk_route
from .data import RoutingData
from .points import END, HORIZONTAL, KIND_WORDS, START, VERTICAL

__all__ = ["END", "HORIZONTAL", "START", "VERTICAL", "ErrorCorrectionRouting", "Route", "Stop"]

#: Prefix of the kind of a suspect point in the model with resources.
_SUSPECT = "suspect "


class ErrorCorrectionRouting(RoutingData):
    """Shortest route from A to B with corrections of the positioning errors.

    Flying a distance d adds ``horizontal_rate * d`` to the horizontal error and
    ``vertical_rate * d`` to the vertical one. A vertical correction point may be visited only if
    the vertical error on arrival is at most `alpha1` and the horizontal one at most `alpha2`; the
    vertical error is 0 afterwards. A horizontal one only if the vertical error is at most `beta1`
    and the horizontal one at most `beta2`; the horizontal error is 0 afterwards. At B both are at
    most `theta`. Minimise the straight-line length of the route.

    The correction of a suspect point may fail: the error is then the minimum of its previous value and
    `residual`. The thresholds must hold in the worst case: all of these corrections fail.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Coordinates in metres.
    kinds : sequence of str, length n
        ``"A"`` (once), ``"horizontal"``, ``"vertical"``, ``"B"`` (once), in any order.
    alpha1, alpha2 : float
        Largest vertical and horizontal error on arrival at a vertical point (paper: α1, α2).
    beta1, beta2 : float
        Largest vertical and horizontal error on arrival at a horizontal point (paper: β1, β2).
    theta : float
        Largest error on arrival at B, of either kind (paper: θ).
    horizontal_rate, vertical_rate : float
        Error gained per metre flown (paper: δ for both).
    revisits : bool
        Whether a point may be visited more than once, which the paper's program forbids; False by
        default.
    ids : sequence of int or str, optional
        Names of the points; 0 … n-1 by default.
    suspect : sequence of bool, length n, optional
        Whether the correction of each point may fail; by default all corrections succeed.
    residual : float, optional
        Largest error after a failed correction; required if points are suspect.
    success : float
        Probability that the correction of a suspect point succeeds, independently of the others; 0
        by default. It determines the chance of arrival in :meth:`walk` and no threshold.
    corrections_limit : int, optional
        Maximum number of corrections on the route.
    no_fly : iterable of polygons, optional
        Polygons in the plane of the first two coordinates, in metres, as in
        :class:`~crosstrack.models.grid_path.Polygons`. No leg may cross the open interior of a polygon at any
        height. A leg may touch corners, follow an edge and end on the boundary.
    delta : float, optional
        Value of both rates, instead of the two fields; not stored under this name.

    Raises
    ------
    InvalidData
        A field is invalid; the error names field, row and value. Examples: NaN, wrong shapes, unknown
        kinds, negative thresholds or rates, not exactly one A and one B, or repeated ids.
    """

    kind: ClassVar[str] = "error-correction"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.error_correction.paper:PaperFormulation",
        "arc-flow": ".models.error_correction.arc_flow:ArcFlowFormulation",
    }
    default_formulation: ClassVar[str] = "arc-flow"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = Route
    second_objectives: ClassVar[dict[str, str]] = {"corrections": "corrections_limit"}
    second_steps: ClassVar[dict[str, float]] = {"corrections": 1.0}

    @classmethod
    def input_names(cls) -> frozenset[str]:
        """Return the additional input names: ``delta``, and ``fail`` in data of files."""
        return frozenset({"delta", "fail"})

    @classmethod
    def from_data(cls, data: Mapping[str, Any], *, name: str = "") -> ErrorCorrectionRouting:
        """Return the model in `data`, which must have both rates, or ``delta`` for both.

        Points marked as ``fail`` in a file of points are suspect if the residual is given.
        """
        if isinstance(data, Mapping):
            for key in ("delta", "horizontal_rate", "vertical_rate"):
                if key in data and data[key] is None:
                    raise InvalidData(f"{key} must be a number, got None", field=key)
            if "fail" in data:
                given = {key: value for key, value in data.items() if key != "fail"}
                if given.get("residual") is not None:
                    given.setdefault("suspect", data["fail"])
                data = given
        return super().from_data(data, name=name)

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data, with ``delta`` for equal rates."""
        content = super().data()
        if content["horizontal_rate"] == content["vertical_rate"]:
            content["delta"] = content.pop("horizontal_rate")
            del content["vertical_rate"]
        if content["ids"] is None:
            del content["ids"]
        return content

    def describe(self) -> str:
        """Return a one-line summary: points by kind, suspects and the limit on corrections."""
        count = 0 if self.suspect is None else int(self.suspect.sum())
        suspect = f", {count} suspect" if count else ""
        limit = self.corrections_limit
        zones = len(self.no_fly or ())
        return (
            f"{len(self.points)} points: {int((self.codes == HORIZONTAL).sum())} horizontal, "
            f"{int((self.codes == VERTICAL).sum())} vertical{suspect}"
            + ("" if limit is None else f"; at most {limit} correction{'' if limit == 1 else 's'}")
            + (f"; {zones} no-fly polygon{'s' * (zones > 1)}" if zones else "")
        )

    def second_objective(self, name: str, plan: Route) -> float:
        """Return the number of corrections."""
        if name != "corrections":
            return super().second_objective(name, plan)
        return float(plan.corrections)

    def limited(self, name: str, value: float) -> ErrorCorrectionRouting:
        """Return the model with at most `value` corrections, rounded down."""
        return super().limited(name, float(np.floor(value)))

    def lower(self) -> ResourceRouting:
        """Return the equivalent route with resources: two errors, and limited corrections.

        A correction that may fail resets the error to at most the residual. Legs that cross a no-fly polygon
        are no arcs.
        """
        suspect = np.zeros(len(self.points), bool) if self.suspect is None else self.suspect
        words = tuple(
            (_SUSPECT if fails else "") + kind
            for kind, fails in zip(self.kinds.tolist(), suspect, strict=True)
        )
        arrivals = sorted(set(words) - {"A"})
        code = {word: KIND_WORDS.index(word.removeprefix(_SUSPECT)) for word in arrivals}
        residual, resources = self.residual or 0.0, []
        for axis, (axis_name, rate) in enumerate(
            (("horizontal", self.horizontal_rate), ("vertical", self.vertical_rate))
        ):
            resets = {
                word: residual if word.startswith(_SUSPECT) else 0.0
                for word in arrivals
                if word.endswith(axis_name)
            }
            limits = {word: float(self.limits[code[word], axis]) for word in arrivals}
            resources.append(Resource(f"{axis_name} error", rate, limits=limits, resets=resets))
        if self.corrections_limit is not None:
            points = [word for word in arrivals if word != "B"]
            most = dict.fromkeys(points, float(self.corrections_limit))
            gains = dict.fromkeys(points, 1.0)
            resources.append(Resource("corrections", limits=most, gains=gains))
        arcs = None
        if self.free_legs is not None:
            allowed = self.free_legs.copy()
            allowed[self.end] = allowed[:, self.start] = False
            arcs = np.argwhere(allowed)
        return ResourceRouting(
            words, tuple(resources), self.start, self.end,
            points=self.points, arcs=arcs, revisits=self.revisits, ids=self.ids, name=self.name,
        )  # fmt: skip

    # -- plans -----------------------------------------------------------------------------------

    def plan_to_data(self, plan: Route) -> dict[str, Any]:
        """Return ``{"route": [indices]}``, with ``"ids"`` if the points have names."""
        return route_to_data(plan, self.ids)

    def plan_from_data(self, data: Any) -> Route:
        """Return the route in `data`: a list of indices, ``{"route": […]}`` or ``{"ids": […]}``."""
        return route_from_data(data, len(self.points), self.ids)

    def walk(self, plan: Route) -> list[Stop]:
        """Return every stop of `plan` with its errors, recomputed from coordinates and rates.

        The errors are worst-case errors; :attr:`Stop.chance` is a probability over all cases.
        """
        return walk_route(self, plan)

    @classmethod
    def remark(cls, plan: Route) -> str:
        """Return the number of corrections in words."""
        return f"{plan.corrections} correction{'' if plan.corrections == 1 else 's'}"

    def details(self, plan: Route) -> list[dict[str, Any]]:
        """Return every stop with its errors before and after correction, and its thresholds.

        The distance is in m; errors are in the unit of the thresholds.
        """
        rows = []
        for stop in self.walk(plan):
            across, up = self.limits[self.codes[stop.point]].tolist()
            bound = stop.kind != "A"
            rows.append(
                {
                    "point": self.label(stop.point),
                    "kind": stop.kind,
                    "distance (m)": stop.distance,
                    "horizontal": stop.horizontal,
                    "limit of horizontal": across if bound else None,
                    "horizontal after": stop.horizontal_after,
                    "vertical": stop.vertical,
                    "limit of vertical": up if bound else None,
                    "vertical after": stop.vertical_after,
                }
            )
        return rows

    def verify(self, plan: Route, *, tolerance: float = TOLERANCE) -> Verification:
        """Compute the length and check every constraint of the paper from the raw data."""
        return verify_route(self, plan, tolerance)
