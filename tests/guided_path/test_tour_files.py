"""Files of guided path tours: TSPLIB's sequential ordering problems, tables of stops, exports."""

import csv
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from guided_path.enumerated import tours
from hypothesis import given, settings

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import export_formats, export_plan, read_model
from crosstrack.instances.guided_path import (
    generate,
    generate_relation,
    read_sop,
    read_stops,
    write_sop,
)
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "sop"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public instances lie in ../shared/data/sop, which is absent"
)


def written(tmp_path, text, name="file.csv"):
    path = tmp_path / name
    path.write_text(text, "utf-8")
    return path


# -- SOP files -----------------------------------------------------------------------------------

SOP = """NAME: tiny
TYPE: SOP
COMMENT: any : thing
DIMENSION: 4
EDGE_WEIGHT_TYPE: EXPLICIT
EDGE_WEIGHT_FORMAT: FULL_MATRIX
EDGE_WEIGHT_SECTION
4
 0  2  5 1000000
-1  0  7  2
-1 -1  0  5
-1 -1 -1  0
EOF
"""


def test_a_file_of_tsplib_is_a_tour(tmp_path):
    model = read_sop(written(tmp_path, SOP, "tiny.sop"))
    assert (model.name, model.kind) == ("tiny", "guided-path-tour")
    # The node farthest from the start is on the right.
    assert model.coordinates.tolist() == [0, -2, 5]
    assert model.chains == ((1, 2),)
    bare = read_sop(written(tmp_path, SOP.replace("SECTION\n4\n", "SECTION\n"), "bare.sop"))
    assert bare.digest == model.digest
    free = read_sop(written(tmp_path, SOP.replace("-1 -1  0  5", "-1  7  0  5"), "free.sop"))
    assert (free.chains, free.pairs) == ((), ())


