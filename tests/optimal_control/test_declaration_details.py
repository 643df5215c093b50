"""Interpolants, invariants, scales and guesses of declared problems."""

import math
import pickle

import casadi
import cloudpickle
import numpy as np
import pytest
from control_declared import COARSE, INF, interpolated, rest_to_rest, solve, two_phases
from control_motions import round_a_disc

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import Model, OptimalControlProblem


def test_an_interpolant_without_a_scalar_form_works():
    ocp = interpolated()
    found = solve(ocp, formulation_options={"intervals": 1, "degree": 8})
    assert found.primal_bound == pytest.approx(0.408401, abs=2e-5)
    for again in (
        Model.from_json(ocp.to_json()),
        pickle.loads(pickle.dumps(ocp)),
        cloudpickle.loads(cloudpickle.dumps(ocp)),
    ):
        assert again.digest == ocp.digest
        assert again.verify(found.plan).objective == pytest.approx(found.primal_bound, rel=1e-12)


def test_a_digest_is_independent_of_earlier_solves():
    """Check that a table without and with cached derivatives has the same digest."""
    ocp = interpolated()
    digest = interpolated().digest
    _ = ocp.formulate("radau", intervals=1).program
    assert ocp.digest == digest == pickle.loads(pickle.dumps(ocp)).digest


def turning(invariant):
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    q, u = phase.state("q", 2, initial=[1, 0]), phase.control("u", lower=-1, upper=1)
    phase.dynamics({q: casadi.vertcat(-q[1], q[0]) * (1 + u)})
    phase.invariant("norm", invariant(q, phase.time), equation="4", unit="m")
    ocp.minimise(phase.final(q[0]))
    return ocp


def test_an_invariant_is_verified():
    found = solve(turning(lambda q, t: casadi.sumsqr(q)))
    assert found.primal_bound == pytest.approx(math.cos(2), abs=1e-6)
    (check,) = [one for one in found.verification.checks if one.name == "norm"]
    assert check.ok and check.worst < 1e-6 and check.equation == "4" and check.unit == "m"


def test_verify_reveals_a_wrong_invariant():
    found = ct.solve(turning(lambda q, t: q[0] + 0 * t), formulation_options={"refine": False})
    assert found.termination == "rejected" and found.plan is None
    assert "norm" in found.message


def test_scales_come_from_bounds_and_ends():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    phase.state("a", 2, lower=[-3, 0], upper=[2, INF])
    phase.state("b", initial=-5, final=(1, 2))
    phase.state("c")
    phase.state("d", 2, upper=7, scale=[2, 3])
    phase.control("e", lower=-4)
    phase.dynamics(dict.fromkeys("abcd", 0))
    phase.path(phase.time <= 9, name="late")
    ocp.minimise(phase.end)
    part = ocp.definition.phases[0]
    assert part.stacked("states", "scale").tolist() == [3, 1, 5, 1, 2, 3]
    assert part.stacked("controls", "scale").tolist() == [4]
    assert part.paths[0].scale.tolist() == [9]


def test_scales_change_only_the_search():
    small = OptimalControlProblem()
    phase = small.phase()
    x = phase.state("x", initial=0, final=1e6, scale=1e6)
    v = phase.state("v", initial=0, final=0, scale=1e6)
    u = phase.control("u", scale=6e6)
    phase.dynamics({x: v, v: u})
    small.minimise(phase.integral((u / 1e6) ** 2))
    assert solve(small).primal_bound == pytest.approx(12, rel=1e-8)


def test_written_out_defaults_are_the_same_problem():
    def declared(**options):
        ocp = OptimalControlProblem()
        phase = ocp.phase(**options.get("phase", {}))
        x = phase.state("x", **options.get("state", {}))
        u = phase.control("u", **options.get("control", {}))
        p = ocp.parameter("p", **options.get("parameter", {}))
        phase.dynamics({x: u + p})
        phase.path(x + u, upper=3, **options.get("path", {}))
        ocp.minimise(phase.end, **options.get("minimise", {}))
        return ocp.digest

    free = {"size": 1, "lower": None, "upper": INF, "scale": 1, "unit": ""}
    assert declared() == declared(
        phase={"name": "phase 1", "time": [0, 1.0], "unit": "s", "equation": ""},
        state={**free, "initial": (None, INF), "final": None},
        control={**free, "lower": -INF},
        parameter={**free, "guess": 0},
        path={"name": "path 1", "lower": -INF, "scale": [3]},
        minimise={"unit": ""},
    )


def guessed(problem):
    """Return the guess as functions of the fraction of the phase."""
    guess = problem.definition.phases[0].guess

    def at(fraction):
        states, controls = (
            [np.interp(fraction, guess.fractions, column) for column in table.T]
            for table in (guess.states, guess.controls)
        )
        return states + controls

    return at


def test_default_guesses_are_lines_between_fixed_values():
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(1, (3, 5)))
    phase.state("a", initial=0, final=4)
    phase.state("b", initial=2)
    phase.state("c", final=-1)
    phase.state("d", lower=1, upper=3)
    phase.state("e", lower=2)
    phase.state("f", final=(5, 6))
    phase.control("u", upper=-1)
    phase.dynamics(dict.fromkeys("abcdef", 0))
    ocp.minimise(phase.end)
    assert guessed(ocp)(0.5) == [2, 2, -1, 2, 2, 2.5, -1]
    guess = ocp.definition.phases[0].guess
    assert (guess.start, guess.end) == (1, 4)


