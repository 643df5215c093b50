"""The default estimator on a recorded race-track drive, with rough vehicle parameters."""

import dataclasses

import numpy as np
import pytest
from sideslip import stanford

import crosstrack as ct
from crosstrack.models.sideslip import identify
from crosstrack.solvers import Request
from crosstrack.solvers.contract.selection import recommended

pytestmark = pytest.mark.skipif(
    not stanford.FILE.exists(), reason="the drive lies in ../shared/data/sideslip, which is absent"
)


@pytest.fixture(scope="module")
def drive():
    return stanford.whole()


def measured(model):
    """Return error and coverage of the recommended backend."""
    backend = recommended(model)
    plan = backend.run(model.blinded(), Request(options=backend.checked_options({}))).point
    return model.verify(plan).objective, model.coverage(plan)


@pytest.mark.parametrize(
    ("count", "vehicle"),
    [
        pytest.param(1, stanford.GUESS, id="1-guess"),
        pytest.param(5, stanford.OTHER, id="5-other car"),
        pytest.param(1, stanford.OTHER, id="1-other car", marks=pytest.mark.slow),
        pytest.param(5, stanford.GUESS, id="5-guess", marks=pytest.mark.slow),
    ],
)
def test_error_and_coverage_on_the_last_part(drive, vehicle, count):
    end = int(stanford.SHARE * len(drive))
    known = stanford.cut(drive, 0, end)
    training = [known] if count == 1 else [part for part, _ in stanford.folds(known, count)]
    here = stanford.cut(drive, end, len(drive))
    error, coverage = measured(stanford.model(here, training, vehicle))
    assert error <= 0.30
    assert 0.90 <= coverage <= 0.98


def test_error_and_coverage_in_cross_validation(drive):
    known = stanford.cut(drive, 0, int(stanford.SHARE * len(drive)))
    found = [measured(stanford.model(part, others)) for part, others in stanford.folds(known, 6)]
    error, coverage = np.mean(found, axis=0)
    assert error <= 0.30
    assert 0.90 <= coverage <= 0.98


@pytest.mark.parametrize("vehicle", [stanford.GUESS, stanford.OTHER], ids=["guess", "other car"])
def test_error_and_coverage_without_training_drives(drive, vehicle):
    error, coverage = measured(
        stanford.model(stanford.cut(drive, len(drive) // 2, len(drive)), [], vehicle)
    )
    assert error <= 0.45
    assert coverage >= 0.90


@pytest.mark.slow
def test_the_declared_noise_fails_after_identification_and_the_identified_one_is_too_small(drive):
    end = int(stanford.SHARE * len(drive))
    car = dataclasses.replace(stanford.GUESS, tyre="magic-formula")
    here = stanford.cut(drive, end, len(drive))
    model = stanford.model(here, [stanford.cut(drive, 0, end)], car)
    result = identify(model)
    assert not result.undetermined
    model = dataclasses.replace(model, vehicle=result.vehicle)
    solution = ct.solve(model, "kalman-filter")
    assert solution.primal_bound > 30.0 and model.coverage(solution.plan) > 0.9
    assert "the measurements contradict the vehicle or the noises" in solution.message
    findings = str(ct.diagnose(dataclasses.replace(model, training=())))
    assert "the noise of lateral_acceleration looks like" in findings
    assert f"m/s² that a friction of {result.vehicle.friction:g}" in findings
    noise = {"yaw_rate_noise": result.noise[1], "acceleration_noise": result.noise[2]}
    solution = ct.solve(dataclasses.replace(model, **noise), "kalman-filter")
    assert solution.primal_bound < 0.5 and model.coverage(solution.plan) < 0.8


def test_signs_units_and_delays_of_the_file(drive):
    """The angle is that of the velocities, and the sensors satisfy dvy/dt = ay - u ω without a scale or a delay."""
    table = np.genfromtxt(stanford.FILE, delimiter=",", skip_header=1)
    assert np.allclose(np.arctan2(table[:, 2], table[:, 1]), drive.sideslip, atol=1e-6)

    def smooth(values):
        return np.convolve(values, np.ones(15) / 15, "valid")

    inertial = smooth(np.gradient(table[:, 2], 0.02) + drive.speed * drive.yaw_rate)
    felt = smooth(drive.lateral_acceleration)
    assert 0.9 < felt @ inertial / (inertial @ inertial) < 1.1
    off = [
        np.std(felt[10 + lag : len(felt) - 10 + lag] - inertial[10:-10]) for lag in range(-10, 11)
    ]
    assert abs(int(np.argmin(off)) - 10) <= 1
    along = smooth(np.gradient(drive.speed, 0.02) - table[:, 2] * drive.yaw_rate)
    assert 0.9 < smooth(drive.longitudinal_acceleration) @ along / (along @ along) < 1.1
