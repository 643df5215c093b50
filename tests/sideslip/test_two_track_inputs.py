"""Optional sensors of a recording, and the tyre curve that kalman-grnn learns, on drives of the two-track simulator."""

from dataclasses import replace

import numpy as np
import pytest
from sideslip.drives import CAR
from sideslip.two_track import SCENARIOS, drive

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import read_recording
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, Vehicle, estimate_speed
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


def test_speeds_of_the_wheels_replace_the_speed_of_a_file(tmp_path, caplog):
    """The file needs a column of the speed if a wheel is missing."""
    entry = recording("parking", more=True)
    names = "times", "steering", "yaw_rate", "lateral_acceleration"
    table = np.column_stack([*(getattr(entry, name) for name in names), entry.wheel_speeds])
    wheels = [
        f"wheel_{axle}_{side} [m/s]" for axle in ("front", "rear") for side in ("left", "right")
    ]
    head = [
        "time [s]",
        "steering [rad]",
        "yaw_rate [rad/s]",
        "lateral_acceleration [m/s^2]",
        *wheels,
    ]
    file = tmp_path / "drive.csv"
    form = {"delimiter": ",", "comments": "", "fmt": "%.17g"}
    np.savetxt(file, table, header=",".join(head), **form)
    with caplog.at_level("WARNING", logger="crosstrack"):
        again = read_recording(file)
    assert "the speed follows from those of the wheels" in caplog.text
    assert np.array_equal(
        again.speed, estimate_speed(entry.wheel_speeds, entry.steering, entry.yaw_rate)
    )
    np.savetxt(file, table[:, :-1], header=",".join(head[:-1]), **form)
    with pytest.raises(InvalidData, match="missing: speed"):
        read_recording(file)


@pytest.mark.parametrize("name", sorted(SCENARIOS))
@pytest.mark.parametrize("wheel", [None, 0, 3])
def test_speed_from_the_wheels_is_near_the_true_one(name, wheel):
    """Also with one failed wheel. Braked wheels are too slow, and driven ones too fast."""
    entry = drive(name)
    rims = entry.wheel_speeds.copy()
    if wheel is not None:
        rims[len(rims) // 3 :, wheel] = 0.0
    speed = estimate_speed(rims, entry.steering, entry.yaw_rate)
    off = speed - entry.true["vx"]
    slips = name in ("braking-in-a-turn", "spin")
    assert np.abs(off).max() < (0.8 if slips else 0.3)


def test_a_wheel_that_spins_or_locks_does_not_change_the_speed():
    rims = np.full((200, 4), 20.0)
    rims[50:100, 2:] = 35.0
    rims[120:150, 0] = 0.0
    speed = estimate_speed(rims, np.zeros(200), np.zeros(200))
    assert np.array_equal(speed, np.full(200, 20.0))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((np.ones((3, 3)), np.zeros(3), np.zeros(3)), "wheel_speeds"),
        ((-np.ones((3, 4)), np.zeros(3), np.zeros(3)), "wheel_speeds"),
        ((np.ones((3, 4)), np.zeros(2), np.zeros(3)), "steering"),
        ((np.ones((3, 4)), np.zeros(3), np.full(3, np.nan)), "yaw_rate"),
        ((np.ones((3, 4)), np.zeros(3), np.zeros(3), 0.0), "track"),
    ],
)
def test_rejects_speeds_of_wheels_of_a_wrong_shape_or_range(values, message):
    with pytest.raises(InvalidData, match=message):
        estimate_speed(*values)


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


def test_the_claim_of_the_tyre_curve_contains_a_filter_that_has_lost_the_angle():
    """A spike at the first sample drives tyres with a peak to 90°. The filter does not return."""
    problem = model("serpentine")
    side = problem.recording.lateral_acceleration.copy()
    side[0] = 1000.0
    car = replace(problem.vehicle, tyre="magic-formula")
    recording = replace(problem.recording, lateral_acceleration=side)
    problem = replace(problem, vehicle=car, recording=recording)
    result = answer(problem)
    assert result.statistics["tyre curve"] == 1.0
    assert problem.verify(result.point).objective > 45.0
    assert problem.coverage(result.point) >= 0.8
    # The smoother replaces the spike.
    assert problem.verify(answer(problem, "smoother-grnn").point).objective < 0.1


def test_the_claim_of_the_tyre_curve_grows_with_that_of_the_filter():
    """On ice the filter is less sure than on the dry road of the training drives."""
    ice = ct.load("sideslip/ice")
    result = answer(ice)
    assert result.statistics["tyre curve"] == 1.0
    assert ice.coverage(result.point) >= 0.92


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
