"""Limit of the angle check, and both error measures. 1.1 times the accepted violation is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from check_limits import assert_allowed, names_of
from sideslip.drives import estimate, kinematic

TOLERANCE = 1e-6
RIGHT = 0.5 * math.pi
#: Time between samples, s, and speed, m/s.
DRIVES = [(0.01, 1.0), (0.05, 20.0), (0.2, 1000.0)]


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("sample", [0, 100, 200])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limit_of_the_angle(sign, sample, known, drive):
    model = kinematic(period=drive[0], speed=drive[1])
    model = model if known else replace(model, truth=None)

    def verify(x):
        angles = np.full(201, -0.1 * sign)
        angles[sample] = sign * RIGHT * (1.0 + x * TOLERANCE)
        found = model.verify(estimate(angles))
        assert found.checks[0].where == f"sample {sample}" and found.checks[0].limit == RIGHT
        return found

    assert_allowed("angle is below 90°", TOLERANCE * RIGHT, verify)


def test_every_check_has_its_limit():
    for model in (kinematic(), replace(kinematic(), truth=None)):
        found = model.verify(estimate(np.zeros(201)))
        assert found.ok and names_of(found) == {"angle is below 90°"}
        assert found.checks[0].worst == 0.0


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_mean_error_counts_moving_samples_alone(sign, drive):
    speed = np.full(201, drive[1])
    speed[50:] = 0.5
    model = kinematic(period=drive[0], speed=speed)
    off = np.where(np.arange(201) < 50, sign * 0.01, 1.0)
    off[:10] *= -3.0
    found = model.verify(estimate(model.truth + off))
    assert found.objective == pytest.approx(math.degrees(0.01 * (40 + 3 * 10) / 50), rel=1e-12)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("seconds", [0.7, 7.0])
@pytest.mark.parametrize("drift", [0.01, -0.01])
def test_the_kinematic_error_is_the_drift_over_a_second(drift, seconds, drive):
    period = min(drive[0], 0.05)
    model = kinematic(n=round(seconds / period) + 1, period=period, speed=drive[1])
    times = model.recording.times
    # The first time of a recording is arbitrary.
    recording = replace(model.recording, times=times + 100.0)
    model = replace(model, recording=recording, truth=None)
    found = model.verify(estimate(0.02 * np.sin(times) + 0.3 + drift * times))
    # The error of the trapezoidal rule is less than a hundredth of it.
    assert found.objective == pytest.approx(math.degrees(0.01 * min(seconds, 1.0)), rel=0.01)


@pytest.mark.parametrize("halts", [slice(50, 51), slice(150, 151), slice(3, None, 10)])
@pytest.mark.parametrize("drift", [0.01, -0.01])
def test_the_kinematic_error_leaves_out_halts(drift, halts):
    speed = np.full(201, 20.0)
    speed[halts] = 0.5
    model = replace(kinematic(period=0.05, speed=speed), truth=None)
    times = model.recording.times
    angles = 0.02 * np.sin(times) + drift * times
    angles[halts] = 1.0
    found = model.verify(estimate(angles))
    # If every second contains a halt, neighbouring samples are compared.
    window = 0.05 if halts.step else 1.0
    assert found.objective == pytest.approx(math.degrees(0.01 * window), rel=0.02)
