"""Identified parameters of vehicles: truth, covariance, and parameters that drives do not determine."""

import dataclasses

import numpy as np
import pytest
from sideslip.drives import kinematic
from sideslip.filters import simulated

from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import generate
from crosstrack.instances.sideslip.vehicles import VEHICLE
from crosstrack.models.sideslip import SideslipEstimation, identification, identify

STIFF = ("cornering_front", "cornering_rear", "yaw_inertia")
WRONG = {"cornering_front": 1.3, "cornering_rear": 0.8, "yaw_inertia": 1.2}


def drives(seed=0, count=3, **options):
    options = {"road": "serpentine", "mismatch": WRONG, **options}
    return generate(seed=seed, drivers=count, **options)


def true_values(names, **others):
    return np.array([{**VEHICLE.data(), **others}[name] for name in names])


@pytest.mark.parametrize("count", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_two_deviations_cover_the_truth(count):
    inside = []
    for seed in range(count):
        model = simulated(seed, n=400)  # by matrix exponentials
        drive = dataclasses.replace(model.recording, sideslip=model.truth)
        wrong = {name: getattr(model.vehicle, name) * WRONG[name] for name in STIFF}
        car = dataclasses.replace(model.vehicle, **wrong)
        result = identify(dataclasses.replace(model, vehicle=car, training=[drive]))
        true = np.array([getattr(model.vehicle, name) for name in STIFF])
        inside.append(np.abs(result.values - true) <= 2.0 * result.deviations)
    assert result.names == STIFF and not result.undetermined
    assert 0.90 <= np.mean(inside) <= 0.98


def test_two_deviations_cover_the_friction():
    options = {"tyre": "saturating", "friction": 0.8, "mismatch": {**WRONG, "friction": 1.5}}
    inside = []
    for seed in range(10):
        result = identify(drives(seed, 2, samples=10, **options))
        names = result.names
        error = result.values - true_values(names, friction=0.8)
        inside.append(np.abs(error) <= 2.0 * result.deviations)
    assert names == (*STIFF, "friction") and not result.undetermined
    assert 0.90 <= np.mean(inside) <= 0.98
    assert result.vehicle.friction == pytest.approx(0.8, abs=0.02)


def test_the_scale_of_masses_and_forces_is_not_determined():
    names = ("mass", *STIFF)
    result = identify(drives(), names)
    assert result.undetermined == names
    assert result.correlations == pytest.approx(np.ones((4, 4)), abs=1e-3)
    assert "mass is not determined (correlation 1.000 with" in str(result)
    # Ratios are determined nevertheless.
    assert result.values[1] / result.values[0] == pytest.approx(
        VEHICLE.cornering_front / VEHICLE.mass, rel=0.01
    )
    known = identify(drives(), names, prior={"mass": 0.01})
    assert not known.undetermined
    assert known.deviations[0] == pytest.approx(0.01 * VEHICLE.mass, rel=0.02)


def test_friction_is_not_determined_by_linear_tyres():
    result = identify(drives(), (*STIFF, "friction"))
    assert result.undetermined == ("friction",)
    assert result.vehicle.friction == VEHICLE.friction


def test_biases_of_the_sensors_are_found():
    model = drives()
    shifted = [
        dataclasses.replace(drive, yaw_rate=drive.yaw_rate + 0.01, sideslip=drive.sideslip - 0.02)
        for drive in model.training
    ]
    names = (*STIFF, "sideslip_bias", "yaw_rate_bias")
    result = identify(dataclasses.replace(model, training=shifted), names)
    assert result.values[3:] == pytest.approx([-0.02, 0.01], abs=4e-4)
    assert result.vehicle.cornering_front == pytest.approx(VEHICLE.cornering_front, rel=0.01)


def test_the_noise_is_estimated():
    model = dataclasses.replace(drives(), yaw_rate_noise=0.01, acceleration_noise=0.01)
    result = identify(model)
    assert result.noise == pytest.approx([0.0, 0.002, 0.05], rel=0.1, abs=2e-4)


def test_a_bad_drive_gives_finite_estimates():
    model = kinematic()
    drive = dataclasses.replace(model.recording, sideslip=model.truth)
    for change in ({"lateral_acceleration": 0.0 * drive.times}, {"yaw_rate": 0.0 * drive.times},
                   {"speed": np.where(drive.times > 5, 0.0, drive.speed)},
                   {"sideslip": 0.0 * drive.times},
                   dict.fromkeys(("steering", "yaw_rate", "lateral_acceleration", "sideslip"),
                                 0.0 * drive.times)):  # fmt: skip
        bad = dataclasses.replace(drive, **change)
        result = identify(dataclasses.replace(model, training=[bad]))
        assert np.isfinite(result.values).all() and (result.values > 0).all()
        assert np.isfinite(result.covariance).all() and np.isfinite(result.noise).all()
    assert result.variance == 0.0 and result.undetermined == STIFF  # a straight drive without noise


def test_fewer_measurements_than_parameters_determine_nothing():
    model = simulated(0, n=100)
    speed = np.where(np.abs(np.arange(100) - 50.5) < 1, model.recording.speed, 0.0)  # two samples
    drive = dataclasses.replace(model.recording, sideslip=model.truth, speed=speed)
    names = (*identification.FIELDS, *identification.BIASES)
    result = identify(dataclasses.replace(model, training=[drive]), names)
    assert result.freedom == 6 - 2 - len(names) and result.undetermined == names


def test_the_noise_counts_degrees_of_freedom():
    noise = []
    for seed in range(25):
        model = simulated(seed, n=10)
        drive = dataclasses.replace(model.recording, sideslip=model.truth)
        noise.append(identify(dataclasses.replace(model, training=[drive])).noise)
    rate, acceleration = np.sqrt(np.mean(np.square(noise), axis=0))[1:] / [0.002, 0.05]
    assert 0.9 < rate < 1.1 and 0.9 < acceleration < 1.1


def test_the_noise_shows_linear_tyres_at_the_limit():
    model = drives(0, 2, samples=200, tyre="saturating", friction=0.8, mismatch={"friction": 1.1})
    linear = dataclasses.replace(model.vehicle, tyre="linear")
    right, wrong = identify(model), identify(dataclasses.replace(model, vehicle=linear))
    assert right.noise[2] == pytest.approx(model.acceleration_noise, rel=0.1)
    assert wrong.noise[2] > 1.5 * model.acceleration_noise
    assert wrong.vehicle.cornering_front < 0.9 * VEHICLE.cornering_front  # an effective stiffness


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        ("weight", {}, "names.0. must be one of mass, .*, got 'weight'"),
        ((), {}, "names must be different parameters, at least one"),
        (("mass", "mass"), {}, "names must be different"),
        (7, {}, "names.0. must be one of mass, .*, got 7"),
        (None, {"prior": 3}, "prior must be a Mapping, got 3"),
        (None, {"prior": {"mass": 0.1}}, "prior names 'mass', which is not estimated"),
        (("mass",), {"prior": {"mass": 0.0}}, r"prior\[mass\] must be > 0, got 0"),
    ],
)
def test_bad_arguments_are_refused(names, options, message):
    with pytest.raises(InvalidData, match=message):
        identify(drives(count=1), names, **options)


