"""Ways along neighbours by SciPy, and a mission whose searches on the grid have no time."""

from __future__ import annotations

import numpy as np
import pytest

import crosstrack as ct
from crosstrack import jit
from crosstrack.models.grid_path import distances
from crosstrack.solvers import Answer, Limit, Termination
from crosstrack.solvers.fleet.fleet_search import FleetSearch
from crosstrack.solvers.fleet_mission import flight, stages
from crosstrack.solvers.fleet_mission.neighbours import NeighbourWays


@pytest.mark.parametrize("name", ["pocket", "nested", "paper"])
def test_ways_along_neighbours_are_shortest(name):
    problem = ct.load(f"fleet-mission/{name}")
    ways = NeighbourWays(problem)
    lengths = distances(problem.map, problem.cells)
    np.testing.assert_allclose(ways.distances(), lengths, rtol=1e-9)
    for goal in range(1, len(lengths)):
        path = ways.path(0, goal)
        steps = np.abs(np.diff(path, axis=0))
        assert steps.max(initial=0.0) <= problem.map.cell * (1 + 1e-9)
        assert np.hypot(*steps.T).sum() == pytest.approx(lengths[0, goal])


def test_a_mission_without_time_for_paths_and_curves_has_a_plan(monkeypatch):
    def out_of_time(*arguments, **keywords):
        raise jit.OutOfTime

    monkeypatch.setattr(stages.Stages, "path", out_of_time)
    monkeypatch.setattr(flight, "programmed", out_of_time)
    solution = ct.solve(
        ct.load("fleet-mission/pocket"), "staged", time_limit=60,
        backend_options={"trajectories": "interior-point"},
    )  # fmt: skip
    assert solution.plan is not None and solution.verification.ok
    assert solution.statistics["robots that rest at knots"] == len(solution.plan.routes)


def test_a_mission_without_time_for_routes_has_a_plan(monkeypatch):
    monkeypatch.setattr(
        FleetSearch, "run", lambda *given: Answer(Termination.NO_SOLUTION, Limit.TIME)
    )
    solution = ct.solve(ct.load("fleet-mission/pocket"), "staged", time_limit=60)
    assert solution.plan is not None and solution.verification.ok
