"""MovingAI's maps: the optimal length of every scenario, to the last digit that was printed."""

import numpy as np
import pytest
from grid_path.grids import SCENARIOS, as_printed, keeps_the_rules, movingai

import crosstrack as ct
from crosstrack.models import GridPath
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.grid_path.exact import AStar, Dijkstra, JumpPoint

#: Scenarios of each map that are solved in every run of the tests.
SAMPLE = 12


def mismatches(grid, cases, *backends):
    """Return what is not of the length that is known, breaks a rule, or differs among backends."""
    wrong = []
    for start, goal, printed in cases:
        bounds = set()
        for backend in backends:
            answer = backend.run(GridPath(grid, start, goal), Request())
            (path,) = answer.point.paths
            bounds.add(answer.dual_bound)
            cells = grid.cells_of(path)
            length = np.hypot(*np.diff(path, axis=0).T).sum()
            good = (
                (cells[0] == start).all()
                and (cells[-1] == goal).all()
                and keeps_the_rules(grid.blocked, cells)
                and as_printed(length, printed)
                and length == pytest.approx(answer.primal_bound, rel=1e-12)
            )
            if not good:
                wrong.append((backend.name, start, goal, printed, length))
        if len(bounds) > 1:
            wrong.append((start, goal, bounds))
    return wrong


def test_the_digits_that_count():
    assert as_printed(3.41421356, "3.41421") and not as_printed(3.4143, "3.41421")
    assert as_printed(2436.6812, "2436.68") and not as_printed(2436.69, "2436.68")
    assert as_printed(20.0, "20") and not as_printed(20.4142, "20")
    assert as_printed(64.3137085, "64.31370850") and not as_printed(64.313709, "64.31370850")


@pytest.mark.parametrize("name", SCENARIOS)
def test_some_scenarios(name):
    """Some of each map, the last and hardest included, and one of them verified."""
    grid, cases = movingai(name)
    some = [*cases[:: len(cases) // SAMPLE], cases[-1]]
    assert mismatches(grid, some, AStar(), JumpPoint()) == []
    assert mismatches(grid, some[::5], AStar(), Dijkstra()) == []
    start, goal, printed = cases[len(cases) // 2]
    solution = ct.solve(GridPath(grid, start, goal))
    assert solution.termination == "optimal"
    assert solution.verification.ok
    assert as_printed(solution.primal_bound, printed)


@pytest.mark.slow
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", SCENARIOS)
def test_all_scenarios(name):
    grid, cases = movingai(name)
    assert len(cases) >= 160
    assert mismatches(grid, cases, AStar(), Dijkstra(), JumpPoint()) == []
