"""The first routes of a search: within tight capacities, and with the bound that costs the least."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fleet.enumerated import OBJECTIVES, best

import crosstrack as ct
from crosstrack.instances.fleet import read_vrplib
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.solvers.fleet.bound import lower_bound, trip_bound
from crosstrack.solvers.fleet.start import _nearest, cut_tour, first_routes, repair

PUBLIC = Path(__file__).resolve().parents[3] / "shared" / "data" / "fleet-vrplib" / "CVRP"
needs_data = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public instances are in ../shared/data/fleet-vrplib, which is absent"
)  # fmt: skip


def packed(bins, capacity, seed, **more):
    """Return a fleet whose demands fill every vehicle to the last unit."""
    draw = np.random.default_rng(seed)
    demands = [0.0]
    for _ in range(bins):
        cuts = np.sort(draw.choice(np.arange(1, capacity), 3, replace=False))
        demands += np.diff([0, *cuts, capacity]).tolist()
    points = draw.random((len(demands), 2))
    return FleetRouting(bins, points=points, demands=demands, capacity=capacity, **more)


def plan_of(routes):
    return FleetPlan(tuple(map(tuple, routes)))


@pytest.mark.parametrize("seed", range(5))
def test_first_routes_keep_capacities_without_slack(seed):
    model = packed(8, 40, seed)
    routes = first_routes(model, np.random.default_rng(seed))
    assert routes is not None
    assert model.verify(plan_of(routes), tolerance=1e-12).ok


@pytest.mark.parametrize("use_all", [True, False])
@pytest.mark.parametrize("vehicles", [1, 3, 9])
def test_a_cut_tour_visits_each_node_once(vehicles, use_all):
    points = np.random.default_rng(1).random((10, 2))
    model = FleetRouting(vehicles, points=points, use_all=use_all)
    routes = cut_tour(model)
    assert len(routes) == vehicles
    assert model.verify(plan_of(routes)).ok


def test_repair_changes_overloaded_routes_alone():
    points = np.random.default_rng(0).random((8, 2))
    model = FleetRouting(
        3, points=points, demands=[0, 1, 1, 1, 1, 1, 1, 1], capacity=[2.0, 2.0, 3.0]
    )
    routes = [[1, 2, 3], [4], [5, 6, 7]]
    fixed = repair(model, routes, np.random.default_rng(0))
    assert fixed is not None and model.verify(plan_of(fixed)).ok
    whole = [[1, 2], [3, 4], [5, 6, 7]]
    assert repair(model, whole, np.random.default_rng(0)) == whole


def test_no_routes_are_returned_if_demands_exceed_all_capacity():
    model = packed(3, 10, 0)
    small = FleetRouting(3, points=model.points, demands=model.demands, capacity=9.0)
    assert first_routes(small, np.random.default_rng(0)) is None
    found = ct.solve(small, "fleet-search", backend_options={"steps": 50})
    assert found.termination == "no_solution"


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("seed", range(3))
def test_the_trip_bound_is_below_the_best_of_all_routes(objective, seed):
    draw = np.random.default_rng(seed)
    costs = draw.integers(0, 20, (6, 6)).astype(float)
    np.fill_diagonal(costs, 0)
    depots = [0, 5] if seed else 0
    model = FleetRouting(2, costs=costs, objective=objective, depots=depots, use_all=seed < 2)
    assert trip_bound(model) <= best(model)[0]
    assert trip_bound(model) <= lower_bound(model, np.zeros(1, np.int8)) + 1e-6


def test_a_route_as_long_as_the_longest_trip_is_optimal_at_once():
    points = np.random.default_rng(1).random((300, 2))
    points[1] = [9.0, 9.0]
    model = FleetRouting(60, points=points)
    found = ct.solve(model, "fleet-search", time_limit=10.0)
    assert found.termination == "optimal"
    assert found.gap <= 1e-6
    assert found.statistics["rounds"] <= 1


@needs_data
def test_a_plan_within_a_slack_of_three_units():
    model = read_vrplib(PUBLIC / "X-n101-k25.vrp", rounded=True)
    assert model.capacity.sum() - model.demands.sum() == 3.0
    found = ct.solve(model, time_limit=0.5)
    assert found.termination == "feasible"
    assert not found.verification.within_tolerance
    assert found.dual_bound > 0.0


@pytest.mark.parametrize("metric", ["euclidean", "rounded", "paper"])
@pytest.mark.parametrize("scale", [1e-3, 1e6])
def test_large_tours_go_to_the_nearest_node(metric, scale):
    points = np.random.default_rng(5).random((1100, 2)) * scale
    model = FleetRouting(2, points=points, metric=metric)
    tour = _nearest(model, 0, model.customers)
    assert sorted(tour.tolist()) == model.customers.tolist()
    left, current = np.array(model.customers), 0
    for node in tour.tolist():
        legs = model.legs(current, left)
        assert model.legs(current, node) <= legs.min() * (1 + 1e-12)
        left, current = left[left != node], node
