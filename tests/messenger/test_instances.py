"""Instances of messenger tours: generator, catalogue and files."""

import csv
import hashlib
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from messenger.flights import flight

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import entries, entry, export_formats, export_plan
from crosstrack.instances.messenger import (
    generate,
    read_best_known,
    read_dtspn,
    read_vehicles,
    write_tour_samples,
)
from crosstrack.instances.messenger.printed import TABLE_3, TABLE_4

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "dtspn"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public instances lie in ../shared/data/dtspn, which is absent"
)
OURS = [one for one in entries() if one.name.startswith("messenger/")]
HEADER = "x,y,vx,vy,radius,id\n"


# -- the generator -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "sparsity", "options"),
    [
        (2, -1.4, {}),
        (2, 17, {"turning_radius": 1e-3, "radius": 0.0}),
        (3, 1e6, {"turning_radius": 1e6, "speed": 1e-6, "fastest": 0.999e-6}),
        (10, -1.999999, {}),
        (40, 17, {"radius": 10.0, "turning_radius": 1.0}),
        (100, 2.5, {"radius": 1e6, "turning_radius": 1e3}),
        (10, 0.0, {"fastest": 0.0}),
    ],
)
def test_the_sparsity_equals_the_given_value(count, sparsity, options):
    model = generate(count, sparsity, 7, **options)
    gaps = [math.dist(a, b) for a, b in itertools.combinations(model.positions.tolist(), 2)]
    apart, turning = np.mean(gaps), options.get("turning_radius", 5.0)
    near = options.get("radius", 5.0)
    assert apart == pytest.approx(sparsity * turning + 2 * near, rel=1e-10)
    # The sparsity loses the digits that cancel between the distance and the radius.
    assert model.sparsity == pytest.approx(sparsity, rel=1e-9, abs=1e-10 * near / turning)
    assert model.size == count
    assert model.start.tolist() == [0, 0, math.pi / 2]
    assert (model.positions >= 0).all()
    speeds = np.hypot(*model.velocities.T)
    assert speeds.max() <= options.get("fastest", 3.5)
    assert model.at_rest == (options.get("fastest") == 0.0)


def test_positions_fill_the_square_and_velocities_point_everywhere():
    model = generate(4000, 17, 3)
    side = 95 / 0.5214054331647207  # the mean distance in a unit square
    assert model.positions.max(axis=0) == pytest.approx([side, side], rel=0.01)
    assert model.positions.mean(axis=0) == pytest.approx([side / 2, side / 2], rel=0.03)
    speeds = np.hypot(*model.velocities.T)
    assert np.quantile(speeds, [0.25, 0.5, 0.75]) == pytest.approx([0.875, 1.75, 2.625], rel=0.05)
    headings = np.arctan2(*model.velocities.T[::-1])
    assert abs(np.exp(1j * headings).mean()) < 0.05


