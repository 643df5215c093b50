"""Instances of fleet routing: the generator, the catalogue, files in and out."""

import csv
import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fleet.enumerated import lengths

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances import entries, entry, export_formats, export_plan, read_model
from crosstrack.instances.fleet import generate, read_nodes, read_tsplib, read_vrplib
from crosstrack.instances.fleet.paper_tables import table_2
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.solvers.report.trials import RecordedTrials

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "tsplib"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public instances lie in ../shared/data/tsplib, which is absent"
)
OURS = [one for one in entries() if one.name.startswith("fleet/")]

#: A file of each kind.
EUCLIDEAN = """NAME: tiny
TYPE: TSP
COMMENT: three places : and a colon
DIMENSION: 3
EDGE_WEIGHT_TYPE: EUC_2D
NODE_COORD_SECTION
1 0 0
2 3.0 4e0
 3 -1.5 0
EOF
"""
MATRIX = """DIMENSION: 3
EDGE_WEIGHT_TYPE: EXPLICIT
EDGE_WEIGHT_FORMAT: {form}
EDGE_WEIGHT_SECTION
{numbers}
DISPLAY_DATA_SECTION
1 0 0
2 1 0
3 0 2
EOF
"""
LORRIES = """NAME : tiny
TYPE : CVRP
DIMENSION : 4
EDGE_WEIGHT_TYPE : EUC_2D
CAPACITY : 10
NODE_COORD_SECTION
1 0 0
2 0 5
3 3 4
4 8 6
DEMAND_SECTION
1 0
2 6
3 3
4 7
DEPOT_SECTION
1
-1
EOF
"""


def written(tmp_path, text, name="file.tsp"):
    path = tmp_path / name
    path.write_text(text, "utf-8")
    return path


# -- the generator and the catalogue -------------------------------------------------------------


