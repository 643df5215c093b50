"""The exact program over subsets of rich fleets: against enumeration, with stops, and its limits."""

import itertools
import math

import numpy as np
import pytest
from fleet.rich_oracle import enumerate_best, reject
from fleet.rich_random import scaled, supported

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.models import FleetRouting
from crosstrack.solvers import Termination
from crosstrack.solvers.fleet.rich_tours import best_routes, first_routes

SQUARE = [[0, 0], [3, 0], [0, 4], [5, 5]]


def solved(model):
    return ct.solve(model, "subset-dp")


@pytest.mark.parametrize(
    ("scale", "count"),
    [(1.0, 10), (1e-3, 3), (1e6, 3), pytest.param(1.0, 400, marks=pytest.mark.slow)],
)
def test_equals_enumeration(scale, count):
    feasible = 0
    for model in itertools.islice(supported("subset-dp", itertools.count()), count):
        best, plan = enumerate_best(model)
        answer = solved(scaled(model, scale) if scale != 1.0 else model)
        if plan is None and answer.plan is None:
            assert answer.termination is Termination.INFEASIBLE
            continue
        assert answer.termination is Termination.OPTIMAL
        assert answer.dual_bound == pytest.approx(answer.primal_bound, rel=1e-9, abs=1e-9 * scale)
        assert scale != 1.0 or reject(model, answer.plan) == []
        # The enumeration visits one reload and one station at most once per route.
        limit = scale * (best + 1e-6 * max(1.0, abs(best)))
        assert answer.primal_bound <= limit
        if not model.stations:
            assert answer.primal_bound == pytest.approx(scale * best, rel=1e-6, abs=1e-6 * scale)
        feasible += 1
    assert feasible > count / 3


def test_a_route_visits_several_reloads_and_a_station():
    model = FleetRouting(
        1, costs=10.0 * (1 - np.eye(5)), objective="sum", demands=[0, 2, 2, 2, 0], capacity=2,
        reloads=[0], battery=40, stations=[4],
    )  # fmt: skip
    answer = solved(model)
    assert answer.termination is Termination.OPTIMAL
    assert answer.plan.routes[0].count(0) == 2
    assert answer.plan.routes[0].count(4) == 1
    assert answer.primal_bound == 70.0


@pytest.mark.parametrize(
    ("points", "fields", "route"),
    [
        # the station before and after the reload
        ([[4, 1], [4, -1], [4, 0], [8, 0]], {"reloads": [4], "stations": [3], "battery": 9}, (1, 3, 4, 3, 2)),
        # a node that reloads and charges
        ([[3, 0], [6, 0], [4, 0]], {"reloads": [3], "stations": [3], "battery": 9}, (1, 3, 2)),
    ],
)  # fmt: skip
def test_a_new_trip_makes_each_stop_useful_again(points, fields, route):
    fields = {
        "points": [[0, 0], *points], "objective": "sum", "capacity": 2,
        "demands": [0, 2, 2, *[0] * (len(points) - 2)], **fields,
    }  # fmt: skip
    answer = solved(FleetRouting(1, **fields))
    assert answer.termination is Termination.OPTIMAL
    assert answer.plan.routes in [(route,), (route[::-1],)]
    assert solved(FleetRouting(1, **fields, max_reloads=0)).termination is Termination.INFEASIBLE


def test_a_charged_vehicle_reloads_again_on_its_way():
    costs = np.full((5, 5), 50.0)
    np.fill_diagonal(costs, 0)
    for a, b, cost in [(0, 1, 3), (1, 4, 5), (4, 3, 2), (4, 2, 6), (2, 0, 1)]:
        costs[a, b] = costs[b, a] = cost
    model = FleetRouting(
        1, costs=costs, objective="sum", demands=[0, 2, 2, 0, 0], capacity=2, reloads=[4],
        stations=[3], battery=10,
    )  # fmt: skip
    (route,) = solved(model).plan.routes
    assert route in ((1, 4, 3, 4, 2), (2, 4, 3, 4, 1))


