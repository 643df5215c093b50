"""PyVRP's model of a fleet: locations, clients, depots, vehicle types and profiles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting
from .whole import (
    FOREVER,
    Scales,
    costs_of,
    is_fetched,
    list_backhauls,
    round_down,
    round_up,
    scales_of,
    whole_demands,
    whole_distances,
    whole_loads,
    whole_spans,
)

__all__ = ["Found", "Posed", "Unreachable"]

Ints = NDArray[np.int64]
Routes = list[list[int]]

#: Whole number that represents the longest distance of a plain fleet, or the total demand.
LARGEST = 10**7
#: Minimum mean demand, so that no shorter route pays for an overload.
DEAR = 2000
#: Length of a forbidden arc.
BARRED = 2**32
#: Value without a limit.
ANYTHING = int(np.iinfo(np.int64).max)
#: Maximum of PyVRP's penalty for one unit, and of its factor for costs above those of distances.
PENALTY, FACTOR = 1e5, 256.0


class Unreachable(Exception):
    """The windows of a node that must be visited end before its release, or before its pickup."""


class Found(NamedTuple):
    """A solution: the nodes of each vehicle, and PyVRP's activities with their vehicle type."""

    routes: Routes
    activities: list[tuple[int, list[Any]]]


class Kind(NamedTuple):
    """Data of a vehicle, equal for all vehicles of one of PyVRP's vehicle types."""

    home: int
    end: int
    capacity: tuple[int, ...]
    battery: float
    per_metre: float
    rate: int
    fixed: int
    begin: int
    late: int
    duration: int
    speed: float
    skills: frozenset[str] | None
    reloads: int


