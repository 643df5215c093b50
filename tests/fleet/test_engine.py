"""Laws of the search: incremental values equal recomputed ones, moves keep plans valid, seeds repeat."""

from __future__ import annotations

import dataclasses
import threading
import time

import numpy as np
import pytest
from fleet.enumerated import OBJECTIVES, best
from hypothesis import given, settings, strategies as st
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

import crosstrack as ct
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan, data
from crosstrack.models.fleet.checks import loads_of
from crosstrack.solvers.fleet import decomposition, fleet_search
from crosstrack.solvers.fleet.bound import lower_bound
from crosstrack.solvers.fleet.candidate import Candidate, nearest_of, scaled
from crosstrack.solvers.fleet.decomposition import Parts
from crosstrack.solvers.fleet.fleet_kernels import Routes, measure, workspace
from crosstrack.solvers.fleet.giant_tour import GiantTour
from crosstrack.solvers.fleet.search_kernels import anneal
from crosstrack.solvers.fleet.start import cut_tour
from crosstrack.solvers.fleet.tree_bound import tree_bound

RUNNING = np.zeros(1, np.int8)


def fleet_of(draw, objective, limit, count, vehicles, **more):
    """Return a fleet with asymmetric costs, ties, and a limit that many routes violate."""
    costs = draw.integers(0, 9, (count + 1, count + 1)) * 1.0
    np.fill_diagonal(costs, 0)
    costs[0, 1] = 9.0
    if objective.startswith("sum-"):
        more["q"] = 0.5
    if limit == "capacity":
        more |= {
            "demands": np.r_[0, draw.integers(1, 5, count)],
            "capacity": 3.0 * count / vehicles,
        }
    elif limit:
        more[limit] = 2.0 * count / vehicles
    return FleetRouting(vehicles, costs=costs, objective=objective, **more)