def test_a_seed_means_the_same_nodes():
    one = generate(9, 3, 5)
    assert one.digest == generate(9, 3, 5).digest != generate(9, 3, 6).digest
    assert one.points[0].tolist() == [100, 100]
    assert hashlib.sha256(one.points.tobytes()).hexdigest()[:16] == "b68d87013afa1154"
    large = generate(900, 2, 1, side=10, objective="sum", name="large")
    assert (large.name, large.size, str(large.objective)) == ("large", 901, "sum")
    assert large.points.max(axis=0) == pytest.approx([10, 10], rel=0.01)
    assert large.points.mean(axis=0) == pytest.approx([5, 5], rel=0.06)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: generate(0, 1, 1), "nodes must"),
        (lambda: generate(10**6, 1, 1), "nodes must"),
        (lambda: generate(3, 4, 1), "vehicles must be at most the 3 nodes"),
        (lambda: generate(3, 2, -1), "seed must be >= 0"),
        (lambda: generate(3, 2, 1, side=0), "side must be > 0"),
        (lambda: generate(3, 2, 1, colour="red"), "colour"),
    ],
)
def test_the_generator_refuses(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


def test_catalogue_titles_match_the_models():
    assert len({one.build().digest for one in OURS}) == len(OURS) >= 22
    rows = [one for one in OURS if "/table-3-" in one.name]
    models = [one.build() for one in rows]
    assert sorted(model.q for model in models) == [0, 0.2, 0.4, 0.6, 0.8]
    for one, model in zip(rows, models, strict=True):
        assert (model.vehicles, len(model.customers)) == (4, 75)
        assert str(model.objective) == "sum-variance"
        assert one.provenance == "seeded"
        assert "prints no coordinates" in one.note
    assert not ct.load("fleet/asymmetric").symmetric
    assert np.unique(ct.load("fleet/two-depots").depots).size == 2
    farthest = ct.load("fleet/each-its-own").distances[0].max()
    assert entry("fleet/each-its-own").published["optimum"] == 2 * farthest
    far = ct.load("fleet/one-far").distances
    assert far.max() > 1e4 * np.median(far)


@needs_public
def test_table_2_measures_a_file_or_states_that_it_is_absent(monkeypatch, tmp_path):
    class Quick(RecordedTrials):
        def run(self, model, backend, **more):
            if backend == "fleet-search":
                more["options"] = {"steps": 10, "bound": False}
            return super().run(model, backend, **more)

    values = table_2(("bayg29", "Kmeans-AC"), Quick(runs=2, time_limit=5))
    assert values["best"] <= values["mean"] <= values["worst"]
    assert values["runs"] == 2
    monkeypatch.setenv("CROSSTRACK_TSPLIB", str(tmp_path))
    assert set(table_2(("bayg29", "TPHA"), Quick()).values()) == {"no file"}


# -- TSPLIB and VRPLIB ---------------------------------------------------------------------------


@needs_public
@pytest.mark.parametrize("name", ["berlin52", "st70", "eil51", "rat99", "ch150", "kroA200"])
def test_public_instances_are_read(name):
    model = read_tsplib(PUBLIC / f"{name}.tsp", 3)
    rows = [line.split() for line in (PUBLIC / f"{name}.tsp").read_text().splitlines()]
    places = [[float(x) for x in row[1:]] for row in rows if len(row) == 3 and row[0].isdigit()]
    assert model.points.tolist() == places
    assert (model.name, model.vehicles, model.depots.tolist()) == (name, 3, [0])
    assert model.size == int("".join(c for c in name if c.isdigit()))


@needs_public
@pytest.mark.parametrize(("name", "optimum"), [("berlin52", 7542), ("bayg29", 1610), ("st70", 675)])
def test_published_tours_have_their_lengths(name, optimum):
    model = read_tsplib(PUBLIC / f"{name}.tsp", 1, rounded=True)
    words = (PUBLIC / f"{name}.opt.tour").read_text().split()
    first = words.index("TOUR_SECTION") + 1
    tour = [int(word) - 1 for word in words[first : first + model.size]]
    at = tour.index(0)
    assert lengths(model, [tour[at + 1 :] + tour[:at]])[0] == optimum
    assert read_tsplib(PUBLIC / "bayg29.tsp", 1, display=True).points[0].tolist() == [1150, 1760]


def test_distances_real_and_rounded(tmp_path):
    path = written(tmp_path, EUCLIDEAN)
    model = read_tsplib(path, 2, objective="sum")
    assert (str(model.objective), model.name) == ("sum", "file")
    assert model.distances[1, 2] == pytest.approx(np.hypot(4.5, 4))
    # A half is rounded up, as TSPLIB does.
    assert read_tsplib(path, 2, rounded=True).distances.tolist() == [
        [0, 5, 2],
        [5, 0, 6],
        [2, 6, 0],
    ]


@pytest.mark.parametrize(
    ("form", "numbers"),
    [
        ("FULL_MATRIX", "0 1 2 1 0 3.5 2 3.5 0"),
        ("UPPER_ROW", "1 2\n3.5"),
        ("LOWER_ROW", "1 2\n3.5"),
        ("UPPER_DIAG_ROW", "0 1 2 0 3.5 0"),
        ("LOWER_DIAG_ROW", "0\n1 0\n2 3.5 0"),
        ("UPPER_COL", "1\n2 3.5"),
        ("LOWER_COL", "1 2\n3.5"),
        ("UPPER_DIAG_COL", "0\n1 0\n2 3.5 0"),
        ("LOWER_DIAG_COL", "0 1 2\n0 3.5\n0"),
    ],
)
def test_matrices(form, numbers, tmp_path):
    path = written(tmp_path, MATRIX.format(form=form, numbers=numbers))
    assert read_tsplib(path, 2).costs.tolist() == [[0, 1, 2], [1, 0, 3.5], [2, 3.5, 0]]
    assert read_tsplib(path, 2, display=True).points.tolist() == [[0, 0], [1, 0], [0, 2]]


def test_lorries(tmp_path):
    path = written(tmp_path, LORRIES, "tiny-n4-k2.vrp")
    model = read_vrplib(path)
    assert (model.vehicles, str(model.objective), model.size) == (2, "sum", 4)
    assert model.capacity.tolist() == [10, 10]
    assert model.demands.tolist() == [0, 6, 3, 7]
    # 6 and 7 are too much for one: either may take the 3 along.
    along = min(5 + np.hypot(3, 1) + 5 + 20, 10 + 5 + np.hypot(5, 2) + 10)
    assert ct.solve(model, "subset-dp").primal_bound == pytest.approx(along)
    assert read_vrplib(path, 3, use_all=False, objective="max").vehicles == 3
    other = written(tmp_path, LORRIES.replace("\n1\n-1", "\n4\n-1"))
    assert read_vrplib(other, 3).depots.tolist() == [3]
    with pytest.raises(InvalidData, match="vehicles must be given"):
        read_vrplib(other)
    said = written(tmp_path, LORRIES.replace("CAPACITY", "VEHICLES : 2\nCAPACITY"))
    assert read_vrplib(said).vehicles == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (EUCLIDEAN, "", "DIMENSION must be a whole number from 1 to 10000, got None"),
        (EUCLIDEAN, "\0\0\0", "no TSPLIB or VRPLIB file"),
        (
            "DIMENSION: 3",
            "DIMENSION: 4",
            r"NODE_COORD_SECTION must hold 4 × 2 .* got shape \(3, 2\)",
        ),
        ("DIMENSION: 3", "DIMENSION: 99999999999", "DIMENSION must be a whole number"),
        ("DIMENSION: 3", "DIMENSION: 3.5", "DIMENSION must be a whole number"),
        ("DIMENSION: 3", "DIMENSION: three", "DIMENSION must be a whole number"),
        ("EUC_2D", "XRAY1", "EDGE_WEIGHT_TYPE must be one of EUC_2D, .*, EXPLICIT, got 'XRAY1'"),
        ("2 3.0 4e0", "2 3.0 west", "NODE_COORD_SECTION must hold numbers"),
        ("2 3.0 4e0", "2 3.0 nan", "NODE_COORD_SECTION must hold numbers, got 'nan'"),
        ("2 3.0 4e0", "2 3_0 4e0", "NODE_COORD_SECTION must hold numbers, got '3_0'"),
        ("2 3.0 4e0", "2 1e999 4", "NODE_COORD_SECTION must hold 3 × 2 finite numbers"),
        ("2 3.0 4e0", "2 3.0", "NODE_COORD_SECTION must hold"),
        ("2 3.0 4e0", "7 3.0 4e0", "row 2 of NODE_COORD_SECTION must begin with 2, got '7'"),
        ("NODE_COORD_SECTION", "", "no TSPLIB or VRPLIB file"),
        ("1 0 0\n2 3.0 4e0\n 3 -1.5 0\n", "", "NODE_COORD_SECTION must"),
    ],
)
def test_bad_files_of_tsplib(old, new, message, tmp_path):
    path = written(tmp_path, EUCLIDEAN.replace(old, new))
    with pytest.raises(InvalidData, match=message) as raised:
        read_tsplib(path, 2)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2 1 0\n", "", "row 2 of DISPLAY_DATA_SECTION must begin with 2, got '3'"),
        ("2 1 0\n", "2 1 0\n2 1 0\n", "row 3 of DISPLAY_DATA_SECTION must begin with 3, got '2'"),
        ("1 2 3\n", "2 1 0\n", "row 2 of DISPLAY_DATA_SECTION must begin with 2, got '1'"),
        ("3 0 2\n", "", "DISPLAY_DATA_SECTION must hold 3 × 2 finite numbers"),
    ],
)
def test_rejects_damaged_coordinates_beside_a_matrix(old, new, message, tmp_path):
    text = MATRIX.format(form="UPPER_ROW", numbers="1 2 3")
    swapped = {old: new, new: old} if new == "2 1 0\n" else {old: new}
    path = written(tmp_path, "".join(swapped.get(row, row) for row in text.splitlines(True)))
    with pytest.raises(InvalidData, match=message):
        read_tsplib(path, 2)


