"""Other schemes and meshes if the first mesh or its refinement leads to no settled plan."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import casadi
import numpy as np
import pytest
from control_declared import rest_to_rest

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.sampling import PANELS, RULE, Course
from crosstrack.solvers.contract.backend import Answer
from crosstrack.solvers.contract.enums import Limit, Termination
from crosstrack.solvers.run import refinement, rescue, running, starts

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
    attended.fake = lambda run, program, request: answer if len(attended.calls) <= 4 else None
    found = ct.solve(rest_to_rest().ocp)
    assert found.termination == "locally_optimal", found.message
    assert found.limit is None
    assert found.statistics["stages"].endswith("radau 60x3: locally optimal")
    meshes = [("gauss", 8), ("radau", 20), ("radau", 40), ("radau", 20), ("radau", 60)]
    assert attended.calls[:5] == meshes


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
    attended.fake = lambda run, program, request: INFEASIBLE if len(attended.calls) <= 3 else None
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


def test_a_stage_is_not_graded_after_the_time_limit(monkeypatch):
    # The verification of a plan with large errors took 1.8 s.
    graded = []
    monkeypatch.setattr(refinement, "explodes", lambda rows: True)
    monkeypatch.setattr(rescue, "_ending", lambda request, limit, seconds: Limit.TIME)
    monkeypatch.setattr(rescue, "_grade", lambda run, answer, is_late=False: graded.append(answer))
    found = ct.solve(ct.load("optimal-control/moon-lander"))
    assert (found.termination, found.limit) == ("rejected", "time"), found.message
    assert not graded and "stages" not in found.statistics


@pytest.mark.parametrize(
    ("verified", "grade"),
    [([True], (1, 2.0)), ([True, None], (1, 2.0)), ([False], (2, np.inf)), ([], (2, np.inf))],
)
def test_the_history_grades_a_stage_that_ends_at_the_time_limit(verified, grade):
    # The answer is that of the last mesh with a verified plan, not of the last mesh.
    run = SimpleNamespace(history=[{"verified": item} for item in verified])
    answer = Answer(Termination.FEASIBLE, point=np.zeros(1), primal_bound=2.0)
    assert rescue._grade(run, answer, is_late=True) == grade


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
    # A limit that is exceeded next to a jump has little effect on the objective.
    for former, change, is_converging in (
        (1e-3, 8e-6, True), (1e-5, 8e-6, False), (1e-3, 8e-5, False), (1e-9, 9e-8, True), (None, 9e-6, True),
    ):  # fmt: skip
        rows[-2]["change"], rows[-1]["change"] = former, change
        assert rescue.explodes(rows) is (expected and not is_converging)
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
    monkeypatch.setattr(rescue, "RESTRICTED", 0)
    limits = []
    attended.fake = lambda run, program, request: limits.append(request.options["max_iter"])
    found = ct.solve(ct.load("optimal-control/bryson-denham"))
    assert found.history[-1]["then"] == "given up: finer meshes need too many iterations"
    assert min(limits[1:]) == rescue.LEAST_FIRST


def only_linear_controls(run, program, request):
    return None if run.target.formulation.is_restricted else INFEASIBLE


def test_linear_controls_settle_a_problem_if_no_other_stage_does(attended):
    attended.fake = only_linear_controls
    found = ct.solve(rest_to_rest().ocp)
    assert found.verified and found.termination == "locally_optimal"
    assert found.statistics["stages"].endswith("radau 40x5, linear controls: locally optimal")
    assert found.primal_bound == pytest.approx(value_of(rest_to_rest()), rel=1e-6)
    for nodes, values in zip(
        found.plan.phases[0].controls.nodes, found.plan.phases[0].controls.values, strict=True
    ):
        assert np.abs(np.polynomial.legendre.legfit(nodes, values, 4)[2:]).max() <= 1e-6


def test_linear_controls_without_multipliers_do_not_settle_on_their_first_mesh(
    attended, monkeypatch
):
    attended.fake, attend = only_linear_controls, running.Run.attend
    monkeypatch.setattr(running.Run, "attend", lambda *args: replace(attend(*args), duals=None))
    found = ct.solve(rest_to_rest().ocp)
    assert found.verified and [row["intervals"] for row in found.history[:2]] == [40, 80]
    assert "linear controls may cost inf" in found.history[0]["then"]


def test_linear_controls_resolve_jumps_by_cuts_near_them(attended):
    ocp = OptimalControlProblem("bang-bang")
    phase = ocp.phase(time=(0, (0.1, 9)))
    x, v = phase.state("x", initial=0, final=1.3), phase.state("v", initial=0, final=0)
    u = phase.control("u", lower=-2, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.end)
    attended.fake = only_linear_controls
    found = ct.solve(ocp)
    # The switch is at 2/3 of the time, inside an interval. The barrier at 200 nodes costs 1e-6.
    assert found.verified and found.primal_bound == pytest.approx(3.9**0.5, rel=3e-6)
    assert found.history[-1]["intervals"] <= 80  # intervals at the bounds are not halved


def test_controls_that_are_not_unique_end_with_a_verified_plan(attended):
    """The speed is constant, so every feasible heading is optimal, and interior points chatter."""
    ocp = OptimalControlProblem("discs")
    phase = ocp.phase(time=(0, 1))
    x, y = phase.state("x", initial=0, final=1.2), phase.state("y", initial=0, final=1.6)
    heading = phase.control("heading")
    u, v = 2.138 * casadi.cos(heading), 2.138 * casadi.sin(heading)
    phase.dynamics({x: u, y: v})
    phase.path((x - 0.4) ** 2 + (y - 0.5) ** 2, lower=0.1)
    phase.path((x - 0.8) ** 2 + (y - 1.5) ** 2, lower=0.1)
    ocp.minimise(phase.integral(u**2 + v**2))
    attended.fake = only_linear_controls
    found = ct.solve(ocp)
    assert found.verified and found.termination == "locally_optimal"
    assert found.primal_bound == pytest.approx(2.138**2, rel=1e-9)


def test_linear_controls_start_at_the_guess_and_then_at_the_best_plan(attended, monkeypatch):
    starts_of, guess = [], rest_to_rest().ocp.formulate("radau", intervals=40, degree=5)

    def fake(run, program, request):
        if run.target.formulation.is_restricted:
            starts_of.append(program.guess)
            return INFEASIBLE
        return INFEASIBLE if is_gauss(run) or len(attended.calls) > 2 else None

    monkeypatch.setattr("crosstrack.solvers.run.refinement.explodes", lambda rows: True)
    monkeypatch.setattr(rescue, "_grade", lambda run, answer, is_late=False: rescued(answer))
    attended.fake = fake
    ct.solve(rest_to_rest().ocp)
    assert len(starts_of) == 2  # a third search from the same plan would repeat the second
    assert np.array_equal(starts_of[0], guess.program.guess)
    assert not np.allclose(starts_of[1], starts_of[0])


def rescued(answer):
    """Grade every plan as rejected."""
    return (rescue._NOTHING, 0.0) if answer.point is None else (rescue._REJECTED, 2.0)


@pytest.mark.parametrize(("change", "expected"), [(None, False), (1e-7, True), (1e-3, False)])
def test_no_stage_follows_a_verified_plan_whose_objective_hardly_changes(change, expected):
    verified, rejected = (
        rescue._Stage(None, None, INFEASIBLE, [{"change": change}], (kind, 1.0))
        for kind in (rescue._VERIFIED, rescue._REJECTED)
    )
    assert verified.is_close is expected and not rejected.is_close


def test_lines_are_fitted_to_a_chattering_control():
    ocp = rest_to_rest().ocp.build()
    t = np.linspace(0, 1, 401)
    u = 3.0 + t + np.where(np.arange(401) % 2, 1.0, -1.0)
    plan = ocp.as_plan({"time": t, "x": t, "v": 0 * t, "u": u})
    restricted = next(
        other for _, other in ocp.formulate("gauss").alternatives() if other.is_restricted
    )
    (layout,) = restricted.layout.phases
    values = restricted.encode(plan)[layout.control_columns][0]
    assert np.abs(values - 3.0 - layout.visit_places[0]).max() < 0.7
    bends = np.linalg.pinv(np.vander(layout.schemes[0].control_points, 5)) @ values[:5]
    assert np.abs(bends[:3]).max() <= 1e-9


def test_objectives_that_vanish_in_both_schemes_agree():
    ocp = OptimalControlProblem("vanishing at a bound")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u", upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral((u - 1) ** 2))
    found = ct.solve(ocp)
    assert found.termination == "locally_optimal" and found.statistics["confirmed_by"] == "radau"
    assert found.primal_bound == pytest.approx(0, abs=1e-8)


def test_a_verified_warm_start_is_not_lost_if_the_run_ends_rejected(attended):
    ocp = rest_to_rest().ocp
    first = ct.solve(ocp)

    def fake(run, program, request):
        point = program.guess * 1.01
        return Answer(Termination.LOCALLY_OPTIMAL, point=point, primal_bound=0.0)

    attended.fake = fake
    lost = ct.solve(ocp, formulation="gauss", formulation_options={"rounds": 1})
    assert lost.termination == "rejected" and lost.plan is None
    assert "returned plan" not in lost.statistics
    kept = ct.solve(ocp, warm_start=first, formulation_options={"rounds": 1})
    assert kept.termination == "feasible" and kept.verified
    assert kept.primal_bound == pytest.approx(first.primal_bound, rel=1e-9)
    assert "the plan is the warm start" in kept.message
    assert kept.statistics["returned plan"] == "warm start"


@pytest.mark.parametrize("time", [1.0, 0.0], ids=["locally-infeasible", "undecodable"])
def test_a_verified_warm_start_is_not_lost_if_the_run_ends_without_a_plan(attended, time):
    ocp = rest_to_rest().ocp
    first = ct.solve(ocp)

    def fake(run, program, request):
        if time:
            return replace(INFEASIBLE, point=None)
        # A phase that ends at its start is not a plan.
        return Answer(Termination.FEASIBLE, point=program.guess * time)

    attended.fake = fake
    assert ct.solve(ocp, formulation="gauss", formulation_options={"rounds": 1}).plan is None
    kept = ct.solve(ocp, warm_start=first, formulation_options={"rounds": 1})
    assert kept.termination == "feasible" and kept.verified
    assert kept.primal_bound == pytest.approx(first.primal_bound, rel=1e-9)
    assert "the plan is the warm start" in kept.message
    assert kept.statistics["returned plan"] == "warm start"


def test_a_refined_program_without_a_plan_leaves_the_plan_of_the_mesh_before(attended):
    def fake(run, program, request):
        if len(attended.calls) == 1:
            return None
        return Answer(Termination.LOCALLY_OPTIMAL, point=0.0 * program.guess)  # ends at its start

    attended.fake = fake
    found = ct.solve(ct.load("optimal-control/bryson-denham"), formulation="gauss", tolerance=1e-3)
    assert found.termination == "feasible" and found.verified
    assert "the refined program ends at a point that is no plan" in found.message
    assert found.history[-1]["then"] in found.message


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
