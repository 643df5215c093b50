"""Exact native backends that are stopped return the best plan known, with a bound that holds."""

from __future__ import annotations

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.instances import (
    error_correction,
    grid_path,
    guided_path,
    resource_routing,
    sequential_ordering,
)
from crosstrack.models import FleetRouting, GridPath, GuidedPathTour, MinimumDerivative
from crosstrack.solvers import Control, Guarantee, Limit
from crosstrack.solvers.contract import registry


def fleet():
    return FleetRouting(3, points=np.random.default_rng(3).random((12, 2)), objective="max")


def loaded():
    rng = np.random.default_rng(3)
    demands = [0, *rng.integers(1, 9, 11).tolist()]
    return FleetRouting(
        3, points=rng.random((12, 2)), objective="sum", demands=demands, capacity=22
    )


def corrected():
    return error_correction.generate(150, 150, (20, 10, 15, 20, 20), seed=0)


def resources():
    return resource_routing.generate_network(12, 0)


def guided():
    return guided_path.generate(5, 30, 0)


def carrying():
    chains = guided_path.generate(20, 5, 0)
    loads = np.zeros(len(chains.coordinates))
    for chain in chains.chains:
        loads[list(chain)] = [1, -1, 1, 0, -1]
    return GuidedPathTour(chains.coordinates, chains=chains.chains, loads=loads, capacity=3.0)


def ordered():
    return sequential_ordering.generate_ordering(40, 1000, 15, seed=0)


def rooms(connectivity):
    grid = grid_path.rooms(220, 220, 0)
    free = np.argwhere(~grid.blocked)
    return GridPath(grid, free[0], [free[-1]], connectivity=connectivity)


def knots():
    return MinimumDerivative([[0.0], [1.0], [-1.0], [2.0]], [0.0, 1.0, 2.5, 3.0])


#: Each exact native backend: a model, and whether a heuristic has a plan before the exact search ends.
CASES = {
    ("error_correction", "label-setting"): (corrected, True),
    ("error_correction", "two-stage"): (corrected, False),
    ("error_correction", "pulse"): (corrected, True),
    ("error_correction", "dynamic-programming"): (corrected, True),
    ("fleet", "column-generation"): (loaded, True),
    ("fleet", "subset-dp"): (fleet, True),
    ("grid_path", "a-star"): (lambda: rooms("4"), True),
    ("grid_path", "dijkstra"): (lambda: rooms("4"), True),
    ("grid_path", "jump-point"): (lambda: rooms("8"), True),
    ("grid_path", "any-angle"): (lambda: rooms("any"), True),
    ("guided_path", "a-star"): (guided, True),
    ("guided_path", "dynamic-programming"): (guided, True),
    ("guided_path", "track-search"): (carrying, True),
    ("minimum_snap", "banded"): (knots, False),
    ("minimum_snap", "interior-point"): (knots, False),
    ("resource_routing", "resource-labelling"): (resources, True),
    ("sequential_ordering", "bounded-levels"): (ordered, True),
}
#: Seconds for runs without a proof.
LONG = {("guided_path", "track-search"): 0.5, ("sequential_ordering", "bounded-levels"): 3.0}
#: The reference of unknown maps sees hidden data, so that no heuristic may begin it.
WITHOUT = {("unknown_grid", "oracle")}


def solve_until_a_plan(monkeypatch, model, name):
    """Return the answer of a run that is stopped as soon as a plan is reported."""
    if (
        name == "column-generation"
    ):  # runs in another process if a library that clashes with HiGHS is loaded
        return ct.solve(model, name, time_limit=60.0, target=1e300)
    report = Control.incumbent

    def report_and_stop(self, *arguments, **keywords):
        report(self, *arguments, **keywords)
        self.stop(Limit.TIME)

    with monkeypatch.context() as patch:
        patch.setattr(Control, "incumbent", report_and_stop)
        return ct.solve(model, name, time_limit=60.0)


@pytest.mark.parametrize("case", CASES, ids="/".join)
def test_a_stopped_run_returns_the_plan_of_its_heuristic(case, monkeypatch):
    build, has_start = CASES[case]
    model = build()
    if case == ("guided_path", "dynamic-programming"):
        best = ct.solve(model, "a-star", time_limit=10.0)
    else:
        best = ct.solve(model, case[1], time_limit=LONG.get(case))
    found = solve_until_a_plan(monkeypatch, model, case[1])
    assert found.termination in ("feasible", "optimal")
    if has_start:
        assert found.termination == "feasible"
        assert found.limit in (Limit.TIME, Limit.TARGET)
    assert found.verified and not found.verification.within_tolerance
    if best.dual_bound is not None:  # a short run on a busy machine may have none
        assert found.primal_bound >= best.dual_bound * (1 - 1e-9)
    if found.dual_bound is not None and best.primal_bound is not None:
        assert found.dual_bound <= best.primal_bound * (1 + 1e-9)


@pytest.mark.sample(2)
@pytest.mark.parametrize("seconds", [0.05, 0.3])
@pytest.mark.parametrize("case", [case for case, one in CASES.items() if one[1]], ids="/".join)
def test_bounds_hold_at_short_time_limits(case, seconds):
    model = CASES[case][0]()
    found = ct.solve(model, case[1], time_limit=seconds)
    assert found.termination in ("no_solution", "feasible", "optimal")
    if found.plan is not None and found.dual_bound is not None:
        assert found.dual_bound <= found.primal_bound * (1 + 1e-9)


def test_the_cases_are_all_exact_native_backends():
    native = [one.load() for one in registry.declarations() if one.problem]
    exact = {
        (one.problem, one.name)
        for one in native
        if one.guarantee is Guarantee.EXACT and registry.is_ours(one)
    }
    assert exact == {*CASES, *WITHOUT}
