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
