"""Optimal plans of small fleets by enumeration, and random fleets of every kind."""

import itertools

import numpy as np
import pytest

from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan

#: Objectives of plain fleets.
OBJECTIVES = ("sum", "max", "sum-deviation", "range", "max-sum", "sum-variance")


def sweep(few, many):
    """Return the parameters 0 … `many` - 1; those from `few` on are slow."""
    return [*range(few), *(pytest.param(k, marks=pytest.mark.slow) for k in range(few, many))]


def all_routes(nodes, vehicles):
    """Yield every way to hand out `nodes`, in every order of each route."""
    for owners in itertools.product(range(vehicles), repeat=len(nodes)):
        groups = [
            [x for x, k in zip(nodes, owners, strict=True) if k == v] for v in range(vehicles)
        ]
        yield from itertools.product(*map(itertools.permutations, groups))


def lengths(model, routes):
    """Return the length of each route."""
    d = model.distances.tolist()
    stops = [(home, *route, home) for home, route in zip(model.homes.tolist(), routes, strict=True)]
    return np.array([sum(d[a][b] for a, b in itertools.pairwise(one)) for one in stops])


def deviation(model, loads):
    """Return the standard deviation of the lengths."""
    if len(loads) < 2:
        return 0.0
    squares = ((loads - loads.sum() / len(loads)) ** 2).sum()
    return (squares / (len(loads) - (model.deviation == "sample"))) ** 0.5


def objective(model, loads):
    """Return what is minimised, of the lengths."""
    return {
        "sum": loads.sum(),
        "max": loads.max(),
        "sum-variance": loads.sum()
        + model.q * ((loads - loads.sum() / len(loads)) ** 2).sum() / len(loads),
        "sum-deviation": loads.sum() + model.q * deviation(model, loads),
        "range": loads.max() - loads.min(),
        "max-sum": loads.max() + 1e-6 * loads.sum(),
    }[str(model.objective)]


def allowed(model, loads, routes):
    """Return whether a plan keeps the limits, rounding aside."""
    near = 1e-9 * loads.max()
    limits = [
        (model.budget, loads.sum()),
        (model.deviation_limit, deviation(model, loads)),
        (model.range_limit, np.ptp(loads)),
        (model.battery, loads),
    ]
    if model.capacity is not None:
        carried = [sum(model.demands[i] for i in route) for route in routes]
        limits.append((model.capacity, np.array(carried)))
    kept = all(np.all(value <= limit + near) for limit, value in limits if limit is not None)
    return kept and (all(routes) or not model.use_all)


def best(model):
    """Return the least objective over all plans and such a plan, infinite and None without one."""
    value, plan = np.inf, None
    for routes in all_routes(model.customers.tolist(), model.vehicles):
        loads = lengths(model, routes)
        found = objective(model, loads)
        if found < value and allowed(model, loads, routes):
            value, plan = found, FleetPlan(routes)
    return value, plan


def random_fleet(seed, **fixed):
    """Return a fleet of 1 to 5 nodes: ties, zeros, ratios of 1e6, one-way costs, limits, two depots."""
    rng = np.random.default_rng(seed)
    size, vehicles = int(rng.integers(3, 7)), int(rng.integers(1, 4))
    kind = int(rng.integers(0, 5))
    if kind == 0:
        costs = 100 * rng.random((size, size))
    elif kind == 1:
        costs = rng.integers(0, 3, (size, size)).astype(float)
    else:
        points = rng.random((size, 2)) * 10.0 ** rng.integers(-3, 4)
        if kind == 2:  # several at one place
            points = np.round(points / points.max() * 3)
        if kind == 3:
            points[-1] *= 1e6
        costs = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(costs, 0.0)
    depots = rng.integers(0, 2, vehicles) if rng.random() < 0.3 else 0
    aim = OBJECTIVES[seed % 5]
    data = {
        "costs": costs, "depots": depots, "objective": aim,
        "use_all": bool(rng.random() < 0.6) and vehicles <= size - np.unique(depots).size,
        "q": float(rng.choice([0.0, 0.3, 1.0, 5.0])) if aim == "sum-deviation" else 0.0,
        "deviation": str(rng.choice(["sample", "population"])), **fixed,
    }  # fmt: skip
    free = FleetRouting(vehicles, **data)
    routes = next(
        r for r in all_routes(free.customers.tolist(), vehicles) if all(r) or not free.use_all
    )
    loads, draw = lengths(free, routes), rng.random(5)
    if draw[0] < 0.25:
        data["battery"] = loads.max() * rng.choice([0.7, 1.0, 1.2], vehicles)
    if draw[1] < 0.2:
        data["demands"] = rng.integers(0, 4, size).astype(float)
        data["capacity"] = float(np.ceil(data["demands"].sum() / vehicles)) + rng.integers(0, 2)
    if draw[2] < 0.15:
        data["budget"] = loads.sum() * rng.choice([0.8, 1.0])
    if draw[3] < 0.15:
        data["deviation_limit"] = deviation(free, loads) * rng.choice([0.5, 1.0])
    if draw[4] < 0.15:
        data["range_limit"] = np.ptp(loads) * rng.choice([0.5, 1.0])
    return FleetRouting(vehicles, **data, name=f"random-{seed}")
