"""Estimators that learn from drives, compared with reference implementations."""

import math
from dataclasses import replace

import numpy as np
import pytest

from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.instances.sideslip.generator import generate
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording
from crosstrack.solvers import Control, Limit, Request, Termination, find_backend
from crosstrack.solvers.sideslip import learning
from crosstrack.solvers.sideslip.gates import apply_gates, small_angle_error
from crosstrack.solvers.sideslip.learning import (
    KernelRegression,
    StraightLine,
    TrainingSet,
    Window,
    training_set,
)
from crosstrack.solvers.sideslip.regression import _noise_ratio

VEHICLE = {
    "mass": 1500, "yaw_inertia": 2500, "front": 1.2, "rear": 1.5,
    "cornering_front": 8e4, "cornering_rear": 1e5,
}  # fmt: skip
LEARNING = ["grnn", "linear-regression", "kalman-grnn", "smoother-grnn"]


def drive(seed, samples=80, *, noise=1.0, period=0.05, curved=0.0, **fields):
    """Return a drive whose angle depends on the previous measurements, with noise."""
    rng = np.random.default_rng(seed)
    times = period * np.arange(samples)
    pace, size, phase = rng.uniform(1, 2), rng.uniform(0.1, 0.3), rng.uniform(0, 6)
    turn = size * np.sin(pace * times + phase)
    push = 20 * size * np.sin(pace * times + phase + 0.3)
    angle = 0.05 * np.roll(push, 1) / 20 - 0.1 * np.roll(turn, 1) + curved * np.roll(turn, 1) ** 2
    angle[0] = 0.0
    given = {
        "times": times,
        "speed": np.full(samples, 20.0),
        "steering": 0.1 * turn,
        "yaw_rate": turn + noise * rng.normal(0, 0.002, samples),
        "lateral_acceleration": push + noise * rng.normal(0, 0.05, samples),
        "sideslip": angle,
    }
    return Recording(**{**given, **fields})


def problem(recording, training, **fields):
    return SideslipEstimation(
        vehicle=VEHICLE,
        recording=replace(recording, sideslip=None),
        training=training,
        truth=recording.sideslip,
        **fields,
    )


def estimate(name, model, control=None, **own):
    """Return the answer of an estimator, run in this process."""
    backend = find_backend(name)
    control = control or Control()
    request = Request(options=backend.checked_options(own), control=control)
    return backend.run(model.blinded(), request)


def scaled(features, others):
    """Return `others` in deviations of the features, without constant ones."""
    varies = np.ptp(features, axis=0) > 0
    middle, size = features[:, varies].mean(axis=0), features[:, varies].std(axis=0)
    return (others[:, varies] - middle) / size


def plain_mean(places, values, place, width):
    """Return weighted mean and spread at a point from the definition. Weights must not vanish."""
    weights = [math.exp(-(math.dist(one, place) ** 2) / (2 * width**2)) for one in places]
    mean = np.average(values, weights=weights)
    spread = np.average((values - mean) ** 2, weights=weights)
    return mean, spread


def some_examples(seed, count=60, features=3, drives=4):
    rng = np.random.default_rng(seed)
    found = rng.normal(size=(count, features)) * 10.0 ** rng.integers(-3, 4, features)
    return TrainingSet(found, rng.normal(size=count), np.sort(rng.integers(0, drives, count)))


# -- features --------------------------------------------------------------------------------------


@pytest.mark.parametrize("inputs", [False, True])
@pytest.mark.parametrize("ahead", [0, 1, 3])
def test_features_are_the_samples_before(ahead, inputs):
    one = drive(0, 30)
    found = Window(0.05, 4, ahead, inputs).features(one)
    signals = [one.yaw_rate, one.lateral_acceleration]
    signals += [one.speed, one.steering] if inputs else []
    for k in range(30):
        before = [max(k - ahead - lag, 0) for lag in range(4)]
        assert found[k] == pytest.approx(np.concatenate([signal[before] for signal in signals]), abs=1e-12)  # fmt: skip


