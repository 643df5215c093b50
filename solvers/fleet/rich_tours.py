"""Best routes of rich fleets through every set of nodes, by labels with exact schedules; ours.

A label is the begin of a route. Every limit that it keeps is also kept by each of its own begins, so labels
that break one are dropped. A label is dominated by another one with the same nodes, last stop and trip if it
is no better in length, battery, reloads, loads and schedule.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective
from ...models.fleet.schedule import Piece, earliest_returns
from .whole import is_fetched, list_backhauls

__all__ = ["MOST_RICH", "best_routes", "first_routes", "refuse_rich", "value_of_sets"]

Floats = NDArray[np.float64]
Route = tuple[int, ...]

#: Maximum number of nodes to visit, and the number in this sum for a reload or a station: about half a second per
#: kind of vehicle.
MOST_RICH, STOP = 8, 2
#: Fields with a value per vehicle, beside its depots.
EACH = (
    "capacity", "battery", "speed", "shifts", "max_duration", "fixed_cost", "distance_cost", "time_cost",
    "skills", "max_reloads",
)  # fmt: skip
#: Relative excess over a limit due to rounding of sums in another order.
ROUNDING = 1e-12


def refuse_rich(model: FleetRouting) -> str:
    """Return which size or objective of a rich fleet is not supported, "" if none."""
    nodes, stops = len(model.customers), len(model.reloads or ()) + len(model.stations or ())
    if nodes + STOP * stops > MOST_RICH:
        return (
            f"rich fleets with more than {MOST_RICH} nodes and {STOP} times as many reloads and stations, got "
            f"{nodes} and {stops}"
        )
    if model.budget is not None and model.objective in (Objective.COST, Objective.MAKESPAN):
        return f"a budget with the objective {str(model.objective)!r}"
    if model.objective is Objective.DEVIATION and model.q > 0:
        return f"rich fleets with the objective {str(model.objective)!r}"
    return ""


class Label(NamedTuple):
    """Begin of a route.

    `nodes` and `trip` are the visited nodes, of the route and since the last reload, as bits. `stops` are the
    reloads and stations that the route must not visit again before the next node, as this never pays. `since`
    is the distance since a station, `load` the present load and `peak` the largest one of the trip.
    """

    route: Route
    nodes: int
    trip: int
    stops: frozenset[int]
    length: float
    since: float
    reloads: int
    load: Floats
    peak: Floats
    pieces: list[Piece]

    def dominates(self, other: Label) -> bool:
        """Return whether every continuation of `other` is no better than the same one of this label."""
        return (
            self.length <= other.length
            and self.since <= other.since
            and self.reloads <= other.reloads
            and bool((self.peak <= other.peak).all())
            and all(
                any(
                    a.first <= b.first and a.last >= b.last and a.fixed <= b.fixed and a.delay <= b.delay
                    for a in self.pieces
                )
                for b in other.pieces
            )
        )  # fmt: skip


class _Vehicle:
    """Extension of labels by the rules for vehicle `k`."""

    def __init__(self, model: FleetRouting, k: int) -> None:
        self.model, self.k = model, k
        self.bits = {int(node): 1 << place for place, node in enumerate(model.customers)}
        shape = (model.size, 1 if model.capacity is None else model.capacity[0].size)
        self.given, self.taken = (
            np.zeros(shape) if rows is None else rows.reshape(shape)
            for rows in (model.demands, model.pickups)
        )
        self.capacity = np.full(shape[1], math.inf)
        if model.capacity is not None:
            self.capacity = model.capacity[k].reshape(-1) * (1 + ROUNDING)
        self.battery = math.inf if model.battery is None else model.battery[k] * (1 + ROUNDING)
        self.fetched = is_fetched(model)
        self.origin = {b: a for a, b in ([] if model.pairs is None else model.pairs.tolist())}
        self.targets = {a: b for b, a in self.origin.items()}
        last = list_backhauls(model)[1].tolist() if model.backhauls else []
        self.back = sum(self.bits[node] for node in last)
        skills = frozenset(() if model.skills is None else model.skills[k])
        names = model.requires or [()] * model.size
        able = [node for node in range(model.size) if skills.issuperset(names[node])]
        self.reloads = [node for node in model.reloads or () if node in able]
        self.stations = [node for node in model.stations or () if node in able]
        self.nodes = [node for node in self.bits if node in able]
        # A node may be both.
        self.stops = list(dict.fromkeys([*self.reloads, *self.stations]))
        self.most = math.inf if model.max_reloads is None else float(model.max_reloads[k])

    def extensions(self, label: Label) -> Iterator[Label]:
        """Yield the labels with one more node, reload or station that keep every limit."""
        at = label.route[-1] if label.route else int(self.model.homes[self.k])
        for node in [*self.nodes, *self.stops]:
            route, leg = (*label.route, node), float(self.model.distances[at, node])
            since = label.since + leg
            if since > self.battery or node in label.stops:
                continue
            longer = self._stop(label, node) if node in self.stops else self._visit(label, node)
            if longer is None:
                continue
            since = 0.0 if node in self.stations else since
            longer = longer._replace(route=route, length=label.length + leg, since=since)
            if self.model.has_times:
                pieces = earliest_returns(self.model, self.k, route, returned=False)
                if not pieces:
                    continue
                longer = longer._replace(pieces=pieces)
            yield longer

    def _stop(self, label: Label, node: int) -> Label | None:
        """Return `label` with the trip, loads and stops after the reload or station `node`; None if forbidden.

        A new trip makes all other stops useful again, and a station all reloads, as the distance since it is less.
        """
        if node not in self.reloads:
            kept = label.stops.intersection(self.stations)
            return label._replace(stops=kept | {node})
        if label.reloads >= self.most or self._is_open(label.trip):
            return None
        kept = frozenset() if label.trip else label.stops
        zero = np.zeros(self.capacity.size)
        return label._replace(
            trip=0, reloads=label.reloads + 1, stops=kept | {node}, load=zero, peak=zero
        )

    def _visit(self, label: Label, node: int) -> Label | None:
        """Return `label` with the bits, loads and stops after a visit of `node`; None if forbidden."""
        bit, first = self.bits[node], self.origin.get(node)
        if label.nodes & bit or (first is not None and not label.trip & self.bits[first]):
            return None
        second = self.targets.get(node)
        if second is not None and label.nodes & self.bits[second]:
            return None
        is_back = bool(bit & self.back)
        if (is_back and not label.trip) or (label.trip & self.back and not is_back):
            return None
        if first is not None:
            load = peak = label.load - self.taken[first]
        elif self.fetched[node]:
            load = peak = label.load + self.taken[node]
        else:  # deliveries of the trip are on board from its begin
            load = label.load + self.taken[node]
            peak = label.peak + self.given[node]
        peak = np.maximum(np.maximum(peak, load), label.peak)
        if (peak > self.capacity).any():
            return None
        nodes, trip = label.nodes | bit, label.trip | bit
        return label._replace(nodes=nodes, trip=trip, stops=frozenset(), load=load, peak=peak)

    def _is_open(self, trip: int) -> bool:
        """Return whether a pair was picked up on the trip, but not delivered."""
        return any(trip & self.bits[a] and not trip & self.bits[b] for a, b in self.targets.items())

    def measure(self, label: Label) -> float:
        """Return the least length, cost or return of the route that ends with `label`; inf if infeasible."""
        model, k, end = self.model, self.k, int(self.model.finishes[self.k])
        leg = float(model.distances[label.route[-1], end]) if end >= 0 else 0.0
        if label.since + leg > self.battery or self._is_open(label.trip):
            return math.inf
        length, pieces = label.length + leg, list[Piece]()
        if model.has_times:
            pieces = earliest_returns(model, k, label.route)
            if not pieces:
                return math.inf
        if model.objective is Objective.MAKESPAN:
            return min(piece.earliest for piece in pieces)
        if model.objective is not Objective.COST:
            return length
        cost = length * (1.0 if model.distance_cost is None else float(model.distance_cost[k]))
        cost += 0.0 if model.fixed_cost is None else float(model.fixed_cost[k])
        if model.time_cost is not None:
            cost += float(model.time_cost[k]) * min(piece.duration for piece in pieces)
        return cost


def first_routes(model: FleetRouting, most: int) -> list[Route]:
    """Return routes of at most `most` nodes, each extended by its nearest feasible node; nodes may be missing."""
    result, used = list[Route](), 0
    for k in range(model.vehicles):
        vehicle = _Vehicle(model, k)
        zero = np.zeros(vehicle.capacity.size)
        label = Label((), used, 0, frozenset(), 0.0, 0.0, 0, zero, zero, [])
        route, visited = label.route, used
        while (label.nodes ^ used).bit_count() < most:
            longer = list(vehicle.extensions(label))
            if not longer:
                break
            label = min(longer, key=lambda one: (one.route[-1] in vehicle.stops, one.length))
            for group in model.groups or ():
                bits = sum(vehicle.bits[node] for node in group)
                if label.nodes & bits:
                    label = label._replace(nodes=label.nodes | bits)
            if label.nodes != visited and math.isfinite(vehicle.measure(label)):
                route, visited = label.route, label.nodes
        result.append(route)
        used = visited
    return result


def best_routes(
    model: FleetRouting, stopped: Callable[[], bool]
) -> list[tuple[Floats, dict[int, Route]]] | None:
    """Return for each vehicle the least measure of a route through each set of nodes, and the routes.

    The measure is the length, the cost or the return, infinite without a feasible route. None after a stop.
    """
    tables, result = dict[str, tuple[Floats, dict[int, Route]]](), []
    for k in range(model.vehicles):
        each = [model.homes, model.finishes, *(getattr(model, name) for name in EACH)]
        kind = str([np.asarray(values[k]).tolist() for values in each if values is not None])
        if kind not in tables:
            table = _best_routes(model, k, stopped)
            if table is None:
                return None
            tables[kind] = table
        result.append(tables[kind])
    return result


def _best_routes(
    model: FleetRouting, k: int, stopped: Callable[[], bool]
) -> tuple[Floats, dict[int, Route]] | None:
    """Return the entry of vehicle `k` in the tables of :func:`best_routes`."""
    vehicle = _Vehicle(model, k)
    least, routes = np.full(1 << len(model.customers), math.inf), dict[int, Route]()
    if not model.use_all:  # otherwise a route has at least a reload or a station
        least[0], routes[0] = 0.0, ()
    zero = np.zeros(vehicle.capacity.size)
    todo = deque([Label((), 0, 0, frozenset(), 0.0, 0.0, 0, zero, zero, [])])
    labels: dict[tuple[object, ...], list[Label]] = {}
    while todo:
        if stopped():
            return None
        label = todo.popleft()
        if label.route and not any(label is other for other in labels[_state(model, label)]):
            continue  # dominated since
        for longer in vehicle.extensions(label):
            others = labels.setdefault(_state(model, longer), [])
            if any(other.dominates(longer) for other in others):
                continue
            others[:] = [other for other in others if not longer.dominates(other)]
            others.append(longer)
            todo.append(longer)
            value = vehicle.measure(longer)
            if value < least[longer.nodes]:
                least[longer.nodes], routes[longer.nodes] = value, longer.route
    return least, routes


def _state(model: FleetRouting, label: Label) -> tuple[object, ...]:
    """Return the attributes that labels must share to dominate one another.

    A later release delays the begin of a trip, so its effect depends on the path since then.
    """
    path: Route = ()
    if model.releases is not None and label.reloads:
        begin = max(i for i, node in enumerate(label.route) if node in (model.reloads or ()))
        path = label.route[begin:]
    return label.nodes, label.trip, label.route[-1], label.stops, path


def value_of_sets(model: FleetRouting) -> Floats:
    """Return the negative prizes of each set of visited nodes, infinite if a required node or group is missing."""
    bits = {int(node): 1 << place for place, node in enumerate(model.customers)}
    values = np.zeros(1 << len(bits))
    sets = np.arange(values.size)
    groups = [*(model.groups or ())]
    grouped = {node for group in groups for node in group}
    for node, bit in bits.items():
        if model.prizes is not None and model.optional[node]:
            values[sets & bit > 0] -= float(model.prizes[node])
        elif node not in grouped:
            values[sets & bit == 0] = math.inf
    for group in groups:
        count = sum((sets & bits[node] > 0).astype(int) for node in group)
        least = 0 if model.optional[group[0]] else 1
        values[(count > 1) | (count < least)] = math.inf
    return values
