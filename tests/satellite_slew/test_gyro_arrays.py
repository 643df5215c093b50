"""Slews with other gyros than the pyramid of four, and with body rates at the ends."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from slews import BETA, FULL, close

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import Model, SatelliteSlew, track
from crosstrack.models.optimal_control.plan import ControlPlan, PhasePlan, Piecewise
from crosstrack.models.satellite_slew.dynamics import SlewMotion, names_of
from crosstrack.models.satellite_slew.gyros import (
    momentum_capacity,
    momentum_direction,
    pyramid_axes,
    singularity_measure,
)
from crosstrack.models.satellite_slew.quaternions import product, rotation_about, rotation_matrix

FIVE = pyramid_axes(5, 54.73)
#: Two rows of three parallel gimbals, as in a roof, with wheels that cancel at the gimbal angle 0.
LEAN = 3**0.5 / 2 * np.array([0.0, 0.6, -0.8])
ROOF = {
    "gimbal_axes": [[0.0, 0.8, 0.6]] * 3 + [[0.0, -0.8, 0.6]] * 3,
    "wheel_axes": [
        *([1.0, 0.0, 0.0], LEAN - [0.5, 0.0, 0.0], -LEAN - [0.5, 0.0, 0.0]),
        *([1.0, 0.0, 0.0], LEAN * [1, 1, -1] - [0.5, 0, 0], LEAN * [1, -1, 1] - [0.5, 0, 0]),
    ],
}
COARSE = {"intervals": 5, "degree": 4}
SLEWS = {
    "five gyros": {"gimbal_axes": FIVE},
    "turning": {"final_rate": [0, 0, 0.004], "final_gimbals": None},
}


def test_a_pyramid_by_its_axes_is_the_pyramid_by_its_angle():
    given, usual = SatelliteSlew(gimbal_axes=pyramid_axes(4, 54.73)), SatelliteSlew()
    rng = np.random.default_rng(1)
    for delta in rng.uniform(-4, 4, (5, 4)):
        close(momentum_direction(delta, given.gyros), momentum_direction(delta, BETA))
        measure = singularity_measure(delta, BETA)
        assert singularity_measure(delta, given.gyros) == pytest.approx(measure, abs=1e-12)
    x, u = rng.normal(size=11), rng.normal(size=4)
    close(SlewMotion.of(given).rate(x, u), SlewMotion.of(usual).rate(x, u))
    assert usual.data().keys() == given.data().keys() - {"gimbal_axes"}


@pytest.mark.parametrize("fields", [{"gimbal_axes": FIVE}, ROOF], ids=["five", "roof of six"])
def test_momentum_is_that_of_wheels_turned_about_any_axes(fields):
    model = SatelliteSlew(**fields)
    rng = np.random.default_rng(2)
    for delta in rng.uniform(-4, 4, (5, model.gyro_count)):
        turned = [
            rotation_matrix(rotation_about(axis, angle)) @ wheel
            for axis, wheel, angle in zip(model.gimbal_axes, model.wheels, delta, strict=True)
        ]
        close(momentum_direction(delta, model.gyros), np.sum(turned, axis=0))


def test_the_capacity_of_six_gyros_is_the_envelope_of_their_momentum():
    gyros = SatelliteSlew(**ROOF).gyros
    rng = np.random.default_rng(3)
    for along in rng.normal(size=(4, 3)):
        along /= np.linalg.norm(along)
        ends = [
            minimize(lambda d, a=along: -a @ momentum_direction(d, gyros), start).fun
            for start in rng.uniform(-np.pi, np.pi, (6, 6))
        ]
        assert momentum_capacity(gyros, along) == pytest.approx(-min(ends), abs=1e-6)


@pytest.mark.parametrize("fields", [{}, {"gimbal_axes": FIVE}, ROOF], ids=["four", "five", "six"])
def test_numpy_and_casadi_write_the_same_equations(fields):
    model = SatelliteSlew(
        inertia=FULL, initial_rate=[0.01, 0.0, -0.02], final_gimbals=None, **fields
    )
    motion, count, rng = SlewMotion.of(model), model.gyro_count, np.random.default_rng(4)
    function = model.lower().definition.phases[0].function
    x, u = rng.normal(size=7 + count), rng.normal(size=count)
    rate, path, _, kept = (np.array(part).ravel() for part in function(0, x, u, []))
    close(rate, motion.rate(x, u))
    close(path, [singularity_measure(x[7:], model.gyros), *motion.torque(x[7:], u)], 1e-9)
    close(kept[1:], motion.total_momentum(x), 1e-9)
    # The reduced problem has the same attitude rate and rates, if the momentum is that of the model.
    sigma, delta = 0.3 * rng.normal(size=3), rng.normal(size=count)
    square = sigma @ sigma
    turn = np.array([1 - square, *(2 * sigma)]) / (1 + square)
    q = product(model.initial_attitude, turn)
    wheels = model.momentum * momentum_direction(delta, model.gyros)
    w = np.linalg.solve(model.inertia, rotation_matrix(q).T @ model.total_momentum - wheels)
    function = model.reduced.definition.phases[0].function
    rate, path, *_ = (np.array(p).ravel() for p in function(0, np.append(sigma, delta), u, []))
    full = np.array(motion.rate(np.concatenate([q, w, delta]), u))
    # σ = v / (1 + c) for the initial attitude (1, 0, 0, 0).
    slope = full[1:4] / (1 + q[0]) - q[1:] * full[0] / (1 + q[0]) ** 2
    close(rate, [*slope, *u])
    close(path[4:], w)


def test_a_slew_from_rate_to_rate_is_that_of_an_independent_integration():
    model = SatelliteSlew.about(
        [1, 2, 0],
        20,
        initial_rate=[0.01, 0, -0.01],
        final_rate=[0, 0.015, 0.005],
        final_gimbals=None,
    )
    best = ct.solve(model, tolerance=1e-3, formulation_options=COARSE, seed=0)
    assert best.termination == "locally_optimal" and best.formulation == "reduced"
    part = best.plan.phases[0]
    inverse = np.linalg.inv(model.inertia)

    def slope(t, y):
        # Rotation matrix instead of a quaternion, and momentum by wheels turned one by one.
        matrix, w, delta = y[:9].reshape(3, 3), y[9:12], y[12:]
        u = part.controls(t)
        h, push = np.zeros(3), np.zeros(3)
        for k in range(4):
            quarter = rotation_matrix(rotation_about([0, 0, 1], k * np.pi / 2))
            axis = quarter @ [np.sin(BETA), 0.0, np.cos(BETA)]
            wheel = rotation_matrix(rotation_about(axis, delta[k])) @ quarter @ [0.0, 1.0, 0.0]
            h += model.momentum * wheel
            push -= model.momentum * u[k] * np.cross(axis, wheel)
        skew = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        turning = inverse @ (push - np.cross(w, model.inertia @ w + h))
        return np.concatenate([(matrix @ skew).ravel(), turning, u])

    y = np.concatenate([np.eye(3).ravel(), model.initial_rate, model.initial_gimbals])
    for begin, end in zip(part.states.knots[:-1], part.states.knots[1:], strict=True):
        y = solve_ivp(slope, (begin, end - 1e-12), y, rtol=1e-6, atol=1e-7).y[:, -1]
    close(y[:9].reshape(3, 3), rotation_matrix(model.final_attitude), 2e-3)
    close(y[9:12], model.final_rate, 2e-4)
    flight = track(model, best, disturbance=(0, 0, 0), tolerance=0.05)
    assert {c.name: c.ok for c in flight.verification.checks}["final body rate"]
    with pytest.raises(InvalidData, match="after must be 0"):
        track(model, best, after=1.0)


@cache
def coarse_optimum(name):
    """Return the slew and its optimum on few nodes."""
    model = SatelliteSlew.about("yaw", 10.0, **SLEWS[name])
    return model, ct.solve(model, tolerance=1e-3, formulation_options=COARSE, seed=0)


@pytest.mark.parametrize("name", SLEWS)
def test_plans_of_the_reduced_program_are_plans_of_the_slew(name):
    model, best = coarse_optimum(name)
    assert best.verification.ok and best.formulation == "reduced"
    assert best.plan.phases[0].state_names == names_of(model.gyro_count)[0]
    written = model.formulate("reduced").fitted(best.plan)
    point = written.encode(best.plan)
    assert written.program.verify(point, tolerance=1e-3).ok
    again = written.decode(point).phases[0]
    times = np.linspace(0, again.end, 50)
    close(again.states(times), best.plan.phases[0].states(times), 1e-3)
    # The costates are those of the same Hamiltonian, which is constant.
    assert best.statistics["hamiltonian_spread"] < 0.2
    assert best.plan.phases[0].costates.size == 7 + model.gyro_count
    assert ct.plot(model, best.plan) is not None
    other = ct.solve(model, "slew-pseudo-inverse") if model.gyro_count == 5 else best
    assert other.verification.ok


def test_the_full_program_has_the_same_optimum():
    model, best = coarse_optimum("turning")
    full = ct.solve(model, formulation="gauss", tolerance=1e-3, seed=0, formulation_options=COARSE)
    assert best.formulation == "reduced"
    assert best.primal_bound == pytest.approx(full.primal_bound, rel=1e-3)


def test_a_better_optimum_than_that_of_the_guess_is_found():
    """The guess leads to 5.525 s."""
    best = ct.solve(ct.load("satellite-slew/skew-30"), tolerance=1e-2)
    assert best.statistics["second look"] == "better"
    assert best.primal_bound < 5.473


def test_limits_are_verified_with_many_gyros_and_moving_ends():
    model = SatelliteSlew(
        final_attitude=[1, 0, 0, 0], gimbal_axes=FIVE, initial_rate=[0, 0, 0.01], final_gimbals=None
    )
    knots, nodes = np.array([0.0, 2.0]), (np.array([-1.0, 1.0]),)
    state = np.concatenate([[1, 0, 0, 0], model.initial_rate, np.zeros(5)])
    states = Piecewise(knots, nodes, (np.tile(state, (2, 1)),))
    controls = Piecewise(knots, nodes, (np.zeros((2, 5)),))
    plan = ControlPlan((PhasePlan("slew", states, controls, *names_of(5)),))
    checks = {check.name: check for check in model.verify(plan).checks}
    assert checks["initial body rates"].ok and not checks["final body rates"].ok
    assert checks["final body rates"].worst == pytest.approx(0.01)
    with pytest.raises(InvalidData, match=r"the plan of a slew has the states .* delta\[3\]"):
        SatelliteSlew().verify(plan)


@pytest.mark.parametrize(
    "fields",
    [{"gimbal_axes": FIVE}, ROOF, {"initial_rate": [0.01, 0, 0], "final_gimbals": None}],
)
def test_json_round_trip_is_exact(fields):
    model = SatelliteSlew(name="a", **fields)
    again = Model.from_json(model.to_json())
    assert again.digest == model.digest and again.to_json() == model.to_json()
    assert (
        model.digest
        != SatelliteSlew(final_gimbals=None if model.final_gimbals is None else 0.0).digest
    )


def test_steering_laws_refuse_moving_ends_by_name():
    model = SatelliteSlew(final_rate=[0, 0.01, 0], final_gimbals=None)
    for law in ("slew-pseudo-inverse", "slew-singularity-robust", "slew-generalised"):
        with pytest.raises(UnsupportedFormulation, match=f"{law} .* does not support final_rate"):
            ct.solve(model, law)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gimbal_axes": FIVE[:2]}, "gimbal_axes must have 3 to 8 rows, one per gyro, got 2"),
        ({"gimbal_axes": 2 * FIVE}, "gimbal_axes must hold unit vectors, got .* in row 0"),
        ({"gimbal_axes": np.eye(3)[:, :2]}, "gimbal_axes must have shape"),
        ({"wheel_axes": FIVE}, "wheel_axes needs gimbal_axes"),
        ({"gimbal_axes": FIVE, "wheel_axes": FIVE}, "wheel_axes must be perpendicular .* row 0"),
        (
            {"gimbal_axes": FIVE, "wheel_axes": FIVE[:3]},
            "wheel_axes has 3 .*gimbal_axes|wheel_axes",
        ),
        ({"gimbal_axes": FIVE, "initial_gimbals": [0] * 4}, "initial_gimbals must have shape"),
        ({"gimbal_axes": FIVE, "rate_weight": [0.1] * 4}, "rate_weight must have shape"),
        ({"initial_rate": [0.2, 0, 0]}, "initial_rate must be within rate_limit, 0.125 rad/s"),
        ({"final_rate": [0, 0.01, 0]}, "would not have final_rate; None leaves them free"),
        (
            {"final_rate": [0.12, 0, 0], "momentum": 5.0, "final_gimbals": None},
            "final_rate needs a momentum of 27.36 N m s in the gyros at the end, which hold at most",
        ),
        (
            {"initial_rate": [0.12, 0, 0], "momentum": 5.0, "final_gimbals": None},
            "initial_rate needs a momentum of 27.36 N m s in the gyros at the end",
        ),
        ({"final_rate": [0, 0]}, "final_rate must have shape"),
    ],
)
def test_bad_data_is_named(change, words):
    with pytest.raises(InvalidData, match=words):
        SatelliteSlew(**change)


@pytest.mark.parametrize(
    ("count", "skew", "words"),
    [(2, 54.73, "count must be >= 3"), (4.5, 54.73, "count must be"), (4, np.nan, "skew must be")],
)
def test_a_pyramid_names_its_bad_arguments(count, skew, words):
    with pytest.raises(InvalidData, match=words):
        pyramid_axes(count, skew)
