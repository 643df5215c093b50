"""Instance files in and out: JSON, CSV, references, faults that are named."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from crosstrack import instances
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.instances import error_correction as ec
from crosstrack.models import ErrorCorrectionRouting, Model, Route

SHARED = Path(__file__).parents[3] / "shared" / "data" / "error-correction" / "points_327.csv"
CONTEST = {
    7: "0-163-114-8-309-305-123-45-160-92-93-61-292-326",
    8: "0-163-114-234-309-305-123-45-160-92-93-61-326",
    9: "0-114-305-45-160-326",
}
DATA = {
    "kinds": ["A", "horizontal", "vertical", "B"],
    "alpha1": 25, "alpha2": 15, "beta1": 20, "beta2": 25, "theta": 30, "delta": 0.001,
}  # fmt: skip
POINTS = [[0, 0, 0], [1.5, 2.5, 3.5], [1e-3, -7, 0.1], [9, 9, 9]]
LIMITS = {name: DATA[name] for name in ("alpha1", "alpha2", "beta1", "beta2", "theta", "delta")}
TABLE = "id,x,y,z,kind\n0,0,0,0,A\n1,1.5,2.5,3.5,0\n2,0.001,-7,0.1,1\n3,9,9,9,B\n"


# -- files ---------------------------------------------------------------------------------------

numbers = st.floats(allow_nan=False, allow_infinity=False)
words = st.text(min_size=1, max_size=5).filter(lambda w: w.isprintable() and w.strip() == w)


@st.composite
def routings(draw):
    n = draw(st.integers(2, 6))
    kinds = [
        "A",
        *draw(st.lists(st.sampled_from(DATA["kinds"][1:3]), min_size=n - 2, max_size=n - 2)),
        "B",
    ]
    labels = st.one_of(
        st.none(),
        st.lists(st.integers(), min_size=n, max_size=n, unique=True),
        st.lists(words.map("p".__add__), min_size=n, max_size=n, unique=True),
    )
    return ErrorCorrectionRouting(
        points=draw(st.lists(st.lists(numbers, min_size=3, max_size=3), min_size=n, max_size=n)),
        kinds=draw(st.permutations(kinds)),
        **dict(zip(ec.Thresholds._fields, draw(st.tuples(*[st.floats(0, 1e9)] * 5)), strict=True)),
        horizontal_rate=draw(st.floats(0, 1)),
        vertical_rate=draw(st.floats(0, 1)),
        revisits=draw(st.booleans()),
        ids=draw(labels),
        name=draw(words),
    )


def same(one, other):
    ids = [
        tuple(range(len(model.points))) if model.ids is None else model.ids
        for model in (one, other)
    ]
    assert one.digest == other.digest
    assert one.name == other.name
    assert ids[0] == ids[1]


@settings(deadline=None, max_examples=100)
@given(model=routings())
def test_written_files_are_read_back(model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    for points in (None, "points.csv"):
        path = ec.write_json(model, folder / "instance.json", points=points)
        same(instances.load(path), model)
    same(Model.from_json(instances.write_model(model, path).read_text(encoding="utf-8")), model)
    assert sorted(file.name for file in folder.iterdir()) == ["instance.json", "points.csv"]
    table = ec.read_points(ec.write_csv(model, folder / "points.csv"))
    assert table.points.tobytes() == model.points.tobytes()
    assert list(table.kinds) == model.kinds.tolist()


@pytest.mark.parametrize(
    "ids", [("1", "2", "3", "4"), (1, "two", 3, 4), (" a", "b", "c", "d"), ("", "b", "c", "d")]
)
def test_ids_that_a_csv_cannot_hold_are_refused(ids, tmp_path):
    model = ErrorCorrectionRouting(POINTS, **DATA, ids=ids, name="with ids")
    (tmp_path / "points.csv").write_text("kept")
    with pytest.raises(InvalidData, match="id"):
        ec.write_csv(model, tmp_path / "points.csv")
    assert (tmp_path / "points.csv").read_text() == "kept"
    same(instances.load(ec.write_json(model, tmp_path / "instance.json")), model)


def test_a_file_without_a_name_names_its_model(tmp_path):
    model = ErrorCorrectionRouting(POINTS, **DATA)
    assert instances.load(ec.write_json(model, tmp_path / "north.json")).name == "north"


def read(tmp_path, content):
    path = tmp_path / "points.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return ec.read_points(path)


@pytest.mark.parametrize(
    "content",
    [
        TABLE,
        TABLE.replace("\n", "\r\n"),
        "\ufeff" + TABLE,
        TABLE.replace("\n", "\n\n"),
        TABLE.rstrip("\n"),
        TABLE.replace(",", " , "),
        TABLE.replace("id,x,y,z,kind", "ID,X,Y,Z,Kind"),
        TABLE.replace(",0\n", ",horizontal\n").replace(",1\n", ",vertical\n"),
        'kind,note,z,id,y,x\nA,"a, b",0,0,0,0\n0,"two\nlines",3.5,1,2.5,1.5\n1,,1e-1,2,-7,1E-3\nB,é,9,3,9,9\n',
    ],
)
def test_tolerated_csv(content, tmp_path):
    table = read(tmp_path, content)
    assert table.points.tolist() == POINTS
    assert table.kinds == ("A", "horizontal", "vertical", "B")
    assert table.ids is None


@pytest.mark.parametrize(
    ("labels", "ids"),
    [
        ("0 1 2 3", None),
        ("1 2 3 4", (1, 2, 3, 4)),
        ("3 2 1 0", (3, 2, 1, 0)),
        ("007 1 2 3", ("007", "1", "2", "3")),
        ("a b c d", ("a", "b", "c", "d")),
        ("0 1 2 -3", (0, 1, 2, -3)),
    ],
)
def test_ids_are_numbers_where_all_are(labels, ids, tmp_path):
    rows = zip(labels.split(), TABLE.splitlines()[1:], strict=True)
    content = "id,x,y,z,kind\n" + "\n".join(
        f"{label},{row.split(',', 1)[1]}" for label, row in rows
    )
    assert read(tmp_path, content).ids == ids


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("x,y,z", "x,y,w", r"line 1: column 'z' is missing; found 'id, x, y, w, kind'"),
        ("x,y,z", "x,x,z", "line 1: column 'x' stands twice"),
        ("1,1.5", "1,one", "line 3, column x: must be a finite number, got 'one'"),
        ("1,1.5", "1,nan", "line 3, column x: must be a finite number, got 'nan'"),
        ("1,1.5", "1,-inf", "line 3, column x: must be a finite number, got '-inf'"),
        ("1,1.5", "1,1e999", "line 3, column x: must be a finite number, got '1e999'"),
        ("1,1.5", "1,1_5", "line 3, column x: must be a finite number, got '1_5'"),
        ("1,1.5", "1,", "line 3, column x: must be a finite number, got ''"),
        (",3.5,0", ",3.5,3", "line 3, column kind: must be one of A, horizontal.* got '3'"),
        (",3.5,0", ",3.5,north", "line 3, column kind: .*got 'north'"),
        ("2,0.001", "1,0.001", "line 4, column id: '1' is in line 3 too"),
        ("2,0.001", ",0.001", "line 4, column id: must not be empty"),
        (",3.5,0", ",3.5", "line 3: 4 values where the header has 5 columns"),
        (",3.5,0", ",3.5,0,7", "line 3: 6 values where the header has 5 columns"),
        (",A", ",0", "no point is of kind A"),
        (",B", ",1", "no point is of kind B"),
        (",3.5,0", ",3.5,A", "line 3, column kind: a second A, the first is in line 2"),
        (",3.5,0", ',3.5,"0', "line 3: no valid CSV"),
        (",", "|", "column 'x' is missing.*separated by commas"),
    ],
)
def test_faults_in_a_csv_name_line_and_column(old, new, message, tmp_path):
    with pytest.raises(InvalidData, match=rf"points\.csv(:|, ).*{message}|{message}") as caught:
        read(tmp_path, TABLE.replace(old, new))
    assert str(caught.value).startswith(str(tmp_path / "points.csv"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"\n\n", "the file is empty"),
        (b"id,x,y,z,kind\n", "no points below the header"),
        (TABLE.replace("A", "\u5357").encode("gbk"), "line 2: byte 0x.. is no UTF-8"),
        (b"\xff" + TABLE.encode(), "line 1: byte 0xff is no UTF-8"),
    ],
)
def test_files_without_a_table_are_rejected(content, message, tmp_path):
    with pytest.raises(InvalidData, match=message):
        read(tmp_path, content)


def test_an_instance_file_refers_to_a_csv_beside_it(tmp_path):
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "four.csv").write_text(TABLE)
    path = tmp_path / "instance.json"

    def write(**changes):
        data = {"points": "points/four.csv", **LIMITS, **changes}
        path.write_text(json.dumps({"model": "error-correction", "data": data}))
        return path

    assert instances.load(write()).digest == ErrorCorrectionRouting(POINTS, **DATA).digest
    assert instances.load(str(write())).digest == ErrorCorrectionRouting(POINTS, **DATA).digest
    assert instances.load(write(revisits=True)).revisits
    for key in ("kinds", "ids"):
        with pytest.raises(InvalidData, match=f"{key} must not be given: the file holds it"):
            instances.load(write(**{key: ["A"]}))
    with pytest.raises(InvalidData, match=r"instance\.json: .*three\.csv: no such file"):
        instances.load(write(points="three.csv"))
    with pytest.raises(InvalidData, match=r"instance\.json: alpha1 must be >= 0, got -1"):
        instances.load(write(alpha1=-1))
    with pytest.raises(InvalidData, match=r"instance\.json: unknown key 'gamma'"):
        instances.load(write(gamma=1))


def test_points_of_a_csv_with_thresholds(tmp_path):
    path = tmp_path / "four.csv"
    path.write_text(TABLE)
    model = ec.read_csv(path, **LIMITS)
    assert model.digest == ErrorCorrectionRouting(POINTS, **DATA).digest
    assert model.name == "four"
    assert ec.read_csv(path, **LIMITS, name="mine").name == "mine"
    with pytest.raises(InvalidData, match="'theta' is missing"):
        ec.read_csv(path, **{k: v for k, v in LIMITS.items() if k != "theta"})
    with pytest.raises(InvalidData, match="kinds must not be given"):
        ec.read_csv(path, **DATA)
    with pytest.raises(InvalidData, match=r"(?s)keys 'alpha1', .* are missing.*--data KEY"):
        instances.load(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty"),
        ("\n", "no valid JSON"),
        ("[]", "a model must be an object"),
        ("{", "no valid JSON"),
        ('{"model": "error-correction"}', "'data' is missing"),
        ('{"model": "error-correction", "data": [1]}', "data must be an object"),
        ('{"model": 7, "data": {}}', "model must be a string"),
        ('{"model": "error-correction", "data": {}, "data": {}}', "stands twice"),
        ('{"model": "error-correction", "data": {"theta": NaN}}', "NaN is no JSON number"),
        ("[" * 200_000, "nested too deeply|no valid JSON"),
    ],
)
def test_faults_in_json_name_the_file(content, message, tmp_path):
    path = tmp_path / "instance.json"
    path.write_text(content)
    with pytest.raises(InvalidData, match=rf"instance\.json: .*({message})"):
        instances.load(path)


def test_files_of_other_models_pass_and_may_refer_to_files(tmp_path, monkeypatch):
    path = tmp_path / "any.json"
    path.write_text('{"model": "no-such-model", "data": {}}')
    with pytest.raises(UnknownName, match="unknown model 'no-such-model'"):
        instances.load(path)
    monkeypatch.setattr("crosstrack.instances.storage._REGISTERED", {})
    instances.register_references(
        "error-correction",
        lambda data, find: {**data, **json.loads(find(data["file"]).read_text())},
    )
    (tmp_path / "rest.json").write_text(json.dumps({"points": POINTS, **DATA, "file": None}))
    path.write_text('{"model": "error-correction", "data": {"file": "rest.json"}}')
    with pytest.raises(InvalidData, match="unknown key 'file'"):
        instances.load(path)
    (tmp_path / "rest.json").write_text(json.dumps({"points": POINTS, **DATA}))
    instances.register_references(
        "error-correction", lambda data, find: json.loads(find(data["file"]).read_text())
    )
    assert instances.load(path).digest == ErrorCorrectionRouting(POINTS, **DATA).digest


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path, link = tmp_path / "instance.json", tmp_path / "link.json"
    model = instances.load("error-correction/1")
    instances.write_model(model, path)
    link.symlink_to(path)
    instances.write_model(model, link)
    assert link.is_symlink()

    def fail(self, target):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail)
        with pytest.raises(InvalidData, match="cannot be written: No space left"):
            instances.write_model(instances.load("error-correction/2"), path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["instance.json", "link.json"]
    assert instances.load(path).digest == model.digest
    with pytest.raises(InvalidData, match="cannot be written"):
        instances.write_model(model, tmp_path / "nowhere" / "instance.json")
    with pytest.raises(InvalidData, match="a folder"):
        instances.load(tmp_path)


def test_written_json_is_for_people_too(tmp_path):
    model = ErrorCorrectionRouting(POINTS, **DATA, name="四")
    lines = instances.write_model(model, tmp_path / "i.json").read_text("utf-8").splitlines()
    assert '  "name": "四",' in lines
    assert "      [1.5, 2.5, 3.5]," in lines
    assert '    "theta": 30.0,' in lines


@pytest.mark.skipif(not SHARED.exists(), reason="the public contest data is not beside the project")
@pytest.mark.parametrize("row", [7, 8, 9])
def test_the_contest_data(row, tmp_path):
    """Real input reads, and its proven optimum verifies with the length in the settings."""
    setting = ec.SETTINGS[row]
    model = ec.read_csv(SHARED, **setting.thresholds._asdict(), delta=0.001)
    assert model.ids is None
    assert model.describe() == instances.load(f"error-correction/{row}").describe()
    found = model.verify(Route(tuple(map(int, CONTEST[row].split("-")))))
    assert found.ok
    assert found.objective == pytest.approx(setting.contest_optimum, abs=5e-4)
    path = ec.write_json(model, tmp_path / "row.json", points="points.csv")
    assert instances.load(path).digest == model.digest
    with (tmp_path / "points.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert (
        np.array([[float(r[axis]) for axis in "xyz"] for r in rows]).tobytes()
        == model.points.tobytes()
    )