@given(
    seed=st.integers(0, 10**6), objective=st.sampled_from(OBJECTIVES), count=st.integers(2, 14),
    vehicles=st.integers(1, 9), use_all=st.booleans(),
    limit=st.sampled_from(["", "capacity", "battery", "budget", "deviation_limit", "range_limit"]),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_incremental_values_equal_recomputed_ones(seed, objective, count, vehicles, use_all, limit):
    draw = np.random.default_rng(seed)
    model = fleet_of(draw, objective, limit, count, min(vehicles, count), use_all=use_all)
    candidate = Candidate(scaled(model), [])
    routes = candidate.routes
    now, top = (Routes(*(entry.copy() for entry in routes)) for _ in range(2))
    done, least, broken = anneal(
        candidate.fleet, routes, now, top, workspace(routes), 0.1, 0.01, 30, RUNNING, draw
    )
    assert done == 30
    _, objective_again, broken_again = measure(candidate.fleet, routes, workspace(routes))
    assert least == pytest.approx(objective_again, rel=1e-7, abs=1e-9)
    assert broken == pytest.approx(broken_again, rel=1e-7, abs=1e-9)
    plan = FleetPlan(tuple(map(tuple, candidate.stops())))
    checks = {check.name: check.ok for check in model.verify(plan).checks}
    assert checks["each node visited once"]
    assert checks.get("every vehicle used", True)
    loads = loads_of(model, plan) / model.distances.max()
    assert routes.values[0] == pytest.approx(loads)
    assert routes.values[2].tolist() == [len(stops) for stops in plan.routes]
    for state in (routes, now) if model.demands is not None else ():  # the best and the last routes
        candidate.routes = state
        assert state.values[1].tolist() == [model.demands[x].sum() for x in candidate.stops()]


@pytest.mark.parametrize("vehicles", [1, 3])
@pytest.mark.parametrize("use_all", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_a_chained_tour_is_the_shortest_of_few_nodes(seed, use_all, vehicles):
    points = np.random.default_rng(seed).random((11, 2))
    points[3] = points[4]
    model = FleetRouting(vehicles, points=points, objective="sum", use_all=use_all)
    tour = GiantTour.of(model, scaled(model))
    assert tour is not None
    routes, done = tour.improve(cut_tour(model), 60, RUNNING, np.random.default_rng(1))
    checked = model.verify(FleetPlan(tuple(map(tuple, routes))))
    assert done == 60
    assert checked.ok, checked
    exact = ct.solve(model, "subset-dp")
    assert checked.objective == pytest.approx(exact.primal_bound)


@given(seed=st.integers(0, 10**6), count=st.integers(7, 40), vehicles=st.integers(1, 4))
@settings(max_examples=15, deadline=None)
def test_kicks_keep_a_tour_and_never_lengthen_it(seed, count, vehicles):
    draw = np.random.default_rng(seed)
    points = draw.integers(0, 6, (count + 1, 2)) * 1.0  # ties and places that coincide
    model = FleetRouting(vehicles, points=points, objective="sum")
    tour = GiantTour.of(model, scaled(model))
    assert tour is not None
    first = cut_tour(model)
    routes, _ = tour.improve(first, 5, RUNNING, draw)
    before, after = (model.verify(FleetPlan(tuple(map(tuple, one)))) for one in (first, routes))
    assert after.ok
    assert after.objective <= before.objective * (1 + 1e-9)


def test_a_tour_replaces_routes_only_if_they_share_depot_and_limits():
    points = np.random.default_rng(0).random((12, 2))
    for more in (
        {"objective": "max"}, {"depots": [0, 1]}, {"battery": 9.0},
        {"demands": np.ones(12), "capacity": 9.0},
    ):  # fmt: skip
        model = FleetRouting(2, points=points, **{"objective": "sum", **more})
        assert GiantTour.of(model, scaled(model)) is None


@pytest.mark.parametrize("metric", ["euclidean", "rounded", "paper"])
def test_legs_equal_the_distances(metric, monkeypatch):
    points = np.random.default_rng(0).random((30, 2)) * 50
    model = FleetRouting(2, points=points, metric=metric)
    monkeypatch.setattr(data, "LARGE", 5)
    lean = FleetRouting(2, points=points, metric=metric)
    nodes = np.arange(30)
    assert (lean.legs(nodes[:, None], nodes) == model.distances).all()
    assert "distances" not in lean.__dict__
    assert lean.longest >= model.longest
    assert lean.symmetric


@pytest.mark.sample(2)
@pytest.mark.parametrize("metric", ["euclidean", "rounded", "paper"])
@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("seed", range(3))
def test_the_tree_bound_is_below_the_optimum(metric, objective, seed):
    draw = np.random.default_rng(seed)
    points = draw.integers(0, 4 if seed else 30, (6, 2)) * 1.3
    more = {"q": 0.3} if objective.startswith("sum-") else {}
    depots = [0, 1] if seed == 2 else 0
    model = FleetRouting(
        2, points=points, metric=metric, objective=objective, depots=depots, use_all=False, **more
    )
    assert 0.0 <= tree_bound(model) <= best(model)[0] * (1 + 1e-9)
    on_a_line = dataclasses.replace(model, points=np.column_stack([np.arange(6.0), np.zeros(6)]))
    assert tree_bound(on_a_line) == 0.0


@pytest.mark.parametrize("depots", [[0], [0, 1, 2]])
@pytest.mark.parametrize("metric", ["euclidean", "rounded", "paper"])
@pytest.mark.parametrize(("objective", "share"), [("sum", 1), ("max", 3)])
def test_the_tree_bound_has_the_length_of_scipys_tree(objective, share, metric, depots):
    points = np.random.default_rng(4).random((20, 2)) * 10
    lengths = cdist(points, points)
    lengths[np.ix_(depots, depots)] = 1e-6  # depots are connected; SciPy drops edges of length 0
    edges = minimum_spanning_tree(lengths).data
    edges = np.floor(edges + 0.5) if metric == "rounded" else edges
    model = FleetRouting(
        3, points=points, metric=metric, objective=objective, depots=depots, use_all=False
    )
    assert tree_bound(model) == pytest.approx(edges.sum() / share, rel=1e-6)


@pytest.fixture
def small_parts(monkeypatch):
    """Treat models with more than 20 nodes as large, in parts of 8 nodes."""
    for module in (data, fleet_search):
        monkeypatch.setattr(module, "LARGE", 20)
    monkeypatch.setattr(decomposition, "SIZE", 8)
    monkeypatch.setattr(decomposition, "STEPS", 10)
    monkeypatch.setattr(fleet_search, "SIZE", 8)


@given(
    seed=st.integers(0, 10**6), objective=st.sampled_from(OBJECTIVES), vehicles=st.integers(1, 7),
    plane=st.booleans(), limit=st.sampled_from(["", "capacity", "battery"]),
)  # fmt: skip
@settings(max_examples=20, deadline=None)
def test_parts_keep_routes_valid_and_never_make_them_worse(seed, objective, vehicles, plane, limit):
    draw = np.random.default_rng(seed)
    model = fleet_of(draw, objective, limit, 30, vehicles, use_all=bool(seed % 2))
    if plane:
        points = draw.integers(0, 9, (31, 2)) * 1.0
        model = dataclasses.replace(model, costs=None, points=points)
    parts = Parts(model, cut_tour(model), draw)
    before = model.verify(parts.plan)
    steps, decomposition.STEPS, size, decomposition.SIZE = (
        decomposition.STEPS,
        2,
        decomposition.SIZE,
        8,
    )
    try:
        for _ in range(4):
            parts.improve(RUNNING)
    finally:
        decomposition.STEPS, decomposition.SIZE = steps, size
    plan = parts.plan
    after = model.verify(plan)
    checks = {check.name: check.ok for check in after.checks}
    assert checks["each node visited once"]
    assert checks.get("every vehicle used", True)
    assert parts.loads == pytest.approx(loads_of(model, plan))
    if before.ok:
        assert after.ok
        assert after.objective <= before.objective * (1 + 1e-9) + 1e-9


@pytest.mark.parametrize("objective", ["max", "sum-variance"])
def test_large_fleets_are_planned_in_parts_and_repeat_by_seed(objective, small_parts):
    points = np.random.default_rng(0).random((60, 2)) * 1e3
    demands = np.r_[0, np.ones(59)]
    model = FleetRouting(5, points=points, objective=objective, demands=demands, capacity=13.0)
    options = {"backend_options": {"patience": 1}, "seed": 3}
    plans = [ct.solve(model, "fleet-search", **options) for _ in range(2)]
    assert plans[0].verified
    assert plans[0].plan == plans[1].plan
    assert plans[0].statistics["rounds"] > 50
    assert 0.0 < plans[0].dual_bound <= plans[0].primal_bound
    first = model.verify(FleetPlan(tuple(map(tuple, cut_tour(model)))))
    assert plans[0].primal_bound < first.objective
    again = ct.solve(model, "fleet-search", warm_start=plans[0], **options)
    assert again.primal_bound <= plans[0].primal_bound


@pytest.mark.parametrize(("objective", "scale"), [("max", 1e-3), ("range", 1e6)])
def test_thousands_of_points_get_a_plan_within_a_second_of_work(objective, scale):
    points = np.random.default_rng(0).random((3000, 2)) * scale
    model = FleetRouting(40, points=points, objective=objective)
    found = ct.solve(model, "fleet-search", time_limit=0.3)
    assert found.verified
    assert "distances" not in model.__dict__


def test_points_at_one_place_are_planned():
    found = ct.solve(FleetRouting(3, points=np.ones((1500, 2))), "fleet-search", time_limit=2.0)
    assert found.verified
    assert found.primal_bound == 0.0


@pytest.mark.usefixtures("small_parts")
def test_a_search_in_parts_keeps_its_options_and_the_bound_of_all_distances():
    points = np.random.default_rng(0).random((40, 2))
    model = FleetRouting(3, points=points, objective="max")
    found = ct.solve(model, "fleet-search", backend_options={"steps": 7, "bound": False}, seed=0)
    assert found.statistics["steps"] == 7 * found.statistics["rounds"] > 0
    found = ct.solve(model, "fleet-search", backend_options={"steps": 7}, seed=0)
    assert found.dual_bound == lower_bound(model, RUNNING) > 1.05 * tree_bound(model)


@pytest.mark.parametrize("objective", ["sum", "max"])
def test_large_fleets_have_a_plan_soon_after_the_limit(objective: str) -> None:
    model = FleetRouting(10, points=np.random.default_rng(3).random((3000, 2)), objective=objective)
    reached: list[float] = []
    timer = threading.Timer(0.3, lambda: reached.append(time.process_time()))
    timer.start()
    answer = ct.solve(model, "fleet-search", time_limit=0.3, seed=1)
    over = time.process_time() - reached[0] if reached else 0.0
    timer.cancel()
    assert answer.plan is not None
    assert over < 1.0  # CPU seconds: first routes, 0.2 s, and the steps of compiling


def test_nearest_nodes_are_those_of_a_full_sort() -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 60))
        distances = rng.integers(0, 8, (n, n)).astype(float) if seed % 2 else rng.random((n, n))
        nodes = np.sort(rng.permutation(n)[: int(rng.integers(1, n + 1))])
        near = nearest_of(distances, nodes)
        for i in nodes:
            others = nodes[nodes != i]
            order = np.argsort(distances[i, others] + distances[others, i], kind="stable")
            expected = others[order][: near.shape[1]]
            assert near[i, : expected.size].tolist() == expected.tolist()
            assert (near[i, expected.size :] == -1).all()