@pytest.mark.parametrize(
    ("form", "numbers", "message"),
    [
        ("FUNCTION", "1 2 3", "EDGE_WEIGHT_FORMAT must be one of FULL_MATRIX"),
        ("UPPER_ROW", "1 2", "EDGE_WEIGHT_SECTION must hold 3 numbers, got 2"),
        ("UPPER_ROW", "1 2 x", "EDGE_WEIGHT_SECTION must hold finite numbers, got 'x'"),
        ("UPPER_ROW", "1 2 inf", "must hold finite numbers, got 'inf'"),
        ("UPPER_ROW", "1 2 -3", "costs"),
        ("FULL_MATRIX", "1 1 2 1 0 3 2 3 0", r"costs\[0, 0\] must be 0"),
    ],
)
def test_bad_matrices(form, numbers, message, tmp_path):
    path = written(tmp_path, MATRIX.format(form=form, numbers=numbers))
    with pytest.raises(InvalidData, match=message):
        read_tsplib(path, 2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("CAPACITY : 10\n", "", "CAPACITY must be a number, got None"),
        ("CAPACITY : 10", "CAPACITY : much", "CAPACITY must be a number, got 'much'"),
        ("DEMAND_SECTION\n1 0\n2 6\n3 3\n4 7\n", "", "must have a DEMAND_SECTION"),
        ("4 7\nDEPOT", "DEPOT", r"DEMAND_SECTION must hold 4 finite numbers, got shape \(3,\)"),
        ("DEPOT_SECTION\n1\n-1\n", "", "must have a DEPOT_SECTION"),
        ("\n1\n-1", "\n1\n2\n-1", r"DEPOT_SECTION must hold 1 finite numbers, got shape \(2,\)"),
        ("\n1\n-1", "\n5\n-1", "depots must be nodes 0 … 3, got 4"),
        ("\n1\n-1", "\n1.5\n-1", "depots.* must be whole numbers"),
        ("\n1\n-1", "\n0\n-1", r"depots\[0\] must be >= 0"),
        ("4 7\nDEPOT", "4 -7\nDEPOT", "demands.* must be >= 0"),
    ],
)
def test_bad_files_of_vrplib(old, new, message, tmp_path):
    path = written(tmp_path, LORRIES.replace(old, new), "bad-k2.vrp")
    with pytest.raises(InvalidData, match=message):
        read_vrplib(path)


