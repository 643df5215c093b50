"""Checks of the rules of rich fleets, from routes and times alone; the schedule is not recomputed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..verification import Check
from .plan import FleetPlan
from .rich_data import RichData
from .specs import Spans

__all__ = [
    "RICH_CHECKS",
    "cost_of",
    "describe_visits",
    "longest_stretch",
    "makespan_of",
    "missing_times",
    "nearest_window",
    "rich_checks",
]

Floats = NDArray[np.float64]


class _Row(NamedTuple):
    """One place of a rule: the value, its limit, the scale of the tolerance, and its place in the plan."""

    value: float
    limit: float
    scale: float
    vehicle: int
    place: str = ""  #: text after the vehicle

    @property
    def where(self) -> str:
        """Name of the place."""
        return f"vehicle {self.vehicle}{self.place}"


def split_trips(model: RichData, route: tuple[int, ...]) -> list[list[int]]:
    """Return the nodes of each trip; a reload ends a trip and belongs to none."""
    trips: list[list[int]] = [[]]
    for node in route:
        if node in (model.reloads or ()):
            trips.append([])
        else:
            trips[-1].append(node)
    return trips


def describe_visits(model: RichData, plan: FleetPlan) -> list[str]:
    """Return the nodes that are visited too often or not at all, and visits of depots."""
    visits = np.bincount(
        np.array([node for route in plan.routes for node in route], int), minlength=model.size
    )
    least, most = np.zeros(model.size, int), np.zeros(model.size, int)
    most[model.customers] = 1
    least[model.customers[~model.optional[model.customers]]] = 1
    for group in model.groups or ():
        least[list(group)] = 0
    for stops in (model.reloads, model.stations):
        most[list(stops or ())] = visits.sum()
    wrong = np.flatnonzero((visits < least) | (visits > most))
    return [f"node {model.label(int(node))}" for node in wrong]


def longest_stretch(model: RichData, vehicle: int, route: tuple[int, ...]) -> float:
    """Return the longest distance of a route without a station between, in the unit of the distances."""
    longest = current = 0.0
    for tail, head in itertools.pairwise(model.path_of(vehicle, route)):
        current += float(model.distances[tail, head])
        longest = max(longest, current)
        if head in (model.stations or ()):
            current = 0.0
    return longest


def cost_of(model: RichData, plan: FleetPlan, lengths: Floats) -> float:
    """Return fixed, distance and time costs of the used vehicles, minus the prizes of visited nodes."""
    total = 0.0
    for k, route in enumerate(plan.routes):
        if route:
            total += 0.0 if model.fixed_cost is None else float(model.fixed_cost[k])
            per_metre = 1.0 if model.distance_cost is None else float(model.distance_cost[k])
            total += per_metre * float(lengths[k])
            if model.time_cost is not None and plan.starts is not None:
                total += float(model.time_cost[k]) * (plan.starts[k][-1] - plan.starts[k][0])
    if model.prizes is not None:
        visited = {node for route in plan.routes for node in route}
        nodes = [int(node) for node in model.customers if model.optional[node] and node in visited]
        total -= float(model.prizes[nodes].sum())
    return total


def makespan_of(plan: FleetPlan) -> float:
    """Return the latest return of a used vehicle, in s; 0 if none is used."""
    return max((times[-1] for times in plan.starts or () if times), default=0.0)


def _amounts(model: RichData) -> tuple[Floats, Floats]:
    """Return what each node takes from the trip's start and adds until its end, shape (n, dimensions).

    A pair adds its amount at the first node and removes it at the second.
    """
    assert model.capacity is not None
    shape = (model.size, model.capacity[0].size)
    taken, added = (
        np.zeros(shape) if array is None else array.reshape(shape) * model.is_customer[:, None]
        for array in (model.demands, model.pickups)
    )
    if model.pairs is not None:
        taken[model.pairs] = 0.0
        added[model.pairs[:, 1]] = -added[model.pairs[:, 0]]
    return taken, added


def _paths(model: RichData, plan: FleetPlan) -> Iterator[tuple[int, list[int], tuple[float, ...]]]:
    """Yield each used vehicle, the nodes of its path with both depots, and its times."""
    for k, (route, times) in enumerate(zip(plan.routes, plan.starts or (), strict=True)):
        if route:
            yield k, model.path_of(k, route), times


def nearest_window(spans: Spans, time: float) -> tuple[float, float]:
    """Return the window that contains `time` or is nearest to it; an infinite one without windows."""
    return min(
        spans or ((-math.inf, math.inf),), key=lambda span: max(span[0] - time, time - span[1])
    )


def _windows(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield the distance of each departure, service and return from the nearest of its windows."""
    assert model.windows is not None
    for k, nodes, times in _paths(model, plan):
        for node, time in zip(nodes, times, strict=False):
            begin, end = nearest_window(model.windows[node], time)
            if begin > -math.inf:
                scale = abs(end if time > end else begin)
                excess = max(begin - time, time - end)
                yield _Row(excess, 0.0, scale, k, f", node {model.label(node)}")


