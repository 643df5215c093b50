"""Other schemes and meshes if the first mesh or its refinement leads to no settled plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from control_declared import rest_to_rest

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.sampling import PANELS, RULE, Course
from crosstrack.solvers.contract.backend import Answer
from crosstrack.solvers.contract.enums import Limit, Termination
from crosstrack.solvers.run import rescue, running, starts

INFEASIBLE = Answer(Termination.LOCALLY_INFEASIBLE, message="made infeasible")


@pytest.fixture
def attended(monkeypatch):
    """Replace answers of programs: `attended.fake(run, program, request)` returns an answer or None."""

    class Attended:
        fake = staticmethod(lambda run, program, request: None)
        calls: list[tuple[str, int]] = []

    real = running.Run.attend

    def attend(run, program, request):
        formulation = run.target.formulation
        Attended.calls.append((formulation.name, sum(m.intervals for m in formulation.meshes)))
        answer = Attended.fake(run, program, request)
        return real(run, program, request) if answer is None else answer

    Attended.calls = []
    monkeypatch.setattr(running.Run, "attend", attend)
    return Attended


def is_gauss(run):
    return run.target.formulation.name == "gauss"


def value_of(case):
    return ct.solve(case.ocp).primal_bound


def test_a_uniform_mesh_of_the_other_scheme_replaces_an_infeasible_first_mesh(attended):
    case = rest_to_rest()
    attended.fake = lambda run, program, request: (
        INFEASIBLE if is_gauss(run) and len(attended.calls) == 1 else None
    )
    found = ct.solve(case.ocp)
    assert found.termination == "locally_optimal" and found.formulation == "radau"
    assert found.statistics["stages"] == "gauss: locally infeasible; radau 20x3: locally optimal"
    assert attended.calls[:2] == [("gauss", 8), ("radau", 20)]
    assert "starts tried" not in found.statistics
    assert found.history[0]["intervals"] == 20


@pytest.mark.parametrize("ending", ["iterations", "failed"])
def test_meshes_grow_until_one_is_feasible(attended, ending):
    answer = {
        "iterations": Answer(Termination.NO_SOLUTION, Limit.ITERATIONS),
        "failed": Answer(Termination.FAILED, message="made to fail"),
    }[ending]
    attended.fake = lambda run, program, request: answer if len(attended.calls) <= 3 else None
    found = ct.solve(rest_to_rest().ocp)
    assert found.termination == "locally_optimal", found.message
    assert found.limit is None
    assert found.statistics["stages"].endswith("radau 60x3: locally optimal")
    assert attended.calls[:4] == [("gauss", 8), ("radau", 20), ("radau", 20), ("radau", 60)]


@pytest.mark.parametrize(("given", "expected"), [(None, "monotone"), ("adaptive", "adaptive")])
def test_uniform_meshes_start_with_a_monotone_barrier(attended, given, expected):
    barriers = []

    def fake(run, program, request):
        barriers.append((run.target.formulation.name, request.options["mu_strategy"]))
        return INFEASIBLE if len(barriers) == 1 else None

    attended.fake = fake
    options = {} if given is None else {"backend_options": {"mu_strategy": given}}
    found = ct.solve(rest_to_rest().ocp, **options)
    assert found.termination == "locally_optimal"
    assert barriers[:2] == [("gauss", "adaptive"), ("radau", expected)]
    assert barriers[2][1] == "adaptive"


def test_stages_start_at_the_guess_after_a_drawn_start(attended, monkeypatch):
    def look_again(run, problem, request, answer, left):
        run.target = replace(run.target, formulation=run.target.formulation.started(1))
        run.notes.append("a remark on the first stage")
        return INFEASIBLE, problem

    monkeypatch.setattr("crosstrack.solvers.run.refinement.look_again", look_again)
    guesses = []
    attended.fake = lambda run, program, request: guesses.append(program.guess)
    ocp = rest_to_rest().ocp
    found = ct.solve(ocp)
    expected = ocp.formulate("radau", intervals=20, degree=3).program.guess
    assert np.array_equal(guesses[1], expected)
    assert found.termination == "locally_optimal" and "remark" not in found.message


def test_later_stages_vary_scheme_mesh_and_start(attended):
    attended.fake = lambda run, program, request: INFEASIBLE if len(attended.calls) <= 2 else None
    found = ct.solve(rest_to_rest().ocp)
    assert found.termination == "locally_optimal"
    assert found.statistics["stages"].endswith("radau 20x3, seed 1: locally optimal")


@pytest.mark.parametrize(
    "options",
    [{"formulation": "gauss"}, {"formulation_options": {"degree": 5}}, {"seed": 1}],
)
def test_explicit_choices_keep_the_formulation(attended, options):
    attended.fake = lambda run, program, request: INFEASIBLE if len(attended.calls) == 1 else None
    found = ct.solve(rest_to_rest().ocp, **options)
    assert "stages" not in found.statistics
    assert all(name == "gauss" for name, _ in attended.calls[:2])


def test_a_settled_answer_has_no_further_stage(attended):
    found = ct.solve(rest_to_rest().ocp)
    assert "stages" not in found.statistics
    assert ("radau", 20) not in attended.calls


def test_a_refinement_that_explodes_is_replaced(attended, monkeypatch):
    monkeypatch.setattr(rescue, "explodes", lambda rows: len(rows) == 1)
    monkeypatch.setattr(
        "crosstrack.solvers.run.refinement.explodes",
        lambda rows: len(rows) == 1 and rows[0]["intervals"] == 8,
    )
    found = ct.solve(ct.load("optimal-control/bryson-denham"))
    assert found.termination == "locally_optimal"
    assert found.statistics["stages"].startswith("gauss: ")
    assert found.statistics["stages"].endswith("radau 20x3: locally optimal")
    assert found.primal_bound == pytest.approx(4.0, rel=1e-6)


@pytest.mark.parametrize(
    ("errors", "nodes", "expected"),
    [
        ([1e-1, 5e-2, 6e-2, 5e-2, 6e-2, 7e-2], [48, 60, 90, 150, 300, 600], True),
        ([1e-1, 5e-2, 1e-2, 5e-3, 1e-3, 5e-4], [48, 60, 90, 150, 300, 600], False),
        ([1e-1, 5e-2, 6e-2, 5e-2, 6e-2, 7e-2], [48, 60, 62, 64, 66, 68], False),
        ([1e-1, 5e-2, 6e-2], [48, 600, 6000], False),
    ],
)
def test_an_explosion_is_growth_without_a_smaller_error(errors, nodes, expected):
    rows = [{"error": e, "nodes": n, "verified": None} for e, n in zip(errors, nodes, strict=True)]
    assert rescue.explodes(rows) is expected
    rows[2]["verified"] = True
    assert not rescue.explodes(rows)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, 1.2, 1.5, 1.9], True),
        ([-9.0, -7.0, -5.0, -3.0], True),
        ([1.9, 1.5, 1.2, 1.0], False),
        ([1.0, 1.2, 1.5, 1.51], False),
        ([1.0, 1.2, 1.5], False),
    ],
)
def test_an_objective_that_rises_on_every_mesh_is_an_explosion(values, expected):
    assert rescue.explodes([{"objective": value} for value in values]) is expected


def test_a_refined_program_that_fails_is_solved_without_the_warm_start(attended):
    failed = []

    def fake(run, program, request):
        if is_gauss(run) and request.warm_start is not None and not failed:
            failed.append(program)
            return Answer(Termination.FAILED, message="made to fail")
        return None

    attended.fake = fake
    found = ct.solve(ct.load("optimal-control/bryson-denham"))
    assert failed and found.termination == "locally_optimal"
    assert "stages" not in found.statistics
    assert found.primal_bound == pytest.approx(4.0, rel=1e-6)


def test_continues_from_the_better_plan_of_the_confirmation(attended):
    changed = []

    def fake(run, program, request):
        # The first confirmation, whose program does not belong to the formulation of the run.
        if (
            is_gauss(run)
            and program is not run.target.formulation.program
            and not changed
            and (request.warm_start is not None)
        ):
            changed.append(program)
            guess = program.guess
            value = 0.9 * float(program.objective(guess))
            return Answer(Termination.LOCALLY_OPTIMAL, point=guess, primal_bound=value)
        return None

    attended.fake = fake
    found = ct.solve(rest_to_rest().ocp)
    assert changed and found.termination == "locally_optimal" and found.verified
    assert any("radau ends at" in row["then"] for row in found.history)


def test_the_order_of_stages():
    def stage(kind, value):
        return rescue._Stage(None, None, replace(INFEASIBLE), [], (kind, value))

    settled, verified, rejected, nothing = range(4)
    assert stage(settled, 1.0).is_better(stage(verified, 1.0 - 1e-6))
    assert not stage(settled, 1.0).is_better(stage(verified, 0.9))
    assert stage(verified, 0.9).is_better(stage(settled, 1.0))
    assert stage(rejected, 2.0).is_better(stage(rejected, 3.0))
    assert stage(verified, 9.0).is_better(stage(rejected, 1.0))
    assert not stage(nothing, 0.0).is_better(stage(rejected, 1e9))


def test_an_error_that_stalls_on_meshes_of_equal_size_is_an_explosion():
    rows = [{"error": e, "nodes": 100, "verified": None} for e in (0.1, 5e-3, *[0.4] * 6)]
    assert rescue.explodes(rows)
    assert not rescue.explodes(rows[:-1])


def test_the_work_of_a_stage_is_limited(attended, monkeypatch):
    monkeypatch.setattr(rescue, "WORK", 0)
    monkeypatch.setattr(rescue, "SHARE", 0)
    limits = []
    attended.fake = lambda run, program, request: limits.append(request.options["max_iter"])
    found = ct.solve(ct.load("optimal-control/bryson-denham"))
    assert found.history[-1]["then"] == "given up: finer meshes need too many iterations"
    assert min(limits[1:]) == rescue.LEAST_FIRST


def test_constant_controls_give_a_verified_plan_if_no_other_stage_does(attended, monkeypatch):
    def fake(run, program, request):
        return None if run.target.formulation.is_last_resort else INFEASIBLE

    attended.fake = fake
    found = ct.solve(rest_to_rest().ocp)
    assert found.verified and found.termination == "feasible"
    assert found.statistics["stages"].endswith("radau 60x5, constant controls: feasible")
    assert "constant per interval" in found.message
    for values in found.plan.phases[0].controls.values:
        assert np.ptp(values, axis=0).max() <= 1e-6


def test_a_convex_problem_is_not_restarted(attended):
    attended.fake = lambda run, program, request: INFEASIBLE
    found = ct.solve(rest_to_rest().ocp)
    assert found.termination == "locally_infeasible"
    assert "starts tried" not in found.statistics


def test_no_restart_follows_restarts_with_many_iterations(attended):
    answer = replace(INFEASIBLE, statistics={"iterations": starts.RESTARTS_END})
    attended.fake = lambda run, program, request: answer
    ocp = ct.load("optimal-control/dubins")
    assert ct.solve(ocp).statistics["starts tried"] == 2


def test_a_vanishing_integrand_has_few_panels(monkeypatch):
    ocp = OptimalControlProblem("vanishing")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u", upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral((u - 1) ** 2))
    points, at = [], Course.at

    def counted(course, interval, tau):
        points.append(tau.size)
        return at(course, interval, tau)

    monkeypatch.setattr(Course, "at", counted)
    found = ct.solve(ocp, formulation="gauss", formulation_options={"rounds": 2})
    assert found.verified and found.primal_bound == pytest.approx(0, abs=1e-8)
    assert max(points) <= 2 * PANELS * RULE