BURMA = """16.47 96.10 16.47 94.44 20.09 92.54 22.39 93.37 25.23 97.24 22.00 96.05 20.47 97.02
17.20 96.29 16.30 97.38 14.05 98.12 16.53 97.38 21.52 95.59 19.41 97.13 20.09 94.55"""
ULYSSES = """38.24 20.42 39.57 26.15 40.56 25.32 36.26 23.12 33.48 10.54 37.56 12.19 38.42 13.11 37.52 20.44
41.23 9.10 41.17 13.05 36.08 -5.21 38.47 15.13 38.15 15.35 37.51 15.17 35.49 14.32 39.36 19.56"""


@pytest.mark.parametrize(("numbers", "optimum"), [(BURMA, 3323), (ULYSSES, 6859)])
def test_geographical_distances_have_the_published_optima(numbers, optimum, tmp_path):
    """TSPLIB's burma14 and ulysses16."""
    places = np.array(numbers.split(), float).reshape(-1, 2)
    rows = "\n".join(f"{k} {x} {y}" for k, (x, y) in enumerate(places.tolist(), 1))
    text = f"DIMENSION: {len(places)}\nEDGE_WEIGHT_TYPE: GEO\nNODE_COORD_SECTION\n{rows}\nEOF\n"
    model = read_tsplib(written(tmp_path, text), 1, objective="sum")
    assert ct.solve(model, "subset-dp").primal_bound == optimum


def test_rounded_types_of_distances(tmp_path):
    for kind, apart in (("CEIL_2D", [5, 2, 7]), ("ATT", [2, 1, 2])):
        model = read_tsplib(written(tmp_path, EUCLIDEAN.replace("EUC_2D", kind)), 2)
        assert model.costs[np.triu_indices(3, 1)].tolist() == apart