@pytest.mark.parametrize("size", [1e-6, 1e-3, pytest.param(1e3, marks=pytest.mark.slow), 1e6])
def test_a_start_far_from_the_truth_is_left(size):
    model = simulated(0, n=400)
    drive = dataclasses.replace(model.recording, sideslip=model.truth)
    car = dataclasses.replace(model.vehicle, cornering_front=size * 9e4)
    result = identify(dataclasses.replace(model, vehicle=car, training=[drive]))
    assert result.vehicle.cornering_front == pytest.approx(9e4, rel=0.01)
    # The scale of all parameters, lengths included, is as wrong as can be: any finite estimate is allowed.
    values = {
        name: size * getattr(model.vehicle, name) for name in (*STIFF, "mass", "front", "rear")
    }
    car = dataclasses.replace(model.vehicle, **values)
    result = identify(dataclasses.replace(model, vehicle=car, training=[drive]))
    assert np.isfinite(result.values).all() and np.isfinite(result.covariance).all()


@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 4), marks=pytest.mark.slow)])
def test_a_wrong_minimum_is_left(seeds):
    wrong = {"cornering_front": 0.01, "cornering_rear": 100, "yaw_inertia": 0.1, "friction": 0.05}
    for seed in seeds:
        model = drives(seed, 2, samples=200, tyre="saturating", friction=0.8, mismatch=wrong)
        result = identify(model)
        error = np.abs(result.values - true_values(result.names, friction=0.8))
        assert (error < 4.0 * result.deviations).all() and not result.undetermined


def test_a_search_that_does_not_converge_determines_nothing(monkeypatch):
    monkeypatch.setattr(identification, "ROUNDS", 1)
    result = identify(drives(count=1))
    assert result.undetermined == result.names and "yaw_inertia is not determined" in str(result)


def test_training_is_required():
    with pytest.raises(InvalidData, match="training must hold at least one drive"):
        identify(kinematic())
    with pytest.raises(InvalidData, match="model must be a SideslipEstimation"):
        identify(SideslipEstimation)
