"""Sideslip estimation model: validation, hidden fields and error measures."""

import contextlib
import copy
import dataclasses
import itertools
import json
import math
import sys

import cloudpickle
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sideslip.drives import CAR, estimate, kinematic

import crosstrack as ct
from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.models import Model, SideslipEstimation
from crosstrack.models.sideslip import Recording, SideslipEstimate, Tyre, Vehicle
from crosstrack.solvers.sideslip.native import Estimate, SideslipBackend

cloudpickle.register_pickle_by_value(sys.modules[__name__])

#: Ten samples, the minimum of a recording.
SHORT = {
    "times": np.arange(10) * 0.1, "speed": np.full(10, 20.0), "steering": np.zeros(10),
    "yaw_rate": np.zeros(10), "lateral_acceleration": np.zeros(10),
}  # fmt: skip


def changed(name, place, value):
    """Return a column of the short recording with one entry replaced."""
    column = np.array(SHORT[name])
    column[place] = value
    return {name: column}


# -- validation ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        *(({name: 0}, rf"{name} must be > 0.*got 0", name) for name in CAR),
        *(({name: -1.0}, rf"{name} must be > 0.*got -1", name) for name in CAR),
        ({"mass": "1500"}, "mass must be a number, got '1500'", "mass"),
        ({"mass": math.inf}, "mass must be finite", "mass"),
        ({"yaw_inertia": None}, "yaw_inertia must be a number", "yaw_inertia"),
        ({"friction": 0}, "friction must be > 0, got 0", "friction"),
        ({"friction": math.nan}, "friction must be finite", "friction"),
        ({"tyre": "round"}, "tyre must be one of linear, saturating, magic-formula, got 'round'", "tyre"),
        ({"tyre": None}, "tyre must be one of", "tyre"),
    ],
)  # fmt: skip
def test_a_vehicle_that_cannot_be(fields, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        Vehicle(**{**CAR, **fields})
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        (changed("times", 3, 0.2), r"a sample twice: times\[3\] = 0.2 s after 0.2 s", "times"),
        (changed("times", 3, 0.05), r"a step back: times\[3\] = 0.05 s after 0.2 s", "times"),
        (
            changed("times", 9, 99.0),
            r"no gap above 2 s, got 98.2 s after times\[8\] = 0.8 s",
            "times",
        ),
        (changed("times", 4, math.nan), r"times\[4\] must be finite, got nan", "times"),
        ({"times": np.arange(9)}, r"times must hold 10 … 1000000 samples, got 9", "times"),
        ({"times": np.arange(1_000_001.0)}, "samples, got 1000001", "times"),
        ({"times": []}, "samples, got 0", "times"),
        ({"times": "now"}, "times must be an array of numbers, got 'now'", "times"),
        ({"times": np.arange(20).reshape(10, 2)}, r"times must have shape \(n,\)", "times"),
        ({"speed": np.ones(11)}, "speed has 11 entries where times has 10", "speed"),
        (changed("speed", 2, -0.1), r"speed\[2\] must be >= 0, got -0.1", "speed"),
        (
            {"speed": np.full(10, 0.99)},
            r"speed must reach 1 m/s somewhere, got at most 0.99",
            "speed",
        ),
        (changed("speed", 0, 1000.5), "speed must be <= 1000 m/s, got 1000.5", "speed"),
        (changed("steering", 1, 1.6), r"steering\[1\] must be <= 1.57", "steering"),
        (changed("steering", 1, -90), r"steering\[1\] must be >= -1.57", "steering"),
        (changed("yaw_rate", 9, 101), r"yaw_rate\[9\] must be <= 100", "yaw_rate"),
        (changed("lateral_acceleration", 9, -1e4), "must be >= -1000", "lateral_acceleration"),
        ({"lateral_acceleration": [True] * 10}, r"\[0\] must be a number", "lateral_acceleration"),
        ({"sideslip": np.full(10, 2.0)}, r"sideslip\[0\] must be <= 1.57", "sideslip"),
        ({"sideslip": np.zeros(4)}, "sideslip has 4 entries where times has 10", "sideslip"),
    ],
)
def test_a_recording_that_is_refused(fields, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        Recording(**{**SHORT, **fields})
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        ({"vehicle": 3}, "vehicle must be an object, got 3", "vehicle"),
        ({"vehicle": {"mass": 1.0}}, "keys 'yaw_inertia', .* missing in the data of a vehicle", "yaw_inertia"),
        ({"vehicle": {**CAR, "weight": 1}}, "unknown key 'weight' in the data of a vehicle", "weight"),
        ({"recording": None}, "recording must be an object", "recording"),
        ({"recording": {**SHORT, "sideslip": np.zeros(10)}}, "must not hold sideslip.*as truth", "recording"),
        ({"recording": {**SHORT, "speeds": 0}}, "unknown key 'speeds'.*did you mean 'speed'", "speeds"),
        ({"training": [SHORT]}, r"training\[0\] must hold sideslip", "training"),
        ({"training": SHORT}, "training must be a list", "training"),
        ({"training": [{**SHORT, "sideslip": np.zeros(10)}, 1]}, r"training\[1\] must be an object", "training[1]"),
        ({"disturbance": [0, 1]}, r"disturbance\[0\] must be >= 1e-09, got 0", "disturbance"),
        ({"disturbance": [1, 1, 1]}, r"disturbance must have shape \(2,\)", "disturbance"),
        ({"yaw_rate_noise": 0}, "yaw_rate_noise must be > 0 rad/s, got 0", "yaw_rate_noise"),
        ({"acceleration_noise": -1}, "acceleration_noise must be > 0 m/s²", "acceleration_noise"),
        ({"initial": [0, math.inf]}, r"initial\[1\] must be finite", "initial"),
        ({"initial_deviation": [0, 1]}, r"initial_deviation\[0\] must be >= 1e-09", "initial_deviation"),
        ({"truth": np.zeros(9)}, "truth has 9 entries where recording has 10", "truth"),
        ({"truth": np.full(10, 1.6)}, r"truth\[0\] must be <= 1.57", "truth"),
    ],
)  # fmt: skip
def test_a_model_that_is_refused(fields, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        SideslipEstimation(**{"vehicle": CAR, "recording": SHORT, **fields})
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (
            {"sideslip": [0.0] * 9, "deviation": [0.0] * 9},
            "must have 10 entries, one per sample, got 9",
        ),
        (
            {"sideslip": [0.0] * 10, "deviation": [0.0] * 9},
            "deviation has 9 entries where sideslip",
        ),
        ({"sideslip": [0.0] * 10, "deviation": [-1e-9] * 10}, r"deviation\[0\] must be >= 0"),
        ({"sideslip": [math.nan] * 10, "deviation": [0.0] * 10}, r"sideslip\[0\] must be finite"),
        ({"sideslip": [0.0] * 10}, "key 'deviation' is missing"),
        ([0.0] * 10, "an object with the keys sideslip, deviation, grip_lost, got"),
        (None, "there is no plan"),
        (3.0, "plan must be a SideslipEstimate"),
    ],
)
def test_a_plan_that_is_none(plan, message):
    model = SideslipEstimation(CAR, SHORT)
    with pytest.raises(InvalidData, match=message):
        ct.verify(model, plan)
    if isinstance(plan, dict) and len(plan) == 2 and len(plan["deviation"]) == 9:
        with pytest.raises(InvalidData, match=message):
            model.coverage(plan)


