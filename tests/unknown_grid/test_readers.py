"""Scenes and runs on unknown grids in files."""

import csv
import json

import numpy as np
import pytest
from grid_path.grids import movingai

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import export_formats, export_plan
from crosstrack.instances.unknown_grid import read_map_scenes, read_scenes
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns

TEXT = """
S.#..
..#.T

.@.S.
TO.W.


.....
G.S.T
"""


def test_drawings_in_a_file(tmp_path):
    file = tmp_path / "three.txt"
    file.write_text(TEXT.replace("\n", "\r\n"), "utf-8")
    model = read_scenes(file, view=(3, 3), steps=9)
    drawings = [block.replace("G", ".") for block in TEXT.strip().split("\n\n")]
    wanted = UnknownGridNavigation.drawn(
        *[one.strip().translate(str.maketrans("OW", "@@")) for one in drawings],
        view=(3, 3),
        steps=9,
    )
    assert model.digest == wanted.digest
    assert model.scenes == 3
    instance = tmp_path / "three.json"
    data = {"scenes": "three.txt", "view": [3, 3], "steps": 9}
    instance.write_text(json.dumps({"model": "unknown-grid", "data": data}), "utf-8")
    assert ct.load(instance).digest == model.digest
    for wrong, message in (
        ({"starts": [[0, 0]]}, "starts must not be given"),
        ({"scenes": 3}, "scenes must name a file, got 3"),
    ):
        instance.write_text(
            json.dumps({"model": "unknown-grid", "data": {**data, **wrong}}), "utf-8"
        )
        with pytest.raises(InvalidData, match=message):
            ct.load(instance)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must hold at least one drawing"),
        ("\n  \n", "must hold at least one drawing"),
        ("S.T\n.x.\n", "line 2, column 2 must be one of"),
        ("\nS.T\n..\n", "line 3 must have 3 cells as the first, got 2"),
        ("S.T\n\nS..T\n", "line 3: .* must have 1 × 3 cells as the first, got 1 × 4"),
        ("S.T\n\n\n...\n..T\n", r"line 4: .* must have one S \(start\), got none"),
        ("S..\n...", r"line 1: .* must have one T \(target\), got none"),
        ("S.T\n.S.", r"one S \(start\), got a second S in line 2, column 2"),
        ("S.T\n\nT.S\n..T", r"line 3: .* got a second T in line 4, column 3"),
    ],
)
def test_bad_drawings(tmp_path, text, message):
    file = tmp_path / "bad.txt"
    file.write_text(text, "utf-8")
    with pytest.raises(InvalidData, match=rf"bad\.txt.*{message}"):
        read_scenes(file, view=(1, 1))


def test_drawings_that_are_none(tmp_path):
    with pytest.raises(InvalidData, match="no such file"):
        read_scenes(tmp_path / "none.txt")
    with pytest.raises(InvalidData, match="path must name a file"):
        read_scenes(None)
    (tmp_path / "image.txt").write_bytes(bytes(range(128, 256)))
    with pytest.raises(InvalidData, match="no UTF-8"):
        read_scenes(tmp_path / "image.txt")


def test_maps_of_movingai(tmp_path):
    grid, cases = movingai("maze-32-32-2")
    file = tmp_path / "maze.map"
    lines = grid.data()["blocked"]
    file.write_text("\n".join(["type octile", "height 32", "width 32", "map", *lines]), "utf-8")
    ends = np.array([case[:2] for case in cases[:3]])
    model = read_map_scenes(file, ends[:, 0], ends[:, 1], view=(9, 9), steps=500)
    assert model.scenes == 3
    assert (model.blocked == grid.blocked).all()
    assert (model.fewest_steps() >= [float(case[2]) for case in cases[:3]]).all()
    with pytest.raises(InvalidData, match="starts"):
        read_map_scenes(file, ends[0, 0], ends[0, 1])
    with pytest.raises(InvalidData, match="targets"):
        read_map_scenes(file, ends[:, 0], ends[:2, 1])
    wall = np.argwhere(grid.blocked)[:1]
    with pytest.raises(InvalidData, match=r"starts\[0\] must be a free cell"):
        read_map_scenes(file, wall, ends[:1, 1])
    file.write_text("type octile\nheight 1\nwidth 2\nmap\n.x\n", "utf-8")
    with pytest.raises(InvalidData, match=r"maze\.map, line 5, column 2"):
        read_map_scenes(file, [[0, 0]], [[0, 1]])


def test_runs_as_a_table(tmp_path):
    model = UnknownGridNavigation.drawn(["S#T", "..."], ["S.T", "..."], view=(3, 3))
    plan = NavigationRuns(("RDRRU", ""), ("reached", "gave up"))
    assert list(export_formats(model)) == ["csv"]
    export_plan(model, plan, tmp_path / "runs.csv")
    with (tmp_path / "runs.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["scene", "step", "action", "row", "column", "collided"]
    assert rows[1:] == [
        ["0", "0", "", "0", "0", "0"],
        ["0", "1", "R", "0", "0", "1"],
        ["0", "2", "D", "1", "0", "0"],
        ["0", "3", "R", "1", "1", "0"],
        ["0", "4", "R", "1", "2", "0"],
        ["0", "5", "U", "0", "2", "0"],
        ["1", "0", "", "0", "0", "0"],
    ]
    one = NavigationRuns(("R",), ("gave up",))
    with pytest.raises(InvalidData, match="actions must have 2 entries"):
        export_plan(model, one, tmp_path / "runs.csv")
    with pytest.raises(InvalidData):
        export_plan(model, plan, tmp_path / "nowhere" / "runs.csv")
