"""Instances of grid paths: what generators promise, the catalogue, and files, hostile ones too."""

import hashlib
import json
import math
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from scipy.ndimage import label

import crosstrack as ct
from crosstrack.errors import BackendMissing, InvalidData
from crosstrack.instances import entries, export_formats, export_plan
from crosstrack.instances.demos import build_demo
from crosstrack.instances.grid_path import (
    maze,
    paper_map,
    random_cells,
    random_nodes,
    random_polygons,
    read_geojson_polygons,
    read_grid,
    read_image,
    read_map,
    read_scenarios,
    read_text_map,
    rooms,
    write_geojson_polygons,
    write_map,
    write_text_map,
)
from crosstrack.models.grid_path import GridMap, GridPath, GridPlan, as_shapely, distances

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "movingai"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public maps lie in ../shared/data/movingai, which is absent"
)
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


@settings(deadline=None, max_examples=60)
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


def test_instances_are_small_and_what_they_are_called():
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


# -- MovingAI ------------------------------------------------------------------------------------


@needs_public
@pytest.mark.parametrize("name", ["arena", "den312d", "maze-32-32-2", "random-64-64-20"])
def test_public_scenarios_have_the_lengths_of_shortest_paths(name):
    """Against the solver of SciPy, which knows nothing of files."""
    grid = read_map(PUBLIC / f"{name}.map", cell=0.5)
    (file,) = PUBLIC.glob(f"{name}*.scen")
    found = read_scenarios(file, grid)
    assert len(found) == len(file.read_text().strip().splitlines()) - 1
    some = found[:: len(found) // 20]
    lengths = distances(grid, [one.start for one in some] + [one.goal for one in some])
    ours = np.diagonal(lengths, len(some))
    assert ours == pytest.approx([one.optimum for one in some], rel=1e-5)
    assert read_scenarios(file, grid, bucket=found[-1].bucket)[-1] == found[-1]
    assert not read_scenarios(file, grid, bucket=10**6)
    model = found[0].pose(grid, connectivity="4")
    assert (model.kind, model.start.tolist()) == ("grid-path", list(found[0].start))


@needs_public
def test_a_public_map_travels(tmp_path):
    file = PUBLIC / "den312d.map"
    grid = read_map(file)
    lines = file.read_text().splitlines()
    assert grid.shape == (81, 65)
    assert [[letter != "." for letter in line] for line in lines[4:]] == grid.blocked.tolist()
    again = read_map(write_map(grid, tmp_path / "a.map"))
    assert np.array_equal(again.blocked, grid.blocked)
    assert read_grid(PUBLIC / "maze512-8-0.map", cell=2).shape == (512, 512)


def test_letters_of_a_map(tmp_path):
    file = tmp_path / "a.map"
    file.write_text(
        "type octile\r\nheight 2\r\nwidth 7\r\nmap\r\n.GS@OTW\r\n.......\r\n\r\n", "utf-8"
    )
    grid = read_map(file, cell=3)
    assert grid.data()["blocked"] == ["...@@@@", "......."]
    assert (grid.cell, grid.upward) == (3, False)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must be type octile, got ''"),
        ("type tile\nheight 1\nwidth 1\nmap\n.", "line 1: must be type octile"),
        ("type octile\nwidth 1\nheight 1\nmap\n.", "line 2: must be height and a number"),
        ("type octile\nheight 1\nwidth -1\nmap\n.", "line 3: must be width and a number, got 'width -1'"),
        ("type octile\nheight 1e9\nwidth 1\nmap\n.", "line 2: must be height"),
        ("type octile\nheight 999999999\nwidth 999999999\nmap\n.", "must have 999999999 lines"),
        ("type octile\nheight ١\nwidth 1\nmap\n.", "line 2: must be height"),
        (HEAD + "....\n....", "must have 3 lines of cells, as line 2 says, got 2"),
        (HEAD + "...\n...\n...", "line 5: must have 4 cells, as line 3 says, got 3"),
        (HEAD + "....\n...\n....", "line 6 must have 4 cells as the first, got 3"),
        (HEAD + "....\n..?.\n....", r"line 6, column 3 must be one of \. G S \(free\) .* got '\?'"),
        (HEAD + "....\n..\ud7ff.\n....", "line 6, column 3 must be one of"),
        (HEAD + "@@@@\n@@@@\n@@@@", "at least one cell free"),
    ],
)  # fmt: skip
def test_bad_maps(text, message, tmp_path):
    file = tmp_path / "a.map"
    file.write_text(text, "utf-8")
    with pytest.raises(InvalidData, match=message) as caught:
        read_map(file)
    assert str(caught.value).startswith(str(file))


