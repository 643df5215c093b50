"""Optimal plans of small fleets by enumeration, and random fleets that share nothing with solvers."""

import itertools

import numpy as np

import crosstrack as ct
from crosstrack.models import FleetPlan, FleetRouting


def partitions(items, parts):
    """Yield every way to hand out `items` to `parts` vehicles, in every order of each route."""
    for owners in itertools.product(range(parts), repeat=len(items)):
        groups = [
            [x for x, k in zip(items, owners, strict=True) if k == part] for part in range(parts)
        ]
        yield from itertools.product(*(itertools.permutations(group) for group in groups))


def best(model):
    """Return the least objective over all plans that verify, and such a plan; None without one."""
    value, plan = np.inf, None
    d, homes = model.distances, model.homes
    for routes in partitions(model.customers.tolist(), model.vehicles):
        if model.use_all and not all(routes):
            continue
        loads = np.array(
            [
                sum(d[a, b] for a, b in itertools.pairwise((homes[k], *route, homes[k])))
                for k, route in enumerate(routes)
            ]
        )
        found = objective(model, loads)
        if found < value and allowed(model, loads, routes):
            value, plan = found, routes
    return (value, FleetPlan(plan)) if plan is not None else (None, None)


def deviation(model, loads):
    """Return the standard deviation of the lengths."""
    if len(loads) < 2:
        return 0.0
    away = ((loads - loads.mean()) ** 2).sum()
    return (away / (len(loads) - (model.deviation == "sample"))) ** 0.5


def objective(model, loads):
    """Return what is minimised, of the lengths."""
    return {
        "sum": loads.sum(),
        "max": loads.max(),
        "sum-deviation": loads.sum() + model.q * deviation(model, loads),
        "range": loads.max() - loads.min(),
        "max-sum": loads.max() + 1e-6 * loads.sum(),
    }[str(model.objective)]


def allowed(model, loads, routes):
    """Return whether the limits hold, rounding aside."""
    near = 1e-9 * max(loads.max(), 1e-300)
    if model.battery is not None and (loads > model.battery + near).any():
        return False
    if model.capacity is not None:
        carried = [sum(model.demands[i] for i in route) for route in routes]
        if (np.array(carried) > model.capacity + 1e-9).any():
            return False
    return not (
        (model.budget is not None and loads.sum() > model.budget + near)
        or (
            model.deviation_limit is not None
            and deviation(model, loads) > model.deviation_limit + near
        )
        or (model.range_limit is not None and np.ptp(loads) > model.range_limit + near)
    )


OBJECTIVES = ("sum", "max", "sum-deviation", "range", "max-sum")


def random_fleet(seed):
    """Return a fleet of 3 to 6 nodes, of any kind: ties, zeros, ratios of 1e6, limits, two depots."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    kind = rng.integers(0, 5)
    if kind == 0:
        costs = rng.random((n + 1, n + 1)) * 100
    elif kind == 1:  # ties and zeros, asymmetric
        costs = rng.integers(0, 3, (n + 1, n + 1)).astype(float)
    else:
        points = rng.random((n + 1, 2)) * 10.0 ** rng.integers(-3, 4)
        if kind == 2:
            points = np.round(points / points.max() * 3)  # several at one place
        if kind == 3:
            points[-1] *= 1e6
        costs = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(costs, 0.0)
    objective = OBJECTIVES[seed % 5]
    several = n > 2 and rng.random() < 0.3
    depots = rng.integers(0, 2, m) if several else 0
    customers = n + 1 - np.unique(depots).size
    use_all = bool(rng.random() < 0.6) and m <= customers
    data = {
        "costs": costs, "depots": depots, "use_all": use_all, "objective": objective,
        "q": float(rng.choice([0.0, 0.3, 1.0, 5.0])) if objective == "sum-deviation" else 0.0,
        "deviation": str(rng.choice(["sample", "population"])),
    }  # fmt: skip
    free = FleetRouting(m, **data)
    plan = next(p for p in partitions(free.customers.tolist(), m) if not use_all or all(p))
    plan = FleetPlan(plan)
    loads = np.array([free.second_objective("max", FleetPlan([r])) for r in plan.routes])
    del loads
    total, most = free.second_objective("sum", plan), free.second_objective("max", plan)
    draw = rng.random(5)
    if draw[0] < 0.25:
        data["battery"] = most * rng.choice([0.7, 1.0, 1.2], m)
    if draw[1] < 0.2:
        data["demands"] = rng.integers(0, 4, n + 1).astype(float)
        data["capacity"] = float(np.ceil(data["demands"].sum() / m)) + rng.integers(0, 2)
    if draw[2] < 0.15:
        data["budget"] = total * rng.choice([0.8, 1.0])
    if draw[3] < 0.15:
        data["deviation_limit"] = free.second_objective("deviation", plan) * rng.choice([0.5, 1.0])
    if draw[4] < 0.15:
        data["range_limit"] = free.second_objective("range", plan) * rng.choice([0.5, 1.0])
    return FleetRouting(m, **data, name=f"random-{seed}")


__all__ = ["OBJECTIVES", "best", "ct", "deviation", "objective", "partitions", "random_fleet"]
