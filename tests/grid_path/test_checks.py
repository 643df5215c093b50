from __future__ import annotations

import pytest

from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridPlan


@pytest.mark.parametrize(
    "path",
    [
        [[0.5, 1.5], [1, 2], [5, 2], [5.5, 1.5]],  # between two rows of the wall
        [[0.5, 1.5], [1, 2], [3, 2], [3, 1], [3.5, 0.5]],  # and out between two of its columns
    ],
)
def test_a_path_between_blocked_cells_side_by_side_is_found(path):
    lines = ["......", ".@@@@.", ".@@@@.", "......"]
    goal = [int(path[-1][1]), int(path[-1][0])]
    model = GridPath({"blocked": lines}, (1, 0), goal, connectivity="any")
    checked = model.verify(GridPlan((path,)))
    assert [check.name for check in checked.violated] == ["keeps to free cells"]


def test_a_path_along_the_edge_of_the_map_beside_a_blocked_cell_is_found():
    model = GridPath({"blocked": [".@.", "..."]}, (0, 0), (0, 2), connectivity="any")
    along = GridPlan(([[0.5, 0.5], [1, 0], [2, 0], [2.5, 0.5]],))
    around = GridPlan(([[0.5, 0.5], [1, 1], [2, 1], [2.5, 0.5]],))
    assert not model.verify(along).ok
    assert model.verify(around).ok


@pytest.mark.parametrize("cell", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("blocked", [(0, 1), (1, 0)])
def test_a_diagonal_step_beside_a_blocked_cell_is_found(cell, blocked):
    """Both cells beside the corner must be free, whichever of them is blocked."""
    rows = [["." for _ in range(3)] for _ in range(3)]
    free = {
        "map": {"blocked": ["".join(row) for row in rows], "cell": cell},
        "start": (0, 0),
        "goals": (1, 1),
    }
    rows[blocked[0]][blocked[1]] = "@"
    cut = {**free, "map": {"blocked": ["".join(row) for row in rows], "cell": cell}}
    centre = [[0.5 * cell, 0.5 * cell], [1.5 * cell, 1.5 * cell]]
    assert GridPath(**free, connectivity="8").verify(GridPlan((centre,))).ok
    found = GridPath(**cut, connectivity="8").verify(GridPlan((centre,)))
    assert "steps to neighbours" in [check.name for check in found.violated]
    four = GridPath(**free, connectivity="4").verify(GridPlan((centre,)))
    assert "steps to neighbours" in [check.name for check in four.violated]
