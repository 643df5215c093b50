"""First routes of a fleet without compiled loops: a tour cut into routes, with overload repaired.

The tour is cut in proportion to the vehicles' capacities (J. E. Beasley, "Route first-cluster second
methods for vehicle routing", Omega 11, 1983). Overload is removed as in bin packing: the nodes of an
overloaded route and of another one are redistributed by enumeration of all subsets, which never
increases the overload.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetPlan, FleetRouting
from ...models.fleet.data import LARGE

__all__ = ["cut_tour", "first_plan", "first_routes", "repair"]

Floats = NDArray[np.float64]
Routes = list[list[int]]

#: Maximum number of nodes redistributed between two routes: 2^10 subsets take 0.1 ms.
MOST = 10
#: Maximum number of redistributions: constant and per vehicle. X-n101-k25 (slack 0.06 %) takes 30 to 60.
ATTEMPTS, PER_VEHICLE = 2000, 20
#: Redistributions per vehicle for compact routes, and the largest mean number of nodes per route for
#: them. On X-n101-k25 (4 nodes) they shorten the sum by 15 % in 0.1 s, with 14 nodes they lengthen it.
IMPROVEMENTS, SHORT = 20, 6
#: Probability of choosing the most compact split of least overload rather than a random one.
COMPACT = 0.5
#: Relative excess over a capacity due to rounding of sums in another order.
ROUNDING = 1e-12


def first_routes(
    model: FleetRouting, draw: np.random.Generator, ended: Callable[[], bool] = lambda: False
) -> Routes | None:
    """Return routes that visit each node once within the capacities, or None after a failure.

    Other limits than capacities and `use_all` are not considered. `ended` returns True if the time is up.
    """
    routes = cut_tour(model)
    if model.capacity is None:
        return routes
    improvements = IMPROVEMENTS if len(model.customers) <= SHORT * model.vehicles else 0
    fixed = repair(model, routes, draw, ended, improvements)
    return fixed or repair(model, _best_fit(model), draw, ended, improvements)


def first_plan(
    model: FleetRouting, draw: np.random.Generator, ended: Callable[[], bool]
) -> tuple[FleetPlan, float] | None:
    """Return the plan of :func:`first_routes` and its objective; None if it violates a limit."""
    routes = first_routes(model, draw, ended)
    if routes is None:
        return None
    plan = FleetPlan(tuple(map(tuple, routes)))
    checked = model.verify(plan, tolerance=ROUNDING)
    return (plan, checked.objective) if checked.ok and checked.objective is not None else None


def cut_tour(model: FleetRouting) -> Routes:
    """Return a nearest-neighbour tour through all nodes, cut into one route per vehicle.

    The demand of a route is proportional to the vehicle's capacity. Without demands, each route has an
    equal share of the tour's length.
    """
    m, depot = model.vehicles, int(model.homes[0])
    tour = _nearest(model, depot, model.customers)
    if model.capacity is not None and model.demands is not None and model.demands[tour].any():
        weights, shares = model.demands[tour], np.array(model.capacity)
    else:
        weights, shares = model.legs([depot, *tour[:-1]], tour), np.ones(m)
    if not shares.any() or not weights.any():
        weights, shares = np.ones(len(tour)), np.ones(m)
    done = np.cumsum(weights) - 0.5 * weights
    ends = np.searchsorted(done, weights.sum() * np.cumsum(shares)[:-1] / shares.sum())
    if model.use_all:  # the model then has at least as many nodes as vehicles
        for k in range(m - 1):
            ends[k] = max(ends[k], ends[k - 1] + 1 if k else 1)
        ends = np.minimum(ends, len(tour) - m + 1 + np.arange(m - 1))
    return [part.tolist() for part in np.split(tour, ends)]


def repair(
    model: FleetRouting,
    routes: Routes,
    draw: np.random.Generator,
    ended: Callable[[], bool] = lambda: False,
    improvements: int = 0,
) -> Routes | None:
    """Return routes without overload, similar to `routes`, or None after a failure.

    Each node of the model, which has demands and capacities, is in exactly one route. `ended` returns True
    if the time is up. After the overload is removed, `improvements` redistributions per vehicle make the
    routes more compact.
    """
    assert model.demands is not None and model.capacity is not None
    demands, capacity, m = model.demands, model.capacity, model.vehicles
    most = capacity * (1.0 + ROUNDING)
    if demands[model.customers].sum() > most.sum() or demands[model.customers].max() > most.max():
        return None
    sets = [list(stops) for stops in routes]
    loads = np.array([demands[stops].sum() for stops in sets])
    changed = set[int]()
    left = min(improvements * m, ATTEMPTS) if m > 1 else 0
    for attempt in range(ATTEMPTS + PER_VEHICLE * m + left):
        over = np.flatnonzero(loads > most)
        if attempt % 64 == 63 and ended():
            if over.size:
                return None
            left = 0
        if not over.size and not left:
            result = [list(stops) for stops in routes]
            for k in changed:
                result[k] = _reorder(model, k, sets[k])
            return result
        if m == 1:
            return None
        if over.size:
            k, compact = int(over[draw.integers(0, over.size)]), COMPACT
            other = int(draw.integers(0, m - 1))
            other += other >= k
        else:
            left, compact = left - 1, 1.0
            k, other = draw.choice(m, 2, replace=False).tolist()
        split = _redistribute(model, sets[k], sets[other], most[[k, other]], draw, compact)
        if split is not None:
            sets[k], sets[other] = split
            loads[k], loads[other] = (demands[stops].sum() for stops in split)
            changed |= {k, other}
    return None


def _redistribute(
    model: FleetRouting,
    stops: list[int],
    other: list[int],
    most: Floats,
    draw: np.random.Generator,
    compact: float,
) -> tuple[list[int], list[int]] | None:
    """Redistribute the nodes of two routes with the least overload; None for the same split."""
    assert model.demands is not None
    nodes = np.array([*stops, *other], np.int64)
    picked = np.arange(nodes.size)
    if nodes.size > MOST:
        picked = np.sort(draw.choice(nodes.size, MOST, replace=False))
    before = picked < len(stops)
    rest = np.delete(np.arange(nodes.size), picked)
    fixed = nodes[rest[rest < len(stops)]], nodes[rest[rest >= len(stops)]]
    bits = ((np.arange(1 << picked.size)[:, None] >> np.arange(picked.size)) & 1).astype(float)
    sums = bits @ model.demands[nodes[picked]]
    first = model.demands[fixed[0]].sum() + sums
    second = model.demands[fixed[1]].sum() + sums[-1] - sums
    over = np.maximum(first - most[0], 0.0) + np.maximum(second - most[1], 0.0)
    if model.use_all:
        counts = bits.sum(axis=1)
        over[(counts + fixed[0].size == 0) | (picked.size - counts + fixed[1].size == 0)] = math.inf
    best = np.flatnonzero(over <= over.min() + ROUNDING * most.sum())
    if draw.random() < compact:
        # Among splits of equal overload, take the one with the least distances within routes.
        near = model.legs(nodes[picked][:, None], nodes[picked])
        row = best[int(_spread(bits[best], near).argmin())]
    else:
        row = best[draw.integers(0, best.size)]
    pick = bits[row] > 0
    if (pick == before).all():
        return None
    chosen = nodes[picked]
    left, right = np.append(fixed[0], chosen[pick]), np.append(fixed[1], chosen[~pick])
    return left.tolist(), right.tolist()


def _spread(bits: Floats, distances: Floats) -> Floats:
    """Return the sum of distances between nodes on the same side, shape (splits,)."""
    others = 1.0 - bits
    sums: Floats = ((bits @ distances) * bits + (others @ distances) * others).sum(axis=1)
    return sums


def _best_fit(model: FleetRouting) -> Routes:
    """Return routes by best-fit decreasing; other nodes go to the vehicle with the most capacity left."""
    assert model.demands is not None and model.capacity is not None
    remaining = np.array(model.capacity)
    routes: Routes = [[] for _ in remaining]
    order = model.customers[np.argsort(-model.demands[model.customers], kind="stable")]
    for place, node in enumerate(order.tolist()):
        need = model.demands[node]
        open_ = np.ones(remaining.size, bool)
        empty = np.array([not stops for stops in routes])
        if model.use_all and empty.sum() >= len(order) - place:
            open_ = empty
        fits = open_ & (remaining >= need)
        if fits.any():
            k = int(np.where(fits, remaining, np.inf).argmin())
        else:
            k = int(np.where(open_, remaining, -np.inf).argmax())
        routes[k].append(node)
        remaining[k] -= need
    return [_reorder(model, k, stops) for k, stops in enumerate(routes)]


def _reorder(model: FleetRouting, k: int, stops: list[int]) -> list[int]:
    """Return the stops of vehicle `k` in the order of a nearest-neighbour tour."""
    if len(stops) < 2:
        return stops
    return [int(node) for node in _nearest(model, int(model.homes[k]), np.array(stops))]


def _nearest(model: FleetRouting, start: int, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return `nodes` in the order of a nearest-neighbour tour."""
    rest, current = np.array(nodes), start
    order = np.empty(rest.size, np.int64)
    # Without stored distances, the points are in the order of `rest`, as an index takes half of the time.
    points = model.points if model.size > LARGE and model.is_plane else None
    places = None if points is None else points[rest]
    for k, size in enumerate(range(rest.size, 0, -1)):
        if points is None or places is None:
            pick = int(model.legs(current, rest[:size]).argmin())
        else:
            pick = int(model.between(points[current], places[:size]).argmin())
            places[pick] = places[size - 1]
        order[k] = current = int(rest[pick])
        rest[pick] = rest[size - 1]
    return order
