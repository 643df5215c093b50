"""Recordings of measured drives in files: order of columns, units and error messages."""

import dataclasses
import json
import logging
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import write_model
from crosstrack.instances.sideslip import generate, read_recording, read_vehicle, write_vehicle
from crosstrack.instances.sideslip.vehicles import VEHICLE

#: Header with the columns in the order of DRIVE.
HEADER = "time [s],speed [m/s],steering [rad],yaw_rate [rad/s],lateral_acceleration [m/s²]"
#: Factors from each unit to the internal one.
UNITS = {
    "time": {"s": 1.0, "ms": 0.001, "us": 1e-6},
    "speed": {"m/s": 1.0, "km/h": 1 / 3.6, "kph": 1 / 3.6, "mph": 1609.344 / 3600},
    "steering": {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180, "mrad": 0.001},
    "yaw_rate": {"rad/s": 1.0, "deg/s": math.pi / 180, "°/s": math.pi / 180, "mrad/s": 0.001},
    "lateral_acceleration": {"m/s²": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "g": 9.80665},
    "sideslip": {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180, "mrad": 0.001},
}


def rows(count=12, step=0.05):
    k = np.arange(count)
    return np.stack([k * step, 20 + k, 0.01 * k, 0.02 * k, -0.5 * k], axis=1).tolist()


def written(tmp_path, lines, header=HEADER, name="drive.csv"):
    file = tmp_path / name
    text = [",".join(map(str, line)) if not isinstance(line, str) else line for line in lines]
    file.write_text("\n".join([header, *text]) + "\n", encoding="utf-8")
    return file


def test_a_file_is_read(tmp_path):
    drive = read_recording(written(tmp_path, rows()))
    found = (
        *(drive.times, drive.speed, drive.steering, drive.yaw_rate),
        drive.lateral_acceleration,
    )
    assert np.array_equal(np.stack(found, axis=1), np.array(rows()))
    assert drive.sideslip is None


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_columns_in_any_order_and_unit(tmp_path_factory, data):
    names = data.draw(st.permutations([*UNITS, "temperature [K]", "steering_wheel [deg]", "note"]))
    names = [one for one in names if one != "sideslip" or data.draw(st.booleans())]
    header, factors = [], {}
    for name in names:
        if name not in UNITS:
            header.append(name)
            continue
        unit = data.draw(st.sampled_from(sorted(UNITS[name])))
        factors[name] = UNITS[name][unit]
        spelt = name.replace("_", data.draw(st.sampled_from(["_", " "])))
        spelt = spelt.upper() if data.draw(st.booleans()) else spelt
        mark = data.draw(st.sampled_from([" [{}]", "[{}]", " ({})", " [ {} ]"]))
        header.append(spelt + mark.format(unit))
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    wanted = {
        "time": np.cumsum(rng.uniform(0.01, 1.9, 12)) - 7.0,
        "speed": rng.uniform(0, 50, 12),
        **{name: rng.uniform(-1.5, 1.5, 12) for name in [*UNITS][2:]},
    }
    wanted["speed"][3] = 5.0
    lines = [
        [repr(float(wanted[name][k] / factors[name])) if name in factors else "x" for name in names]
        for k in range(12)
    ]
    file = written(tmp_path_factory.mktemp("files"), lines, ",".join(header))
    drive = read_recording(file)
    for name, found in drive.data().items():
        name = {"times": "time"}.get(name, name)
        if found is None:
            assert name == "sideslip" and "sideslip" not in factors
        else:
            assert found == pytest.approx(wanted[name], rel=1e-12, abs=1e-12)


def test_a_drive_comes_back_exactly(tmp_path):
    seen = generate(missing=0.3, drivers=0).recording
    table = np.stack([*(getattr(seen, name) for name in ("times", "speed", "steering")),
                      seen.yaw_rate, seen.lateral_acceleration], axis=1)  # fmt: skip
    file = written(tmp_path, [map(repr, row) for row in table.tolist()])
    assert read_recording(file).data() == seen.data()


def test_doubled_lines_are_dropped_and_told(tmp_path, caplog):
    lines = rows()
    lines[5:5] = [lines[4], lines[4]]
    with caplog.at_level(logging.WARNING, logger="crosstrack"):
        drive = read_recording(written(tmp_path, lines))
    assert drive.times == pytest.approx(np.arange(12) * 0.05)
    assert "2 lines repeat the one before" in caplog.text
    caplog.clear()
    # Ignored columns may differ. A warning names them.
    marked = [[*line, k] for k, line in enumerate(lines)]
    with caplog.at_level(logging.WARNING, logger="crosstrack"):
        assert len(read_recording(written(tmp_path, marked, HEADER + ",slip angle [deg]"))) == 12
    assert "line 1: columns that are not read: slip angle [deg]" in caplog.text


