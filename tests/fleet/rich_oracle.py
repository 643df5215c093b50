"""Enumeration of small rich fleets and a schedule checker, written apart from the package.

The enumeration chooses one window per stop, so that each schedule is a system of differences. It then
takes the earliest times forward and the latest times backward from the earliest return.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from crosstrack.models.fleet import FleetPlan

#: Objectives whose value never decreases with a measure of one route.
ENUMERATED = ("sum", "max", "max-sum", "cost", "makespan")


def _raw(model):
    """Return the data of the model as plain numbers, with defaults."""
    n, m = model.size, model.vehicles
    d = np.array(model.distances)
    times = d if model.times is None else np.array(model.times)
    speed = np.ones(m) if model.speed is None else np.array(model.speed)
    homes = [int(np.broadcast_to(model.depots, (m,))[k]) for k in range(m)]
    ends = homes if model.ends is None else [int(x) for x in model.ends]
    width = 1 if model.capacity is None else np.array(model.capacity).reshape(m, -1).shape[1]
    zero = np.zeros((n, width))
    return {
        "d": d, "t": [times / speed[k] for k in range(m)], "homes": homes, "ends": ends,
        "service": np.zeros(n) if model.service is None else np.array(model.service),
        "release": np.full(n, -math.inf) if model.releases is None else np.array(model.releases),
        "windows": [None] * n if model.windows is None else list(model.windows),
        "reloads": set(model.reloads or ()), "stations": set(model.stations or ()),
        "demand": zero if model.demands is None else np.array(model.demands).reshape(n, -1),
        "pickup": zero if model.pickups is None else np.array(model.pickups).reshape(n, -1),
        "partner": {} if model.pairs is None else {
            x: y for a, b in np.array(model.pairs).tolist() for x, y in ((a, b), (b, a))
        },
        "first": set() if model.pairs is None else set(np.array(model.pairs)[:, 0].tolist()),
    }  # fmt: skip


def _others(model):
    """Return depots, ends, reloads and stations."""
    stops = {int(x) for x in np.ravel(model.depots)} | set(model.reloads or ())
    stops |= set(model.stations or ())
    return stops | ({int(x) for x in model.ends if x >= 0} if model.ends is not None else set())


def static_faults(model, raw, k, route):
    """Return the rules on loads, battery, skills, reloads and pairs that one route of vehicle k breaks."""
    faults = []
    trips, trip = [], []
    for node in route:
        if node in raw["reloads"]:
            trips.append(trip)
            trip = []
        else:
            trip.append(node)
    trips.append(trip)
    if model.max_reloads is not None and len(trips) - 1 > model.max_reloads[k]:
        faults.append("reloads")
    if model.requires is not None:
        own = set(model.skills[k])
        faults += ["skills" for node in route if not set(model.requires[node]) <= own]
    for trip in trips:
        work = [node for node in trip if node not in raw["stations"]]
        for node in work:
            other = raw["partner"].get(node)
            if other is not None and (
                other not in work
                or (node in raw["first"]) != (work.index(node) < work.index(other))
            ):
                faults.append("pairs")
        if model.capacity is not None:
            capacity = np.array(model.capacity).reshape(model.vehicles, -1)[k]
            plain = [node for node in work if node not in raw["partner"]]
            load = raw["demand"][plain].sum(axis=0) if plain else np.zeros(capacity.size)
            most = load.copy()
            for node in work:
                if node in plain:
                    load = load - raw["demand"][node] + raw["pickup"][node]
                elif node in raw["first"]:
                    load = load + raw["pickup"][node]
                else:
                    load = load - raw["pickup"][raw["partner"][node]]
                most = np.maximum(most, load)
            if (most > capacity * (1 + 1e-6) + 1e-9).any():
                faults.append("capacity")
        if model.backhauls:
            kinds = [
                "back" if raw["pickup"][x].any() and not raw["demand"][x].any() else "line"
                for x in work
            ]
            if kinds != sorted(kinds, reverse=True) or (kinds and kinds[0] == "back"):
                faults.append("backhauls")
    if model.battery is not None and route:
        since = 0.0
        path = [raw["homes"][k], *route] + ([raw["ends"][k]] if raw["ends"][k] >= 0 else [])
        for a, b in itertools.pairwise(path):
            since += raw["d"][a, b]
            if since > model.battery[k] * (1 + 1e-6):
                faults.append("battery")
            since = 0.0 if b in raw["stations"] else since
    return faults


def reject(model, plan, tolerance=1e-6):
    """Return the broken rules of a plan, from its routes and times; empty for a feasible plan."""
    raw, faults = _raw(model), []
    if len(plan.routes) != model.vehicles:
        return ["number of routes"]
    others, visits = _others(model), [node for route in plan.routes for node in route]
    free = raw["reloads"] | raw["stations"]
    for node in range(model.size):
        count = visits.count(node)
        if node in others:
            faults += ["visits"] * (count > 0 and node not in free)
            continue
        grouped = any(node in group for group in model.groups or ())
        priced = model.prizes is not None and not math.isnan(model.prizes[node])
        if count > 1 or (count == 0 and not grouped and not priced):
            faults.append("visits")
    for group in model.groups or ():
        count = sum(node in visits for node in group)
        priced = model.prizes is not None and not math.isnan(model.prizes[group[0]])
        if count > 1 or (count == 0 and not priced):
            faults.append("groups")
    if model.use_all and not all(plan.routes):
        faults.append("use_all")
    timed = any(
        getattr(model, name) is not None
        for name in [
            "times",
            "speed",
            "service",
            "windows",
            "releases",
            "shifts",
            "max_duration",
            "time_cost",
        ]
    )
    for k, route in enumerate(plan.routes):
        faults += static_faults(model, raw, k, route)
        if route and (timed or model.objective == "makespan"):
            if plan.starts is None or len(plan.starts[k]) != len(route) + 2:
                faults.append("times")
            else:
                faults += _time_faults(model, raw, k, route, plan.starts[k], tolerance)
    return faults


def _time_faults(model, raw, k, route, times, tolerance):
    faults = []
    span = tolerance * max(1e-3, max(times) - min(times))
    begin, end = (0.0, math.inf) if model.shifts is None else model.shifts[k]
    if times[0] < begin - span or times[-1] > end + span:
        faults.append("shift")
    if model.max_duration is not None and times[-1] - times[0] > model.max_duration[k] + span:
        faults.append("duration")
    path = [raw["homes"][k], *route] + ([raw["ends"][k]] if raw["ends"][k] >= 0 else [])
    for node, time in zip(path, times, strict=False):
        spans = raw["windows"][node]
        if spans and not any(a - span <= time <= b + span for a, b in spans):
            faults.append("window")
    reload, trip_departure = raw["homes"][k], times[0]
    for place in range(len(times) - 1):
        stay = raw["service"][path[place]] if place else 0.0
        head = path[place + 1] if place + 1 < len(path) else None
        travel = 0.0 if head is None else raw["t"][k][path[place], head]
        if times[place] + stay + travel > times[place + 1] + span:
            faults.append("travel")
        if place and path[place] in raw["reloads"]:
            reload, trip_departure = path[place], times[place + 1] - travel
        inner = head is not None and place + 1 <= len(route)
        if inner and head not in _others(model) and raw["release"][head] > trip_departure + span:
            faults.append("release")
    assert reload is not None
    return faults


def schedules(model, raw, k, route):
    """Yield (return, duration, times) of each feasible choice of one window per stop."""
    path = [raw["homes"][k], *route] + ([raw["ends"][k]] if raw["ends"][k] >= 0 else [])
    begin, end = (0.0, math.inf) if model.shifts is None else map(float, model.shifts[k])
    releases, trip = [-math.inf], 0
    at = {}
    for place, node in enumerate(path):
        if 0 < place <= len(route) and node in raw["reloads"]:
            releases.append(-math.inf)
            trip += 1
            at[place] = trip
        elif 0 < place <= len(route) and node not in raw["stations"]:
            releases[trip] = max(releases[trip], raw["release"][node])
    options = [raw["windows"][node] or ((-math.inf, math.inf),) for node in path]
    if len(path) == len(route) + 1:
        options.append(((-math.inf, math.inf),))
    gaps = []
    for place in range(len(options) - 1):
        stay = raw["service"][path[place]] if place else 0.0
        travel = 0.0
        if place + 1 < len(path):
            travel = raw["t"][k][path[place], path[place + 1]]
        floor = releases[at[place]] + travel if place in at else -math.inf
        gaps.append((stay + travel, floor))
    for spans in itertools.product(*options):
        early = [max(begin, spans[0][0], releases[0])]
        for (gap, floor), (a, _) in zip(gaps, spans[1:], strict=True):
            early.append(max(a, early[-1] + gap, floor))
        if any(t > b for t, (_, b) in zip(early, spans, strict=True)) or early[-1] > end:
            continue
        late = [early[-1]]
        for (gap, _), (_, b) in zip(reversed(gaps), reversed(spans[:-1]), strict=True):
            late.append(min(b, late[-1] - gap))
        late.reverse()
        if model.max_duration is None or late[-1] - late[0] <= model.max_duration[k] * (1 + 1e-9):
            yield early[-1], late[-1] - late[0], tuple(late)


def _routes(raw, nodes, most_reloads):
    """Yield the orders of the nodes with at most one reload and at most one station."""
    for order in itertools.permutations(nodes):
        yield order
        stops = [(x,) for x in raw["stations"]] + [(x,) for x in raw["reloads"]] * bool(
            most_reloads > 0
        )
        stops += list(itertools.product(raw["reloads"], raw["stations"])) * bool(most_reloads > 0)
        for extra in stops:
            for places in itertools.product(range(len(order) + 1), repeat=len(extra)):
                result = list(order)
                for place, node in sorted(zip(places, extra, strict=True), reverse=True):
                    result.insert(place, node)
                yield tuple(result)
                if len(extra) == 2 and places[0] == places[1]:
                    place = places[0]
                    result[place], result[place + 1] = result[place + 1], result[place]
                    yield tuple(result)


def enumerate_best(model):
    """Return the least objective and a plan of it, (inf, None) without a feasible plan.

    Routes have at most one reload and one station each, so the value is an optimum of the model only if
    `max_reloads` is at most 1 and a second station does not pay.
    """
    assert str(model.objective) in ENUMERATED
    assert model.deviation_limit is None and model.range_limit is None
    raw, m = _raw(model), model.vehicles
    customers = [node for node in range(model.size) if node not in _others(model)]
    tables = []
    for k in range(m):
        most = 0 if not raw["reloads"] else 1 if model.max_reloads is None else model.max_reloads[k]
        table = {}
        for size in range(1, len(customers) + 1):
            for nodes in itertools.combinations(customers, size):
                if model.requires is not None and any(
                    not set(model.requires[x]) <= set(model.skills[k]) for x in nodes
                ):
                    continue
                best = _best_route(model, raw, k, nodes, most)
                if best is not None:
                    table[frozenset(nodes)] = best
        tables.append(table)
    best, chosen = math.inf, None

    def place(k, used, parts):
        nonlocal best, chosen
        if k == m:
            value = _value(model, used, parts)
            if value < best:
                best, chosen = value, list(parts)
            return
        if not model.use_all:
            place(k + 1, used, [*parts, None])
        for nodes, entry in tables[k].items():
            if not nodes & used:
                place(k + 1, used | nodes, [*parts, entry])

    place(0, frozenset(), [])
    if chosen is None:
        return math.inf, None
    routes = tuple(() if part is None else part[2] for part in chosen)
    starts = tuple(() if part is None else part[3] for part in chosen)
    return best, FleetPlan(routes, starts)


def _best_route(model, raw, k, nodes, most):
    """Return (measure, length, route, times) of the best route of vehicle k through the nodes."""
    best = None
    for route in _routes(raw, nodes, most):
        if static_faults(model, raw, k, route):
            continue
        path = [raw["homes"][k], *route] + ([raw["ends"][k]] if raw["ends"][k] >= 0 else [])
        length = float(sum(raw["d"][a, b] for a, b in itertools.pairwise(path)))
        for back, duration, times in schedules(model, raw, k, route):
            measure = length
            if model.objective == "makespan":
                measure = back
            elif model.objective == "cost":
                unit = [
                    x if array is None else float(array[k])
                    for x, array in ((0.0, model.fixed_cost), (1.0, model.distance_cost),
                                     (0.0, model.time_cost))
                ]  # fmt: skip
                measure = unit[0] + unit[1] * length + unit[2] * duration
            if best is None or measure < best[0]:
                best = (measure, length, route, times)
    return best


def _value(model, used, parts):
    """Return the objective of one choice of routes; inf if it breaks a rule on the whole plan."""
    for node in range(model.size):
        grouped = any(node in group for group in model.groups or ())
        priced = model.prizes is not None and not math.isnan(model.prizes[node])
        if node not in used and node not in _others(model) and not grouped and not priced:
            return math.inf
    for group in model.groups or ():
        count = len(used & set(group))
        priced = model.prizes is not None and not math.isnan(model.prizes[group[0]])
        if count > 1 or (count == 0 and not priced):
            return math.inf
    measures = [0.0 if part is None else part[0] for part in parts]
    lengths = [0.0 if part is None else part[1] for part in parts]
    if model.budget is not None and sum(lengths) > model.budget * (1 + 1e-9):
        return math.inf
    if model.objective in ("max", "makespan"):
        return max(measures)
    if model.objective == "max-sum":
        return max(lengths) + 1e-6 * sum(lengths)
    prizes = 0.0
    if model.prizes is not None:
        prizes = sum(float(model.prizes[x]) for x in used if not math.isnan(model.prizes[x]))
    return sum(measures) - prizes