def test_a_seed_yields_the_same_vehicles():
    assert generate(9, 3, 5).digest == generate(9, 3, 5).digest != generate(9, 3, 6).digest
    model = generate(5, 5, 1, name="mine")
    assert model.name == "mine"
    content = model.positions.tobytes() + model.velocities.tobytes()
    assert hashlib.sha256(content).hexdigest()[:16] == "6f141ecefcfc238b"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: generate(1, 5, 1), "vehicles must"),
        (lambda: generate(2.5, 5, 1), "vehicles must be a whole number"),
        (lambda: generate(10**6, 5, 1), "vehicles must"),
        (
            lambda: generate(5, -2, 1),
            "sparsity must be > -2, at which all vehicles are in one place",
        ),
        (lambda: generate(5, 0, 1, radius=0.0), "sparsity must be > -?0"),
        (lambda: generate(5, 1e308, 1, turning_radius=1e9), "sparsity must"),
        (lambda: generate(5, math.nan, 1), "sparsity must"),
        (lambda: generate(5, "far", 1), "sparsity must"),
        (lambda: generate(5, 5, -1), "seed must be >= 0"),
        (lambda: generate(5, 5, 1, radius=-1), "radius must be >= 0"),
        (lambda: generate(5, 5, 1, turning_radius=0), "turning_radius must be > 0"),
        (lambda: generate(5, 5, 1, fastest=-1), "fastest must be >= 0"),
        (
            lambda: generate(50, 5, 1, fastest=20.0),
            r"velocities\[\d+\] must be slower than the UAV",
        ),
    ],
)
def test_the_generator_rejects_bad_arguments(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


# -- the catalogue -------------------------------------------------------------------------------


def test_the_catalogue_has_the_papers_sizes_and_sparsities_and_marks_them_as_seeded():
    rows = [one for one in OURS if "/B-" in one.name]
    printed = {**TABLE_3.rows, **TABLE_4.rows}
    assert len(rows) == len(printed) == 60
    for one, ((name,), cells) in zip(rows, printed.items(), strict=True):
        model, (_, size, row) = one.build(), name.split("-")
        assert one.name == f"messenger/B-{int(size):02}-{row}"
        assert (model.size, model.sparsity) == (int(size), pytest.approx(cells[0], abs=1e-9))
        assert one.provenance == "seeded"
        assert "does not publish its instances" in one.note
        assert one.published["table"] == (4 if model.size >= 10 else 3)
    numbers = [one.published["row"] for one in rows]
    assert len(set(numbers)) == 60
    assert len({one.build().digest for one in OURS}) == len(OURS) == 65


def test_lengths_are_of_the_order_that_the_paper_prints():
    """Greedy tours have the magnitude of Table IV for N = 10 and 20, and grow fast."""
    found = {}
    for size in (10, 20):
        names = [f"messenger/B-{size}-{row:02}" for row in (6, 8)]
        found[size] = [flight(ct.load(name)).length for name in names]
    for size, (low, high) in {10: (205, 480), 20: (1770, 3194)}.items():
        assert low / 3 < np.median(found[size]) < 3 * high
    assert np.median(found[20]) > 2 * np.median(found[10])


def test_special_cases_match_their_names():
    static = ct.load("messenger/static-closed")
    assert (static.closed, static.at_rest, static.start) == (True, True, None)
    assert ct.load("messenger/moving-targets").radius.max() == 0
    assert ct.load("messenger/euclidean").turning_radius == 0
    met = ct.load("messenger/met-at-start")
    assert (np.hypot(*met.positions.T) < met.radius).all()
    nothing = {
        "order": [0, 1, 2, 3], "times": [0.0] * 4, "points": [[0.0, 0.0]] * 4,
        "start": met.start.tolist(), "primitives": [],
    }  # fmt: skip
    found = ct.verify(met, nothing)
    assert (found.ok, found.objective) == (True, 0.0)
    assert entry("messenger/met-at-start").published["optimum"] == 0


def test_the_gap_instance_has_a_gap():
    """Random paths of up to four primitives: none meets the first vehicle during the gap."""
    model = ct.load("messenger/gap")
    rng = np.random.default_rng(1)
    words = [
        word for word in itertools.product((1, 0, -1), repeat=4)
        if all(a != b for a, b in itertools.pairwise(word))
    ]  # fmt: skip

    def nearest(time):
        best = math.inf
        for word in words:
            lengths = model.speed * time * rng.dirichlet([0.7] * 4, 2000).T
            place, heading = np.zeros((2, 2000)), np.full(2000, model.start[2])
            for sign, length in zip(word, lengths, strict=True):
                half = sign * length / model.turning_radius / 2
                chord = length * np.sinc(half / np.pi)
                place += chord * np.array([np.cos(heading + half), np.sin(heading + half)])
                heading += 2 * half
            best = min(best, np.hypot(*(place.T - model.where(0, time)).T).min())
        return best

    # By then the shortest path is below 12 m, and the length flown is above.
    assert [nearest(time) > 1.5 for time in (1.3, 1.8, 2.4)] == [True] * 3
    assert nearest(3.0) < 0.5
    center = np.array([-model.turning_radius, 0.0])
    assert math.dist(model.where(0, 1.19), center) < 5 < math.dist(model.where(0, 1.21), center)


# -- the public instances ------------------------------------------------------------------------


@needs_public
def test_public_instances_are_read():
    files = sorted(PUBLIC.glob("dtspn-*.txt"))
    bounds = read_best_known(PUBLIC / "best_known.csv")
    assert {file.stem for file in files} == set(bounds)
    assert len(files) == 300
    for file in files[::7]:
        model = read_dtspn(file)
        _, size, _, turning, _ = file.stem.split("-")
        assert (model.size, model.turning_radius) == (int(size), int(turning) / 100)
        assert (model.closed, model.at_rest, model.start, model.name) == (
            True, True, None, file.stem,
        )  # fmt: skip
        first = [float(word) for word in file.read_text().split()[:3]]
        assert [*model.positions[0], model.radius[0]] == first
    lower, upper = bounds["dtspn-06-01-025-0"]
    assert (lower, upper) == (33.92062571661774, 33.92636579612516)
    assert all(0 < low <= high for low, high in bounds.values())


def test_lines_of_a_public_instance(tmp_path):
    file = tmp_path / "dtspn-02-01-150-0.txt"
    file.write_text("\n  1 2  0.5\r\n\n-3e1\t4 0\n", "utf-8")
    model = read_dtspn(file)
    assert model.positions.tolist() == [[1, 2], [-30, 4]]
    assert model.radius.tolist() == [0.5, 0]
    assert model.turning_radius == 1.5
    assert read_dtspn(file, turning_radius=0.25).turning_radius == 0.25
    plain = tmp_path / "discs.txt"
    plain.write_text("1 2 3", "utf-8")
    assert read_dtspn(plain, turning_radius=2).turning_radius == 2
    with pytest.raises(InvalidData, match=r"turning_radius must be given"):
        read_dtspn(plain)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must hold at least one line x y radius"),
        ("1 2", "line 1: must be x y radius, got 2 values: '1 2'"),
        ("1 2 3\n1 2 3 4", "line 2: must be x y radius, got 4 values"),
        ("1 2 3\n\n1 y 3", "line 3, column y: must be a finite number, got 'y'"),
        ("nan 2 3", "line 1, column x: must be a finite number, got 'nan'"),
        ("1 2 1e999", "line 1, column radius: must be a finite number"),
        ("1 2 3\n1 2 -3", "line 2, column radius: must be >= 0, got '-3'"),
        ("1,2,3", "line 1: must be x y radius"),
    ],
)
def test_bad_lines_of_a_public_instance(text, message, tmp_path):
    file = tmp_path / "dtspn-06-01-025-0.txt"
    file.write_text(text, "utf-8")
    with pytest.raises(InvalidData, match=message) as raised:
        read_dtspn(file)
    assert str(file) in str(raised.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,LB,UB\n", "must be a header of bounds.*missing: instance"),
        ("instance,LB,UB\na.txt,1,x\n", "line 2, column ub: must be a finite number, got 'x'"),
        ("instance,LB,UB\na.txt,1\n", "line 2: 2 values where the header has 3"),
        ("instance,LB,UB\na,1,2\na.txt,1,2\n", "line 3: instance must be a name that no other"),
        ("instance,LB,UB\n.,1,2\n", "line 2: instance must be a name that no other"),
        ("instance,LB,UB\na,3,2\n", r"line 2: LB must be <= UB = 2\.0, got 3\.0"),
    ],
)
def test_bad_lines_of_known_bounds(text, message, tmp_path):
    file = tmp_path / "best.csv"
    file.write_text(text, "utf-8")
    with pytest.raises(InvalidData, match=message):
        read_best_known(file)


