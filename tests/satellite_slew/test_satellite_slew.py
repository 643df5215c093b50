"""The slew of a satellite: geometry, motion, its lowering, its check, steering laws and tracking."""

import itertools
import json
import pickle
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances import entries
from crosstrack.models import ControlPlan, Model, PhasePlan, SatelliteSlew
from crosstrack.models.optimal_control.plan import Piecewise
from crosstrack.models.satellite_slew.dynamics import SlewMotion
from crosstrack.models.satellite_slew.gyros import (
    gimbal_jacobian,
    momentum_direction,
    singularity_measure,
)
from crosstrack.models.satellite_slew.profile import EigenaxisProfile
from crosstrack.models.satellite_slew.quaternions import (
    attitude_error,
    axis_and_angle,
    conjugate,
    product,
    quaternion_rate,
    rotation_about,
    rotation_matrix,
)
from crosstrack.models.satellite_slew.tracking import track
from crosstrack.solvers.satellite_slew.steering import (
    GeneralisedInverse,
    PseudoInverse,
    RobustInverse,
    null_projection,
)

BETA = np.deg2rad(54.73)
FULL = [[228.0, 3.0, -5.0], [3.0, 188.0, 7.0], [-5.0, 7.0, 176.0]]
ENTRIES = [e for e in entries() if e.name.startswith("satellite-slew/")]
LAWS = ("slew-pseudo-inverse", "slew-singularity-robust", "slew-generalised")


def close(have, want, tolerance=1e-12):
    np.testing.assert_allclose(have, want, rtol=0, atol=tolerance)


def random_attitudes(count, seed=0):
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def steered():
    """The paper's slew by the pseudo-inverse."""
    return ct.solve(SatelliteSlew(), "slew-pseudo-inverse")


@pytest.fixture(scope="module")
def reserved():
    """A slew with a tenth in reserve."""
    model = SatelliteSlew(margin=0.1)
    return model, ct.solve(model, "slew-pseudo-inverse").plan


# -- gyros and quaternions ---------------------------------------------------------------------------


def test_momentum_is_that_of_wheels_turned_about_their_gimbals():
    rng = np.random.default_rng(1)
    for delta in rng.uniform(-4, 4, (20, 4)):
        total = np.zeros(3)
        for k in range(4):
            # The first gimbal leans by 90° - β towards x; the others stand a quarter turn further.
            quarter = rotation_matrix(rotation_about([0, 0, 1], k * np.pi / 2))
            gimbal = np.array([np.sin(BETA), 0.0, np.cos(BETA)])
            wheel = rotation_matrix(rotation_about(gimbal, delta[k])) @ np.array([0.0, 1.0, 0.0])
            total += quarter @ wheel
        close(momentum_direction(delta, BETA), total)


def test_jacobian_is_the_derivative_and_the_measure_its_determinant():
    delta = np.random.default_rng(2).uniform(-4, 4, (5, 3, 4))
    jacobian = gimbal_jacobian(delta, BETA)
    assert jacobian.shape == (5, 3, 3, 4)
    step = 1e-6
    for k in range(4):
        off = step * np.eye(4)[k]
        slope = momentum_direction(delta + off, BETA) - momentum_direction(delta - off, BETA)
        close(jacobian[..., k], slope / (2 * step), 1e-9)
    square = jacobian @ np.swapaxes(jacobian, -1, -2)
    close(singularity_measure(delta, BETA), np.linalg.det(square))
    cb, sb = np.cos(BETA), np.sin(BETA)
    assert singularity_measure(np.zeros(4), BETA) == pytest.approx(16 * cb**4 * sb**2)
    # The inner singularity that a turn about roll runs into.
    assert 0 <= singularity_measure([-np.pi / 2, 0, np.pi / 2, 0], BETA) < 1e-30


def test_quaternions_turn_body_into_inertial_components():
    p, q = random_attitudes(6), random_attitudes(6, 1)
    close(rotation_matrix(product(p, q)), rotation_matrix(p) @ rotation_matrix(q))
    close(product(q, conjugate(q)), np.tile([1.0, 0, 0, 0], (6, 1)))
    quarter = rotation_matrix(rotation_about([0, 0, 2], np.pi / 2))
    close(quarter @ [1, 0, 0], [0, 1, 0])
    for one in q:
        axis, angle = axis_and_angle(one)
        assert 0 <= angle <= np.pi
        turned = rotation_about(axis, angle)
        close(turned * np.sign(turned @ one), one * 1.0)
    assert axis_and_angle([-1.0, 0, 0, 0])[1] == 0.0


