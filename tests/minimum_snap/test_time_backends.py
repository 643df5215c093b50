"""Time allocation: backends against one another, laws, and the common request."""

import time
from dataclasses import replace

import numpy as np
import pytest
from allocations import LIMITS, POINTS, walk
from hypothesis import given, settings, strategies as st
from listening import incumbents
from simplex import best_times, programmed, spline

import crosstrack as ct
from crosstrack.errors import CrosstrackError, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import TimeAllocation
from crosstrack.solvers.minimum_snap.time_gradient import TimeGradient
from crosstrack.solvers.minimum_snap.time_rules import distance, trapezoid

# -- backends against one another ----------------------------------------------------------------


@pytest.mark.parametrize("more", [{"time_weight": 100}, {"total_time": 6.0, "order": 3}])
def test_a_simplex_over_a_spline_finds_the_same_times(more):
    model = TimeAllocation(POINTS, **more)
    own = ct.solve(model, "time-gradient")
    least, durations = best_times(model, spline)
    assert own.primal_bound <= least * (1 + 1e-9)
    assert least == pytest.approx(own.primal_bound, rel=1e-7)
    assert durations == pytest.approx(own.plan.durations, rel=2e-3)


@pytest.mark.parametrize(
    "more",
    [pytest.param({"velocity_limit": 1.2}, marks=pytest.mark.slow), {"weights": [0, 0.5, 1]}],
)
def test_a_simplex_over_another_solver_finds_the_same_times(more):
    pytest.importorskip("daqp", reason="daqp is not installed")
    model = TimeAllocation(POINTS[:3], 60.0, order=3, **more)
    own = ct.solve(model, "time-gradient")
    least, durations = best_times(model, programmed, accuracy=1e-6, restarts=0)
    assert own.termination == "locally_optimal"
    assert least == pytest.approx(own.primal_bound, rel=1e-6)
    assert own.primal_bound <= least * (1 + 1e-7)
    assert durations == pytest.approx(own.plan.durations, rel=2e-3)


@pytest.mark.parametrize("more", [{}, {"weights": [0.5, 0, 0, 1]}, LIMITS])
def test_every_rule_leads_to_times_better_than_its_own(more):
    model = TimeAllocation(POINTS, 100, **more)
    for name, rule in (("trapezoid", trapezoid), ("distance", distance)):
        found = ct.solve(model, backend_options={"rule": name})
        assert found.termination == "locally_optimal"
        assert found.verification.ok
        start = model.at(model.times(rule(model)))
        kept = ct.solve(start)
        if kept.plan is not None:
            assert found.primal_bound < model.objective(kept.plan)
    with pytest.raises(UnsupportedOption, match="rule"):
        ct.solve(model, backend_options={"rule": "simplex"})


@pytest.mark.parametrize("name", ["time-trapezoid", "time-distance", "time-simplex"])
def test_a_backend_that_is_gone_is_an_unknown_name(name):
    with pytest.raises(CrosstrackError, match=name):
        ct.solve(TimeAllocation(POINTS, 100), name)


def test_the_trapezoid_knows_the_limits():
    model = TimeAllocation([[0], [10], [10.5]], 1, velocity_limit=2, acceleration_limit=1)
    assert trapezoid(model) == pytest.approx([10 / 2 + 2, 2 * np.sqrt(0.5)])
    assert distance(model) == pytest.approx([10, 0.5])


# -- laws ----------------------------------------------------------------------------------------


weights = st.floats(1e-2, 1e4)
seeds = st.integers(0, 50)
PRECISE = {"gradient": 1e-10}


@given(weight=weights, seed=seeds, order=st.sampled_from([2, 3, 4]), factor=st.floats(0.2, 5))
@settings(max_examples=8, deadline=None)
def test_times_grow_as_a_root_of_the_price(weight, seed, order, factor):
    model = TimeAllocation(walk(5, 2, seed), weight, order=order)
    here = ct.solve(model, backend_options=PRECISE)
    there = ct.solve(replace(model, time_weight=weight * factor), backend_options=PRECISE)
    share = factor ** (-1 / (2 * order))
    assert there.plan.durations == pytest.approx(share * here.plan.durations, rel=1e-5)
    assert there.primal_bound == pytest.approx(factor * share * here.primal_bound, rel=1e-9)


