"""Independent check of a route, leg by leg in plain Python."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

from ..fields import required
from ..verification import Check, Verification, check_tolerance
from .data import RoutingData
from .route import Route, route_of_indices

__all__ = ["Visit", "exact_sum", "verify_route", "walk_route"]


@dataclass(frozen=True)
class Visit:
    """Stop of a route with the level of each resource on arrival and on leaving, after waiting and reset.

    `distance` is the length up to the point, inf after a missing arc, and `value` the same less the prizes.
    """

    point: int
    distance: float
    arrival: tuple[float, ...]
    leaving: tuple[float, ...]
    value: float


def walk_route(model: RoutingData, plan: Route) -> tuple[list[Visit], list[str]]:
    """Return the stops of `plan`, and the names of the legs without an arc."""
    route = route_of_indices(plan.route, len(model.kinds)).route
    index_of = model.arc_index
    place = {word: k for k, word in enumerate(model.words)}
    levels = [resource.initial for resource in model.resources]
    visits: list[Visit] = []
    legs: list[float] = []
    prizes = [] if model.prizes is None else [-float(model.prizes[point]) for point in route]
    missing = []
    for stop, point in enumerate(route):
        code = place[model.kinds[point]]
        if stop:
            pair = route[stop - 1], point
            arc = index_of.get(pair)
            if arc is None and (model.arcs is not None or pair[0] == point):
                missing.append(f"{model.label(pair[0])}-{model.label(point)}")
                leg = math.inf
            elif arc is not None and model.lengths is not None:
                leg = float(model.lengths[arc])
            else:
                assert model.points is not None
                leg = math.dist(model.points[pair[0]], model.points[point])
            legs.append(leg)
            for k, resource in enumerate(model.resources):
                extra = 0.0 if arc is None or model.uses is None else float(model.uses[arc, k])
                # Without a rate, a missing arc of infinite length uses 0 (0 * inf is NaN).
                used = resource.rate * leg if resource.rate else 0.0
                levels[k] += used + extra + float(model.gains[code, k])
        arrival = tuple(levels)
        if stop:
            levels = [
                min(max(level, float(floor)), float(cap))
                for level, floor, cap in zip(
                    levels, model.floors[code], model.resets[code], strict=True
                )
            ]
        value = exact_sum(legs + prizes[: stop + 1])
        visits.append(Visit(point, exact_sum(legs), arrival, tuple(levels), value))
    return visits, missing


def exact_sum(legs: list[float]) -> float:
    """Return the correctly rounded sum; inf on overflow."""
    try:
        return math.fsum(legs)
    except OverflowError:
        return math.inf


def verify_route(model: RoutingData, plan: Route, tolerance: float) -> Verification:
    """Compute the length of `plan` and check every limit of `model` from the raw data."""
    check_tolerance(tolerance)
    required("plan", plan, Route)
    found = _verify_one(model, plan, tolerance)
    if not plan.others and model.routes == 1:
        return found
    return replace(found, checks=(*found.checks, *_check_others(model, plan, found, tolerance)))


def _verify_one(model: RoutingData, plan: Route, tolerance: float) -> Verification:
    """Return the verification of the first route of `plan`."""
    visits, missing = walk_route(model, plan)
    route = [visit.point for visit in visits]
    between = [model.label(k) for k in route[1:-1] if k in (model.start, model.end)]

    def count(name: str, labels: list[str]) -> Check:
        return Check.count(name, [f"point {label}" for label in labels])

    def ends(name: str, stops: list[int], *, bad: bool) -> Check:
        places = [f"point {model.label(k)}" for k in stops] or ["a route too short"]
        return Check.count(name, places if bad else [])

    checks = [
        ends("starts at the start", route[:1], bad=route[:1] != [model.start]),
        ends("ends at the end", route[-1:], bad=len(route) < 2 or route[-1] != model.end),
        count("neither start nor end between", between),
        count("arcs that there are", missing),
    ]
    if not model.revisits:
        first = {k: stop for stop, k in reversed(list(enumerate(route)))}
        repeated = [model.label(k) for stop, k in enumerate(route) if first[k] != stop]
        checks.append(count("no point twice", repeated))
    for column, resource in enumerate(model.resources):
        for word, limit in resource.limits:
            arrivals = [visit for visit in visits[1:] if model.kinds[visit.point] == word]
            checks.append(
                Check.within(
                    f"{resource.name} at {word}", [visit.arrival[column] for visit in arrivals],
                    limit, resource.unit,
                    lambda k, arrivals=arrivals: f"point {model.label(arrivals[k].point)}",
                    tolerance,
                )
            )  # fmt: skip
        for word, least in resource.lower_limits:
            arrivals = [visit for visit in visits[1:] if model.kinds[visit.point] == word]
            checks.append(
                Check.within(
                    f"least {resource.name} at {word}", [-visit.arrival[column] for visit in arrivals],
                    -least, resource.unit,
                    lambda k, arrivals=arrivals: f"point {model.label(arrivals[k].point)}",
                    tolerance, scale=least,
                )
            )  # fmt: skip
    length = visits[-1].value if len(visits) > 1 else None
    # The scale of a length is the length itself.
    return Verification(length, tuple(checks), scale=0.0)


def _check_others(
    model: RoutingData, plan: Route, first: Verification, tolerance: float
) -> list[Check]:
    """Return the checks of the further routes: feasible, different, in order and not too many."""
    routes = [Route(plan.route), *map(Route, plan.others)]
    found = [_verify_one(model, route, tolerance) for route in routes[1:]]
    values = [math.inf if one.objective is None else one.objective for one in (first, *found)]
    names = [f"others[{k}]" for k in range(len(found))]
    seen = [route.route in {other.route for other in routes[:k]} for k, route in enumerate(routes)]
    return [
        Check.count("other routes within all limits", [
            f"{name}: {one.violated[0].name}" for name, one in zip(names, found, strict=True) if not one.ok
        ]),
        Check.count("different routes", [name for name, twice in zip(names, seen[1:], strict=True) if twice]),
        Check.count("routes in the order of their lengths", [
            name for name, pair in zip(names, pairwise(values), strict=True) if pair[0] > pair[1]
        ]),
        Check.count("at most as many routes as asked for", names[model.routes - 1 :]),
    ]  # fmt: skip
