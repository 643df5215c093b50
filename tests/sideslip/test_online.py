"""Estimators that follow a drive sample by sample: the numbers of the backends, missing and late samples."""

import dataclasses
import math
import pickle
import time
import warnings

import numpy as np
import pytest
from sideslip.filters import GRIPPING, VEHICLE, answer, drawn, filtered, simulated

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances.sideslip import generate
from crosstrack.models.sideslip.data import UNKNOWN
from crosstrack.solvers.sideslip import online
from crosstrack.solvers.sideslip.kalman import KalmanFilter
from crosstrack.solvers.sideslip.unscented import UnscentedFilter

COLUMNS = ("times", "speed", "steering", "yaw_rate", "lateral_acceleration")


def samples(model):
    return np.column_stack([getattr(model.recording, name) for name in COLUMNS]).tolist()


def spinning():
    return generate(
        "serpentine", speed=18.0, samples=268, tyre="saturating", friction=0.35,
        mismatch={"friction": 0.95 / 0.35}, drivers=0,
    )  # fmt: skip


def followed(estimator, rows):
    return np.array([estimator.update(row) for row in rows])


def spiky():
    """Return a spin with spikes of one to four samples."""
    model = spinning()
    drive = {name: getattr(model.recording, name).copy() for name in COLUMNS}
    for k, count in ((30, 1), (60, 2), (100, 4)):
        drive["lateral_acceleration"][k : k + count] += 40.0
        drive["yaw_rate"][k + 10 : k + 10 + count] -= 5.0
    return dataclasses.replace(model, recording=type(model.recording)(**drive))


MODELS = [drawn(0, VEHICLE, n=200), drawn(1, GRIPPING, n=200), simulated(0, n=400), spinning()]


