"""The independent check of a route: it is walked from the raw data, in plain Python."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ..fields import show
from ..resource_routing.route import Route, route_of_indices
from ..verification import ROUNDING, Check, Verification, check_tolerance
from .data import RoutingData

__all__ = ["Stop", "verify_route", "walk_route"]


@dataclass(frozen=True)
class Stop:
    """Stop of a route with the errors before and after correction.

    The errors are worst-case errors: every correction that may fail does.

    Parameters
    ----------
    point : int
        Index of the point.
    kind : str
        Kind of the point.
    distance : float
        Length of the route up to the point, m.
    horizontal, vertical : float
        Errors on arrival.
    horizontal_after, vertical_after : float
        Errors on leaving.
    suspect : bool
        Whether the correction may fail.
    chance : float
        Probability that no threshold is exceeded up to and including this stop.
    """

    point: int
    kind: str
    distance: float
    horizontal: float
    vertical: float
    horizontal_after: float
    vertical_after: float
    suspect: bool = False
    chance: float = 1.0


def _length(legs: list[float]) -> float:
    """Return the correctly rounded sum of the legs, m; inf on overflow."""
    try:
        return math.fsum(legs)
    except OverflowError:
        return math.inf


def walk_route(model: RoutingData, plan: Route) -> list[Stop]:
    """Return every stop of `plan` with its errors, recomputed from coordinates and rates.

    The errors are worst-case errors; :attr:`Stop.chance` is a probability over all cases. Corrections
    fail independently, so each error has a separate distribution. It has few values, as a successful
    correction resets the error.
    """
    stops: list[Stop] = []
    legs: list[float] = []
    horizontal = vertical = 0.0
    chances: list[dict[float, float]] = [{0.0: 1.0}, {0.0: 1.0}]
    for place, point in enumerate(route_of_indices(plan.route, len(model.points)).route):
        kind, code = str(model.kinds[point]), int(model.codes[point])
        suspect = model.suspect is not None and bool(model.suspect[point])
        if place:
            leg = math.dist(model.points[plan.route[place - 1]], model.points[point])
            legs.append(leg)
            horizontal += model.horizontal_rate * leg
            vertical += model.vertical_rate * leg
            gained = (model.horizontal_rate * leg, model.vertical_rate * leg)
            for axis, gain in enumerate(gained):
                limit = model.limits[code, axis] * (1 + ROUNDING)
                chances[axis] = {
                    error + gain: share
                    for error, share in chances[axis].items()
                    if error + gain <= limit
                }
        chance = sum(chances[0].values()) * sum(chances[1].values())
        residual = float(model.residual or 0.0) if suspect else 0.0
        after = (
            min(horizontal, residual) if kind == "horizontal" else horizontal,
            min(vertical, residual) if kind == "vertical" else vertical,
        )
        if kind in ("horizontal", "vertical"):
            axis = 0 if kind == "horizontal" else 1
            success = model.success if suspect else 1.0
            corrected: dict[float, float] = {}
            for error, share in chances[axis].items():
                for value, part in ((0.0, success), (min(error, residual), 1.0 - success)):
                    if part:
                        corrected[value] = corrected.get(value, 0.0) + part * share
            chances[axis] = corrected
        stops.append(
            Stop(
                point,
                kind,
                _length(legs),
                horizontal,
                vertical,
                *after,
                suspect,
                min(chance, 1.0),
            )
        )
        horizontal, vertical = after
    return stops


def verify_route(model: RoutingData, plan: Route, tolerance: float) -> Verification:
    """Compute the length and check every constraint of the paper from the raw data."""
    check_tolerance(tolerance)
    if not isinstance(plan, Route):
        raise InvalidData(f"plan must be a Route, got {show(plan)}", field="plan")
    stops = walk_route(model, plan)
    ends = [
        _count(model, "starts at A", "2", stops[:1], lambda s: s.kind != "A", len(stops) < 1),
        _count(model, "ends at B", "3", stops[-1:], lambda s: s.kind != "B", len(stops) < 2),
        _count(
            model, "only correction points between", "4-5", stops[1:-1], lambda s: s.kind in "AB"
        ),
    ]
    if not model.revisits:
        visited: set[int] = set()
        repeated = [s for s in stops if s.point in visited or visited.add(s.point)]  # type: ignore[func-returns-value]
        ends.append(_count(model, "no point twice", "4-5", repeated, lambda s: True))
    if model.corrections_limit is not None:
        limit = model.corrections_limit
        excess = max(plan.corrections - limit, 0)
        ends.append(
            Check(f"at most {limit} corrections", "", float(excess), "points", 0.0, "", 0.0)
        )
    thresholds = [
        _worst(
            model,
            "horizontal error at vertical points",
            "9",
            "vertical",
            model.alpha2,
            stops,
            tolerance,
        ),
        _worst(
            model,
            "vertical error at vertical points",
            "10",
            "vertical",
            model.alpha1,
            stops,
            tolerance,
        ),
        _worst(
            model,
            "horizontal error at horizontal points",
            "13",
            "horizontal",
            model.beta2,
            stops,
            tolerance,
        ),
        _worst(
            model,
            "vertical error at horizontal points",
            "14",
            "horizontal",
            model.beta1,
            stops,
            tolerance,
        ),
        _worst(model, "horizontal error at B", "17", "B", model.theta, stops, tolerance),
        _worst(model, "vertical error at B", "18", "B", model.theta, stops, tolerance),
    ]
    length = stops[-1].distance if len(stops) > 1 else None
    # The scale of a length is the length itself.
    return Verification(length, (*ends, *thresholds), scale=0.0)


def _count(
    model: RoutingData, name: str, equation: str, stops: list[Stop], bad: Any, short: bool = False
) -> Check:
    wrong = [f"point {model.label(s.point)}" for s in stops if bad(s)]
    where = "a route too short" if short else wrong[0] if wrong else ""
    return Check(name, equation, float(len(wrong) + short), "points", 0.0, where, 0.0)


def _worst(
    model: RoutingData,
    name: str,
    equation: str,
    kind: str,
    limit: float,
    stops: list[Stop],
    tolerance: float,
) -> Check:
    axis = name.partition(" ")[0]
    arrivals = [(getattr(s, axis), s) for s in stops[1:] if s.kind == kind]
    worst, where = 0.0, ""
    if arrivals:
        error, stop = max(arrivals, key=lambda pair: pair[0])
        worst, where = max(error - limit, 0.0), f"point {model.label(stop.point)}"
    # Rounding is relative to the error, which is close to the threshold here.
    return Check.scaled(name, equation, worst, "error", where, tolerance, limit, limit=limit)