def test_missing_samples_shift_no_feature():
    one = drive(1, 60)
    straight = replace(one, yaw_rate=one.times, lateral_acceleration=-2 * one.times)
    kept = np.array([0, 1, 2, 7, 8, 9, 20, 21, 40, 41, 42, 59])
    few = Recording(
        **{
            name: getattr(straight, name)[kept]
            for name in (
                "times", "speed", "steering", "yaw_rate", "lateral_acceleration", "sideslip",
            )
        }
    )  # fmt: skip
    window = Window(0.05, inputs=False)
    assert window.features(few) == pytest.approx(window.features(straight)[kept], abs=1e-12)


def test_standstill_teaches_nothing():
    speed = np.where(np.arange(80) < 30, 0.2, 20.0)
    one, two = drive(2), drive(3, speed=speed, sideslip=np.where(speed > 1, drive(3).sideslip, 1.5))
    found = training_set([one, two], Window(0.05))
    assert len(found.angles) == 80 + 50
    assert np.abs(found.angles).max() < 0.2
    assert np.bincount(found.drives).tolist() == [80, 50]


def test_a_single_drive_is_split_into_parts_of_at_least_fifteen_seconds():
    found = training_set([drive(4, 11)], Window(0.05))
    assert found.drives.tolist() == [0] * 5 + [1] * 6
    counts = [np.bincount(training_set([drive(4, n)], Window(0.05)).drives) for n in (901, 4000)]
    assert [len(count) for count in counts] == [3, 5]
    assert np.ptp(counts[0]) == 1


# -- kernel regression -----------------------------------------------------------------------------


@pytest.mark.parametrize("width", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("seed", range(3))
def test_kernels_are_the_plain_double_loop(seed, width):
    known = some_examples(seed)
    learned = KernelRegression(known, width)
    asked = some_examples(seed + 100, 20).features
    asked = asked / asked.std(axis=0) * known.features.std(axis=0)
    values, _, _ = learned(asked)
    places, there = scaled(known.features, known.features), scaled(known.features, asked)
    plain = [plain_mean(places, known.angles, place, width) for place in there]
    assert values == pytest.approx([mean for mean, _ in plain], rel=1e-9, abs=1e-12)


def test_the_network_of_the_paper_by_hand():
    """Examples at (0, 0), (3, 4) and (6, 8), evaluated at (0, 0) with sigma = 5: weights 1, e^-1/2, e^-2."""
    features = np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]])
    known = TrainingSet(features, np.array([0.1, 0.2, 0.4]), np.array([0, 1, 2]))
    # Variances are 6 and 32/3: the width is in units of their root mean square, and 3 and 4 keep their ratio.
    unit = math.sqrt((6 + 32 / 3) / 2)
    values, _, _ = KernelRegression(known, 5 / unit, scaling=False)(features[:1])
    one, two = math.exp(-0.5), math.exp(-2)
    assert values[0] == pytest.approx((0.1 + 0.2 * one + 0.4 * two) / (1 + one + two))
    # Scaled, both coordinates are 0, 1.2247 and 2.4495: squared distances 3 and 12.
    values, _, _ = KernelRegression(known, 1.0)(features[:1])
    one, two = math.exp(-1.5), math.exp(-6)
    assert values[0] == pytest.approx((0.1 + 0.2 * one + 0.4 * two) / (1 + one + two))


