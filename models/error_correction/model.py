"""A UAV route with error-correction points.

Source: "Model and algorithm of UAV path planning considering error correction points", Computer
Integrated Manufacturing Systems, 2022, doi 10.13196/j.cims.2022.04.003.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...errors import InvalidData
from ..model import Model
from ..resource_routing.model import ResourceRouting
from ..resource_routing.route import Route, route_from_data, route_to_data
from ..verification import TOLERANCE, Verification
from .checks import Stop, verify_route, walk_route
from .data import RoutingData
from .general import resources_of
from .points import END, HORIZONTAL, START, VERTICAL

__all__ = ["END", "HORIZONTAL", "START", "VERTICAL", "ErrorCorrectionRouting", "Route", "Stop"]


@dataclass(frozen=True, eq=False, repr=False)
class ErrorCorrectionRouting(RoutingData, Model[Route]):
    """The shortest route from A to B whose positioning errors are corrected in time.

    Flying a distance d adds ``horizontal_rate * d`` to the horizontal error and
    ``vertical_rate * d`` to the vertical one. A vertical correction point may be visited only if
    the vertical error on arrival is at most `alpha1` and the horizontal one at most `alpha2`; the
    vertical error is 0 afterwards. A horizontal one only if the vertical error is at most `beta1`
    and the horizontal one at most `beta2`; the horizontal error is 0 afterwards. At B both are at
    most `theta`. Minimise the straight-line length of the route.

    The correction of a suspect point may fail: then the error is the lesser of what it was and
    `residual`. The thresholds must hold in the worst case, in which all of them fail.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Coordinates (m).
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
        Whether a point may be visited more than once; the paper's program forbids it.
    ids : sequence of int or str, optional
        The points' names in the file they come from; 0 … n-1 where there are none.
    suspect : sequence of bool, length n, optional
        Correction points whose correction may fail; none without it.
    residual : float, optional
        Most of an error that a failed correction leaves; needed where points are suspect.
    success : float
        Probability that the correction of a suspect point succeeds, each by itself: for the chance
        of arrival in :meth:`walk`, which no threshold asks for.
    corrections_limit : int, optional
        Most corrections on the way.
    delta : float, optional
        Both rates at once, instead of the two; read them back as the two.

    Raises
    ------
    InvalidData
        Naming field, row and value: NaN, wrong shapes, unknown kinds, negative thresholds or
        rates, not one A and one B, ids that repeat.
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
        """Allow ``delta`` in files and in the constructor, and ``fail`` in data of files."""
        return frozenset({"delta", "fail"})

    @classmethod
    def from_data(cls, data: Mapping[str, Any], *, name: str = "") -> ErrorCorrectionRouting:
        """Return the model in `data`; each of the two rates, or ``delta`` for both, must be there.

        What a file of points marks as ``fail`` is suspect where the residual is given.
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
        """Return the content as JSON data: ``delta`` where both rates are the same."""
        found = super().data()
        if found["horizontal_rate"] == found["vertical_rate"]:
            found["delta"] = found.pop("horizontal_rate")
            del found["vertical_rate"]
        if found["ids"] is None:
            del found["ids"]
        return found

    def describe(self) -> str:
        """Return the size in a few words."""
        count = 0 if self.suspect is None else int(self.suspect.sum())
        suspect = f", {count} suspect" if count else ""
        most = self.corrections_limit
        return (
            f"{len(self.points)} points: {int((self.codes == HORIZONTAL).sum())} horizontal, "
            f"{int((self.codes == VERTICAL).sum())} vertical{suspect}"
            + ("" if most is None else f"; at most {most} correction{'' if most == 1 else 's'}")
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
        """Return the same as a route with resources: two errors, and corrections where limited.

        What fails in the worst case is reset to the residual at the most.
        """
        none = [False] * len(self.points)
        words, resources = resources_of(
            self.kinds.tolist(),
            none if self.suspect is None else self.suspect.tolist(),
            self.limits,
            (self.horizontal_rate, self.vertical_rate),
            0.0 if self.residual is None else self.residual,
            self.corrections_limit,
        )
        return ResourceRouting(
            words, resources, self.start, self.end,
            points=self.points, revisits=self.revisits, ids=self.ids, name=self.name,
        )  # fmt: skip

    # -- plans -----------------------------------------------------------------------------------

    def plan_to_data(self, plan: Route) -> dict[str, Any]:
        """Return ``{"route": [indices]}``, with ``"ids"`` where the file names its points."""
        return route_to_data(plan, self.ids)

    def plan_from_data(self, data: Any) -> Route:
        """Return the route in `data`: a list of indices, ``{"route": […]}`` or ``{"ids": […]}``."""
        return route_from_data(data, len(self.points), self.ids)

    def walk(self, plan: Route) -> list[Stop]:
        """Return every stop of `plan` with its errors, recomputed from coordinates and rates.

        The errors are those of the worst case; :attr:`Stop.chance` counts all cases.
        """
        return walk_route(self, plan)

    @classmethod
    def remark(cls, plan: Route) -> str:
        """Return the number of corrections in words."""
        return f"{plan.corrections} correction{'' if plan.corrections == 1 else 's'}"

    def details(self, plan: Route) -> list[dict[str, Any]]:
        """Return every stop with its errors before and after correction, and what is allowed there.

        The distance is in m; errors are in the unit of the thresholds.
        """
        found = []
        for stop in self.walk(plan):
            across, up = self.limits[self.codes[stop.point]].tolist()
            bound = stop.kind != "A"
            found.append(
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
        return found

    def verify(self, plan: Route, *, tolerance: float = TOLERANCE) -> Verification:
        """Walk the route from the raw data: its length, and every constraint of the paper."""
        return verify_route(self, plan, tolerance)