# -- copies, files and hidden fields -------------------------------------------------------------


def learner():
    """Return a model with every field set."""
    drive = {**SHORT, "sideslip": np.linspace(-0.1, 0.1, 10)}
    return kinematic(
        30, vehicle={**CAR, "tyre": "saturating", "friction": 0.3}, training=[drive, Recording(**drive)],
        disturbance=[1e-9, 1e-6], yaw_rate_noise=1e-9, acceleration_noise=1e6, initial=[0.1, -0.2],
        initial_deviation=[1e-9, 1e6], name="all",
    )  # fmt: skip


def test_json_gives_the_same_model_and_plan():
    model = learner()
    again = Model.from_json(model.to_json())
    assert again == model and again.name == "all" and again.digest == model.digest
    assert again.vehicle.tyre is Tyre.SATURATING
    assert again.truth.tolist() == model.truth.tolist()
    assert again.training[1].sideslip.tolist() == model.training[0].sideslip.tolist()
    plan = estimate(model.truth + 1e-17, 1e-300)
    read = model.plan_from_data(json.loads(json.dumps(model.plan_to_data(plan))))
    assert read.data() == plan.data()
    assert str(read) == "30 samples, at most 1.14°, deviation about 5.7e-299°"


def test_the_digest_tells_models_apart_and_copies_not():
    model = learner()
    nudged = model.truth.copy()
    nudged[3] += 1e-15
    others = [
        *(
            dataclasses.replace(model, **field)
            for field in (
                {"truth": None}, {"truth": nudged}, {"training": ()}, {"training": model.training[:1]},
                {"vehicle": CAR}, {"yaw_rate_noise": 1.0}, {"acceleration_noise": 1.0},
                {"disturbance": [1e-6, 1e-9]}, {"initial": [0, 0]}, {"initial_deviation": [1, 1]},
            )
        ),
        kinematic(30, noise=(1e-3, 0)),
    ]  # fmt: skip
    assert len({one.digest for one in (model, *others)}) == len(others) + 1
    for same in (
        copy.copy(model), copy.deepcopy(model), model.renamed("x"), model.blinded(),
        cloudpickle.loads(cloudpickle.dumps(model)), cloudpickle.loads(cloudpickle.dumps(model.blinded())),
    ):  # fmt: skip
        assert same.digest == model.digest