@pytest.mark.parametrize("model", MODELS, ids=["linear", "brush", "clean", "spin"])
@pytest.mark.parametrize("room", [8, 4096])
def test_all_numbers_are_those_of_the_backend(model, room, monkeypatch):
    monkeypatch.setattr(online, "_ROOM", room)  # 8: the gate drops samples often
    estimator = ct.prepare(model, "kalman-filter")
    result, covariance = [], []
    for row in samples(model):
        result.append(estimator.update(row))
        covariance.append(estimator.covariance)
        assert estimator.state[0] == pytest.approx(result[-1].sideslip, abs=1.6)
    offline, states = answer(model, KalmanFilter), filtered(model)
    angle, deviation, contradiction, _ = np.array(result).T
    np.testing.assert_allclose(angle, offline.point.sideslip, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(deviation, offline.point.deviation, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(covariance, states.filtered_covariance, rtol=1e-12, atol=1e-15)
    contradicted = offline.statistics.get("samples contradicted by kinematics", 0)
    assert np.count_nonzero(contradiction) == contradicted


@pytest.mark.parametrize(
    "model", [*MODELS, spiky()], ids=["linear", "brush", "clean", "spin", "spikes"]
)
def test_the_unscented_filter_is_that_of_the_backend(model):
    estimator = ct.prepare(model, "unscented-filter", history=0.2)
    angle, deviation, _, slides = followed(estimator, samples(model)).T
    offline = answer(model, UnscentedFilter)
    np.testing.assert_allclose(angle, offline.point.sideslip, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(deviation, offline.point.deviation, rtol=1e-12, atol=1e-12)
    assert bool(slides.any()) == bool(offline.point.grip_lost)
    for name, value in zip(("inverse friction", "bank"), estimator.state[2:4], strict=True):
        assert offline.statistics[name] == pytest.approx(value, rel=1e-12)
    assert np.linalg.eigvalsh(estimator.covariance).min() > 0.0


def test_the_gate_forgets_old_samples():
    model = simulated(0, n=400)
    estimator = ct.prepare(model)
    rows = np.array(samples(model))
    rows[:, 0] = 0.1 * np.arange(400)
    for k in range(60):
        followed(estimator, np.add(rows, [40.0 * k, 0, 0, 0, 0]))
    assert len(estimator._track.times) == online._ROOM
    assert len(pickle.dumps(estimator)) < 2e6


def short_loop():
    """Take about 12 microseconds on the machine of the page's tables."""
    x = 0.0
    for _ in range(400):
        x = 0.5 * x + 1.0


@pytest.mark.parametrize("backend", ["kalman-filter", "unscented-filter"])
def test_an_update_takes_less_than_twenty_microseconds(backend):
    """A ratio, because a busy machine doubles both times."""
    estimator = ct.prepare(MODELS[2], backend)
    rows = np.array(samples(MODELS[2]))
    updates, loops = [], []
    for k in range(10):
        for row in np.add(rows, [8.0 * k, 0, 0, 0, 0]).tolist():
            begin = time.thread_time_ns()
            estimator.update(row)
            middle = time.thread_time_ns()
            short_loop()
            updates.append(middle - begin)
            loops.append(time.thread_time_ns() - middle)
    assert np.median(updates) < 20.0 / 12.0 * np.median(loops)


def test_a_missing_sensor_leaves_the_other():
    model = simulated(1, n=400)
    rows = np.array(samples(model))
    whole = followed(ct.prepare(model), rows.tolist())
    for column, noise in ((3, "yaw_rate_noise"), (4, "acceleration_noise")):
        dead = rows.copy()
        dead[:, column] = math.nan
        result = followed(ct.prepare(model), dead.tolist())
        # A sensor of infinite noise says the same, up to rounding.
        deaf = dataclasses.replace(model, **{noise: 1e9})
        loud = filtered(deaf)
        np.testing.assert_allclose(result[:, 0], loud.filtered[:, 0], rtol=1e-6, atol=1e-9)
        assert (np.abs(result[:, 0] - model.truth) < 3.5 * result[:, 1]).mean() > 0.95
        assert np.median(result[:, 1]) > np.median(whole[:, 1])
    blind = rows.copy()
    blind[200:, 3:] = math.nan
    result = followed(ct.prepare(model), blind.tolist())
    np.testing.assert_array_equal(result[:200], whole[:200])
    assert result[-1, 1] > result[199, 1]  # predicted only
    assert (np.abs(result[:, 0] - model.truth) < 3.5 * result[:, 1]).mean() > 0.95


def test_a_missing_input_keeps_its_last_value():
    rows = samples(MODELS[2])[:50]
    kept = [list(row) for row in rows]
    for k in range(20, 25):
        kept[k][1:3] = kept[19][1:3]
    lost = [list(row) for row in kept]
    for k in range(20, 25):
        lost[k][1] = lost[k][2] = math.nan
    np.testing.assert_array_equal(
        followed(ct.prepare(MODELS[2]), kept), followed(ct.prepare(MODELS[2]), lost)
    )


def test_a_sample_may_be_a_dict():
    keys = ("time", *COLUMNS[1:])
    rows = samples(MODELS[2])[:30]
    named = [dict(zip(keys, row, strict=True)) for row in rows]
    del named[20]["yaw_rate"]
    rows[20][3] = math.nan
    np.testing.assert_array_equal(
        followed(ct.prepare(MODELS[2]), named), followed(ct.prepare(MODELS[2]), rows)
    )


def test_at_rest_the_angle_is_unknown_and_a_long_gap_starts_again():
    model = simulated(2, n=200)
    rows = samples(model)
    estimator = ct.prepare(model)
    followed(estimator, rows)
    assert estimator.update([4.5, 0.5, 0.0, 0.0, 0.0]).deviation == UNKNOWN
    late = [[row[0] + 100.0, *row[1:]] for row in rows]
    np.testing.assert_array_equal(followed(estimator, late), followed(ct.prepare(model), late))
    again = [[row[0] + 200.0, *row[1:]] for row in rows]  # while the vehicle moves
    np.testing.assert_array_equal(followed(estimator, again), followed(ct.prepare(model), again))
    # The inputs before a gap are those of another drive.
    before = pickle.dumps(estimator)
    for row in ([300.0, math.nan, 0.0, 0.0, 0.0], [300.0, 20.0, math.nan, 0.0, 0.0]):
        with pytest.raises(InvalidData, match="at the first sample and after a gap"):
            estimator.update(row)
    assert pickle.dumps(estimator) == before
    estimator.reset()
    np.testing.assert_array_equal(followed(estimator, rows), followed(ct.prepare(model), rows))


def test_late_samples_run_again():
    model = spinning()
    rows = samples(model)
    order = np.arange(len(rows))
    for k in range(20, 260, 20):
        order[k : k + 4] = order[k : k + 4][::-1]
    estimator = ct.prepare(model, history=0.3)
    for k in order:
        newest = max(estimator._time, rows[k][0])
        result = estimator.update(rows[k])
        assert estimator._time == newest
    expected = followed(ct.prepare(model), rows)
    np.testing.assert_array_equal(result, expected[-1])
    # The first samples may arrive in any order, and one may have been forgotten.
    estimator.reset()
    for row in (rows[1], rows[0], rows[2]):
        result = estimator.update(row)
    np.testing.assert_array_equal(result, expected[2])


def test_samples_that_are_too_late_are_refused():
    rows = samples(MODELS[2])
    estimator = ct.prepare(MODELS[2], history=0.1)
    before = followed(estimator, rows[:100])[-1]
    for row in (rows[0], rows[99], rows[98]):
        with pytest.raises(InvalidData, match="time must rise"):
            estimator.update(row)
    plain = ct.prepare(MODELS[2])
    followed(plain, rows[:100])
    with pytest.raises(InvalidData, match=r"time must rise, got .* history=0 s"):
        plain.update(rows[98])
    first, second = estimator.update(rows[100]), plain.update(rows[100])
    assert first == second != tuple(before)


def test_a_pickled_estimator_goes_on():
    model = spinning()
    rows = samples(model)
    estimator = ct.prepare(model, history=0.2)
    followed(estimator, rows[:150])
    copy = pickle.loads(pickle.dumps(estimator))
    np.testing.assert_array_equal(followed(estimator, rows[150:]), followed(copy, rows[150:]))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ((0, 20, 0, 0), "sample must be time, speed, .*, got"),
        ("abcde", "sample must be time"),
        ({"time": 0, "speeds": 3}, "sample must be time, .*, got"),
        ({"speed": 3}, "time must be finite, got nan"),
        (7, "sample must be time"),
        ("12345", "sample must be time, .*, got '12345'"),
        ({0.0, 20.0, 0.1, 0.2, 0.3}, "sample must be time"),
        ({0.0: 0, 20.0: 1, 0.1: 2, 0.2: 3, 0.3: 4}, "sample must be time"),
        (b"\0\x14\0\0\1", "sample must be time"),
        ((0, 10**400, 0, 0, 0), "sample must be time"),
        ((math.nan, 20, 0, 0, 0), "time must be finite, got nan"),
        ((math.inf, 20, 0, 0, 0), "time must be finite, got inf"),
        ((0, -1, 0, 0, 0), "speed must be 0 … 1000, got -1"),
        ((0, math.inf, 0, 0, 0), "speed must be 0 … 1000, got inf"),
        ((0, 20, 30, 0, 0), "steering must be -1.5708 … 1.5708, got 30"),
        ((0, 20, 0, 1e3, 0), "yaw_rate must be -100 … 100, got 1000"),
        ((0, 20, 0, 0, -1e6), "lateral_acceleration must be -1000 … 1000, got -1e"),
        ((0, math.nan, 0, 0, 0), "speed and steering must be known at the first sample"),
    ],
)
def test_bad_samples_are_refused(row, message):
    estimator = ct.prepare(MODELS[2])
    with pytest.raises(InvalidData, match=message):
        estimator.update(row)
    assert math.isfinite(estimator.update((0, 20, 0.01, 0, 0)).sideslip)


@pytest.mark.parametrize("size", [1e-100, 1e-3, 1e3])
def test_wild_samples_give_finite_estimates(size):
    estimator = ct.prepare(drawn(0))
    rng = np.random.default_rng(0)
    for k in range(300):
        u, d, w, a = size * rng.normal(size=4)
        row = (
            0.01 * k,
            min(abs(u), 1000.0),
            *np.clip([d, w, a], [-1.5, -99, -999], [1.5, 99, 999]),
        )
        result = estimator.update(row)
        assert all(map(math.isfinite, result)) and 0.0 <= result.deviation <= 2.0


@pytest.mark.parametrize("name", ["kalman-filter", "unscented-filter"])
def test_noises_that_overflow_cause_no_warning(name):
    model = dataclasses.replace(
        drawn(0), yaw_rate_noise=1e300, initial_deviation=(1e300, 1e-9), disturbance=(1e300, 1e-9)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = ct.prepare(model, name).update((0, 20, 0.01, 0, 0))
    assert all(map(math.isfinite, result))


def test_other_backends_and_options_are_refused():
    for name in ("rts-smoother", "ipopt"):
        with pytest.raises(UnsupportedOption, match=f"prepare takes .* got '{name}'"):
            ct.prepare(MODELS[2], name)
    with pytest.raises(UnsupportedOption, match=r"the option history .* got tolerance"):
        ct.prepare(MODELS[2], tolerance=1e-3)
    with pytest.raises(InvalidData, match="history must be"):
        ct.prepare(MODELS[2], history=-1.0)
