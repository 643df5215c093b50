"""Points as people have them: the contest's own file, Excel, no header, other codes, and hostile files."""

import io
import json
import logging
import sys
import zipfile
from pathlib import Path

import pytest
from commands import run

import crosstrack as ct
from crosstrack.errors import BackendMissing, InvalidData, UnsupportedOption
from crosstrack.instances import error_correction as ec, excel, read_waypoints

openpyxl = pytest.importorskip("openpyxl", reason="Excel files need openpyxl")

SHARED = Path(__file__).parents[3] / "shared" / "data" / "error-correction" / "points_327.csv"
LIMITS = {"alpha1": 25, "alpha2": 15, "beta1": 20, "beta2": 25, "theta": 30, "delta": 0.001}
GIVEN = [word for key, value in LIMITS.items() for word in ("--data", f"{key}={value}")]
TITLE = ["附件2：数据集2"]
HEADER = [
    "编号",
    "X坐标（单位: m）",
    "Y坐标（单位:m）",
    "Z坐标（单位: m）",
    "校正点类型",
    "第三问点标记",
]
#: Four points as the contest writes them: ends in words, others by number, a mark for its third problem.
ROWS = [
    [0, 0.0, 50000, 5000.0, "A 点", 0],
    [1, 9000.5, 50000.0, 5000.0, 1, 0],
    [2, 18000.0, 50000.0, 5000.25, 0, 1],
    [3, 27000.0, 50000.0, 5000.0, "B点", 0],
]
KINDS = ("A", "vertical", "horizontal", "B")


