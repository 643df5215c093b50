"""How a run that does not end well ends: at its limit, with the best plan and bound there are."""

import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from brute_force import shortest_length

import crosstrack as ct
from crosstrack.instances.error_correction.generator import random_small
from crosstrack.models import Route
from crosstrack.solvers import Request, Worker
from crosstrack.solvers.conformance.limits import hard_knapsack
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.mip import scip
from crosstrack.solvers.programs.attempts import Clock

FORMULATIONS = ("paper", "arc-flow")


@pytest.mark.parametrize("count", [24, pytest.param(60, marks=pytest.mark.slow)])
def test_a_floor_is_below_every_route_and_above_the_straight_line(count):
    tight = 0
    for seed in range(count):
        model = random_small(4 + seed % 6, seed)
        optimum = shortest_length(model)
        line = np.linalg.norm(model.points[model.end] - model.points[model.start])
        for name in FORMULATIONS:
            formulation = model.formulate(name)
            if optimum is None:
                assert formulation.floor < np.inf
                continue
            for one in (formulation, formulation.bounded(optimum)):
                assert line * (1 - 1e-12) <= one.floor <= optimum * (1 + 1e-12)
            tight += formulation.floor > line * (1 + 1e-9)
        program = model.formulate("paper").program
        assert program.column_lower[
            program.column_block("distance on arrival").start + model.end
        ] == pytest.approx(line)
    assert tight > count / 3


def test_a_model_without_a_path_has_no_floor():
    model = replace(random_small(5, 1), theta=0.0)
    assert not len(model.formulate("arc-flow").arcs)
    assert [model.formulate(name).floor for name in FORMULATIONS] == [-np.inf, -np.inf]


@pytest.mark.parametrize("name", ["highs", "scip", "scipy", "cvxpy", "ortools"])
def test_without_time_the_warm_start_and_the_floor_are_left(name):
    model = ct.load("error-correction/8")
    start = Route((0, 89, 264, 159, 232, 101, 174, 227, 213, 222, 242, 80, 308, 326))
    # Too short for the largest program, so that it ends before any solver has started.
    ended = ct.solve(model, name, formulation="paper", time_limit=1e-3, warm_start=start)
    assert (ended.termination, ended.limit) == ("feasible", "time")
    assert ended.plan == start
    assert "the plan is the warm start" in ended.message
    floor = model.formulate("paper").bounded(ended.primal_bound).floor
    assert ended.dual_bound == pytest.approx(floor, rel=1e-12)
    assert ended.gap < 0.09


@pytest.mark.parametrize("name", ["ortools", "cvxpy"])
def test_a_killed_solver_leaves_its_plan_and_bound(name):
    program = hard_knapsack()
    heard, kinds = [], set()
    with Worker() as worker:

        def kill(event):
            kinds.add(event.kind)
            if event.kind == "incumbent":
                heard.append(event.incumbent.objective)
            if kinds >= {"incumbent", "bound"}:
                os.kill(worker.pid, signal.SIGKILL)

        left = worker.solve(Job(program, name, time_limit=60.0), listener=kill)
    assert left.termination == "feasible"
    assert "SIG" in left.message
    assert left.primal_bound == pytest.approx(min(heard))
    assert left.dual_bound is not None
    assert left.dual_bound <= -38851.0  # the best plan known


def test_scip_builds_no_further_than_its_time_allows():
    import pyscipopt

    class Late(Clock):
        looks = 3

        def left(self):
            self.looks -= 1
            return max(self.looks, 0.0)

    program = ct.load("error-correction/9").formulate("arc-flow").program
    columns, rows = scip._build(pyscipopt.Model(), program, Request(time_limit=1.0), Late(1.0))
    assert 0 < len(columns) <= 2 * scip.LOOK < program.size
    assert rows == []


@pytest.mark.slow
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ["highs", "scip", "cvxpy"])
def test_a_solver_stops_at_its_limit(name, formulation):
    model = ct.load("error-correction/9")
    ct.solve(random_small(5, 0), name)  # the libraries are loaded, a worker stands ready
    for limit in (1.0, 2.0, 5.0):
        begin = time.perf_counter()
        ended = ct.solve(model, name, formulation=formulation, time_limit=limit)
        spent = time.perf_counter() - begin
        assert ended.termination == "optimal" or ended.limit == "time"
        assert spent < limit + 4.0, f"limit {limit:g} s"
        assert ended.dual_bound >= 102932.9


def test_scip_reports_no_bound_while_it_frees_its_tree():
    """That bound is the incumbent's, and would pass for a proof; the optimum is 882."""
    found = ct.solve(ct.load("guided-path/k20-l5"), "scip", time_limit=1.5)
    assert found.dual_bound is None or found.dual_bound <= 882 + 1e-6
    assert found.limit == "time" and found.termination in ("feasible", "no_solution")