@dataclass
class Posed:
    """PyVRP's model of a fleet. Node i is location i; further locations follow.

    If `forced`, each vehicle must first visit a copy of its depot. A copy is an additional client with an
    additional load type; a vehicle has capacity for one. Arcs lead from it to nodes only. Reloads have
    their own locations; their duration is part of the travel time to them, as PyVRP starts a trip after
    the releases of its nodes and then serves the depot. An open route ends at a location at distance 0.
    A client has one window: nodes with several are groups of clients that exclude each other. Skills and
    backhauls are profiles with forbidden arcs.
    """

    model: FleetRouting
    forced: bool
    kinds: list[Kind] = field(init=False)
    members: list[list[int]] = field(init=False)
    #: Node of each client, -1 for a copy of a depot; node of each depot; pair of each shipment.
    nodes: list[int] = field(init=False, default_factory=list)
    stops: list[int] = field(init=False, default_factory=list)
    pairs: list[list[int]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        model = self.model
        if not model.is_rich:
            self.distances, length = whole_distances(model, LARGEST)
            self.scales = Scales(length, 1.0, length, 0.0, (0,) * model.vehicles)
            demands: Any = np.zeros((model.size, 0), int)
            capacity: Any = np.zeros((model.vehicles, 0), int)
            if model.capacity is not None:
                demands, capacity = (
                    np.array(rows)[:, None] for rows in whole_demands(model, LARGEST)
                )
            self.loads = demands, np.zeros_like(demands), demands[:0], capacity
        else:
            self.scales = scales_of(model)
            self.distances = round_up(model.distances, self.scales.length)
            self.loads = whole_loads(model, LARGEST)
        # PyVRP's penalty per unit of overload is at most 1e5, so demands must be large numbers.
        total = np.max([rows.sum(axis=0) for rows in self.loads[:3]], axis=0)
        factor = np.maximum(1, np.rint(DEAR * len(model.customers) / np.maximum(total, 1))).astype(
            int
        )
        self.loads = tuple(rows * factor for rows in self.loads)
        kinds: dict[Kind, list[int]] = {}
        for k in range(model.vehicles):
            kinds.setdefault(self._kind(k), []).append(k)
        self.kinds, self.members = list(kinds), list(kinds.values())
        self.homes = sorted({kind.home for kind in self.kinds})
        self.fetched = is_fetched(model)

    def _kind(self, k: int) -> Kind:
        """Return the data of vehicle `k` in whole numbers."""
        model, scales = self.model, self.scales
        per_metre, _ = costs_of(model)
        battery, fixed = model.battery, model.fixed_cost
        begin, late = (0.0, math.inf) if model.shifts is None else model.shifts[k].tolist()
        early, last = scales.moment(begin, True), scales.moment(late, False)
        longest = math.inf if model.max_duration is None else model.max_duration[k]
        reloads = FOREVER if model.max_reloads is None else int(model.max_reloads[k])
        return Kind(
            home=int(model.homes[k]),
            end=int(model.finishes[k]),
            capacity=tuple(self.loads[3][k].tolist()),
            battery=math.inf if battery is None else float(battery[k]),
            per_metre=float(per_metre[k]),
            rate=scales.rates[k],
            fixed=0 if fixed is None else round(float(fixed[k]) * scales.cost),
            begin=early if model.has_times else 0,
            late=max(early, last) if model.has_times else FOREVER,
            duration=int(round_down(longest, scales.time)),
            speed=float(model.speeds[k]),
            skills=None if model.skills is None else frozenset(model.skills[k]),
            reloads=reloads if model.reloads else 0,
        )

    @cached_property
    def penalty(self) -> float:
        """Maximum penalty of a unit of overload, lateness or length."""
        per_metre, _ = costs_of(self.model)
        dear = float(per_metre.max()) * float(self.model.distances.max()) * self.scales.cost
        return PENALTY * min(max(dear / max(int(self.distances.max()), 1), 1.0), FACTOR)

    def longest(self, found: Found) -> int:
        """Return the length of the longest route, in whole-number units."""
        lengths = [0]
        for home, end, route in zip(
            self.model.homes, self.model.finishes, found.routes, strict=True
        ):
            if route:
                stops = [home, *route, *([end] if end >= 0 else [])]
                lengths.append(int(self.distances[stops[:-1], stops[1:]].sum()))
        return max(lengths)

    def data(self, limit: float) -> Any:
        """Return PyVRP's data, with routes of length at most `limit` in whole-number units."""
        from pyvrp import Location, ProblemData

        self.nodes, self.stops, self.pairs = [], [], []
        places = self._places
        distances, durations = self._matrices()
        clients, groups = self._clients()
        depots, at = self._depots()
        return ProblemData(
            [Location(0, 0) for _ in places], clients, depots, list(self._types(at, limit)),
            distances, durations, groups, list(self._shipments()),
        )  # fmt: skip

    @cached_property
    def _places(self) -> Ints:
        """Node of each location; that of the end of open routes is arbitrary."""
        copies = self.homes if self.forced else []
        is_open = [0] * any(kind.end < 0 for kind in self.kinds)
        nodes = [*range(self.model.size), *copies, *(self.model.reloads or ()), *is_open]
        return np.array(nodes, np.int64)

    @cached_property
    def _first_reload(self) -> int:
        return self.model.size + len(self.homes) * self.forced

    @cached_property
    def _profiles(self) -> list[tuple[float, float, frozenset[str] | None]]:
        """Cost per metre, speed and skills of each profile."""
        return list(dict.fromkeys(map(_profile, self.kinds)))

    def _matrices(self) -> tuple[list[Ints], list[Ints]]:
        """Return the distances, in units of cost if they have one, and the durations of each profile."""
        model, places, scales = self.model, self._places, self.scales
        count, first = len(places), self._first_reload
        spread = np.ix_(places, places)
        barred = np.zeros((count, count), bool)
        if self.forced:
            copies = np.arange(model.size, first)
            barred[:, copies] = True
            barred[copies] = True
            barred[self.homes, copies] = False
            barred[np.ix_(copies, model.customers)] = False
        if model.backhauls:
            first_ones, last_ones = list_backhauls(model)
            sources = [
                *self.homes,
                *range(model.size, first),
                *range(first, first + len(model.reloads or ())),
            ]
            barred[np.ix_(sources, last_ones)] = True
            barred[np.ix_(last_ones, first_ones)] = True
        distances, durations = [], []
        times: dict[float, Ints] = {}
        for per_metre, speed, skills in self._profiles:
            lengths = self.distances
            if model.is_rich and per_metre > 0.0:
                lengths = round_up(model.distances, per_metre * scales.cost)
            matrix = lengths[spread]
            for row, home in enumerate(self.homes if self.forced else (), model.size):
                matrix[home, row] = 0
            self._open(matrix)
            matrix[barred] = BARRED
            for node in self._lacking(skills):
                matrix[node, :] = matrix[:, node] = BARRED
            np.fill_diagonal(matrix, 0)
            distances.append(matrix)
            if speed not in times:
                times[speed] = self._durations(speed)
            durations.append(times[speed])
        return distances, durations

    def _lacking(self, skills: frozenset[str] | None) -> list[int]:
        """Return the nodes that vehicles with `skills` must not visit."""
        if self.model.requires is None or skills is None:
            return []
        return [
            node for node, names in enumerate(self.model.requires) if not skills.issuperset(names)
        ]

    def _durations(self, speed: float) -> Ints:
        model, places = self.model, self._places
        if not model.has_times:
            return np.zeros((len(places),) * 2, np.int64)
        matrix = round_up(model.base_times / speed, self.scales.time)[np.ix_(places, places)]
        for row, home in enumerate(self.homes if self.forced else (), model.size):
            matrix[home, row] = 0
        for column, node in enumerate(model.reloads or (), self._first_reload):
            matrix[:, column] += self._service(node)
        self._open(matrix)
        np.fill_diagonal(matrix, 0)
        return matrix

    def _open(self, matrix: Ints) -> None:
        """Make the last location the end of open routes, if there are any."""
        if any(kind.end < 0 for kind in self.kinds):
            matrix[-1], matrix[:, -1] = BARRED, 0

    def _service(self, node: int) -> int:
        service = self.model.service
        return 0 if service is None else int(round_up(service[node], self.scales.time))

    def _release(self, node: int) -> int:
        releases = self.model.releases
        return 0 if releases is None else max(0, self.scales.moment(releases[node], True))

    def _prize(self, node: int) -> int:
        optional = self.model.prizes is not None and self.model.optional[node]
        return round(float(self.model.prizes[node]) * self.scales.cost) if optional else 0

    def _clients(self) -> tuple[list[Any], list[Any]]:
        """Return the clients, and the groups of which at most one is visited."""
        from pyvrp import Client, ClientGroup

        model = self.model
        of = {node: group for group in model.groups or () for node in group}
        clients: list[Any] = []
        groups: list[Any] = []
        extra = [0] * self.forced
        visited: set[int] = set()
        for node in model.customers.tolist():
            if node in visited or self.fetched[node]:
                continue
            group = of.get(node, (node,))
            visited.update(group)
            required = not model.optional[node]
            choices = [
                (other, release, window)
                for other in group
                for release in [self._release(other)]
                for window in whole_spans(model, other, self.scales)
                if release <= window[1]
            ]
            if required and not choices:
                raise Unreachable(node)
            several = len(choices) > 1
            if several:
                first = len(clients)
                groups.append(ClientGroup(list(range(first, first + len(choices))), required))
            for other, release, (early, late) in choices:
                clients.append(
                    Client(
                        other, [*self.loads[0][other].tolist(), *extra], [*self.loads[1][other].tolist(), *extra],
                        self._service(other), early, _late(late), release, self._prize(other),
                        required and not several, len(groups) - 1 if several else None,
                    )
                )  # fmt: skip
                self.nodes.append(other)
        for home in model.homes.tolist() if self.forced else ():
            nothing = [0] * self.loads[0].shape[1]
            clients.append(Client(model.size + self.homes.index(home), [*nothing, DEAR]))
            self.nodes.append(-1)
        return clients, groups

    def _shipments(self) -> Iterator[Any]:
        """Yield the pairs of pickup and delivery."""
        from pyvrp import Shipment

        model = self.model
        for row, pair in enumerate([] if model.pairs is None else model.pairs.tolist()):
            windows = [whole_spans(model, node, self.scales)[0] for node in pair]
            required = bool((~model.optional[pair]).any())
            if windows[1][1] < windows[0][0]:
                if required:
                    raise Unreachable(pair[1])
                continue
            self.pairs.append(pair)
            yield Shipment(
                *pair, windows[0][0], _late(windows[0][1]), self._service(pair[0]),
                windows[1][0], _late(windows[1][1]), self._service(pair[1]),
                [*self.loads[2][row].tolist(), *[0] * self.forced], sum(map(self._prize, pair)),
                required,
            )  # fmt: skip

    def _depots(self) -> tuple[list[Any], dict[int, int]]:
        """Return the depots, reloads last, and the depot at the location of each start or end."""
        from pyvrp import Depot

        model, depots, at = self.model, [], {}
        for node in sorted({node for kind in self.kinds for node in (kind.home, kind.end)}):
            place = node if node >= 0 else len(self._places) - 1
            at[node] = len(depots)
            early, late = whole_spans(model, node, self.scales)[0] if node >= 0 else (0, FOREVER)
            depots.append(Depot(place, early, _late(late)))
            self.stops.append(node)
        for place, node in enumerate(model.reloads or (), self._first_reload):
            service = self._service(node)
            for early, late in whole_spans(model, node, self.scales):
                depots.append(Depot(place, early + service, _late(late + service)))
                self.stops.append(node)
        return depots, at

    def _types(self, at: dict[int, int], limit: float) -> Iterator[Any]:
        """Yield a vehicle type for each kind of vehicles."""
        from pyvrp import VehicleType

        reloads = list(range(len(at), len(self.stops)))
        is_barred = [
            bool(self._lacking(kind.skills)) or self.model.backhauls for kind in self.kinds
        ]
        for kind, members, barred in zip(self.kinds, self.members, is_barred, strict=True):
            scale = kind.per_metre * self.scales.cost or self.scales.length
            longest = limit
            if not math.isinf(kind.battery):
                longest = min(longest, math.floor(kind.battery * scale * (1 + 1e-12)))
            if barred:
                longest = min(longest, BARRED - 1)
            late, duration = _late(kind.late), _late(kind.duration)
            yield VehicleType(
                len(members), [*kind.capacity, *[DEAR] * self.forced], at[kind.home], at[kind.end],
                kind.fixed, kind.begin, late, duration,
                ANYTHING if math.isinf(longest) else int(longest),
                1 if kind.per_metre else 0, kind.rate, self._profiles.index(_profile(kind)),
                reload_depots=reloads if kind.reloads else [], max_reloads=kind.reloads,
            )  # fmt: skip

    def read(self, solution: Any) -> Found:
        """Return the routes of `solution`."""
        from pyvrp import Activity

        routes: Routes = [[] for _ in range(self.model.vehicles)]
        free = [iter(members) for members in self.members]
        activities = []
        for route in solution.routes():
            kind = route.vehicle_type()
            # Copies, because PyVRP's own objects end with the solution.
            inner = [Activity(stop.type, stop.idx) for stop in list(route)[1:-1]]
            activities.append((kind, inner))
            nodes = []
            for stop in inner:
                if stop.is_client():
                    nodes.append(self.nodes[stop.idx])
                elif stop.is_depot():
                    nodes.append(self.stops[stop.idx])
                else:
                    nodes.append(self.pairs[stop.idx][stop.is_delivery()])
            routes[next(free[kind])] = [node for node in nodes if node >= 0]
        return Found(routes, activities)


def _profile(kind: Kind) -> tuple[float, float, frozenset[str] | None]:
    return kind.per_metre, kind.speed, kind.skills


def _late(moment: int) -> int:
    """Return `moment`, or PyVRP's infinity."""
    return ANYTHING if moment >= FOREVER else moment