def test_the_network_scales_nothing_unless_asked():
    one = problem(drive(0), [drive(1), drive(2)])
    window = Window(0.05)
    for own, scaling in (({}, False), ({"scaling": True}, True)):
        learned = KernelRegression(training_set(one.training, window), scaling=scaling)
        values, _, _ = learned(window.features(one.recording))
        assert estimate("grnn", one, **own).point.sideslip == pytest.approx(values, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_left_out_drives_by_brute_force(seed):
    """Include the claimed deviation: spread and validation error, with 95 % within two deviations."""
    known = some_examples(seed)
    learned = KernelRegression(known, 0.8)
    places = scaled(known.features, known.features)
    found = []
    for place, drive_ in zip(places, known.drives, strict=True):
        others = known.drives != drive_
        found.append(plain_mean(places[others], known.angles[others], place, 0.8))
    means, spreads = np.array(found).T
    off = np.abs(means - known.angles)
    error = math.sqrt((off**2).mean())
    assert learned.error == pytest.approx(error, rel=1e-9)
    factor = np.quantile(off / (2 * np.sqrt(spreads + error**2)), math.erf(math.sqrt(2)))
    within = np.array([plain_mean(places, known.angles, place, 0.8) for place in places])
    _, deviations, _ = learned(known.features)
    assert deviations == pytest.approx(factor * np.sqrt(within[:, 1] + error**2), rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_width_taken_is_the_best(seed):
    """No width of a fine grid reduces the error by more than 1 %."""
    known = training_set([drive(10 * seed + k) for k in range(4)], Window(0.05))
    learned = KernelRegression(known)
    grid = np.geomspace(learning.NARROWEST, learning.WIDEST, 60)
    least = min(KernelRegression(known, width).error for width in grid)
    assert learned.error <= 1.01 * least


def test_a_narrow_kernel_takes_the_nearest_and_a_wide_one_the_mean():
    known, asked = some_examples(5), some_examples(6, 40).features
    places, there = scaled(known.features, known.features), scaled(known.features, asked)
    apart = np.linalg.norm(places[None] - there[:, None], axis=2)
    narrow, _, _ = KernelRegression(known, 1e-6)(asked)
    assert narrow == pytest.approx(known.angles[apart.argmin(axis=1)], abs=1e-12)
    wide, _, _ = KernelRegression(known, 1e6)(known.features)
    assert wide == pytest.approx(np.full(len(wide), known.angles.mean()), abs=1e-9)


def test_ties_are_shared_evenly():
    """Equal measurements with different angles give their mean for any kernel width."""
    features = np.repeat([[0.0, 1.0], [1.0, 0.0]], 6, axis=0)
    known = TrainingSet(features, np.tile([0.1, 0.2, 0.3], 4), np.tile([0, 1], 6))
    values, deviations, near = KernelRegression(known, 1e-6)(np.array([[0.0, 1.0], [1.0, 0.0]]))
    assert values == pytest.approx([0.2, 0.2])
    assert (deviations >= 0.05 - 1e-12).all()  # an error of 0.1 is within two deviations
    assert near.tolist() == [1, 1]


def test_blocks_change_nothing(monkeypatch):
    known = training_set([drive(k) for k in range(3)], Window(0.05))
    asked = Window(0.05).features(drive(9))
    whole = KernelRegression(known, 0.2)(asked)
    monkeypatch.setattr(learning, "BLOCK", 1)
    parts = KernelRegression(known, 0.2)(asked)
    assert parts[0] == pytest.approx(whole[0], abs=1e-12)
    assert parts[1] == pytest.approx(whole[1], rel=1e-9)


def test_few_are_left_out_of_many(monkeypatch):
    """Examples come evenly from all drives, or from some if there are too many drives."""
    monkeypatch.setattr(learning, "MOST_LEFT_OUT", 20)
    drives = np.repeat(np.arange(4), 50)
    out = learning.left_out(drives)
    assert np.bincount(drives[out]).tolist() == [5, 5, 5, 5]
    assert len(np.unique(out)) == len(out)
    many = np.repeat(np.arange(100), 3)
    assert 10 <= len(np.unique(many[learning.left_out(many)])) <= 20


@pytest.mark.parametrize("width", [None, 1e-6, 0.1, 1e6])
def test_far_from_all_examples_nothing_is_claimed_to_be_known(width):
    known = training_set([drive(k) for k in range(4)], Window(0.05, inputs=False))
    learned = KernelRegression(known, width)
    usual, spread = np.median(learned(known.features)[1]), known.angles.std()
    for away in (1e2, 1e6):
        values, deviations, near = learned(known.features[::20] * away)
        assert np.isfinite(values).all()
        assert (np.abs(values) <= np.abs(known.angles).max() + 1e-12).all()
        assert (deviations >= 0.99 * spread).all()
        assert width == 1e6 or (near <= 0.1).all()
    assert width == 1e6 or usual < 0.7 * spread


@pytest.mark.parametrize("fields", [{}, {"mismatch": {"mass": 1.3}}])
def test_the_residual_is_what_the_filter_leaves(fields):
    """Compare with the filter on each drive and a kernel regression on its errors."""
    model = generate(seed=1, drivers=4, samples=120, **fields)
    found = estimate("kalman-grnn", model).point

    def filtered(recording):
        alone = SideslipEstimation(
            vehicle=model.vehicle, recording=replace(recording, sideslip=None)
        )
        point = estimate("kalman-filter", alone).point
        # The correction learns the error of small angles, which the filter adds to its deviation.
        return replace(point, deviation=np.sqrt(point.deviation**2 - small_angle_error(alone) ** 2))

    here, there = filtered(model.recording), [filtered(one) for one in model.training]
    left = [
        replace(one, sideslip=one.sideslip - own.sideslip)
        for one, own in zip(model.training, there, strict=True)
    ]
    window = Window(0.05)
    learned = KernelRegression(training_set(left, window))
    error, deviation, near = learned(window.features(model.recording))
    assert found.sideslip == pytest.approx(here.sideslip + near * error, abs=1e-12)
    usual = np.median(np.concatenate([one.deviation for one in there]))
    unsure = np.maximum(here.deviation / usual, 1)
    claim = deviation * unsure
    gated = apply_gates(model, found.sideslip, claim, learned.spread, history=True)
    assert found.deviation == pytest.approx(gated.deviation, rel=1e-9)
    assert gated.deviation[~gated.outside] == pytest.approx(claim[~gated.outside])


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"mismatch": {"mass": 1.3, "cornering_front": 0.7, "cornering_rear": 0.7}},
        {"tyre": "saturating", "friction": 0.6, "believed_tyre": "linear"},
        {"decibels": -10},
    ],
)
def test_the_filter_that_learned_is_no_worse_than_either(fields):
    """By more than a tenth."""
    names = ("kalman-grnn", "kalman-filter", "grnn")
    errors = np.array([
        [model.verify(estimate(name, model).point).objective for name in names]
        for model in (generate(seed=seed, drivers=8, **fields) for seed in range(2))
    ])  # fmt: skip
    both, filter_, kernels = np.median(errors, axis=0)
    assert both <= 1.1 * min(filter_, kernels)


