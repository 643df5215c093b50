"""Comparison of starts on a coarse mesh, one start for convex problems, and limits that count no seconds."""

import time

import numpy as np
import pytest
from control_motions import BRYSON, CURVE, FALL, round_a_disc

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.transcription.methods import Gauss
from crosstrack.models.optimal_control.transcription.starts import draw_flight
from crosstrack.solvers.contract.backend import Answer, Request, Termination
from crosstrack.solvers.run import starts


def f8_aircraft():
    """Return the F-8 aircraft of Garrard, Jordan 1977, whose guess leads to 5.7286 instead of 3.7809."""
    ocp = OptimalControlProblem("f8")
    phase = ocp.phase(time=(0, (0.1, 20)))
    a = phase.state("a", initial=0.4655, final=0)
    b = phase.state("b", initial=0, final=0)
    c = phase.state("c", initial=0, final=0)
    e = phase.control("e", lower=-0.05236, upper=0.05236)
    lift = -0.877 * a + c - 0.088 * a * c + 0.47 * a**2 - 0.019 * b**2 - a**2 * c + 3.846 * a**3
    lift += -0.215 * e + 0.28 * a**2 * e + 0.47 * a * e**2 + 0.63 * e**3
    pitch = -4.208 * a - 0.396 * c - 0.47 * a**2 - 3.564 * a**3
    pitch += -20.967 * e + 6.265 * a**2 * e + 46 * a * e**2 + 61.4 * e**3
    phase.dynamics({a: lift, b: c, c: pitch})
    ocp.minimise(phase.end)
    return ocp


def test_finds_the_better_of_several_optima():
    found = ct.solve(f8_aircraft(), tolerance=1e-3)
    assert found.verified and found.statistics["second look"] == "better"
    assert found.primal_bound == pytest.approx(3.7809, rel=1e-3)
    assert "a drawn start led to a better optimum" in found.message
    alone = ct.solve(f8_aircraft(), tolerance=1e-3, seed=0)
    assert alone.primal_bound > 5.7 and "second look" not in alone.statistics


def count_searches(monkeypatch):
    """Return a list that grows by the number of columns of each program that is solved."""
    solved = []
    attend = starts.Run.attend

    def counting(run, problem, request):
        solved.append(problem.size)
        return attend(run, problem, request)

    monkeypatch.setattr(starts.Run, "attend", counting)
    return solved


def test_a_convex_problem_has_one_start(monkeypatch):
    solved = count_searches(monkeypatch)
    found = ct.solve(ct.load(BRYSON))
    assert found.statistics["second look"] == "convex" and found.statistics["convex"] is True
    assert len(solved) == found.statistics["meshes"] + 1  # the confirmation
    assert "convex" not in ct.solve(ct.load(CURVE)).statistics


def test_starts_that_agree_end_the_comparison(monkeypatch):
    solved = count_searches(monkeypatch)
    found = ct.solve(ct.load(CURVE))
    assert found.statistics["second look"] == "no better"
    coarse = [size for size in solved[1:] if size < solved[0]]
    assert len(coarse) == starts.LEAST + 1


def test_a_search_can_begin_at_the_optimum_of_the_coarse_program(monkeypatch):
    monkeypatch.setattr(Gauss, "begins_coarse", True)
    solved = count_searches(monkeypatch)
    found = ct.solve(ct.load(CURVE))
    assert found.verified and found.statistics["second look"] == "no better"
    # The plan of the first mesh and the drawn starts are compared on the coarse one.
    assert solved[0] < solved[1] and solved.count(solved[0]) == 1 + starts.LEAST + 1
    assert found.primal_bound == pytest.approx(FALL, rel=1e-6)
    del solved[:]
    ct.solve(ct.load(CURVE), seed=0, formulation_options={"rounds": 1})
    assert len(solved) == 1  # the caller chose the start


def test_a_failure_from_the_coarse_optimum_is_repeated_from_the_guess(monkeypatch):
    monkeypatch.setattr(Gauss, "begins_coarse", True)
    solved, attend = count_searches(monkeypatch), starts.Run.attend

    def failing(run, problem, request):
        answer = attend(run, problem, request)
        return Answer(Termination.FAILED) if len(solved) == 2 else answer

    monkeypatch.setattr(starts.Run, "attend", failing)
    found = ct.solve(ct.load(CURVE))
    assert found.verified and solved[0] < solved[1] == solved[2]