@given(seed=seeds, shift=st.floats(-1e3, 1e3), size=st.floats(0.1, 10))
@settings(max_examples=6, deadline=None)
def test_moving_and_enlarging_the_path_with_its_limits(seed, shift, size):
    points = walk(4, 2, seed)
    limits = {"velocity_limit": 1.0, "acceleration_limit": 1.5}
    here = ct.solve(TimeAllocation(points, 5.0, order=3, **limits))
    enlarged = {name: size * value for name, value in limits.items()}
    model = TimeAllocation(size * points + shift, 5.0 * size**2, order=3, **enlarged)
    there = ct.solve(model)
    assert here.termination == there.termination == "locally_optimal"
    assert there.primal_bound == pytest.approx(size**2 * here.primal_bound, rel=2e-5)


@given(seed=seeds, unit=st.floats(0.2, 5))
@settings(max_examples=6, deadline=None)
def test_another_unit_of_time_is_the_same_problem(seed, unit):
    points = walk(4, 2, seed)
    here = ct.solve(TimeAllocation(points, 5.0, order=3, velocity_limit=1.0, jerk_limit=6.0))
    model = TimeAllocation(
        points, 5.0 / unit**6, order=3, velocity_limit=1.0 / unit, jerk_limit=6.0 / unit**3
    )
    there = ct.solve(model)
    assert there.primal_bound == pytest.approx(here.primal_bound / unit**5, rel=2e-5)


# -- the common request --------------------------------------------------------------------------


def test_starts_seeds_and_warm_starts():
    model = TimeAllocation(walk(4), 20.0, **{**LIMITS, "order": 3})
    several = ct.solve(model, "time-gradient", starts=3, seed=0)
    assert [s.termination for s in several.starts] == ["locally_optimal"] * 3
    assert several.primal_bound <= min(s.primal_bound for s in several.starts)
    once, twice = (ct.solve(model, "time-gradient", seed=2) for _ in range(2))
    assert once.plan.times.tolist() == twice.plan.times.tolist()
    assert once.plan.times.tolist() == several.starts[2].plan.times.tolist()
    warm = ct.solve(model, "time-gradient", warm_start=several)
    assert warm.primal_bound == pytest.approx(several.primal_bound, rel=1e-6)


def test_a_run_that_ends_early_is_no_worse_than_its_warm_start():
    model = TimeAllocation(POINTS, 400.0, **LIMITS)
    best = ct.solve(model)
    # One step on the first barrier, which leads away from the limits.
    found = ct.solve(model, warm_start=best, backend_options={"iterations": 1})
    assert found.termination == "feasible"
    assert "warm start" in found.message
    assert found.primal_bound == best.primal_bound
    assert found.plan.times.tolist() == best.plan.times.tolist()
    slow = ct.solve(model.at(1.5 * best.plan.times)).plan
    better = ct.solve(model, warm_start=slow)
    assert better.termination == "locally_optimal"
    assert better.primal_bound == pytest.approx(best.primal_bound, rel=1e-5)


@pytest.mark.parametrize("seed", [1, 3, 4, 6])
def test_a_local_optimum_with_limits_has_a_small_gradient(seed):
    """The predicted decrease alone ended these at gradients of 1e-5 to 7e-5."""
    limits = [{"velocity_limit": 2.5, "acceleration_limit": 4.0}, {"velocity_limit": 1.5}]
    points = walk(12, 2 + seed % 2, seed)
    found = ct.solve(TimeAllocation(points, 10.0 ** (seed % 4), **limits[seed % 3]))
    assert found.termination == "locally_optimal"
    assert found.statistics["gradient"] <= 1e-6


def test_a_limit_keeps_the_incumbent():
    model = TimeAllocation(walk(400), 1000.0, velocity_limit=2.5, acceleration_limit=4)
    ct.solve(TimeAllocation(POINTS, 1, **LIMITS))  # compiled
    heard = []
    begin = time.perf_counter()
    found = ct.solve(model, time_limit=0.3, on_event=incumbents(heard.append))
    assert time.perf_counter() - begin < 8
    assert found.limit == "time"
    assert found.termination in ("feasible", "no_solution")
    if found.termination == "feasible":
        assert found.verification.ok


def test_rejects_unsupported_problems():
    model = TimeAllocation(POINTS, 1, end=np.zeros((4, 2)), degree=9)
    with pytest.raises(UnsupportedFormulation, match="snap"):
        ct.solve(model, "time-gradient")
    assert TimeGradient().refuses(TimeAllocation(POINTS, 1, continuity=2, **LIMITS))
