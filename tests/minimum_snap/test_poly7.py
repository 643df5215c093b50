"""Trajectories in and out: Crazyflie's poly7 files."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from minimum_snap.drawn import HEADER, drawn, smooth, spline

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import Poly7, read_poly7, write_poly7
from crosstrack.instances.minimum_snap import PIECES_THAT_FIT
from crosstrack.models.minimum_snap.trajectory import Trajectory

numbers = st.floats(-1e6, 1e6).map(lambda x: x + 0.0)
tables = st.integers(1, 5).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(1e-3, 1e3), min_size=n, max_size=n),
        st.lists(st.lists(numbers, min_size=32, max_size=32), min_size=n, max_size=n),
    )
)


@given(tables)
@settings(max_examples=25, deadline=None)
def test_poly7_files_are_exact(tmp_path_factory, table):
    """All digits: every number. 4 bytes: the numbers of the firmware, and a stable text."""
    path = tmp_path_factory.mktemp("poly7") / "p.csv"
    pieces = Poly7(table[0], np.reshape(table[1], (-1, 4, 8)))
    path.write_text(pieces.text("float64"))
    again = Poly7.read(path)
    assert again.durations.tobytes() == pieces.durations.tobytes()
    assert again.coefficients.tobytes() == pieces.coefficients.tobytes()
    path.write_text(pieces.text("float32"))
    stored, rounded = Poly7.read(path), pieces.rounded()
    for have, want in ((stored.durations, rounded.durations), (stored.coefficients, rounded.coefficients)):  # fmt: skip
        assert have.astype(np.float32).tobytes() == want.astype(np.float32).tobytes()


@given(
    st.integers(1, 12),
    st.integers(1, 4),
    st.integers(0, 10**6),
    st.sampled_from(["float32", "float64"]),
)
@settings(max_examples=20, deadline=None)
def test_poly7_round_trip_is_within_the_report(
    tmp_path_factory, segments, dimensions, seed, precision
):
    path = tmp_path_factory.mktemp("poly7") / "p.csv"
    plan = smooth(segments, dimensions, seed)[1]
    report = write_poly7(plan, path, precision=precision)
    back = read_poly7(path, start=plan.times[0])
    text = path.read_text()
    if precision == "float32":
        # Once rounded, it stays as it is; the firmware reads the digits as 4-byte floats.
        write_poly7(back, path)
        assert path.read_text() == text
        back = Poly7.read(path).rounded().trajectory(plan.times[0])
    assert (back.segments, back.dimensions, back.degree) == (segments, 4, 7)
    assert report.pieces == segments and report.fits
    assert not back.coefficients[:, :, dimensions:].any()
    if precision == "float64":
        np.testing.assert_allclose(back.times, plan.times, atol=1e-13 * plan.duration)
        np.testing.assert_allclose(
            back.coefficients[:, :, :dimensions], plan.coefficients, rtol=1e-12, atol=1e-12
        )
        # The report is of what the firmware makes of it, whatever digits the file has.
        assert max(map(max, report.jumps)) > 0 or segments == 1
        return
    for order in range(4):
        begin, end = back.at_ends(order)
        jump = np.abs(begin[1:] - end[:-1]).max(axis=0, initial=0.0)
        reported = np.array(report.jumps[order])
        np.testing.assert_allclose(jump, reported, rtol=1e-4, atol=1e-11 * 100**order)
        # The plan's own jumps are rounding in eight bytes.
        caused = np.array(report.rounding_jumps[order])
        np.testing.assert_allclose(caused, reported, rtol=1e-3, atol=1e-9 * 100**order)
    drift = back.at_ends()[1][-1, :dimensions] - plan.at_ends()[1][-1]
    np.testing.assert_allclose(drift, report.end_drift[:dimensions], atol=1e-11)
    assert back.duration - plan.duration == pytest.approx(report.time_drift, abs=1e-12)


def test_poly7_is_refused_before_a_file_is_touched():
    plan = smooth(32, 3, 1)[1]
    assert PIECES_THAT_FIT == 31
    path = Path("nowhere") / "p.csv"
    with pytest.raises(InvalidData, match=r"at most 31 pieces.*4096 bytes.*got 32"):
        write_poly7(plan, path, strict=True)
    with pytest.raises(InvalidData, match="cannot be written"):
        write_poly7(plan, path)


def test_poly7_report_in_words(tmp_path):
    path = tmp_path / "p.csv"
    plan = smooth(32, 3, 1)[1]
    report = write_poly7(plan, path)
    assert not report.fits
    assert report.bytes_needed == 32 * 132
    text = str(report)
    assert "TOO MANY, the firmware holds 31" in text
    assert "largest jump of jerk" in text
    data = json.loads(json.dumps(report.to_dict()))
    assert data["fits"] is False and data["limit"] == 31 and len(data["jumps"]) == 4
    assert 0 < report.jumps[0][0] < 1e-5
    assert "yaw" not in text
    assert "rad/s by rounding" in str(write_poly7(smooth(3, 4)[1], path))
    write_poly7(plan, path)
    before = path.read_text()
    with pytest.raises(InvalidData, match="31"):
        write_poly7(plan, path, strict=True)
    assert path.read_text() == before
    fits = write_poly7(smooth(31)[1], path, strict=True)
    assert fits.fits and "TOO MANY" not in str(fits)


def test_rounding_jumps_leave_the_trajectorys_own_out(tmp_path):
    plan = drawn(4, 7, 3, 5)  # jumps by itself
    report = write_poly7(plan, tmp_path / "p.csv")
    assert max(report.jumps[0]) > 0.1
    assert 0 < max(report.rounding_jumps[0]) < 1e-4
    single = write_poly7(drawn(1), tmp_path / "p.csv")
    assert single.jumps == ((0.0,) * 4,) * 4


def test_poly7_axes_and_yaw(tmp_path):
    path = tmp_path / "p.csv"
    model, plan = smooth(3, 2, 7)
    write_poly7(plan, path, yaw=0.5)
    t = np.linspace(0, plan.duration, 9)[:-1]
    back = read_poly7(path)
    np.testing.assert_allclose(back(t)[:, :2], plan(t), atol=1e-5)
    assert not back(t)[:, 2].any()
    np.testing.assert_array_equal(back(t)[:, 3], 0.5)
    turn = spline(plan.times, model.waypoints[:, :1])
    write_poly7(plan, path, yaw=turn, precision="float64")
    np.testing.assert_allclose(read_poly7(path)(t)[:, 3], turn(t)[:, 0], atol=1e-11)
    four = drawn(2, 5, 4)
    write_poly7(four, path, precision="float64")
    back = read_poly7(path, start=float(four.times[0]))
    assert not back.coefficients[:, 6:].any()
    np.testing.assert_allclose(back.coefficients[:, :6], four.coefficients, rtol=1e-12)
    # Zeros above degree 7 are no obstacle.
    padded = Trajectory(four.times, np.pad(four.coefficients, ((0, 0), (0, 4), (0, 0))))
    text = path.read_text()
    write_poly7(padded, path, precision="float64")
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: write_poly7(drawn(degree=9), p), "degree <= 7, got 9.*degree=7"),
        (lambda p: write_poly7(drawn(dimensions=5), p), "1 to 4 dimensions.*got 5"),
        (lambda p: write_poly7([1], p), "must be a Trajectory, got list"),
        (lambda p: write_poly7(drawn(dimensions=4), p, yaw=0.0), "fourth axis is yaw"),
        (lambda p: write_poly7(drawn(), p, yaw=math.inf), "yaw must be finite"),
        (lambda p: write_poly7(drawn(), p, yaw="north"), "yaw must be a number"),
        (lambda p: write_poly7(drawn(), p, yaw=drawn(dimensions=1, seed=9)), "knots of the traj"),
        (lambda p: write_poly7(drawn(), p, yaw=drawn(dimensions=2)), "1-dimensional"),
        (lambda p: write_poly7(drawn(), p, precision="half"), "float32, float64, got 'half'"),
        (lambda p: write_poly7(drawn(low=1e-7, high=2e-7), p), "4-byte float, got .*lasts"),
        (lambda p: write_poly7(Trajectory([0, 1e39], [[[1.0]]]), p), "duration of piece 0 must"),
        (lambda p: write_poly7(Trajectory([0, 1e-50], [[[0.0], [1]]]), p), "4-byte|no finite"),
        (lambda p: Poly7([], np.zeros((0, 4, 8))), "at least 1 entry"),
        (lambda p: Poly7([0.0], np.zeros((1, 4, 8))), r"durations\[0\] must be > 0"),
        (lambda p: Poly7([1.0], np.zeros((1, 3, 8))), "shape"),
    ],
)
def test_poly7_rejects_unsupported_trajectories(call, message, tmp_path):
    path = tmp_path / "p.csv"
    with pytest.raises(InvalidData, match=message):
        call(path)
    assert not path.exists()


ROW = ",".join(["1.5", *map(str, range(32))])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"line 1, column 1: the header must hold 'duration', got nothing"),
        (ROW, r"line 1, column 1: the header must hold 'duration', got '1\.5'"),
        (HEADER.replace("x^1", "x1") + "\n" + ROW, r"line 1, column 3.*'x\^1', got 'x1'"),
        (HEADER.replace(",yaw^7", "") + "\n" + ROW, r"line 1, column 33.*'yaw\^7', got nothing"),
        (HEADER + ",w\n" + ROW, r"line 1: 34 columns where 33 are allowed.*'w'"),
        (HEADER, "no piece below the header"),
        (HEADER + "\n" + ROW + ",1", r"line 2: 34 values where 33 are allowed"),
        (HEADER + "\n\n" + ROW.removesuffix(",31"), r"line 3: 32 values where 33"),
        (HEADER + "\n" + ROW.replace(",9,", ",nan,"), r"line 2, column y\^1: must be a finite number, got 'nan'"),
        (HEADER + "\n" + ROW.replace(",9,", ",1e999,"), r"line 2, column y\^1: must be a finite"),
        (HEADER + "\n" + ROW.replace(",9,", ",,"), r"line 2, column y\^1: must be a finite number, got ''"),
        (HEADER + "\n" + ROW.replace(",9,", ",1_0,"), r"line 2, column y\^1"),
        (HEADER + "\n" + ROW + "\n" + ROW.replace("1.5", "0", 1), r"line 3, column duration: must be > 0 s, got '0'"),
        (HEADER + "\n" + ROW.replace("1.5", "-2", 1), r"line 2, column duration: must be > 0"),
        (HEADER + "\n" + ROW.replace("1.5", "1e300", 1), r"coefficients\[0, 2, 0\] must be finite"),
        (HEADER + "\n" + ROW + "\n" + ROW.replace("1.5", "1e-30", 1), r"times\[2\] must be >"),
    ],
)  # fmt: skip
def test_bad_poly7_files_are_named(text, message, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InvalidData, match=rf"bad\.csv.*{message}"):
        read_poly7(path)


def test_poly7_files_of_other_tools(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(
        f"# {HEADER.replace(',', ' , ').title()} ,\r\n\r\n{ROW.replace(',', ', ')},\r\n"
    )
    assert read_poly7(path).segments == 1
    with pytest.raises(InvalidData, match="no such file"):
        read_poly7(tmp_path / "none.csv")
    path.write_bytes(b"\xff")
    with pytest.raises(InvalidData, match=r"p\.csv.*no UTF-8"):
        read_poly7(path)
    path.write_text(HEADER + "\n" + ROW)
    with pytest.raises(InvalidData, match="start must be finite"):
        read_poly7(path, start=math.nan)


def test_load_recognises_csv_files(tmp_path):
    path = tmp_path / "some.csv"
    for text, message in (
        (HEADER.upper() + "\n" + ROW, r": a poly7.*a plan, and no instance.*read_poly7\(path\)"),
        ("t,x,y\n0,1,2\n", r": a CSV file of samples.*read_samples\(path\)"),
        (
            "0,1,2\n3,4,5\n",
            r"minimum-snap: key 'times' is missing.*minimum-derivative: .*'times'.*data={",
        ),
        ("x,y,z\n3,4,5\n", "minimum-snap.*must hold at least 2 waypoints"),
        ("id,x,y,z,kind\n", "error-correction: .*no points below the header"),
        ("", "the file is empty"),
    ):
        path.write_text(text)
        with pytest.raises(InvalidData, match=rf"(?s)some\.csv.*{message}"):
            ct.load(path)
    with pytest.raises(InvalidData, match="no such file"):
        ct.load(tmp_path / "none.csv")
