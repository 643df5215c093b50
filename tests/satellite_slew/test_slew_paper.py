"""The equations of the paper, with values computed by hand; h0 = 20 N m s and cos β = 0.6."""

import numpy as np
import pytest
from slews import close

from crosstrack.models import SatelliteSlew, track
from crosstrack.models.satellite_slew.controller import (
    TrackingLaw,
    lyapunov_function,
    tracking_torque,
)
from crosstrack.models.satellite_slew.dynamics import SlewMotion
from crosstrack.models.satellite_slew.gyros import gimbal_jacobian, singularity_measure
from crosstrack.models.satellite_slew.quaternions import (
    attitude_error,
    conjugate,
    product,
    quaternion_rate,
    rotation_about,
)

BETA = np.arccos(0.6)
INERTIA = np.diag([228.0, 188.0, 176.0])
MODEL = SatelliteSlew(momentum=20.0, pyramid_angle=float(np.rad2deg(BETA)))
MOTION = SlewMotion.of(MODEL)
ROOT = np.sqrt(0.5)


def test_gyros_at_zero_gimbal_angles():
    jacobian = [[-0.6, 0, 0.6, 0], [0, -0.6, 0, 0.6], [0.8, 0.8, 0.8, 0.8]]
    close(gimbal_jacobian(np.zeros(4), BETA), jacobian)
    # Eq. 9: -20 · (-0.6 - 0.6, 0, 0.8 - 0.8).
    close(MOTION.torque(np.zeros(4), [1, 0, -1, 0]), [24, 0, 0])
    # Eq. 11: A Aᵀ = diag(0.72, 0.72, 2.56).
    assert singularity_measure(np.zeros(4), BETA) == pytest.approx(1.327104)


def test_motion_of_the_satellite():
    # Eq. 10: -½ w·q = -½, -½ w×q = (0, ½, -½), ½ q0 w = (½, 0, 0).
    close(quaternion_rate([0.5] * 4, [2, 0, 0]), [-0.5, 0.5, 0.5, -0.5])
    # Eq. 3: w×(I w + h) = (0, 0.1 · 22.8 - 0.1 · 17.6, 0), and T_c = (24, 0, 0) by eq. 9.
    x = np.array([1, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 0, 0], float)
    rate = MOTION.rate(x, np.array([1.0, 0, -1, 0]), [0, 0, 1.76])
    close(rate[4:7], [24 / 228, -0.52 / 188, 0.01])
    # Eq. 22: 1 + 0.1 (1 + 1).
    phase = MODEL.lower().definition.phases[0]
    assert float(phase.function(0, x, [1, 0, -1, 0], [])[2]) == pytest.approx(1.2)


def test_both_readings_of_the_limits(steered):
    norm = SatelliteSlew(vector_limits="norm")
    # A rate of 0.1 rad/s about two axes: components of 0.1, a norm of 0.1414 rad/s.
    close(SatelliteSlew().magnitudes([0.1, -0.1, 0.0]), [0.1, 0.1, 0.0])
    close(norm.magnitudes([[0.1, -0.1, 0.0]]), [[0.1 * np.sqrt(2)]])
    close(norm.magnitudes([3.0, 0.0, 4.0]), [5.0])
    phase = norm.lower().definition.phases[0]
    assert [one.name for one in phase.paths][1:] == ["body rate squared", "control torque squared"]
    close(phase.paths[1].upper, [1 / 64])
    close(phase.paths[2].upper, [625.0])
    x = np.array([1, 0, 0, 0, 0.1, -0.1, 0, 0, 0, 0, 0], float)
    # T_c = -h0 A_t δ̇ at δ = 0 with only the first gimbal moving.
    part = norm.momentum**2 * (np.cos(norm.beta) ** 2 + np.sin(norm.beta) ** 2)
    path = np.array(phase.function(0, x, [1, 0, 0, 0], [])[1]).ravel()
    close(path[1:], [0.02, part], 1e-9)
    # An eigenaxis turn about roll is within both; a shorter limit is seen by both alike.
    assert norm.verify(steered.plan).ok
    tight = SatelliteSlew(vector_limits="norm", rate_limit=0.07).verify(steered.plan)
    (rate,) = [one for one in tight.violated if one.name == "body rate limit"]
    assert rate.equation == "23"
    assert rate.where.endswith("|w|")


