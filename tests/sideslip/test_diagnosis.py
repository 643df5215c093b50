"""Diagnosis of a recording. Each finding is tested on a recording with exactly that defect."""

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.linalg import expm
from sideslip.drives import CAR, kinematic

import crosstrack as ct
from crosstrack.models.sideslip import Recording, Vehicle
from crosstrack.solvers.sideslip.diagnosis import critical_speed, diagnose_sideslip, gramian


def turning(n=401, speed=20.0, *, noise=True, vehicle=None, scale=(1, 1, 1, 1), seed=0, **fields):
    """Return a model of steady turns of a car with the declared noise.

    `scale` multiplies speed, steering, yaw rate and acceleration as recorded.
    """
    drawn = np.random.default_rng(seed)
    times = 0.05 * np.arange(n)
    speed = np.broadcast_to(np.asarray(speed, float), (n,))
    car = Vehicle(**CAR)
    yaw = np.where(speed >= 1, 0.1 * np.sin(0.8 * times), 0.0)
    under = (
        car.mass / car.wheelbase * (car.rear / car.cornering_front - car.front / car.cornering_rear)
    )
    steering = yaw * (car.wheelbase + under * speed**2) / np.maximum(speed, 1.0)
    columns = np.stack([speed, steering, yaw, speed * yaw])
    columns *= np.array(scale)[:, None]
    if noise:
        columns[2:] += np.array([[0.002], [0.05]]) * drawn.normal(size=(2, n))
    model = kinematic(n, name="turns", **fields)
    found = dataclasses.replace(model, recording=Recording(times, *columns), truth=np.zeros(n))
    return found if vehicle is None else dataclasses.replace(found, vehicle=vehicle)


def recorded(model, **columns):
    """Return a copy of a model with some columns of its recording replaced."""
    return dataclasses.replace(model, recording=dataclasses.replace(model.recording, **columns))


def odd(model):
    """Return the findings that need attention."""
    found = diagnose_sideslip(model)
    assert found.feasible
    json.dumps(found.to_dict(), allow_nan=False)
    count = found.summary.split("; ")[1].split()[0]
    return [one.text for one in found.findings[: 0 if count == "nothing" else int(count)]]


def drive_of(model):
    """Return the recording of a model as a training drive."""
    return dataclasses.replace(model.recording, sideslip=np.zeros(len(model.recording)))


def test_a_good_recording_has_nothing_odd():
    model = dataclasses.replace(turning(), training=(drive_of(turning(seed=1)),))
    assert odd(model) == []
    found = ct.diagnose(model)
    assert str(found).startswith(
        "turns: a plan exists, for every angle below 90° is one; nothing looks odd\n"
    )
    texts = [one.text for one in found.findings]
    assert texts[0] == "401 samples in 20 s, one about every 0.05 s"
    assert "the believed vehicle does not oversteer: it is stable at every speed" in texts
    assert any(text.startswith("1 drive to learn from, 401 samples: ") for text in texts)
    assert diagnose_sideslip(model.blinded()).findings == found.findings, "the truth is not read"
    # Left and right are symmetric.
    mirrored = recorded(
        model,
        **{
            name: -getattr(model.recording, name)
            for name in ("steering", "yaw_rate", "lateral_acceleration")
        },
    )
    for one, other in zip(ct.diagnose(mirrored).findings[:-1], found.findings[:-1], strict=True):
        assert one.text == other.text


