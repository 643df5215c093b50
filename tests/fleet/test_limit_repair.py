"""Repair of plans beyond limits on the lengths."""

import dataclasses

import pytest

from crosstrack.models import FleetRouting
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.fleet import rivals
from crosstrack.solvers.fleet.limit_repair import excess_of, repair
from crosstrack.solvers.fleet.rivals import REPAIRS, Best, FleetHeuristic
from crosstrack.solvers.fleet.whole import COMMON


def windows_fleet(**limits):
    """Return a rich fleet whose shortest plan has one route."""
    points = [[0, 0], [4, 0], [5, 0], [-4, 1], [-5, 0]]
    fields = {"windows": [None, (0, 50), None, None, None], "use_all": False, "objective": "sum"}
    return FleetRouting(2, points=points, **fields, **limits)


@pytest.mark.parametrize("limit", [{"range_limit": 1.5}, {"deviation_limit": 1.0}])
def test_repairs_a_plan_beyond_its_limit(limit):
    model = windows_fleet(**limit)
    routes = [[1, 2, 3, 4], []]
    assert excess_of(model, routes) > 0.0
    repaired = repair(model, routes, 1e-6, 1, 1500, lambda: False)
    assert model.verify(model.with_schedule(repaired)).ok
    assert repair(model, routes, 1e-6, 1, 1500, lambda: True) is None


def test_returns_none_if_another_constraint_is_violated_or_no_plan_is_found():
    model = windows_fleet(range_limit=1.5)
    assert repair(model, [[1, 2, 3], []], 1e-6, 1, 10, lambda: False) is None
    short = dataclasses.replace(model, range_limit=None, budget=1.0)
    assert repair(short, [[1, 2, 3, 4], []], 1e-6, 1, 30, lambda: False) is None


def test_an_offered_plan_beyond_a_limit_becomes_an_incumbent():
    model = windows_fleet(range_limit=1.5)
    best = Best(model, Request())
    for _ in range(2 * REPAIRS):  # a missing node cannot be repaired
        assert not best.offer([[1, 2, 3], []])
    assert best.repairs == 0
    assert best.offer([[1, 2, 3, 4], []])
    assert model.verify(best.plan).ok
    assert best.repairs == 1


class ByObjective(FleetHeuristic):
    """Heuristic with a fixed plan per objective."""

    name = "by-objective"
    rich = COMMON | {"makespan"}
    plans = {"sum": [[1, 2, 3, 4], []], "max": [[1, 2], [3, 4]], "cost": [[], []]}

    def search(self, best, request):
        best.offer(self.plans.get(str(best.problem.objective), [[1], []]))
        return {}


@pytest.mark.parametrize(
    ("fields", "routes"),
    [
        ({"objective": "max", "budget": 20.5}, [[1, 2, 3, 4], []]),
        ({"objective": "sum", "range_limit": 1.5}, [[1, 2], [3, 4]]),
        ({"objective": "makespan"}, [[1, 2, 3, 4], []]),
        ({"objective": "cost", "range_limit": 1.5, "prizes": [None, 1, 1, 1, 1]}, [[], []]),
    ],
)
def test_a_simpler_objective_provides_the_first_plan(monkeypatch, fields, routes):
    monkeypatch.setattr(rivals, "REPAIRS", 0)
    model = dataclasses.replace(windows_fleet(), **fields)
    answer = ByObjective().run(model, Request())
    assert answer.point is not None
    assert [list(route) for route in answer.point.routes] == routes
    assert model.verify(answer.point).ok
