"""Flow program of a path, and diagnosis of unreachable goals."""

import numpy as np
import pytest
from grid_path.grids import costs, optimum, serpentine, small
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap, GridPlan


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_a_linear_program_agrees(seed):
    model = small(seed)
    best = optimum(model)
    solution = ct.solve(model, "highs", formulation="flow")
    if np.isinf(best):
        assert solution.termination == "infeasible", solution
        return
    assert solution.termination == "optimal", solution
    assert solution.verification.ok, solution.summary()
    assert solution.primal_bound == pytest.approx(best, rel=1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_plans_fit_the_program(seed):
    """Every exact plan encodes to a feasible point of equal cost, and decodes to an equally good plan."""
    model = small(seed)
    solution = ct.solve(model, "dijkstra")
    if solution.plan is None:
        return
    written = model.formulate("flow")
    point = written.encode(solution.plan)
    rows = written.program.verify(point)
    assert rows.ok, rows
    assert rows.objective == pytest.approx(solution.primal_bound, rel=1e-9, abs=1e-12)
    again = model.verify(written.decode(point))
    assert again.ok, again
    assert again.objective == pytest.approx(solution.primal_bound, rel=1e-9, abs=1e-12)


def test_a_walk_that_comes_back_fits_too():
    """Decoding removes circular flow."""
    model = GridPath(GridMap(["...", "..."]), (0, 0), (0, 2), connectivity="4")
    walk = [(0, 0), (0, 1), (1, 1), (1, 0), (0, 0), (0, 1), (0, 2)]
    plan = GridPlan((model.map.centres(walk),))
    assert model.verify(plan).ok
    written = model.formulate("flow")
    point = written.encode(plan)
    rows = written.program.verify(point)
    assert rows.ok and rows.objective == 6
    assert model.verify(written.decode(point)).objective == 2


def test_ties_that_a_point_mixes():
    """Half a unit on each of two equal paths is optimal, and decodes to one of them."""
    model = GridPath(GridMap(["..", ".."]), (0, 0), (1, 1), connectivity="4")
    written = model.formulate("flow")
    ways = [[(0, 0), (0, 1), (1, 1)], [(0, 0), (1, 0), (1, 1)]]
    point = sum(written.encode(GridPlan((model.map.centres(way),))) for way in ways) / 2
    assert written.program.verify(point).ok
    plan = written.decode(point)
    assert model.verify(plan).ok
    assert model.map.cells_of(plan.paths[0]).tolist() in [list(map(list, way)) for way in ways]


def test_a_corridor_to_and_fro():
    model = GridPath(GridMap(serpentine(21)), (0, 0), [(20, 20), (12, 7)], reach="each")
    for name in ("a-star", "jump-point", "highs"):
        solution = ct.solve(model, name)
        assert solution.termination == "optimal"
        assert solution.primal_bound == pytest.approx(costs(model).sum(), rel=1e-9)


def test_program_rejects_unsupported_models():
    large = GridMap(np.zeros((200, 101), bool))
    with pytest.raises(UnsupportedFormulation, match="20000 free cells, the map has 20200"):
        GridPath(large, (0, 0), (1, 1)).formulate("flow")
    with pytest.raises(UnsupportedFormulation, match="'any'"):
        GridPath(GridMap([".."]), (0, 0), (0, 1), connectivity="any").formulate("flow")


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ([(0, 0), (0, 2)], "step 0 is to no neighbour"),
        ([(0, 0), (1, 0)], "leaves the free cells"),
        ([(0, 0), (0, 1)], "ends at no goal"),
        ([(0, 0), (0, 1), (1, 2)], "step 1 is to no neighbour"),  # cuts a corner
    ],
)
def test_plans_that_have_no_point(path, words):
    model = GridPath(GridMap(["...", "@@."]), (0, 0), [(0, 2), (1, 2)])
    with pytest.raises(InvalidData, match=words):
        model.formulate("flow").encode(GridPlan((model.map.centres(path),)))


def test_points_that_are_no_plan():
    model = GridPath(GridMap(["..."]), (0, 0), (0, 2))
    written = model.formulate("flow")
    with pytest.raises(InvalidData, match="5 entries, got 3"):
        written.decode(np.zeros(3))
    with pytest.raises(InvalidData, match="do not lead to a goal"):
        written.decode(np.zeros(5))


def test_diagnosis_names_unreachable_goals():
    model = GridPath(
        GridMap([".@..", "@@..", "...@"], cell=2.0), (0, 0), [(0, 0), (0, 3), (2, 0)], reach="each"
    )
    found = ct.diagnose(model)
    assert found.feasible is False
    assert "2 of 3 goals cannot be reached" in found.summary
    assert "1 of 8 free cells" in found.summary
    first, second = found.findings
    assert (first.data["goal"], first.data["nearest"], first.data["distance"]) == (2, [0, 0], 4.0)
    assert (second.data["goal"], second.data["distance"]) == (1, 6.0)
    assert "goals[1] at row 0, column 3" in second.text
    assert ct.diagnose(GridPath(model.map, (0, 0), model.goals)).feasible is True
    assert ct.diagnose(GridPath(model.map, (0, 2), (2, 0))).feasible is True


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_diagnosis_is_right(seed):
    model = small(seed)
    found = ct.diagnose(model)
    far = costs(model)
    assert found.feasible == np.isfinite(optimum(model))
    if not found.feasible:
        named = {one.data["goal"] for one in found.findings}
        assert named == set(np.flatnonzero(np.isinf(far)).tolist())
