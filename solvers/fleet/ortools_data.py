"""Dimensions, costs and choices of a fleet in OR-Tools' routing library."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective
from .whole import (
    FOREVER,
    costs_of,
    has_shift,
    list_backhauls,
    round_down,
    round_up,
    scales_of,
    whole_loads,
    whole_shift,
    whole_spans,
)

__all__ = ["Posed"]

Ints = NDArray[np.int64]

#: Weight of the longest route, or of the makespan, relative to the sum.
SPAN = 100
#: Number of customers up to which each reload and station has a copy per customer; larger fleets have
#: at least as many copies, and :data:`PER_VEHICLE` per vehicle.
COPIES, PER_VEHICLE = 12, 2


class Posed:
    """A fleet in the routing library, whose place j is node `places[j]`; -1 is the end of open routes.

    Optional stops have copies, each visited at most once. Loads since the start of a trip and lengths
    since a station begin again at 0 by a slack of that stop. If nodes have both deliveries and pickups,
    the load on board at the start of a trip is at least the goods that the trip delivers.
    """

    def __init__(self, model: FleetRouting) -> None:
        self.model, self.scales = model, scales_of(model)
        depots = np.union1d(model.homes, model.finishes).tolist()
        self.customers = model.customers.tolist()
        count = len(self.customers)
        copies = count if count <= COPIES else max(COPIES, PER_VEHICLE * model.vehicles)
        most = copies
        if model.max_reloads is not None:
            most = min(copies, int(np.minimum(model.max_reloads, count).sum()))
        self.places = [*depots, *self.customers]
        self.at = {node: place for place, node in enumerate(self.places) if place >= len(depots)}
        first = len(self.places)
        self.places += [node for node in model.reloads or () for _ in range(most)]
        middle = len(self.places)
        self.places += [node for node in model.stations or () for _ in range(copies)]
        self.depots = range(len(depots))
        self.reloads, self.stations = range(first, middle), range(middle, len(self.places))
        self.homes = [depots.index(node) for node in model.homes.tolist()]
        self.ends = [depots.index(node) for node in model.finishes.tolist()]

    def places_of(self, routes: Sequence[Sequence[int]]) -> list[list[int]] | None:
        """Return the places of `routes`, None if there are fewer copies than visits of a stop."""
        free = [*self.reloads, *self.stations]
        result: list[list[int]] = [[] for _ in routes]
        for places, route in zip(result, routes, strict=True):
            for node in route:
                copy = next((j for j in free if self.places[j] == node), None)
                place = self.at.get(node, copy)
                if place is None:
                    return None
                places.append(place)
                free = [j for j in free if j != place]
        return result

    def declare(self, routing: Any, manager: Any) -> None:
        """Add the model to `routing`."""
        self.routing, self.solver, self.index = routing, routing.solver(), manager.NodeToIndex
        vehicles = range(self.model.vehicles)
        #: Indices of all visits but those of depots, of all starts, and of all ends.
        self.inner = {self.index(j): j for j in range(len(self.places)) if j not in self.depots}
        self.starts = list(map(routing.Start, vehicles))
        self.finishes = list(map(routing.End, vehicles))
        self._declare_costs()
        self._declare_lengths()
        if self.model.has_times:
            self._declare_times()
        self._declare_loads()
        self._declare_pairs()
        self._declare_choices()

    def _visit(self, node: int) -> int:
        return int(self.index(self.at[node]))

    def _spread(self, matrix: NDArray[Any]) -> Ints:
        """Return `matrix` over nodes as one over places; the end of open routes is at distance 0."""
        result = matrix[np.ix_(self.places, self.places)].astype(np.int64)
        outside = np.array(self.places) < 0
        result[outside], result[:, outside] = 0, 0
        return result

    def _dimension(
        self, name: str, transits: Any, slack: int, limits: Sequence[int] | Ints, zero: bool = True
    ) -> Any:
        """Return a new dimension; `transits` are one per place, or registered ones per vehicle."""
        if isinstance(transits, np.ndarray):
            transits = [self.routing.RegisterUnaryTransitVector(transits.tolist())] * len(limits)
        self.routing.AddDimensionWithVehicleTransitAndCapacity(
            transits, int(slack), [int(limit) for limit in limits], zero, name
        )
        return self.routing.GetDimensionOrDie(name)

    def _declare_costs(self) -> None:
        """Set the cost of each arc; a node of a group with a smaller prize costs the difference."""
        model, scales = self.model, self.scales
        lost = np.zeros((len(self.places), 1), np.int64)
        for group in model.groups or ():
            for node in group:
                lost[self.at[node]] = self._largest_prize(group) - scales.prize(model, node)
        matrices: dict[float, int] = {}
        for k, price in enumerate(costs_of(model)[0].tolist()):
            if price not in matrices:
                whole = self._spread(round_up(model.distances, price * scales.cost)) + lost
                if model.objective in (Objective.VARIANCE, Objective.DEVIATION):
                    whole *= SPAN
                matrices[price] = self.routing.RegisterTransitMatrix(whole.tolist())
            self.routing.SetArcCostEvaluatorOfVehicle(matrices[price], k)
            self.routing.SetFixedCostOfVehicle(scales.fixed(model, k), k)

    def _largest_prize(self, group: Sequence[int]) -> int:
        return max(self.scales.prize(self.model, node) for node in group)

    def _declare_lengths(self) -> None:
        model = self.model
        span = 0 if model.objective in (Objective.SUM, Objective.COST, Objective.MAKESPAN) else SPAN
        if model.objective in (Objective.VARIANCE, Objective.DEVIATION):
            span = round(min(SPAN * model.q, 1e6))
        if model.battery is None and not span:
            return
        lengths = self._spread(round_up(model.distances, self.scales.length))
        largest = int(lengths.max()) * (len(self.places) + 1)
        limits = np.full(model.vehicles, largest)
        if model.battery is not None:
            limits = np.minimum(round_down(model.battery, self.scales.length), largest)
        full = int(limits.max()) if self.stations else 0
        lengths[list(self.stations)] -= full
        transit = self.routing.RegisterTransitMatrix(lengths.tolist())
        dimension = self._dimension("length", [transit] * model.vehicles, full, limits)
        self._reset(dimension, self.stations, full)
        dimension.SetGlobalSpanCostCoefficient(span)

    def _reset(self, dimension: Any, places: Sequence[int], full: int | None) -> None:
        """Allow slack at `places` only; there it completes the value to `full` if given."""
        for index in [*self.inner, *self.starts] if places else ():
            if self.inner.get(index) not in places:
                dimension.SlackVar(index).SetValue(0)
            elif full is not None:
                self.solver.Add(dimension.SlackVar(index) + dimension.CumulVar(index) == full)

    def _declare_times(self) -> None:
        model, scales, routing = self.model, self.scales, self.routing
        service = np.zeros(len(self.places), np.int64)
        if model.service is not None:
            service = round_up(model.service, scales.time)[self.places]
        service[self.depots] = 0
        transits: dict[float, int] = {}
        step = 0
        for speed in model.speeds.tolist():
            if speed not in transits:
                whole = self._spread(round_up(model.base_times / speed, scales.time))
                whole += service[:, None]
                transits[speed] = routing.RegisterTransitMatrix(whole.tolist())
                step = max(step, int(whole.max()))
        windows = [whole_spans(model, node, scales) for node in self.places]
        shifts = [whole_shift(model, k, scales) for k in range(model.vehicles)]
        begins = [begin for spans in [*windows, shifts] for begin, _ in spans]
        begins += [scales.release(model, node) for node in self.customers]
        horizon = max(begins) + step * (len(self.places) + 1)
        limits = [horizon] * model.vehicles
        time = self._dimension(
            "time", [transits[s] for s in model.speeds.tolist()], horizon, limits, False
        )
        for index, place in self.inner.items():
            _restrict(time.CumulVar(index), windows[place])
        if model.releases is not None:
            self._declare_releases(time, horizon)
        durations = [FOREVER] * model.vehicles
        if model.max_duration is not None:
            durations = round_down(model.max_duration, scales.time).tolist()
        for k, (early, late) in enumerate(shifts):
            start, end = time.CumulVar(self.starts[k]), time.CumulVar(self.finishes[k])
            if not has_shift(model, k, scales):
                routing.NextVar(self.starts[k]).SetValue(self.finishes[k])
                continue
            for moment, place in ((start, self.homes[k]), (end, self.ends[k])):
                _restrict(moment, windows[place])
                moment.SetRange(early, late)
            time.SetSpanUpperBoundForVehicle(min(durations[k], horizon), k)
            time.SetSpanCostCoefficientForVehicle(scales.rates[k], k)
            free = model.max_duration is not None or model.releases is not None
            if model.objective is Objective.MAKESPAN and not free:
                start.SetValue(start.Min())  # so that the span ends with the makespan
            routing.AddVariableMinimizedByFinalizer(end)
            routing.AddVariableMaximizedByFinalizer(start)
        time.SetGlobalSpanCostCoefficient(SPAN if model.objective is Objective.MAKESPAN else 0)

    def _declare_releases(self, time: Any, horizon: int) -> None:
        """Require each route to depart after the releases of its nodes, by a level that is constant along it."""
        none = np.zeros(len(self.places), np.int64)
        level = self._dimension("release", none, 0, [horizon] * self.model.vehicles, False)
        for index, place in self.inner.items():
            if place not in self.stations:
                level.CumulVar(index).SetMin(self.scales.release(self.model, self.places[place]))
        for start in self.starts:
            self.solver.Add(level.CumulVar(start) <= time.CumulVar(start))

    def _declare_loads(self) -> None:
        model = self.model
        deliveries, pickups, amounts, capacity = whole_loads(model)
        if model.pairs is not None:
            pickups[model.pairs[:, 0]] += amounts
            pickups[model.pairs[:, 1]] -= amounts
        outside = ~np.isin(self.places, self.customers)
        for column, limits in enumerate(capacity.T):
            full, name = int(limits.max()), f"load {column}"
            given, taken = (
                np.where(outside, 0, rows[self.places, column]) for rows in (deliveries, pickups)
            )
            if not given.any() or not taken.any():
                self._load(name, given + taken, limits, full)
                continue
            parts = [
                self._load(f"{name} taken", taken, limits, full),
                self._load(f"{name} to deliver", -given, limits, 0, full),
            ]
            aboard = self._load(name, taken - given, limits, full, 2 * full)
            for index in [*self.inner, *self.starts, *self.finishes]:
                self.solver.Add(
                    aboard.CumulVar(index) >= sum(part.CumulVar(index) for part in parts)
                )

    def _load(
        self, name: str, loads: Ints, limits: Ints, drop: int, slack: int | None = None
    ) -> Any:
        """Return the dimension of a load that is 0 at the start of each trip, or free with a `slack`."""
        loads = loads.copy()
        loads[self.reloads] -= drop
        most = (drop if slack is None else slack) if self.reloads else 0
        dimension = self._dimension(name, loads, most, limits, slack is None)
        self._reset(dimension, self.reloads, drop if slack is None else None)
        return dimension

    def _declare_pairs(self) -> None:
        """Require one trip and the right order for each pair, and limit the reloads."""
        model, routing, solver = self.model, self.routing, self.solver
        if not self.reloads and model.pairs is None:
            return
        many = np.full(model.vehicles, len(self.places) + 1)
        most = many if model.max_reloads is None else np.minimum(model.max_reloads, many)
        trips = self._dimension(
            "trip", np.isin(np.arange(len(self.places)), self.reloads) * 1, 0, most
        )
        if model.pairs is None:
            return
        ranks = self._dimension("rank", np.ones(len(self.places), int), 0, many)
        for a, b in ((self._visit(a), self._visit(b)) for a, b in model.pairs.tolist()):
            routing.AddPickupAndDelivery(a, b)
            solver.Add(routing.VehicleVar(a) == routing.VehicleVar(b))
            solver.Add(ranks.CumulVar(a) <= ranks.CumulVar(b))
            solver.Add(trips.CumulVar(a) == trips.CumulVar(b))

    def _declare_choices(self) -> None:
        """Add prizes, groups, optional stops, skills, and forbid arcs before backhauls."""
        model, routing = self.model, self.routing
        alone = set(model.customers[model.optional[model.customers]].tolist())
        alone.difference_update(*(model.groups or ()))
        for group in [*(model.groups or ()), *((node,) for node in sorted(alone))]:
            penalty = [self._largest_prize(group)] if model.optional[group[0]] else []
            routing.AddDisjunction([self._visit(node) for node in group], *penalty)
        for place in [*self.reloads, *self.stations]:
            routing.AddDisjunction([self.index(place)], 0)
        requires = model.requires or [()] * model.size
        for node in self.customers:
            names = set(requires[node])
            able = [k for k, known in enumerate(model.skills or ()) if names.issubset(known)]
            if names and len(able) < model.vehicles:
                routing.VehicleVar(self._visit(node)).SetValues([-1, *able])
        if model.backhauls:
            first, last = ([self._visit(node) for node in nodes] for nodes in list_backhauls(model))
            for tail in [*self.starts, *map(self.index, self.reloads)]:
                routing.NextVar(tail).RemoveValues(last)
            for tail in last:
                routing.NextVar(tail).RemoveValues(first)


def _restrict(moment: Any, spans: Sequence[tuple[int, int]]) -> None:
    """Restrict the variable `moment` to the union of `spans`."""
    end = max(late for _, late in spans)
    moment.SetRange(spans[0][0], end)
    end = spans[0][1]
    for early, late in spans[1:]:
        if early > end + 1:
            moment.RemoveInterval(end + 1, early - 1)
        end = max(end, late)
