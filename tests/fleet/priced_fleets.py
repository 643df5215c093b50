"""Random small rich fleets of the features of column generation, and their optimum by enumeration."""

import itertools

import numpy as np
from fleet.enumerated import all_routes

from crosstrack.models import FleetRouting
from crosstrack.models.fleet.checks import value_of


def random_rich_fleet(seed):
    """Return a fleet of 3 or 4 nodes with windows, skills, prizes, ends, shifts, costs or dimensions."""
    rng = np.random.default_rng(seed)
    size, vehicles = int(rng.integers(4, 6)), int(rng.integers(1, 3))
    scale = 10.0 ** rng.integers(-2, 4)
    points = np.round(rng.random((size, 2)) * 4, 1 if seed % 3 else 0) * scale
    costs = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    if rng.random() < 0.3:
        costs *= rng.uniform(0.5, 1.5, (size, size))
    data = {"costs": costs, "objective": str(rng.choice(["sum", "cost", "cost", "max"]))}
    draw = rng.random(9)
    horizon = 6.0 * scale
    if draw[0] < 0.6:
        begins = rng.uniform(0, horizon, size)
        width = rng.choice([0.0, 1.0, 3.0, 20.0], size) * scale
        data["windows"] = [
            None if i == 0 or rng.random() < 0.3 else [(begins[i], begins[i] + width[i])]
            for i in range(size)
        ]
    if draw[1] < 0.4:
        data["service"] = rng.choice([0.0, 0.5, 2.0], size) * scale
    if draw[2] < 0.4:
        data["speed"] = rng.choice([0.5, 1.0, 2.0], vehicles)
    if draw[3] < 0.4:
        early = rng.choice([0.0, 1.0], vehicles) * scale
        data["shifts"] = np.stack(
            [early, early + rng.choice([8.0, 15.0, 40.0], vehicles) * scale], 1
        )
    if draw[4] < 0.3:
        names = [("a",), ("b",), ("a", "b"), ()]
        data["requires"] = [names[rng.choice([0, 1, 3, 3])] for _ in range(size)]
        data["skills"] = [names[rng.integers(3)] for _ in range(vehicles)]
    if draw[5] < 0.3:
        data["ends"] = rng.choice([-1, 0, size - 1], vehicles)
    if draw[6] < 0.5:
        shape = (size, 2) if rng.random() < 0.5 else (size,)
        data["demands"] = rng.integers(0, 4, shape).astype(float)
        data["capacity"] = rng.integers(4, 9, (vehicles, *shape[1:])).astype(float)
    if draw[7] < 0.3:
        data["battery"] = rng.choice([8.0, 12.0, 30.0], vehicles) * scale
    if data["objective"] == "cost":
        data["fixed_cost"] = rng.choice([0.0, 1.0, 3.0], vehicles) * scale
        data["distance_cost"] = rng.choice([0.5, 1.0, 2.0], vehicles)
        if draw[8] < 0.6:
            prizes = rng.uniform(0.0, 5.0, size) * scale
            data["prizes"] = np.where(rng.random(size) < 0.6, prizes, np.nan)
    return FleetRouting(vehicles, **data, use_all=bool(rng.random() < 0.2), name=f"rich-{seed}")


def best_rich(model):
    """Return the least objective over all plans, infinite without one."""
    nodes, value = model.customers.tolist(), np.inf
    free = [i for i in nodes if model.optional[i]]
    for count in range(len(free) + 1):
        for skipped in itertools.combinations(free, count):
            for routes in all_routes([i for i in nodes if i not in skipped], model.vehicles):
                plan = model.with_schedule(routes)
                if model.verify(plan, tolerance=1e-9).ok:
                    value = min(value, value_of(model, plan))
    return value