@settings(max_examples=40, deadline=None)
@given(model=tours(7))
def test_tours_travel_through_files(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("sop") / "tour.sop"
    again = read_sop(write_sop(model, path))
    extent = float(np.ptp(model.coordinates))
    apart = np.abs(np.subtract.outer(model.coordinates, model.coordinates))
    found = np.abs(np.subtract.outer(again.coordinates, again.coordinates))
    assert np.abs(apart - found).max() <= 4e-9 * extent
    assert (again.closure == model.closure).all()
    assert again.coordinates[0] == 0
    assert again.coordinates.max() >= -again.coordinates.min()
    # Reading and writing again reproduces the file.
    assert read_sop(write_sop(again, path)).digest == again.digest


def test_chains_come_back_as_chains(tmp_path):
    for model in (generate(4, 5, 1), generate(1, 40, 2), generate(6, 1, 3)):
        again = read_sop(write_sop(model, tmp_path / "a.sop"))
        assert again.coordinates.tolist() == model.coordinates.tolist()
        assert again.chains == tuple(chain for chain in model.chains if len(chain) > 1)
        assert not len(again.precedence)
    some = generate_relation(12, 0.4, 5)
    pairs = read_sop(write_sop(some, tmp_path / "b.sop")).precedence.tolist()
    assert len(pairs) < len(some.precedence)


def test_written_files_follow_tsplib(tmp_path):
    model = GuidedPathTour([1, 3, -4, 0.5], chains=[[1, 2, 3]], name="a line")
    lines = write_sop(model, tmp_path / "a.sop").read_text().splitlines()
    assert lines[0] == "NAME: a line"
    assert lines[lines.index("EDGE_WEIGHT_SECTION") + 1 : -1] == [
        "5",
        "0.0 2.0 5.0 0.5 1000000",
        "-1 0.0 7.0 2.5 2.0",
        "-1 -1 0.0 4.5 5.0",
        "-1 -1 -1 0.0 0.5",
        "-1 -1 -1 -1 0",
    ]
    whole = write_sop(GuidedPathTour([0, 10**9, -(10**9)]), tmp_path / "b.sop").read_text()
    assert "0 1000000000 1000000000 20000000000" in whole
    blank = write_sop(GuidedPathTour([0, 1], name=" "), tmp_path / "c.sop").read_text()
    assert blank.startswith("NAME: tour\n")


@needs_public
@pytest.mark.parametrize("path", sorted(PUBLIC.glob("*.sop")), ids=lambda path: path.stem)
def test_public_matrices_are_no_lines(path):
    words = r"distances must be those of a line: .* nodes \d+ and \d+ are \S+ apart, got \S+"
    with pytest.raises(InvalidData, match=words) as raised:
        read_sop(path)
    assert str(path) in str(raised.value)
    text = str(raised.value)
    i, j = (int(word) - 1 for word in re.findall(r"nodes (\d+) and (\d+) are", text)[0])
    words = path.read_text().split("EDGE_WEIGHT_SECTION")[1].split("EOF")[0].split()
    matrix = np.array(words[1:], float).reshape(int(words[0]), -1)
    assert text.endswith(f"got {matrix[i, j]:.10g}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("TYPE: SOP", "TYPE: TSP", "TYPE must be SOP, got 'TSP'"),
        ("FULL_MATRIX", "UPPER_ROW", "EDGE_WEIGHT_FORMAT must be FULL_MATRIX"),
        ("DIMENSION: 4", "", "DIMENSION must be a whole number from 3 to 5002, got None"),
        ("DIMENSION: 4", "DIMENSION: 2", "DIMENSION must be a whole number"),
        ("DIMENSION: 4", "DIMENSION: 99999999", "DIMENSION must be a whole number"),
        ("DIMENSION: 4", "DIMENSION: ٤", "DIMENSION must be a whole number"),
        ("DIMENSION: 4", "DIMENSION: 5", "must hold 5 × 5 numbers, got 17"),
        ("0  7  2", "0  seven  2", "must hold finite numbers, got 'seven'"),
        ("0  7  2", "0  nan  2", "must hold finite numbers, got 'nan'"),
        ("0  7  2", "0  1e999  2", "must hold finite numbers, got '1e999'"),
        ("0  7  2", "0  7", "must hold 4 × 4 numbers, got 15"),
        ("0  7  2", "0  8  2", "nodes 2 and 3 are 7 apart, got 8"),
        ("0  7  2", "0  7  3", "nodes 2 and 4 are 2 apart, got 3"),
        ("0  7  2", "0  -7  2", "entry 2, 3 must be a distance or -1, got -7"),
        ("0  7  2", "0 -1  2", "nodes 2 and 3 each precede the other"),
        (" 0  2  5", " 0 -1  5", "node 1 must come first"),
        ("0  7  2", "0  7 -1", "node 4 last"),
        (SOP, "", "TYPE must be SOP, got None"),
        ("TYPE: SOP", "TYPE: SOP\nCAPACITY: 3", "'CAPACITY' is not supported"),
        ("TYPE: SOP", "TYPE: SOP\nTYPE: SOP", "TYPE must be there once"),
        (SOP[SOP.index("EDGE_WEIGHT_SECTION") + 19 :], "", "must hold 4 × 4 numbers, got 0"),
        ("EOF", "TIME_WINDOW_SECTION\n1 0 5\nEOF", "'TIME_WINDOW_SECTION' is not supported"),
    ],
)
def test_bad_files_of_tsplib(old, new, message, tmp_path):
    path = written(tmp_path, SOP.replace(old, new), "bad.sop")
    with pytest.raises(InvalidData, match=message) as raised:
        read_sop(path)
    assert str(path) in str(raised.value)


def test_cycles_in_files_of_tsplib(tmp_path):
    text = write_sop(GuidedPathTour([0, 1, 1, 1]), tmp_path / "a.sop").read_text()
    rows = [line.split() for line in text.splitlines()]
    first = rows.index(["5"]) + 1
    for after, before in ((1, 2), (2, 3), (3, 1)):
        rows[first + after][before] = "-1"
    path = written(tmp_path, "\n".join(map(" ".join, rows)), "b.sop")
    with pytest.raises(InvalidData, match="precedence must have no cycle"):
        read_sop(path)


