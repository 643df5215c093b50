"""PyVRP's model of a fleet: locations, clients, depots, vehicle types and profiles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting
from .whole import (
    FOREVER,
    costs_of,
    has_shift,
    is_fetched,
    list_backhauls,
    round_down,
    round_up,
    scales_of,
    whole_loads,
    whole_shift,
    whole_spans,
)

__all__ = ["Found", "Posed", "Unreachable"]

Ints = NDArray[np.int64]
Routes = list[list[int]]

#: Minimum mean load, so that no shorter route pays for an overload. Of two runs of 6 CPU seconds on X-n101-k25, one
#: missed the optimum by 1 % with 2,000, and none with 100,000.
DEAR = 100_000
#: Length of a forbidden arc.
BARRED = 2**32
#: Value without a limit.
ANYTHING = int(np.iinfo(np.int64).max)
#: Maximum of PyVRP's penalty for one unit, and of its factor for costs above those of distances.
PENALTY, FACTOR = 1e5, 256.0


class Unreachable(Exception):
    """A node ends before its release or its pickup, or no shift overlaps the windows of the depots."""


class Found(NamedTuple):
    """A solution: the nodes of each vehicle, and PyVRP's activities with their vehicle type."""

    routes: Routes
    activities: list[tuple[int, list[Any]]]