def test_guesses_by_samples_values_and_functions():
    given = rest_to_rest()
    given.phase.guess(x=[0, 4, 0], v=[[1.0], [3.0]], u=lambda t: 10 * t)
    assert guessed(given.ocp)(0.25) == pytest.approx([2, 1.5, 2.5])
    given.phase.guess(time=[0, 0.2, 1], x=[0, 1, 1])  # one after the other, the last one counts
    assert guessed(given.ocp)(0.1) == pytest.approx([0.5, 1.2, 1])
    given.phase.guess(v=-1, u=np.float64(3))
    assert guessed(given.ocp)(0.9) == pytest.approx([1, -1, 3])


def test_guesses_of_free_times_and_vectors():
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, (1, 10)))
    q = phase.state("q", 2)
    phase.dynamics({q: 0})
    ocp.minimise(phase.end)
    phase.guess(time=[0, 8], q=[[0, 1], [4, 1]])
    assert ocp.definition.phases[0].guess.end == 8 and guessed(ocp)(0.5) == [2, 1]
    phase.guess(q=[7, 9])
    assert ocp.definition.phases[0].guess.end == 8 and guessed(ocp)(0.5) == [7, 9]
    phase.guess(q=lambda t: [t, -t])
    assert guessed(ocp)(0.5) == pytest.approx([4, -4])


@pytest.mark.parametrize("what", ["solution", "plan", "phase"])
def test_a_plan_or_solution_is_a_guess(answer, what):
    source = {"solution": answer, "plan": answer.plan, "phase": answer.plan.phases[0]}[what]
    again = rest_to_rest()
    again.phase.guess(source)
    assert guessed(again.ocp)(0.5) == pytest.approx([0.5, 1.5, 0], abs=1e-3)


def test_the_plan_of_another_problem_guesses_equal_names(answer):
    other = OptimalControlProblem()
    phase = other.phase("its own name", time=(0, (2, 5)))
    y, x = phase.state("y", initial=7), phase.state("x")
    w = phase.control("w")
    phase.dynamics({x: w, y: x})
    other.minimise(phase.end)
    phase.guess(answer.plan, w=4)
    assert guessed(other)(0.5) == pytest.approx([7, 0.5, 4], abs=1e-3)
    assert other.definition.phases[0].guess.end == 2  # 1, moved into its bounds


def test_a_plan_guesses_phases_by_name():
    ocp, go, stop = two_phases((0.2, 1.5))
    found = solve(ocp)
    again, go, stop = two_phases((0.2, 1.5))
    for part in (go, stop):
        part.phase.guess(found)
    guess = again.definition.phases[1].guess
    assert guess.start == pytest.approx(found.plan.phases[1].start)
    assert guess.states[-1] == pytest.approx([1, 0, 1.5], abs=1e-6)
    third = OptimalControlProblem()
    phase = third.phase("third")
    phase.state("w")
    with pytest.raises(InvalidData, match="phases 'go', 'stop'; give one of them"):
        phase.guess(found)
    phase.guess(found.plan.phases[0])


def test_a_warm_start_must_fit_the_problem(answer):
    ocp = rest_to_rest().ocp
    warm = ct.solve(ocp, warm_start=answer, formulation_options=COARSE)
    assert warm.primal_bound == pytest.approx(12, rel=1e-9)
    with pytest.raises(InvalidData, match="phases of the plan must be"):
        ct.solve(two_phases()[0], warm_start=answer)
    far = rest_to_rest()
    far.phase.path(far.v <= 1.2, name="slow")
    found = ct.solve(far.ocp, warm_start=answer, formulation_options=COARSE)
    assert found.verification.ok and found.primal_bound > 12.0
    assert found.message == "warm start: used as a guess; verification violated: slow"


def test_a_plan_from_another_state_is_a_guess():
    """Check that replanning passes the disc on the side of the guess, not of a random start."""

    def way(start: float) -> OptimalControlProblem:
        ocp = OptimalControlProblem("round a disc")
        phase = ocp.phase()
        x, y = phase.state("x", initial=start, final=2), phase.state("y", initial=0, final=0)
        u, v = phase.control("u", lower=-20, upper=20), phase.control("v", lower=-20, upper=20)
        phase.dynamics({x: u, y: v})
        phase.path((x - 1) ** 2 + (y - 0.1) ** 2, lower=0.25, name="disc")
        phase.guess(x=[start, 1, 2], y=[0, -1, 0])
        ocp.minimise(phase.integral(u**2 + v**2))
        return ocp

    above, model = ct.solve(round_a_disc(), seed=0, tolerance=1e-4), way(0.05)
    again = ct.solve(model, warm_start=above, tolerance=1e-4)
    assert again.verification.ok
    assert again.message == "warm start: used as a guess; verification violated: initial values"
    assert again.plan["y"](0.5) > 0.0 > ct.solve(model, seed=0, tolerance=1e-4).plan["y"](0.5)
    # A warm start that fails must not become a plan of this problem.
    none = ct.solve(model, warm_start=above, backend_options={"max_iter": 1}, time_limit=1e-6)
    assert none.plan is None and none.termination == "no_solution"