ROW = "0\ta.map\t4\t3\t0\t0\t3\t2\t5.0"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must be version 1, got ''"),
        ("version 2\n", "line 1: must be version 1"),
        ("version 1\n1 2 3", "line 2: must have the 9 columns bucket, .* got 3"),
        ("version 1\n\n" + ROW.replace("\t5.0", "\tfar"), "line 3, column optimum: must be a finite"),
        ("version 1\n" + ROW.replace("5.0", "nan"), "line 2, column optimum"),
        ("version 1\n" + ROW.replace("5.0", "-1"), "column optimum: must be >= 0"),
        ("version 1\n" + ROW.replace("\t3\t2", "\t3.5\t2"), "column goal x: must be a whole number"),
        ("version 1\n" + ROW.replace("\t3\t2", "\t3\t-2"), "column goal y: must be a whole number"),
        ("version 1\n" + ROW.replace("\t4\t3", "\t3\t4"), "about a map of 4 × 3 cells, .* has 3 × 4"),
        ("version 1\n" + ROW.replace("\t3\t2", "\t4\t2"), "goal must be a free cell, got x 4, y 2"),
        ("version 1\n" + ROW.replace("\t0\t0\t", "\t2\t0\t"), "line 2: the start must be a free cell"),
    ],
)  # fmt: skip
def test_bad_scenarios(text, message, tmp_path):
    file = tmp_path / "a.scen"
    file.write_text(text, "utf-8")
    with pytest.raises(InvalidData, match=message) as caught:
        read_scenarios(file, GridMap(LINES))
    assert str(caught.value).startswith(str(file))


def test_scenarios_of_another_hand(tmp_path):
    file = tmp_path / "a.scen"
    file.write_text(
        f"version 1.0\n{ROW.replace('a.map', 'my maps/a b.map')}\n7 a 4 3 1 0 1 2 2\n", "utf-8"
    )
    first, second = read_scenarios(file, GridMap(LINES, cell=2.0))
    assert (first.start, first.goal, first.optimum, first.bucket) == ((0, 0), (2, 3), 10.0, 0)
    assert (second.start, second.goal, second.optimum, second.bucket) == ((0, 1), (2, 1), 4.0, 7)


# -- text and images -----------------------------------------------------------------------------


def test_text_travels(tmp_path):
    grid = GridMap(LINES, 0.5, (3, 4), upward=True)
    file = write_text_map(grid, tmp_path / "a.txt")
    assert file.read_text("utf-8").splitlines() == LINES[::-1], "as pictures show it"
    again = read_text_map(file, cell=0.5, origin=(3, 4), upward=True)
    assert again.data() == grid.data()
    assert read_text_map(write_text_map(GridMap(LINES), file)).data() == GridMap(LINES).data()


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "must hold at least one free cell"),
        (b"..\n.\n", "line 2 must have 2 cells as the first, got 1"),
        (b"..\n\n..\n", "line 2 must have 2 cells as the first, got 0"),
        (b"..\n. \n", "line 2, column 2 must be one of"),
        (b"..\n.\x00\n", "line 2, column 2 must be one of"),
        (b"..\n.\xff\n", "line 2: byte 0xff is no UTF-8"),
        (b"@@\n@@\n", "must hold at least one free cell, got none"),
    ],
)
def test_bad_texts(raw, message, tmp_path):
    file = tmp_path / "a.txt"
    file.write_bytes(raw)
    with pytest.raises(InvalidData, match=message) as caught:
        read_text_map(file)
    assert str(caught.value).startswith(str(file))


