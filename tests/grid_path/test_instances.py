"""Instances of grid paths: what generators promise, the catalogue, references and exports."""

import hashlib
import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from scipy.ndimage import label

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import entries, export_formats, export_plan
from crosstrack.instances.demos import build_demo
from crosstrack.instances.grid_path import (
    maze,
    paper_map,
    random_cells,
    random_nodes,
    random_polygons,
    rooms,
    write_geojson_polygons,
    write_map,
)
from crosstrack.models.grid_path import GridMap, GridPath, GridPlan, as_shapely, distances

OURS = [one for one in entries() if one.name.startswith("grid-path/")]
LINES = ["..@.", ".@@.", "...."]
HEAD = "type octile\nheight 3\nwidth 4\nmap\n"


def regions(grid):
    return label(~grid.blocked)[1]


def fingerprint(*arrays):
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()[:16]


# -- generators ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_polygons_are_irregular_and_apart(seed):
    bounds, depots = (-50.0, 20.0, 150.0, 220.0), [(50.0, 120.0), (-49.0, 21.0)]
    found = random_polygons(28, seed, bounds, keep=depots, gap=2.0)
    shapes = as_shapely(found)
    assert shapely.is_valid(shapes).all()
    assert shapely.within(shapes, shapely.box(*bounds)).all()
    apart = shapely.distance(shapes[:, None], shapes)
    assert apart[~np.eye(28, dtype=bool)].min() > 2
    assert shapely.distance(shapes[:, None], shapely.points(depots)).min() > 2
    convex = np.isclose(shapely.area(shapes), shapely.area(shapely.convex_hull(shapes)))
    assert 0 < convex.sum() < 20
    assert 0.1 < shapely.area(shapes).sum() / 200**2 < 0.2


def test_seeds_mean_the_same_everywhere():
    polygons = random_polygons(28, 1)
    grid = GridMap.from_polygons(polygons, (0, 0, 200, 200), 2)
    assert fingerprint(*(one.shell for one in polygons)) == "4c20f4e431cbac6f"
    assert fingerprint(random_nodes(grid, (1, 1), 75, 1)) == "f5bcbabc4c4c8994"
    assert fingerprint(maze(31, 21, 1).blocked, rooms(33, 25, 1).blocked) == "6bf03fc86d2f408f"
    assert fingerprint(random_cells(20, 30, 0.3, 1).blocked) == "ed52a31f122f8310"
    assert maze(31, 21, 2).data() != maze(31, 21, 1).data()


def test_nodes_are_where_robots_can_go():
    blocked = np.zeros((10, 12), bool)
    blocked[:, 6] = True
    blocked[4, 3] = True
    grid = GridMap(blocked, 0.5, (7.0, -3.0))
    depot = grid.centres((2, 2)) + 0.1
    nodes = random_nodes(grid, depot, 58, 3)
    cells = grid.cells_of(nodes)
    assert grid.holds(cells).all()
    assert cells[:, 1].max() < 6
    assert len({(*cell,) for cell in cells.tolist()} | {(2, 2)}) == 59
    assert np.allclose(grid.centres(cells), nodes)
    assert len(random_nodes(grid, depot, 0, 3)) == 0
    with pytest.raises(InvalidData, match=r"count must be at most 58, .* got 59"):
        random_nodes(grid, depot, 59)
    with pytest.raises(InvalidData, match="depot must lie in a free cell"):
        random_nodes(grid, grid.centres((4, 3)))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**40), st.integers(0, 12), st.integers(0, 12), st.integers(1, 4))