@pytest.mark.parametrize(
    "part",
    ["BACKHAUL_SECTION\n2 1", "VEHICLES_DEPOT_SECTION\n1 1", "LINEHAUL_SECTION\n2 1",
     "VEHICLES_FIXED_COST_SECTION\n1 5", "CAPACITY_SECTION\n1 5", "FIXED_EDGES_SECTION\n1 2\n-1",
     "NEW_THING : 1", "TYPE : VRPTW", "NODE_COORD_TYPE : THREED_COORDS", "CAPACITY : 11",
     "TIME_WINDOW_SECTION\n1 0 9\n2 0 9", "VEHICLES_RELOAD_DEPOT_SECTION\n1 1\n2 2",
     "MUTUALLY_EXCLUSIVE_GROUP_SECTION\n1 2 9", "VEHICLES_ALLOWED_CLIENTS_SECTION\n1 2 3",
     "PICKUP_AND_DELIVERY_SECTION\n1 0 0 9 0 0 0", "STATION_SECTION\n2"],
)  # fmt: skip
def test_unsupported_keywords_are_refused_by_name(part, tmp_path):
    """The sections were left out, and another problem was solved."""
    path = written(
        tmp_path, LORRIES.replace("DEMAND_SECTION", f"{part}\nDEMAND_SECTION"), "a-k2.vrp"
    )
    with pytest.raises(InvalidData, match=part.split()[0]):
        read_vrplib(path)
    with pytest.raises(InvalidData):
        read_tsplib(path, 2)


@pytest.mark.parametrize("key", ["DISTANCE", "VEHICLES_MAX_DISTANCE"])
def test_a_limit_on_the_length_is_the_battery(key, tmp_path):
    path = written(tmp_path, LORRIES.replace("CAPACITY", f"{key} : 42.5\nCAPACITY"), "a-k2.vrp")
    assert read_vrplib(path).battery.tolist() == [42.5, 42.5]
    assert read_vrplib(path, battery=50).battery.tolist() == [50, 50]


def test_a_file_of_vehicles_is_no_tour(tmp_path):
    with pytest.raises(InvalidData, match="TYPE must be one of TSP, ATSP"):
        read_tsplib(written(tmp_path, LORRIES), 2)
    # The type precedes the sections that are not supported, and is named first.
    timed = LORRIES.replace("TYPE : CVRP", "TYPE : SOP")
    timed = timed.replace("DEMAND_SECTION", "TIME_WINDOW_SECTION\n1 0 9\nDEMAND_SECTION")
    with pytest.raises(InvalidData, match=r"TYPE must be one of CVRP, .*, got 'SOP'"):
        read_vrplib(written(tmp_path, timed, "a-k2.vrp"))
    with pytest.raises(InvalidData, match="nothing may follow EOF"):
        read_vrplib(written(tmp_path, LORRIES.replace("EOF", "EOF\n1 2 3"), "a-k2.vrp"))


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(InvalidData, match="no such file"):
        read_tsplib(tmp_path / "none.tsp", 2)
    (tmp_path / "bytes.tsp").write_bytes(b"DIMENSION: 3\n\xff\xfe")
    with pytest.raises(InvalidData, match=r"line 2: byte 0xff is no UTF-8"):
        read_tsplib(tmp_path / "bytes.tsp", 2)


# -- tables of nodes -----------------------------------------------------------------------------


def test_a_table_of_nodes_is_an_instance(tmp_path):
    file = written(tmp_path, "x, y,demand,id\n0,0,0,home\n3,4,2,a\n\n0,8,1,b\n", "shop.csv")
    model = ct.load(file, data={"vehicles": 2, "capacity": 2})
    assert (model.kind, model.name, model.ids) == ("fleet-routing", "shop", ("home", "a", "b"))
    assert model.points.tolist() == [[0, 0], [3, 4], [0, 8]]
    assert model.demands.tolist() == [0, 2, 1]
    bare = written(tmp_path, "y,x\n0,0\n4,3\n", "bare.csv")
    assert ct.load(bare, data={"vehicles": 1}).points.tolist() == [[0, 0], [3, 4]]
    whole = {"model": "fleet-routing", "data": {"points": "shop.csv", "vehicles": 2, "capacity": 2}}
    named = ct.load(written(tmp_path, json.dumps(whole), "shop.json"))
    assert named.digest == model.digest
    whole["data"]["demands"] = [0, 1, 1]
    with pytest.raises(InvalidData, match="demands must not be given: the file holds it"):
        read_model(written(tmp_path, json.dumps(whole), "twice.json"), trusted=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must be a header of nodes"),
        ("x,id\n1,a\n", "must be a header of nodes"),
        ("x,y,y\n1,2,3\n", "must be a header of nodes"),
        ("x,y,colour\n1,2,red\n", "must be a header of nodes.*colour"),
        ("x,y\n", "no nodes below the header"),
        ("x,y\n1,2,3\n", "line 2: 3 values where the header has 2"),
        ("x,y\n1,north\n", "line 2, column y: must be a finite number, got 'north'"),
        ("x,y,id\n\n1,2,\n", "line 3, column id: must name the node, got nothing"),
        ('x,y\n1,"2\n', "no valid CSV"),
    ],
)
def test_bad_tables_of_nodes(text, message, tmp_path):
    with pytest.raises(InvalidData, match=message):
        read_nodes(written(tmp_path, text, "nodes.csv"))