# -- tables of vehicles --------------------------------------------------------------------------


def test_a_table_of_vehicles_is_an_instance(tmp_path):
    file = tmp_path / "fleet.csv"
    file.write_text(f"{HEADER}60, 20,1,0,5,lorry\n\n10,70,0,-2,0,7\n", "utf-8")
    model = ct.load(file)
    assert (model.kind, model.name, model.ids) == ("messenger-tour", "fleet", ("lorry", "7"))
    assert model.positions.tolist() == [[60, 20], [10, 70]]
    assert model.velocities.tolist() == [[1, 0], [0, -2]]
    assert model.radius.tolist() == [5, 0]
    assert ct.load(file, data={"speed": 3.0}).speed == 3
    (tmp_path / "half.csv").write_text("radius,y,x\n5,2,1\n", "utf-8")
    half = ct.load(tmp_path / "half.csv")
    assert half.positions.tolist() == [[1, 2]]
    assert half.at_rest
    assert half.ids is None
    (tmp_path / "fleet.json").write_text(
        json.dumps({"model": "messenger-tour", "data": {"positions": "fleet.csv", "speed": 4}}),
        "utf-8",
    )
    named = ct.load(tmp_path / "fleet.json")
    assert named.digest == ct.load(file, data={"speed": 4.0}).digest