class Spy(SideslipBackend):
    """Backend that tries to read the truth."""

    name = "spy"

    def estimate(self, problem, request):
        with contextlib.suppress(HiddenData):
            return Estimate(problem.truth, problem.truth, message="read")
        nothing = np.zeros(len(problem.recording))
        return Estimate(nothing, nothing, message="nothing")


def test_backends_do_not_see_the_truth():
    model = learner()
    view = cloudpickle.loads(cloudpickle.dumps(model.blinded()))
    with pytest.raises(HiddenData, match="truth of model 'sideslip' is hidden"):
        view.truth  # noqa: B018
    for ask in (view.verify, view.coverage):
        with pytest.raises(HiddenData):
            ask(estimate(np.zeros(30)))
    assert view.describe() == model.describe()
    secret = model.truth.tobytes()
    assert secret in cloudpickle.dumps(model)
    assert secret not in cloudpickle.dumps(model.blinded())
    found = ct.solve(model, Spy())
    assert found.message == "nothing"
    assert found.primal_bound == model.verify(estimate(np.zeros(30))).objective
    with pytest.raises(UnsupportedOption, match="hides data from backends"):
        ct.solve(model, Spy(), isolate=False)


def test_what_describes_a_model():
    assert learner().describe() == "30 samples in 1.45 s, 2 drives to learn from, saturating tyres"
    short = SideslipEstimation(CAR, SHORT)
    assert short.describe() == "10 samples in 0.9 s, no drive to learn from, linear tyres"
    car = short.vehicle
    assert car.wheelbase == 2.7
    assert sum(car.loads) == pytest.approx(1500 * 9.80665)
    assert car.loads[0] * car.front == pytest.approx(car.loads[1] * car.rear)


# -- error measures ------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 1e-9, 0.001, -0.3])
def test_an_estimate_that_is_off_by_a_constant_has_that_error(offset):
    model = kinematic()
    checked = model.verify(estimate(model.truth + offset))
    assert checked.ok
    assert checked.objective == pytest.approx(math.degrees(abs(offset)), abs=1e-13)


def test_an_angle_beyond_a_right_one_is_no_angle():
    model = kinematic()
    for beyond, ok in ((-1e-3, True), (0.0, True), (1e-7, True), (1e-3, False), (1e200, False)):
        angles = np.zeros(201)
        angles[17] = -(np.pi / 2 + beyond)
        checked = model.verify(estimate(angles))
        assert checked.ok is ok
        assert checked.checks[0].where == "sample 17"
        assert bool(checked.within_tolerance) is (ok and beyond > 0)
    with pytest.raises(UnsupportedOption, match="tolerance"):
        model.verify(estimate(model.truth), tolerance=1.0)


def test_samples_at_rest_do_not_count():
    speed = np.full(201, 20.0)
    speed[50:100] = 0.999
    model = kinematic(speed=speed)
    angles = model.truth.copy()
    angles[50:100] = 1.5
    plan = estimate(angles, 1e-6)
    assert model.verify(plan).objective == 0.0
    assert model.coverage(plan) == 1.0
    assert model.distance(plan, estimate(model.truth)) == 0.0
    unknown = dataclasses.replace(model, truth=None)
    assert unknown.verify(plan).objective == unknown.verify(estimate(model.truth)).objective


def plain_kinematic_error(recording, angles):
    """Return the mean difference of changes over a second, sample by sample from the definition."""
    times = recording.times
    window = min(1.0, times[-1] - times[0])
    moving = recording.speed >= 1.0
    found = []
    for i in range(len(times)):
        ends = [j for j in range(i + 1, len(times)) if times[j] - times[i] >= window * (1 - 1e-9)]
        if not ends or not moving[i : ends[0] + 1].all():
            continue
        part = slice(i, ends[0] + 1)
        rate = (
            recording.lateral_acceleration[part] / recording.speed[part] - recording.yaw_rate[part]
        )
        measured = np.trapezoid(rate, times[part])
        found.append(abs(angles[ends[0]] - angles[i] - measured))
    return math.degrees(np.mean(found)) if found else None