def test_tables_of_others_are_still_theirs(tmp_path):
    way = written(tmp_path, "x,y\n0,0\n1,1\n2,0\n", "way.csv")
    assert ct.load(way, data={"times": [0, 1, 2]}).kind == "minimum-snap"
    met = written(tmp_path, "x,y,radius\n60,20,5\n10,70,5\n", "met.csv")
    assert ct.load(met).kind == "messenger-tour"


# -- export --------------------------------------------------------------------------------------


def test_exports(tmp_path):
    model = replace(ct.load("fleet/example"), vehicles=3, use_all=False, ids=list("0abcdefg"))
    plan = FleetPlan([[7, 6], [], [1, 2, 3, 4, 5]])
    assert list(export_formats(model)) == ["csv", "geojson", "vrplib"]
    rows = list(
        csv.DictReader(export_plan(model, plan, tmp_path / "a.csv").read_text().splitlines())
    )
    assert list(rows[0]) == ["vehicle", "stop", "node", "x", "y", "arrival"]
    assert [row["node"] for row in rows] == [*"0gf0", *"0abcde0"]
    assert [row["vehicle"] for row in rows] == ["0"] * 4 + ["2"] * 7
    loads = lengths(model, plan.routes)
    assert [float(rows[k]["arrival"]) for k in (3, 10)] == pytest.approx(loads[[0, 2]].tolist())
    assert [float(rows[1][key]) for key in "xy"] == model.points[7].tolist()

    drawn = json.loads(export_plan(model, plan, tmp_path / "a.geojson", "geojson").read_text())
    assert [one["properties"]["vehicle"] for one in drawn["features"]] == [0, 2]
    line = drawn["features"][0]["geometry"]
    assert line == {"type": "LineString", "coordinates": model.points[[0, 7, 6, 0]].tolist()}
    assert drawn["features"][0]["properties"]["length"] == pytest.approx(loads[0])

    import vrplib

    held = vrplib.read_solution(export_plan(model, plan, tmp_path / "a.sol", "vrplib"))
    assert held["routes"] == [[7, 6], [1, 2, 3, 4, 5]]
    assert held["cost"] == pytest.approx(loads.sum())


def test_invalid_plans_cannot_be_exported(tmp_path):
    model = FleetRouting(2, costs=np.ones((4, 4)) - np.eye(4))
    plan = FleetPlan([[1], [2, 3]])
    rows = list(csv.reader(export_plan(model, plan, tmp_path / "a.csv").read_text().splitlines()))
    assert rows[2] == ["0", "1", "1", "", "", "1.0"]
    with pytest.raises(UnsupportedFormulation, match="the model has costs"):
        export_plan(model, plan, tmp_path / "b.geojson", "geojson")
    with pytest.raises(UnsupportedFormulation, match="the model has several"):
        export_plan(replace(model, depots=[0, 1]), plan, tmp_path / "b.sol", "vrplib")
    for routes, message in (
        ([[1], [2], [3]], "routes must be 2"),
        ([[0], [2]], "other than depots"),
    ):
        for kind in ("csv", "vrplib"):
            with pytest.raises(InvalidData, match=message):
                export_plan(model, FleetPlan(routes), tmp_path / "b", kind)
    assert [one.name for one in tmp_path.iterdir()] == ["a.csv"]