STILL = np.concatenate([np.full(200, 20.0), np.zeros(201)])


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (turning(scale=(1, 1, -1, 1)), ["yaw rate and lateral acceleration have opposite signs", "steering and yaw rate have opposite signs"]),
        (turning(scale=(1, -1, 1, 1)), ["steering and yaw rate have opposite signs"]),
        (turning(scale=(1, 1, 1, -1)), ["yaw rate and lateral acceleration have opposite signs"]),
        (turning(scale=(1, 1, 180 / np.pi, 1)), ["the yaw rate seems to be in degrees a second", "turns 57.3 times as much as the believed one with the same steering: a unit"]),
        (turning(scale=(1, 1, 1, 1 / 9.80665)), ["the lateral acceleration seems to be in g"]),
        (turning(scale=(3.6, 1, 1, 1)), ["the speed seems to be in km/h"]),
        (turning(scale=(2.237, 1, 1, 1)), ["the speed seems to be in miles an hour"]),
        (turning(scale=(1, 1, 1, 7)), ["a unit or a scale is wrong", "above 4 m/s²"]),
        (turning(scale=(1, 15, 1, 1)), ["times less than its steering asks for: the angle of the steering wheel"]),
        (turning(scale=(1, 50, 1, 1)), ["times less than its steering asks for: degrees instead of rad"]),
        (turning(vehicle=Vehicle(**{**CAR, "cornering_front": 40_000.0})), ["times as much as the believed one"]),
        (turning(vehicle=Vehicle(**{**CAR, "cornering_front": 150_000.0}), speed=60.0), ["oversteers and is unstable above", "above 4 m/s²"]),
        (recorded(turning(), yaw_rate=np.full(401, 0.25)), ["yaw_rate never changes: 0.25 at every sample", "by kinematics the angle would change by -273°"]),
        (recorded(turning(), lateral_acceleration=np.zeros(401)), ["lateral_acceleration never changes: 0 at", "hardly excites"]),
        (recorded(turning(), lateral_acceleration=turning().recording.lateral_acceleration + 0.3), ["by kinematics the angle would change by 17.2°"]),
        (recorded(turning(), yaw_rate=turning().recording.yaw_rate + 0.02), ["rad/s where the steering says straight ahead", "by kinematics"]),
        (recorded(turning(), steering=turning().recording.steering - 0.004), ["rad/s where the steering says straight ahead"]),
        (turning(speed=STILL, scale=(1, 1, 1, 1)), []),
        (recorded(turning(speed=STILL), yaw_rate=turning(speed=STILL).recording.yaw_rate + 0.004), ["at rest yaw_rate shows 0.00"]),
        (recorded(turning(speed=STILL), lateral_acceleration=turning(speed=STILL).recording.lateral_acceleration - 0.06), ["at rest lateral_acceleration shows -0.0"]),
        (turning(yaw_rate_noise=0.01), ["the noise of yaw_rate looks like 0.00", ]),
        (turning(acceleration_noise=0.005), ["the noise of lateral_acceleration looks like 0.05"]),
        (turning(scale=(1, 0.02, 0.02, 0.02)), ["yaw_rate is 0.00", "lateral_acceleration is 0.0"]),
    ],
)  # fmt: skip
def test_each_oddity_is_told(model, words):
    found = odd(model)
    for one in words:
        assert any(one in text for text in found), found
    allowed = [
        *words,
        "the noise of",
        "times as much as the believed",
        "hardly excites",
        "by kinematics",
    ]
    if len(words) < 2:  # one defect gives no other finding
        assert all(any(one in text for one in allowed) for text in found), found


def test_missing_stale_and_jittering_samples():
    model = turning(noise=True)
    times, drive = model.recording.times, model.recording
    kept = np.delete(np.arange(401), [*range(100, 130), 50])
    lost = dataclasses.replace(
        model, truth=None,
        recording=Recording(*(column[kept] for column in (drive.times, drive.speed, drive.steering, drive.yaw_rate, drive.lateral_acceleration))),
    )  # fmt: skip
    assert odd(lost) == [
        "about 7.73 % of the samples are missing; the longest gap is 1.55 s after 4.95 s"
    ]
    shown = np.arange(401) // 2 * 2
    stale = recorded(
        model,
        yaw_rate=drive.yaw_rate[shown],
        lateral_acceleration=drive.lateral_acceleration[shown],
    )
    assert odd(stale)[0].startswith("50 % of the samples repeat both measurements before them")
    shaken = times + np.random.default_rng(0).uniform(-0.02, 0.02, 401)
    assert odd(recorded(model, times=shaken))[0].startswith("401 samples in ")
    assert "give or take" in odd(recorded(model, times=shaken))[0]
    slow = turning(speed=STILL)
    assert any(
        "50.1 % of the samples are below 1 m/s" in one.text
        for one in diagnose_sideslip(slow).findings
    )


