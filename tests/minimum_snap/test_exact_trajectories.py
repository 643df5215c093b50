"""``banded`` on hard durations against an elimination in a hundred digits."""

import math

import numpy as np
import pytest
from minimum_snap import judged

import crosstrack as ct
from crosstrack.models import FREE, MinimumDerivative, MinimumSnap
from crosstrack.solvers.minimum_snap import direct, hermite


def judge(model):
    """Solve `model` with ``banded``, compare the answer with the exact optimum, and return it."""
    solution = ct.solve(model, "banded")
    word, why = judged.judge(model, solution)
    assert word != "WRONG", why
    return solution


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
