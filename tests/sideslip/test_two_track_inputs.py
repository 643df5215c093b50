"""Optional sensors of a recording, and the tyre curve that kalman-grnn learns, on drives of the two-track simulator."""

from dataclasses import replace

import numpy as np
import pytest
from sideslip.drives import CAR
from sideslip.two_track import SCENARIOS, drive

from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import read_recording
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, Vehicle
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.sideslip.learning import relative_size

TRAINING = "serpentine", "step-steer", "steady-circle"


def recording(name, *, known=False, more=False, seed=0):
    found = drive(name, seed)
    fields = dict(found.recording())
    if more:
        fields["wheel_speeds"] = found.wheel_speeds
        fields["longitudinal_acceleration"] = found.longitudinal_acceleration
    return Recording(**fields, sideslip=found.truth if known else None)


def model(name, *, more=False, car=CAR):
    training = [recording(entry, known=True, more=more, seed=1) for entry in TRAINING]
    here = recording(name, more=more)
    return SideslipEstimation(Vehicle(**car), here, training=training, truth=drive(name).truth)


def answer(problem, name="kalman-grnn"):
    backend = find_backend(name)
    return backend.run(problem.blinded(), Request(options=backend.checked_options({})))


def error(problem, name="kalman-grnn"):
    return problem.verify(answer(problem, name).point).objective


def test_digest_of_a_recording_without_the_sensors_is_old():
    plain = model("lane-change")
    assert set(plain.recording.data()) == {
        "times", "speed", "steering", "yaw_rate", "lateral_acceleration", "sideslip",
    }  # fmt: skip
    more = model("lane-change", more=True)
    assert more.digest != plain.digest
    again = Recording.from_data(more.recording.data())
    assert np.array_equal(again.wheel_speeds, more.recording.wheel_speeds)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("wheel_speeds", np.ones((751, 3))),
        ("wheel_speeds", -np.ones((751, 4))),
        ("wheel_speeds", np.full((751, 4), np.nan)),
        ("longitudinal_acceleration", np.ones(750)),
        ("longitudinal_acceleration", np.full(751, 1e6)),
    ],
)
def test_rejects_sensors_of_a_wrong_shape_or_range(field, value):
    with pytest.raises(InvalidData, match=field):
        replace(recording("serpentine"), **{field: value})


def test_forward_acceleration_follows_from_the_speed():
    found = drive("braking-in-a-turn")
    by_speed = recording("braking-in-a-turn").forward_acceleration
    # The sensor has the term - v r of the rotation, which is small here; the difference lags by 0.1 s.
    assert by_speed[300:380].mean() == pytest.approx(found.true["ax"][295:375].mean(), abs=0.15)
    measured = recording("braking-in-a-turn", more=True)
    assert measured.forward_acceleration is measured.longitudinal_acceleration


def test_reader_accepts_the_optional_columns(tmp_path):
    found = recording("lane-change", known=True, more=True)
    head = "time [s],speed [m/s],steering [rad],yaw_rate [rad/s],lateral_acceleration [m/s^2],sideslip [rad],"
    head += "longitudinal_acceleration [g],wheel_front_left [km/h],wheel_front_right [km/h],wheel_rear_left [km/h],"
    names = "times", "speed", "steering", "yaw_rate", "lateral_acceleration", "sideslip"
    columns = [*(getattr(found, name) for name in names), found.longitudinal_acceleration / 9.80665]
    table = np.column_stack([*columns, found.wheel_speeds * 3.6])
    file = tmp_path / "drive.csv"
    np.savetxt(
        file,
        table,
        delimiter=",",
        header=head + "wheel_rear_right [km/h]",
        comments="",
        fmt="%.17g",
    )
    again = read_recording(file)
    assert np.allclose(again.wheel_speeds, found.wheel_speeds, rtol=1e-12)
    assert np.allclose(again.longitudinal_acceleration, found.longitudinal_acceleration, rtol=1e-12)
    np.savetxt(file, table[:, :-1], delimiter=",", header=head[:-1], comments="", fmt="%.17g")
    with pytest.raises(InvalidData, match="wheel_rear_right"):
        read_recording(file)


