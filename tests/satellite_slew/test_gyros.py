"""Gyros, quaternions and the equations of motion of a slew."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from slews import BETA, FULL, close

from crosstrack.models import SatelliteSlew
from crosstrack.models.satellite_slew.dynamics import SlewMotion
from crosstrack.models.satellite_slew.gyros import (
    gimbal_jacobian,
    momentum_direction,
    singularity_measure,
)
from crosstrack.models.satellite_slew.quaternions import (
    attitude_error,
    axis_and_angle,
    conjugate,
    product,
    quaternion_rate,
    rotation_about,
    rotation_matrix,
)


def random_attitudes(count, seed=0):
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


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
