"""A UAV route with error-correction points.

Source: "Model and algorithm of UAV path planning considering error correction points", Computer
Integrated Manufacturing Systems, 2022, doi 10.13196/j.cims.2022.04.003.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Optional, Real, declared, frozen, show
from ..labels import Ids
from ..model import Model
from ..verification import ROUNDING, TOLERANCE, Check, Verification, check_tolerance
from .points import END, HORIZONTAL, KIND_WORDS, START, VERTICAL, Kinds

__all__ = ["END", "HORIZONTAL", "START", "VERTICAL", "ErrorCorrectionRouting", "Route"]


@dataclass(frozen=True)
class Route:
    """A flight from point to point; a sequence of its points: ``len``, iteration, ``route[0]``.

    Parameters
    ----------
    route : tuple of int
        Indices into the model's points, from A to B.
    """

    route: tuple[int, ...]

    def __post_init__(self) -> None:
        route = Array(("stops",), int).coerce("route", self.route, {})
        object.__setattr__(self, "route", tuple(route.tolist()))

    @property
    def corrections(self) -> int:
        """Number of corrections on the way."""
        return max(len(self.route) - 2, 0)

    def __len__(self) -> int:
        return len(self.route)

    def __iter__(self) -> Iterator[int]:
        return iter(self.route)

    def __getitem__(self, place: int) -> int:
        return self.route[place]

    def __str__(self) -> str:
        return "-".join(map(str, self.route))


def _length(legs: list[float]) -> float:
    """Return the sum of the legs, exactly rounded; infinity where it is beyond all floats."""
    try:
        return math.fsum(legs)
    except OverflowError:
        return math.inf


@dataclass(frozen=True)
class Stop:
    """One stop of a route: the errors on arrival and on leaving, before and after correction."""

    point: int
    kind: str
    distance: float
    horizontal: float
    vertical: float
    horizontal_after: float
    vertical_after: float


@dataclass(frozen=True, eq=False, repr=False)
class ErrorCorrectionRouting(Model[Route]):
    """The shortest route from A to B whose positioning errors are corrected in time.

    Flying a distance d adds ``horizontal_rate * d`` to the horizontal error and
    ``vertical_rate * d`` to the vertical one. A vertical correction point may be visited only if
    the vertical error on arrival is at most `alpha1` and the horizontal one at most `alpha2`; the
    vertical error is 0 afterwards. A horizontal one only if the vertical error is at most `beta1`
    and the horizontal one at most `beta2`; the horizontal error is 0 afterwards. At B both are at
    most `theta`. Minimise the straight-line length of the route.

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
    delta : float, optional
        Both rates at once, instead of the two; read them back as the two.

    Raises
    ------
    InvalidData
        Naming field, row and value: NaN, wrong shapes, unknown kinds, negative thresholds or
        rates, not one A and one B, ids that repeat.
    """

    points: NDArray[np.float64] = declared(Array(("n", 3)))
    kinds: NDArray[np.str_] = declared(Kinds())
    alpha1: float = declared(Real(lower=0))
    alpha2: float = declared(Real(lower=0))
    beta1: float = declared(Real(lower=0))
    beta2: float = declared(Real(lower=0))
    theta: float = declared(Real(lower=0))
    horizontal_rate: float = declared(Real(lower=0), default=None)
    vertical_rate: float = declared(Real(lower=0), default=None)
    revisits: bool = declared(Flag(), default=False)
    ids: tuple[int | str, ...] | None = declared(Optional(Ids()), default=None)
    delta: InitVar[float | None] = None

    kind: ClassVar[str] = "error-correction"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.error_correction.paper:PaperFormulation",
        "arc-flow": ".models.error_correction.arc_flow:ArcFlowFormulation",
    }
    default_formulation: ClassVar[str] = "arc-flow"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = Route

    def __post_init__(self, delta: float | None) -> None:
        rates = {"horizontal_rate": self.horizontal_rate, "vertical_rate": self.vertical_rate}
        given = [name for name, value in rates.items() if value is not None]
        if delta is not None:
            if given:
                raise InvalidData(
                    f"delta stands for both rates: give it or {given[0]}, not both", field="delta"
                )
            delta = Real(lower=0).coerce("delta", delta, {})
            for name in rates:
                object.__setattr__(self, name, delta)
        elif len(given) < 2:
            absent = next(name for name in rates if name not in given)
            raise InvalidData(
                f"{absent} is missing: give delta, or horizontal_rate and vertical_rate",
                field=absent,
            )
        super().__post_init__()

    def check(self) -> None:
        """Refuse anything but one A and one B."""
        for code, word in ((START, "A"), (END, "B")):
            rows = np.flatnonzero(self.codes == code).tolist()
            if len(rows) != 1:
                found = f"rows {show(rows)}" if rows else "none"
                raise InvalidData(
                    f"kinds must hold {word!r} exactly once, got {found}", field="kinds"
                )

    @classmethod
    def input_names(cls) -> frozenset[str]:
        """Allow ``delta`` in files and in the constructor."""
        return frozenset({"delta"})

    @classmethod
    def from_data(cls, data: Mapping[str, Any], *, name: str = "") -> ErrorCorrectionRouting:
        """Return the model in `data`; each of the two rates, or ``delta`` for both, must be there."""
        if isinstance(data, Mapping):
            for key in ("delta", "horizontal_rate", "vertical_rate"):
                if key in data and data[key] is None:
                    raise InvalidData(f"{key} must be a number, got None", field=key)
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
        return (
            f"{len(self.points)} points: {int((self.codes == HORIZONTAL).sum())} horizontal, "
            f"{int((self.codes == VERTICAL).sum())} vertical"
        )

    @cached_property
    def codes(self) -> NDArray[np.int8]:
        """The kinds as codes: ``START``, ``HORIZONTAL``, ``VERTICAL``, ``END``; shape (n,)."""
        codes = np.zeros(len(self.kinds), np.int8)
        for code, word in enumerate(KIND_WORDS):
            codes[self.kinds == word] = code
        return frozen(codes)

    @cached_property
    def start(self) -> int:
        """Index of A."""
        return int(np.flatnonzero(self.codes == START)[0])

    @cached_property
    def end(self) -> int:
        """Index of B."""
        return int(np.flatnonzero(self.codes == END)[0])

    @cached_property
    def limits(self) -> NDArray[np.float64]:
        """Largest (horizontal, vertical) error on arrival, by kind code; shape (4, 2)."""
        return frozen(
            np.array(
                [
                    [0.0, 0.0],
                    [self.beta2, self.beta1],
                    [self.alpha2, self.alpha1],
                    [self.theta, self.theta],
                ]
            )
        )

    @cached_property
    def rounded_limits(self) -> NDArray[np.float64]:
        """:attr:`limits` with what rounding excuses added, as searches compare; shape (4, 2)."""
        return frozen(self.limits + ROUNDING * self.limits)

    def label(self, point: int) -> str:
        """Return the name of `point` in its file."""
        return str(point if self.ids is None else self.ids[point])

    # -- plans -----------------------------------------------------------------------------------

    def plan_to_data(self, plan: Route) -> dict[str, Any]:
        """Return ``{"route": [indices]}``, with ``"ids"`` where the file names its points."""
        data: dict[str, Any] = {"route": list(plan.route)}
        if self.ids is not None:
            data["ids"] = [self.ids[k] for k in plan.route]
        return data

    def plan_from_data(self, data: Any) -> Route:
        """Return the route in `data`: a list of indices, ``{"route": […]}`` or ``{"ids": […]}``."""
        if isinstance(data, Mapping):
            for key in data:
                if key not in ("route", "ids"):
                    raise InvalidData(
                        f"unknown key {key!r} in a plan; allowed: route, ids", field=str(key)
                    )
            if not data:
                raise InvalidData("a plan needs the key route or ids", field="route")
            by_index = self._indices(data["route"]) if "route" in data else None
            by_id = self._from_ids(data["ids"]) if "ids" in data else None
            if by_index is not None and by_id is not None and by_index != by_id:
                raise InvalidData("route and ids of the plan name different points", field="ids")
            return by_index or by_id or Route(())
        return self._indices(data)

    def _indices(self, value: Any) -> Route:
        if isinstance(value, str | Mapping) or not isinstance(value, Sequence | np.ndarray):
            raise InvalidData(
                f"route must be a list of point indices, got {show(value)}", field="route"
            )
        route = []
        for stop, entry in enumerate(value):
            if isinstance(entry, bool) or not isinstance(entry, int | np.integer):
                raise InvalidData(
                    f"route[{stop}] must be a point index, got {show(entry)}", field="route"
                )
            if not 0 <= entry < len(self.points):
                raise InvalidData(
                    f"route[{stop}] must lie in 0 … {len(self.points) - 1}, got {show(entry)}",
                    field="route",
                )
            route.append(int(entry))
        return Route(tuple(route))

    def _from_ids(self, value: Any) -> Route:
        if isinstance(value, str | Mapping) or not isinstance(value, Sequence):
            raise InvalidData(f"ids must be a list, got {show(value)}", field="ids")
        names = range(len(self.points)) if self.ids is None else self.ids
        places = {name: k for k, name in enumerate(names)}
        for stop, entry in enumerate(value):
            if isinstance(entry, bool) or not isinstance(entry, int | str) or entry not in places:
                raise InvalidData(f"ids[{stop}]: no point is called {show(entry)}", field="ids")
        return Route(tuple(places[entry] for entry in value))

    def walk(self, plan: Route) -> list[Stop]:
        """Return every stop of `plan` with its errors, recomputed from coordinates and rates."""
        stops: list[Stop] = []
        legs: list[float] = []
        horizontal = vertical = 0.0
        for place, point in enumerate(self._indices(plan.route).route):
            if place:
                leg = math.dist(self.points[plan.route[place - 1]], self.points[point])
                legs.append(leg)
                horizontal += self.horizontal_rate * leg
                vertical += self.vertical_rate * leg
            kind = str(self.kinds[point])
            after = (
                0.0 if kind == "horizontal" else horizontal,
                0.0 if kind == "vertical" else vertical,
            )
            stops.append(Stop(point, kind, _length(legs), horizontal, vertical, *after))
            horizontal, vertical = after
        return stops

    def verify(self, plan: Route, *, tolerance: float = TOLERANCE) -> Verification:
        """Walk the route from the raw data: its length, and every constraint of the paper."""
        check_tolerance(tolerance)
        if not isinstance(plan, Route):
            raise InvalidData(f"plan must be a Route, got {show(plan)}", field="plan")
        stops = self.walk(plan)
        ends = [
            self._count("starts at A", "2", stops[:1], lambda s: s.kind != "A", len(stops) < 1),
            self._count("ends at B", "3", stops[-1:], lambda s: s.kind != "B", len(stops) < 2),
            self._count(
                "only correction points between", "4-5", stops[1:-1], lambda s: s.kind in "AB"
            ),
        ]
        if not self.revisits:
            seen: set[int] = set()
            again = [s for s in stops if s.point in seen or seen.add(s.point)]  # type: ignore[func-returns-value]
            ends.append(self._count("no point twice", "4-5", again, lambda s: True))
        thresholds = [
            self._worst(
                "horizontal error at vertical points",
                "9",
                "vertical",
                self.alpha2,
                stops,
                tolerance,
            ),
            self._worst(
                "vertical error at vertical points", "10", "vertical", self.alpha1, stops, tolerance
            ),
            self._worst(
                "horizontal error at horizontal points",
                "13",
                "horizontal",
                self.beta2,
                stops,
                tolerance,
            ),
            self._worst(
                "vertical error at horizontal points",
                "14",
                "horizontal",
                self.beta1,
                stops,
                tolerance,
            ),
            self._worst("horizontal error at B", "17", "B", self.theta, stops, tolerance),
            self._worst("vertical error at B", "18", "B", self.theta, stops, tolerance),
        ]
        length = stops[-1].distance if len(stops) > 1 else None
        # A length is its own scale.
        return Verification(length, (*ends, *thresholds), scale=0.0)

    def _count(
        self, name: str, equation: str, stops: list[Stop], bad: Any, short: bool = False
    ) -> Check:
        wrong = [f"point {self.label(s.point)}" for s in stops if bad(s)]
        where = "a route too short" if short else wrong[0] if wrong else ""
        return Check(name, equation, float(len(wrong) + short), "points", 0.0, where, 0.0)

    def _worst(
        self, name: str, equation: str, kind: str, limit: float, stops: list[Stop], tolerance: float
    ) -> Check:
        axis = name.partition(" ")[0]
        arrivals = [(getattr(s, axis), s) for s in stops[1:] if s.kind == kind]
        worst, where = 0.0, ""
        if arrivals:
            error, stop = max(arrivals, key=lambda pair: pair[0])
            worst, where = max(error - limit, 0.0), f"point {self.label(stop.point)}"
        # Sums of errors round relative to themselves, and they meet the threshold there.
        return Check.scaled(name, equation, worst, "error", where, tolerance, limit, limit=limit)