def changed(row, column, value):
    lines = rows()
    lines[row][column] = value
    return lines


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (changed(4, 1, "nan"), r"line 6, column speed \[m/s\]: must be a finite number, got 'nan'"),
        (changed(4, 1, ""), r"line 6, column speed \[m/s\]: must be a finite number, got ''"),
        (changed(4, 3, "fast"), r"line 6, column yaw_rate \[rad/s\]: must be a finite .* 'fast'"),
        (changed(4, 3, "1e999"), r"line 6, column yaw_rate \[rad/s\]: must be a finite number"),
        (changed(4, 3, "=1+1"), r"line 6, column yaw_rate \[rad/s\]: must be a finite number"),
        (changed(0, 1, -1), r"line 2, column speed \[m/s\]: must be 0 … 1000 m/s, got '-1'"),
        (changed(0, 2, 25), r"column steering \[rad\]: must be -1.5708 … 1.5708 rad, got '25'"),
        (changed(3, 4, 1e9), r"column lateral_acceleration \[m/s²\]: must be -1000 … 1000 m/s²"),
        (changed(5, 0, 0.2), r"line 7, column time: must rise \(two different lines have one time"),
        (changed(5, 0, 0.1), r"line 7, column time: must rise, got 0.1 s after 0.2 s"),
        (changed(11, 0, 2.6), r"line 13, column time: must leave no gap above 2 s .*got 2.6 s"),
        ([*rows()[:6], [1.0, 2.0]], "line 8: 2 values where the header has 5"),
        ([*rows()[:6], [1, 2, 3, 4, 5, 6]], "line 8: 6 values where the header has 5"),
        (rows(5), "times must hold 10 … 1000000 samples, got 5"),
        ([], "no samples below the header"),
        ([[k * 0.05, 0, 0, 0, 0] for k in range(12)], "speed must reach 1 m/s somewhere"),
        (["0,1,0,0,\"open"], "no valid CSV"),
    ],
)  # fmt: skip
def test_bad_rows_are_refused(tmp_path, lines, message):
    with pytest.raises(InvalidData, match=message) as found:
        read_recording(written(tmp_path, lines))
    assert "drive.csv" in str(found.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("speed [m/s]", "speed", r"column 'speed': must state its unit .* m/s, km/h.*; got none"),
        ("speed [m/s]", "speed []", "must state its unit in brackets"),
        ("speed [m/s]", "speed [knots]", "one of m/s, km/h, kph, mph, .*; got 'knots'"),
        ("steering [rad]", "steering [rad/s]", "one of rad, deg, °, mrad, .*; got 'rad/s'"),
        ("speed [m/s],", "", "missing: speed"),
        ("speed [m/s],steering [rad]", "velocity [m/s],wheel [rad]", "missing: speed, steering"),
        ("speed [m/s]", "speed [m/s][m/s]", "missing: speed"),
        (
            "speed [m/s],",
            "speed [m/s],speed [km/h],",
            "column 'speed' stands twice",
        ),
        ("speed [m/s],", "speed [m/s],speed [m/s],", "column 'speed' stands twice"),
        (HEADER, "", "missing: time, speed"),
    ],
)
def test_bad_headers_are_refused(tmp_path, old, new, message):
    assert old in HEADER
    with pytest.raises(InvalidData, match=message):
        read_recording(written(tmp_path, rows(), HEADER.replace(old, new)))


def test_files_that_are_none(tmp_path):
    with pytest.raises(InvalidData, match="no such file"):
        read_recording(tmp_path / "none.csv")
    with pytest.raises(InvalidData, match="path must name a file"):
        read_recording(7)
    empty = tmp_path / "empty.csv"
    empty.write_bytes(b"")
    with pytest.raises(InvalidData, match="missing: time"):
        read_recording(empty)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\x00time")
    with pytest.raises(InvalidData, match="is no UTF-8"):
        read_recording(binary)


def test_a_file_is_an_instance(tmp_path, caplog):
    lines = [[*row, 0.5] for row in rows()]
    file = written(tmp_path, lines, HEADER + ",sideslip [deg]")
    model = ct.load(file)
    assert (model.kind, model.name) == ("sideslip", "drive")
    assert model.vehicle.data() == VEHICLE.data()
    assert "vehicle is assumed, as the file holds none" in caplog.text
    caplog.clear()
    heavy = {**VEHICLE.data(), "mass": 2500.0}
    assert ct.load(file, data={"vehicle": heavy}).vehicle.mass == 2500.0
    assert not caplog.text
    with pytest.raises(InvalidData, match="recording must not be given: the file holds it"):
        ct.load(file, data={"recording": model.recording}, model="sideslip")
    assert model.recording.sideslip is None
    assert np.degrees(model.truth) == pytest.approx(np.full(12, 0.5))
    assert ct.load(written(tmp_path, rows(), name="other.csv")).truth is None
    learnt = ct.load(
        file, data={"training": [generate(drivers=1).training[0]], "yaw_rate_noise": 0.01}
    )
    assert (len(learnt.training), learnt.yaw_rate_noise) == (1, 0.01)
    bad = written(tmp_path, rows(), HEADER.replace("[m/s]", ""), "bad.csv")
    with pytest.raises(InvalidData, match="must state its unit in brackets"):
        ct.load(bad, model="sideslip")


