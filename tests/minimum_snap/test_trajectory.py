"""The trajectory: its values, integrals, extremes and other forms."""

import json
import math

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from minimum_snap.paths import (
    INF,
    NAN,
    QUICK,
    make,
    trajectories,
)
from numpy.polynomial import polynomial
from scipy.integrate import quad
from scipy.interpolate import PPoly

from crosstrack.errors import InvalidData
from crosstrack.models.minimum_snap import MinimumDerivative
from crosstrack.models.minimum_snap.polynomials import bernstein_matrix, critical_points, horner
from crosstrack.models.minimum_snap.trajectory import Trajectory


def exact(plan, t, derivative):
    """Evaluate by fractions of 50 digits."""
    with mpmath.workdps(50):
        k = min(int(np.searchsorted(plan.times, t, "right")) - 1, plan.segments - 1)
        long = mpmath.mpf(plan.times[k + 1]) - mpmath.mpf(plan.times[k])
        s = (mpmath.mpf(t) - mpmath.mpf(plan.times[k])) / long
        value = []
        for axis in range(plan.dimensions):
            total = mpmath.mpf(0)
            for p in range(derivative, plan.degree + 1):
                total += (
                    mpmath.mpf(plan.coefficients[k, p, axis])
                    * math.perm(p, derivative)
                    * s ** (p - derivative)
                )
            value.append(float(total / long**derivative))
        return np.array(value)  # fmt: skip


@QUICK
@given(plan=trajectories(), share=st.floats(0, 1), derivative=st.integers(0, 11))
def test_values_against_fifty_digits(plan, share, derivative):
    t = float(np.clip(plan.times[0] + share * plan.duration, plan.times[0], plan.times[-1]))
    k = min(int(np.searchsorted(plan.times, t, "right")) - 1, plan.segments - 1)
    size = sum(
        np.abs(plan.coefficients[k, p]).max() * math.perm(p, derivative)
        for p in range(derivative, plan.degree + 1)
    )
    found = plan(t, derivative)
    bound = 1e-11 * size * plan.durations[k] ** -float(derivative)
    assert found.shape == (plan.dimensions,)
    assert np.abs(found - exact(plan, t, derivative)).max() <= bound


@pytest.mark.parametrize("derivative", [0, 1, 2, 5, 7, 8])
def test_one_time_has_the_value_of_many(derivative):
    rng = np.random.default_rng(3)
    knots = np.cumsum(rng.uniform(0.1, 10, 41))
    plan = Trajectory(knots, rng.normal(size=(40, 8, 3)))
    times = np.concatenate([plan.times, rng.uniform(plan.times[0], plan.times[-1], 10_000)])
    many = plan(times, derivative)
    for t, value in zip(times[:300], many, strict=False):
        for one in (float(t), t, np.array(t)):
            assert plan(one, derivative).shape == (3,)
            np.testing.assert_allclose(plan(one, derivative), value, rtol=1e-14, atol=0)


def test_calls_at_knots_outside_and_with_arrays():
    plan = Trajectory([0, 1, 3], [[[0.0], [1]], [[5.0], [2]]])
    assert plan(1).tolist() == [5.0]  # the later segment speaks
    assert plan(3).tolist() == [7.0]
    assert plan([[0, 0.5], [1, 3]]).shape == (2, 2, 1)
    assert plan(np.zeros((0,))).shape == (0, 1)
    assert plan(2, 1).tolist() == [1.0]
    assert plan(2, 2).tolist() == [0.0]
    assert plan(2, 30).tolist() == [0.0]
    assert plan(0.5, np.int64(1)).tolist() == [1.0]
    for t in (-1e-6, 3.00001, NAN, INF, [1, 4]):
        with pytest.raises(InvalidData, match=r"t must lie in \[0, 3\]"):
            plan(t)
    for derivative in (-1, 1.0, True, "1", None):
        with pytest.raises(InvalidData, match="derivative must be"):
            plan(1, derivative)
    begin, end = plan.at_ends(0)
    assert begin.tolist() == [[0], [5]]
    assert end.tolist() == [[1], [7]]


