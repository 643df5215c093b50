"""Single-track model, compared with matrix exponentials, quadrature and finite differences."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from crosstrack.jit import Kernel
from crosstrack.models.sideslip import Recording, SideslipEstimation, Vehicle, dynamics
from crosstrack.models.sideslip.dynamics import (
    advance,
    axle_force,
    flow,
    linearise,
    measured,
    parameters,
    rates,
)

Floats = NDArray[np.float64]

VEHICLE = Vehicle(1500.0, 2500.0, 1.2, 1.5, 9e4, 1.1e5)
GRIPPING = dataclasses.replace(VEHICLE, tyre="saturating")
#: Vehicles with parameters that differ by factors up to 1e6.
UNLIKE = [
    dataclasses.replace(VEHICLE, cornering_front=1e3, cornering_rear=1e9),
    dataclasses.replace(VEHICLE, cornering_front=1e9, cornering_rear=1e3),
    dataclasses.replace(VEHICLE, mass=1.0, yaw_inertia=1e6),
    dataclasses.replace(VEHICLE, mass=1e6, yaw_inertia=1.0),
    dataclasses.replace(VEHICLE, front=1e-3, rear=1e3),
]


def matrix(entries: Any) -> Floats:
    return np.array(entries, dtype=float).reshape(2, 2)


# Reference implementation in NumPy


def plain_force(slip: float, stiffness: float, most: float) -> float:
    """Return the force of an axle by Rajamani, Vehicle Dynamics and Control, eq. 13.54."""
    if np.isinf(most):
        return stiffness * slip
    t = np.tan(slip)
    if stiffness * abs(t) >= 3 * most or abs(slip) >= np.pi / 2:
        return float(most * np.sign(slip))
    cubic = stiffness * t
    cubic += -(stiffness**2) / (3 * most) * abs(t) * t + stiffness**3 / (27 * most**2) * t**3
    return float(cubic)


def plain_rates(x: Floats, u: float, delta: float, p: Floats) -> Floats:
    """Return dβ/dt, dω/dt and the lateral acceleration."""
    m, inertia, a, b, front, rear, most_front, most_rear = p[:8]
    v = max(u, 1.0)
    one = plain_force(delta - x[0] - a * x[1] / v, front, most_front)
    two = plain_force(b * x[1] / v - x[0], rear, most_rear)
    return np.array([(one + two) / (m * v) - x[1], (a * one - b * two) / inertia, (one + two) / m])


def differences(function: Any, x: Floats, by: float = 1e-6) -> Floats:
    """Return central differences, shape (…, 2)."""
    steps = by * np.eye(2)
    return np.stack([(function(x + e) - function(x - e)) / (2 * by) for e in steps], axis=-1)


states = st.tuples(st.floats(-0.5, 0.5), st.floats(-3, 3)).map(np.array)
speeds = st.one_of(st.floats(0, 100), st.sampled_from([0.0, 0.5, 1.0, 100.0]))
angles = st.floats(-0.5, 0.5)
vehicles = st.sampled_from(
    [VEHICLE, GRIPPING, dataclasses.replace(GRIPPING, friction=0.1), *UNLIKE]
)


# Forces


@pytest.mark.parametrize("most", [math.inf, 7e3, 1e2, 1e9])
def test_force_is_the_law(most: float) -> None:
    for slip in np.linspace(-1.5, 1.5, 61):
        force, slope = axle_force(slip, 9e4, most)
        assert force == pytest.approx(plain_force(slip, 9e4, most), rel=1e-12, abs=1e-9)
        # Differences are one-sided at the onset of sliding, which is not a grid point.
        by = 1e-8
        two = [plain_force(slip + e, 9e4, most) for e in (-by, by)]
        # Above 85° the tangent is steep, and differences are inaccurate.
        assert slope == pytest.approx((two[1] - two[0]) / (2 * by), rel=1e-4, abs=1e-2)


def test_force_grows_to_its_greatest_and_stays() -> None:
    """Value and derivative are continuous at full sliding. The force keeps its sign beyond 90°."""
    edge = math.atan(3 * 7e3 / 9e4)
    before, after = axle_force(edge * (1 - 1e-9), 9e4, 7e3), axle_force(edge * (1 + 1e-9), 9e4, 7e3)
    assert before == pytest.approx(after, abs=1e-3) and after == (7e3, 0.0)
    for slip in (1.0, math.pi / 2, 2.0, 3.0, 1e300):
        assert axle_force(slip, 9e4, 7e3) == (7e3, 0.0)
        assert axle_force(-slip, 9e4, 7e3) == (-7e3, 0.0)


def test_small_slip_loses_no_digits() -> None:
    assert axle_force(1e-12, 9e4, 7e3)[0] == pytest.approx(9e-8, rel=1e-10)


# Derivatives


@settings(deadline=None)
@given(states, speeds, angles, vehicles)
def test_rates_and_measurement_with_their_derivatives(
    x: Floats, u: float, delta: float, vehicle: Vehicle
) -> None:
    p = parameters(vehicle)
    plain = plain_rates(x, u, delta, p)
    found, value = rates(*x, u, delta, p), measured(*x, u, delta, p)
    size = np.abs(plain).max() + abs(p[4] + p[5]) / p[0]
    np.testing.assert_allclose([*found[:2], value[0]], plain, rtol=1e-9, atol=1e-9 * size)

    # Complex steps do not support the absolute value. The law has a kink in its second derivative.
    slopes = differences(lambda at: plain_rates(at, u, delta, p), x, 1e-5)
    got = np.array([*found[2:], *value[1:]]).reshape(3, 2)
    scale = np.array([[abs(p[4] + p[5]) / p[0]], [(p[2] * p[4] + p[3] * p[5]) / p[1]]])
    scale = np.maximum(scale[[0, 1, 0]] * (1 + p[2] + p[3]), 1.0)
    np.testing.assert_allclose(got / scale, slopes / scale, rtol=1e-3, atol=2e-4)


# Steps


@settings(deadline=None)
@given(
    st.tuples(*[st.floats(-4, 4)] * 4),
    st.sampled_from([1e-12, 1e-6, 1e-3, 1.0, 10.0]),
    st.sampled_from(["any", "equal", "defective", "singular", "turning", "stiff"]),
)
def test_flow_is_the_exponential(entries: tuple[float, ...], size: float, kind: str) -> None:
    a, b, c, d = entries
    made = {
        "any": [[a, b], [c, d]],
        "equal": [[a, 1e-9 * b], [1e-9 * c, a * (1 + 1e-12)]],
        "defective": [[a, b], [0, a]],
        "singular": [[a, b], [2 * a, 2 * b]],
        "turning": [[a, b], [-b, a]],
        "stiff": [[-1e3 * abs(a), b], [c, -abs(d)]],
    }[kind]
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[:2, 2:] = size * np.array(made), np.eye(2)
    want = expm(whole)
    got = flow(*whole[:2, :2].ravel())
    for found, wanted in ((got[:4], want[:2, :2]), (got[4:], want[:2, 2:])):
        np.testing.assert_allclose(matrix(found), wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_flow_over_nothing_and_over_what_is_no_number() -> None:
    assert flow(0.0, 0.0, 0.0, 0.0) == (1, 0, 0, 1, 1, 0, 0, 1)
    for bad in (math.nan, math.inf):
        for place in range(4):
            for other in (0.0, 1.0):
                entries = [bad if k == place else other for k in range(4)]
                assert np.isnan(flow(*entries)).all() and np.isnan(flow.py_func(*entries)).all()
    assert len(flow(1e308, 1e308, 1e308, 1e308)) == 8  # terminates; the values are not checked


@pytest.mark.parametrize("vehicle", [VEHICLE, *UNLIKE])
@pytest.mark.parametrize("u", [0.0, 1.0, 5.0, 22.0, 100.0])
@pytest.mark.parametrize("dt", [1e-6, 0.01, 0.05, 2.0])
def test_step_of_linear_tyres_is_exact(vehicle: Vehicle, u: float, dt: float) -> None:
    p, x, delta = parameters(vehicle), np.array([0.03, -0.2]), 0.04
    at_rest = np.zeros(2)
    jacobian = differences(lambda at: plain_rates(at, u, delta, p)[:2], at_rest, 0.5)
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = jacobian * dt, plain_rates(at_rest, u, delta, p)[:2] * dt
    want = expm(whole)
    found = advance(*x, dt, u, 0.0, delta, 0.0, p)
    if np.abs(want).max() > 1e100:  # an unstable vehicle
        assert np.abs(found).max() > 1e90
        return
    ahead = want[:2, :2] @ x + want[:2, 2]
    for row in range(2):
        size = np.abs(want[row]).max()
        np.testing.assert_allclose(found[row], ahead[row], rtol=1e-9, atol=1e-9 * size)
        np.testing.assert_allclose(
            found[2 + 2 * row : 4 + 2 * row], want[row, :2], rtol=1e-8, atol=1e-9 * size
        )


@pytest.mark.parametrize(("u", "du"), [(22.0, 3.0), (0.5, 4.0), (10.0, -9.5)])
def test_saturating_tyres_in_the_second_order(u: float, du: float) -> None:
    """Speed and steering change during the step, and the tyres begin to slide."""
    p, x, time = parameters(GRIPPING), np.array([0.02, 0.3]), 0.4
    delta, ddelta = 0.02, 0.12

    def slope(t: float, at: Floats) -> Floats:
        return plain_rates(at, u + du * t / time, delta + ddelta * t / time, p)[:2]

    exact = solve_ivp(slope, (0, time), x, rtol=1e-11, atol=1e-12, max_step=0.002).y[:, -1]
    errors = []
    for count in (20, 40, 80):  # steps of at most 0.02 s are not divided
        at = x
        for k in range(count):
            share = k / count
            at = np.array(
                advance(
                    *at,
                    time / count,
                    u + share * du,
                    du / count,
                    delta + share * ddelta,
                    ddelta / count,
                    p,
                )[:2]
            )
        errors.append(float(np.abs(at - exact).max()))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 3.0 and errors[1] / errors[2] > 3.0
    whole = np.array(advance(*x, time, u, du, delta, ddelta, p)[:2])
    assert np.abs(whole - exact).max() == pytest.approx(errors[0], rel=1e-6)


@settings(deadline=None)
@given(states, st.floats(1, 60), angles, st.floats(-0.02, 0.02))
def test_jacobian_of_a_short_step(x: Floats, u: float, delta: float, ddelta: float) -> None:
    """The product of exponentials equals the derivative of the step up to second order in time."""
    p, dt = parameters(GRIPPING), 1e-4
    found = advance(*x, dt, u, 0.0, delta, ddelta, p)
    slopes = differences(
        lambda at: np.array(advance(*at, dt, u, 0.0, delta, ddelta, p)[:2]), x, 1e-5
    )
    np.testing.assert_allclose(matrix(found[2:]), slopes, atol=2e-4)


# Along a drive


def drive(n: int = 40, seed: int = 0) -> Recording:
    rng = np.random.default_rng(seed)
    times = np.cumsum(10 ** rng.uniform(-3, 0.2, n))
    speed = np.where(rng.random(n) < 0.2, 0.0, rng.uniform(0, 60, n))
    speed[0] = 30.0
    noise = rng.normal(size=(3, n))
    return Recording(times, speed, 0.05 * noise[0], 0.1 * noise[1], noise[2])


@pytest.mark.parametrize("vehicle", [VEHICLE, GRIPPING])
def test_linearised_along_a_drive(vehicle: Vehicle) -> None:
    problem = SideslipEstimation(vehicle, drive())
    p, on = parameters(vehicle), problem.recording
    at = np.random.default_rng(1).normal(size=(40, 2)) * [0.02, 0.2]
    model = linearise(problem, at)
    for k in range(40):
        value, *slopes = measured(*at[k], on.speed[k], on.steering[k], p)
        np.testing.assert_allclose(model.slope[k], [[0, 1], slopes])
        np.testing.assert_allclose(
            model.slope[k] @ at[k] + model.level[k], [at[k, 1], value], atol=1e-12
        )
        if k < 39:
            dt, du, dd = (np.diff(one[k : k + 2])[0] for one in (on.times, on.speed, on.steering))
            ahead = advance(*at[k], dt, on.speed[k], du, on.steering[k], dd, p)
            np.testing.assert_allclose(model.step[k], matrix(ahead[2:]))
            np.testing.assert_allclose(
                model.step[k] @ at[k] + model.shift[k], ahead[:2], atol=1e-12
            )


def test_linear_tyres_are_the_same_about_any_state() -> None:
    problem = SideslipEstimation(VEHICLE, drive())
    one, two = linearise(problem, np.zeros((40, 2))), linearise(problem, np.full((40, 2), 0.5))
    for mine, other in zip(one, two, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-11 * np.abs(mine).max())


def test_what_is_no_number_ends() -> None:
    problem = SideslipEstimation(GRIPPING, drive())
    model = linearise(problem, np.full((40, 2), np.nan))
    assert np.isnan(model.shift).all() and np.isnan(model.level[:, 1]).all()


# Properties


@settings(max_examples=50, deadline=None)
@given(states, speeds, angles, st.floats(-0.1, 0.1), vehicles, st.floats(1e-4, 2.0))
def test_left_and_right_are_alike(
    x: Floats, u: float, delta: float, ddelta: float, vehicle: Vehicle, dt: float
) -> None:
    p = parameters(vehicle)
    one = advance(*x, dt, u, 0.0, delta, ddelta, p)
    two = advance(*-x, dt, u, 0.0, -delta, -ddelta, p)
    np.testing.assert_array_equal(one, np.array(two) * [-1, -1, 1, 1, 1, 1])


@settings(max_examples=50, deadline=None)
@given(states, st.floats(0, 60), angles, st.floats(1e-3, 1e3), st.booleans())
def test_mass_cancels(x: Floats, u: float, delta: float, by: float, slides: bool) -> None:
    """A common factor on mass, inertia and stiffness does not change the motion."""
    one = GRIPPING if slides else VEHICLE
    names = "mass", "yaw_inertia", "cornering_front", "cornering_rear"
    two = dataclasses.replace(one, **{name: by * getattr(one, name) for name in names})
    found = [advance(*x, 0.1, u, 1.0, delta, 0.01, parameters(each)) for each in (one, two)]
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-10)


# Kernels


def test_kernels_mean_the_same_interpreted() -> None:
    p, cases = parameters(GRIPPING), np.random.default_rng(0).normal(size=(20, 4))
    calls: list[tuple[Kernel, Any]] = []
    for a, b, c, d in cases:
        calls += [
            (axle_force, (0.2 * a, 9e4, 7e3)),
            (rates, (0.1 * a, b, 10 * abs(c), 0.1 * d, p)),
            (measured, (0.1 * a, b, 10 * abs(c), 0.1 * d, p)),
            (flow, (a, 10 * b, c, d)),
            (advance, (0.1 * a, b, 0.1, 10 * abs(c), 1.0, 0.1 * d, 0.01, p)),
        ]  # fmt: skip
    for loop, given_ in calls:
        np.testing.assert_allclose(
            loop.py_func(*given_), loop.dispatcher(*given_), rtol=1e-13, atol=1e-15
        )


def test_no_step_is_longer_than_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps are counted as calls of the interpreted kernel."""
    count = []
    real = dynamics.rates.py_func
    monkeypatch.setattr(dynamics, "rates", lambda *at: count.append(1) or real(*at))
    for dt, steps in ((1e-9, 1), (0.02, 1), (0.0200001, 2), (0.05, 3), (2.0, 100)):
        count.clear()
        advance.py_func(0.0, 0.0, dt, 20.0, 0.0, 0.0, 0.0, parameters(VEHICLE))
        assert len(count) == steps
