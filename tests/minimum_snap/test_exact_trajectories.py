"""``banded`` against 100 digits of another hand: objective, shape and bound right, or refused."""

import math

import mpmath
import numpy as np
import pytest
from minimum_snap.exact_trajectories import exact_spline
from minimum_snap.splines import only

import crosstrack as ct
from crosstrack.models import FREE, MinimumDerivative, MinimumSnap
from crosstrack.solvers.minimum_snap import direct, hermite


def draw(seed, most):
    """Return a model of one axis: any pattern, durations over a ratio of up to 1e6."""
    rng = np.random.default_rng(seed)
    order, count = int(rng.integers(2, 6)), int(rng.integers(2, most + 1))
    ratio = 10 ** rng.uniform(0, 6)
    durations = {
        0: np.exp(rng.uniform(0, math.log(ratio), count)),
        1: np.where(np.arange(count) % 2, ratio, 1.0),
        2: np.where(np.arange(count) == rng.integers(count), 1.0, ratio),
    }[int(rng.integers(3))] * 10 ** rng.uniform(-3, 3) / ratio**0.5  # fmt: skip
    times = np.concatenate([[0.0], np.cumsum(durations)])
    fixed = rng.random((count + 1, order)) < rng.choice([0.1, 0.3, 0.6])
    kind = rng.integers(3)
    if kind == 0:
        fixed[:] = False
    if kind < 2:
        fixed[:, 0] = True
    if kind == 0 or rng.random() < 0.7:
        fixed[[0, -1]] = True
    values = rng.normal(size=fixed.shape) / durations.mean() ** np.arange(order)
    values[:, 0] = np.cumsum(values[:, 0])
    values[:, 1:] *= rng.random((count + 1, order - 1)) < 0.7
    table = np.where(fixed, values, FREE)[:, :, None]
    open_end = np.zeros((0, 1))
    return MinimumDerivative(
        table[:, 0], times, order=order, derivatives=table[:, 1:], start=open_end, end=open_end
    )


def judge(model):
    """Solve `model`, hold what is claimed against the exact optimum, and return the solution."""
    solution = ct.solve(model, "banded")
    table = np.full((model.segments + 1, model.order), np.inf)
    rows = min(model.order, model.conditions.shape[1])
    table[:, :rows] = model.conditions[:, :rows, 0]
    fixed = np.isfinite(table)
    exact = exact_spline(model.durations, table, fixed, only(model.order))
    if solution.plan is None:
        assert exact is None or "too much" in solution.message or "unique" in solution.message
        return solution
    assert exact is not None
    least, powers = exact
    floor = 1e-15 * model.objective_scale
    assert solution.dual_bound <= least * (1 + mpmath.mpf("1e-13")) + floor
    assert solution.verification.ok
    if solution.termination == "optimal":
        assert solution.primal_bound == pytest.approx(float(least), rel=1e-6, abs=floor)
        wanted = np.array([[float(power) for power in row] for row in powers])
        off = np.abs(solution.plan.coefficients[:, :, 0] - wanted)
        # A position is held to the digits that its own size leaves.
        off[:, 0] = np.maximum(off[:, 0] - 4e-16 * np.abs(wanted[:, 0]), 0.0)
        size = np.abs(wanted[:, 1:]).max(axis=1) + 1e-6 * model.position_scale.max()
        assert (off.max(axis=1) <= 1e-8 * size).all()
    else:
        assert "the shape of segment" in solution.message
    return solution


def test_any_pattern_and_durations():
    found = [str(judge(draw(seed, 7)).termination) for seed in range(60)]
    assert found.count("optimal") >= 40
    assert set(found) <= {"optimal", "rejected", "no_solution"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1010))
def test_any_pattern_of_many_segments(seed):
    judge(draw(seed, 1000))


def test_a_waypoint_missed_by_the_digits_of_a_swing_is_not_forgiven():
    model = MinimumDerivative([[0], [0], [1]], [0, 1e3, 1000.001], order=5)
    found = ct.solve(model)
    assert found.plan is None
    assert "the durations differ too much" in found.message
    assert "waypoints" in found.message


@pytest.mark.parametrize("free", [False, True])
def test_the_bound_of_a_short_segment_between_long_ones(free):
    points = [[0], [0], [None if free else 1], [0.5]]
    found = judge(MinimumSnap(points, [0, 20, 20.05, 40.05]))
    assert found.termination == "optimal"
    assert found.gap <= 1e-9


@pytest.mark.parametrize("order", [4, 5])
def test_a_leap_between_very_long_segments(order):
    times = np.concatenate([[0.0], np.cumsum([1e3, 1e-3, 1e3])])
    found = judge(MinimumDerivative([[0], [1], [2], [0]], times, order=order))
    assert found.termination == "optimal"


@pytest.mark.parametrize("points", [[[1.0], [1], [1], [1]], [[0.0], [1], [5], [6]]])
def test_an_optimum_of_nothing_has_no_gap(points):
    """At rest, and on a straight line at constant speed."""
    speed = [[1.0]] if points[0] != points[1] else [[0.0]]
    model = MinimumSnap(points, [0, 1, 5, 6], start=speed, end=speed)
    found = ct.solve(model)
    assert found.termination == "optimal"
    assert found.gap == 0.0
    assert found.primal_bound <= 1e-20


def test_a_shape_that_is_not_certain_is_named(monkeypatch):
    monkeypatch.setattr(hermite, "CERTIFIED", 1e-20)
    found = ct.solve(MinimumSnap([[0], [1], [2], [0]], [0, 1, 21, 22]), "banded")
    assert found.termination == "feasible"
    assert "the shape of segment " in found.message
    assert found.plan is not None


def test_free_derivatives_that_need_all_digits():
    """Long segments were a third off, which the objective could not see."""
    rng = np.random.default_rng(4)
    count, order = 60, 4
    durations = np.exp(rng.uniform(0.0, math.log(400.0), count))
    fixed = rng.random((count + 1, order)) < 0.2
    fixed[0] = True
    table = np.where(fixed, rng.normal(size=fixed.shape), FREE)[:, :, None]
    times = np.concatenate([[0.0], np.cumsum(durations)])
    open_end = np.zeros((0, 1))
    model = MinimumSnap(table[:, 0], times, derivatives=table[:, 1:], start=open_end, end=open_end)
    assert judge(model).termination == "optimal"
    assert direct.Banded().refuses(model) == ""