def test_the_rate_of_q_is_the_printed_one_and_turns_the_body():
    q, w = random_attitudes(4), np.random.default_rng(3).normal(size=(4, 3))
    rate = quaternion_rate(q, w)
    close(rate[:, 0], -0.5 * (w * q[:, 1:]).sum(axis=1))
    close(rate[:, 1:], -0.5 * np.cross(w, q[:, 1:]) + 0.5 * q[:, :1] * w)
    step = 1e-6
    slope = (rotation_matrix(q + step * rate) - rotation_matrix(q - step * rate)) / (2 * step)
    for k in range(4):
        x, y, z = w[k]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        close(slope[k], rotation_matrix(q[k]) @ cross, 1e-9)


def test_error_quaternion_is_half_the_small_angle_and_has_the_plus_sign():
    q = random_attitudes(5)
    close(attitude_error(q, q), np.tile([1.0, 0, 0, 0], (5, 1)))
    close(attitude_error(-q, q), np.tile([1.0, 0, 0, 0], (5, 1)))
    small = rotation_about([0, 1, 0], 2e-3)
    close(attitude_error(product(q, small), q), np.tile(small, (5, 1)))
    p = random_attitudes(5, 1)
    close(attitude_error(p, q)[:, 0], np.abs((p * q).sum(axis=1)))


# -- the motion --------------------------------------------------------------------------------------


