"""Time allocation as a nonlinear program: by other means the same optima, and exact derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from allocations import LIMITS, POINTS, walk

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models import TimeAllocation

pytest.importorskip("casadi", reason="casadi is not installed")

TRIANGLE = {
    "polytope_segments": [0, 1, 1],
    "polytope_normals": [[-1, 1], [0, 1], [1, 0]],
    "polytope_offsets": [1.2, 2.05, 3.1],
}
FEATURES = {
    "a price": {"time_weight": 100},
    "a total": {"total_time": 6.0, "order": 3},
    "a total within limits": {"total_time": 8.0, "time_weight": 3.0, "order": 3, **LIMITS},
    "limits of three orders": {"time_weight": 400, "order": 3, "jerk_limit": 9.0, **LIMITS},
    "a corridor": {"time_weight": 100, "corridor_lower": -0.05, "corridor_upper": [4.05, 2.05]},
    "polytopes": {"time_weight": 100, **TRIANGLE},
    "several orders": {"time_weight": 60, "order": 3, "weights": [0, 0.5, 1]},
    "a higher degree": {"time_weight": 60, "order": 3, "degree": 7, "velocity_limit": 1.2},
    "ends in motion": {
        "time_weight": 50, "start": [[1, 0], [0, 0], [0, 0]], "end": [[0.5, -1], [0, None], [0, 0]],
    },
    "a free coordinate": {
        "time_weight": 50, "waypoints": [[0, 0], [1, None], [3, 2], [4, 0]], "velocity_limit": 1.5,
    },
    "far away": {"time_weight": 100, "waypoints": np.add(POINTS, 1e5), "velocity_limit": 1.5},
}  # fmt: skip


def agree(model, tolerance=1e-6):
    """Solve by both means; the objective is the same, and the plan of one fits the other's rows."""
    own, other = ct.solve(model, "time-gradient"), ct.solve(model, "ipopt")
    for found in (own, other):
        assert found.termination == "locally_optimal", found.message
        assert found.verification.ok
    assert other.formulation == "times"
    assert other.primal_bound == pytest.approx(own.primal_bound, rel=tolerance)
    assert ct.verify(model, own.plan, formulation="times").ok
    return own, other


@pytest.mark.parametrize(
    "name",
    [
        "time-allocation/lap-8s",
        pytest.param("time-allocation/walk-20", marks=pytest.mark.slow),
        pytest.param("time-allocation/walk-20-limited", marks=pytest.mark.slow),
    ],
)
def test_the_catalogues_optima_are_the_same(name):
    agree(ct.load(name), 1e-8)


@pytest.mark.parametrize("name", FEATURES)
def test_every_feature_has_the_same_optimum(name):
    own, other = agree(TimeAllocation(**{"waypoints": POINTS, **FEATURES[name]}))
    assert other.plan.durations == pytest.approx(own.plan.durations, rel=1e-2)


@pytest.mark.parametrize(
    "seed",
    [
        3,
        pytest.param(0, marks=pytest.mark.slow),
        pytest.param(1, marks=pytest.mark.slow),
        pytest.param(2, marks=pytest.mark.slow),
    ],
)
def test_random_walks_have_the_same_optimum(seed):
    rng = np.random.default_rng(seed)
    order = int(rng.integers(2, 5))
    points = walk(int(rng.integers(3, 7)), int(rng.integers(1, 4)), seed)
    free = TimeAllocation(points, float(10 ** rng.uniform(0, 3)), order=order)
    own, _ = agree(free, 1e-8)
    peak = own.plan.extremes(1)
    most = max(float(-peak.least.min()), float(peak.largest.max()))
    agree(replace(free, velocity_limit=float(rng.uniform(0.6, 0.9)) * most))