def test_error_quaternion():
    # Eq. 25 by hand: q_e0 = 0.5 √½ + 0.5 √½, q_e = √½ (0.5, 0.5, 0.5) - (0.5 √½, 0, 0) + (0, 0.5, -0.5) √½.
    close(attitude_error([0.5] * 4, [ROOT, ROOT, 0, 0]), [ROOT, 0, ROOT, 0])
    # No error gives (1, 0); the printed minus would give q_e0 = 0 here.
    close(attitude_error([ROOT, ROOT, 0, 0], [ROOT, ROOT, 0, 0]), [1, 0, 0, 0])


def test_tracking_law():
    # Eq. 32 with K_p = 100 · 0.8, K_d = 50, q_e = (0.6, 0, 0), w_e = (0.1, 0, 0).
    torque = tracking_torque(
        80 * np.eye(3), 50 * np.eye(3), [0.6, 0, 0], [0.1, 0, 0],
        [1, 2, 3], [0, 0.52, 0], [22.8, 0, 0],
    )  # fmt: skip
    close(torque, [-31.2, -1.48, -3.0])
    # tr(I) = 592 kg m², so k1 = 2 · 592 / 3 at 1 rad/s.
    close(TrackingLaw.PAPER.stiffness(1.0, INERTIA, 0.75), 296 * np.eye(3))
    close(TrackingLaw.INERTIA.stiffness(1.0, INERTIA, 0.75), np.diag([456.0, 376.0, 352.0]))


def test_lyapunov_function_falls_as_the_proof_says():
    # Eq. 28: 100 · 0.36 + ½ · 228 · 0.01.
    error, rates = np.array([0.6, 0, 0]), np.array([0.1, 0, 0])
    assert lyapunov_function(100.0, INERTIA, error, rates) == pytest.approx(37.14)
    q, desired = rotation_about([1, 2, 3], 0.9), rotation_about([0, 1, -1], 0.3)
    w, wanted, push = np.array([0.05, -0.1, 0.02]), np.array([0.1, 0.03, 0.0]), np.full(3, 0.01)
    gain, damping, outer = 300.0, np.diag([50.0, 60.0, 70.0]), np.array([0.4, -0.2, 0.1])
    difference = product(conjugate(desired), q)
    gyration = np.cross(w, MOTION.body_momentum(w, np.zeros(4)))
    torque = tracking_torque(
        gain * difference[0] * np.eye(3), damping, difference[1:], w - wanted, outer, gyration,
        INERTIA @ push,
    )  # fmt: skip
    # The gimbals rest, and T_c enters with the outer torque.
    x = np.concatenate([q, w, np.zeros(4)])
    rate = MOTION.rate(x, np.zeros(4), torque + outer)
    turned = product(conjugate(desired), rate[:4])
    turned = turned + product(conjugate(quaternion_rate(desired, wanted)), q)
    # Eq. 27, with the term q_e × w_d that the print lacks.
    e0, e, we = difference[0], difference[1:], w - wanted
    close(turned[0], -0.5 * e @ we)
    close(turned[1:], 0.5 * (np.cross(e, we) + e0 * we) + np.cross(e, wanted))
    # Eq. 29 and 33.
    slope = 2 * gain * e @ turned[1:] + we @ INERTIA @ (np.array(rate[4:7]) - push)
    assert slope == pytest.approx(-we @ damping @ we)
    assert slope < 0


def test_the_papers_law_knows_the_disturbance(reserved):
    flight = track(*reserved, law="paper", sample_time=0.08)
    blind = track(*reserved, law="paper", known_disturbance=0.0, sample_time=0.08)
    assert flight.max_quaternion_error < 0.2 * blind.max_quaternion_error
    assert blind.max_quaternion_error < 4e-4
    assert blind.max_rate_error < 1e-3