def test_printed_equations_conserve_momentum_with_q_from_body_to_inertial():
    model = SatelliteSlew(inertia=FULL, initial_gimbals=[0.3, -0.2, 0.5, 0.1], final_gimbals=None)
    motion = SlewMotion.of(model)

    def rates(t):
        return np.array([np.sin(t), -0.4, 0.7 * np.cos(2 * t), 0.3])

    start = np.concatenate([random_attitudes(1)[0], [0.05, -0.1, 0.08], model.initial_gimbals])
    found = solve_ivp(
        lambda t, x: motion.rate(x, rates(t)), (0, 6), start, "DOP853", rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    states = found.y.T
    momenta = motion.total_momentum(states)
    assert np.abs(momenta - momenta[0]).max() < 1e-7
    assert np.abs((states[:, :4] ** 2).sum(axis=1) - 1).max() < 1e-9
    # Turned the other way it is no constant: the convention is the one documented.
    wrong = np.einsum(
        "nji,nj->ni",
        rotation_matrix(states[:, :4]),
        motion.body_momentum(states[:, 4:7], states[:, 7:]),
    )
    assert np.abs(wrong - wrong[0]).max() > 1.0


def test_numpy_and_casadi_write_the_same_equations():
    model = SatelliteSlew(inertia=FULL, pyramid_angle=50.0, rate_weight=[0.1, 0.2, 0.3, 0.4])
    motion = SlewMotion.of(model)
    function = model.lower().definition.phases[0].function
    rng = np.random.default_rng(4)
    for _ in range(5):
        x, u = rng.normal(size=11), rng.normal(size=4)
        rate, path, integrand, kept = (np.array(part).ravel() for part in function(0, x, u, []))
        close(rate, motion.rate(x, u))
        close(path[0], singularity_measure(x[7:], model.beta))
        close(path[1:], motion.torque(x[7:], u))
        close(integrand, 1 + model.rate_weight @ u**2)
        close(kept[0], x[:4] @ x[:4])
        close(kept[1:], motion.total_momentum(x), 1e-9)


def test_outer_torque_enters_in_body_axes():
    motion = SlewMotion.of(SatelliteSlew(inertia=FULL))
    x, u = np.zeros(11), np.zeros(4)
    x[0] = 1.0
    close(motion.rate(x, u, [1.0, 2.0, 3.0])[4:7], np.linalg.solve(FULL, [1.0, 2.0, 3.0]))


# -- the problem it is a case of ---------------------------------------------------------------------


def conserved_slopes(model, x):
    """Derivatives of the length of q and of the total momentum by the state, shape (4, 11)."""
    motion, step = SlewMotion.of(model), 1e-6

    def values(y):
        return np.append(motion.total_momentum(y) / 100, y[:4] @ y[:4])

    columns = [
        (values(x + step * unit) - values(x - step * unit)) / (2 * step) for unit in np.eye(11)
    ]
    return np.array(columns).T


@pytest.mark.parametrize(
    ("axis", "angle"), [("roll", 45), ("roll", 180), ("yaw", 120), ([1, 2, 3], 70)]
)
@pytest.mark.parametrize("free", [False, True])
def test_conditions_at_the_end_are_independent_and_imply_the_rest(axis, angle, free):
    model = SatelliteSlew.about(axis, angle, **({"final_gimbals": None} if free else {}))
    phase = model.lower().definition.phases[0]
    low, high = phase.stacked("states", "final_lower"), phase.stacked("states", "final_upper")
    fixed = np.flatnonzero(low == high)
    end = np.concatenate([model.target, np.zeros(7)])
    close(low[fixed], end[fixed])
    assert (low <= end).all() and (end <= high).all()
    # Momentum and length hold anyway: with them, the fixed entries are independent.
    rows = np.vstack([conserved_slopes(model, end), np.eye(11)[fixed]])
    assert fixed.size == (6 if free else 7)
    if free:
        # The rates are fixed, the gimbals free to move within the null space: one direction is left.
        assert np.linalg.matrix_rank(rows, tol=1e-5) == 10
        return
    assert np.linalg.matrix_rank(rows, tol=1e-5) == 11
    # Any further condition depends on these.
    everything = np.vstack([conserved_slopes(model, end), np.eye(11)])
    assert np.linalg.matrix_rank(everything, tol=1e-5) == 11


def test_lowered_problem_is_kept_named_and_travels():
    model = SatelliteSlew(name="mine", margin=0.1)
    problem = model.lower()
    assert problem is model.lower()
    assert problem.name == "mine"
    assert problem.objective_unit == model.objective_unit == "s"
    again = pickle.loads(pickle.dumps(model))
    assert again.digest == model.digest
    assert again.lower().digest == problem.digest
    phase = problem.definition.phases[0]
    assert [r.name for r in phase.paths] == ["singularity measure", "control torque"]
    close(phase.paths[1].upper, [22.5] * 3)
    close(phase.controls[0].upper, [0.9] * 4)
    close(phase.states[1].upper, [0.125] * 3)  # the rates are no actuator's
    assert phase.guess.states.shape[1] == 11
    measures = singularity_measure(phase.guess.states[:, 7:], model.beta)
    assert measures.min() > 0.2
    assert SatelliteSlew(time_range=(9, 9)).lower().definition.phases[0].end_lower == 9


def test_guess_goes_from_end_to_end():
    model = SatelliteSlew.about([1, -2, 1], 100)
    guess = model.lower().definition.phases[0].guess
    close(guess.states[0], [1, *[0] * 10])
    close(guess.states[-1, :4], model.target, 1e-9)
    close((guess.states[:, :4] ** 2).sum(axis=1), np.ones(len(guess.states)))
    # Rates and attitude belong together.
    times = guess.start + guess.fractions * (guess.end - guess.start)
    slope = np.gradient(guess.states[:, :4], times, axis=0)
    rates = quaternion_rate(guess.states[:, :4], guess.states[:, 4:7])
    assert np.abs(slope - rates)[1:-1].max() < 5e-3
    assert SatelliteSlew.about("roll", 0.0).lower().definition.phases[0].guess.end > 1


# -- the data ----------------------------------------------------------------------------------------


def test_defaults_are_the_papers():
    model = SatelliteSlew()
    close(model.inertia, np.diag([228.0, 188, 176]))
    close(model.rate_weight, [0.1] * 4)
    assert model.final_attitude[1] == pytest.approx(0.38268, abs=5e-6)
    assert model.beta == pytest.approx(BETA)
    about = SatelliteSlew.about("roll", 45.0)
    close(about.final_attitude, model.final_attitude)
    close(SatelliteSlew.about([2, 0, 0], -45.0).final_attitude, conjugate(model.final_attitude))
    start = rotation_about([0, 0, 1], 1.0)
    turned = SatelliteSlew.about("pitch", 30, initial_attitude=start)
    axis, angle = turned.turn
    close(axis, [0, 1, 0])
    assert np.rad2deg(angle) == pytest.approx(30)


def test_the_short_way_is_taken():
    model = SatelliteSlew.about("roll", 270.0)
    axis, angle = model.turn
    close(axis, [-1, 0, 0])
    assert np.rad2deg(angle) == pytest.approx(90)
    assert model.target @ model.initial_attitude > 0
    other = replace(model, final_attitude=-model.final_attitude)
    close(other.target, model.target)


@pytest.mark.parametrize(
    "change",
    [{}, {"inertia": FULL}, {"final_gimbals": None, "rate_weight": [0, 1, 2, 3]}, {"margin": 0.25}],
)
def test_json_round_trip_is_exact(change):
    model = SatelliteSlew.about([1, 2, 3], 33.3, name="a", **change)
    again = Model.from_json(model.to_json())
    assert isinstance(again, SatelliteSlew)
    assert again.digest == model.digest
    assert again.to_json() == model.to_json()
    assert json.loads(model.to_json())["data"]["pyramid_angle"] == 54.73


def test_final_gimbals_may_lie_anywhere_on_the_same_momentum():
    # Null motion from zero: gimbals that hold no momentum either.
    s = 0.3
    other = [s, -s, s, -s]
    close(momentum_direction(other, BETA), np.zeros(3))
    assert SatelliteSlew(final_gimbals=other).final_gimbals[0] == s
    # And with a momentum of their own, which stays where it is while the body turns.
    held = SatelliteSlew(initial_gimbals=[0.1, 0.2, 0.3, 0.4], final_gimbals=None)
    close(rotation_matrix(held.final_attitude) @ held.final_momentum, held.total_momentum)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inertia": [228, 188]}, "inertia must be a symmetric matrix of shape .* got shape"),
        ({"inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "inertia must be symmetric"),
        ({"inertia": [1, 1, -1]}, "inertia must be positive definite"),
        ({"inertia": [1, 1, 3]}, "no principal moment of a body exceeds"),
        ({"inertia": ["a", 1, 3]}, "must be a number"),
        ({"final_attitude": [1, 1, 0, 0]}, "final_attitude must be a unit quaternion"),
        ({"initial_attitude": [1, 0, 0]}, "initial_attitude must have shape"),
        ({"margin": 1.0}, "margin must be < 1"),
        ({"margin": -0.1}, "margin must be >= 0"),
        ({"momentum": 0}, "momentum must be > 0 N m s"),
        ({"torque_limit": -1}, "torque_limit must be > 0 N m"),
        ({"time_range": [5, 4]}, "time_range must be"),
        ({"time_range": [0, 0]}, "time_range must be"),
        ({"pyramid_angle": 95}, "pyramid_angle must be <= 90 degrees"),
        ({"rate_weight": [1, 2]}, "rate_weight must have shape"),
        ({"rate_weight": -1}, "must be >= 0"),
        ({"final_gimbals": [0.5, 0, 0, 0]}, "would not be at rest"),
        ({"initial_gimbals": [0.5, 0, 0, 0]}, "would not be at rest"),
        ({"initial_gimbals": [-np.pi / 2, 0, np.pi / 2, 0]}, "initial_gimbals must have det"),
        ({"momentum": float("nan")}, "momentum must be finite"),
        ({"margin": "0.1"}, "margin must be a number"),
    ],
)
def test_bad_data_is_named(change, words):
    with pytest.raises(InvalidData, match=words):
        SatelliteSlew(**change)


def test_bad_turns_are_named():
    with pytest.raises(InvalidData, match="axis must not be zero"):
        SatelliteSlew.about([0, 0, 0], 10)
    with pytest.raises(InvalidData, match="axis must be one of roll, pitch, yaw"):
        SatelliteSlew.about("x", 10)
    with pytest.raises(InvalidData, match="leave it out"):
        SatelliteSlew.about("roll", 10, final_attitude=[1, 0, 0, 0])
    with pytest.raises(InvalidData, match="unknown key 'omega'"):
        SatelliteSlew.from_data({"omega": 1})


# -- the check of a plan -----------------------------------------------------------------------------


def test_a_plan_is_verified_and_travels(steered):
    model = SatelliteSlew()
    found = model.verify(steered.plan)
    assert found.ok
    assert {check.equation for check in found.checks} == {"9", "10", "12"}
    assert len([c for c in found.checks if c.name.startswith(("initial", "final "))]) == 6
    again = model.plan_from_data(json.loads(json.dumps(model.plan_to_data(steered.plan))))
    assert model.verify(again).objective == found.objective
    # The cost by another quadrature.
    times = np.linspace(0, steered.plan.end, 200_001)
    speed = (0.1 * steered.plan["rate"](times) ** 2).sum(axis=1)
    assert found.objective == pytest.approx(np.trapezoid(1 + speed, times), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "violated"),
    [
        ({"rate_limit": 0.07}, {"body rate limit"}),
        ({"gimbal_rate_limit": 0.5}, {"gimbal rate limit"}),
        ({"torque_limit": 5.0}, {"control torque limit"}),
        ({"singularity_limit": 0.6}, {"singularity measure"}),
        ({"time_range": (1.0, 9.0)}, {"start at 0, final time within its range"}),
        ({"time_range": (20.0, 60.0)}, {"start at 0, final time within its range"}),
        ({"margin": 0.3}, {"gimbal rate limit, 30 % in reserve"}),
        ({"final_attitude": rotation_about([1, 0, 0], 0.7)}, {"final attitude"}),
        ({"initial_attitude": rotation_about([1, 0, 0], 0.1)}, {"initial attitude"}),
        ({"final_gimbals": [0.3, -0.3, 0.3, -0.3]}, {"final gimbal angles"}),
        ({"momentum": 17.6}, {"body rates integrated anew", "total momentum"}),
        ({"inertia": [230, 188, 176]}, {"attitude integrated anew", "total momentum"}),
    ],
)
def test_each_violation_is_found(steered, change, violated):
    found = SatelliteSlew(**change).verify(steered.plan)
    assert not found.ok
    assert violated <= {check.name for check in found.violated}