# -- tables of stops -----------------------------------------------------------------------------

STOPS = "id,coordinate,chain,place,after\ndock,0,,,\na,3,x,2,\nb,-1,x,1,\nc,4,y,1,a\nd,2,,,b c\n"


def test_a_table_of_stops_is_an_instance(tmp_path):
    model = ct.load(written(tmp_path, STOPS, "shop.csv"))
    assert (model.kind, model.name) == ("guided-path-tour", "shop")
    assert model.coordinates.tolist() == [0, 3, -1, 4, 2]
    assert model.chains == ((2, 1), (3,))
    assert model.precedence.tolist() == [[1, 3], [2, 4], [3, 4]]
    assert model.ids == ("dock", *"abcd")
    rows = "Coordinate , chain\n1.5,\n2,1\n4,2\n\n-1,1\n"
    model = ct.load(written(tmp_path, rows, "rows.csv"))
    assert model.chains == ((1, 3), (2,))
    assert model.ids is None
    numbered = ct.load(written(tmp_path, "coordinate,after\n0,\n1,\n2,1\n", "numbered.csv"))
    assert numbered.pairs == ((1, 2),)
    given = ct.load(
        written(tmp_path, "coordinate\n0\n1\n2\n", "bare.csv"), data={"chains": [[2, 1]]}
    )
    assert given.pairs == ((2, 1),)


def test_a_sheet_of_stops_is_an_instance(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="Excel files need the extra xlsx")
    book = openpyxl.Workbook()
    for row in csv.reader(STOPS.splitlines()):
        book.active.append([cell or None for cell in row])
    book.save(tmp_path / "shop.xlsx")
    plain = ct.load(written(tmp_path, STOPS, "shop.csv"))
    assert ct.load(tmp_path / "shop.xlsx").digest == plain.digest


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must be a header of stops"),
        ("id,chain\na,1\n", "must be a header of stops"),
        ("coordinate,place\n1,2\n", "must be a header of stops"),
        ("coordinate,coordinate\n1,2\n", "must be a header of stops"),
        ("coordinate,colour\n1,red\n", "must be a header of stops.*colour"),
        ("coordinate\n", "no stops below the header"),
        ("coordinate\n0\n1,2\n", "line 3: 2 values where the header has 1"),
        ("coordinate\nleft\n", "line 2, column coordinate: must be a finite number, got 'left'"),
        ("coordinate,id\n0,a\n1,\n", "line 3, column id: must name the stop"),
        ("coordinate,chain\n0,x\n1,x\n", "first row is the start, whose chain must be empty"),
        ("coordinate,after\n0,1\n1,\n", "first row is the start, whose after must be empty"),
        ("coordinate,chain,place\n0,,\n1,x,\n", "stop 1 of chain x must have a place of its own"),
        (
            "coordinate,chain,place\n0,,\n1,x,2\n1,x,2.0\n",
            "stop 2 of chain x must have a place of its own, got 2",
        ),
        ("coordinate,chain,place\n0,,\n1,x,first\n", "column place: must be a finite number"),
        ("coordinate,after\n0,\n1,7\n", "after of stop 1 must name stops, got '7'"),
        ("coordinate,id,after\n0,a,\n1,b,1\n", "after of stop b must name stops, got '1'"),
        ("coordinate,id,after\n0,a,\n1,b,\n1,b,\n", "ids must differ"),
    ],
)
def test_bad_tables_of_stops(text, message, tmp_path):
    with pytest.raises(InvalidData, match=message):
        read_stops(written(tmp_path, text, "stops.csv"))


