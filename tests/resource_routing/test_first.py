"""A first route without compiled loops: it is feasible, and a run without time to compile returns it."""

from __future__ import annotations

import pytest

import crosstrack as ct
from crosstrack import jit
from crosstrack.instances.resource_routing import generate_electric, generate_network
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.error_correction.label_setting import LabelSetting
from crosstrack.solvers.resource_routing import labelling
from crosstrack.solvers.resource_routing.first import first_route, route_in_time


@pytest.mark.parametrize("seed", range(3))
def test_a_first_route_is_feasible(seed):
    for model in (generate_network(8, seed), generate_electric(40, seed)):
        route = first_route(model)
        if route is not None:
            assert model.verify(route).ok


@pytest.mark.parametrize(
    "name", ["resource-routing/electric-200", "resource-routing/network-20", "error-correction/12"]
)
def test_large_instances_have_a_first_route_within_a_tenth(name):
    model = ct.load(name)
    route = first_route(model.lower() or model)
    assert model.verify(route).objective <= 1.1 * ct.solve(model).primal_bound


def test_a_stopped_search_returns_no_route():
    assert first_route(generate_network(8, 0), lambda: True) is None


def _out_of_time(*arguments, **keywords):
    raise jit.OutOfTime


def test_a_run_without_time_to_compile_returns_the_first_route(monkeypatch):
    model = ct.load("resource-routing/electric-200")
    monkeypatch.setattr(labelling, "_under", _out_of_time)
    solution = ct.solve(model, "resource-labelling", time_limit=60)
    assert solution.termination == "feasible" and solution.plan == first_route(model)


def test_label_setting_without_a_starter_returns_the_first_route(monkeypatch):
    model = ct.load("error-correction/7")
    monkeypatch.setattr(LabelSetting, "starter", lambda self, problem: "")
    monkeypatch.setattr(LabelSetting, "search", _out_of_time)
    solution = ct.solve(model, "label-setting", time_limit=60)
    assert solution.termination == "feasible" and solution.plan == first_route(model.lower())


def test_few_points_many_pairs_and_runs_without_a_limit_need_no_first_route():
    model = generate_electric(40, 0)
    assert route_in_time(model, Request(time_limit=60.0)) == first_route(model)
    assert route_in_time(model, Request()) is None
    for points in (10, 2100):
        assert route_in_time(generate_electric(points, 0), Request(time_limit=60.0)) is None