def altered(plan, column, by, *, controls=False):
    """The plan with something added to one state, as a function of the place in the interval."""
    phase = plan.phases[0]
    part = phase.controls if controls else phase.states
    values = []
    for nodes, table in zip(part.nodes, part.values, strict=True):
        table = table.copy()
        table[:, column] += by(nodes)
        values.append(table)
    new = Piecewise(part.knots, part.nodes, tuple(values), part.lower, part.upper)
    states, rates = (phase.states, new) if controls else (new, phase.controls)
    return ControlPlan(
        (PhasePlan(phase.name, states, rates, phase.state_names, phase.control_names),)
    )


def test_states_that_do_not_follow_from_the_controls_are_found(steered):
    model = SatelliteSlew()
    off = altered(steered.plan, 5, lambda nodes: 1e-4 * (1 - nodes**2))
    names = {check.name for check in model.verify(off).violated}
    assert names == {"body rates integrated anew", "total momentum"}
    longer = altered(steered.plan, 0, lambda nodes: 1e-4 * (1 - nodes**2))
    names = {check.name for check in model.verify(longer).violated}
    assert {"norm of the quaternion", "attitude integrated anew"} <= names
    pushed = altered(steered.plan, 3, lambda nodes: 0.01 + 0 * nodes, controls=True)
    names = {check.name for check in model.verify(pushed).violated}
    assert "gimbal angles integrated anew" in names
    # What breaks the bounds between the nodes only is seen too.
    assert model.verify(off, tolerance=1e-2).ok


