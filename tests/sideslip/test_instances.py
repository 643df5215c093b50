"""Instances of sideslip estimation: design of experiments, generator, catalogue and files."""

import csv
import itertools
import math

import numpy as np
import pytest
from scipy.stats import qmc

import crosstrack as ct
from crosstrack.errors import CrosstrackError, InvalidData, UnsupportedOption
from crosstrack.instances import entries, entry, export_formats, export_plan
from crosstrack.instances.sideslip import generate, read_recording
from crosstrack.instances.sideslip.drivers import (
    COLUMNS,
    FACTORS,
    HELD_OUT,
    RANGES,
    Design,
    design_drivers,
    uniform_design,
)
from crosstrack.instances.sideslip.listing import MISMATCH
from crosstrack.instances.sideslip.paper import TABLE_1, TABLE_2, TABLE_3
from crosstrack.instances.sideslip.paper_tables import table_2
from crosstrack.instances.sideslip.roads import RoadKind, road_of
from crosstrack.instances.sideslip.simulator import _aside
from crosstrack.instances.sideslip.vehicles import VEHICLE
from crosstrack.models.sideslip import SideslipEstimate
from crosstrack.models.sideslip.data import GRAVITY

OURS = [one for one in entries() if one.name.startswith("sideslip/")]


# -- the design ----------------------------------------------------------------------------------


def test_the_design_table():
    table = uniform_design()
    assert table.shape == (15, 8)
    for row, column in itertools.product(range(15), range(8)):
        assert table[row, column] % 15 == (row + 1) * FACTORS[column] % 15
    for column in table.T:
        assert sorted(column) == list(range(1, 16))
    assert [one for one in range(1, 15) if math.gcd(one, 15) == 1] == list(FACTORS)
    assert table[0].tolist() == list(FACTORS)
    assert set(table[14]) == {15}


def test_the_tables_of_the_paper():
    """Table 1 except one entry, and Table 2 except its last row."""
    paper = np.array(list(TABLE_1.rows.values()))
    assert np.argwhere(paper != uniform_design()).tolist() == [[0, 6]]
    assert (paper[0, 6], uniform_design()[0, 6]) == (12, 13)
    # By hand: 6 x 13 = 78 = 5 x 15 + 3 is row 6 of column 7, and 4 x 11 = 44 = 2 x 15 + 14 row 4 of column 6.
    assert (paper[5, 6], paper[3, 5]) == (3, 14)
    for key in TABLE_2.rows:
        found = table_2(key, None)
        printed, ours = (found[f"discrepancy, {one} columns"] for one in ("printed", "our"))
        assert printed == ours or (key == ("8",) and printed > ours)
        points = (
            uniform_design()[:, [found[name] - 1 for name in TABLE_2.columns if name in found]]
            - 0.5
        ) / 15
        assert ours == pytest.approx(qmc.discrepancy(points, method="CD"), abs=1e-9)
    assert tuple(k + 1 for k in COLUMNS) == TABLE_2.rows[("3",)][:3]


def test_drivers_of_a_design():
    def table(count, design, seed=0):
        drivers = design_drivers(count, design, np.random.default_rng(seed))
        assert {(one.correction, one.gain) for one in drivers} == {(0.15, 0.95)}
        return np.array([[getattr(one, name) for name in RANGES] for one in drivers])

    low, high = np.array(list(RANGES.values())).T
    uniform = table(15, Design.UNIFORM)
    # Each parameter has 15 equidistant levels, including both ends.
    for column, lower, upper in zip(uniform.T, low, high, strict=True):
        assert np.sort(column) == pytest.approx(np.linspace(lower, upper, 15), abs=1e-6)
    assert np.array_equal(uniform, table(15, Design.UNIFORM, seed=9))
    assert np.array_equal(uniform[:4], table(4, Design.UNIFORM))
    assert np.array_equal(uniform, table(40, Design.UNIFORM)[:15])
    drawn = table(200, Design.RANDOM)
    assert ((drawn >= low - 1e-6) & (drawn <= high + 1e-6)).all()
    assert ((drawn.min(axis=0) - low) / (high - low)).max() < 0.05
    assert not np.array_equal(drawn, table(200, Design.RANDOM, seed=1))
    # Driver 2 by hand: row 2 of columns 1, 3 and 4 is 2, 8, 14.
    assert uniform[1] == pytest.approx([0.05 + 0.1 / 14, 0.1, 0.75 + 0.45 * 13 / 14], abs=1e-6)
    held_out = np.array([getattr(HELD_OUT, name) for name in RANGES])
    assert ((held_out > low) & (held_out < high)).all()
    assert not (np.abs(uniform - held_out) < 1e-9).all(axis=1).any()