@pytest.mark.parametrize(
    ("times", "coefficients", "field", "words"),
    [
        ([0], np.zeros((0, 2, 1)), "times", "at least 2"),
        ([0, 1], np.zeros((2, 2, 1)), "coefficients", "coefficients has 2 entries where times"),
        ([0, 1], np.zeros((1, 0, 1)), "coefficients", "must not be empty"),
        ([0, 1], np.zeros((1, 2, 0)), "coefficients", "must not be empty"),
        ([0, 1], np.zeros((1, 2)), "coefficients", "shape"),
        ([0, 1], [[[NAN]]], "coefficients", r"coefficients\[0, 0, 0\] must be finite"),
        ([1, 1], [[[0]]], "times", r"times\[1\] must be > times\[0\]"),
        ([0, NAN], [[[0]]], "times", "must be finite"),
    ],
)
def test_bad_trajectories_are_refused(times, coefficients, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        Trajectory(times, coefficients)
    assert caught.value.field == field


@QUICK
@given(plan=trajectories())
def test_round_trips(plan):
    size = np.abs(plan.coefficients).max()
    inner = np.linspace(plan.times[0], plan.times[-1], 37)[:-1]
    near = plan(inner)
    piecewise, spline = plan.to_ppoly(), plan.to_bspline()
    assert isinstance(piecewise, PPoly)
    for other in (piecewise(inner), spline(inner)):
        assert np.allclose(other, near, rtol=0, atol=1e-10 * max(size, 1e-300))
    back = Trajectory.from_ppoly(piecewise)
    assert np.allclose(back.coefficients, plan.coefficients, rtol=1e-12, atol=0)
    control = plan.bezier()
    assert np.array_equal(control[:, 0], plan.coefficients[:, 0])
    assert np.allclose(control[:, -1], plan.at_ends()[1], rtol=0, atol=1e-11 * size)
    again = Trajectory.from_bezier(plan.times, control)
    assert np.allclose(again.coefficients, plan.coefficients, rtol=0, atol=1e-9 * size)
    assert Trajectory.from_data(json.loads(json.dumps(plan.to_data()))).to_data() == plan.to_data()


def test_a_ppoly_is_a_plan():
    model = make(MinimumDerivative, order=1, waypoints=[[0.0], [1], [3]])
    piecewise = PPoly(np.array([[1.0, 1.0], [0.0, 1.0]]), [0.0, 1, 3])
    assert model.verify(model.as_plan(piecewise)).ok
    with pytest.raises(InvalidData, match="2 or 3 dimensions"):
        Trajectory.from_ppoly(PPoly(np.zeros((2, 1, 2, 2)), [0.0, 1]))


@QUICK
@given(plan=trajectories(), derivative=st.integers(0, 10))
def test_integral_of_square_against_quadrature(plan, derivative):
    found = plan.integral_of_square(derivative)
    for axis in range(plan.dimensions):
        total = 0.0
        for k in range(plan.segments):
            own = polynomial.Polynomial(plan.coefficients[k, :, axis]).deriv(derivative)
            long = plan.durations[k]
            total += quad(lambda s, own=own: own(s) ** 2, 0, 1, epsabs=0, limit=200)[0] * long ** (
                1 - 2 * derivative
            )
        assert found[axis] == pytest.approx(total, rel=1e-9, abs=1e-300)


def check_extremes(plan, derivative):
    found = plan.extremes(derivative)
    for k in range(plan.segments):
        inner = np.linspace(0, 1, 801)
        for axis in range(plan.dimensions):
            own = polynomial.Polynomial(plan.coefficients[k, :, axis]).deriv(derivative)
            long = plan.durations[k]
            values = own(inner) * long**-derivative
            size = np.abs(own.coef).sum() * long**-derivative
            slack = 1e-11 * size
            assert found.least[k, axis] <= values.min() + slack
            assert found.largest[k, axis] >= values.max() - slack
            for value, t in (
                (found.least[k, axis], found.least_time[k, axis]),
                (found.largest[k, axis], found.largest_time[k, axis]),
            ):
                s = (t - plan.times[k]) / long
                assert -1e-12 <= s <= 1 + 1e-12
                wiggle = 1e-13 * plan.times[-1] / long * (plan.degree + 1) ** 2
                assert abs(own(s) * long**-derivative - value) <= (1e-11 + wiggle) * size


@settings(max_examples=60, deadline=None)
@given(plan=trajectories(), derivative=st.integers(0, 5))
def test_extremes_against_dense_samples(plan, derivative):
    check_extremes(plan, derivative)


@settings(max_examples=80, deadline=None)
@given(
    low=st.lists(st.floats(-2, 2), min_size=1, max_size=4),
    lead=st.sampled_from([0.0, 1e-300, 1e-17, 1e-15, 1e-13, 1e-12, 1e-11, 1e-9, 1e-6]),
    zeros=st.integers(0, 6),
    scale=st.sampled_from([1e-200, 1e-9, 1.0, 1e9, 1e200]),
)
@example(low=[0.0, 1.0, -1.0], lead=0.0, zeros=0, scale=1.0)
@example(low=[0.1, 0.7, -0.9], lead=0.0, zeros=0, scale=1.0)
@example(low=[0.6, -0.4, 0.5], lead=1e-13, zeros=0, scale=1.0)
def test_extremes_where_the_leading_coefficient_is_zero_or_nearly(low, lead, zeros, scale):
    """A cubic that is a parabola: its vertex must not move by the noise of a missing root."""
    coefficients = np.array([*low, *[0.0] * zeros, lead])[:, None] * scale
    check_extremes(Trajectory([0.0, 1.0], coefficients[None]), 0)


@settings(max_examples=40, deadline=None)
@given(roots=st.lists(st.floats(0, 1), min_size=1, max_size=6), sign=st.sampled_from([-1.0, 1.0]))
def test_critical_points_hit_prescribed_roots(roots, sign):
    """The slope's roots are known, so the extremes are."""
    powers = polynomial.polyint(polynomial.polyfromroots(roots)) * sign
    values = polynomial.polyval(np.array([0.0, 1.0, *roots]), powers)
    s = critical_points(powers[None])
    found = horner(powers[None, :, None], s)[0]
    size = np.abs(powers).sum()
    assert ((s >= 0) & (s <= 1)).all()
    assert abs(found.max() - values.max()) <= 1e-12 * size
    assert abs(found.min() - values.min()) <= 1e-12 * size


@pytest.mark.parametrize("degree", [0, 1, 5, 7, 15])
def test_control_points_of_parts_enclose_the_curve(degree):
    rng = np.random.default_rng(degree)
    pieces = 4
    matrix = bernstein_matrix(degree, pieces).reshape(pieces, degree + 1, degree + 1)
    for row in rng.normal(size=(20, degree + 1)):
        for piece, part in enumerate(matrix):
            control = part @ row
            s = (piece + np.linspace(0, 1, 50)) / pieces
            values = polynomial.polyval(s, row)
            assert control[[0, -1]] == pytest.approx(values[[0, -1]], rel=1e-12, abs=1e-12)
            assert values.min() >= control.min() - 1e-12
            assert values.max() <= control.max() + 1e-12
    np.testing.assert_array_equal(bernstein_matrix(degree), bernstein_matrix(degree, 1))


def test_extremes_along_a_direction():
    plan = Trajectory([0, 2.0], [[[0.0, 0], [1, 1], [0, -1]]])
    found = plan.extremes(0, direction=[[1.0, 1.0]])
    assert found.largest.shape == (1, 1)
    assert found.largest[0, 0] == pytest.approx(1.0)
    assert found.largest_time[0, 0] == pytest.approx(2.0)


def test_sampled():
    plan = Trajectory([1.0, 2.0, 3.05], [[[0.0, 1], [1, 0]], [[1.0, 1], [2, 0]]])
    rows = plan.sampled(10, 2)
    assert rows.shape == (22, 1 + 3 * 2)
    assert rows[0, 0] == 1.0
    assert rows[-1, 0] == 3.05
    assert np.allclose(np.diff(rows[:-1, 0]), 0.1)
    assert np.array_equal(rows[:, 1:3], plan(rows[:, 0]))
    assert np.array_equal(rows[:, 3:5], plan(rows[:, 0], 1))
    assert Trajectory([0, 1.0], [[[0.0]]]).sampled(10).shape == (11, 6)  # ends on a sample
    assert Trajectory([0, 0.3], [[[0.0]]]).sampled(0.1, 0).tolist() == [[0, 0], [0.3, 0]]
    for rate in (0, -1, NAN, INF):
        with pytest.raises(InvalidData, match="rate must be > 0"):
            plan.sampled(rate)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (None, "must be an object"),
        ({}, "'times', 'coefficients' are missing"),
        ({"times": [0, 1]}, "'coefficients' is missing"),
        ({"times": [0, 1], "coefficients": [[[0]]], "degree": 0}, "unknown key 'degree'"),
        ({"times": ["0", 1], "coefficients": [[[0]]]}, r"times\[0\] must be a number"),
    ],
)
def test_bad_plan_data(data, words):
    with pytest.raises(InvalidData, match=words):
        make().plan_from_data(data)


def test_extremes_are_found_where_the_slope_alone_overflows():
    """Its coefficients are floats, those of its slope are beyond: 0 at both ends, large between."""
    plan = Trajectory([0, 1], [[[0.0], [0.0], [1.5e308], [-1.5e308]]])
    with np.errstate(over="ignore", invalid="ignore"):
        found = plan.extremes()
    assert found.largest_time[0, 0] == pytest.approx(2 / 3)
    assert found.largest[0, 0] == pytest.approx(1.5e308 / 27 * 4)
