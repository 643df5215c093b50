"""The native minimum-derivative solver: laws that any optimum obeys, and the slope by durations."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from minimum_snap.splines import cost_of_jets, only, reference, through_waypoints

from crosstrack.solvers.minimum_snap import banded, hermite
from crosstrack.solvers.minimum_snap.hermite import Outcome

# -- laws -----------------------------------------------------------------------------------------


@st.composite
def paths(draw, most=6):
    """Positions fixed at all knots; at inner knots some derivatives too."""
    order = draw(st.integers(2, 5))
    count = draw(st.integers(1, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    durations, values, fixed = through_waypoints(order, count, 4.0, 2, seed=rng)
    if draw(st.booleans()):
        more = rng.random((count + 1, order)) < 0.2
        values[:, more] = rng.normal(size=(2, int(more.sum())))
        fixed = ~np.isnan(values)
    return durations, values, fixed, only(order), order - 1


LAWS = settings(max_examples=40, deadline=None)


def solve(problem):
    solved = banded.solve_hermite(*problem)
    assert solved.outcome is Outcome.SOLVED
    return solved


@given(paths(), st.floats(-1e3, 1e3))
@LAWS
def test_moving_the_path_changes_nothing(problem, shift):
    durations, values, *rest = problem
    moved = values.copy()
    moved[:, :, 0] += shift
    # Both solvers receive the values after rounding of the sum.
    back = values.copy()
    back[:, :, 0] = moved[:, :, 0] - shift
    one, other = solve((durations, back, *rest)), solve((durations, moved, *rest))
    assert one.objective == pytest.approx(other.objective, rel=1e-9, abs=1e-12)
    difference = one.jets[..., 1:] - other.jets[..., 1:]
    assert np.abs(difference).max() <= 1e-9 * max(np.abs(one.jets[..., 1:]).max(), 1e-3)


@given(paths(), st.floats(0.01, 100.0))
@LAWS
def test_stretching_time_scales_the_objective(problem, factor):
    durations, values, fixed, weights, continuity = problem
    order = len(weights)
    slower = values / factor ** np.arange(order)
    one = solve(problem)
    other = solve((durations * factor, slower, fixed, weights, continuity))
    assert other.objective * factor ** (2 * order - 1) == pytest.approx(one.objective, rel=1e-10)


@given(paths())
@LAWS
def test_backwards_is_the_same(problem):
    durations, values, fixed, weights, continuity = problem
    signs = (-1.0) ** np.arange(len(weights))
    back = solve((durations[::-1], values[:, ::-1] * signs, fixed[:, ::-1], weights, continuity))
    one = solve(problem)
    assert back.objective == pytest.approx(one.objective, rel=1e-10)
    turned = back.jets[:, ::-1, ::-1] * signs
    assert np.abs(turned - one.jets).max() <= 1e-9 * np.abs(one.jets).max()


@given(paths(), st.integers(0, 5), st.floats(0.2, 0.8))
@LAWS
def test_a_waypoint_on_the_optimum_changes_nothing(problem, segment, share):
    durations, values, _, weights, continuity = problem
    segment %= len(durations)
    one = solve(problem)
    powers = hermite.jets_to_coefficients(durations, one.jets)[segment]
    there = np.einsum("p,pa->a", share ** np.arange(len(powers)), powers)
    long = durations[segment]
    split = np.insert(durations, segment, share * long)
    split[segment + 1] = (1.0 - share) * long
    row = np.full((len(values), 1, len(weights)), np.nan)
    row[:, 0, 0] = there
    more = np.concatenate([values[:, : segment + 1], row, values[:, segment + 1 :]], axis=1)
    other = solve((split, more, ~np.isnan(more), weights, continuity))
    assert other.objective == pytest.approx(one.objective, rel=1e-7, abs=1e-12)


@given(paths(), st.randoms(use_true_random=False))
@LAWS
def test_fixing_what_is_optimal_changes_nothing(problem, random):
    durations, values, fixed, weights, continuity = problem
    one = solve(problem)
    knots = np.concatenate([one.jets[:, :, 0], one.jets[:, -1:, 1]], axis=1)
    more = fixed.copy()
    for knot in range(values.shape[1]):
        for i in range(values.shape[2]):
            more[:, knot, i] |= random.random() < 0.3
    other = solve((durations, np.where(more, knots, np.nan), more, weights, continuity))
    assert other.objective == pytest.approx(one.objective, rel=1e-10)
    assert np.abs(other.jets - one.jets).max() <= 1e-8 * np.abs(one.jets).max()


@given(paths(), st.integers(0, 2**32 - 1), st.floats(1e-3, 1.0))
@LAWS
def test_nothing_nearby_is_better(problem, seed, size):
    durations, _, fixed, weights, _ = problem
    one = solve(problem)
    rng = np.random.default_rng(seed)
    step = np.where(fixed, 0.0, size * rng.normal(size=fixed.shape))
    other = one.jets + np.stack([step[:, :-1], step[:, 1:]], axis=2)
    costs = cost_of_jets(durations, other, weights)
    assert (costs >= one.objective * (1 - 1e-13)).all()


def test_axes_with_other_patterns_are_solved_apart():
    durations, values, fixed = through_waypoints(4, 20, axes=4)
    fixed[2, 7, 0] = False
    fixed[3, 3, 1] = True
    values[3, 3, 1] = 0.25
    together = banded.solve_hermite(durations, values, fixed, only(4), 3)
    assert together.factorisations == 3
    for a in range(4):
        own = slice(a, a + 1)
        alone = banded.solve_hermite(durations, values[own], fixed[own], only(4), 3)
        assert alone.objective[0] == pytest.approx(together.objective[a], rel=1e-12)


def test_free_and_equal_entries_cost_nothing():
    values = np.full((1, 6, 3), 7.0)
    values[:, :, 1:] = 0.0
    solved = banded.solve_hermite(np.ones(5), values, values == 7.0, only(3), 2)
    assert solved.outcome is Outcome.SOLVED
    assert solved.objective[0] == 0.0


# -- gradient of durations ------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_duration_gradient(order):
    """Central differences of the optimal value in 50 digits: the envelope theorem."""
    durations, values, fixed = through_waypoints(order, 5, axes=2)
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    apart = hermite.duration_gradient(durations, solved.jets, only(order), per_axis=True)
    summed = hermite.duration_gradient(durations, solved.jets, only(order))
    assert apart.sum(axis=0) == pytest.approx(summed, rel=1e-13)
    with mpmath.workdps(50):
        step = mpmath.mpf(10) ** -15
        for axis in range(2):
            for k in range(5):
                sides = []
                for sign in (1, -1):
                    moved = [mpmath.mpf(float(d)) for d in durations]
                    moved[k] += sign * step
                    sides.append(reference(moved, values[axis], order))
                slope = float((sides[0] - sides[1]) / (2 * step))
                assert apart[axis, k] == pytest.approx(slope, rel=1e-9)


def test_duration_gradient_with_several_weights():
    rng = np.random.default_rng(2)
    weights = np.array([0.3, 0.0, 2.0, 1.0])
    durations = rng.uniform(0.5, 2.0, 6)
    jets = rng.normal(size=(2, 6, 2, 4))
    found = hermite.duration_gradient(durations, jets, weights)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        ahead, behind = (
            cost_of_jets(durations + sign * step, jets, weights).sum() for sign in (1, -1)
        )
        assert found[k] == pytest.approx((ahead - behind) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_from_rest_to_rest_the_gradient_sums_up_to_the_objective(order):
    """Σ T_k dJ/dT_k = (1 - 2r) J, since J scales with T^(1 - 2r)."""
    durations, values, fixed = through_waypoints(order, 50)
    values[:, [0, -1], 1:] = 0.0
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    slope = hermite.duration_gradient(durations, solved.jets, only(order), per_axis=True)
    assert slope @ durations == pytest.approx((1 - 2 * order) * solved.objective, rel=1e-10)
