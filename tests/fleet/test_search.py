"""Search for routes: known optima, reproducibility by seed, and limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fleet.enumerated import OBJECTIVES, best
from hypothesis import given, settings, strategies as st
from listening import incumbents

import crosstrack as ct
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.solvers import Limit, Termination
from crosstrack.solvers.contract.job import GAP


def scattered(n: int, vehicles: int, seed: int = 0, **more) -> FleetRouting:
    points = np.random.default_rng(seed).random((n + 1, 2)) * 100
    return FleetRouting(vehicles, points=points, **more)


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), 2])
def test_small_fleets_get_the_best_of_all_routes(objective, seed):
    draw = np.random.default_rng(seed)
    costs = draw.integers(0, 20, (6, 6)) * 10.0 ** draw.integers(0, 3)
    np.fill_diagonal(costs, 0)
    if seed % 2:
        costs = np.maximum(costs, costs.T)
    more = {"q": 0.7} if objective == "sum-deviation" else {}
    more |= {"q": 0.01} if objective == "sum-variance" else {}
    if seed == 2:
        more["depots"] = [0, 5]
    model = FleetRouting(2, costs=costs, objective=objective, **more)
    found = ct.solve(model, "fleet-search", seed=seed)
    assert found.verified
    assert found.primal_bound == pytest.approx(best(model)[0], rel=1e-9, abs=1e-9)
    assert found.dual_bound <= found.primal_bound + 1e-9 * abs(found.primal_bound)


@given(
    count=st.integers(1, 7), vehicles=st.integers(1, 4), seed=st.integers(0, 10**6),
    objective=st.sampled_from(OBJECTIVES), use_all=st.booleans(), scale=st.sampled_from([1e-6, 1.0, 1e6]),
)  # fmt: skip
@settings(max_examples=8, deadline=None)
def test_routes_are_never_worse_than_proven_nor_below_a_bound(
    count, vehicles, seed, objective, use_all, scale
):
    draw = np.random.default_rng(seed)
    # Ties, places that coincide, and one that is far away.
    points = draw.integers(0, 4, (count + 1, 2)) * scale
    if seed % 3 == 0:
        points[-1] *= 1e6
    vehicles = min(vehicles, count)
    model = FleetRouting(vehicles, points=points, objective=objective, use_all=use_all)
    found = ct.solve(model, "fleet-search", seed=1)
    assert found.verified
    assert found.dual_bound <= found.primal_bound * (1 + 1e-9)
    if objective in ("sum", "max", "max-sum"):
        exact = ct.solve(model, "subset-dp")
        # The search ends as soon as its bound is within the gap.
        assert found.primal_bound == pytest.approx(exact.primal_bound, rel=GAP, abs=1e-12 * scale)


def test_the_plan_does_not_depend_on_the_number_of_threads():
    model = scattered(30, 3)
    options = {"patience": 1, "steps": 200}
    plans = [
        ct.solve(
            model, "fleet-search", seed=7, threads=threads, backend_options=options
        ).plan.routes
        for threads in (1, 2, None)
    ]
    assert plans[0] == plans[1] == plans[2]
    other = ct.solve(model, "fleet-search", seed=8, backend_options={"patience": 1, "steps": 5})
    assert other.verified
    assert other.plan.routes != plans[0]


def test_a_warm_start_is_never_made_worse():
    model = scattered(40, 4)
    good = ct.solve(model, "fleet-search", backend_options={"patience": 1, "steps": 500})
    again = ct.solve(
        model, "fleet-search", warm_start=good, backend_options={"patience": 1, "steps": 1}
    )
    assert again.primal_bound <= good.primal_bound


@pytest.mark.parametrize(
    "limits",
    [
        {"demands": [0, *[1.0] * 12], "capacity": 4.0},
        {"demands": [0, *[1.0] * 12], "capacity": [6.0, 5.0, 1.0]},
        {"battery": [400.0, 250.0, 120.0]},
        {"objective": "sum", "range_limit": 20.0},
        {"objective": "sum", "deviation_limit": 5.0},
        {"objective": "max", "budget": 480.0},
    ],
    ids=lambda limits: list(limits)[-1],
)
def test_limits_are_kept(limits):
    model = scattered(12, 3, seed=5, **limits)
    found = ct.solve(model, "fleet-search", backend_options={"steps": 500})
    assert found.verified, found
    assert not found.verification.within_tolerance


def test_infeasible_limits_end_without_a_plan():
    model = scattered(8, 2, battery=1.0)
    found = ct.solve(model, "fleet-search")
    assert found.plan is None
    assert found.termination is Termination.NO_SOLUTION
    assert "limits" in found.message


@pytest.mark.parametrize(
    "model",
    [
        FleetRouting(5, points=np.random.default_rng(0).random((6, 2))),  # as many robots as nodes
        FleetRouting(3, points=np.zeros((8, 2))),  # all at one place
        FleetRouting(2, points=[[0, 0], [1, 0], [1e6, 0]]),
        FleetRouting(1, points=[[0, 0], [1, 0]]),
        FleetRouting(2, costs=np.zeros((5, 5))),
        FleetRouting(3, points=np.column_stack([np.arange(9.0), np.zeros(9)])),  # on a line
        FleetRouting(4, points=np.random.default_rng(0).random((9, 2)), use_all=False),
    ],
    ids=["each-one", "one-place", "far", "one-node", "zeros", "line", "not-all"],
)
def test_wild_fleets_are_routed(model):
    steps = {"steps": 200}
    for objective in OBJECTIVES:
        asked = dataclasses.replace(model, objective=objective)
        found = ct.solve(asked, "fleet-search", backend_options=steps)
        assert found.verified, objective


def test_the_farthest_node_proves_that_routes_are_optimal():
    model = FleetRouting(3, points=[[0, 0], [50, 0], [0, 1], [1, 0], [-2, 0]])
    found = ct.solve(model, "fleet-search")
    assert found.termination is Termination.OPTIMAL
    assert found.primal_bound == pytest.approx(100.0)


def test_a_time_limit_is_kept_by_large_fleets():
    model = scattered(600, 5)
    found = ct.solve(model, "fleet-search", time_limit=0.2)
    assert found.verified
    assert found.limit is Limit.TIME
    assert found.seconds["solve"] < 10.0


def test_incumbents_are_reported_and_a_target_stops():
    model = scattered(25, 3)
    seen: list[float] = []
    found = ct.solve(
        model,
        "fleet-search",
        target=1e9,
        on_event=incumbents(lambda one: seen.append(one.objective)),
    )
    assert found.limit is Limit.TARGET
    assert seen
    assert seen == sorted(seen, reverse=True)


def test_auto_selects_the_search_for_large_models():
    assert ct.solve(scattered(40, 3), time_limit=0.3).backend == "fleet-search"
    assert ct.solve(scattered(6, 2)).backend == "subset-dp"


def test_external_plans_have_the_same_objective():
    model = scattered(9, 3, objective="sum-deviation", q=2.0)
    found = ct.solve(model, "fleet-search")
    again = model.verify(FleetPlan(tuple(reversed(found.plan.routes))))
    assert again.objective == pytest.approx(found.primal_bound)


@pytest.mark.parametrize("seed", [0, 1, 3, 5])
def test_no_vehicle_stays_idle_if_nodes_are_at_the_depot(seed):
    places = np.random.default_rng(seed).uniform(-1, 1, (10, 2))
    places[:2] = 0.0
    costs = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    model = FleetRouting(6, costs=costs, depots=[0], objective="sum-variance")
    chosen = {"steps": 50, "patience": 2, "bound": False}
    answer = ct.solve(model, "fleet-search", seed=0, backend_options=chosen)
    assert answer.verified, answer
