"""Algorithms 2 and 4 of the paper, worked by hand."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap
from crosstrack.models.grid_path.search_kernels import STRAIGHT, ahead
from crosstrack.solvers.grid_path.smoothing import smooth


def test_algorithm_2_by_hand():
    """A* on three rows: f = g + D of eq. 4 is 2 at the start and 8 after the turn."""
    model = GridPath(GridMap(["....", "@@@.", "...."]), (0, 0), (2, 0), connectivity="4")
    path = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (2, 2), (2, 1), (2, 0)]
    to_goal = [2, 3, 4, 5, 4, 3, 2, 1, 0]
    frame = np.array([3, 3, 1, 1])  # the goal, as rows and columns of the framed map
    assert [ahead(r + 1, c + 1, frame, False) / STRAIGHT for r, c in path] == to_goal
    found = ct.solve(model, "a-star")
    assert model.map.cells_of(found.plan.paths[0]).tolist() == [list(cell) for cell in path]
    assert found.primal_bound == 8.0


def test_algorithm_4_by_hand():
    """From the first point, the lines to points 7 and 6 meet the blocked cell, that to 5 passes it.

    The line from (0.5, 1.5) to (4.5, 0.5) is at y = 0.875 where the cell begins, x = 3, and falls; the
    cell begins at y = 1. From point 5 the last point is in sight.
    """
    grid = GridMap(["......", "...@.."])
    cells = [(1, 0), (1, 1), (0, 1), (0, 2), (0, 3), (0, 4), (1, 4), (1, 5)]
    path = [(column + 0.5, row + 0.5) for row, column in cells]
    found = smooth(grid, path, "greedy")
    assert found.tolist() == [[0.5, 1.5], [4.5, 0.5], [5.5, 1.5]]
    assert np.hypot(*np.diff(found, axis=0).T).sum() == pytest.approx(17**0.5 + 2**0.5)


def test_shortcuts_start_from_four_neighbours_if_asked():
    """Around one cell: along the border with four neighbours, diagonally past it with eight."""
    model = GridPath(GridMap(["....", ".@..", "...."]), (0, 0), (2, 3), connectivity="any")
    lengths = [
        ct.solve(model, "shortcut-greedy", backend_options={"neighbours": number}).primal_bound
        for number in ("4", "8")
    ]
    assert lengths == pytest.approx([3 + 2, 1 + 10**0.5])
