"""Dimensions, costs and choices of a rich fleet in OR-Tools' routing library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective
from .whole import (
    FOREVER,
    Scales,
    costs_of,
    list_backhauls,
    round_down,
    round_up,
    scales_of,
    whole_loads,
    whole_spans,
)

__all__ = ["Rich"]

Ints = NDArray[np.int64]

#: Whole number for the sum of all loads.
LARGEST = 10**7
#: Weight of the longest route, or of the makespan, relative to the sum.
SPAN = 100
#: Least number of copies of each reload and station in fleets with fewer customers than that, and the
#: number per vehicle in larger ones.
COPIES, PER_VEHICLE = 12, 2


@dataclass
class Rich:
    """A rich fleet in the routing library, whose place j is node `places[j]`; -1 is the end of open routes.

    Optional stops have copies, each visited at most once. After a reload, the loads since the start of
    the trip are 0 by a slack of its place. Load on board is modelled if nodes have both deliveries and
    pickups: it starts with at least the goods that the trip delivers.
    """

    model: FleetRouting
    places: list[int] = field(init=False)
    homes: list[int] = field(init=False)
    ends: list[int] = field(init=False)

    def __post_init__(self) -> None:
        model = self.model
        depots = sorted({*model.homes.tolist(), *model.finishes.tolist()})
        count = len(model.customers)
        copies = count if count <= COPIES else max(COPIES, PER_VEHICLE * model.vehicles)
        reloads = copies
        if model.max_reloads is not None:
            reloads = min(copies, int(np.minimum(model.max_reloads, count).sum()))
        self.places = [*depots, *model.customers.tolist()]
        first = len(self.places)
        self.places += [node for node in model.reloads or () for _ in range(reloads)]
        middle = len(self.places)
        self.places += [node for node in model.stations or () for _ in range(copies)]
        self.reloads, self.stations = range(first, middle), range(middle, len(self.places))
        self.homes = [depots.index(node) for node in model.homes.tolist()]
        self.ends = [depots.index(node) for node in model.finishes.tolist()]
        self.at = {node: place for place, node in enumerate(self.places[:first])}
        self.scales: Scales = scales_of(model)

    def spread(self, matrix: NDArray[Any]) -> Ints:
        """Return `matrix` over nodes as one over places; the end of open routes is at distance 0."""
        result = matrix[np.ix_(self.places, self.places)].astype(np.int64)
        outside = np.array(self.places) < 0
        result[outside], result[:, outside] = 0, 0
        return result

    def places_of(self, routes: Sequence[Sequence[int]]) -> list[list[int]] | None:
        """Return the places of `routes`; each visit of a reload or station needs another copy."""
        free = [*self.reloads, *self.stations]
        result: list[list[int]] = []
        for route in routes:
            result.append([])
            for node in route:
                place = self.at.get(node) if node in self._customers else None
                if place is None:
                    place = next((copy for copy in free if self.places[copy] == node), None)
                    if place is None:
                        return None
                    free.remove(place)
                result[-1].append(place)
        return result

    @cached_property
    def _customers(self) -> set[int]:
        return set(self.model.customers.tolist())

    def declare(self, routing: Any, manager: Any) -> None:
        """Add the model to `routing`."""
        self.routing, self.manager, self.solver = routing, manager, routing.solver()
        self.inner = [
            manager.NodeToIndex(j) for j in range(len(self.places)) if not self._is_end(j)
        ]
        self._declare_costs()
        self._declare_lengths()
        if self.model.has_times:
            self._declare_times()
        self._declare_loads()
        self._declare_pairs()
        self._declare_choices()
        self._declare_backhauls()

    def _is_end(self, place: int) -> bool:
        return place in self.homes or place in self.ends

    def _index(self, node: int) -> int:
        return int(self.manager.NodeToIndex(self.at[node]))

    def _prize(self, node: int) -> int:
        model = self.model
        optional = model.prizes is not None and model.optional[node]
        return round(float(model.prizes[node]) * self.scales.cost) if optional else 0

    @cached_property
    def _worth(self) -> dict[int, int]:
        """Penalty for each node of a group: the largest prize in the group."""
        groups = self.model.groups or ()
        return {node: max(map(self._prize, group)) for group in groups for node in group}

    def _declare_costs(self) -> None:
        """Set the cost of each arc; a node of a group with a smaller prize costs the difference."""
        model, routing = self.model, self.routing
        per_metre, _ = costs_of(model)
        lost = np.zeros(len(self.places), np.int64)
        for node, worth in self._worth.items():
            lost[self.at[node]] = worth - self._prize(node)
        matrices: dict[float, int] = {}
        for k, price in enumerate(per_metre.tolist()):
            if price not in matrices:
                whole = self.spread(round_up(model.distances, price * self.scales.cost))
                matrices[price] = routing.RegisterTransitMatrix((whole + lost[:, None]).tolist())
            routing.SetArcCostEvaluatorOfVehicle(matrices[price], k)
            if model.fixed_cost is not None:
                routing.SetFixedCostOfVehicle(
                    round(float(model.fixed_cost[k]) * self.scales.cost), k
                )

    def _dimension(
        self, name: str, transits: Sequence[int], slack: int, limits: Sequence[int], *, zero: bool = True,
    ) -> Any:  # fmt: skip
        self.routing.AddDimensionWithVehicleTransitAndCapacity(
            list(transits), int(slack), [int(limit) for limit in limits], zero, name
        )
        return self.routing.GetDimensionOrDie(name)

    def _reset(self, dimension: Any, places: Sequence[int], full: int) -> None:
        """Let `dimension` begin again at 0 after `places`, whose transit is lower by `full`."""
        resets = {int(self.manager.NodeToIndex(place)) for place in places}
        for index in self._slack_indices():
            slack = dimension.SlackVar(index)
            if index in resets:
                self.solver.Add(slack + dimension.CumulVar(index) == full)
            else:
                slack.SetValue(0)

    def _slack_indices(self) -> list[int]:
        """Return the indices of all visits that have a successor."""
        return [*self.inner, *(self.routing.Start(k) for k in range(self.model.vehicles))]

    def _declare_lengths(self) -> None:
        model = self.model
        span = SPAN if model.objective not in _SUMS else 0
        if model.objective in (Objective.VARIANCE, Objective.DEVIATION):
            span = round(min(SPAN * model.q, 1e6))
        if model.battery is None and not span:
            return
        lengths = self.spread(round_up(model.distances, self.scales.length))
        largest = int(lengths.max()) * (len(self.places) + 1)
        limits = [largest] * model.vehicles
        if model.battery is not None:
            limits = np.minimum(round_down(model.battery, self.scales.length), largest).tolist()
        full = max(limits) if self.stations else 0
        lengths[list(self.stations)] -= full
        transit = self.routing.RegisterTransitMatrix(lengths.tolist())
        dimension = self._dimension("length", [transit] * model.vehicles, full, limits)
        if self.stations:
            self._reset(dimension, self.stations, full)
        dimension.SetGlobalSpanCostCoefficient(span)

    def _declare_times(self) -> None:
        model, scales, vehicles = self.model, self.scales, range(self.model.vehicles)
        service = np.zeros(len(self.places), np.int64)
        if model.service is not None:
            service = round_up(model.service, scales.time)[self.places]
        service[[place for place in range(len(self.places)) if self._is_end(place)]] = 0
        transits: dict[float, int] = {}
        step = 0
        for speed in dict.fromkeys(model.speeds.tolist()):
            whole = self.spread(round_up(model.base_times / speed, scales.time)) + service[:, None]
            transits[speed] = self.routing.RegisterTransitMatrix(whole.tolist())
            step = max(step, int(whole.max()))
        windows = [
            whole_spans(model, node, scales) if node >= 0 else [(0, FOREVER)]
            for node in self.places
        ]
        begins = [begin for spans in windows for begin, _ in spans]
        shifts = (
            model.shifts
            if model.shifts is not None
            else np.tile([0.0, math.inf], (model.vehicles, 1))
        )
        begins += [scales.moment(begin, True) for begin, _ in shifts]
        if model.releases is not None:
            begins += [scales.moment(release, True) for release in model.releases]
        horizon = max(begins) + step * (len(self.places) + 1)
        evaluators = [transits[speed] for speed in model.speeds.tolist()]
        time = self._dimension("time", evaluators, horizon, [horizon] * model.vehicles, zero=False)
        for index in self.inner:
            _restrict(time.CumulVar(index), windows[self.manager.IndexToNode(index)], horizon)
        for k in vehicles:
            early, late = scales.moment(shifts[k, 0], True), scales.moment(shifts[k, 1], False)
            late = min(max(early, late), horizon)
            for index, place in (
                (self.routing.Start(k), self.homes[k]), (self.routing.End(k), self.ends[k])
            ):  # fmt: skip
                _restrict(time.CumulVar(index), windows[place], horizon)
                time.CumulVar(index).SetRange(early, late)
            if model.max_duration is not None:
                longest = int(round_down(model.max_duration[k], scales.time))
                time.SetSpanUpperBoundForVehicle(min(longest, horizon), k)
            time.SetSpanCostCoefficientForVehicle(scales.rates[k], k)
            if model.objective is Objective.MAKESPAN and model.max_duration is None:
                start = time.CumulVar(self.routing.Start(k))
                start.SetValue(start.Min())
            self.routing.AddVariableMinimizedByFinalizer(time.CumulVar(self.routing.End(k)))
            self.routing.AddVariableMaximizedByFinalizer(time.CumulVar(self.routing.Start(k)))
        if model.objective is Objective.MAKESPAN:
            time.SetGlobalSpanCostCoefficient(SPAN)
        if model.releases is not None:
            self._declare_releases(time, service, horizon)

    def _declare_releases(self, time: Any, service: Ints, horizon: int) -> None:
        """Add the departure of each trip, which is no earlier than the releases of its nodes."""
        model = self.model
        none = self.routing.RegisterUnaryTransitVector([0] * len(self.places))
        departure = self._dimension(
            "departure", [none] * model.vehicles, horizon, [horizon] * model.vehicles, zero=False
        )
        resets = {int(self.manager.NodeToIndex(place)) for place in self.reloads}
        for index in self._slack_indices():
            if index not in resets:
                departure.SlackVar(index).SetValue(0)
                continue
            begin = departure.SlackVar(index) + departure.CumulVar(index)
            place = self.manager.IndexToNode(index)
            end = time.CumulVar(index) + time.SlackVar(index) + int(service[place])
            self.solver.Add(begin == end)
        for k in range(model.vehicles):
            start = self.routing.Start(k)
            self.solver.Add(departure.CumulVar(start) == time.CumulVar(start))
        for node in model.customers.tolist():
            release = self.scales.moment(model.releases[node], True)
            if release > 0:
                departure.CumulVar(self._index(node)).SetMin(release)

    def _declare_loads(self) -> None:
        model = self.model
        deliveries, pickups, amounts, capacity = whole_loads(model, LARGEST)
        places, vehicles = np.array(self.places), range(model.vehicles)
        outside = ~np.isin(places, model.customers)
        carried = pickups.copy()
        if model.pairs is not None:
            carried[model.pairs[:, 0]] += amounts
            carried[model.pairs[:, 1]] -= amounts
        for column in range(capacity.shape[1]):
            limits, full = capacity[:, column].tolist(), int(capacity[:, column].max())
            rows = [np.where(outside, 0, loads[places, column]) for loads in (deliveries, carried)]
            name = f"load {column}"
            if not rows[0].any() or not rows[1].any():
                self._resetting(name, rows[0] + rows[1], limits, full)
                continue
            fetched = self._resetting(f"{name} fetched", rows[1], limits, full)
            remaining = self._flowing(f"{name} to deliver", -rows[0], limits, 0, full)
            aboard = self._flowing(name, rows[1] - rows[0], limits, full, 2 * full)
            for index in [
                *self.inner,
                *map(self.routing.Start, vehicles),
                *map(self.routing.End, vehicles),
            ]:
                goods = fetched.CumulVar(index) + remaining.CumulVar(index)
                self.solver.Add(aboard.CumulVar(index) >= goods)

    def _resetting(self, name: str, loads: Ints, limits: list[int], full: int) -> Any:
        """Add a load that is 0 at the start of each trip."""
        transit = loads.copy()
        transit[list(self.reloads)] -= full
        evaluator = self.routing.RegisterUnaryTransitVector(transit.tolist())
        slack = full if self.reloads else 0
        dimension = self._dimension(name, [evaluator] * len(limits), slack, limits)
        if self.reloads:
            self._reset(dimension, self.reloads, full)
        return dimension

    def _flowing(self, name: str, loads: Ints, limits: list[int], drop: int, slack: int) -> Any:
        """Add a load of free size at the start of each trip."""
        transit = loads.copy()
        transit[list(self.reloads)] -= drop
        evaluator = self.routing.RegisterUnaryTransitVector(transit.tolist())
        most = slack if self.reloads else 0
        dimension = self._dimension(name, [evaluator] * len(limits), most, limits, zero=False)
        resets = {int(self.manager.NodeToIndex(place)) for place in self.reloads}
        for index in self._slack_indices() if self.reloads else ():
            if index not in resets:
                dimension.SlackVar(index).SetValue(0)
        return dimension

    def _declare_pairs(self) -> None:
        model, routing, solver = self.model, self.routing, self.solver
        count = len(self.places) + 1
        trips = None
        if self.reloads and (model.max_reloads is not None or model.pairs is not None):
            stops = np.isin(np.arange(len(self.places)), self.reloads).astype(int)
            evaluator = routing.RegisterUnaryTransitVector(stops.tolist())
            most = [count] * model.vehicles
            if model.max_reloads is not None:
                most = np.minimum(model.max_reloads, count).tolist()
            trips = self._dimension("trip", [evaluator] * model.vehicles, 0, most)
        if model.pairs is None or not len(model.pairs):
            return
        ranks = self._dimension(
            "rank", [routing.RegisterUnaryTransitVector([1] * len(self.places))] * model.vehicles, 0,
            [count] * model.vehicles,
        )  # fmt: skip
        for first, second in model.pairs.tolist():
            a, b = self._index(first), self._index(second)
            routing.AddPickupAndDelivery(a, b)
            solver.Add(routing.VehicleVar(a) == routing.VehicleVar(b))
            solver.Add(ranks.CumulVar(a) <= ranks.CumulVar(b))
            if trips is not None:
                solver.Add(trips.CumulVar(a) == trips.CumulVar(b))

    def _declare_choices(self) -> None:
        """Add prizes, groups, optional stops and skills."""
        model, routing = self.model, self.routing
        grouped = set()
        for group in model.groups or ():
            grouped.update(group)
            penalty = [self._worth[group[0]]] if model.optional[group[0]] else []
            routing.AddDisjunction([self._index(node) for node in group], *penalty)
        for node in model.customers[model.optional[model.customers]].tolist():
            if node not in grouped:
                routing.AddDisjunction([self._index(node)], self._prize(node))
        for place in [*self.reloads, *self.stations]:
            routing.AddDisjunction([self.manager.NodeToIndex(place)], 0)
        for node in model.customers.tolist() if model.requires is not None else ():
            names, skills = model.requires[node], model.skills or ()
            able = [k for k, known in enumerate(skills) if set(known).issuperset(names)]
            if names and len(able) < model.vehicles:
                routing.VehicleVar(self._index(node)).SetValues([-1, *able])

    def _declare_backhauls(self) -> None:
        if not self.model.backhauls:
            return
        model = self.model
        first_ones, last_ones = (list(map(self._index, nodes)) for nodes in list_backhauls(model))
        starts = [
            *map(self.routing.Start, range(model.vehicles)),
            *map(self.manager.NodeToIndex, self.reloads),
        ]
        for tails, heads in ((starts, last_ones), (last_ones, first_ones)):
            for tail in tails:
                self.routing.NextVar(tail).RemoveValues([head for head in heads if head != tail])


#: Objectives that are sums over the routes.
_SUMS = (Objective.SUM, Objective.COST, Objective.MAKESPAN)


def _restrict(moment: Any, spans: list[tuple[int, int]], horizon: int) -> None:
    """Restrict the variable `moment` to the union of `spans`."""
    moment.SetRange(min(spans[0][0], horizon), min(max(late for _, late in spans), horizon))
    end = spans[0][1]
    for early, late in spans[1:]:
        if early > end + 1:
            moment.RemoveInterval(end + 1, early - 1)
        end = max(end, late)
