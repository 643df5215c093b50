"""Files of sequential ordering: TSPLIB and SOPLIB, damaged files, exports."""

from pathlib import Path

import numpy as np
import pytest
from sequential_ordering.enumerated import random_problem

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import export_plan
from crosstrack.instances.sequential_ordering import (
    generate_ordering,
    read_ordering,
    write_ordering,
)
from crosstrack.models import SequentialOrdering

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "sop"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public instances lie in ../shared/data/sop, which is absent"
)
#: Optima of TSPLIB's list of best known values.
OPTIMA = {"ESC07": 2125, "ESC12": 1675, "br17.10": 55, "br17.12": 55}
SOP = """NAME: tiny
TYPE: SOP
DIMENSION: 4
EDGE_WEIGHT_TYPE: EXPLICIT
EDGE_WEIGHT_FORMAT: FULL_MATRIX
EDGE_WEIGHT_SECTION
4
 0  2  6 1000000
-1  0  7  2
-1 -1  0 1000000
-1 -1 -1  0
EOF
"""
#: All nodes are connected.
WHOLE = SOP.replace("1000000\n-1 -1 -1", "3\n-1 -1 -1")


def written(tmp_path, text):
    path = tmp_path / "tiny.sop"
    path.write_text(text, "utf-8")
    return path


def test_a_file_is_a_model(tmp_path):
    model = ct.load(written(tmp_path, WHOLE))
    assert (model.kind, model.name) == ("sequential-ordering", "tiny")
    assert model.precedence.tolist() == [[1, 2]]
    assert model.distances.tolist()[0] == [0, 2, 6, np.inf]
    lacks = read_ordering(written(tmp_path, SOP))
    bare = read_ordering(written(tmp_path, SOP.replace("SECTION\n4\n", "SECTION\n")))
    assert bare.digest == lacks.digest
    rows = SOP.split("SECTION\n4\n")[1].replace("EOF\n", "\n")  # as in SOPLIB
    assert ct.load(written(tmp_path, rows)).digest == lacks.digest
    with pytest.raises(InvalidData, match="must hold 4 × 4 numbers, got 15"):
        ct.load(written(tmp_path, rows.replace(" 7 ", " ")))
    assert np.isinf(lacks.distances[2, 3])
    assert ct.solve(lacks).termination == "infeasible"
    larger = read_ordering(written(tmp_path, SOP.replace(" 0  2  6", " 0  2 1000001")))
    assert larger.distances[2, 3] == 1_000_000  # not the largest entry


def test_a_line_is_a_guided_path_unless_requested(tmp_path):
    from crosstrack.instances.guided_path import generate, write_sop

    path = write_sop(generate(3, 3, 1), tmp_path / "line.sop")
    assert ct.load(path).kind == "guided-path-tour"
    model = ct.load(path, model="sequential-ordering")
    assert model.kind == "sequential-ordering"
    assert ct.solve(model).primal_bound == ct.solve(ct.load(path)).primal_bound


def test_models_travel_through_files(tmp_path):
    path = tmp_path / "a.sop"
    for seed in range(40):
        model = random_problem(seed)
        if model.distances.max(initial=0.0, where=np.isfinite(model.distances)) > 9e5:
            continue
        again = read_ordering(write_ordering(model, path))
        assert (again.closure == model.closure).all()
        assert (again.arcs == model.arcs).all()
        assert (again.distances[again.arcs] == model.distances[model.arcs]).all()
        twice = read_ordering(write_ordering(again, path))
        assert twice.digest == again.digest
    good = SequentialOrdering([[0, 2e6, 5], [1, 0, 1], [1, 1, 0]])
    assert (read_ordering(write_ordering(good, path)).arcs == good.arcs).all()
    for distances in ([[0, 1e6, 1], [1, 0, 1], [1, 1, 0]], [[0, 2e6, None], [1, 0, 1], [1, 1, 0]]):
        with pytest.raises(InvalidData, match="below 1000000"):
            write_ordering(SequentialOrdering(distances), path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("TYPE: SOP", "TYPE: TSP", "TYPE must be SOP"),
        ("DIMENSION: 4", "DIMENSION: 5", "must hold 5 × 5 numbers, got 17"),
        ("DIMENSION: 4", "DIMENSION: 4000", "DIMENSION must be a whole number from 2 to 3000"),
        ("0  7  2", "0  seven  2", "must hold finite numbers, got 'seven'"),
        ("0  7  2", "0  nan  2", "must hold finite numbers"),
        ("0  7  2", "0  7", "must hold 4 × 4 numbers, got 15"),
        ("0  7  2", "0 -7  2", "entry 2, 3 must be a distance or -1, got -7"),
        ("0  7  2", "0 -1  2", "nodes 2 and 3 each precede the other"),
        (" 0  2  6", " 0 -1  6", "node 1 must come first"),
        ("0  7  2", "0  7 -1", "node 4 last"),
        (SOP[40:], "", "has no keyword"),
    ],
)
def test_damaged_files_are_refused_by_name(tmp_path, old, new, message):
    path = written(tmp_path, SOP.replace(old, new, 1))
    with pytest.raises(InvalidData, match=message) as raised:
        read_ordering(path)
    assert str(path) in str(raised.value)
    with pytest.raises(InvalidData, match="tiny"):
        ct.load(path)


@needs_public
def test_public_files_have_their_published_optima():
    paths = sorted(PUBLIC.glob("*.sop"))
    assert len(paths) == 6
    for path in paths:
        model = ct.load(path)
        assert model.kind == "sequential-ordering"
        if path.stem in OPTIMA:
            found = ct.solve(model)
            assert (found.termination, found.primal_bound) == ("optimal", OPTIMA[path.stem])


def test_exports(tmp_path):
    model = generate_ordering(6, 9, 30, 1)
    found = ct.solve(model)
    export_plan(model, found.plan, tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "stop,node,distance,length"
    assert float(lines[-1].split(",")[-1]) == found.primal_bound
    export_plan(model, found.plan, tmp_path / "a.tour", "tsplib")
    words = (tmp_path / "a.tour").read_text().split("TOUR_SECTION\n")[1].split()
    assert words == [*(str(node + 1) for node in found.plan.order), "-1", "EOF"]


def test_an_instance_refers_to_a_file(tmp_path):
    written(tmp_path, WHOLE)
    content = '{"model": "sequential-ordering", "data": {"sop": "tiny.sop"}}'
    (tmp_path / "a.json").write_text(content)
    assert ct.load(tmp_path / "a.json").size == 4


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((1, 9, 5, 0), "nodes"), ((5, -1, 5, 0), "largest"), ((5, 9, 101, 0), "percentage"),
        ((5, 9, 5, -1), "seed"),
    ],
)  # fmt: skip
def test_the_generator_names_wrong_values(values, message):
    with pytest.raises(InvalidData, match=message):
        generate_ordering(*values)
