"""Files of SPPRCLIB, PathWyse and the OR-Library: read, proven, and damaged files refused."""

from pathlib import Path

import pytest

import crosstrack as ct
from crosstrack.errors import CrosstrackError, InvalidData, UnsupportedFormulation
from crosstrack.instances.resource_routing import read_rcsp, read_spprclib

FILES = Path(__file__).resolve().parents[3] / "shared" / "data" / "rcsp"
NAME = "resource-labelling"
#: Optima that HiGHS proves, too, except for A-n54-k7-149.
OPTIMA = {
    "rcsp1.txt": 131, "rcsp3.txt": 2, "rcsp7.txt": 6, "rcsp11.txt": 6, "rcsp15.txt": 9, "rcsp21.txt": 858,
    "toy.txt": -10435, "A-n54-k7-149.sppcc": -12492,
}  # fmt: skip


@pytest.mark.skipif(not FILES.exists(), reason="the public files are not beside the project")
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * name.startswith("A-n54")) for name in OPTIMA],
)
def test_public_files_are_proven(name):
    model = ct.load(str(FILES / name))
    found = ct.solve(model, NAME)
    assert found.termination == "optimal"
    assert found.primal_bound == found.dual_bound == OPTIMA[name]


TEXT = """NAME : small
SIZE : 3
DIRECTED : {directed}
RESOURCES : 2
RES_NAMES : 0 1
RES_TYPE
0 CAP
1 TW
END
RES_BOUND
0 {least} 9
END
RES_NODE_BOUND
1 1 4 6
1 2 0 20
END
EDGE_COST
0 0 0
0 1 1
0 2 9
1 2 2
2 0 3
1 0 8
END
EDGE_CONSUMPTION
1 0 1 1
1 1 2 2
END
NODE_COST
0 -1
1 -5
END
NODE_CONSUMPTION
0 1 4
0 2 4
1 1 7
END
"""


def read(tmp_path, text, **fields):
    path = tmp_path / "small.sppcc"
    path.write_text(text)
    return read_spprclib(path, **fields)


def test_windows_service_and_the_copy_of_the_origin(tmp_path):
    model = read(tmp_path, TEXT.format(directed=1, least=0))
    assert (model.start, model.end, len(model.kinds), len(model.arcs)) == (0, 3, 4, 5)
    found = ct.solve(model, NAME)
    assert found.plan.route == (0, 1, 2, 3) and found.primal_bound == 1 + 2 + 3 - 5 - 1
    rows = model.details(found.plan)
    # Wait until 4, serve for 7, travel for 2.
    assert [row["resource 1"] for row in rows][:3] == [0, 1, 13]
    assert rows[2]["resource 0"] == 8


@pytest.mark.parametrize("backend", [NAME, "highs"])
def test_files_whose_lengths_are_not_negative_are_read(tmp_path, backend):
    text = TEXT.replace("NODE_COST\n0 -1\n1 -5\nEND\n", "").format(directed=1, least=0)
    found = ct.solve(read(tmp_path, text), backend)
    assert found.termination == "optimal"
    assert found.plan.route == (0, 1, 2, 3) and found.primal_bound == 1 + 2 + 3


def test_edges_of_undirected_files_lead_both_ways(tmp_path):
    text = TEXT.replace("2 0 3\n1 0 8\n", "").format(directed=0, least=0)
    assert len(read(tmp_path, text).arcs) == 6


def test_lower_bounds_apply_to_the_whole_path(tmp_path):
    model = read(tmp_path, TEXT.format(directed=1, least=9))
    assert ct.solve(model, NAME).termination == "infeasible"


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("SIZE : 3", "SIZE : 3.5", InvalidData), ("SIZE : 3", "", InvalidData),
        ("0 1 1\n", "0 7 1\n", InvalidData), ("0 1 1\n", "0 1\n", InvalidData),
        ("0 1 1\n", "0 x 1\n", InvalidData), ("1 TW", "1 PDP", UnsupportedFormulation),
        ("EDGE_CONSUMPTION", "ARC_DATA", UnsupportedFormulation),
        ("RESOURCES : 2", "RESOURCES : 3", InvalidData), ("SIZE : 3", "SIZE : 3\nCYCLIC : 2", InvalidData),
        ("1 2 2\n", "1 2 2\n1 2 3\n", InvalidData), ("1 1 7\n", "1 1 7\n2 1 7\n", InvalidData),
        ("1 1 4 6", "1 1 7 6", InvalidData), ("0 {least} 9", "0 10 9", InvalidData),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path, old, new, error):
    with pytest.raises(error):
        read(tmp_path, TEXT.replace(old, new).format(directed=1, least=0))


def test_lower_limits_of_the_or_library(tmp_path):
    path = tmp_path / "small.txt"
    path.write_text("3 3 1\n4\n9\n0 0 0\n1 3 1 1\n1 2 2 2\n2 3 2 2\n")
    found = ct.solve(read_rcsp(path), NAME)
    assert found.plan.route == (0, 1, 2) and found.primal_bound == 4
    path.write_text("2 2 1\n4\n9\n0 0\n1 2 1 1\n1 2 2 5\n")
    with pytest.raises(CrosstrackError, match="two arcs join"):
        read_rcsp(path)


@pytest.mark.parametrize("row", ["1 3 -1 1", "1 1 1 -1", "1 3 1 -1"])
def test_negative_numbers_of_the_or_library_are_refused(tmp_path, row):
    path = tmp_path / "small.txt"
    path.write_text(f"3 3 1\n0\n9\n0 0 0\n{row}\n1 2 2 2\n2 3 2 2\n")
    with pytest.raises(InvalidData, match="line 5: must be numbers >= 0, got -1"):
        read_rcsp(path)


def test_only_time_windows_wait(tmp_path):
    """A lower bound at a node is the opening of a window, but a lower limit of a capacity."""
    text = (
        "SIZE: 3\nORIGIN: 0\nDESTINATION: 2\nRES_TYPE\n0 {}\nEND\nRES_BOUND\n0 0 9\nEND\n"
        "RES_NODE_BOUND\n0 1 4 9\nEND\nEDGE_COST\n0 1 1\n1 2 1\n0 2 5\nEND\n"
        "NODE_CONSUMPTION\n0 1 2\nEND\n"
    )
    for word, route in (("CAP", (0, 2)), ("TW", (0, 1, 2))):
        file = tmp_path / f"{word}.sppcc"
        file.write_text(text.format(word))
        assert ct.solve(read_spprclib(file), "resource-labelling").plan.route == route
