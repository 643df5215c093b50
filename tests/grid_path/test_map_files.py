"""Files of maps, scenarios and polygons, hostile ones too."""

import json
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from crosstrack.errors import BackendMissing, InvalidData
from crosstrack.instances.grid_path import (
    random_polygons,
    read_geojson_polygons,
    read_grid,
    read_image,
    read_map,
    read_scenarios,
    read_text_map,
    write_geojson_polygons,
    write_map,
    write_text_map,
)
from crosstrack.models.grid_path import GridMap, distances

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "movingai"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public maps lie in ../shared/data/movingai, which is absent"
)
LINES = ["..@.", ".@@.", "...."]
HEAD = "type octile\nheight 3\nwidth 4\nmap\n"


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


@pytest.mark.parametrize("suffix", [".pgm", ".png"])
def test_cells_that_no_sensor_has_seen_are_blocked_by_default(suffix, tmp_path):
    """Maps of ROS: 254 is free, 0 occupied and 205 unknown."""
    file = saved(np.array([[254, 205, 0], [254, 204, 206]], np.uint8), tmp_path / f"a{suffix}")
    assert read_image(file).data()["blocked"] == [".@@", "..."]
    assert read_grid(file, unknown="free").data()["blocked"] == ["..@", "..."]
    with pytest.raises(InvalidData, match="unknown must be one of"):
        read_image(file, unknown="maybe")
    unseen = saved(np.full((2, 2), 205, np.uint8), tmp_path / f"b{suffix}")
    with pytest.raises(InvalidData, match="unknown='free'"):
        read_image(unseen)


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
        ({"type": "GeometryCollection", "geometries": [SHAPE, SHAPE]}, 2),
        ({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": part} for part in (SHAPE, None)]}, 1),
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
        (feature({"type": "Feature"}), r"features\[1\]\.geometry must be an object"),
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
