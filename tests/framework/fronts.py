"""Fronts by enumeration, and what the tests of fronts share."""

import itertools

import numpy as np

from crosstrack.models import FleetPlan, FleetRouting
from crosstrack.solvers import Answer, Termination
from crosstrack.solvers.fleet.subset_dp import SubsetDP

#: Six nodes, whose front of sum and longest route has three points.
PLACES = [[0, 0], [4, 0], [5, 5], [5, -5], [-1, 1], [-2, -1]]
MODEL = FleetRouting(2, points=PLACES, objective="sum", name="six")
POINTS = [(30.2265, 24.3402), (34.9244, 18.7543), (35.0937, 17.7243)]


def values(found):
    return [(one.objective, one.second) for one in found.points]


def all_loads(costs, vehicles):
    """The lengths of all routes of all plans with a node for every vehicle, shape (plans, vehicles)."""
    nodes = range(1, len(costs))
    rows = []
    for order in itertools.permutations(nodes):
        for cuts in itertools.combinations(range(1, len(order)), vehicles - 1):
            ends = (0, *cuts, len(order))
            routes = ((0, *order[a:b], 0) for a, b in itertools.pairwise(ends))
            rows.append([sum(costs[i][j] for i, j in itertools.pairwise(r)) for r in routes])
    return np.array(rows, float)


def measured(what, loads, q=0.0):
    deviation = loads.std(axis=1, ddof=1)
    return {
        "sum": loads.sum(axis=1),
        "max": loads.max(axis=1),
        "deviation": deviation,
        "range": np.ptp(loads, axis=1),
        "sum-deviation": loads.sum(axis=1) + q * deviation,
        "max-sum": loads.max(axis=1) + 1e-6 * loads.sum(axis=1),
    }[what]


def pareto_set(first, second):
    """Pairs that no other pair is as good as in both entries, the largest second one first."""
    kept = []
    for a, b in sorted(zip(first.tolist(), second.tolist(), strict=True)):
        if not kept or b < kept[-1][1] - 1e-9 * abs(kept[-1][1]):
            # What differs by rounding only is no better in the first.
            if kept and a <= kept[-1][0] * (1 + 1e-9):
                kept.pop()
            kept.append((a, b))
    return kept


def matrix(kind, seed):
    """Costs between a depot and four to six nodes."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 8)) if kind in ("plane", "ties") else 5
    if kind == "ties":  # and zeros, not symmetric
        found = rng.integers(0, 4, (n, n)).astype(float)
    elif kind == "nothing":
        found = np.zeros((n, n))
    else:
        points = rng.random((n, 2)) * 100
        if kind == "places":  # several nodes at one place
            points = np.round(points / 50)
        elif kind == "far":  # one point a million times as far away as the others
            points[-1] *= 1e6
        elif kind == "line":
            points[:, 1] = 0.0
        found = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(found, 0.0)
    return found


class Given(SubsetDP):
    """Returns given plans, one per run, and proves nothing."""

    name = "given"

    def __init__(self, *plans):
        self.plans = iter(plans)

    def run(self, problem, request):
        return Answer(Termination.FEASIBLE, None, FleetPlan(next(self.plans)))
