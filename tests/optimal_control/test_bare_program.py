"""The bare program of the benchmarks solves declared problems and returns plans that verify."""

import math
import sys

import numpy as np
import pytest
from benchmarks.optimal_control.bare import plan_of_nodes, solve_bare

import crosstrack as ct
from crosstrack.models import OptimalControlProblem


def test_solves_a_catalogue_problem_and_returns_a_plan_that_verifies():
    problem = ct.load("optimal-control/bryson-denham")
    answer = solve_bare(problem)
    assert answer.success
    assert answer.status == "Solve_Succeeded"
    assert answer.objective == pytest.approx(4.0, rel=1e-5)
    assert answer.iterations > 0
    assert 0.0 < answer.seconds < 30.0
    assert problem.verify(answer.plan).ok


def _two_legs():
    """Return two linked legs of a double integrator, with a parameter, data, integrals and free times."""
    ocp = OptimalControlProblem("two legs")
    legs, ends = [], ((0, (0.5, 3)), ((0.5, 3), (1, 6)))
    limit = ocp.parameter("limit", lower=0.1, upper=5, guess=2.0)
    distance = ocp.data("distance", value=4.0)
    for name, time in zip(("out", "back"), ends, strict=True):
        phase = ocp.phase(name, time=time)
        x = phase.state("x", initial=0 if name == "out" else None)
        v = phase.state("v", final=0, initial=0 if name == "out" else None)
        u = phase.control("u", lower=-3, upper=3)
        phase.dynamics({x: v, v: u})
        phase.path(u - limit, upper=0)
        phase.path(u + limit, lower=0)
        legs.append((phase, x, u))
    (first, x, u), (second, y, w) = legs
    ocp.link(first, second)
    ocp.subject_to(first.final(x) == distance)
    ocp.subject_to(second.final(y) == 0)
    # A leg of distance d at full acceleration a takes 2 sqrt(d / a).
    ocp.minimise(first.end + second.integral(1 + 0 * w) + limit)
    return ocp.build()


def test_solves_two_phases_with_parameter_data_paths_and_free_times():
    problem = _two_legs()
    answer = solve_bare(problem, intervals=40)
    # 8 / sqrt(a) + a is smallest at a = 4^(2/3), which is below the bounds of 3.
    best = 4 ** (2 / 3)
    assert answer.success
    assert answer.objective == pytest.approx(8 / math.sqrt(best) + best, rel=1e-4)
    assert answer.plan.parameters["limit"] == pytest.approx(best, rel=1e-3)
    assert answer.plan.parameters["distance"] == pytest.approx(4.0)
    assert problem.verify(answer.plan, tolerance=1e-2).ok


def test_reports_an_infeasible_problem_as_a_failure():
    ocp = OptimalControlProblem("too fast")
    phase = ocp.phase(time=(0, 0.5))
    x = phase.state("x", initial=0, final=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral(u**2))
    answer = solve_bare(ocp.build(), intervals=10)
    assert not answer.success
    assert answer.status == "Infeasible_Problem_Detected"
    assert not ocp.build().verify(answer.plan).ok


def test_values_that_are_not_finite_make_no_plan():
    definition = ct.load("optimal-control/bryson-denham").definition
    part = {
        "knots": [0.0, 1.0],
        "state_nodes": [[-1.0, 1.0]],
        "states": [np.zeros((2, 2))],
        "control_nodes": [[1.0]],
        "controls": [np.full((1, 1), 2.0)],
    }
    assert plan_of_nodes(definition, [part], []) is not None
    part["states"] = [np.full((2, 2), math.nan)]
    assert plan_of_nodes(definition, [part], []) is None


def test_the_limit_of_cpu_time_ends_the_solver():
    answer = solve_bare(ct.load("optimal-control/goddard"), seconds=sys.float_info.epsilon)
    assert not answer.success
    assert answer.status == "Maximum_CpuTime_Exceeded"