def _moves(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield how much earlier than possible each service and return begins."""
    service = np.zeros(model.size) if model.service is None else model.service
    for k, nodes, times in _paths(model, plan):
        for place, (tail, head) in enumerate(itertools.pairwise(nodes)):
            stay = float(service[tail]) if place else 0.0
            ready = times[place] + stay + float(model.base_times[tail, head] / model.speeds[k])
            to = f", to node {model.label(head)}"
            yield _Row(ready - times[place + 1], 0.0, abs(ready), k, to)
        if len(nodes) < len(times):
            ready = times[-2] + float(service[nodes[-1]])
            yield _Row(ready - times[-1], 0.0, abs(ready), k, ", end of the route")


def _releases(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield how much earlier than the goods of a node its trip departs.

    A trip after a reload departs when its vehicle must leave to reach the first node in time.
    """
    assert model.releases is not None
    for k, nodes, times in _paths(model, plan):
        place = 0
        for trip in split_trips(model, plan.routes[k]):
            departs = times[0]
            if place and trip:
                travel = float(model.base_times[nodes[place], trip[0]] / model.speeds[k])
                departs = times[place + 1] - travel
            for node in trip:
                release = float(model.releases[node])
                if model.is_customer[node]:
                    place_name = f", node {model.label(node)}"
                    yield _Row(release - departs, 0.0, abs(release), k, place_name)
            place += len(trip) + 1


def _shifts(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield how much a route departs before or returns after the shift of its vehicle."""
    for k, _, times in _paths(model, plan):
        begin, end = (0.0, math.inf) if model.shifts is None else model.shifts[k].tolist()
        yield _Row(begin - times[0], 0.0, abs(begin), k, ", departure")
        if end < math.inf:
            yield _Row(times[-1] - end, 0.0, abs(end), k, ", return")


def _durations(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield the duration of each route."""
    assert model.max_duration is not None
    for k, _, times in _paths(model, plan):
        limit = float(model.max_duration[k])
        if limit < math.inf:
            yield _Row(times[-1] - times[0], limit, limit, k)


def _loads(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield the largest load of each trip in each dimension."""
    assert model.capacity is not None
    limits = model.capacity.reshape(model.vehicles, -1)
    taken, added = _amounts(model)
    largest = np.maximum(limits.max(axis=0), 1e-300)
    for k, route in enumerate(plan.routes):
        for trip in split_trips(model, route):
            change = np.vstack([taken[trip].sum(axis=0), added[trip] - taken[trip]])
            for c, value in enumerate(np.cumsum(change, axis=0).max(axis=0).tolist()):
                limit = float(limits[k, c])
                dimension = f", dimension {c}" * (limits.shape[1] > 1)
                yield _Row(value, limit, limit or float(largest[c]), k, dimension)


def _backhauls(model: RichData, plan: FleetPlan) -> Iterator[str]:
    """Yield the pickups before a delivery of their trip, and trips that begin with one."""
    assert model.pickups is not None

    def positive(array: Floats | None) -> NDArray[np.bool_]:
        empty = np.zeros((model.size, 1))
        return np.asarray((empty if array is None else array.reshape(model.size, -1)).any(axis=1))

    back = positive(model.pickups) & ~positive(model.demands)
    for k, route in enumerate(plan.routes):
        for stops in split_trips(model, route):
            trip = [node for node in stops if model.is_customer[node]]  # without stations
            for place, node in enumerate(trip):
                if back[node] and (place == 0 or not back[trip[place + 1 :]].all()):
                    yield f"vehicle {k}, node {model.label(node)}"


def _pairs(model: RichData, plan: FleetPlan) -> Iterator[str]:
    """Yield the pairs without both nodes in one trip, the pickup first."""
    assert model.pairs is not None
    places = {
        node: (k, number, place)
        for k, route in enumerate(plan.routes)
        for number, trip in enumerate(split_trips(model, route))
        for place, node in enumerate(trip)
    }
    for first, second in model.pairs.tolist():
        a, b = places.get(first), places.get(second)
        if a != b and (a is None or b is None or a[:2] != b[:2] or a[2] > b[2]):
            yield f"pair {model.label(first)} to {model.label(second)}"


def _skills(model: RichData, plan: FleetPlan) -> Iterator[str]:
    """Yield the visits by a vehicle that lacks a required skill."""
    for k, route in enumerate(plan.routes):
        for node in route:
            lacks = set((model.requires or {node: ()})[node]) - set((model.skills or {k: ()})[k])
            if lacks:
                yield f"vehicle {k}, node {model.label(node)}"


def _groups(model: RichData, plan: FleetPlan) -> Iterator[str]:
    """Yield the groups with several visited nodes, or with none if its nodes have no prizes."""
    visited = {node for route in plan.routes for node in route}
    for k, group in enumerate(model.groups or ()):
        count = len(visited & set(group))
        if count > 1 or (count == 0 and not model.optional[list(group)].any()):
            yield f"group {k}"


def _reloads(model: RichData, plan: FleetPlan) -> Iterator[_Row]:
    """Yield the number of reloads of each vehicle."""
    assert model.max_reloads is not None
    for k, route in enumerate(plan.routes):
        count = len(split_trips(model, route)) - 1
        yield _Row(count, int(model.max_reloads[k]), 0.0, k)


class RichCheck(NamedTuple):
    """A check: its name, the attribute of the model that requires it, its unit and its rule.

    The rule yields the values of a limit, or the places at which a rule without a tolerance is broken.
    """

    name: str
    attribute: str
    unit: str
    rule: Callable[[RichData, FleetPlan], Iterator[_Row] | Iterator[str]]


#: Checks of rich fleets in their order.
RICH_CHECKS = (
    RichCheck("one node of each group", "groups", "", _groups),
    RichCheck("pickup before its delivery", "pairs", "", _pairs),
    RichCheck("deliveries before backhauls", "backhauls", "", _backhauls),
    RichCheck("skills of the vehicle", "requires", "", _skills),
    RichCheck("reloads within limit", "max_reloads", "", _reloads),
    RichCheck("load within capacity", "capacity", "", _loads),
    RichCheck("travel and service take their time", "has_times", "s", _moves),
    RichCheck("service within a window", "windows", "s", _windows),
    RichCheck("trip departs after releases", "releases", "s", _releases),
    RichCheck("route within shift", "has_times", "s", _shifts),
    RichCheck("duration within limit", "max_duration", "s", _durations),
)


def rich_checks(model: RichData, plan: FleetPlan, tolerance: float) -> list[Check]:
    """Return the checks of the rules of a rich `model`; `plan` has one route per vehicle.

    The tolerance of a time is relative to its limit, and to the travel and service times of its route if
    these are less. It therefore depends neither on the origin of the times nor on waiting.
    """
    checks, untimed = [], []
    if model.has_times:
        untimed = missing_times(plan)
        checks.append(Check.count("times of each route", untimed))
    work, rounding = np.zeros(model.vehicles), np.zeros(model.vehicles)
    for k, nodes, times in _paths(model, plan) if model.has_times and not untimed else ():
        service = 0.0 if model.service is None else model.service[list(plan.routes[k])].sum()
        work[k] = service + model.base_times[nodes[:-1], nodes[1:]].sum() / model.speeds[k]
        rounding[k] = min(1e-12 * max(map(abs, times)), tolerance * work[k])
    for name, attribute, unit, rule in RICH_CHECKS:
        value = getattr(model, attribute)
        if value is None or value is False or (untimed and unit):
            continue
        rows = list(rule(model, plan))
        places = [row for row in rows if isinstance(row, str)]
        values = [row for row in rows if isinstance(row, _Row)]
        if places or not rows:
            checks.append(Check.count(name, places))
            continue
        value, limits, scales = np.array([row[:3] for row in values], float).T
        vehicles = [row.vehicle for row in values]
        checks.append(
            Check.within(
                name, value, limits, unit, lambda i, rows=values: rows[i].where, tolerance,
                scale=np.minimum(scales, work[vehicles]) if unit else scales,
                noise=rounding[vehicles] if unit else 0.0,
            )
        )  # fmt: skip
    return checks


def missing_times(plan: FleetPlan) -> list[str]:
    """Return the vehicles whose times do not match their route: two more than nodes, none if idle."""
    sizes = [len(route) + 2 if route else 0 for route in plan.routes]
    actual = [len(times) for times in plan.starts or ()]
    if plan.starts is None or len(sizes) != len(actual):
        return [f"{len(actual)} vehicles with times"]
    return [f"vehicle {k}" for k, size in enumerate(sizes) if size != actual[k]]