@settings(max_examples=30, deadline=None)
@given(
    steps=st.lists(st.sampled_from([0.01, 0.05, 0.25, 1.0, 1.9]), min_size=9, max_size=60),
    halts=st.lists(st.integers(0, 60), max_size=4),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_kinematic_error_is_that_of_its_definition(steps, halts, seed):
    drawn = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    n = times.size
    speed = drawn.uniform(1.0, 40.0, n)
    speed[[k for k in halts if 0 < k < n]] = 0.0
    columns = (drawn.uniform(-0.5, 0.5, n), drawn.normal(size=n), drawn.normal(size=n) * 5)
    model = SideslipEstimation(CAR, Recording(times, speed, *columns))
    angles = drawn.uniform(-0.5, 0.5, n)
    expected = plain_kinematic_error(model.recording, angles)
    if expected is not None:
        assert model.verify(estimate(angles)).objective == pytest.approx(expected, rel=1e-9)


def test_a_consistent_record_has_no_kinematic_error():
    # The integral is exact if the rate of the angle is linear between samples.
    times = np.sort(np.random.default_rng(1).uniform(0, 20, 400))
    rate = np.interp(times, [0, 5, 9, 14, 20], [0, 0.05, -0.08, 0.03, 0])
    turn = 0.3 * np.sin(times)
    speed = 15 + 10 * np.cos(times / 3)
    angles = np.concatenate([[0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times))])
    record = Recording(times, speed, np.zeros(400), turn, speed * (rate + turn))
    model = SideslipEstimation(CAR, record)
    assert model.verify(estimate(angles)).objective < 1e-12
    # A constant error has no effect. A growing error contributes its rate.
    assert model.verify(estimate(angles + 0.2)).objective < 1e-12
    drift = model.verify(estimate(angles + 0.01 * times)).objective
    apart = np.searchsorted(times, times[times <= times[-1] - 1] + 1) - np.arange(
        (times <= times[-1] - 1).sum()
    )
    assert math.degrees(0.01) <= drift < math.degrees(0.012) and apart.min() > 1


@pytest.mark.parametrize("speed", [[1.0] + [0.0] * 9, [1.0, 1.0] + [0.0] * 8, [0.0, 1.0] * 5])
def test_records_that_hardly_move_have_an_error_that_is_a_number(speed):
    model = SideslipEstimation(CAR, {**SHORT, "speed": speed})
    angles = np.zeros(10)
    angles[1] = 0.1
    pair = math.degrees(0.1) if speed[:2] == [1.0, 1.0] else 0.0
    assert model.verify(estimate(angles)).objective == pytest.approx(pair)


def test_short_records_are_compared_as_a_whole():
    model = SideslipEstimation(CAR, SHORT)  # 0.9 s
    angles = np.full(10, 0.3)
    angles[-1] = 0.1
    assert model.verify(estimate(angles)).objective == pytest.approx(math.degrees(0.2))


def test_coverage_counts_what_lies_within_the_claim():
    model = kinematic()
    error = np.linspace(0, 3, 201) * np.where(np.arange(201) % 2, 1, -1)
    plan = estimate(model.truth + 0.001 * error, 0.001 * (1 + 1e-9))
    assert model.coverage(plan) == pytest.approx((np.linspace(0, 3, 201) <= 2).mean())
    assert model.coverage(plan, 1.0) == pytest.approx((np.linspace(0, 3, 201) <= 1).mean())
    assert model.coverage(estimate(model.truth, 0.0)) == 1.0
    assert model.coverage(model.plan_to_data(estimate(model.truth + 1e-6, 0.0))) == 0.0
    with pytest.raises(InvalidData, match="truth is not known"):
        dataclasses.replace(model, truth=None).coverage(plan)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.lists(st.floats(-10, 10), min_size=10, max_size=10), min_size=3, max_size=3))
def test_the_distance_is_a_metric(angles):
    model = SideslipEstimation(CAR, SHORT)
    one, two, three = (estimate(each) for each in angles)
    for a, b, c in itertools.permutations((one, two, three)):
        assert model.distance(a, a) == 0.0
        assert model.distance(a, b) == model.distance(b, a)
        assert (model.distance(a, b) == 0) == (a.sideslip.tolist() == b.sideslip.tolist())
        assert model.distance(a, c) <= (model.distance(a, b) + model.distance(b, c)) * (1 + 1e-12)
    plain = np.degrees(np.mean(np.abs(np.subtract(angles[0], angles[1]))))
    assert model.distance(one, two) == pytest.approx(plain)


def test_an_empty_estimate_says_so():
    assert str(SideslipEstimate([], [])) == "no samples"
    with pytest.raises(InvalidData, match="got 0"):
        kinematic().verify(SideslipEstimate([], []))