def test_instances_refer_to_files(tmp_path):
    table = written(tmp_path, STOPS, "shop.csv")
    whole = {"model": "guided-path-tour", "data": {"coordinates": "shop.csv"}}
    named = ct.load(written(tmp_path, json.dumps(whole), "shop.json"))
    assert named.digest == ct.load(table).digest
    line = written(tmp_path, SOP, "tiny.sop")
    whole["data"] = {"sop": "tiny.sop", "ids": ["home", "a", "b"]}
    model = ct.load(written(tmp_path, json.dumps(whole), "line.json"))
    assert (model.name, model.label(1)) == ("line", "a")
    assert model.coordinates.tolist() == read_sop(line).coordinates.tolist()
    whole["data"] = {"sop": "tiny.sop", "chains": [[1, 2]]}
    with pytest.raises(InvalidData, match="chains must not be given: the file holds it"):
        read_model(written(tmp_path, json.dumps(whole), "twice.json"), trusted=True)
    whole["data"] = {"sop": "tiny.sop", "coordinates": [0, 1]}
    with pytest.raises(InvalidData, match="coordinates must not be given"):
        read_model(written(tmp_path, json.dumps(whole), "both.json"), trusted=True)
    (tmp_path / "below").mkdir()
    for data in ({"sop": "../tiny.sop"}, {"coordinates": str(table)}):
        whole["data"] = data
        path = written(tmp_path / "below", json.dumps(whole), "out.json")
        with pytest.raises(InvalidData, match="folder"):
            read_model(path)


def test_other_tables_keep_their_readers(tmp_path):
    way = written(tmp_path, "x,y\n0,0\n1,1\n2,0\n", "way.csv")
    assert ct.load(way, data={"times": [0, 1, 2]}).kind == "minimum-snap"
    nodes = written(tmp_path, "x,y,id\n0,0,a\n1,1,b\n", "nodes.csv")
    assert ct.load(nodes, data={"vehicles": 1}).kind == "fleet-routing"


# -- export --------------------------------------------------------------------------------------


def test_exports(tmp_path):
    model = ct.load("guided-path/chains-and-pairs")
    plan = GuidedPathPlan([5, 6, 1, 9, 2, 3, 4, 10, 7, 8])
    assert model.verify(plan).ok
    assert list(export_formats(model)) == ["csv", "tsplib"]
    rows = list(
        csv.DictReader(export_plan(model, plan, tmp_path / "a.csv").read_text().splitlines())
    )
    assert list(rows[0]) == ["stop", "customer", "x", "walked"]
    assert [row["customer"] for row in rows] == ["start", *"efaibcdjgh", "start"]
    assert [float(row["x"]) for row in rows] == model.coordinates[[0, *plan.order, 0]].tolist()
    assert [int(row["stop"]) for row in rows] == list(range(12))
    assert float(rows[1]["walked"]) == 6
    assert float(rows[-1]["walked"]) == model.verify(plan).objective

    lines = export_plan(model, plan, tmp_path / "a.tour", "tsplib").read_text().splitlines()
    assert lines[:3] == ["NAME: guided-path/chains-and-pairs", "TYPE: TOUR", "DIMENSION: 12"]
    nodes = [int(line) for line in lines[lines.index("TOUR_SECTION") + 1 : -2]]
    assert nodes == [1, *(customer + 1 for customer in plan.order), 12]
    assert lines[-2:] == ["-1", "EOF"]
    # The tour uses the node numbers of the SOP file of the same model.
    text = write_sop(model, tmp_path / "a.sop").read_text()
    words = text.split("EDGE_WEIGHT_SECTION")[1].split("EOF")[0].split()[1:]
    matrix = np.array(words, float).reshape(12, 12)
    steps = [matrix[a - 1, b - 1] for a, b in itertools.pairwise(nodes)]
    assert min(steps) >= 0
    assert sum(steps) == model.verify(plan).objective


def test_rejects_bad_plans_for_export(tmp_path):
    model = GuidedPathTour([0, 1, 2])
    for kind in ("csv", "tsplib"):
        with pytest.raises(InvalidData, match="order must hold customers 1 … 2, got 3"):
            export_plan(model, GuidedPathPlan([3]), tmp_path / "a", kind)
    assert not list(tmp_path.iterdir())