@pytest.mark.parametrize("name", ["lane-change", "braking-in-a-turn"])
def test_tyre_curve_corrects_a_wrong_vehicle(name):
    wrong = {**CAR, "mass": 1.3 * CAR["mass"], "cornering_rear": 0.7 * CAR["cornering_rear"]}
    problem = model(name, car=wrong)
    found = answer(problem)
    assert found.statistics["tyre curve"] == 1.0
    alone = error(problem, "kalman-filter")
    assert problem.verify(found.point).objective < 0.4 * alone


def test_tyre_curve_is_not_used_on_a_noisier_drive():
    problem = model("lane-change")
    rng = np.random.default_rng(0)
    noisy = problem.recording.yaw_rate + 0.02 * rng.normal(size=len(problem.recording))
    problem = replace(problem, recording=replace(problem.recording, yaw_rate=noisy))
    assert "tyre curve" not in answer(problem).statistics


def test_an_optional_sensor_is_used_only_if_all_drives_have_it():
    wrong = {**CAR, "mass": 1.3 * CAR["mass"]}
    full, plain = model("lane-change", more=True, car=wrong), model("lane-change", car=wrong)
    for mixed in (replace(full, training=plain.training), replace(plain, training=full.training)):
        assert answer(mixed).point == answer(plain).point
    assert not np.array_equal(answer(full).point.sideslip, answer(plain).point.sideslip)


@pytest.mark.parametrize("name", ["ice", "braking-in-a-turn", "mass", "bias", "serpentine"])
def test_claims_hold_in_situations_that_differ_from_the_training_drives(name):
    training = [recording(entry, known=True, seed=101) for entry in ("lane-change", *TRAINING)]
    problem = replace(model(name), training=training)
    result = answer(problem)
    assert result.statistics["tyre curve"] == 1
    assert problem.coverage(result.point) >= 0.9
    usual = np.degrees(np.median(result.point.deviation))
    if name == "serpentine":  # like the training drives: nothing is wider
        assert usual < 0.06
    else:
        assert "changes over a second differ" in result.message


def test_size_of_errors_falls_with_the_speed():
    speed = np.linspace(5.0, 50.0, 200)
    size = relative_size(0.01 + 0.2 / speed, speed)
    assert np.allclose(size(speed) * (0.01 + 0.2 / speed).mean(), 0.01 + 0.2 / speed)
    assert np.array_equal(relative_size(np.zeros(3), speed[:3])(speed), np.ones(200))
    constant = relative_size(np.full(200, 0.3), np.full(200, 20.0))
    assert np.allclose(constant(np.full(4, 20.0)), 1.0)


def test_scenarios_are_valid_recordings():
    for name in SCENARIOS:
        recording(name, more=True)


@pytest.mark.parametrize("name", ["kalman-grnn", "smoother-grnn"])
def test_names_a_constant_error_that_kinematics_does_not_show(name, monkeypatch):
    steady = SCENARIOS["step-steer"]
    heavy = replace(steady.car, mass=1.1 * steady.car.mass, inertia=1.1 * steady.car.inertia)
    monkeypatch.setitem(SCENARIOS, "step-steer, heavy", replace(steady, car=heavy))
    problem = model("step-steer, heavy")
    result = answer(problem, name)
    off = np.degrees(np.abs(result.point.sideslip - problem.truth))
    assert problem.coverage(result.point) < 0.5 and off.max() < 0.6
    assert "kinematics does not show a constant error: a mass 10 % above" in result.message
    assert "would change the angle by up to 0." in result.message
    straight = answer(model("highway"), name)
    assert "constant error" not in straight.message


@pytest.mark.parametrize("name", ["kalman-filter", "rts-smoother", "unscented-filter"])
def test_deviations_cover_the_large_angles_of_parking(name):
    problem = model("parking")
    assert 0.9 <= problem.coverage(answer(problem, name).point) <= 0.98