def test_the_other_sign_of_the_quaternion_is_the_same_attitude(steered):
    phase = steered.plan.phases[0]
    flip = np.array([-1.0] * 4 + [1.0] * 7)
    states = Piecewise(
        phase.states.knots, phase.states.nodes, tuple(flip * v for v in phase.states.values)
    )
    turned = ControlPlan((replace(phase, states=states),))
    assert SatelliteSlew().verify(turned).ok


def test_what_is_no_plan_of_a_slew_raises(steered):
    model = SatelliteSlew()
    with pytest.raises(InvalidData, match="must be a ControlPlan"):
        model.verify(3)
    phase = steered.plan.phases[0]
    with pytest.raises(InvalidData, match="has 1 phase, got 2"):
        model.verify(ControlPlan((phase, phase)))
    named = replace(phase, control_names=tuple("abcd"))
    with pytest.raises(InvalidData, match="has the controls rate"):
        model.verify(ControlPlan((named,)))


# -- the eigenaxis profile and the steering laws -----------------------------------------------------


@pytest.mark.parametrize(("peak", "push"), [(0.1, 0.05), (1.0, 0.05), (0.02, 0.1)])
def test_profile_is_a_trapezoid_or_a_triangle(peak, push):
    final = rotation_about([1, 2, 2], 1.2)
    profile = EigenaxisProfile.between([1, 0, 0, 0], final, peak, push)
    assert profile.angle == pytest.approx(1.2)
    assert profile.reached <= peak * (1 + 1e-12)
    times = np.linspace(0, profile.duration, 20_001)
    angle, speed, push_at = profile.turned(times)
    assert angle[0] == 0 and angle[-1] == pytest.approx(1.2)
    assert speed.max() <= profile.reached * (1 + 1e-12)
    assert set(np.round(push_at, 9)) <= {-push, 0.0, push}
    close(np.gradient(angle, times)[1:-1], speed[1:-1], 2e-4)
    attitude, rates, _ = profile.course(profile.duration + 1.0)
    close(attitude, final)
    close(rates, np.zeros(3))
    standing = EigenaxisProfile.between(final, final, peak, push)
    assert standing.duration == 0.0
    assert standing.breaks.tolist() == [0.0]