def test_what_other_drives_do_not_show():
    model = turning()
    slower = drive_of(turning(speed=10.0))
    (text,) = odd(dataclasses.replace(model, training=(slower,)))
    assert text == (
        "1 drive to learn from, 401 samples: 100 % of the recording lies outside of what they show, most of it by speed"
    )
    drive = drive_of(model)
    rare = dataclasses.replace(drive, times=drive.times * 2)
    (text,) = odd(dataclasses.replace(model, training=(drive, rare)))
    assert (
        text
        == "the drives to learn from have a sample every 0.05 … 0.1 s, the recording every 0.05 s"
    )
    half = dataclasses.replace(drive, yaw_rate=np.abs(drive.yaw_rate))
    share = np.mean(drive.yaw_rate < half.yaw_rate.min() - 0.01 * half.yaw_rate.max())
    (text,) = odd(dataclasses.replace(model, training=(half,)))
    assert f"{100 * share:.3g} % of the recording" in text and text.endswith("by yaw_rate")


@pytest.mark.parametrize("friction", [0.15, 0.3, 0.5, 2.0])
def test_tyres_that_slide_are_told_by_their_stiffness(friction):
    model = turning(vehicle=Vehicle(**CAR, tyre="saturating", friction=friction))
    most = np.abs(model.recording.lateral_acceleration).max()
    texts = [one.text for one in diagnose_sideslip(model).findings if "friction of" in one.text]
    if most > friction * 9.80665 + 0.2:
        assert texts[0].endswith(
            f"more than the {friction * 9.80665:.3g} m/s² that a friction of {friction:g} allows"
        )
        assert texts[0] in odd(model)
        return
    # Slope of Fiala's force at a share of its maximum, by differences.
    share = min(most / (friction * 9.80665), 1.0)
    slips = np.linspace(0, 3, 300_001)  # C tan α / (μ F_z): the tyre slides from 3
    force = slips - slips**2 / 3 + slips**3 / 27
    left = np.interp(share, force, np.gradient(force, slips))
    assert f"tyres then have {100 * left:.3g} % of their stiffness left" in texts[0]
    assert (texts[0] in odd(model)) == (left < 0.3)


def plain_gramian(model, speed, count):
    """Return the Gramian as a sum over powers of the step, with matrices by differences."""
    car = model.vehicle

    def forces(state):
        beta, omega = state
        front = car.cornering_front * (-beta - car.front * omega / speed)
        rear = car.cornering_rear * (car.rear * omega / speed - beta)
        return front, rear

    def flow(state):
        front, rear = forces(state)
        return [
            (front + rear) / (car.mass * speed) - state[1],
            (car.front * front - car.rear * rear) / car.yaw_inertia,
        ]

    def seen(state):
        return [
            state[1] / model.yaw_rate_noise,
            sum(forces(state)) / car.mass / model.acceleration_noise,
        ]

    matrix = np.column_stack([flow(unit) for unit in np.eye(2)])
    look = np.column_stack([seen(unit) for unit in np.eye(2)])
    rows = [look @ expm(matrix * model.recording.period * k) for k in range(count)]
    return sum(row.T @ row for row in rows)


@pytest.mark.parametrize("speed", [1.0, 7.0, 30.0, 100.0])
@pytest.mark.parametrize("count", [1, 2, 16, 64])
@pytest.mark.parametrize("rear", [90_000.0, 40_000.0])
def test_the_gramian_is_the_sum_over_samples(speed, count, rear):
    model = turning(vehicle=Vehicle(**{**CAR, "cornering_rear": rear}))
    assert gramian(model, speed, count) == pytest.approx(
        plain_gramian(model, speed, count), rel=1e-9
    )