def test_an_idle_vehicle_has_no_return():
    points = [[25, 7], [3, 8], [12, 24], [13, 2]]
    shifts = [(-100, 900), (-100, 900), (-1, 900)]
    model = FleetRouting(3, points=points, objective="makespan", shifts=shifts)
    # The last vehicle returns after 0.
    best, _ = enumerate_best(
        FleetRouting(2, points=points, objective="makespan", shifts=shifts[:2])
    )
    answer = solved(model)
    assert answer.primal_bound == pytest.approx(best) and answer.dual_bound == pytest.approx(best)


def test_every_objective_of_a_timed_fleet():
    fields = {"points": SQUARE, "service": [0, 1, 2, 3], "windows": [None, (0, 4), None, (9, 11)]}
    for objective in ("sum", "max", "max-sum", "cost", "makespan"):
        model = FleetRouting(2, objective=objective, **fields)
        best, _ = enumerate_best(model)
        assert solved(model).primal_bound == pytest.approx(best)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"points": np.random.default_rng(0).random((10, 2))}, "more than 8 nodes .* got 9 and 0"),
        ({"reloads": [0], "points": np.random.default_rng(0).random((9, 2))}, "got 8 and 1"),
        ({"objective": "makespan", "budget": 30}, "a budget with the objective 'makespan'"),
        ({"objective": "sum-deviation", "q": 1.0}, "the objective 'sum-deviation'"),
        ({"range_limit": 3}, "range_limit"),
    ],
)  # fmt: skip
def test_refuses_by_name(fields, reason):
    model = FleetRouting(2, **{"points": SQUARE, "objective": "sum", "shifts": (0, 99)} | fields)
    with pytest.raises(UnsupportedFormulation, match=reason):
        solved(model)


def test_a_stop_ends_the_labels():
    model = FleetRouting(2, points=SQUARE, objective="sum", shifts=(0, 99))
    assert best_routes(model, lambda: True) is None
    (values, routes), _ = best_routes(model, lambda: False)
    assert routes[0] == () and values[0] == 0.0 and math.isfinite(values[7])


@pytest.mark.parametrize("name", ["subset-dp", "pyvrp"])
def test_a_depot_requires_no_skills(name):
    if name == "pyvrp":
        pytest.importorskip("pyvrp", reason="PyVRP is not installed")
    model = FleetRouting(
        1, points=SQUARE, objective="sum", requires=[["lift"], [], ["saw"], []], skills=[["saw"]]
    )
    answer = ct.solve(model, name, **({"seed": 1} if name == "pyvrp" else {}))
    assert answer.primal_bound == pytest.approx(
        ct.solve(FleetRouting(1, points=SQUARE)).primal_bound
    )
    # A reload is a node of the route, and requires its skills.
    barred = FleetRouting(
        1, points=SQUARE, objective="sum", requires=[["lift"], [], [], []], skills=[[]],
        reloads=[0], demands=[0, 2, 2, 2], capacity=4,
    )  # fmt: skip
    assert ct.solve(barred, name, **({"seed": 1} if name == "pyvrp" else {})).plan is None


def test_a_stopped_run_has_a_plan():
    """Routes of 15 different vehicles through all sets of 8 nodes take seconds."""
    points = np.random.default_rng(1).uniform(0, 100, (9, 2))
    model = FleetRouting(
        15, points=points, objective="cost", fixed_cost=np.arange(15.0), windows=[[[0, 1000]]] * 9,
        demands=[0] + [1] * 8, capacity=np.arange(2, 17), service=[0] + [1] * 8,
    )  # fmt: skip
    answer = ct.solve(model, "subset-dp", time_limit=0.5)
    assert answer.termination is Termination.FEASIBLE and answer.limit == "time"
    assert answer.verified


def test_first_routes_serve_most_drawn_fleets():
    count = feasible = 0
    for model in itertools.islice(supported("subset-dp", itertools.count()), 60):
        best, _ = enumerate_best(model)
        if not math.isfinite(best):
            continue
        count += 1
        plans = [
            model.with_schedule(first_routes(model, most))
            for most in (model.size, -(-len(model.customers) // model.vehicles))
        ]
        feasible += any(model.verify(plan).ok for plan in plans)
    assert feasible > 0.5 * count > 10
