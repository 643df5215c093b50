"""Free knots: merged, split again, and never to the cost of time."""

from itertools import pairwise

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import TimeAllocation
from crosstrack.solvers.minimum_snap.time_rules import coarsen, runs_of, subdivide

#: A line of 10 m within limits of 2 m/s, 3 m/s² and 20 m/s³.
LIMITS = {"velocity_limit": 2.0, "acceleration_limit": 3.0, "jerk_limit": 20.0}
#: Largest relative excess over a plan with fewer knots: the final share of the barrier.
MORE = 1e-6


def line(free, weight=1e8):
    return TimeAllocation([[0.0], *[[None]] * free, [10.0]], weight, **LIMITS)


def test_runs_end_where_something_is_fixed_or_bounds_change():
    points = [[0, 0], *[[None, None]] * 3, [1, 2], *[[None, None]] * 2, [3, None], [4, 4]]
    assert runs_of(TimeAllocation(points, 1.0)).tolist() == [4, 3, 1]
    upper = np.full((8, 2), 9.0)
    upper[2:] = 8.0
    assert runs_of(TimeAllocation(points, 1.0, corridor_upper=upper)).tolist() == [2, 2, 3, 1]
    walls = {
        "polytope_segments": [5, 6], "polytope_normals": [[1, 0]] * 2, "polytope_offsets": [6, 6],
    }  # fmt: skip
    assert runs_of(TimeAllocation(points, 1.0, **walls)).tolist() == [4, 1, 2, 1]


def test_merged_models_are_equivalent():
    points = [[0, 0], *[[None, None]] * 3, [1, 2], *[[None, None]] * 2, [3, 1]]
    upper = np.repeat([[5.0, 6.0], [7.0, 8.0]], [4, 3], axis=0)
    walls = {
        "polytope_segments": [4, 5, 6], "polytope_normals": [[1, 0]] * 3,
        "polytope_offsets": [6, 6, 6],
    }  # fmt: skip
    model = TimeAllocation(points, 1.0, corridor_upper=upper, **walls)
    found = list(coarsen(model))
    assert [runs.tolist() for runs, _ in found] == [
        [1, 1], [1, 2], [2, 2], [2, 3], [3, 3], [4, 3]
    ]  # fmt: skip
    assert found[-1][1] is model
    for runs, fewer in found:
        assert runs_of(fewer).tolist() == runs.tolist()
        assert fewer.corridor_upper.tolist() == np.repeat(upper[[0, 6]], runs, axis=0).tolist()
        assert fewer.polytope_segments.tolist() == list(range(runs[0], runs.sum()))
        durations = np.linspace(1, 2, runs.sum())
        split = subdivide(durations, runs, np.array([4, 3]))
        ends = np.cumsum(durations)
        assert np.isin(ends.round(12), np.cumsum(split).round(12)).all()


def test_a_loop_is_never_merged_into_one_segment():
    model = TimeAllocation([[0.0], [None], [None], [0.0], [1.0]], 1.0, velocity_limit=1.0)
    with pytest.raises(ct.errors.InvalidData, match="repeats"):
        TimeAllocation([[0.0], [0.0], [1.0]], 1.0)
    assert [runs.tolist() for runs, _ in coarsen(model)] == [[2, 1], [3, 1]]


@pytest.mark.parametrize("weight", [pytest.param(1e2, marks=pytest.mark.slow), 1e8])
def test_more_free_knots_never_cost_time(weight):
    values = [ct.solve(line(free, weight)).primal_bound for free in (0, 2)]
    for fewer, more in pairwise(values):
        assert more <= fewer * (1 + MORE)
    assert values[-1] < 0.75 * values[0]


@pytest.mark.slow
@pytest.mark.parametrize("weight", [1e2, 1e5, 1e8])
def test_up_to_fourteen_free_knots_never_cost_time(weight):
    values = [ct.solve(line(free, weight)) for free in (6, 7, 13, 14)]
    assert all(found.verification.ok for found in values)
    for fewer, more in pairwise(values):
        assert more.primal_bound <= fewer.primal_bound * (1 + MORE)
