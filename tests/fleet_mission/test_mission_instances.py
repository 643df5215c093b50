"""The catalogue of missions, the generator, files that missions refer to, and plans as files."""

import csv
import json
import re

import numpy as np
import pytest
import shapely
from fleet_mission.missions import box, flown, plain, small
from framework.commands import run
from scipy.ndimage import label

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import entries, export_plan, read_poly7
from crosstrack.instances.fleet_mission import random_mission
from crosstrack.models import FleetMission


@pytest.mark.parametrize("seed", [0, 28])
def test_drawn_missions_are_in_the_papers_manner(seed):
    model = random_mission(seed=seed)
    assert (model.vehicles, len(model.nodes), len(model.obstacles)) == (4, 75, 28)
    again = random_mission(seed=seed)
    assert again == model
    assert random_mission(seed=seed + 1) != model
    solids = [shapely.Polygon(one.shell) for one in model.obstacles]
    assert all(one.is_valid for one in solids)
    gaps = shapely.STRtree(solids).query(solids, predicate="dwithin", distance=4.0)
    assert (gaps[0] == gaps[1]).all(), "a robot passes between any two polygons"
    places = shapely.points(model.places)
    away = shapely.distance(places, shapely.union_all(solids))
    assert away.min() >= model.radius
    regions = label(~model.map.blocked)[0]
    assert len({regions[tuple(cell)] for cell in model.map.cells_of(model.places)}) == 1


def test_every_entry_matches_its_title():
    found = {one.name: one.build() for one in entries() if one.model == "fleet-mission"}
    assert len(found) == 7
    assert found["fleet-mission/one-cell"].map.blocked.sum() == 8
    corridor = found["fleet-mission/corridor"]
    column = corridor.map.blocked[:, corridor.map.cells_of([5, 4])[1]]
    assert (~column).sum() == 1
    # A slightly wider robot does not fit through the gap.
    with pytest.raises(InvalidData, match="cannot be reached"):
        FleetMission(**{**vars_of(corridor), "radius": 0.2501})
    example = found["fleet-mission/example"]
    assert (example.vehicles, len(example.nodes), len(example.obstacles)) == (3, 9, 5)
    nested = found["fleet-mission/nested"]
    solids = [shapely.Polygon(one.shell, one.holes) for one in nested.obstacles]
    pairs = shapely.STRtree(solids).query(solids, predicate="intersects").T
    assert any(a < b for a, b in pairs)


def vars_of(model):
    return {key: value for key, value in model.data().items() if value is not None}


def test_obstacles_may_lie_in_a_file_beside_the_instance(tmp_path):
    model = small()
    rings = [[*box(4, 4, 6, 6), [4, 4]]]
    (tmp_path / "walls.geojson").write_text(
        json.dumps(
            {
                "type": "Feature",
                "properties": {},
                "geometry": {"type": "Polygon", "coordinates": rings},
            }
        )
    )
    data = {**model.to_dict(), "data": {**model.data(), "obstacles": "walls.geojson"}}
    (tmp_path / "mission.json").write_text(json.dumps(data))
    assert ct.load(tmp_path / "mission.json") == model
    data["data"]["obstacles"] = "../walls.geojson"
    (tmp_path / "mission.json").write_text(json.dumps(data))
    with pytest.raises(InvalidData, match=r"walls\.geojson"):
        ct.load(tmp_path / "mission.json")
    data["data"]["obstacles"] = "walls.geojson"
    (tmp_path / "mission.json").write_text(json.dumps(data))
    (tmp_path / "walls.geojson").write_text(
        '{"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}'
    )
    with pytest.raises(InvalidData, match=re.escape(str(tmp_path / "walls.geojson"))):
        ct.load(tmp_path / "mission.json")


@pytest.mark.parametrize(
    "damage",
    [
        {"routes": [[0]]}, {"routes": 1, "trajectories": [], "visits": []},
        {"routes": [[0]], "trajectories": [], "visits": [[1.0]]},
        {"routes": [[0]], "trajectories": [None], "visits": [[]]},
        {"routes": [[0.5]], "trajectories": [None], "visits": [[1.0]]},
        {"routes": [[0]], "trajectories": ["x"], "visits": [[1.0]]},
        {"routes": [[0]], "trajectories": [{"times": [0, 1]}], "visits": [[1.0]]},
        {
            "routes": [[0]], "visits": [[1.0]],
            "trajectories": [{"times": [0, 1], "coefficients": [[[1.0], [2.0]]]}],
        },
    ],
)  # fmt: skip
def test_plans_that_are_none(damage):
    with pytest.raises(InvalidData):
        small().plan_from_data(damage)