def workbook(path, rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def as_csv(rows):
    return "".join(",".join(map(str, row)) + "\n" for row in rows)


def coded(rows):
    """The rows with codes for the ends, as a solution of the contest on the web writes them."""
    return [[{"A 点": -1, "B点": 2}.get(cell, cell) for cell in row] for row in rows]


@pytest.mark.parametrize(
    "rows",
    [
        [TITLE, HEADER, *ROWS],
        [HEADER, *ROWS],
        ROWS,
        coded(ROWS),
        [row[1:] for row in ROWS],
        [row[1:5] for row in coded(ROWS)],
        [row[:5] for row in ROWS],
        [HEADER[1:], *(row[1:] for row in ROWS)],
        [["note", *HEADER], *([f"n{k}", *row] for k, row in enumerate(ROWS))],
    ],
)
@pytest.mark.parametrize("form", ["xlsx", "csv"])
def test_the_contests_file_is_read_as_it_is(form, rows, tmp_path):
    file = tmp_path / f"points.{form}"
    if form == "xlsx":
        workbook(file, rows)
    else:
        # A table that passed through floating-point numbers has 0.0 for 0; a title fills its row.
        wide = [row + [""] * (max(map(len, rows)) - len(row)) for row in rows]
        file.write_text(as_csv(wide).replace(",1,0\n", ",1.0,0\n"), "utf-8")
    table = ec.read_points(file)
    assert table.points.tolist() == [row[1:4] for row in ROWS]
    assert table.kinds == KINDS
    assert table.ids is None


def test_one_of_several_sheets_must_be_named(tmp_path):
    file = workbook(tmp_path / "points.xlsx", ROWS)
    book = openpyxl.load_workbook(file)
    book.create_sheet("empty")
    book.create_sheet("limits").append(["theta", 30])
    book.save(file)
    with pytest.raises(InvalidData, match=r"sheet must name one of the .*: 'Sheet', 'limits'"):
        ec.read_points(file)
    for sheet in ("Sheet", 1, "1"):
        assert len(ec.read_points(file, sheet=sheet).points) == len(ROWS)
    for sheet in ("Points", 4, 0, -1, 1.5):
        with pytest.raises(InvalidData, match="sheet must be a name or number of 'Sheet', 'empty'"):
            ec.read_points(file, sheet=sheet)
    with pytest.raises(InvalidData, match="encoding is for text files"):
        ec.read_points(file, encoding="latin-1")


def test_columns_that_are_not_used_are_named(tmp_path, caplog):
    file = workbook(tmp_path / "points.xlsx", [TITLE, HEADER, *ROWS])
    with caplog.at_level(logging.WARNING, "crosstrack"):
        assert ec.read_points(file).fail is not None
        ec.read_points(workbook(tmp_path / "bare.xlsx", ROWS))
    assert [record.getMessage().partition(": ")[2] for record in caplog.records] == [
        "a title that is not read: '附件2：数据集2'",
        "not used: 'column 6'",
    ]


@pytest.mark.parametrize("form", ["xlsx", "csv"])
def test_a_file_of_points_is_solved_with_the_missing_fields(form, tmp_path):
    file = tmp_path / f"points.{form}"
    rows = [HEADER[:5], *(row[:5] for row in ROWS)]
    workbook(file, rows) if form == "xlsx" else file.write_text(as_csv(rows), "utf-8")
    done = run("solve", file, *GIVEN, "--json")
    assert json.loads(done.stdout)["plan"] == {"route": [0, 3]}
    assert json.loads(done.stdout)["instance"] == "points"
    assert ct.load(file, data=LIMITS).digest == ec.read_csv(file, **LIMITS).digest
    lacking = run("solve", file, *GIVEN[4:], code=2).stderr
    assert "error-correction: keys 'alpha1', 'alpha2' are missing" in lacking
    assert "--data KEY=VALUE" in lacking
    assert "delta" in run("solve", file, *GIVEN[:-2], code=2).stderr
    assert "did you mean 'theta'" in run("solve", file, *GIVEN, "--data", "tetha=1", code=2).stderr
    assert "the file holds it" in run("solve", file, "--data", "points=1", code=2).stderr
    instance = tmp_path / "instance.json"
    instance.write_text(
        json.dumps({"model": "error-correction", "data": {**LIMITS, "points": file.name}})
    )
    assert ct.load(instance).digest == ct.load(file, data=LIMITS).digest
    with pytest.raises(UnsupportedOption, match="whole instance"):
        ct.load(instance, data=LIMITS)
    with pytest.raises(UnsupportedOption, match="whole instance"):
        ct.load("error-correction/7", model="error-correction")


@pytest.mark.parametrize("form", ["xlsx", "csv"])
def test_a_file_of_waypoints_names_the_missing_fields(form, tmp_path):
    file, rows = tmp_path / f"way.{form}", [["x", "y"], [0, 0], [1.5, 2], [3, 2]]
    workbook(file, rows) if form == "xlsx" else file.write_text(as_csv(rows))
    assert read_waypoints(file).tolist() == rows[1:]
    text = run("solve", file, code=2).stderr
    assert "minimum-snap: key 'times' is missing" in text
    assert "time-allocation: " in text
    assert "total_time" in text
    assert ct.load(file, data={"times": [0, 1, 2]}).kind == "minimum-snap"
    assert ct.load(file, data={"total_time": 3}).kind == "time-allocation"
    chosen = ct.load(file, data={"times": [0, 1, 2], "order": 3}, model="minimum-derivative")
    assert chosen.kind == "minimum-derivative"
    assert "unknown model" in run("solve", file, "--model", "covering", code=2).stderr


def test_an_unknown_table_names_the_supported_columns(tmp_path):
    file = tmp_path / "any.csv"
    file.write_text("name,colour\nsky,blue\n")
    text = run("solve", file, code=2).stderr
    assert "data of no model" in text
    assert "column 'x' is missing" in text
    with pytest.raises(InvalidData, match="no such file"):
        ct.load(tmp_path / "none.xlsx")


def test_excel_without_openpyxl_exits_with_5(tmp_path, monkeypatch):
    file = workbook(tmp_path / "points.xlsx", ROWS)
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(BackendMissing, match=r"pip install 'crosstrack\[xlsx\]'"):
        ec.read_points(file)
    assert "crosstrack[xlsx]" in run("solve", file, *GIVEN, code=5).stderr


# -- hostile files ---------------------------------------------------------------------------------


def changed(path, name, change):
    """Write the contest's file to `path` with one part of the archive changed."""
    source = io.BytesIO()
    workbook(source, [HEADER, *ROWS])
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        assert name in old.namelist()
        for part in old.namelist():
            content = old.read(part)
            new.writestr(part, change(content) if part == name else content)
    return path


SHEET = "xl/worksheets/sheet1.xml"
BOMB = b"""<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "%s">%s]>""" % (
    b"a" * 100,
    b"".join(b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 100) for k in range(6)),
)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        (SHEET, lambda old: old[: len(old) // 2]),
        (SHEET, lambda old: b"\xff\x00" * 50),
        (SHEET, lambda old: BOMB + b"<worksheet><sheetData><row><c><v>&g;</v></c></row></sheetData></worksheet>"),
        (SHEET, lambda old: old.replace(b'<row r="2"', b'<row r="2000000000"')),
        (SHEET, lambda old: old.replace(b'r="A2"', b'r="ZZZ2"')),
        (SHEET, lambda old: old.replace(b"<v>1</v>", b"<v>1e999</v>")),
        ("xl/workbook.xml", lambda old: b"<workbook/>"),
        ("[Content_Types].xml", lambda old: b""),
    ],
)  # fmt: skip
def test_a_damaged_excel_file_is_invalid_data(name, change, tmp_path):
    file = changed(tmp_path / "points.xlsx", name, change)
    with pytest.raises(InvalidData, match=r"points\.xlsx"):
        ec.read_points(file)
    if name != SHEET:  # the command line treats the same exception in one way
        assert "Traceback" not in run("solve", file, *GIVEN, code=2).stderr