def test_steering_laws():
    rng = np.random.default_rng(6)
    delta, wanted = rng.uniform(-1, 1, 4), rng.normal(size=3)
    jacobian = gimbal_jacobian(delta, BETA)
    exact = PseudoInverse().rates(0.0, jacobian, wanted)
    close(exact, np.linalg.pinv(jacobian) @ wanted, 1e-9)
    singular = gimbal_jacobian([-np.pi / 2, 0, np.pi / 2, 0], BETA)
    locked = np.array([1.0, 0.0, 0.0])  # no gimbal gives torque about roll there
    close(singular.T @ locked, np.zeros(4), 1e-12)
    robust = RobustInverse(0.01, 10.0)
    assert np.abs(robust.rates(0.0, singular, locked)).max() < 1e-9
    general = GeneralisedInverse(0.01, 10.0, 0.1, np.pi / 2)
    assert np.abs(general.rates(1.0, singular, locked)).max() > 1e-2
    for law in (robust, general):
        assert np.abs(law.rates(0.3, singular, wanted)).max() < 1e3
        close(law.rates(0.0, gimbal_jacobian(np.zeros(4), BETA), wanted),
              PseudoInverse().rates(0.0, gimbal_jacobian(np.zeros(4), BETA), wanted), 1e-5)  # fmt: skip
    moved = null_projection(jacobian, rng.normal(size=4))
    assert np.abs(moved).max() > 1e-3
    close(jacobian @ moved, np.zeros(3), 1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_each_law_flies_the_papers_slew_when_it_may_choose_the_pace(law, steered):
    found = steered if law == LAWS[0] else ct.solve(SatelliteSlew(), law)
    assert found.termination == "feasible"
    assert found.verification.ok
    assert 11.8 < found.plan.end < 13.5
    # Dearer than the optimum by far, and away from singularities.
    assert found.primal_bound > 8.652909 * 1.3
    assert found.statistics["least singularity measure"] >= 0.2


@pytest.mark.parametrize("law", LAWS)
def test_at_full_rate_the_gyros_get_singular_and_the_plan_is_rejected(law):
    model = SatelliteSlew(time_range=(1.0, 20.0))
    found = ct.solve(model, law, backend_options={"peak_rate": 1.0})
    assert found.termination == "rejected"
    assert found.plan is None
    assert "singularity measure" in {check.name for check in found.verification.violated}
    assert found.statistics["least singularity measure"] < 0.02


def test_gimbals_are_brought_home_and_elsewhere():
    there = [0.3, -0.3, 0.3, -0.3]
    model = SatelliteSlew.about([1, 1, 1], 30.0, final_gimbals=there)
    pace = {"peak_rate": 0.4, "acceleration": 0.3}
    found = ct.solve(model, LAWS[0], backend_options=pace)
    assert found.verification.ok
    close(found.plan["delta"](found.plan.end), there, 1e-6)
    free = ct.solve(replace(model, final_gimbals=None), LAWS[0], backend_options=pace)
    assert free.plan.end < found.plan.end


def test_gyros_that_hold_momentum_from_the_start():
    model = SatelliteSlew.about(
        "yaw", 20.0, initial_gimbals=[0.1, 0.0, 0.1, 0.0], final_gimbals=None
    )
    assert np.linalg.norm(model.total_momentum) > 1.0
    found = ct.solve(model, "slew-generalised")
    assert found.verification.ok


def test_least_time_and_standing_still():
    slow = SatelliteSlew.about("yaw", 10.0, time_range=(12.0, 20.0))
    found = ct.solve(slow, "slew-pseudo-inverse")
    assert found.verification.ok
    assert found.plan.end == pytest.approx(12.0)
    still = ct.solve(SatelliteSlew.about("yaw", 0.0), "slew-pseudo-inverse")
    assert still.verification.ok
    assert still.primal_bound == pytest.approx(1.0)


def test_too_little_torque_for_the_time_is_rejected():
    found = ct.solve(ct.load("satellite-slew/infeasible"), "slew-pseudo-inverse")
    assert found.termination == "rejected"
    assert "has not settled within the time range" in found.message


def test_options_are_checked_and_a_search_stops():
    with pytest.raises(UnsupportedOption, match="peak_rate"):
        ct.solve(SatelliteSlew(), LAWS[0], backend_options={"peak_rate": 2.0})
    with pytest.raises(UnsupportedOption, match="damping"):
        ct.solve(SatelliteSlew(), LAWS[0], backend_options={"damping": 1.0})
    begin = time.perf_counter()
    found = ct.solve(SatelliteSlew(), LAWS[1], time_limit=0.2, isolate=False)
    assert found.limit == "time"
    assert found.termination == "no_solution"
    assert time.perf_counter() - begin < 5
    assert threading.active_count() < 20


# -- by nonlinear programming ------------------------------------------------------------------------


def test_the_optimum_is_better_than_every_law_and_verified():
    model = SatelliteSlew.about("pitch", 45.0)
    best = ct.solve(model, "ipopt", tolerance=1e-3)
    assert best.termination == "locally_optimal"
    assert best.verification.ok
    assert best.primal_bound == pytest.approx(8.0770, rel=1e-3)
    steered = ct.solve(model, "slew-pseudo-inverse")
    assert steered.primal_bound > best.primal_bound


@pytest.mark.slow
def test_the_papers_slew():
    model = ct.load("satellite-slew/paper")
    best = ct.solve(model, tolerance=1e-5)
    assert best.backend == "ipopt"
    assert best.verification.ok
    wanted = ct.instances.entry("satellite-slew/paper").published["objective"]
    assert best.primal_bound == pytest.approx(wanted, rel=1e-5)
    assert best.plan.end == pytest.approx(7.8258, abs=1e-3)
    # A tenth in reserve costs 2.2 % of time, and pays: disturbances from anywhere are tracked
    # within the paper's figures, which at the limits they are not.
    model = ct.load("satellite-slew/margin-10")
    reserved = ct.solve(model, tolerance=1e-5)
    assert reserved.plan.end / best.plan.end == pytest.approx(1.022, abs=1e-3)
    for torque in itertools.product((-0.1, 0.1), repeat=3):
        found = track(model, reserved, disturbance=torque)
        assert found.max_quaternion_error < 4e-4
        assert found.max_rate_error < 1e-3
    assert track(SatelliteSlew(), best, disturbance=(-0.1, 0, 0)).max_rate_error > 1e-3


# -- tracking ----------------------------------------------------------------------------------------


def test_without_disturbance_the_plan_is_followed(reserved):
    model, plan = reserved
    found = track(model, plan, disturbance=(0, 0, 0))
    assert found.max_quaternion_error < 1e-6
    assert found.max_rate_error < 1e-5
    assert not found.saturated.any()
    n = found.times.size
    assert found.quaternion_errors.shape == (n, 4)
    assert found.gimbal_rates.shape == (n - 1, 4)
    assert found.times[-1] == plan.end
    close((found.attitudes**2).sum(axis=1), np.ones(n), 1e-7)
    # The gyros give what is asked for, on the whole.
    assert np.abs(found.commanded - found.applied).max() < 0.05
    assert found.measures.min() > 0.2


def test_papers_figures_are_kept_with_a_reserve(reserved):
    model, plan = reserved
    found = track(model, plan, disturbance=(0.1, 0.1, 0.1))
    assert found.max_quaternion_error < 4e-4
    assert found.max_rate_error < 1e-3
    # An unknown constant torque leaves q_e = T / (2 ω² I).
    late = track(model, plan, disturbance=(0.1, 0.1, 0.1), after=10.0)
    rest = 0.1 / (2 * 2.0**2 * np.diag(model.inertia))
    close(late.quaternion_errors[-1, 1:], rest, 1e-6)
    known = track(model, plan, disturbance=(0.1, 0.1, 0.1), known_disturbance=1.0)
    assert known.max_quaternion_error < 0.1 * found.max_quaternion_error
    assert "quaternion error" in str(found)


def test_errors_grow_with_what_disturbs(reserved):
    model, plan = reserved
    worst = [
        track(model, plan, disturbance=(size, 0, 0)).max_quaternion_error for size in (0.1, 0.4)
    ]
    assert worst[1] == pytest.approx(4 * worst[0], rel=0.1)
    shares = [
        track(model, plan, disturbance=(0, 0, 0), inertia_error=share).max_quaternion_error
        for share in (0.005, 0.01)
    ]
    assert 1e-5 < shares[0] < shares[1]
    stiff = track(model, plan, natural_frequency=4.0).max_quaternion_error
    soft = track(model, plan, natural_frequency=1.0).max_quaternion_error
    assert stiff < 0.2 * soft
    waves = track(model, plan, disturbance=lambda t: [0.1 * np.sin(t), 0.0, 0.0])
    assert 0 < waves.max_quaternion_error < worst[0]


def test_a_plan_beyond_the_limits_saturates(steered):
    roomy = track(SatelliteSlew(), steered)
    assert not roomy.saturated.any()
    tight = track(SatelliteSlew(gimbal_rate_limit=0.8), steered)
    assert 0 < tight.saturated_share < 0.5
    assert tight.max_rate_error > 2 * roomy.max_rate_error
    assert np.abs(tight.gimbal_rates).max() == 0.8
    weak = track(SatelliteSlew(torque_limit=8.0), steered)
    assert weak.saturated.any()
    assert np.abs(weak.applied).max() < 8.5


def test_bad_parameters_of_tracking_are_named(reserved):
    model, plan = reserved
    for change, words in (
        ({"sample_time": 0}, "sample_time must be > 0"),
        ({"natural_frequency": -1}, "natural_frequency must be > 0"),
        ({"disturbance": (1, 2)}, "disturbance must have shape"),
        ({"disturbance": lambda t: [1]}, "disturbance must return 3 finite numbers"),
        ({"known_disturbance": 2}, "known_disturbance must be <= 1"),
        ({"inertia_error": -1.0}, "inertia_error must be > -1"),
        ({"after": -1.0}, "after must be >= 0"),
    ):
        with pytest.raises(InvalidData, match=words):
            track(model, plan, **change)


# -- the catalogue -----------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_instances_build_and_travel(entry):
    model = entry.build()
    assert isinstance(model, SatelliteSlew)
    assert model.name == entry.name
    assert Model.from_json(model.to_json()).digest == model.digest
    assert model.lower().name == entry.name
    assert entry.note and entry.title


def test_the_infeasible_instance_is_infeasible():
    model = ct.load("satellite-slew/infeasible")
    # Without total momentum, I ẇ = T_c bounds how fast the rate grows, up and down again.
    push = np.linalg.norm(model.torque_limit / np.diag(model.inertia))
    assert not model.total_momentum.any()
    assert 2 * np.sqrt(model.turn[1] / push) > model.time_range[1]
