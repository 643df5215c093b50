"""Random small rich fleets of whole numbers, and their optimum by enumeration without the code of models and solvers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

INF = math.inf
#: Most reloads and stations in a route of the enumeration; instances allow no more reloads.
STOPS = 2


def random_fields(seed: int, stations: bool = False) -> dict[str, Any]:
    """Return the fields of a rich fleet: nodes 0 and 1 are depots, node 2 a reload or station, others customers."""
    rng = np.random.default_rng(seed)
    count, vehicles = int(rng.choice([2, 3, 3, 4])), int(rng.integers(1, 3))
    size = 3 + count

    def some(share: float) -> bool:
        return bool(rng.random() < share)

    points = rng.integers(0, 20, (size, 2))
    costs = np.abs(points[:, None] - points[None]).sum(axis=-1) + rng.integers(0, 3, (size, size))
    np.fill_diagonal(costs, 0)
    fields: dict[str, Any] = {
        "vehicles": vehicles,
        "costs": costs.astype(float),
        "depots": rng.integers(0, 2, vehicles) if some(0.4) else [0] * vehicles,
        "objective": str(rng.choice(["cost", "cost", "cost", "sum"])),
        "use_all": False,
    }
    if some(0.3):
        fields["ends"] = rng.choice([-1, 0, 1], vehicles)
    else:
        fields["ends"] = list(fields["depots"])
    if fields["objective"] == "cost":
        if some(0.6):
            fields["fixed_cost"] = rng.integers(0, 30, vehicles).astype(float)
        if some(0.6):
            fields["distance_cost"] = rng.integers(1, 4, vehicles).astype(float)
        if some(0.4):
            fields["time_cost"] = rng.integers(0, 3, vehicles).astype(float)
        if some(0.4):
            fields["prizes"] = [
                float(rng.integers(0, 60)) if k > 2 and some(0.6) else math.nan for k in range(size)
            ]
    if some(0.5):
        fields["times"] = rng.integers(1, 15, (size, size)) * (1.0 - np.eye(size))
    if some(0.3):
        fields["speed"] = rng.choice([0.5, 1.0, 2.0], vehicles)
    if some(0.6):
        fields["service"] = rng.integers(0, 6, size).astype(float)
    if some(0.6):
        rows: list[Any] = [None] * size
        for k in range(2, size):
            if some(0.6):
                begins = np.sort(rng.integers(0, 90, int(rng.integers(1, 3))))
                rows[k] = [(float(a), float(a + rng.integers(5, 40))) for a in begins]
        fields["windows"] = rows
    if some(0.3):
        fields["shifts"] = [
            (float(a), float(a + rng.integers(60, 160))) for a in rng.integers(0, 20, vehicles)
        ]
    if some(0.3):
        fields["max_duration"] = rng.integers(40, 160, vehicles).astype(float)
    if some(0.3):
        fields["releases"] = rng.integers(0, 40, size).astype(float) * (np.arange(size) > 2)
    kinds = int(rng.integers(1, 3))
    shape = (size, kinds) if kinds > 1 else (size,)
    if some(0.7):
        fields["demands"] = rng.integers(0, 5, shape).astype(float)
        fields["capacity"] = rng.integers(
            6, 14, (vehicles, kinds) if kinds > 1 else (vehicles,)
        ).astype(float)
        if some(0.5):
            fields["pickups"] = rng.integers(0, 5, shape).astype(float)
            if some(0.3):
                take = rng.random(size) < 0.5
                fields["demands"][take] = 0
                fields["pickups"][~take] = 0
                fields["backhauls"] = True
            elif some(0.6):
                fields["pairs"] = [(3, 4)]
                for k in (3, 4):  # PyVRP has neither several windows nor releases for pairs
                    if "windows" in fields and fields["windows"][k]:
                        fields["windows"][k] = fields["windows"][k][:1]
                    if "releases" in fields:
                        fields["releases"][k] = 0.0
    if some(0.3):
        names = ["cold", "lift"]
        fields["skills"] = [[name for name in names if some(0.6)] for _ in range(vehicles)]
        fields["requires"] = [[name for name in names if k > 2 and some(0.2)] for k in range(size)]
    if count > 2 and some(0.25) and ("pairs" not in fields or count > 3):
        group = (size - 2, size - 1) if count < 4 or "pairs" not in fields else (5, 6)
        prizes = fields.get("prizes")
        if prizes is None or math.isnan(prizes[-1]) == math.isnan(prizes[-2]):
            fields["groups"] = [group]
    if stations:
        fields["battery"] = rng.integers(25, 90, vehicles).astype(float)
        fields["stations"] = [2]
    else:
        if some(0.3):
            fields["battery"] = rng.integers(40, 140, vehicles).astype(float)
        if "capacity" in fields and some(0.6):
            fields["reloads"] = [2] if some(0.5) else [0]
            fields["max_reloads"] = rng.integers(0, STOPS + (count < 4), vehicles)
    return fields


def customers_of(fields: dict[str, Any]) -> list[int]:
    """Return the nodes to visit."""
    stops = {
        *fields["depots"],
        *fields["ends"],
        *fields.get("reloads", ()),
        *fields.get("stations", ()),
    }
    return [node for node in range(len(fields["costs"])) if node not in stops]


def return_time(fields: dict[str, Any], k: int, route: tuple[int, ...], departure: float) -> float:
    """Return the earliest return for a departure, inf if a window or a release is missed."""
    return _pass(fields, k, route, departure, wait=True)[0]


def _pass(
    fields: dict[str, Any], k: int, route: tuple[int, ...], departure: float, wait: bool
) -> tuple[float, list[float]]:
    """Return the return time, and the departures that just meet a limit if no node requires to `wait`."""
    costs = fields["costs"]
    times = fields.get("times", costs)
    speed = fields["speed"][k] if "speed" in fields else 1.0
    service = fields.get("service", [0.0] * len(costs))
    windows = fields.get("windows", [None] * len(costs))
    releases = fields.get("releases", [0.0] * len(costs))
    stops = set(fields.get("reloads", ()))
    ends = [i for i, node in enumerate(route) if node in stops] + [len(route)]
    goods = max((releases[node] for node in route[: ends[0]]), default=0.0)
    now, place, end, events = departure, fields["depots"][k], fields["ends"][k], [goods]
    if wait and departure < goods:
        return INF, events
    for i, node in enumerate([*route, *([end] if end >= 0 else [])]):
        now += times[place][node] / speed
        spans = windows[node] or [(-INF, INF)]
        events += [moment - now for span in spans for moment in span if abs(moment) < INF]
        if wait:
            now = min((max(now, a) for a, b in spans if now <= b), default=INF)
        if i < len(route):
            now += service[node]
            if node in stops:
                until = ends[ends.index(i) + 1]
                goods = max((releases[other] for other in route[i + 1 : until]), default=-INF)
                events.append(goods - now)
                now = max(now, goods) if wait else now
        place = node
    return now, [departure + event for event in events]


def timed(fields: dict[str, Any], k: int, route: tuple[int, ...]) -> Iterator[tuple[float, float]]:
    """Yield departures with their returns within all limits, among them the shortest and the earliest.

    The return is piecewise max(a, departure + b). Its pieces begin and end at the departures that meet the
    begin or end of a window, or a release, without waiting before.
    """
    begin, end = fields["shifts"][k] if "shifts" in fields else (0.0, INF)
    limit = fields["max_duration"][k] if "max_duration" in fields else INF
    _, events = _pass(fields, k, route, 0.0, wait=False)
    for departure in {begin, *(event for event in events if begin <= event < INF)}:
        back = return_time(fields, k, route, departure)
        if back < INF and back <= end and back - departure <= limit:
            yield departure, back


def fits(fields: dict[str, Any], k: int, route: tuple[int, ...]) -> bool:
    """Return whether `route` keeps all rules that need no times."""
    stops, stations = set(fields.get("reloads", ())), set(fields.get("stations", ()))
    trips: list[list[int]] = [[]]
    for node in route:
        if node in stops:
            trips.append([])
        elif node not in stations:
            trips[-1].append(node)
    if "max_reloads" in fields and len(trips) - 1 > fields["max_reloads"][k]:
        return False
    pairs = fields.get("pairs", ())
    paired = {node for pair in pairs for node in pair}
    for first, second in pairs:
        for trip in trips:
            if (first in trip) != (second in trip) or (
                first in trip and trip.index(first) > trip.index(second)
            ):
                return False
    if "capacity" in fields:
        limit = np.atleast_1d(fields["capacity"][k])
        nothing = np.zeros(len(limit))
        given = np.array(fields["demands"], float).reshape(-1, len(limit))
        taken = np.array(fields.get("pickups", 0.0 * given), float).reshape(-1, len(limit))
        second_of = {second: first for first, second in pairs}
        for trip in trips:
            load = sum((given[node] for node in trip if node not in paired), nothing)
            if (load > limit).any():
                return False
            for node in trip:
                if node in second_of:
                    load = load - taken[second_of[node]]
                elif node in paired:
                    load = load + taken[node]
                else:
                    load = load + taken[node] - given[node]
                if (load > limit).any():
                    return False
            if fields.get("backhauls"):
                last = [bool(taken[node].any() and not given[node].any()) for node in trip]
                if last and (last[0] or last != sorted(last)):
                    return False
    skills = set(fields["skills"][k]) if "skills" in fields else set()
    if any(set(fields["requires"][node]) - skills for node in route if "requires" in fields):
        return False
    if "battery" in fields:
        end = fields["ends"][k]
        used, place = 0.0, fields["depots"][k]
        for node in [*route, *([end] if end >= 0 else [])]:
            used += fields["costs"][place][node]
            if used > fields["battery"][k]:
                return False
            used, place = 0.0 if node in stations else used, node
    return True


def length(fields: dict[str, Any], k: int, route: tuple[int, ...]) -> float:
    """Return the length of `route`."""
    end = fields["ends"][k]
    stops = [fields["depots"][k], *route, *([end] if end >= 0 else [])]
    return float(sum(fields["costs"][a][b] for a, b in itertools.pairwise(stops)))


def value(fields: dict[str, Any], k: int, route: tuple[int, ...]) -> float:
    """Return the least contribution of `route` to the objective, inf if it is infeasible."""
    if not route:
        return 0.0
    if not fits(fields, k, route):
        return INF
    options = list(timed(fields, k, route))
    if not options:
        return INF
    if fields["objective"] == "makespan":
        return min(back for _, back in options)
    if fields["objective"] != "cost":
        return length(fields, k, route)
    total = length(fields, k, route) * (
        fields["distance_cost"][k] if "distance_cost" in fields else 1.0
    )
    if "time_cost" in fields:
        total += fields["time_cost"][k] * min(back - departure for departure, back in options)
    total += fields["fixed_cost"][k] if "fixed_cost" in fields else 0.0
    prizes = fields.get("prizes")
    if prizes is not None:
        total -= sum(prizes[node] for node in route if not math.isnan(prizes[node]))
    return float(total)


def routes_of(fields: dict[str, Any], nodes: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yield the routes through `nodes` with up to :data:`STOPS` reloads or stations between, before or after."""
    stops = [*fields.get("reloads", ()), *fields.get("stations", ())]
    for order in itertools.permutations(nodes):
        for count in range(STOPS + (len(nodes) < 4) if stops else 1):
            for places in itertools.combinations_with_replacement(range(len(order) + 1), count):
                for chosen in itertools.product(stops, repeat=count):
                    route = list(order)
                    for place, stop in sorted(zip(places, chosen, strict=True), reverse=True):
                        route.insert(place, stop)
                    yield tuple(route)