def test_an_excel_file_is_read_within_bounds(tmp_path, monkeypatch):
    monkeypatch.setattr(excel, "UNPACKED", 2 << 20)
    zeros = changed(tmp_path / "bomb.xlsx", SHEET, lambda old: old + b" " * (3 << 20))
    assert zeros.stat().st_size < 1 << 20
    with pytest.raises(InvalidData, match="unpacked"):
        ec.read_points(zeros)
    for content in (b"", b"no archive", b"PK\x03\x04" + bytes(60)):
        (tmp_path / "no.xlsx").write_bytes(content)
        with pytest.raises(InvalidData, match="no Excel file"):
            ec.read_points(tmp_path / "no.xlsx")
    for path in (tmp_path, Path("/dev/zero")):
        (tmp_path / "link.xlsx").unlink(missing_ok=True)
        (tmp_path / "link.xlsx").symlink_to(path)
        with pytest.raises(InvalidData, match="no regular file"):
            ec.read_points(tmp_path / "link.xlsx")
    wide = workbook(tmp_path / "wide.xlsx", [[*HEADER, *range(60)], *ROWS])
    with pytest.raises(InvalidData, match="64 columns"):
        ec.read_points(wide)
    monkeypatch.setattr(excel, "ROWS", 3)
    with pytest.raises(InvalidData, match="at most 3 rows"):
        ec.read_points(workbook(tmp_path / "long.xlsx", ROWS))


def test_a_formula_is_read_as_its_stored_value(tmp_path):
    """A formula without a stored value is None, and links to other files are not followed."""
    rows = [[*row] for row in ROWS]
    rows[0][1] = "='[/etc/passwd]Sheet1'!A1"
    file = workbook(tmp_path / "points.xlsx", [HEADER, *rows])
    with pytest.raises(InvalidData, match="line 2, column x: must be a finite number"):
        ec.read_points(file)
    stored = changed(
        tmp_path / "stored.xlsx", SHEET, lambda old: old.replace(b"<v>9000.5</v>", b"<f>1+1</f><v>9000.5</v>")
    )  # fmt: skip
    assert ec.read_points(stored).points[1].tolist() == [9000.5, 50000, 5000]


@pytest.mark.skipif(not SHARED.exists(), reason="the public contest data is not beside the project")
@pytest.mark.parametrize("how", ["xlsx", "codes"])
def test_the_public_points_in_the_contest_format(how, tmp_path):
    """Row 8 of the paper's table 1, whose optimum is known, with no code of a user's."""
    with SHARED.open(encoding="utf-8") as stream:
        rows = [line.rstrip("\n").split(",") for line in stream][1:]
    cells = [
        [int(k), float(x), float(y), float(z), kind if kind in "AB" else int(kind), int(fail)]
        for k, x, y, z, kind, fail in rows
    ]
    if how == "xlsx":
        words = [[f"{cell}点" if cell in ("A", "B") else cell for cell in row] for row in cells]
        file = workbook(tmp_path / "contest.xlsx", [TITLE, HEADER, *words])
    else:
        file = tmp_path / "contest.csv"
        codes = [[{"A": -1, "B": 2}.get(cell, cell) for cell in row] for row in cells]
        file.write_text(as_csv(codes))
    found = json.loads(run("solve", file, *GIVEN, "--json").stdout)
    assert found["primal_bound"] == pytest.approx(106545.931, abs=5e-4)
    assert found["plan"]["route"] == [0, 163, 114, 234, 309, 305, 123, 45, 160, 92, 93, 61, 326]