# -- roads ---------------------------------------------------------------------------------------


def course(road, x):
    return [_aside.py_func(road.along, road.aside, road.sine, at, 0)[0] for at in x]


def test_the_lane_change_of_equation_4_by_hand():
    road = road_of(RoadKind.LANE_CHANGE)
    u = road.speed
    assert u * 3.6 == pytest.approx(80)
    assert np.diff(road.along) / u == pytest.approx([2, 2, 2, 1, 2, 5, 3])
    # Straight to 4u, shift by 3.5 m to 6u, straight to 7u, back to 9u. At a quarter a shift is 3/16 - 2/64 = 5/32.
    places = np.array([3.9, 4.5, 5, 6, 6.5, 7, 8, 8.5, 9, 16])
    wanted = 3.5 * np.array([0, 5 / 32, 1 / 2, 1, 1, 1, 1 / 2, 5 / 32, 0, 0])
    assert course(road, u * places) == pytest.approx(wanted)


def test_the_serpentine_of_equation_7_by_hand():
    road = road_of(RoadKind.SERPENTINE)
    u, h = road.speed, 2.46 / 2
    assert u * 3.6 == pytest.approx(65)
    assert road.length / u == pytest.approx(15)
    # The printed last segment, and the segments before it that follow by continuity.
    for t in np.linspace(10, 12, 9):
        assert course(road, [u * t])[0] == pytest.approx(h * (-1 + math.sin(math.pi * (t + 1) / 2)))
    for t in np.linspace(4, 10, 19):
        assert course(road, [u * t])[0] == pytest.approx(2 * h * math.cos(math.pi * t / 2))
    for t in np.linspace(2, 4, 9):
        assert course(road, [u * t])[0] == pytest.approx(h * (1 + math.cos(math.pi * t / 2)))
    assert course(road, u * np.array([0, 2, 12, 14])) == pytest.approx([0, 0, 0, 0], abs=1e-12)
    longer = road_of(RoadKind.SERPENTINE, 5000.0)
    assert 5000.0 <= longer.length < 5050.0
    assert np.array_equal(longer.along[:6], road.along[:6])


# -- the generator -------------------------------------------------------------------------------


def test_a_seed_means_the_same_drives():
    one = generate(seed=5)
    assert one.digest == generate("lane-change", seed=5).digest != generate(seed=6).digest
    assert len({one.digest, generate(road="serpentine", seed=5).digest}) == 2
    # The number of training drives changes neither the estimated drive nor the first training drives.
    fewer = generate(seed=5, drivers=3)
    assert fewer.recording.data() == one.recording.data()
    assert [drive.data() for drive in fewer.training] == [d.data() for d in one.training[:3]]
    drawn = generate(seed=5, design="random")
    assert drawn.recording.data() == one.recording.data()
    assert drawn.training[0].data() != one.training[0].data()
    by_data = generate(seed=5, driver=HELD_OUT.data(), vehicle=VEHICLE.data(), name="mine")
    assert (by_data.digest, by_data.name) == (one.digest, "mine")
    assert not np.array_equal(
        generate(seed=5, driver={**HELD_OUT.data(), "gain": 0.9}).truth, one.truth
    )


def test_the_usual_instance():
    model = generate()
    assert model.recording.sideslip is None
    assert len(model.recording) == len(model.truth) == 341
    assert len(model.training) == 15
    assert model.recording.speed == pytest.approx(np.full(341, 80 / 3.6))
    assert {len(drive) for drive in model.training} == {341}
    steered = np.array([drive.steering for drive in (model.recording, *model.training)])
    assert len(np.unique(np.round(steered, 6), axis=0)) == 16
    most = np.degrees(np.abs([drive.sideslip for drive in model.training]).max(axis=1))
    assert most.min() > 0.3 and most.max() < 3.0
    assert np.degrees(np.abs(model.truth).max()) < most.max()


def test_noise_has_the_deviation_that_it_is_said_to_have():
    asked = {"drivers": 4, "samples": 20_000, "road": "serpentine", "disturbance": (1e-9, 1e-9)}
    quiet = generate(**asked, yaw_rate_noise=1e-9, acceleration_noise=1e-9)
    loud = generate(**asked, yaw_rate_noise=0.01, acceleration_noise=0.3)
    assert np.array_equal(quiet.truth, loud.truth)
    for one, two in zip(
        (quiet.recording, *quiet.training), (loud.recording, *loud.training), strict=True
    ):
        for name, deviation in (("yaw_rate", 0.01), ("lateral_acceleration", 0.3)):
            errors = getattr(two, name) - getattr(one, name)
            # Six standard errors of the mean and of the deviation.
            assert abs(errors.mean()) < 6 * deviation / math.sqrt(len(errors))
            assert errors.std() == pytest.approx(deviation, rel=6 / math.sqrt(2 * len(errors)))
    noisy = quiet.recording.yaw_rate, loud.recording.yaw_rate - quiet.recording.yaw_rate
    assert abs(np.corrcoef(*noisy)[0, 1]) < 0.05