def optimum(fields: dict[str, Any]) -> float:
    """Return the optimum, inf if there is no feasible plan."""
    customers = customers_of(fields)
    highest = fields["objective"] in ("max", "makespan")
    table: dict[frozenset[int], float] = {frozenset(): 0.0}
    for k in range(fields["vehicles"]):
        own: dict[frozenset[int], float] = {frozenset(): 0.0}
        for count in range(1, len(customers) + 1):
            for nodes in itertools.combinations(customers, count):
                own[frozenset(nodes)] = min(
                    value(fields, k, route) for route in routes_of(fields, nodes)
                )
        joint: dict[frozenset[int], float] = {}
        for (left, a), (right, b) in itertools.product(table.items(), own.items()):
            if not left & right and max(a, b) < INF:
                total = max(a, b) if highest else a + b
                joint[left | right] = min(joint.get(left | right, INF), total)
        table = joint
    return min(
        (total for nodes, total in table.items() if _is_complete(fields, customers, nodes)),
        default=INF,
    )


def _is_complete(fields: dict[str, Any], customers: list[int], visited: frozenset[int]) -> bool:
    prizes = fields.get("prizes", [math.nan] * len(fields["costs"]))
    grouped = set()
    for group in fields.get("groups", ()):
        grouped.update(group)
        count = len(visited & set(group))
        if count > 1 or (count == 0 and math.isnan(prizes[group[0]])):
            return False
    return all(
        node in visited for node in customers if node not in grouped and math.isnan(prizes[node])
    )