def seen(count=120, step=0.05):
    """Return columns of a plausible drive in the order of HEADER."""
    times = step * np.arange(count)
    yaw = 0.2 * np.sin(2.0 * times)
    return np.stack([times, 20.0 + 0 * times, 0.2 * yaw, yaw, 20.0 * yaw], axis=1)


@pytest.mark.parametrize(
    ("column", "name"), [(2, "steering"), (3, "yaw_rate"), (4, "lateral_acceleration")]
)
def test_one_dead_sensor_gives_a_result_and_a_finding(tmp_path, column, name):
    table = seen()
    table[:, column] = 0.01
    model = ct.load(written(tmp_path, table.tolist()))
    for backend in ("kalman-filter", "rts-smoother"):
        solution = ct.solve(model, backend)
        assert np.isfinite(solution.plan.sideslip).all() and solution.plan.deviation.max() > 0.005
    assert f"{name} never changes: 0.01 at every sample" in str(ct.diagnose(model))


def test_constant_steering_is_no_finding_on_a_straight_road(tmp_path):
    table = seen()
    table[:, 2:] = 0.0
    table[:, 3] += 0.002 * np.random.default_rng(0).normal(size=len(table))
    assert "steering never changes" not in str(
        ct.diagnose(ct.load(written(tmp_path, table.tolist())))
    )


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (seen()[::-1], r"line 3, column time: must rise, got 5.9 s after 5.95 s"),
        (seen()[:3], r"drive.csv: times must hold 10 … 1000000 samples, got 3"),
        (seen()[:1], r"drive.csv: times must hold 10 … 1000000 samples, got 1"),
        (seen() * [1, -1, 1, 1, 1], r"line 2, column speed \[m/s\]: must be 0 … 1000 m/s"),
        (seen() * [1e6, 1, 1, 1, 1], r"line 3, column time: must leave no gap above 2 s"),
        (seen() * [0, 1, 1, 1, 1], r"line 3, column time: must rise \(two different lines"),
    ],
)  # fmt: skip
def test_strange_drives_are_refused(tmp_path, table, message):
    with pytest.raises(InvalidData, match=message):
        read_recording(written(tmp_path, table.tolist()))


@pytest.mark.parametrize("scale", [1e-3, 1e-2])
def test_fast_drives_and_calendar_times_give_results(tmp_path, scale):
    for start in (0.0, 1.7e9):
        table = seen() * [scale, 1, 1, 1, 1] + [start, 0, 0, 0, 0]
        solution = ct.solve(ct.load(written(tmp_path, table.tolist())), "kalman-filter")
        assert np.isfinite(solution.plan.sideslip).all()


def test_vehicles_come_back_exactly(tmp_path):
    car = dataclasses.replace(VEHICLE, tyre="saturating", friction=1 / 3)
    file = write_vehicle(car, tmp_path / "car.json")
    assert read_vehicle(file).data() == car.data()
    model = generate(drivers=0, samples=20)
    text = json.loads(write_model(model, tmp_path / "model.json").read_text(encoding="utf-8"))
    text["data"]["vehicle"] = "car.json"
    (tmp_path / "other.json").write_text(json.dumps(text), encoding="utf-8")
    assert ct.load(tmp_path / "other.json").vehicle.data() == car.data()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"mass": 3}', "car.json: keys 'yaw_inertia', .* are missing"),
        (json.dumps({**VEHICLE.data(), "mass": -1}), "car.json: mass must be > 0 kg, got -1"),
        (json.dumps({**VEHICLE.data(), "colour": 1}), "car.json: unknown key 'colour'"),
        ("[1, 2]", "car.json: data must be an object"),
        ("{", "car.json"),
    ],
)
def test_bad_vehicles_are_refused(tmp_path, text, message):
    (tmp_path / "car.json").write_text(text, encoding="utf-8")
    with pytest.raises(InvalidData, match=message):
        read_vehicle(tmp_path / "car.json")
    with pytest.raises(InvalidData, match="no such file"):
        read_vehicle(tmp_path / "none.json")


def test_excel_files(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="Excel files need the extra xlsx")
    book = openpyxl.Workbook()
    for row in [HEADER.split(","), *rows()]:
        book.active.append(row)
    book.save(tmp_path / "drive.xlsx")
    drive = read_recording(tmp_path / "drive.xlsx")
    assert drive.speed.tolist() == [20.0 + k for k in range(12)]