@pytest.mark.parametrize("size", [1e300, 1e150, 1e-300])
def test_numbers_beyond_reason_end(size):
    """A curve far beyond the map, or with knots that floats cannot tell apart, is judged at once."""
    model = small()
    plan = flown([[1, 1], (0, [size, 8]), (1, [8, 2])], [[1, 1], (2, [2, 8])], pace=max(size, 1e-3))
    assert not model.verify(plan).ok


def rows_of(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def test_samples(tmp_path):
    model = small()
    plan = plain(model)
    export_plan(model, plan, tmp_path / "samples.csv", rate=4.0)
    rows = rows_of(tmp_path / "samples.csv")
    assert list(rows[0]) == ["robot", "t", "x", "y", "vx", "vy", "ax", "ay"]
    for robot, one in enumerate(plan.trajectories):
        own = [row for row in rows if row["robot"] == str(robot)]
        times = np.array([float(row["t"]) for row in own])
        assert times[0] == one.times[0]
        assert times[-1] == one.times[-1]
        for names, order in ((("x", "y"), 0), (("vx", "vy"), 1), (("ax", "ay"), 2)):
            values = np.array([[float(row[name]) for name in names] for row in own])
            assert values == pytest.approx(one(times, order), abs=1e-12)
    with pytest.raises(InvalidData, match="rate"):
        export_plan(model, plan, tmp_path / "samples.csv", rate=0.0)


def test_a_poly7_file_for_each_robot(tmp_path):
    model = small()
    plan = plain(model)
    report = export_plan(model, plan, tmp_path / "swarm.csv", "poly7", height=1.5)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["swarm-0.csv", "swarm-1.csv"]
    assert [one["robot"] for one in report.to_dict()["files"]] == [0, 1]
    assert "robot 1, to be started at 80 s" in str(report)
    for robot, one in enumerate(plan.trajectories):
        again = read_poly7(tmp_path / f"swarm-{robot}.csv")
        at = np.linspace(0, one.duration, 50)
        assert again(at)[:, :2] == pytest.approx(one(one.times[0] + at), abs=1e-5)
        assert again(at)[:, 2] == pytest.approx(1.5)


def test_geojson(tmp_path):
    model = small(ids=["a", "b", "c"])
    plan = plain(model)
    export_plan(model, plan, tmp_path / "mission.geojson", "geojson", rate=1.0)
    data = json.loads((tmp_path / "mission.geojson").read_text())
    kinds = [one["geometry"]["type"] for one in data["features"]]
    assert [kinds.count(kind) for kind in ("Polygon", "Point", "LineString")] == [1, 4, 2]
    shapes = [shapely.from_geojson(json.dumps(one["geometry"])) for one in data["features"]]
    assert shapes[0].equals(shapely.Polygon(model.obstacles[0].shell))
    nodes = {
        one["properties"]["node"]: one["properties"]
        for one in data["features"]
        if "node" in one["properties"]
    }
    assert nodes["b"] == {"node": "b", "robot": 0, "time": 20.0}
    line = data["features"][-1]
    assert line["properties"]["robot"] == 1
    assert line["geometry"]["coordinates"][20] == pytest.approx([2, 8])


def test_the_command_line(tmp_path):
    target = tmp_path / "plan.json"
    solved = run(
        *("solve", "fleet-mission/pocket", "--seed", 0, "--option", "routing=kmeans-ac", "--json")
    )
    target.write_text(solved.stdout)
    run("check", "fleet-mission/pocket", target)
    run(
        "export",
        "fleet-mission/pocket",
        target,
        "--format",
        "poly7",
        "--output",
        tmp_path / "fly.csv",
    )
    assert (tmp_path / "fly-0.csv").exists()
    told = run("diagnose", "fleet-mission/pocket").stdout
    assert "robots of a radius of up to" in told


def test_too_many_pieces_for_the_firmware_name_the_option_that_gives_fewer(tmp_path):
    model = ct.load("fleet-mission/corridor")
    quick = {"routing": "kmeans-ac"}
    rounded = ct.solve(model, "staged", seed=0, backend_options=quick).plan
    chosen = quick | {"trajectories": "interior-point"}
    snap = ct.solve(model, "staged", seed=0, backend_options=chosen).plan
    assert "trajectories=interior-point" in str(
        export_plan(model, rounded, tmp_path / "many.csv", "poly7")
    )
    with pytest.raises(InvalidData, match=r"trajectories\[0\].*31.*trajectories=interior-point"):
        export_plan(model, rounded, tmp_path / "strict.csv", "poly7", strict=True)
    assert not list(tmp_path.glob("strict*"))
    report = export_plan(model, snap, tmp_path / "few.csv", "poly7", strict=True)
    assert all(entry.fits for entry in report.reports)
    assert "interior-point" not in str(report)