@pytest.mark.parametrize("name", ["a total within limits", "polytopes", "a higher degree"])
def test_derivatives_are_those_of_automatic_differentiation(name):
    model = TimeAllocation(**{"waypoints": POINTS, **FEATURES[name]})
    program = model.formulate("times").program
    plain = replace(program, derivatives=None, hessian=None)
    rng = np.random.default_rng(1)
    point = program.guess + 0.1 * program.column_scale * rng.standard_normal(program.size)
    duals = rng.standard_normal(program.row_count)
    for mine, theirs in zip(program.first_order(point), plain.first_order(point), strict=True):
        assert np.array(mine) == pytest.approx(np.array(theirs), rel=1e-9, abs=1e-9)
    mine, theirs = (np.array(p.second_order(point, 0.7, duals)) for p in (program, plain))
    assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-9 * np.abs(theirs).max())
    assert program.second_order.nnz_out(0) < theirs.size / 2


def test_a_plan_is_its_columns():
    model = TimeAllocation(**{"waypoints": POINTS, **FEATURES["a higher degree"]})
    written = model.formulate("times")
    plan = ct.solve(model).plan
    point = written.encode(plan)
    again = written.decode(point)
    assert again.durations == pytest.approx(plan.durations, rel=1e-14)
    assert again.coefficients == pytest.approx(plan.coefficients, abs=1e-12)
    assert written.program.objective(point) == pytest.approx(model.objective(plan), rel=1e-12)
    program = written.program
    start = program.verify(program.guess)
    assert start.ok, "from rest to rest and within limits, the guess keeps them"


@pytest.mark.parametrize("data", [{"time_weight": 1.0}, {"total_time": 7.0, "velocity_limit": 9.0}])
def test_guess_is_the_smoothest_path_at_its_times(data):
    model = TimeAllocation(POINTS, **data)
    guess = model.formulate("times").guess
    times = np.linspace(0, guess.duration, 20)
    assert np.allclose(guess(times), ct.solve(model.at(guess.times)).plan(times), atol=1e-9)


def test_refinement_adds_violated_instants():
    free = TimeAllocation(POINTS, 100, order=3)
    path = ct.solve(free).plan
    model = replace(free, velocity_limit=0.8 * np.abs(path.extremes(1).largest).max())
    coarse = model.formulate("times", samples=2)
    finer = coarse.refined(coarse.encode(path), 1e-6)
    assert finer.program.row_count > coarse.program.row_count
    assert finer.rounds == 1
    # The refined program starts from the previous solution.
    assert finer.program.guess == pytest.approx(coarse.encode(path), rel=1e-12, abs=1e-12)
    assert not finer.program.verify(finer.encode(path)).ok
    found = ct.solve(model, "ipopt", formulation_options={"samples": 2})
    assert found.statistics["refinements"] >= 1
    assert found.verification.ok
    settled = ct.solve(model).plan
    assert coarse.refined(coarse.encode(settled), 1e-6) is None


def test_lower_continuity_within_limits_is_covered_here_alone():
    model = TimeAllocation(POINTS, 60, order=3, continuity=1, velocity_limit=1.2)
    with pytest.raises(UnsupportedFormulation, match="continuity 1"):
        ct.solve(model, "time-gradient")
    loose, smooth = (ct.solve(m, "ipopt") for m in (model, replace(model, continuity=2)))
    assert loose.verification.ok
    assert loose.primal_bound < smooth.primal_bound


def test_rejects_unsupported_problems():
    for more in ({"continuity": 4}, {"end": np.zeros((4, 2)), "degree": 9}):
        with pytest.raises(UnsupportedFormulation, match=r"continuity 4|derivative 4"):
            TimeAllocation(POINTS, 1, **more).formulate("times")
    with pytest.raises(UnsupportedOption, match="samples"):
        TimeAllocation(POINTS, 1).formulate("times", samples=1)


@pytest.mark.parametrize("limit", [None, 0.9])
def test_a_single_segment_is_timed(limit):
    """Nothing but its duration is free: the vector of what else is decided has no entries."""
    model = TimeAllocation([[1.0, 2.0], [3.0, 2.0]], 100.0, velocity_limit=limit)
    best = ct.solve(model, "ipopt")
    assert best.verified
    if limit is None:
        assert best.primal_bound == pytest.approx(ct.solve(model, "time-gradient").primal_bound)