def test_disturbances_have_the_variance_of_the_model():
    # Without tyre forces the yaw rate is constant between samples, and the angle decreases at that rate.
    weak = {**VEHICLE.data(), "cornering_front": 1e-6, "cornering_rear": 1e-6}
    disturbance = np.array([3e-5, 1e-5])
    model = generate(
        vehicle=weak, drivers=0, samples=5000, period=0.02, disturbance=disturbance,
        yaw_rate_noise=1e-12, acceleration_noise=1e-12,
    )  # fmt: skip
    yaw_rate = model.recording.yaw_rate
    jumps = np.stack([np.diff(model.truth) + 0.02 * yaw_rate[:-1], np.diff(yaw_rate)])
    deviation = jumps.std(axis=1) / math.sqrt(0.02)
    assert deviation == pytest.approx(disturbance, rel=6 / math.sqrt(2 * 4999))
    assert abs(np.corrcoef(jumps)[0, 1]) < 6 / math.sqrt(4999)
    assert (model.truth[0], yaw_rate[0]) == (0.0, pytest.approx(0.0, abs=1e-9))


def test_decibels():
    clean = generate(yaw_rate_noise=1e-9, acceleration_noise=1e-9)
    for decibels in (-10.0, 0.0, 20.0):
        model = generate(decibels=decibels)
        for name, noise in (
            ("yaw_rate", model.yaw_rate_noise),
            ("lateral_acceleration", model.acceleration_noise),
        ):
            power = np.mean(getattr(clean.recording, name) ** 2) / noise**2
            assert 10 * np.log10(power) == pytest.approx(decibels, abs=1e-3)
    # Training drives are unchanged.
    assert model.training[3].data() == generate().training[3].data()


def test_worse_sensors():
    plain = generate(drivers=1)
    shown = plain.recording
    biased = generate(drivers=1, bias=(0.02, -0.3)).recording
    assert biased.yaw_rate - shown.yaw_rate == pytest.approx(np.full(341, 0.02), abs=1e-8)
    assert biased.lateral_acceleration - shown.lateral_acceleration == pytest.approx(
        np.full(341, -0.3), abs=1e-8
    )
    fewer = generate(drivers=1, missing=0.3)
    kept = np.isin(shown.times, fewer.recording.times)
    assert 0.6 < kept.mean() < 0.8 and kept[0] and kept[-1]
    assert np.array_equal(fewer.truth, plain.truth[kept])
    for name in ("times", "speed", "steering", "yaw_rate", "lateral_acceleration"):
        assert np.array_equal(getattr(fewer.recording, name), getattr(shown, name)[kept])
    old = generate(drivers=1, stale=0.3)
    same = np.diff(old.recording.yaw_rate) == 0.0
    assert 0.2 < same.mean() < 0.4
    assert np.array_equal(same, np.diff(old.recording.lateral_acceleration) == 0.0)
    assert np.array_equal(old.recording.steering, shown.steering)
    fresh = np.concatenate([[True], ~same])
    assert np.array_equal(old.recording.yaw_rate[fresh], shown.yaw_rate[fresh])
    assert np.array_equal(old.truth, plain.truth)
    for other in (fewer, old):
        assert other.training[0].data() == plain.training[0].data()


def test_what_estimators_believe():
    model = generate(
        tyre="saturating", believed_tyre="linear", friction=0.7,
        mismatch={"mass": 1.3, "friction": 2.0},
    )  # fmt: skip
    assert model.vehicle.data() == {
        **VEHICLE.data(), "mass": VEHICLE.mass * 1.3, "friction": 1.4, "tyre": "linear",
    }  # fmt: skip
    right = generate(tyre="saturating", friction=0.7)
    assert np.array_equal(right.truth, model.truth)
    assert right.vehicle.data() == {**VEHICLE.data(), "friction": 0.7, "tyre": "saturating"}
    linear = generate(friction=0.7)
    assert np.array_equal(linear.truth, generate().truth)
    assert not np.array_equal(linear.truth, right.truth)