# -- least squares ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_line_is_that_of_least_squares(seed):
    known, asked = some_examples(seed), some_examples(seed + 50, 10).features
    values, _ = StraightLine(known)(asked)
    rows = np.column_stack([np.ones(60), known.features])
    weights = np.linalg.lstsq(rows, known.angles)[0]
    assert values == pytest.approx(np.column_stack([np.ones(10), asked]) @ weights, rel=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_the_line_without_each_drive_by_brute_force(seed):
    known = some_examples(seed)
    learned = StraightLine(known)
    rows = np.column_stack([np.ones(60), known.features])
    off, leverage = np.zeros((2, 60))
    for one in range(4):
        out = known.drives == one
        weights = np.linalg.lstsq(rows[~out], known.angles[~out])[0]
        off[out] = np.abs(rows[out] @ weights - known.angles[out])
        normal = np.linalg.inv(rows[~out].T @ rows[~out])
        leverage[out] = ((rows[out] @ normal) * rows[out]).sum(axis=1)
    error = math.sqrt((off**2).mean())
    assert learned.error == pytest.approx(error, rel=1e-8)
    each = 60 / 4  # samples of a drive
    ratios = off / (2 * error * np.sqrt(1 + each * leverage))
    factor = np.quantile(ratios, math.erf(math.sqrt(2)))
    here = ((rows @ np.linalg.inv(rows.T @ rows)) * rows).sum(axis=1)
    claimed = factor * error * np.sqrt(1 + each * here)
    assert learned(known.features)[1] == pytest.approx(claimed, rel=1e-8)


def test_a_line_through_tied_and_constant_features():
    """A repeated and a constant feature do not change the estimate."""
    known = some_examples(7)
    doubled = np.column_stack([known.features, known.features[:, 1], np.full(60, 3.7)])
    plain, claimed = StraightLine(known)(known.features)
    values, deviations = StraightLine(known._replace(features=doubled))(doubled)
    assert values == pytest.approx(plain, abs=1e-9)
    assert deviations == pytest.approx(claimed, rel=1e-6)


# -- both, as backends -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", LEARNING)
def test_units_and_the_order_of_drives_change_nothing(name):
    training, asked = [drive(k, curved=0.2) for k in range(5)], drive(9, curved=0.2)
    own = {"scaling": True} if name == "grnn" else {}
    first = estimate(name, problem(asked, training), **own).point

    def other(one):
        if name in ("kalman-grnn", "smoother-grnn"):  # the filter knows its units
            return one
        factor = {"yaw_rate": 57.3, "lateral_acceleration": 1e-4}
        return replace(one, **{key: getattr(one, key) * by for key, by in factor.items()})

    changed = problem(other(asked), [other(one) for one in reversed(training)])
    again = estimate(name, changed, **own).point
    # The kernel width depends on single-precision sums, and so on their order and the platform.
    assert again.sideslip == pytest.approx(first.sideslip, abs=1e-7)
    # Other units contradict kinematics, so the claimed deviation is compared for the order only.
    again = estimate(name, problem(asked, training[::-1]), **own).point
    assert again.deviation == pytest.approx(first.deviation, rel=1e-5)


@pytest.mark.parametrize("name", LEARNING)
def test_left_and_right_are_alike(name):
    def mirrored(one):
        return replace(
            one,
            **{
                key: -getattr(one, key)
                for key in ("steering", "yaw_rate", "lateral_acceleration", "sideslip")
            },
        )

    training, asked = [drive(k, curved=0.2) for k in range(5)], drive(9, curved=0.2)
    first = estimate(name, problem(asked, training)).point
    again = estimate(name, problem(mirrored(asked), [mirrored(one) for one in training])).point
    assert again.sideslip == pytest.approx(-first.sideslip, abs=1e-8)
    assert again.deviation == pytest.approx(first.deviation, rel=1e-6)


def wild_training():
    still = np.concatenate([np.zeros(70), np.full(10, 3.0)])
    return {
        "ten samples": [drive(0, 10)],
        "one drive": [drive(0)],
        "the same drive twice": [drive(0), drive(0)],
        "constant": [drive(k, yaw_rate=np.zeros(80), sideslip=np.full(80, 0.01)) for k in range(3)],
        "all zero": [
            drive(k, yaw_rate=np.zeros(80), lateral_acceleration=np.zeros(80),
                  sideslip=np.zeros(80)) for k in range(2)
        ],
        "two values": [drive(k, yaw_rate=np.arange(80) % 2 * 0.1) for k in range(3)],
        "ratio of 1e6": [drive(k, yaw_rate=drive(k).yaw_rate * 1e-6) for k in range(3)],
        "mostly at rest": [drive(0, speed=still), drive(1, speed=still)],
        "one sample in motion": [drive(0, speed=np.where(np.arange(80) == 40, 5.0, 0.0)), drive(1)],
        "ten samples in motion, each of a drive": [
            drive(k, speed=np.where(np.arange(80) == 8 * k, 5.0, 0.0)) for k in range(10)
        ],
        "another period": [drive(0, period=0.01), drive(1, period=0.2)],
        "noise of 10 dB": [drive(k, noise=60.0) for k in range(3)],
        "an outlier": [drive(0), drive(1, yaw_rate=np.where(np.arange(80) == 9, 99.0, 0.0))],
    }  # fmt: skip


@pytest.mark.sample(2)
@pytest.mark.parametrize("case", wild_training())
@pytest.mark.parametrize("name", LEARNING)
@pytest.mark.parametrize("inputs", [pytest.param(False, marks=pytest.mark.slow), True])
def test_wild_drives_give_angles(name, case, inputs):
    steps = np.random.default_rng(0).choice([0.01, 0.05, 1.9], 79)
    asked = drive(9, times=np.concatenate([[0.0], np.cumsum(steps)]))
    model = problem(asked, wild_training()[case])
    answer = estimate(name, model, inputs=inputs)
    assert answer.termination is Termination.FEASIBLE
    assert "samples without an estimate" not in answer.statistics
    assert model.verify(answer.point).ok
    assert (answer.point.deviation >= 0).all()


@pytest.mark.parametrize("name", LEARNING)
def test_claims_hold_on_other_drives(name):
    """About 95 % of the errors on similar drives are within two claimed deviations."""
    shares = []
    for seed in range(8):
        training = [drive(100 * seed + k, curved=0.1) for k in range(10)]
        model = problem(drive(100 * seed + 99, curved=0.1), training)
        shares.append(model.coverage(estimate(name, model).point))
    assert 0.90 <= np.mean(shares) <= 0.99


def test_kernels_follow_what_no_line_does():
    better = []
    for seed in range(6):
        training = [drive(100 * seed + k, curved=1.0) for k in range(12)]
        model = problem(drive(100 * seed + 99, curved=1.0), training)
        kernels, line = (
            model.verify(estimate(name, model).point).objective
            for name in ("grnn", "linear-regression")
        )
        better.append(kernels / line)
    assert np.median(better) < 0.5


@pytest.mark.parametrize(("name", "most"), [("grnn", 5.5), ("linear-regression", 3.0)])
def test_claims_are_wider_where_kinematics_contradicts(name, most):
    """A sensor bias that is absent in training widens the claimed deviation."""
    for bias, wider in (((0.0, 0.0), False), ((0.02, 0.3), True)):
        model = generate(seed=1, drivers=8, bias=bias)
        answer = estimate(name, model)
        assert ("yaw rate" in answer.message) is wider
        assert model.coverage(answer.point) >= 0.9
        if wider:
            off = np.abs(answer.point.sideslip - model.truth)
            assert off.mean() <= answer.point.deviation.mean() <= most * off.mean()


@pytest.mark.parametrize("name", LEARNING)
def test_nothing_to_learn_from_is_refused(name):
    resting = drive(0, speed=np.where(np.arange(80) < 9, 5.0, 0.0))
    for training, reason in (([], "no training"), ([resting], "9 samples in motion")):
        model = problem(drive(0), training)
        assert reason in find_backend(name).refuses(model)
        with pytest.raises(UnsupportedFormulation, match=reason):
            estimate(name, model)


@pytest.mark.parametrize(
    ("name", "own"),
    [
        ("grnn", {"width": 0.0}),
        ("grnn", {"lags": 0}),
        ("grnn", {"ahead": -1}),
        ("grnn", {"scaling": 1}),
        ("linear-regression", {"width": 1.0}),
        ("linear-regression", {"inputs": 1}),
    ],
)
def test_bad_options_are_refused(name, own):
    with pytest.raises(UnsupportedOption):
        find_backend(name).checked_options(own)


def test_a_run_stopped_before_it_has_learned_returns_the_filtered_angles(monkeypatch):
    control = Control()

    def stop(*arguments):
        control.stop(Limit.TIME)

    monkeypatch.setattr(KernelRegression, "__call__", stop)
    model = problem(drive(0), [drive(1), drive(2)])
    answer = estimate("kalman-grnn", model, control)
    filtered = estimate("kalman-filter", model, Control())
    np.testing.assert_array_equal(answer.point.sideslip, filtered.point.sideslip)
    assert answer.limit is Limit.TIME and "before it had learned" in answer.message


def test_a_stopped_run_has_no_estimate():
    control = Control()
    control.stop(Limit.TIME)
    answer = estimate("grnn", problem(drive(0), [drive(1), drive(2)]), control)
    assert (answer.termination, answer.limit) == (Termination.NO_SOLUTION, Limit.TIME)


def test_a_run_stopped_before_the_filter_ends_returns_the_linear_regression():
    control = Control()
    control.stop(Limit.TIME)
    model = problem(drive(0), [drive(1), drive(2)])
    answer = estimate("kalman-grnn", model, control)
    line = estimate("linear-regression", model, Control())
    np.testing.assert_array_equal(answer.point.sideslip, line.point.sideslip)
    assert answer.limit is Limit.TIME and "linear regression" in answer.message


def test_training_drives_whose_noise_is_unknown_are_left_out_of_its_ratio():
    """The noise of a drive follows from at least a hundred third differences of regular samples."""
    recording, known, short = drive(0, 400), drive(1, 400), drive(2, 80)
    ratio = _noise_ratio(problem(recording, (known,)))
    assert 0.5 < ratio < 2.0
    assert _noise_ratio(problem(recording, (known, short))) == ratio
    assert _noise_ratio(problem(recording, (short,))) == 1.0
    assert _noise_ratio(problem(drive(0, 400, noise=9.0), (known, short))) > 3.0