def saved(array, file, mode=None, **options):
    image = pytest.importorskip("PIL.Image", reason="images need Pillow")
    found = image.fromarray(np.asarray(array))
    (found.convert(mode) if mode else found).save(file, **options)
    return file


GRAYS = [[255, 254, 0, 200], [128, 127, 10, 255], [255, 255, 255, 255]]


@pytest.mark.parametrize(
    ("suffix", "mode"),
    [(".png", None), (".png", "1"), (".png", "P"), (".png", "RGB"), (".bmp", None), (".gif", None), (".pgm", None)],
)  # fmt: skip
def test_images(suffix, mode, tmp_path):
    grays = np.where(np.array(GRAYS) > 127, 255, 0) if mode == "1" else GRAYS
    file = saved(np.array(grays, np.uint8), tmp_path / f"a{suffix}", mode)
    assert read_image(file).data()["blocked"] == LINES
    grid = read_grid(file, cell=0.1, origin=(1, 2), upward=True)
    assert grid.data() == GridMap(LINES[::-1], 0.1, (1, 2), upward=True).data()
    if mode != "1":
        assert read_image(file, threshold=0.9).data()["blocked"] == ["..@@", "@@@.", "...."]


def test_images_with_transparency_or_16_bits(tmp_path):
    clear = np.zeros((2, 2, 4), np.uint8)
    clear[0, 0, 3] = 255
    assert read_image(saved(clear, tmp_path / "a.png")).data()["blocked"] == ["@.", ".."]
    deep = np.array([[0, 30000], [40000, 65535]], np.uint16)
    assert read_image(saved(deep, tmp_path / "b.png")).data()["blocked"] == ["@@", ".."]