def test_friction_and_speed_over_time():
    asked = {"tyre": "saturating", "drivers": 2, "samples": 342}
    dry = generate(**asked, friction=0.9)
    falls = generate(**asked, friction=0.9, later_friction=0.5)
    apart = np.flatnonzero(dry.truth != falls.truth)
    assert apart[0] == 172  # one step after the friction changes
    assert falls.training[0].data() != dry.training[0].data()
    learnt_dry = generate(**asked, friction=0.9, later_friction=0.5, training_friction=0.9)
    assert learnt_dry.training[0].data() == dry.training[0].data()
    assert np.array_equal(learnt_dry.truth, falls.truth)
    assert learnt_dry.vehicle.friction == 0.9
    model = generate(speed=[[0, 20], [5, 0], [6, 0], [10, 10]], drivers=1)
    times = np.arange(201) * 0.05
    assert model.recording.speed == pytest.approx(np.interp(times, [0, 5, 6, 10], [20, 0, 0, 10]))
    assert model.training[0].speed == pytest.approx(model.recording.speed)
    # A slower drive on the same road takes longer.
    assert len(generate(speed=40 / 3.6, drivers=0).recording) == 681
    assert len(generate(samples=50).recording) == 50
    assert len(generate(samples=50).training[0]) == 341
    assert generate(period=0.01, drivers=0).recording.period == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"road": "motorway"}, "road must be one of lane-change, serpentine"),
        ({"seed": -1}, "seed must be >= 0"),
        ({"seed": 0.5}, "seed must be a whole number"),
        ({"driver": 7}, "driver must be an object, got 7"),
        ({"driver": {"preview": 1.0}}, "are missing in the data of a driver"),
        ({"driver": {**HELD_OUT.data(), "lag": 0}}, "lag must be >= 0.001 s"),
        ({"drivers": -1}, "drivers must be >= 0"),
        ({"drivers": 10**9}, "drivers must be <= 1000"),
        ({"design": "latin"}, "design must be one of uniform, random"),
        ({"vehicle": {"mass": 1.0}}, "are missing in the data of a vehicle"),
        ({"tyre": "magic"}, "tyre must be one of linear, saturating"),
        ({"believed_tyre": "magic"}, "tyre must be one of linear, saturating"),
        ({"mismatch": {"mas": 2.0}}, "did you mean 'mass'"),
        ({"mismatch": {"tyre": 2.0}}, "mismatch has no parameter 'tyre'"),
        ({"mismatch": {"mass": -1.0}}, "must be > 0"),
        ({"friction": 0}, "friction must be > 0"),
        ({"later_friction": -1}, "later_friction must be > 0"),
        ({"training_friction": math.nan}, "training_friction must be finite"),
        ({"speed": 0.0}, "speed must be >= 0.1"),
        ({"speed": [[0, 10]]}, "at least two rows of time and speed"),
        ({"speed": [[1, 10], [2, 10]]}, "whose times begin at 0 and rise"),
        ({"speed": [[0, 10], [0, 11]]}, "whose times begin at 0 and rise"),
        ({"speed": [[0, 0.2], [20, 0.9]]}, "speed must reach 1 m/s somewhere"),
        ({"samples": 3}, "times must hold 10"),
        ({"samples": 10**9}, "samples must be <= 1000000"),
        ({"period": 0}, "period must be > 0"),
        ({"period": 3.0}, "period must be <= 2"),
        ({"period": 1e-9}, "period must leave at most 1000000 samples"),
        ({"disturbance": [0.1]}, "disturbance must have shape"),
        ({"disturbance": [0.1, -1]}, "must be >= 0"),
        ({"yaw_rate_noise": 0}, "yaw_rate_noise must be > 0"),
        ({"acceleration_noise": math.inf}, "acceleration_noise must be finite"),
        ({"decibels": 1e9}, "decibels must be <= 200"),
        ({"bias": [math.nan, 0]}, "bias.0. must be finite"),
        ({"bias": [1e3, 0]}, "yaw_rate.0. must be <= 100"),
        ({"missing": 1.0}, "missing must be <= 0.9"),
        ({"stale": -0.1}, "stale must be >= 0"),
        ({"known": "yes"}, "known must be true or false"),
        ({"tyre": "saturating", "friction": 0.25}, r"recording: the vehicle spins [\d.]+ s after"),
        (
            {"tyre": "saturating", "training_friction": 0.1},
            r"training\[\d+\]: the vehicle spins",
        ),
    ],
)  # fmt: skip
def test_the_generator_refuses(options, message):
    kind = UnsupportedOption if "parameter" in message or "mean" in message else InvalidData
    with pytest.raises(kind, match=message):
        generate(**options)