class Posed:
    """PyVRP's model of a fleet. Node i is location i; further locations follow.

    If `forced`, each vehicle must first visit a copy of its depot. A copy is an additional client with an
    additional load type; a vehicle has capacity for one. Arcs lead from it to nodes only. Reloads have
    their own locations; their duration is part of the travel time to them, as PyVRP starts the service
    of a depot after the releases. An open route ends at the last location, at distance 0. A client has
    one window: nodes with several are groups of clients that exclude each other. Skills and backhauls
    are profiles with forbidden arcs, and distances include the cost per metre.
    """

    def __init__(self, model: FleetRouting, forced: bool) -> None:
        self.model, self.forced = model, forced
        self.scales = scales_of(model)
        self.distances = round_up(model.distances, self.scales.length)
        loads = whole_loads(model)
        # PyVRP's penalty per unit of overload is limited, so loads must be large numbers.
        total = np.max([rows.sum(axis=0) for rows in loads[:3]], axis=0)
        factor = np.maximum(1, np.rint(DEAR * len(model.customers) / np.maximum(total, 1)))
        self.deliveries, self.pickups, self.amounts, self.capacity = (
            (rows * factor.astype(int)).tolist() for rows in loads
        )
        self.fetched = is_fetched(model)
        self.per_metre, _ = costs_of(model)
        self.homes = np.unique(model.homes).tolist()
        self.is_open = bool((model.finishes < 0).any())
        copies, reloads = self.homes if forced else [], list(model.reloads or ())
        #: Node of each location; that of the end of open routes is arbitrary.
        self.places = np.array([*range(model.size), *copies, *reloads, *[0] * self.is_open])
        self.copies = list(enumerate(copies, model.size))
        self.reloads = list(enumerate(reloads, model.size + len(copies)))
        skills = [
            None if model.skills is None else frozenset(names)
            for names in model.skills or [()] * model.vehicles
        ]
        keys = list(zip(self.per_metre.tolist(), model.speeds.tolist(), skills, strict=True))
        self.profiles = list(dict.fromkeys(keys))
        self.profile_of = [self.profiles.index(key) for key in keys]

    @property
    def penalty(self) -> float:
        """Maximum penalty of a unit of overload, lateness or length."""
        dear = float(self.per_metre.max()) * float(self.model.distances.max()) * self.scales.cost
        return PENALTY * min(max(dear / max(int(self.distances.max()), 1), 1.0), FACTOR)

    def longest(self, found: Found) -> int:
        """Return the length of the longest route, in whole-number units."""
        lengths = [0]
        for k, route in enumerate(found.routes):
            if route:
                end = int(self.model.finishes[k])
                stops = [int(self.model.homes[k]), *route, *([end] if end >= 0 else [])]
                lengths.append(int(self.distances[stops[:-1], stops[1:]].sum()))
        return max(lengths)

    def data(self, limit: float) -> Any:
        """Return PyVRP's data, with routes of length at most `limit` in whole-number units.

        Raises
        ------
        Unreachable
            A node that must be visited cannot be visited in time.
        """
        from pyvrp import Location, ProblemData, VehicleType

        #: Node of each client, -1 for a copy of a depot; node of each depot; pair of each shipment.
        self.nodes: list[int] = []
        self.stops: list[int] = []
        self.pairs: list[list[int]] = []
        distances, durations = self._matrices()
        clients, groups = self._clients()
        depots, at = self._depots()
        kinds: dict[tuple[tuple[str, Any], ...], list[int]] = {}
        for k in range(self.model.vehicles):
            if has_shift(self.model, k, self.scales):
                kinds.setdefault(tuple(self._vehicle(k, at).items()), []).append(k)
        if not kinds:
            raise Unreachable
        self.members = list(kinds.values())
        # The limit does not change the kinds, because a start refers to them.
        most = ANYTHING if math.isinf(limit) else int(limit)
        types = []
        for kind, members in kinds.items():
            fields = dict(kind)
            fields["max_distance"] = min(fields["max_distance"], most)
            types.append(VehicleType(len(members), **fields))
        return ProblemData(
            [Location(0, 0) for _ in self.places], clients, depots, types, distances, durations,
            groups, list(self._shipments()),
        )  # fmt: skip

    def _matrices(self) -> tuple[list[Any], list[Any]]:
        """Return the distances, in units of cost if they have one, and the durations of each profile."""
        model, count = self.model, len(self.places)
        spread = np.ix_(self.places, self.places)
        barred = np.zeros((count, count), bool)
        copies = [place for place, _ in self.copies]
        barred[:, copies] = True
        barred[copies] = True
        barred[np.ix_(np.array(copies, int), model.customers)] = False
        for place, home in self.copies:
            barred[home, place] = False
        if self.is_open:
            barred[-1] = True
        if model.backhauls:
            first, last = list_backhauls(model)
            sources = np.array([*self.homes, *copies, *(place for place, _ in self.reloads)])
            barred[np.ix_(sources, last)] = True
            barred[np.ix_(last, first)] = True
        distances, durations = [], []
        times: dict[float, Ints] = {}
        for per_metre, speed, skills in self.profiles:
            lengths = self.distances
            if per_metre > 0.0:
                lengths = round_up(model.distances, per_metre * self.scales.cost)
            matrix = self._from_home(lengths[spread])
            matrix[barred] = BARRED
            for node in self._lacking(skills):
                matrix[node, :] = matrix[:, node] = BARRED
            np.fill_diagonal(matrix, 0)
            distances.append(matrix)
            if speed not in times:
                times[speed] = self._durations(speed)
            durations.append(times[speed])
        return distances, durations

    def _from_home(self, matrix: Ints) -> Ints:
        """Return `matrix` with 0 from each home to its copy, and to the end of open routes."""
        for place, home in self.copies:
            matrix[home, place] = 0
        if self.is_open:
            matrix[:, -1] = 0
        return matrix

    def _lacking(self, skills: frozenset[str] | None) -> list[int]:
        """Return the locations of nodes and reloads that vehicles with `skills` must not visit."""
        requires, known = self.model.requires, skills or frozenset()
        stops = [(node, node) for node in self.model.customers.tolist()] + self.reloads
        return [place for place, node in stops if requires and not known.issuperset(requires[node])]

    def _durations(self, speed: float) -> Ints:
        if not self.model.has_times:
            return np.zeros((len(self.places),) * 2, np.int64)
        whole = round_up(self.model.base_times / speed, self.scales.time)
        matrix = whole[np.ix_(self.places, self.places)]
        for place, node in self.reloads:
            matrix[:, place] += self._service(node)
        matrix = self._from_home(matrix)
        np.fill_diagonal(matrix, 0)
        return matrix

    def _service(self, node: int) -> int:
        service = self.model.service
        return 0 if service is None else int(round_up(service[node], self.scales.time))

    def _clients(self) -> tuple[list[Any], list[Any]]:
        """Return the clients, and the groups of clients that exclude each other."""
        from pyvrp import Client, ClientGroup

        model, scales = self.model, self.scales
        clients: list[Any] = []
        groups: list[Any] = []
        extra = [0] * self.forced
        alone = set(model.customers[~self.fetched[model.customers]].tolist())
        alone.difference_update(*(model.groups or ()))
        for group in [*(model.groups or ()), *((node,) for node in sorted(alone))]:
            required = not model.optional[group[0]]
            choices = [
                (node, release, window)
                for node in group
                for release in [scales.release(model, node)]
                for window in whole_spans(model, node, scales)
                if release <= window[1]
            ]
            if required and not choices:
                raise Unreachable
            several = len(choices) > 1
            if several:
                own = range(len(clients), len(clients) + len(choices))
                groups.append(ClientGroup(list(own), required))
            for node, release, (early, late) in choices:
                clients.append(
                    Client(
                        node, self.deliveries[node] + extra, self.pickups[node] + extra,
                        self._service(node), early, _late(late), release, scales.prize(model, node),
                        required and not several, len(groups) - 1 if several else None,
                    )
                )  # fmt: skip
                self.nodes.append(node)
        for place in (place for home in model.homes for place, node in self.copies if node == home):
            clients.append(Client(place, [*[0] * len(self.capacity[0]), DEAR]))
            self.nodes.append(-1)
        return clients, groups

    def _shipments(self) -> Iterator[Any]:
        """Yield the pairs of pickup and delivery."""
        from pyvrp import Shipment

        model = self.model
        for pair, amount in zip(
            [] if model.pairs is None else model.pairs.tolist(), self.amounts, strict=True
        ):
            (early, late), (begin, end) = (
                whole_spans(model, node, self.scales)[0] for node in pair
            )
            required = not model.optional[pair].all()
            if end < early and required:
                raise Unreachable
            if end >= early:
                self.pairs.append(pair)
                first, second = pair
                yield Shipment(
                    first, second, early, _late(late), self._service(first),
                    begin, _late(end), self._service(second), amount + [0] * self.forced,
                    sum(self.scales.prize(model, node) for node in pair), required,
                )  # fmt: skip

    def _depots(self) -> tuple[list[Any], dict[int, int]]:
        """Return the depots, reloads last, and the depot of each node at which routes start or end."""
        from pyvrp import Depot

        model = self.model
        depots: list[Any] = []
        at: dict[int, int] = {}
        for node in np.union1d(model.homes, model.finishes).tolist():
            at[node] = len(depots)
            early, late = whole_spans(model, node, self.scales)[0]
            depots.append(Depot(node if node >= 0 else len(self.places) - 1, early, _late(late)))
            self.stops.append(node)
        for place, node in self.reloads:
            service = self._service(node)
            for early, late in whole_spans(model, node, self.scales):
                depots.append(Depot(place, early + service, _late(late + service)))
                self.stops.append(node)
        return depots, at

    def _vehicle(self, k: int, at: dict[int, int]) -> dict[str, Any]:
        """Return the arguments of the vehicle type of vehicle `k`, except the number of vehicles."""
        model, scales = self.model, self.scales
        per_metre = float(self.per_metre[k])
        longest = ANYTHING
        if model.battery is not None:
            scale = per_metre * scales.cost or scales.length
            longest = min(longest, int(round_down(model.battery[k], scale)))
        if model.backhauls or self._lacking(self.profiles[self.profile_of[k]][2]):
            longest = min(longest, BARRED - 1)
        duration = math.inf if model.max_duration is None else model.max_duration[k]
        most = FOREVER if model.max_reloads is None else int(model.max_reloads[k])
        early, late = whole_shift(model, k, scales)
        reloads = range(len(at), len(self.stops)) if most else ()
        return {
            "capacity": (*self.capacity[k], *[DEAR] * self.forced),
            "start_depot": at[int(model.homes[k])],
            "end_depot": at[int(model.finishes[k])],
            "fixed_cost": scales.fixed(model, k),
            "tw_early": early,
            "tw_late": _late(late),
            "shift_duration": _late(int(round_down(duration, scales.time))),
            "max_distance": longest,
            "unit_distance_cost": int(per_metre > 0.0),
            "unit_duration_cost": scales.rates[k],
            "profile": self.profile_of[k],
            "reload_depots": tuple(reloads),
            "max_reloads": most,
        }

    def read(self, solution: Any) -> Found:
        """Return the routes of `solution`."""
        from pyvrp import Activity

        routes: Routes = [[] for _ in range(self.model.vehicles)]
        free = [iter(members) for members in self.members]
        activities = []
        for route in solution.routes():
            kind = route.vehicle_type()
            # Copies at once, because PyVRP's own objects end with the iteration.
            inner = [Activity(stop.type, stop.idx) for stop in route][1:-1]
            activities.append((kind, inner))
            nodes = []
            for stop in inner:
                if stop.is_shipment():
                    nodes.append(self.pairs[stop.idx][stop.is_delivery()])
                else:
                    nodes.append((self.nodes if stop.is_client() else self.stops)[stop.idx])
            routes[next(free[kind])] = [node for node in nodes if node >= 0]
        return Found(routes, activities)


def _late(moment: int) -> int:
    """Return `moment`, or PyVRP's infinity."""
    return ANYTHING if moment >= FOREVER else moment