def test_the_deviation_that_is_told_is_that_of_least_squares():
    model = turning()
    (finding,) = [
        one for one in diagnose_sideslip(model).findings if "samples tell the angle" in one.text
    ]
    # The prior has no influence: the result uses 16 samples only.
    known = np.linalg.inv(plain_gramian(model, 20.0, 16))
    assert finding.data["angle"] == pytest.approx(math.sqrt(known[0, 0]), rel=1e-6)
    assert finding.data["samples"] == 16 and finding.data["speed"] == pytest.approx(20.0)


@pytest.mark.parametrize(("front", "rear"), [(1.2, 1.5), (1.6, 1.1), (2.0, 0.7)])
@pytest.mark.parametrize("factor", [1.0, 1e6])
def test_above_the_critical_speed_the_model_grows(front, rear, factor):
    fields = {
        **CAR,
        "front": front,
        "rear": rear,
        "mass": 1500.0 * factor,
        "yaw_inertia": 2500.0 * factor,
    }
    fields |= {"cornering_front": 80_000.0 * factor, "cornering_rear": 90_000.0 * factor}
    car = Vehicle(**fields)
    critical = critical_speed(car)
    stiff, arms = np.array([car.cornering_front, car.cornering_rear]), np.array([front, -rear])

    def grows(speed):
        return max(np.linalg.eigvals(
            [
                [-stiff.sum() / (car.mass * speed), -(stiff @ arms) / (car.mass * speed**2) - 1],
                [-(stiff @ arms) / car.yaw_inertia, -(stiff @ arms**2) / (car.yaw_inertia * speed)],
            ]
        ).real)  # fmt: skip

    if math.isinf(critical):
        assert stiff @ arms <= 0
        assert all(grows(speed) < 0 for speed in (1, 10, 100, 1000))
    else:
        assert grows(critical * 0.999) < 0 < grows(critical * 1.001)


EXTREME = {"mass": 1e300, "yaw_inertia": 1e-300, "front": 1e150, "rear": 1e-150}


@pytest.mark.parametrize(
    "model",
    [
        turning(vehicle=Vehicle(**{**CAR, **EXTREME})),
        turning(vehicle=Vehicle(**{**CAR, "cornering_front": 1e308, "cornering_rear": 1e-308})),
        turning(vehicle=Vehicle(**{**CAR, "mass": 1e-300}, tyre="saturating", friction=1e-300)),
        turning(yaw_rate_noise=1e-300, acceleration_noise=1e300),
        turning(initial_deviation=[1e-9, 1e200]),
        turning(10),
        turning(10, speed=[1.0] + [0.0] * 9),
        turning(10, noise=False, scale=(1, 0, 0, 0)),
        recorded(turning(10), times=np.array([*np.arange(9) * 5e-324, 1.0])),
        recorded(
            turning(), yaw_rate=np.full(401, 1e-160), lateral_acceleration=np.full(401, -1e-320)
        ),
        turning(scale=(50, 0, 100, 1)),
    ],
)
@pytest.mark.filterwarnings("error")
def test_wild_models_are_diagnosed(model):
    odd(model)
    odd(dataclasses.replace(model, training=(drive_of(model), drive_of(turning(13)))))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("lane-change", []),
        ("serpentine", ["above 4 m/s²"]),
        ("lane-change-mismatch", ["1.54 times as much as the believed one"]),
        ("limit", []),
        ("stop-and-go", []),
        ("missing", ["samples are missing"]),
        ("stale", ["repeat both measurements"]),
        ("biased", ["where the steering says straight ahead"]),
        ("noisy", ["yaw_rate is", "lateral_acceleration is", "outside of what they show"]),
        ("short", []),
        ("untrained", []),
    ],
)
def test_simulated_drives_are_told_what_was_done_to_them_and_no_more(name, words):
    found = odd(ct.load(f"sideslip/{name}"))
    assert len(found) == len(words)
    assert all(word in text for word, text in zip(words, found, strict=True)), found