def test_a_fixed_mesh_is_solved_from_the_guess_alone(monkeypatch):
    solved = count_searches(monkeypatch)
    found = ct.solve(ct.load(CURVE), formulation_options={"refine": False})
    assert len(solved) == 1 and "second look" not in found.statistics


def test_names_starts_that_the_time_limit_stops(monkeypatch):
    monkeypatch.setattr(starts, "SHARE", 1e-9)
    found = ct.solve(ct.load(CURVE), time_limit=300)
    assert found.statistics["second look"] == "stopped"
    assert "other starts were stopped by the time limit" in found.message


@pytest.mark.parametrize("name", ["zermelo", pytest.param("moon-lander", marks=pytest.mark.slow)])
def test_the_answer_does_not_depend_on_the_clock(name, monkeypatch):
    model, real = ct.load(f"optimal-control/{name}"), time.perf_counter
    first = ct.solve(model)
    # A busy machine is one whose clock runs fast.
    monkeypatch.setattr(time, "perf_counter", lambda: 1000.0 * real())
    second = ct.solve(model)
    monkeypatch.undo()
    assert first.primal_bound == second.primal_bound
    assert first.statistics == second.statistics and first.message == second.message


def test_a_motion_with_random_controls_is_a_start():
    formulation = round_a_disc().formulate("gauss").coarse()
    definition = formulation.model.definition
    guess = formulation.decode(formulation.program.guess)
    plan, again = (draw_flight(definition, guess, 3).phases[0] for _ in range(2))
    assert plan.to_data() == again.to_data()
    assert plan.to_data() != draw_flight(definition, guess, 4).phases[0].to_data()
    t = np.linspace(plan.start, plan.end, 50)
    for part, what in ((plan.states, "states"), (plan.controls, "controls")):
        low, high = definition.phases[0].bounds(what)
        assert (part(t) >= low - 1e-12).all() and (part(t) <= high + 1e-12).all()
    # The states move with the controls: q' = u, by pieces of constant controls.
    assert np.ptp(part(t), axis=0).max() > 0
    columns = formulation.draw(2)
    assert columns.shape == (formulation.program.size,)


def free_motion(cost):
    """Return the motion with a free control and a cost of its last state."""
    ocp = OptimalControlProblem("free")
    phase = ocp.phase(time=(0, 1))
    x, v, u = phase.state("x", initial=0), phase.state("v", initial=0), phase.control("u")
    phase.dynamics({x: v, v: u - x})
    ocp.minimise(cost(phase.final(x)))
    return ocp


def test_stops_early_if_the_objective_is_unbounded():
    ocp = OptimalControlProblem("free")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u")
    phase.dynamics({x: u})
    ocp.minimise(phase.final(x))
    found = ct.solve(ocp, formulation="gauss")
    assert found.termination == "no_solution" and "may be unbounded" in found.message
    assert found.statistics["iterations"] < 200  # of 3000


@pytest.mark.parametrize("options", [{"rounds": 2}, {"refine": False}])
def test_a_plan_at_a_saddle_is_no_optimum_on_finer_meshes(options):
    # The point at rest is stationary for -x², and a warm start on a finer mesh stays there.
    found = ct.solve(
        free_motion(lambda x: -(x**2)),
        formulation="gauss",
        formulation_options={"intervals": 2, "degree": 3, **options},
    )
    assert found.termination == "feasible" and "not a minimum" in found.message


@pytest.mark.parametrize(
    ("values", "count"),
    [
        ([5.0, 5.0, 5.0, 5.0, 6.0], starts.LEAST),  # three agree with the plan, and none is better
        ([5.0, 5.0, 5.0, 6.0, 7.0], starts.MOST),
        ([5.0, 5.0, 5.0, 5.0, 4.0], starts.MOST),
    ],
)
def test_worse_optima_do_not_require_more_starts_if_most_starts_agree(values, count):
    problem = free_motion(lambda x: x**2)
    formulation = problem.formulate("gauss", intervals=1, degree=2)
    points = iter(values + [6.0] * starts.MOST)
    solved = []

    class Fake:
        def attend(self, program, request):
            solved.append(next(points))
            point, ended = program.guess, Termination.LOCALLY_OPTIMAL
            return Answer(ended, point=point, primal_bound=solved[-1], statistics={"iterations": 1})

    plan = formulation.decode(formulation.program.guess)
    better = starts._optima(Fake(), formulation, plan, 5.0, Request())
    assert len(solved) == count + 1
    assert len(better) == (min(values) < 5.0)
