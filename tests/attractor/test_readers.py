"""Series in CSV and Excel files, of which much is refused."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.instances.attractor import read_series
from crosstrack.instances.attractor.readers import table_file

COUNT = 60
VALUES = np.sin(0.7 * np.arange(COUNT)).round(6)


def written(folder, header="time [s],x [m]", times=None, values=VALUES, name="a.csv"):
    """Write a file of times and values; return its path."""
    times = 0.5 * np.arange(len(values)) if times is None else times
    rows = [f"{t},{x}" for t, x in zip(times, values, strict=True)]
    file = folder / name
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


# -- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [
        ("s", 1), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("μs", 1e-6), ("ns", 1e-9),
        ("min", 60), ("h", 3600), ("d", 86400),
    ],
)  # fmt: skip
@pytest.mark.parametrize("header", ["time [{}],x [mV]", "Time ({}) , X (mV)", "# t [{}],x [mV]"])
def test_times_have_units(unit, seconds, header, tmp_path):
    found = read_series(written(tmp_path, header.format(unit)))
    assert found.series.tolist() == VALUES.tolist()
    assert found.period == pytest.approx(0.5 * seconds, rel=1e-12)
    assert (found.unit, found.name) == ("mV", "a")
    assert (found.true_exponent, found.true_dimension, found.chaotic) == (None, None, None)


def test_a_column_is_named_where_there_are_several(tmp_path):
    file = tmp_path / "a.csv"
    lines = [f"{k},{x},word,{2 * x}" for k, x in enumerate(VALUES.tolist())]
    file.write_text("\n".join(["time [ms],x [m],remark,Speed [m/s]", *lines]))
    for column in ("speed", "Speed [m/s]", " SPEED "):
        found = read_series(file, column, name="mine")
        assert (found.unit, found.name, found.period) == ("m/s", "mine", 0.001)
        assert found.series.tolist() == (2 * VALUES).tolist()
    assert read_series(file, "x").unit == "m"
    with pytest.raises(InvalidData, match=r"line 1: has several columns of values, x .m., remark"):
        read_series(file)
    with pytest.raises(UnknownName, match=r"'speeed': known: remark, speed .m/s., x .m."):
        read_series(file, "speeed")
    with pytest.raises(InvalidData, match="line 2, column remark: must be a finite number"):
        read_series(file, "remark")


def test_a_period_stands_for_times_that_are_missing(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("x\n" + "\n".join(map(str, VALUES)))
    found = read_series(file, period=0.25)
    assert (found.period, found.unit) == (0.25, "")
    with pytest.raises(
        InvalidData, match=r"has no column of times, such as 'time .s.': period must"
    ):
        read_series(file)
    with pytest.raises(InvalidData, match="has no column of times"):
        table_file(file)
    assert table_file(file, period=0.25)["period"] == 0.25
    with pytest.raises(InvalidData, match=r"period must not be given: the file has times, 0.5 s"):
        read_series(written(tmp_path), period=0.5)


def test_rounded_times_are_evenly_spaced(tmp_path):
    # Thirty samples a second to three digits, from anywhere.
    times = (1e6 + np.arange(COUNT) / 30).round(3)
    found = read_series(written(tmp_path, times=times))
    assert found.period == pytest.approx(1 / 30, rel=1e-3)


def test_a_file_is_an_instance(tmp_path):
    file = written(tmp_path)
    found = ct.load(file)
    assert found.kind == "attractor" and found.name == "a" and found.period == 0.5
    assert found.digest == ct.load(file, model="attractor").digest == read_series(file).digest


def test_excel_files_are_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="Excel files need the extra xlsx")
    book = openpyxl.Workbook()
    book.active.append(["time [s]", "x [m]"])
    for k, x in enumerate(VALUES.tolist()):
        book.active.append([0.5 * k, x])
    book.save(tmp_path / "a.xlsx")
    assert read_series(tmp_path / "a.xlsx").digest == read_series(written(tmp_path)).digest


def test_a_long_file_is_read(tmp_path):
    values = np.sin(0.1 * np.arange(50_000))
    found = read_series(written(tmp_path, values=values, times=np.arange(50_000) / 1000))
    assert np.array_equal(found.series, values)
    assert found.period == pytest.approx(1e-3)


# -- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: np.delete(t, 30), "line 32, column time .s.: must leave no gap, where samples are 0.5"),
        (lambda t: np.delete(t, 1), "line 3, column time .s.: must leave no gap.*got 1 after 0"),
        (lambda t: np.insert(t, 30, t[30]), "line 33, column time .s.: must differ from the time before"),
        (lambda t: np.insert(t, 30, t[30] - 0.1), "line 33, column time .s.: must be 0.5 after the time"),
        (lambda t: np.insert(t, 30, t[10]), "line 32, column time .s.: must rise, got 5 after 14.5"),
        (lambda t: -t, "line 3, column time .s.: must rise, got -0.5 after"),
        (lambda t: 0 * t, "line 3, column time .s.: must differ from the time before, got 0 after 0"),
        (lambda t: t + 0.01 * np.sin(t), None),
        (lambda t: t + 0.1 * np.sin(t), "must be .* within 0.05 of the spacing 0.49.*evenly spaced"),
        (lambda t: t * (1 + 0.01 * t), "evenly spaced"),
    ],
)  # fmt: skip
def test_times_that_are_uneven(change, message, tmp_path):
    times = change(0.5 * np.arange(COUNT))
    file = written(tmp_path, times=times, values=np.resize(VALUES, len(times)))
    if message is None:
        assert read_series(file).period == pytest.approx(0.5, rel=0.01)
        return
    with pytest.raises(InvalidData, match=message) as caught:
        read_series(file)
    assert caught.value.field == "time"
    assert str(caught.value).startswith(str(file))


@pytest.mark.parametrize(
    "text", ["nan", "inf", "-inf", "", "abc", "1,5", "1e999", "1_0", "٣", "0x10"]
)
def test_cells_that_are_no_numbers(text, tmp_path):
    for column in (0, 1):
        cells = [["0.0", "1.0"], ["0.5", "2.0"], ["1.0", "3.0"]]
        cells[1][column] = text
        file = tmp_path / "a.csv"
        file.write_text("time [s],x [m]\n" + "\n".join(",".join(row) for row in cells))
        said = "3 values where the header has 2" if "," in text else "must be a finite number, got"
        with pytest.raises(InvalidData, match=f"a.csv, line 3.*{said}"):
            read_series(file)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("time,x", "line 1, column 'time': must state its unit in brackets, one of s, ms, .*; got none"),
        ("time [fortnight],x", "one of s, ms, us, μs, ns, min, h, d; got 'fortnight'"),
        ("time [],x", "got none"),
        ("t [s],time [ms]", "column 'time' stands twice"),
        ("x,x", "columns must differ"),
        ("0.0,1.0", "must be a header of a series, such as 'time .s.,x .m.', got '0.0,1.0'"),
        ("time [s],", "must be a header of a series"),
        ("x,y", "has several columns of values, x, y: one must be named"),
    ],
)  # fmt: skip
def test_headers_that_are_none(header, message, tmp_path):
    with pytest.raises(InvalidData, match=message):
        read_series(written(tmp_path, header))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: has no column of values"),
        ("time [s],x\n", "no samples below the header"),
        ("time [s]\n0\n1\n", "has no column of values"),
        ("time [s],x\n0,1\n", "line 2: one sample is no series"),
        ("time [s],x\n0,1\n1\n", "line 3: 1 values where the header has 2"),
        ("time [s],x\n0,1\n1,2\n", "series must hold 50 … 10000000 samples, got 2"),
        ('time [s],x\n0,"1\n', "no valid CSV"),
    ],
)
def test_files_that_are_none(text, message, tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(InvalidData, match=message) as caught:
        read_series(file)
    assert str(caught.value).startswith(str(file))


def test_constant_series_and_strange_arguments(tmp_path):
    flat = written(tmp_path, values=np.full(COUNT, 7.0))
    with pytest.raises(InvalidData, match=r"a.csv: series must not be constant, got 7 at all 60"):
        read_series(flat)
    with pytest.raises(InvalidData, match="no such file"):
        read_series(tmp_path / "none.csv")
    (tmp_path / "bytes.csv").write_bytes(b"time [s],x\n0,\xff\n")
    with pytest.raises(InvalidData, match="line 2: byte 0xff is no UTF-8"):
        read_series(tmp_path / "bytes.csv")
    with pytest.raises(InvalidData, match="column must be a str"):
        read_series(flat, 1)
    with pytest.raises(InvalidData, match="period must be > 0 s"):
        read_series(flat, period=-1)


def test_files_of_other_problems_are_left_to_them(tmp_path):
    recording = "time [s],speed [m/s],steering [rad],yaw_rate [rad/s],lateral_acceleration [m/s²]"
    places = "coordinate"
    for header in (recording, places, "x,y", "x,y,z,kind"):
        width = header.count(",") + 1
        file = tmp_path / "a.csv"
        rows = [",".join([str(k)] * width) for k in range(COUNT)]
        file.write_text("\n".join([header, *rows]))
        with pytest.raises(InvalidData):
            table_file(file)
