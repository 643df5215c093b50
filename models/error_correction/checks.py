"""The independent check of a route: it is walked from the raw data, in plain Python."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from ..fields import required
from ..resource_routing.checks import exact_sum
from ..resource_routing.route import Route, route_of_indices
from ..verification import ROUNDING, Check, Verification, check_tolerance
from .data import RoutingData
from .no_fly import crosses

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
        Length of the route up to the point, in metres.
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
                exact_sum(legs),
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
    required("plan", plan, Route)
    stops = walk_route(model, plan)

    def count(name: str, equation: str, wrong: Iterable[Stop], *, short: bool = False) -> Check:
        places = ["a route too short"] * short
        places += [f"point {model.label(stop.point)}" for stop in wrong]
        return Check.count(name, places, unit="points", equation=equation)

    inner = stops[1:-1]
    checks = [
        count("starts at A", "2", (s for s in stops[:1] if s.kind != "A"), short=not stops),
        count("ends at B", "3", (s for s in stops[-1:] if s.kind != "B"), short=len(stops) < 2),
        count("only correction points between", "4-5", (s for s in inner if s.kind in "AB")),
    ]
    if not model.revisits:
        first = {stop.point: k for k, stop in reversed(list(enumerate(stops)))}
        repeated = (stop for k, stop in enumerate(stops) if first[stop.point] != k)
        checks.append(count("no point twice", "4-5", repeated))
    if model.corrections_limit is not None:
        most = model.corrections_limit
        excess = max(plan.corrections - most, 0)
        checks.append(Check.count(f"at most {most} corrections", excess, unit="points"))
    if model.no_fly:
        legs = [
            f"leg {model.label(one.point)}-{model.label(other.point)}"
            for one, other in pairwise(stops)
            if any(
                crosses(model.points[one.point], model.points[other.point], polygon)
                for polygon in model.no_fly
            )
        ]
        checks.append(Check.count("no leg through a no-fly polygon", legs, unit="legs"))
    for axis, kind, limit, equation in (
        ("horizontal", "vertical", model.alpha2, "9"),
        ("vertical", "vertical", model.alpha1, "10"),
        ("horizontal", "horizontal", model.beta2, "13"),
        ("vertical", "horizontal", model.beta1, "14"),
        ("horizontal", "B", model.theta, "17"),
        ("vertical", "B", model.theta, "18"),
    ):
        arrivals = [stop for stop in stops[1:] if stop.kind == kind]
        # Rounding is relative to the error, which is close to the threshold here.
        checks.append(
            Check.within(
                f"{axis} error at {'B' if kind == 'B' else f'{kind} points'}",
                [getattr(stop, axis) for stop in arrivals], limit, "error",
                lambda k, arrivals=arrivals: f"point {model.label(arrivals[k].point)}", tolerance,
                equation=equation,
            )
        )  # fmt: skip
    length = stops[-1].distance if len(stops) > 1 else None
    # The scale of a length is the length itself.
    return Verification(length, tuple(checks), scale=0.0)