def test_mazes_have_one_way_and_rooms_at_least_one(seed, rows, columns, width):
    rows, columns = rows + width + 2, columns + width + 2
    found = maze(rows, columns, seed, corridor=width)
    halls = ((rows - 1) // (width + 1), (columns - 1) // (width + 1))
    assert found.shape == (rows, columns)
    assert regions(found) == 1
    # A tree: every hall of width² cells, and a passage of `width` cells for each but one.
    count = halls[0] * halls[1]
    assert (~found.blocked).sum() == count * width**2 + (count - 1) * width
    house = rooms(rows, columns, seed, size=width, doors=0.5)
    assert regions(house) == 1
    walls = halls[0] * (halls[1] - 1) + halls[1] * (halls[0] - 1)
    assert count - 1 <= (~house.blocked).sum() - count * width**2 <= walls
    every = rooms(rows, columns, seed, size=width, doors=1)
    assert (~every.blocked).sum() == count * width**2 + walls


def test_a_large_maze():
    found = maze(1001, 1001, 3)
    assert regions(found) == 1
    assert (~found.blocked).sum() == 2 * 500**2 - 1


def test_random_cells():
    assert random_cells(300, 400, 0.3, 2).blocked.mean() == pytest.approx(0.3, abs=0.01)
    assert not random_cells(9, 9, 0).blocked.any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: random_polygons(-1), "count must be >= 0"),
        (lambda: random_polygons(28, 1, size=3), "count must leave room .* size < 3"),
        (lambda: random_polygons(1, 1, (0, 0, 1, 1), keep=[(0.5, 0.5)], gap=1), "leave room"),
        (lambda: random_polygons(5, 1, (0, 0, 0, 1)), "bounds must be least x"),
        (lambda: random_polygons(5, 1, (-1e308, 0, 1e308, 1)), "bounds must be least x"),
        (lambda: random_polygons(5, -1), "seed must be >= 0"),
        (lambda: random_polygons(5, size=0), "size must be > 0"),
        (lambda: maze(2, 9), "rows must be >= 3"),
        (lambda: maze(9, 9, corridor=0), "corridor must be >= 1"),
        (lambda: maze(10**5, 10**5), "rows × columns must be at most"),
        (lambda: rooms(9, 8, size=7), "columns must be >= 9"),
        (lambda: rooms(9, 9, doors=2), "doors must be <= 1"),
        (lambda: random_cells(9, 9, 1.0), "at least one cell free"),
        (lambda: random_cells(9, 9, math.nan), "density must be finite"),
        (lambda: random_nodes([[0]], (0, 0)), "grid must be a GridMap"),
    ],
)
def test_generators_refuse(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


# -- the catalogue -------------------------------------------------------------------------------


def test_instances_are_small_and_match_their_names():
    models = {one.name.partition("/")[2]: one.build() for one in OURS}
    assert len({model.digest for model in models.values()}) == len(OURS) == 11
    lengths = {}
    for name, model in models.items():
        assert model.map.blocked.size <= 10_000
        cells = np.vstack([model.start, model.goals])
        lengths[name] = distances(model.map, cells, diagonal=model.connectivity != "4")[0, 1:]
    assert not np.isfinite(lengths.pop("unreachable")).any()
    assert all(np.isfinite(found).all() for found in lengths.values())
    assert lengths["one-cell"] == [0]
    assert {str(model.connectivity) for model in models.values()} == {"4", "8", "any"}
    assert {str(model.reach) for model in models.values()} == {"nearest", "each"}
    assert models["terrain"].weights.max() / models["terrain"].weights.min() > 50
    pocket = models["pocket"]
    apart = math.dist(pocket.start.tolist(), pocket.goals[0].tolist())
    assert lengths["pocket"][0] > 6 * apart
    passage = models["passage"].map
    assert np.flatnonzero(~passage.blocked[:, 10]).tolist() == [6]
    assert GridMap.from_polygons(
        [[(2.4, -0.6), (3.9, -0.6), (3.9, 0.9), (2.4, 0.9)],
         [(2.4, 1.8), (3.9, 1.8), (3.9, 4.2), (2.4, 4.2)]],
        (0, -0.6, 6.3, 4.2), 0.3, 0.30001,
    ).blocked[:, 10].all(), "a robot only a little larger does not pass"  # fmt: skip


def test_the_map_in_the_papers_manner():
    grid = paper_map(1.0, 2.0)
    assert grid.shape == (200, 200)
    assert grid.holds(grid.cells_of((100, 100)))
    assert len(random_nodes(grid, (100, 100), 75, 1)) == 75


# -- instances that name files -------------------------------------------------------------------


def instance(folder, map_, **data):
    file = folder / "instance.json"
    held = {"map": map_, "start": [0, 0], "goals": [2, 3], **data}
    file.write_text(json.dumps({"model": "grid-path", "data": held}), "utf-8")
    return file


def test_instances_name_their_maps(tmp_path):
    write_map(GridMap(LINES), tmp_path / "a.map")
    plain = GridPath(GridMap(LINES), np.array([0, 0]), np.array([2, 3]))
    assert ct.load(instance(tmp_path, "a.map")).digest == plain.digest
    wide = ct.load(instance(tmp_path, {"file": "a.map", "cell": 2.5}))
    assert wide.map.cell == 2.5
    write_geojson_polygons([[(2, 0), (3, 0), (3, 2), (2, 2)]], tmp_path / "walls.geojson")
    options = {"bounds": [0, 0, 4, 3], "cell": 1, "radius": 0.0}
    walls = ct.load(instance(tmp_path, {"file": "walls.geojson", **options}))
    assert walls.map.data()["blocked"] == ["..@.", "..@.", "...."]
    assert walls.map.upward
    whole = ct.load(instance(tmp_path, GridMap(LINES).data()))
    assert whole.digest == plain.digest


@pytest.mark.parametrize(
    ("map_", "message"),
    [
        ("b.map", "b.map: no such file"),
        ("/etc/hostname", "must be named relative"),
        ("../a.map", "must lie below the instance's folder"),
        ("a.csv", r"a\.csv: the name of a map's file must end in \.map, \.txt"),
        ({"file": 3}, "map.file must name a file, got 3"),
        (
            {"file": "a.map", "cel": 2},
            "'cel' is no option of maps in .map files; did you mean 'cell'",
        ),
        ({"file": "a.map", "path": "b.map"}, "'path' is no option"),
        ({"file": "a.map", "cell": "2"}, "cell must be a number"),
        ({"file": "walls.geojson"}, "maps in .geojson files need bounds, cell beside the file"),
    ],
)
def test_maps_that_instances_cannot_name(map_, message, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    for name in ("a.map", "a.csv", "walls.geojson"):
        (home / name).write_text(HEAD + "\n".join(LINES), "utf-8")
    write_map(GridMap(LINES), tmp_path / "a.map")
    with pytest.raises(InvalidData, match=message):
        ct.load(instance(home, map_), trusted=True)


def test_a_message_quotes_a_file_only_if_trusted(tmp_path):
    (tmp_path / "a.map").write_text(HEAD + "....\n.secret.\n....", "utf-8")
    with pytest.raises(InvalidData, match="line 6: not in the form that the model reads"):
        ct.load(instance(tmp_path, "a.map"))


def test_the_demonstration(tmp_path):
    assert build_demo("grid-path", {}).name == "grid-path/paper-map"
    file = write_map(GridMap(LINES), tmp_path / "a.map")
    model = build_demo("grid-path", {"map": str(file), "goal": "2,3", "connectivity": "4"})
    assert (model.goals.tolist(), str(model.connectivity)) == ([[2, 3]], "4")
    with pytest.raises(InvalidData, match="goal must be ROW,COLUMN, got 'here'"):
        build_demo("grid-path", {"map": str(file), "goal": "here"})


# -- export --------------------------------------------------------------------------------------


def test_paths_as_files(tmp_path):
    model = ct.load("grid-path/errands")
    plan = GridPlan([[[0.1, 1 / 3], [2, 1e-17]], [[5, 5]]])
    assert list(export_formats(model)) == ["csv", "geojson"]
    rows = export_plan(model, plan, tmp_path / "a.csv").read_text("utf-8").splitlines()
    assert rows == ["path,x,y", f"0,0.1,{1 / 3!r}", "0,2.0,1e-17", "1,5.0,5.0"]
    text = export_plan(model, plan, tmp_path / "a.geojson", "geojson").read_text("utf-8")
    content = json.loads(text)
    lines = [one["geometry"] for one in content["features"]]
    assert [one["type"] for one in lines] == ["LineString"] * 2
    assert lines[0]["coordinates"] == plan.paths[0].tolist()
    assert lines[1]["coordinates"] == [[5, 5], [5, 5]]
    assert [one["properties"] for one in content["features"]] == [{"path": 0}, {"path": 1}]