@pytest.mark.parametrize("seed", range(12))
def test_wild_instances_are_valid_or_refused(seed):
    rng = np.random.default_rng(seed)
    knots = np.sort(rng.uniform(0, 40, 6))
    knots[0] = 0.0
    parts = {name: 10.0 ** rng.uniform(-1, 1) for name in ("mass", "yaw_inertia")}
    car = {**VEHICLE.data(), **{key: VEHICLE.data()[key] * by for key, by in parts.items()}}
    try:
        model = generate(
            str(rng.choice(["lane-change", "serpentine"])), seed=seed, drivers=2, vehicle=car,
            speed=np.stack([knots, rng.choice([0.0, 0.5, 0.999, 5.0, 60.0], 6) + 5.0 * (knots == 0)], 1),
            tyre=str(rng.choice(["linear", "saturating"])), friction=float(10 ** rng.uniform(-1, 0)),
            decibels=float(rng.uniform(-20, 60)), missing=0.5, stale=0.5, bias=(0.1, 1.0),
        )  # fmt: skip
    except CrosstrackError as error:
        assert "spins" in str(error) or "no gap" in str(error)  # noqa: PT017 - any of both is right
        return
    assert np.isfinite(model.truth).all()
    assert np.abs(model.truth).max() < np.pi / 2
    assert ct.models.SideslipEstimation.from_dict(model.to_dict()).digest == model.digest


# -- the catalogue -------------------------------------------------------------------------------


def test_the_catalogue_says_what_it_holds():
    models = {one.name.partition("/")[2]: one.build() for one in OURS}
    assert len({model.digest for model in models.values()}) == len(OURS) == 16
    for road, (mean, deviation) in zip(
        ("lane-change", "serpentine"), TABLE_3.rows.values(), strict=True
    ):
        listed = entry(f"sideslip/{road}")
        assert listed.provenance == "completed"
        assert listed.published == {"mean": mean, "deviation": deviation, "source": "table 3"}
        right, off = models[road], models[f"{road}-mismatch"]
        assert right.recording.data() == off.recording.data()
        assert [drive.data() for drive in right.training] == [d.data() for d in off.training]
        for name, factor in MISMATCH.items():
            assert abs(factor - 1) == pytest.approx(0.3)
            assert getattr(off.vehicle, name) == getattr(right.vehicle, name) * factor


def test_wild_ones_are_wild():
    models = {one.name.partition("/")[2]: one.build() for one in OURS}
    for name, model in models.items():
        assert len(model.training) == (0 if name == "untrained" else 15)
        assert (model.truth is None) == (name == "unknown")
    # Near the limit the axle forces are close to their maximum.
    limit = models["limit"]
    forces = np.abs([d.lateral_acceleration for d in limit.training]).max() / (0.55 * GRAVITY)
    assert 0.7 < forces < 1.05
    ice = models["ice"]
    assert ice.vehicle.friction == pytest.approx(0.9)
    assert 0.8 < np.abs(ice.recording.lateral_acceleration).max() / (0.2 * GRAVITY) < 1.1
    believed = generate(tyre="saturating", friction=0.9, speed=16.0, drivers=0)
    assert np.degrees(np.abs(ice.truth - believed.truth).max()) > 0.3
    halted = models["stop-and-go"].recording
    assert (halted.speed == 0.0).sum() >= 40
    assert halted.moving.mean() > 0.7
    assert np.diff(models["missing"].recording.times).max() > 0.12
    assert np.abs(models["noisy"].recording.yaw_rate).max() > 0.3
    assert len(models["short"].recording) == 50
    assert len(models["long"].recording) == 10_000
    assert len(models["long"].training[0]) == 301
    # The serpentine continues beyond its usual length.
    assert np.degrees(np.abs(models["long"].truth[-500:]).max()) > 0.3


# -- files ---------------------------------------------------------------------------------------


def test_export(tmp_path):
    model = ct.load("sideslip/short")
    count = len(model.recording)
    plan = SideslipEstimate(np.linspace(-0.1, 1 / 3, count), np.full(count, 1e-3))
    assert list(export_formats(model)) == ["csv"]
    file = export_plan(model, plan, tmp_path / "a.csv")
    with file.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["deviation [rad]"]) for row in rows] == [1e-3] * count
    # The file is a recording of the drive with the estimate as angle, exact to the last digit.
    back = read_recording(file)
    assert back.data() == {**model.recording.data(), "sideslip": plan.sideslip.tolist()}
    with pytest.raises(InvalidData, match="sideslip must have 50 entries, one per sample, got 49"):
        export_plan(model, SideslipEstimate(np.zeros(49), np.zeros(49)), tmp_path / "b.csv")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