def test_a_sheet_of_vehicles_is_an_instance(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="Excel files need openpyxl")
    book = openpyxl.Workbook()
    for row in (["x", "y", "vx", "vy", "id"], [60, 20.5, 1, 0, 12], [10, 70, 0, -2, "b"]):
        book.active.append(row)
    book.save(tmp_path / "fleet.xlsx")
    model = ct.load(tmp_path / "fleet.xlsx")
    assert model.positions.tolist() == [[60, 20.5], [10, 70]]
    assert model.ids == ("12", "b")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must be a header of vehicles"),
        ("1,2,3,4,5,6\n", "line 1: must be a header of vehicles"),
        ("x,y\n1,2\n", "must be a header of vehicles"),
        ("x,y,vx,radius\n1,2,3,4\n", "must be a header of vehicles"),
        ("x,y,radius,radius\n1,2,3,4\n", "must be a header of vehicles"),
        ("x,y,radius,colour\n1,2,3,red\n", "must be a header of vehicles.*colour"),
        (HEADER, "no vehicles below the header"),
        (f"{HEADER}1,2,3,4,5\n", "line 2: 5 values where the header has 6"),
        (f"{HEADER}1,2,0,0,5,a,b\n", "line 2: 7 values where the header has 6"),
        (f"{HEADER}\n1,2,0,zero,5,a\n", "line 3, column vy: must be a finite number, got 'zero'"),
        (f"{HEADER}1,inf,0,0,5,a\n", "line 2, column y: must be a finite number"),
        (f"{HEADER}1,2,0,0,5,\n", "line 2, column id: must name the vehicle"),
        (f'{HEADER}1,2,0,0,5,"a\n', "no valid CSV"),
    ],
)
def test_bad_tables_of_vehicles(text, message, tmp_path):
    file = tmp_path / "fleet.csv"
    file.write_text(text, "utf-8")
    with pytest.raises(InvalidData, match=message):
        read_vehicles(file)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,2,0,0,-5,a\n", r"radius\[0\] must be >= 0"),
        ("1,2,6,8,5,a\n", r"velocities\[0\] must be slower than the UAV"),
        ("1,2,0,0,5,a\n1,2,0,0,5,a\n", "ids must differ"),
    ],
)
def test_rejects_tables_with_invalid_vehicles(row, message, tmp_path):
    (tmp_path / "fleet.csv").write_text(HEADER + row, "utf-8")
    with pytest.raises(InvalidData, match=message):
        ct.load(tmp_path / "fleet.csv")


def test_a_table_of_waypoints_is_not_a_table_of_vehicles(tmp_path):
    (tmp_path / "way.csv").write_text("x,y\n0,0\n1,1\n2,0\n", "utf-8")
    kind = ct.load(tmp_path / "way.csv", data={"times": [0, 1, 2]}).kind
    assert kind == "minimum-snap"


# -- export --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["B-10-04", "moving-targets", "euclidean", "gap"])
def test_samples_lie_on_the_path(name, tmp_path):
    model = ct.load(f"messenger/{name}")
    plan = flight(model)
    assert ct.verify(model, plan).ok
    assert export_formats(model)["samples"].options == ("rate",)
    file = export_plan(model, plan, tmp_path / "tour.csv", rate=7)
    rows = list(csv.DictReader(file.read_text("utf-8").splitlines()))
    assert list(rows[0]) == ["t", "x", "y", "heading", "leg"]
    times = np.array([float(row["t"]) for row in rows])
    poses = np.array([[float(row[key]) for key in ("x", "y", "heading")] for row in rows])
    assert times[0] == 0
    assert times[-1] * model.speed == pytest.approx(plan.length, rel=1e-12)
    assert np.diff(times).max() <= 1 / 7 + 1e-12
    # Steps respect the speed and the turning radius.
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert (steps <= model.speed * np.diff(times) * (1 + 1e-9) + 1e-9).all()
    if model.turning_radius > 0:
        turned = np.abs(np.diff(poses[:, 2]))
        assert (turned <= model.speed * np.diff(times) / model.turning_radius + 1e-9).all()
    for place, (vehicle, time) in enumerate(zip(plan.order, plan.times, strict=True)):
        near = int(np.abs(times - time).argmin())
        slack = model.speed * abs(times[near] - time) + 1e-6
        assert math.dist(poses[near, :2], model.where(vehicle, time)) <= slack
        assert abs(int(rows[near]["leg"]) - place) <= 1


def test_rejects_bad_sampling_arguments(tmp_path):
    model = ct.load("messenger/gap")
    plan = flight(model)
    with pytest.raises(InvalidData, match="rate must be > 0"):
        export_plan(model, plan, tmp_path / "a.csv", rate=0)
    with pytest.raises(InvalidData, match="rate must give at most"):
        export_plan(model, plan, tmp_path / "a.csv", rate=1e9)
    with pytest.raises(InvalidData, match="plan must be a TourPlan"):
        write_tour_samples(plan.to_data(), tmp_path / "a.csv", model=model)
    assert not list(tmp_path.iterdir())
