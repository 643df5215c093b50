"""Time allocation: the model, and its optima by the descent."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from allocations import LIMITS, POINTS, spline_cost, walk

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import MinimumDerivative, Model, TimeAllocation, Trajectory
from crosstrack.solvers.contract.selection import recommended
from crosstrack.solvers.minimum_snap.time_barrier import Barrier, Spline
from crosstrack.solvers.minimum_snap.time_rules import distance, prepare_start, trapezoid

# -- the model -----------------------------------------------------------------------------------


def test_the_model_is_its_problem_at_given_times_with_the_times_free():
    model = TimeAllocation(POINTS, 100, order=3, **LIMITS, corridor_lower=[-1, -0.5])
    at = model.at([0, 1, 3, 4])
    assert isinstance(at, MinimumDerivative)
    assert at.durations.tolist() == [1, 2, 1]
    for name in ("order", "degree", "continuity"):
        assert getattr(model, name) == getattr(at, name)
    assert np.array_equal(model.start, np.zeros((2, 2)))
    assert np.array_equal(model.corridor_lower, at.corridor_lower)
    assert "minimum jerk" in model.describe()
    assert "velocity limit" in repr(model)
    assert recommended(model).name == "time-gradient"


def test_json_is_exact_and_defaults_written_out_are_the_same_content():
    model = TimeAllocation(
        [[0, 0], [1, None], [3, 2.5]], total_time=7.3, start=[[1, None]], **LIMITS, name="x"
    )
    again = Model.from_json(model.to_json())
    assert isinstance(again, TimeAllocation)
    assert again.digest == model.digest
    assert again.to_json() == model.to_json()
    plain = TimeAllocation(POINTS, 5)
    full = TimeAllocation(POINTS, 5.0, end=np.zeros((3, 2)), degree=7, continuity=3)
    assert plain.digest == full.digest
    assert plain.digest != TimeAllocation(POINTS, 6).digest
    assert plain.digest != TimeAllocation(POINTS, 5, total_time=3).digest


@pytest.mark.parametrize(
    ("data", "field", "says"),
    [
        ({}, "time_weight", "without end"),
        ({"time_weight": 0}, "time_weight", "total_time"),
        ({"time_weight": -1}, "time_weight", "-1"),
        ({"time_weight": float("nan")}, "time_weight", "nan"),
        ({"time_weight": 1, "total_time": 0}, "total_time", "> 0 s, got 0"),
        ({"time_weight": 1, "velocity_limit": -1}, "velocity_limit", r"velocity_limit\[0, 0\]"),
        ({"time_weight": 1, "weights": [1, 2]}, "weights", "order"),
        ({"time_weight": 1, "degree": 5}, "degree", ">= 2 order - 1 = 7, got 5"),
        ({"time_weight": 1, "start": [[9, 0]], "velocity_limit": 2}, "start", "velocity 9"),
        ({"time_weight": 1, "waypoints": [[0, 0]]}, "waypoints", "at least 2 knots, got 1"),
        ({"time_weight": 1, "waypoints": [[0], [1], [1], [2]]}, "waypoints", r"\[2\].*repeats"),
        ({"time_weight": 1, "waypoints": [[0], [math.nan]]}, "waypoints", r"waypoints\[1, 0\]"),
        ({"time_weight": 1, "corridor_upper": 1.5}, "waypoints", "outside the corridor"),
    ],
)
def test_bad_data_is_refused_with_field_index_and_value(data, field, says):
    with pytest.raises(InvalidData, match=says) as caught:
        TimeAllocation(**{"waypoints": POINTS, **data})
    assert caught.value.field == field


def test_a_segment_that_returns_to_its_start_is_refused_only_where_it_could_stand_still():
    TimeAllocation([[0], [0], [1]], 1, start=[[2], [0], [0]])
    TimeAllocation([[0, 0], [None, None], [1, 1]], 1)
    with pytest.raises(InvalidData, match=r"waypoints\[1\] = \[0.0, None\]"):
        TimeAllocation([[0, 0], [0, None], [1, 1]], 1)


def test_verification_recomputes_the_objective_and_checks_the_total():
    model = TimeAllocation(POINTS, 2.0, total_time=6)
    plan = ct.solve(model.at([0, 2, 4, 6])).plan
    found = model.verify(plan)
    assert found.ok
    assert found.objective == pytest.approx(spline_cost(model, [2, 2, 2]) + 2.0 * 6, rel=1e-12)
    assert [c.name for c in found.checks][:2] == ["durations > 0", "total time"]
    late = Trajectory(plan.times + 10, plan.coefficients)
    assert model.verify(late).ok
    assert model.verify(late).objective == pytest.approx(found.objective, rel=1e-12)
    assert model.as_plan(plan.to_ppoly()).durations == pytest.approx([2, 2, 2])
    assert model.as_plan(model.plan_to_data(plan)).times.tolist() == [0, 2, 4, 6]
    wrong = replace(model, total_time=5)
    checks = {c.name: c for c in wrong.verify(plan).violated}
    assert list(checks) == ["total time"]
    assert checks["total time"].worst == pytest.approx(1.0)
    with pytest.raises(InvalidData, match="3 segments, the model 2"):
        TimeAllocation(POINTS[:3], 1).verify(plan)
    with pytest.raises(InvalidData, match="must be a Trajectory"):
        model.verify(None)


# -- optima --------------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [{"order": 2}, {"order": 3}, {}, {"weights": [0.1, 0, 0.5, 1]}])
def test_optimum_satisfies_the_time_identity(more):
    model = TimeAllocation(walk(20), 40.0, **more)
    found = ct.solve(model, "time-gradient", backend_options={"gradient": 1e-10})
    assert found.termination == "locally_optimal"
    assert found.statistics["identity residual"] <= 1e-9
    r = model.order
    shares = [
        (2 * j - 1) * w * found.plan.integral_of_square(j).sum()
        for j, w in enumerate(model.order_weights, start=1)
    ]
    assert 40.0 * found.plan.duration == pytest.approx(sum(shares), rel=1e-9)
    if not more.get("weights"):
        cost = found.primal_bound - 40.0 * found.plan.duration
        assert 40.0 * found.plan.duration == pytest.approx((2 * r - 1) * cost, rel=1e-9)
    assert model.identity_residual(found.plan) <= 1e-9


def test_identity_residual_is_none_if_it_does_not_apply():
    assert TimeAllocation(POINTS, 1, corridor_upper=5).scales
    for more in (LIMITS, {"start": [[1, 0]]}):
        assert not TimeAllocation(POINTS, 1, **more).scales
    found = ct.solve(TimeAllocation(POINTS, 50, **LIMITS))
    assert "identity residual" not in found.statistics


def test_a_corridor_keeps_the_identity():
    model = TimeAllocation(POINTS, 100, corridor_lower=[-0.05, -0.05], corridor_upper=[4.05, 2.05])
    found = ct.solve(model, backend_options={"gradient": 1e-9})
    assert found.termination == "locally_optimal"
    assert found.primal_bound > ct.solve(TimeAllocation(POINTS, 100)).primal_bound * 1.001
    assert found.statistics["identity residual"] <= 1e-6


@pytest.mark.parametrize("order", [2, 3, 4])
def test_no_grid_of_times_is_better(order):
    model = TimeAllocation(POINTS[:3], 30.0, order=order)
    found = ct.solve(model)
    best = min(
        spline_cost(model, pair) + 30.0 * sum(pair)
        for pair in itertools.product(np.geomspace(0.5, 4, 30), repeat=2)
    )
    assert found.primal_bound <= best * (1 + 1e-12)
    assert found.primal_bound == pytest.approx(best, rel=1e-2)


def test_no_grid_of_times_within_limits_is_better():
    model = TimeAllocation(POINTS, 400.0, **LIMITS)
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.verification.ok
    assert not found.verification.within_tolerance
    inner = Barrier(model, np.zeros(1, np.int8))
    inner.unit = found.primal_bound
    best = np.inf
    for durations in itertools.product(
        *[np.linspace(0.6 * t, 1.5 * t, 7) for t in found.plan.durations]
    ):
        inner.mu = 1e-4 * inner.unit / inner.pairs
        value = inner.settle(np.array(durations), 1e-6)
        best = min(best, value.objective + 400.0 * sum(durations))
    assert best >= found.primal_bound
    assert best == pytest.approx(found.primal_bound, rel=0.05)


def test_a_given_total_is_kept_and_shared_best():
    model = TimeAllocation(POINTS, total_time=6.0)
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.plan.duration == pytest.approx(6.0, rel=1e-14)
    shares = [
        (a, b, 6.0 - a - b)
        for a, b in itertools.product(np.linspace(0.5, 4, 40), repeat=2)
        if a + b < 5.5
    ]
    best = min(spline_cost(model, share) for share in shares)
    assert found.primal_bound <= best
    assert found.primal_bound == pytest.approx(best, rel=2e-2)
    # The same total, found where time has the price that makes it the best.
    free = ct.solve(TimeAllocation(POINTS, 7 * found.primal_bound / 6.0))
    assert free.plan.duration == pytest.approx(6.0, rel=1e-7)
    assert free.plan.durations == pytest.approx(found.plan.durations, rel=1e-6)


def test_a_total_so_short_that_the_rules_shares_find_no_path():
    free = ct.solve(TimeAllocation(POINTS, 1e5, **LIMITS))
    model = TimeAllocation(POINTS, total_time=1.01 * free.plan.duration, **LIMITS)
    inner = Barrier(model, np.zeros(1, np.int8))
    for rule in (trapezoid, distance):
        assert prepare_start(model, inner, rule(model)) is None
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.plan.duration == pytest.approx(model.total_time, rel=1e-12)
    short = ct.solve(TimeAllocation(POINTS, total_time=0.5, **LIMITS))
    assert short.termination == "no_solution"
    assert "no proof" in short.message


# -- ends in motion ------------------------------------------------------------------------------


#: One segment whose path is fixed by its duration: it starts at 2 m/s towards a wall at 1.2 m.
TOWARDS_A_WALL = {
    "waypoints": [[0.0], [1.0]],
    "order": 2,
    "start": [[2.0]],
    "corridor_upper": 1.05,
    "acceleration_limit": 12.0,
}


def test_slowing_down_breaks_the_corridor_of_an_end_in_motion():
    model = TimeAllocation(time_weight=1e-3, **TOWARDS_A_WALL)
    free = Spline(_unbounded(model))
    keeps = [t for t in np.linspace(0.2, 4, 381) if model.verify(free.plan(np.array([t]))).ok]
    assert min(keeps) > 0.2
    assert max(keeps) < 2.5, "a longer motion overshoots: uniform stretching would be wrong"
    for weight in (1e-3, 1e3):
        found = ct.solve(TimeAllocation(time_weight=weight, **TOWARDS_A_WALL))
        assert found.termination == "locally_optimal"
        assert found.verification.ok
        assert min(keeps) - 0.01 <= found.plan.duration <= max(keeps) + 0.01
    # J decreases with T, with slope 0 at T = 1.5. With a time weight, one local optimum is at T = 1.5
    # and another one at the wall.
    costs = {t: free.value(np.array([t])).objective + 1e-3 * t for t in keeps}
    near = min(cost for t, cost in costs.items() if t < 1.51)
    assert ct.solve(model).primal_bound == pytest.approx(near, rel=1e-4)
    late = ct.solve(_unbounded(model).at([0, 1.55])).plan
    found = ct.solve(model, warm_start=late)
    assert found.termination == "locally_optimal"
    assert found.primal_bound <= min(costs.values())
    assert found.plan.duration == pytest.approx(max(keeps), abs=0.01)


def _unbounded(model):
    return replace(model, corridor_upper=None, acceleration_limit=None)


def test_ends_in_motion_within_limits():
    model = TimeAllocation(
        POINTS, 50, start=[[1, 0], [0, 0], [0, 0]], end=[[0.5, -1], [0, 0], [0, 0]],
        **LIMITS, corridor_lower=-0.3, corridor_upper=4.3,
    )  # fmt: skip
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.verification.ok
    assert not found.verification.within_tolerance
    assert found.plan(0.0, derivative=1) == pytest.approx([1, 0])
    assert found.plan(found.plan.duration, derivative=1) == pytest.approx([0.5, -1])