def bomb(width, height):
    """A PNG that says that it is large."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    packed = zlib.compress(bytes(1000))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "cannot be read as an image"),
        (b"no image at all", "cannot be read as an image"),
        (bomb(8200, 8200), "must have at most 67108864 pixels, got 8200 × 8200"),
        (bomb(20_000, 20_000), "a.png: "),
        (bomb(2**31 - 1, 2**31 - 1), "a.png: "),
        (bomb(100, 100)[:-40], "cannot be read as an image"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "cannot be read as an image"),
    ],
    ids=["empty", "text", "large", "larger", "largest", "cut", "program"],
)
def test_bad_images(raw, message, tmp_path):
    pytest.importorskip("PIL", reason="images need Pillow")
    file = tmp_path / "a.png"
    file.write_bytes(raw)
    with pytest.raises(InvalidData, match=message) as caught:
        read_image(file)
    assert str(caught.value).startswith(str(file))


def test_images_that_are_no_maps(tmp_path, monkeypatch):
    dark = saved(np.zeros((2, 2), np.uint8), tmp_path / "dark.png")
    with pytest.raises(
        InvalidData, match=r"dark\.png: no pixel is as bright as the threshold 0\.5"
    ):
        read_image(dark)
    with pytest.raises(InvalidData, match="threshold must be <= 1"):
        read_image(dark, threshold=128)
    with pytest.raises(InvalidData, match="no such file"):
        read_image(tmp_path / "b.png")
    with pytest.raises(InvalidData, match="cannot be read: Is a directory"):
        read_image(tmp_path)
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(BackendMissing, match=r"pip install 'crosstrack\[plot\]'"):
        read_image(dark)


# -- GeoJSON -------------------------------------------------------------------------------------

RING = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
HOLE = [[1, 1], [1, 2], [2, 2], [1, 1]]
SHAPE = {"type": "Polygon", "coordinates": [RING, HOLE]}


def test_polygons_travel(tmp_path):
    held = [*random_polygons(5, 2), {"shell": np.add(RING, 500), "holes": [np.add(HOLE, 500)]}]
    file = write_geojson_polygons(held, tmp_path / "a.geojson")
    content = json.loads(file.read_text("utf-8"))
    assert [one["geometry"]["type"] for one in content["features"]] == ["Polygon"] * 6
    assert content["features"][5]["geometry"]["coordinates"][0] == np.add(RING, 500).tolist()
    found = read_geojson_polygons(file)
    assert all(np.array_equal(a.shell, b.shell) for a, b in zip(found, held[:5], strict=False))
    assert [len(one.holes) for one in found] == [0] * 5 + [1]
    assert read_geojson_polygons(write_geojson_polygons([], file)) == ()


@pytest.mark.parametrize(
    ("content", "count"),
    [
        (SHAPE, 1),
        ({"type": "MultiPolygon", "coordinates": [[RING], [np.add(RING, 9).tolist()]]}, 2),
        ({"type": "Feature", "properties": None, "geometry": SHAPE, "bbox": [0, 0, 4, 4]}, 1),
        ({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": SHAPE}] * 3}, 3),
        ({"type": "Polygon", "coordinates": [[[*point, 17.5] for point in RING]]}, 1),
    ],
)  # fmt: skip
def test_kinds_of_geojson(content, count, tmp_path):
    file = tmp_path / "a.geojson"
    file.write_text(json.dumps(content), "utf-8")
    found = read_geojson_polygons(file)
    assert len(found) == count
    assert found[0].shell.tolist() == RING[:4]


def feature(geometry):
    return {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "geometry": SHAPE}, geometry],
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "no valid JSON: .* line 1 column 2"),
        ("[" * 100_000, "no valid JSON: nested too deeply"),
        ([], r"the file must be an object of type FeatureCollection, .* got \[\]"),
        ({"type": "Topology"}, "got 'Topology'"),
        ({"type": ["Polygon"]}, "the file must be an object of type"),
        ({"type": "Polygon"}, "coordinates must be a list, got None"),
        ({"type": "Polygon", "coordinates": []}, "coordinates must be a list of rings"),
        ({"type": "Polygon", "coordinates": [3]}, r"coordinates\[0\] must be a list of positions"),
        ({"type": "Polygon", "coordinates": RING}, r"coordinates\[0\] must be a list of positions"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1], [2, 2]]]}, r"coordinates\[0\] must be"),
        ({"type": "Polygon", "coordinates": [[[0, 0], ["1", 0], [2, 2]]]}, r"coordinates\[1, 0\] must"),
        ({"type": "Polygon", "coordinates": [RING, RING[:3]]}, r"coordinates.holes\[0\] must|do not"),
        (feature({"type": "Point", "coordinates": [0, 0]}), r"features\[1\] must be an object of type"),
        (feature({"type": "Feature", "geometry": None}), r"features\[1\]\.geometry must be an object"),
        (
            feature({"type": "MultiPolygon", "coordinates": [[RING], [[[0, 0], [1, 1], [1, 0], [0, 1]]]]}),
            r"features\[1\]\.coordinates\[1\] must be a polygon whose rings do not cross, got Self",
        ),
    ],
)  # fmt: skip
def test_bad_geojson(content, message, tmp_path):
    file = tmp_path / "a.geojson"
    file.write_text(content if isinstance(content, str) else json.dumps(content), "utf-8")
    with pytest.raises(InvalidData, match=message) as caught:
        read_geojson_polygons(file)
    assert str(caught.value).startswith(str(file))


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


def test_a_message_quotes_a_file_only_to_those_who_trust(tmp_path):
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
