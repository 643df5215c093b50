"""Reader of tables: separators, decimal commas, comments, units, encodings, maps, missing cells."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from framework.commands import run
from framework.mutated_tables import main

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances.attractor import read_series
from crosstrack.instances.error_correction import read_points
from crosstrack.instances.fleet import read_nodes
from crosstrack.instances.grid_path import read_geojson_polygons
from crosstrack.instances.guided_path import read_stops
from crosstrack.instances.minimum_snap import read_samples, read_waypoints
from crosstrack.instances.projection import project_positions
from crosstrack.instances.sideslip import read_recording
from crosstrack.instances.units import label_parts


def written(tmp_path: Path, content: str | bytes, name: str = "table.csv") -> Path:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


@pytest.mark.parametrize(
    "text",
    [
        "x,y\n1.5,2\n3,-4\n",
        "x;y\n1,5;2\n3;-4,0\n",
        "x\ty\n1,5\t2\n3\t-4\n",
        "x  y\n 1.5   2\n3 -4 \n",
        "x [km];y (cm)\n0,0015;200\n0,003;-400\n",
        "x;y\nkm;cm\n0,0015;200\n0,003;-400\n",
        "x;y;name\nm;m;\n1,5;2;a;\n".replace("a;", "a") + "3;-4;b\n",
        "# survey of May; metres\n\nx;y\n% first\n1,5;2\n// a; b; c\n#\n3;-4\n",
        "#x,y\n1.5,2\n3,-4\n",
        '"x","y","note"\r\n"1.5","2","a ""b"", c\n# d"\r\n3,-4,\r\n',
        "x,y\n1.5,2\n#7.0,8\n3,-4\n",
        "Easting [m],Northing [m]\n1.5,2\n3,-4\n",
        "sep=;\r\nx;y\r\n1,5;2\r\n3;-4\r\n",
        "Sep=,,\nx,y\n1.5,2\n3,-4\n",
        "Survey of May\nx,y\n1.5,2\n3,-4\n",
        "Survey;;\n;May;\n\nx;y;name\nm;m;\n1,5;2;a\n3;-4;b\n",
        "x,y,\nm,m,\n1.5,2,\n3,-4,\n",
        "x;y;;\n1,5;2;;\n3;-4\n",
        ";;x;y\n;;m;m\n;;1,5;2\n;;3;-4\n",
    ],
)
def test_spellings_of_one_table(text, tmp_path):
    assert read_nodes(written(tmp_path, text))["points"] == [(1.5, 2.0), (3.0, -4.0)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x;y\n1,5;2.5\n", r"line 2, column y: must have the decimal mark of '1,5' \(.*column x\)"),
        ("x;y\n1.234,5;2\n", "got '1.234,5': write it without thousands separators"),
        ('x,y\n"1,5",2\n', "got '1,5': a decimal comma needs semicolons or tabs"),
        ("x,y\n1,\n", "line 2, column y: must be a finite number, got '': the value is missing"),
        ("x,y\nm,m\nNA,1\n", "line 3, column x .m.: .* got 'NA': the value is missing"),
        ("x [m],y\nkm,km\n1,1\n", "column 'x .m.' must have one unit, got 'km' below it"),
        ("x [furlong],y\n1,1\n", "must state its unit in brackets, one of m, km"),
        ("id,x,y\na,1,2\n#b,3\n", "line 3: 2 values where the header has 3"),
        ("x,y,due\n1,2,3\n", "must be a header of nodes.*remove or rename .*'due'; got"),
        (",x,y\n0,1,2\n", r"remove or rename the other columns, 'number 1 \(without a name\)'"),
        ("x,y\n0,0\n#N/A,3\n", "line 3, column x: .* got '#N/A': the value is missing"),
        ("x,y\n0,0\n#DIV/0!,3\n", "line 3, column x: must be a finite number, got '#DIV/0!'"),
        ("sep=|\nx|y\n1|2\n", "must be a header of nodes"),
        ("sep=;\nx;y\n1;2;3\n", "line 3: 3 values where the header has 2"),
        ("x\n1,2\n", "line 1: must be a header of nodes"),
        ("x,y,\n1,2,\n3,4,7\n", r"other columns, 'number 3 \(without a name\)'"),
        ("x,y,\n" + "1,2,\n" * 9 + "3,4,7\n", "line 11: 3 values where the header has 2"),
        (",x,y\n" + ",0,0\n" * 9 + "7,1,2\n", "line 11: 3 values where the header has 2"),
        (";;x;y\n" + ";;0;0\n" * 9 + "5;6\n", "line 11: 4 values where the header has 2"),
        ("x\0,\0y\0", "zero bytes, as UTF-16 without a byte-order mark: .* --encoding utf-16-le"),
        ("a\nb\nc\nd\nx,y\n1,2\n", "line 1: must be a header of nodes"),
        ("x;y\n0;0\n#BEZUG! ;3\n", "line 3, column x: must be a finite number, got '#BEZUG!'"),
    ],
)
def test_ambiguous_cells_are_refused(text, message, tmp_path):
    with pytest.raises(InvalidData, match=message):
        read_nodes(written(tmp_path, text))


def test_ids_that_look_like_comments_or_units_are_rows(tmp_path):
    rows = "#0,0,0,0,A\n#1,1,1,1,0\n%2,2,2,2,B\n"
    expected = ("#0", "#1", "%2")
    for header in ("id,x,y,z,kind\n", ""):
        assert read_points(written(tmp_path, header + rows)).ids == expected
    with pytest.raises(InvalidData, match="line 2, column coordinate"):
        read_stops(written(tmp_path, "id,coordinate,chain\nm,,\n"))
    text = "x [km],y (mm),Z坐标（单位: cm）,kind\n1,2,3,A\n4,5,6,B\n"
    assert read_points(written(tmp_path, text)).points.tolist() == [
        [1e3, 2e-3, 0.03],
        [4e3, 5e-3, 0.06],
    ]


def test_a_marked_row_that_may_be_a_comment_is_read_with_a_warning(tmp_path, caplog):
    text = "id,x,y\ndepot,0,0\n#1,1,1\n# B,3,4\n"
    assert read_nodes(written(tmp_path, text))["ids"] == ["depot", "#1", "# B"]
    assert [record.getMessage().split(": ")[1] for record in caplog.records] == [
        "'# B' is read as an id, not as a comment"
    ]


def test_points_with_an_unknown_unit_are_refused(tmp_path):
    file = written(tmp_path, "x [inch],y,z,kind\n1,2,3,A\n4,5,6,B\n")
    with pytest.raises(InvalidData, match=r"line 1, column x: must state its unit.*got 'inch'"):
        read_points(file)


def test_labels_of_many_blanks_take_linear_time():
    label = f"x{100_000 * ' '}("
    assert label_parts(label) == (label, "")
    assert label_parts(f"x{100_000 * ' '}(km )") == ("x", "km")


def test_error_values_of_spreadsheets_are_no_comments(tmp_path):
    rows = [np.sin(k / 3) for k in range(60)]
    lines = [*map(str, rows[:20]), "#N/A", *map(str, rows[21:])]
    file = written(tmp_path, "\n".join(["height", *lines]))
    book = openpyxl.Workbook()
    for cell in ["height", *rows[:20], "#N/A", *rows[21:]]:
        book.active.append([cell])
    book.save(tmp_path / "a.xlsx")
    for path in (file, tmp_path / "a.xlsx"):
        with pytest.raises(InvalidData, match=r"line 22, column height: .* got '#N/A'"):
            read_series(path, period=0.1)
        series = read_series(path, period=0.1, missing="interpolate").series
        assert len(series) == 60 and series[20] == pytest.approx((rows[19] + rows[21]) / 2)
    file = written(tmp_path, "x,y\n0,0\n#Attention! 2 rows\n3,4\n")
    assert len(read_nodes(file)["points"]) == 2


def test_encodings(tmp_path):
    text = "x;y;name\n1,5;2;Zürich\n"
    for encoding in ("utf-8-sig", "utf-16"):
        assert read_nodes(written(tmp_path, text.encode(encoding)))["ids"] == ["Zürich"]
    file = written(tmp_path, text.encode("latin-1"))
    with pytest.raises(InvalidData, match=r"line 2: byte 0xfc.*--encoding windows-1252"):
        read_nodes(file)
    assert read_nodes(file, encoding="Windows-1252")["ids"] == ["Zürich"]
    for encoding in ("zip", "rot13", "", 3):
        with pytest.raises(InvalidData, match="encoding must be"):
            read_nodes(file, encoding=encoding)
    with pytest.raises(InvalidData, match=r"is no gbk text|must be a header"):
        read_nodes(written(tmp_path, b"x,y\n\xff\xff,1\n"), encoding="gbk")
    with pytest.raises(InvalidData, match="sheet is for Excel files"):
        read_nodes(file, sheet="Sheet1")


def test_columns_are_mapped(tmp_path, caplog):
    file = written(tmp_path, "Name;Easting [km];Northing;Load;x\na;1,5;2;3;9\nb;3;4;5;9\n")
    columns = {"x": "easting", "Y": "Northing", "demand": "Load", "id": "Name"}
    with caplog.at_level(logging.WARNING, "crosstrack"):
        data = read_nodes(file, columns=columns)
    assert data["points"] == [(1500.0, 2.0), (3000.0, 4.0)]
    assert (data["demands"], data["ids"]) == ([3, 5], ["a", "b"])
    assert "columns that are not read: unmapped x" in caplog.text
    model = ct.load(file, columns=columns, data={"vehicles": 1, "capacity": 9, "depots": "b"})
    assert model.depots.tolist() == [1]
    mapping = "x=Easting,y=Northing,demand=Load,id=Name"
    options = ("--data", "vehicles=1", "--data", "capacity=9", "--columns", mapping, "--json")
    assert json.loads(run("solve", file, *options, "--time-limit", "2").stdout)["verification"]
    for columns, message in (
        (
            {"x": "Eastings"},
            "'eastings' .for x. is there 0 times: did you mean .*the file has 'Name",
        ),
        ({"dem": "Load"}, "columns must name columns of nodes, x, y, lat.* got 'dem'"),
        ({"x": "Load", "y": "load"}, "must map each name to another column"),
        ([("x", "Load")], "columns must map names"),
    ):
        with pytest.raises(InvalidData, match=message):
            read_nodes(file, columns=columns)
    with pytest.raises(InvalidData, match=r"table.csv, line 1: columns must name columns of the"):
        ct.load(file, columns={"x": "nowhere"})
    with pytest.raises(InvalidData, match="depots must be ids of one node each, got 'c'"):
        ct.load(file, model="fleet-routing", data={"vehicles": 1, "depots": ["c"]},
                columns={"x": "Easting", "y": "Northing", "demand": "Load", "id": "Name"})  # fmt: skip
    with pytest.raises(UnsupportedOption, match="data, model, columns are for "):
        ct.load("fleet/example", columns={"x": "a"})
    assert "not NAME=COLUMN" in run("solve", file, "--columns", "x", code=2).stderr
    twice = run("solve", file, "--columns", "x=Easting", "--columns", "x=Load", code=2)
    assert "'x' is given twice" in twice.stderr


def test_waypoints_and_points_take_a_map(tmp_path):
    file = written(tmp_path, "t;North;East;Up\ns;km;m;m\n0;1;2,5;3\n1;4;5;6\n")
    columns = {"east": "East", "north": "North", "up": "Up"}
    assert read_waypoints(file, columns=columns).tolist() == [[2.5, 1000, 3], [5, 4000, 6]]
    with pytest.raises(InvalidData, match="a column of times"):
        read_waypoints(file)
    turned = written(tmp_path, "x [km],y,z,yaw [deg]\n1,2,3,180\n4,5,6,90\n")
    assert read_waypoints(turned)[0].tolist() == [1000, 2, 3, np.pi]
    file = written(tmp_path, "Nr.;X-Koord.;Y;Z;Art\n1;0,5;0;0;A\n2;1;1;1;B\n")
    columns = {"id": "Nr.", "x": "X-Koord.", "kind": "Art"}
    assert read_points(file, columns=columns).points.tolist() == [[0.5, 0, 0], [1, 1, 1]]
    with pytest.raises(InvalidData, match=r"columns must name columns of points, .* got 'fial'"):
        read_points(file, columns={"fial": "Nr."})


def test_sheets_of_excel_files(tmp_path):
    book = openpyxl.Workbook()
    book.active.append(["nothing", "here"])
    sheet = book.create_sheet("Nodes")
    for row in (["# from a survey"], ["x", "y"], ["km", "m"], [1, 2.5], [3, 4]):
        sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    assert read_nodes(tmp_path / "a.xlsx", sheet="Nodes")["points"] == [(1000, 2.5), (3000, 4)]
    model = ct.load(tmp_path / "a.xlsx", sheet=2, data={"vehicles": 1})
    assert model.points.tolist() == [[1000, 2.5], [3000, 4]]
    with pytest.raises(InvalidData, match="sheets with content: 'Sheet', 'Nodes'"):
        ct.load(tmp_path / "a.xlsx", data={"vehicles": 1})


HEADER = "time [s];speed [km/h];steering_wheel [deg];yaw_rate [deg/s];lateral_acceleration [m/s**2]"


def drive(lines: dict[int, str | None] | None = None) -> str:
    """Return a recording at 20 Hz, with changed lines."""
    rows = [f"{k / 20};{36 + k};{16 * k};{k};{k / 10}".replace(".", ",") for k in range(20)]
    for at, row in sorted((lines or {}).items(), reverse=True):
        rows[at : at + 1] = [] if row is None else [row]
    return "\n".join([HEADER, *rows]) + "\n"


def test_recordings_with_a_steering_wheel_and_gaps(tmp_path, caplog):
    file = written(tmp_path, drive())
    whole = read_recording(file, steering_ratio=16)
    assert whole.steering == pytest.approx(np.radians(np.arange(20)))
    assert whole.speed[0] == pytest.approx(10)
    loaded = ct.load(file, data={"steering_ratio": 16}).recording
    assert loaded.data() == whole.data()
    with pytest.raises(InvalidData, match="missing: steering"):
        read_recording(file)
    with pytest.raises(InvalidData, match="steering_ratio must be > 0"):
        read_recording(file, steering_ratio=0)
    columns = {"steering_wheel": "steering_wheel"}
    with pytest.raises(InvalidData, match="steering_ratio must be given"):
        read_recording(file, columns=columns)
    file = written(tmp_path, drive({4: "0,2;40;NA;4;0,4", 5: "0,25;41;-;5;0,5", 9: None, 10: None}))
    with pytest.raises(InvalidData, match=r"line 6, column steering_wheel.*got 'NA'.*is missing"):
        read_recording(file, steering_ratio=16)
    with caplog.at_level(logging.WARNING, "crosstrack"):
        filled = read_recording(file, steering_ratio=16, missing="interpolate")
    assert np.allclose(filled.steering, whole.steering) and np.allclose(filled.times, whole.times)
    assert "10 missing cells are interpolated, the longest gap is 0.15 s" in caplog.text
    assert "2 missing rows are interpolated" in caplog.text
    lost = {k: f"{k / 20};40;NA;4;4".replace(".", ",") for k in range(4, 9)}
    for lines, message in (
        (lost, "values are missing for 0.3 s; at most 0.25 s are interpolated"),
        ({0: "0;;0;0;0"}, "column speed: must have a value, because no sample before it"),
        ({19: "0,95;;0;0;0"}, "column speed: must have a value, because no sample after it"),
        ({3: ";40;0;0;0"}, "column time .s.: must be a finite number, got ''"),
    ):
        with pytest.raises(InvalidData, match=message):
            read_recording(
                written(tmp_path, drive(lines)), steering_ratio=16, missing="interpolate"
            )


def test_missing_rows_of_a_recording_are_limited(tmp_path):
    steps = np.where(np.arange(60) % 3, 1e-6, 0.2)
    times = np.append(0.0, np.cumsum(steps))
    text = "\n".join([HEADER.replace(";", ","), *(f"{time:.6f},40,1,1,1" for time in times)])
    with pytest.raises(InvalidData, match=r"column time: 3\.99998e\+06 rows are missing for 61"):
        read_recording(written(tmp_path, text), steering_ratio=16, missing="interpolate")


def test_series_with_several_columns_and_gaps(tmp_path):
    heights = [round(np.sin(k / 3), 6) for k in range(60)]
    rows = [f"{k},{height},{k}" for k, height in enumerate(heights)]
    rows[7], rows[9:11] = "7,,7", []
    file = written(tmp_path, "\n".join(["time [ms],height [m],n", *rows]))
    with pytest.raises(InvalidData, match=r"several columns of values, height \[m\], n"):
        ct.load(file, model="attractor")
    options = {"missing": "interpolate", "data": {"column": "height"}}
    series = ct.load(file, model="attractor", **options)
    assert series.period == pytest.approx(1e-3) and len(series.series) == 60
    assert series.series[7] == pytest.approx((heights[6] + heights[8]) / 2)
    assert series.series[10] == pytest.approx(heights[8] + (heights[11] - heights[8]) * 2 / 3)
    with pytest.raises(InvalidData, match=r"line 9, column height .m.: must be a finite number"):
        read_series(file, "height")
    gap = written(tmp_path, "\n".join(["time [ms],height [m]", *rows[:20], *rows[30:]]))
    with pytest.raises(InvalidData, match=r"13 values|3 values where the header has 2"):
        read_series(gap, missing="interpolate")
    gap = written(tmp_path, "\n".join(["time [ms],height [m],n", *rows[:20], *rows[30:]]))
    with pytest.raises(InvalidData, match="must leave no gap"):
        read_series(gap, "height", missing="interpolate")


def test_samples_with_missing_cells(tmp_path):
    rows = [f"{k / 100},{k * k},{2 * k}" for k in range(6)]
    rows[2] = "0.02,,4"
    file = written(tmp_path, "\n".join(["t,x,vx", *rows]))
    with pytest.raises(InvalidData, match="line 4, column x: must be a finite number, got ''"):
        read_samples(file)
    assert read_samples(file, missing="interpolate").values[0, 2, 0] == pytest.approx(5.0)
    last = written(tmp_path, "t,x,y\n0,0,0\n0.05,2,\n0.1,4,6\n")
    assert read_samples(last, missing="interpolate").values[0, 1].tolist() == [2.0, 3.0]
    with pytest.raises(InvalidData, match=r"line 3, column y: .* the value is missing"):
        read_samples(last)
    book = openpyxl.Workbook()
    for row in (["t", "x", "y"], [0, 0, 0], [0.05], [0.1, 4, 6]):
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    filled = read_samples(tmp_path / "a.xlsx", missing="interpolate")
    assert filled.values[0, 1].tolist() == [2.0, 3.0]
    for read in (read_nodes, read_points, read_waypoints, read_stops):
        with pytest.raises(InvalidData, match="are not samples over time"):
            read(file, missing="interpolate")
    with pytest.raises(InvalidData, match="missing must be absent or 'interpolate', got 'drop'"):
        read_samples(file, missing="drop")


def chord_distance(lat: np.ndarray, lon: np.ndarray) -> np.ndarray:
    """Return the distances of all pairs on WGS 84, from chords of a sphere of mean curvature."""
    lat, lon = np.radians(lat), np.radians(lon)
    square = 6.69437999014e-3
    across = 6378137.0 / np.sqrt(1 - square * np.sin(lat) ** 2)
    points = np.stack(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), (1 - square) * np.sin(lat)], axis=1
    )
    points *= across[:, None]
    chords = np.linalg.norm(points[:, None] - points, axis=-1)
    return 2 * 6371e3 * np.arcsin(chords / (2 * 6371e3))


@pytest.mark.parametrize(
    ("lat", "lon", "reach"),
    [(52, 4, 0.05), (0, 180, 2), (-33, 151, 4), (90, 0, 3), (-90, 77, 3), (70, -180, 4)],
)
def test_projected_distances_are_within_the_stated_error(lat, lon, reach, caplog):
    rng = np.random.default_rng(1)
    north = np.clip(lat + rng.uniform(-reach, reach, 40), -90, 90)
    wide = 180 if abs(lat) == 90 else reach / np.cos(np.radians(lat))
    east = (lon + rng.uniform(-wide, wide, 40) + 180) % 360 - 180
    with caplog.at_level(logging.WARNING, "crosstrack"):
        plane = project_positions(north, east, "a.csv")
    stated = float(caplog.text.split("at most ")[1].split()[0]) / 100
    expected = chord_distance(north, east)
    distances = np.linalg.norm(plane[:, None] - plane, axis=-1)
    apart = expected > 1.0
    ratio = distances[apart] / expected[apart] - 1
    # The chords of a sphere are themselves wrong by about 1e-5 of a distance below 1000 km.
    assert ratio.min() > -2e-5 and ratio.max() < 1.05 * stated + 2e-5
    assert ratio.max() > 0.05 * stated


def test_the_projection_agrees_with_known_distances():
    # One degree of latitude at the equator and at 60° N, and of longitude at 60° N (GRS 80 tables).
    for lat, lon, metres in (
        ((-0.5, 0.5), (0, 0), 110574.3),
        ((59.5, 60.5), (0, 0), 111412.2),
        ((60, 60), (-0.5, 0.5), 55799.5),
    ):
        plane = project_positions(lat, lon, "a.csv")
        assert np.linalg.norm(plane[1] - plane[0]) == pytest.approx(metres, rel=3e-5)
    assert np.allclose(project_positions([5, 5], [7, 7], "a.csv"), 0.0, atol=1e-6)
    for lat in (0.0, 90.0, -90.0):
        assert np.allclose(project_positions([lat], [0.0], "a.csv"), 0.0, atol=1e-6)


def test_fleets_with_latitudes(tmp_path, caplog):
    text = "name;Latitude;Longitude;demand\n;°;°;kg\nhub;52,0;4,0;0\na;52,1;4,0;2\nb;52,0;4,1;3\n"
    file = written(tmp_path, text)
    with caplog.at_level(logging.WARNING, "crosstrack"):
        model = ct.load(file, data={"vehicles": 1, "capacity": 9})
    assert np.linalg.norm(model.points[1] - model.points[0]) == pytest.approx(11126.1, rel=1e-4)
    assert np.linalg.norm(model.points[2] - model.points[0]) == pytest.approx(6867.9, rel=1e-4)
    assert "azimuthal equidistant about 52.0333° N, 4.0334° E" in caplog.text
    both = written(tmp_path, "x,y,B,L\n0,0,52.0,4.0\n1,1,52.1,4.0\n")
    with caplog.at_level(logging.WARNING, "crosstrack"):
        points = read_nodes(both, columns={"lat": "B", "lon": "L"})["points"]
    assert np.linalg.norm(np.subtract(*points)) == pytest.approx(11126.1, rel=1e-4)
    assert "columns that are not read: x, y" in caplog.text
    for text, message in (
        ("lat,lon\n52,4\n60,40\n", "must be within 1100 km of their centre"),
        ("lat,lon\n0,0\n0,180\n", "must be within 1100 km"),
        ("lat,lon\n91,0\n", "line 2, column lat: must be -90 … 90 deg, got '91'"),
        ("lat,y\n1,0\n", "must be a header of nodes"),
    ):
        with pytest.raises(InvalidData, match=message):
            read_nodes(written(tmp_path, text))


def test_mutated_tables_are_read_right_or_rejected():
    verdicts = main(250)
    assert min(verdicts[word] for word in ("read", "damaged", "rejected")) > 20


def test_maps_with_longitudes(tmp_path, caplog):
    ring = [[4.0, 52.0], [4.01, 52.0], [4.01, 52.01], [4.0, 52.01], [4.0, 52.0]]
    hole = [[4.004, 52.004], [4.006, 52.004], [4.006, 52.006], [4.004, 52.004]]
    file = written(tmp_path, json.dumps({"type": "Polygon", "coordinates": [ring, hole]}), "a.json")
    (polygon,) = read_geojson_polygons(file, geographic=True)
    width, height = np.ptp(polygon.shell, axis=0)
    assert (width, height) == pytest.approx((686.9, 1112.6), rel=1e-3)
    assert len(polygon.holes) == 1
    # The corners of the bounds move the centre, and the cells cover them.
    entry = {"file": "a.json", "bounds": [3.99, 51.99, 4.02, 52.02], "cell": 50, "geographic": True}
    data = {"map": entry, "start": [1, 1], "goals": [30, 30]}
    whole = written(tmp_path, json.dumps({"model": "grid-path", "data": data}), "whole.json")
    grid = ct.load(whole).map
    assert grid.blocked.shape == (67, 42)
    assert 300 < grid.blocked[:-1, :-1].sum() < 400
    file = written(
        tmp_path, json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [0, 95], [5, 0]]]})
    )
    with pytest.raises(InvalidData, match=r"latitudes.1. must be .*got 95"):
        read_geojson_polygons(file, geographic=True)
