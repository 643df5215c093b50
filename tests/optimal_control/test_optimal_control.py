"""Declaring optimal control problems: what each declaration means, what is refused, what is kept."""

import copy
import inspect
import json
import math
import pickle
from types import SimpleNamespace

import casadi
import cloudpickle
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedOption
from crosstrack.models import ControlPlan, Model, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.plan import Piecewise

INF, NAN = math.inf, math.nan
#: A coarse first mesh: these problems are smooth, and refinement does the rest.
COARSE = {"intervals": 3}


def solve(problem, **options):
    """Solve on a coarse mesh, and insist on a plan."""
    answer = ct.solve(problem, **{"formulation_options": COARSE, **options})
    assert answer.plan is not None, str(answer)
    return answer


def rest_to_rest(name="rest to rest"):
    """The least effort from rest to rest: x = 3t² - 2t³, u = 6 - 12t, ∫ u² = 12."""
    ocp = OptimalControlProblem(name)
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    return SimpleNamespace(ocp=ocp, phase=phase, x=x, v=v, u=u)


def open_problem(time=(0, 1)):
    """The same without dynamics and objective, to declare what a test is about."""
    ocp = OptimalControlProblem("open")
    phase = ocp.phase(time=time)
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u")
    return SimpleNamespace(ocp=ocp, phase=phase, x=x, v=v, u=u)


@pytest.fixture(scope="module")
def answer():
    return solve(rest_to_rest().ocp)


def at_instant(ocp, *, t=0.0, x=(), u=(), p=(), phase=0):
    """The declared functions at one instant: rate, path, integrand, invariant."""
    found = ocp.definition.phases[phase].function(t, list(x), list(u), list(p))
    return [np.array(one).ravel() for one in found]


# -- what declarations mean ------------------------------------------------------------------------


def test_a_newcomer_declares_bryson_and_denham_in_twelve_lines():
    ocp = OptimalControlProblem("bryson-denham")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=1 / 9)
    v = phase.state("v", initial=1, final=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2 / 2))
    answer = ct.solve(ocp, tolerance=1e-6)
    assert answer.termination == "locally_optimal"
    assert answer.primal_bound == pytest.approx(4.0, abs=4e-6)
    assert answer.verification.ok
    assert answer.plan["x"](0.5) == pytest.approx(1 / 9, abs=2e-6)
    assert ocp.describe() == "1 phase, 2 states, 1 controls"


def test_a_vector_is_its_entries():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    q = phase.state("q", 2, initial=[0, 0], final=[1, 0])
    u = phase.control("u")
    phase.dynamics({q: np.array([[0.0, 1], [0, 0]]) @ q + np.array([0.0, 1]) * u})
    ocp.minimise(phase.integral(u**2))
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(12, rel=1e-9)
    t = np.linspace(0, 1, 7)
    assert found.plan["q"](t) == pytest.approx(
        np.stack([3 * t**2 - 2 * t**3, 6 * t - 6 * t**2], axis=1), abs=1e-8
    )
    assert found.plan["q[1]"](0.25) == pytest.approx(1.125, abs=1e-8)
    assert ocp.definition.phases[0].state_names == ("q[0]", "q[1]")


@pytest.mark.parametrize(
    "rate",
    [
        lambda v, u: [v, u],
        lambda v, u: (v, u),
        lambda v, u: np.array([v, u]),
        lambda v, u: np.array([v / 2, u]) * np.array([2, 1]),
        lambda v, u: casadi.vertcat(v, u),
        lambda v, u: casadi.horzcat(v, u).T,
    ],
)
def test_lists_and_arrays_of_expressions_are_columns(rate):
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    q, u = phase.state("q", 2), phase.control("u")
    phase.dynamics({q: rate(q[1], u)})
    phase.path([q[0], 2 * u], lower=[0, 1])
    ocp.subject_to(np.array([phase.final(q)[0], phase.end]), equals=[1, 1])
    ocp.minimise(phase.end)
    rates, path, *_ = at_instant(ocp, x=[3, 5], u=[7])
    assert rates.tolist() == [5, 7] and path.tolist() == [3, 14]


def test_a_number_is_the_rate_of_every_entry():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    q, w = phase.state("q", 3), phase.state("w", 2)
    phase.dynamics({"q": 2})
    phase.dynamics({w: np.array([1.0, 4.0])})
    ocp.minimise(phase.final(q[0] + w[0]))
    assert at_instant(ocp, x=np.zeros(5))[0].tolist() == [2, 2, 2, 1, 4]


#: CasADi announces once that NumPy's functions on its symbols may come to mean more.
@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_functions_written_for_numpy_take_symbols():
    def pendulum(angle, rate, torque):
        return rate, -np.sin(angle) - 0.1 * np.sqrt(1 + rate**2) + np.float64(2) * torque

    ocp = OptimalControlProblem()
    phase = ocp.phase()
    a, w, u = phase.state("a"), phase.state("w"), phase.control("u")
    phase.dynamics(dict(zip((a, w), pendulum(a, w, u), strict=True)))
    ocp.minimise(phase.end)
    assert at_instant(ocp, x=[0.3, 2.0], u=[0.7])[0] == pytest.approx(pendulum(0.3, 2.0, 0.7))


@pytest.mark.parametrize(
    ("relation", "values", "lower", "upper"),
    [
        (lambda x, y, p: x**2 + y**2 >= 1, [13], [1], [INF]),
        (lambda x, y, p: x <= 1, [2], [-INF], [1]),
        (lambda x, y, p: x < 1, [2], [-INF], [1]),
        (lambda x, y, p: x >= 1, [2], [1], [INF]),
        (lambda x, y, p: np.float64(1) >= x, [2], [-INF], [1]),
        (lambda x, y, p: x == 4, [2], [4], [4]),
        (lambda x, y, p: np.float64(4) == x, [2], [4], [4]),
        (lambda x, y, p: x <= p * y, [2 - 15], [-INF], [0]),
        (lambda x, y, p: x >= p, [5 - 2], [-INF], [0]),
        (lambda x, y, p: x == y, [-1], [0], [0]),
        (lambda x, y, p: x - 1 >= 2 * y - 4, [6 - 4 - (2 - 1)], [-INF], [0]),
        (lambda x, y, p: casadi.vertcat(x, y) <= np.array([1, INF]), [2, 3], [-INF, -INF], [1, INF]),
        (lambda x, y, p: np.array([0, -INF]) <= casadi.vertcat(x, y), [2, 3], [0, -INF], [INF] * 2),
        (lambda x, y, p: x <= np.array([1, 2]), [2, 2], [-INF, -INF], [1, 2]),
        (lambda x, y, p: casadi.vertcat(x, y) >= 0, [2, 3], [0, 0], [INF, INF]),
        (lambda x, y, p: casadi.vertcat(x, y) <= p, [2 - 5, 3 - 5], [-INF, -INF], [0, 0]),
    ],
)  # fmt: skip
def test_relations_are_bounds(relation, values, lower, upper):
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, y, p = phase.state("x"), phase.state("y"), ocp.parameter("p")
    phase.dynamics({x: 0, y: 0})
    phase.path(relation(x, y, p))
    ocp.subject_to(relation(phase.final(x), phase.initial(y), p))
    ocp.minimise(phase.end)
    path, boundary = ocp.definition.phases[0].paths[0], ocp.definition.boundaries[0]
    for one in (path, boundary):
        assert one.lower.tolist() == lower and one.upper.tolist() == upper
    assert at_instant(ocp, x=[2, 3], p=[5])[1].tolist() == values
    ends = [0, 1, 9, 3, 2, 9]  # t0, tf, x0, xf
    assert np.array(ocp.definition.endpoint(ends, 5)[1]).ravel().tolist() == values


def test_a_constraint_without_a_limit_limits_nothing():
    free = rest_to_rest()
    free.phase.path(free.x, upper=INF, name="no limit")
    free.phase.path(free.x <= INF)
    free.ocp.subject_to(free.phase.final(free.x), lower=-INF)
    assert solve(free.ocp).primal_bound == pytest.approx(12, rel=1e-9)


def test_equations_on_the_way_hold_at_every_instant():
    """Two accelerations must agree, so the effort is counted twice."""
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    u, w = phase.control("u"), phase.control("w")
    phase.dynamics({x: v, v: u})
    phase.path(u == w, name="alike", equation="3", unit="N")
    ocp.minimise(phase.integral(u**2 + w**2), unit="J")
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(24, rel=1e-9)
    (check,) = [one for one in found.verification.checks if one.name == "alike"]
    assert check.ok and check.equation == "3" and check.unit == "N"
    assert ocp.definition.objective_unit == "J"


def test_integrals_enter_constraints():
    """Among curves over [0, 1] that enclose the area 1, x = 6t (1 - t) has the least ∫ x'²."""
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, u = phase.state("x", initial=0, final=0), phase.control("u")
    phase.dynamics({x: u})
    ocp.subject_to(phase.integral(x) == 1, name="area")
    ocp.minimise(phase.integral(u**2))
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(12, rel=1e-9)
    assert found.plan["x"](0.5) == pytest.approx(1.5, abs=1e-8)


def test_integrals_enter_the_objective_through_functions():
    bent = rest_to_rest()
    effort = bent.phase.integral(bent.u**2)
    bent.ocp.minimise(casadi.sqrt(4 + effort) + effort * bent.phase.end)
    assert solve(bent.ocp).primal_bound == pytest.approx(4 + 12, rel=1e-8)


def test_parameters_are_chosen_with_the_motion():
    """x' = a + b t from 0: (x(1) - 3)² + a² + b², least for a = 4/3, b = 2/3, at 4."""
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x = phase.state("x", initial=0)
    p = ocp.parameter("p", 2, guess=[5, 5], unit="m/s")
    phase.dynamics({x: p[0] + p[1] * phase.time})
    ocp.minimise((phase.final(x) - 3) ** 2 + casadi.sumsqr(p))
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(4, rel=1e-9)
    assert found.plan.parameters["p"] == pytest.approx([4 / 3, 2 / 3], abs=1e-8)
    assert ocp.definition.parameter_names == ("p[0]", "p[1]")


def test_a_bounded_parameter_starts_in_the_middle_and_stays_inside():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x = phase.state("x", initial=0)
    p, q, r = ocp.parameter("p", lower=0, upper=1), ocp.parameter("q", lower=2), ocp.parameter("r")
    phase.dynamics({x: p})
    ocp.minimise((phase.final(x) - 3) ** 2 + (q - 5) ** 2 + r**2)
    starts = [one.initial_lower.tolist() for one in ocp.definition.parameters]
    assert starts == [[0.5], [2], [0]]
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(4, abs=1e-6)
    assert found.plan.parameters["q"] == pytest.approx([5], abs=1e-6)


def test_free_times_at_both_ends():
    """x' = u t with |u| <= 1: late is fast, so the start waits as long as it may."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=((0, 1), (0.5, 3)), unit="h")
    x = phase.state("x", initial=0, final=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u * phase.time})
    ocp.minimise(phase.duration)
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(math.sqrt(3) - 1, abs=1e-6)
    assert (found.plan.start, found.plan.end) == pytest.approx((1, math.sqrt(3)), abs=1e-6)


def test_motion_without_controls_and_cost_without_integrals():
    """x' = -2 t x, so x(0) = e x(1)."""
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x = phase.state("x")
    phase.dynamics({x: -2 * phase.time * x})
    ocp.subject_to(phase.final(x) >= 1)
    ocp.minimise(phase.initial(x))
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(math.e, abs=1e-8)
    assert found.plan.phases[0].controls.size == 0
    t = np.linspace(0, 1, 5)
    assert found.plan["x"](t) == pytest.approx(np.exp(1 - t**2), abs=1e-7)
    again = ocp.plan_from_data(json.loads(json.dumps(ocp.plan_to_data(found.plan))))
    assert ocp.verify(again).ok


def test_a_constant_objective_asks_for_any_plan():
    some = rest_to_rest()
    some.ocp.minimise(3)
    assert solve(some.ocp).primal_bound == 3


def test_time_at_the_ends_is_that_of_the_ends():
    timed = open_problem(time=(2, (3, 4)))
    timed.phase.dynamics({timed.x: timed.v, timed.v: timed.u})
    phase = timed.phase
    timed.ocp.minimise(100 * phase.final(phase.time) + phase.initial(phase.time * 10 + timed.x))
    ends = [2, 3.5, 7, 8, 9, 10]  # t0, tf, x0, v0, xf, vf
    assert float(timed.ocp.definition.endpoint(ends, [])[0]) == 350 + 20 + 7


# -- several phases ----------------------------------------------------------------------------------


def two_phases(time=1.0, *, named=(), **link):
    ocp = OptimalControlProblem("two phases")
    parts = []
    for name, times, ends in (
        ("go", (0, time), {"initial": [0, 0]}),
        ("stop", (time, 2), {"final": [1, 0]}),
    ):
        phase = ocp.phase(name, time=times)
        q = phase.state("q", 2, **ends)
        w = phase.state("w", **({"initial": 0} if name == "go" else {}))
        u = phase.control("u")
        phase.dynamics({q: [q[1], u], w: u**2})
        parts.append(SimpleNamespace(phase=phase, q=q, w=w, u=u))
    go, stop = parts
    ocp.link(go.phase, stop.phase, *named)
    ocp.minimise(stop.phase.final(stop.w))
    return ocp, go, stop


@pytest.mark.parametrize("time", [0.7, (0.2, 1.5)], ids=["fixed", "free"])
def test_linked_phases_are_one_motion(time):
    ocp, *_ = two_phases(time)
    found = solve(ocp)
    assert found.primal_bound == pytest.approx(12 / 8, rel=1e-8)
    first, second = found.plan
    assert first.end == pytest.approx(second.start, abs=1e-9)
    assert first["q"](first.end) == pytest.approx(second["q"](second.start), abs=1e-8)
    assert second["w"](2.0) == pytest.approx(1.5, abs=1e-7)
    assert found.plan.phase("stop") is second and (found.plan.start, found.plan.end) == (0, 2)


def test_links_may_be_declared_state_by_state():
    ocp, go, stop = two_phases((0.2, 1.5), named=["q"])
    ocp.link(go.phase, stop.phase, "w")
    names = [one.name for one in ocp.definition.boundaries]
    assert names == [
        "q goes on from go to stop",
        "time goes on from go to stop",
        "w goes on from go to stop",
    ]
    assert solve(ocp).primal_bound == pytest.approx(1.5, rel=1e-8)


def test_phases_may_be_joined_by_hand():
    """A jump of the speed by one between two phases costs what it costs: x goes from 0 to 2."""
    ocp = OptimalControlProblem()
    a, b = ocp.phase("a", time=(0, 1)), ocp.phase("b", time=(1, 2))
    x, y = a.state("x", initial=0), b.state("y", final=2)
    u, w = a.control("u"), b.control("w")
    a.dynamics({x: u})
    b.dynamics({y: w})
    ocp.subject_to(b.initial(y) - a.final(x) == 1, name="jump")
    ocp.minimise(a.integral(u**2) + b.integral(w**2))
    assert solve(ocp).primal_bound == pytest.approx(0.5, rel=1e-9)


# -- interpolants, invariants ------------------------------------------------------------------------


def interpolated():
    grid = np.linspace(-2, 2, 21)
    table = casadi.interpolant("table", "bspline", [grid], np.sin(grid))
    ocp = OptimalControlProblem("interpolated")
    phase = ocp.phase()
    x, u = phase.state("x", initial=1), phase.control("u", lower=-2, upper=2)
    phase.dynamics({x: -table(x) + u})
    ocp.minimise(phase.integral(x**2 + u**2))
    return ocp


def test_an_interpolant_works_though_it_has_no_scalar_form():
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


def test_a_digest_does_not_hang_on_what_was_solved_before():
    """A table that was differentiated once writes its derivatives with itself."""
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


def test_what_is_no_invariant_is_found_out():
    found = ct.solve(turning(lambda q, t: q[0] + 0 * t), formulation_options={"refine": False})
    assert found.termination == "rejected" and found.plan is None
    assert "norm" in found.message


# -- scales and defaults -------------------------------------------------------------------------------


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


def test_scales_change_the_search_alone():
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


# -- guesses -------------------------------------------------------------------------------------------


def guessed(problem):
    """The guess as functions of the fraction of the phase."""
    guess = problem.definition.phases[0].guess

    def at(fraction):
        states, controls = (
            [np.interp(fraction, guess.fractions, column) for column in table.T]
            for table in (guess.states, guess.controls)
        )
        return states + controls

    return at


def test_without_a_guess_lines_join_what_is_fixed():
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
def test_another_answer_is_a_guess(answer, what):
    source = {"solution": answer, "plan": answer.plan, "phase": answer.plan.phases[0]}[what]
    again = rest_to_rest()
    again.phase.guess(source)
    assert guessed(again.ocp)(0.5) == pytest.approx([0.5, 1.5, 0], abs=1e-3)


def test_the_plan_of_another_problem_gives_what_it_has(answer):
    other = OptimalControlProblem()
    phase = other.phase("its own name", time=(0, (2, 5)))
    y, x = phase.state("y", initial=7), phase.state("x")
    w = phase.control("w")
    phase.dynamics({x: w, y: x})
    other.minimise(phase.end)
    phase.guess(answer.plan, w=4)
    assert guessed(other)(0.5) == pytest.approx([7, 0.5, 4], abs=1e-3)
    assert other.definition.phases[0].guess.end == 2  # 1, moved to where it may be


def test_a_guess_of_several_phases_is_taken_by_name():
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


def test_a_warm_start_is_a_plan_of_the_problem(answer):
    ocp = rest_to_rest().ocp
    warm = ct.solve(ocp, warm_start=answer, formulation_options=COARSE)
    assert warm.primal_bound == pytest.approx(12, rel=1e-9)
    with pytest.raises(InvalidData, match="phases of the plan must be"):
        ct.solve(two_phases()[0], warm_start=answer)
    far = rest_to_rest()
    far.phase.path(far.v <= 1, name="slow")
    with pytest.raises(InvalidData, match="warm_start is no plan of the model: violated: slow"):
        ct.solve(far.ocp, warm_start=answer)


# -- declaring more ------------------------------------------------------------------------------------


def test_declaring_more_makes_another_problem():
    grown = rest_to_rest()
    first = grown.ocp.digest
    assert solve(grown.ocp).primal_bound == pytest.approx(12, rel=1e-9)
    grown.phase.path(grown.u <= 5, name="weak")
    second = grown.ocp.digest
    assert second != first
    found = solve(grown.ocp)
    assert found.primal_bound > 12.01 and found.digest == second
    grown.ocp.minimise(grown.phase.integral(grown.u**2) + 1)
    assert solve(grown.ocp).primal_bound == pytest.approx(found.primal_bound + 1, rel=1e-6)
    assert grown.ocp.digest not in (first, second)


def test_what_was_refused_leaves_no_trace():
    part = rest_to_rest()
    before = part.ocp.digest
    for attempt in (
        lambda: part.phase.state("z", initial="a"),
        lambda: part.phase.state("y", scale=-1),
        lambda: part.phase.control("w", lower=2, upper=1),
        lambda: part.phase.dynamics({part.x: 1}),
        lambda: part.phase.path(part.x),
        lambda: part.phase.invariant("i", part.u),
        lambda: part.phase.integral([1, 2]),
        lambda: part.phase.guess(x="a"),
        lambda: part.ocp.parameter("p", guess=NAN),
        lambda: part.ocp.phase("late", time=(2, 1)),
        lambda: part.ocp.subject_to(part.phase.final(part.x)),
        lambda: part.ocp.minimise("x"),
    ):
        with pytest.raises(InvalidData):
            attempt()
    assert part.ocp.digest == before
    part.phase.state("z", initial=0)
    part.phase.dynamics({"z": 1})
    assert part.ocp.digest != before


def test_a_finished_definition_is_closed():
    first = rest_to_rest()
    copied = OptimalControlProblem("copy", definition=first.ocp.definition)
    assert copied.digest == first.ocp.digest and copied.name == "copy"
    for closed in (copied, first.ocp.renamed("other"), copy.deepcopy(first.ocp)):
        assert isinstance(closed, OptimalControlProblem)
        assert not any(
            hasattr(closed, name) for name in ("phase", "parameter", "minimise", "link", "build")
        )
    first.phase.path(first.x <= 2)
    assert copied.digest != first.ocp.digest


def test_words_for_people():
    part = open_problem()
    assert part.ocp.describe() == "being declared" and "being declared" in repr(part.ocp)
    assert "2 states" in repr(rest_to_rest().ocp.renamed("r"))


# -- digests and round trips ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "trip",
    [
        lambda m: Model.from_json(m.to_json()),
        lambda m: Model.from_json(m.to_json(indent=1)),
        lambda m: Model.from_dict(json.loads(json.dumps(m.to_dict()))),
        lambda m: pickle.loads(pickle.dumps(m)),
        lambda m: cloudpickle.loads(cloudpickle.dumps(m)),
        copy.copy,
        copy.deepcopy,
        lambda m: m.renamed("another name"),
        lambda m: Model.from_json(Model.from_json(m.to_json()).to_json()),
    ],
)
def test_round_trips_keep_the_digest(trip, answer):
    ocp = rest_to_rest().ocp
    again = trip(ocp)
    assert again.digest == ocp.digest
    assert again.verify(answer.plan).objective == ocp.verify(answer.plan).objective


def everything(twenty):
    """A problem with all kinds of declarations, and a number written one way or another."""
    ocp = OptimalControlProblem("everything")
    first = ocp.phase("first", time=(0, (1, twenty)), equation="2")
    x = first.state("x", 2, initial=[0, 0], upper=twenty, unit="m")
    u = first.control("u", lower=-1, upper=1)
    p = ocp.parameter("p", lower=0, upper=twenty)
    first.dynamics({x: casadi.vertcat(x[1], u * twenty - p * x[0])})
    first.path(x[0] ** 2 + u**2 <= twenty, name="tube")
    first.invariant("nothing", p * first.time * 0, scale=twenty)
    second = ocp.phase("second", time=((1, twenty), twenty))
    y = second.state("x", 2, final=[1, 0])
    second.dynamics({y: [y[1], twenty]})
    second.guess(x=[[0, 0], [1, twenty]])
    ocp.link(first, second)
    ocp.subject_to(first.integral(u**2) <= twenty)
    ocp.minimise(first.integral(u**2) + second.final(y[0]) + twenty * p)
    return ocp


def test_twenty_is_twenty():
    digests = {everything(one).digest for one in (20, 20.0, np.float64(20), np.int64(20))}
    assert len(digests) == 1
    assert everything(21).digest not in digests


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.phase.path(d.x <= 9),
        lambda d: d.ocp.subject_to(d.phase.final(d.x) <= 9),
        lambda d: d.phase.guess(x=0.5),
        lambda d: d.ocp.parameter("p"),
        lambda d: d.phase.invariant("i", d.x * 0),
        lambda d: d.ocp.minimise(d.phase.integral(d.u**2), unit="J"),
        lambda d: d.ocp.minimise(d.phase.integral(d.u**2 * (1 + 1e-15))),
    ],
)
def test_every_declaration_is_part_of_the_digest(change):
    part = rest_to_rest()
    before = part.ocp.digest
    change(part)
    assert part.ocp.digest != before


def test_a_fresh_process_draws_up_the_same_problem(run_python, tmp_path):
    ocp = everything(20)
    (tmp_path / "model.pickle").write_bytes(pickle.dumps(ocp))
    (tmp_path / "model.json").write_text(ocp.to_json(), "utf-8")
    script = f"""\
import pathlib, pickle, casadi, numpy as np, crosstrack as ct
from crosstrack.models import OptimalControlProblem

{inspect.getsource(everything)}

print(pickle.loads(pathlib.Path("model.pickle").read_bytes()).digest)
print(ct.load("model.json").digest)
print(everything(20).digest)
"""
    (tmp_path / "script.py").write_text(script, "utf-8")
    assert run_python("script.py", cwd=tmp_path).split() == [ocp.digest] * 3


def test_workers_solve_what_was_declared_here():
    ocp = interpolated()
    verdict = ct.compare([ocp], ["ipopt", "sqpmethod"], time_limit=60)
    assert len(verdict.solutions) == 2
    for one in verdict.solutions:
        assert one.digest == ocp.digest
        assert one.primal_bound == pytest.approx(0.408401, abs=2e-5), str(one)


def test_a_problem_is_read_from_its_file(tmp_path):
    ocp = everything(20)
    file = tmp_path / "mine.json"
    file.write_text(ocp.to_json(indent=1), "utf-8")
    again = ct.load(file)
    assert isinstance(again, OptimalControlProblem) and again.digest == ocp.digest
    assert again.name == "everything"


# -- plans ---------------------------------------------------------------------------------------------


def test_plans_are_functions_of_time(answer):
    plan = answer.plan
    assert plan["x"](0.25) == pytest.approx(0.15625, abs=1e-8)
    assert np.ndim(plan["x"](0.25)) == 0
    t = np.array([[0.0, 0.2], [0.7, 1.0]])
    assert plan["v"](t) == pytest.approx(6 * t - 6 * t**2, abs=1e-7)
    assert plan["x"](t, derivative=1) == pytest.approx(plan["v"](t), abs=1e-6)
    assert plan["x"](t, 2) == pytest.approx(6 - 12 * t, abs=1e-4)
    assert plan["u"](t) == pytest.approx(6 - 12 * t, abs=1e-6)
    assert plan.grid(3).tolist() == [0, 0.5, 1] and plan["x"]([]).shape == (0,)
    # Rounding beyond the ends is forgiven, more is not.
    assert plan["x"](1 + 1e-12) == plan["x"](1.0)


@pytest.mark.parametrize(
    ("ask", "error", "words"),
    [
        (lambda p: p["x"](1.1), InvalidData, ["t must lie in [0, 1]", "1.1"]),
        (lambda p: p["x"]([0.5, -0.2]), InvalidData, ["t must lie in [0, 1]", "-0.2"]),
        (lambda p: p["x"](NAN), InvalidData, ["t must lie in", "nan"]),
        (lambda p: p["x"]("noon"), InvalidData, ["t must be numbers", "'noon'"]),
        (lambda p: p["x"](0.5, -1), InvalidData, ["derivative must be >= 0", "-1"]),
        (lambda p: p["x"](0.5, 0.5), InvalidData, ["derivative must be a whole number", "0.5"]),
        (lambda p: p["y"], UnknownName, ["state or control", "'y'", "u, v, x"]),
        (lambda p: p["x[0]"], UnknownName, ["'x[0]'"]),
        (lambda p: p.phase("no"), UnknownName, ["phase", "'no'", "phase 1"]),
        (lambda p: ControlPlan(p.phases * 2)["x"], InvalidData, ["the plan has 2 phases", "ask one"]),
        (lambda p: ControlPlan(p.phases * 2).grid(), InvalidData, ["the plan has 2 phases"]),
        (lambda p: ControlPlan(()), InvalidData, ["phases", "1 PhasePlan at least"]),
        (lambda p: ControlPlan((3,)), InvalidData, ["phases", "PhasePlan", "3"]),
        (lambda p: ControlPlan(p.phases, {"p": "a"}), InvalidData, ["parameter 'p'", "numbers", "'a'"]),
    ],
)  # fmt: skip
def test_plans_say_what_they_cannot_answer(answer, ask, error, words):
    with pytest.raises(error) as caught:
        ask(answer.plan)
    assert all(word in str(caught.value) for word in words), caught.value


def test_controls_saturate_where_they_are_bounded():
    part = Piecewise(
        [0.0, 1], (np.array([-1.0, 0, 1]),), (np.array([[0.0], [2], [0]]),), [0.0], [1.5]
    )
    assert part([0.5, 0.0]).ravel().tolist() == [1.5, 0]
    assert part(0.5, 1).tolist() == [0]  # the polynomial's own


def test_plans_in_json_are_exact(answer):
    ocp = rest_to_rest().ocp
    data = json.loads(json.dumps(ocp.plan_to_data(answer.plan), allow_nan=False))
    again = ocp.plan_from_data(data)
    t = np.linspace(0, 1, 50)
    for name in "xvu":
        assert (again[name](t) == answer.plan[name](t)).all()
    assert again.phases[0].costates is not None
    assert ocp.verify(again) == ocp.verify(answer.plan)
    assert ct.verify(ocp, data).ok
    assert ocp.plan_to_data(again) == data


def test_plans_with_parameters_and_phases_in_json():
    ocp, *_ = two_phases((0.2, 1.5))
    knots = np.array([0.0, 1])
    part = Piecewise(knots, (np.array([-1.0, 1]),), (np.zeros((2, 3)),))
    none = Piecewise(knots, (np.array([0.0]),), (np.zeros((1, 1)),), [-INF], [2.0])
    names = ("q[0]", "q[1]", "w")
    plan = ControlPlan(
        (PhasePlan("go", part, none, names, ("u",)), PhasePlan("stop", part, none, names, ("u",))),
        {"p": [1.0, 2.0], "r": 3.0},
    )
    again = ControlPlan.from_data(json.loads(json.dumps(plan.to_data(), allow_nan=False)))
    assert again.to_data() == plan.to_data()
    assert again.parameters["p"].tolist() == [1, 2] and again.parameters["r"].tolist() == [3]
    with pytest.raises(InvalidData, match="parameters of the plan must be"):
        ocp.verify(again)


def bad_plans():
    """Changes of a plan's data, and the words of what is said about each."""

    def put(*path):
        *inner, last, value = path

        def change(data):
            at = data
            for key in inner:
                at = at[key]
            if value is ...:
                del at[last]
            else:
                at[last] = value

        return change

    one = ("phases", 0)
    return [
        (put("phases", []), ["phases"]),
        (put("phases", 3), ["phases must be a list", "3"]),
        (put("phases", ...), ["a plan must be an object with phases"]),
        (put("parameters", [1]), ["parameters must be an object"]),
        (put("parameters", {"p": [1]}), ["parameters of the plan must be []", "'p'"]),
        (put(*one, "name", "b"), ["phases of the plan must be ['phase 1']", "'b'"]),
        (put(*one, "name", 3), ["name must be a string", "3"]),
        (put(*one, "knots", [0, 0, 0, 0]), ["knots must increase"]),
        (put(*one, "knots", ["a", "b"]), ["knots", "number", "'a'"]),
        (put(*one, "knots", [0, 1]), ["1 intervals need as many nodes"]),
        (put(*one, "state_names", 3), ["state_names must hold strings", "3"]),
        (put(*one, "state_names", ["x"]), ["states has 2 columns for 1 names"]),
        (put(*one, "state_names", ["v", "x"]), ["state_names", "['x', 'v']", "['v', 'x']"]),
        (put(*one, "control_names", ["w"]), ["control_names", "['u']", "['w']"]),
        (put(*one, "states", 3), ["states must be an object"]),
        (put(*one, "states", "nodes", 3), ["nodes must be a list"]),
        (put(*one, "states", "nodes", 0, 0, -2), ["nodes[0]", ">= -1", "-2"]),
        (put(*one, "states", "values", 0, 0, 0, None), ["values[0][0, 0] must be a number", "None"]),
        (put(*one, "states", "values", 0, 0, 0, NAN), ["values[0]", "finite"]),
        (put(*one, "states", "values", 0, 0, 0, "1"), ["values[0][0, 0] must be a number", "'1'"]),
        (put(*one, "controls", "values", 0, [[1]]), ["values[0] has 1 entries"]),
        (put(*one, "extra", 1), ["a phase of a plan has the keys"]),
    ]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), bad_plans())
def test_a_wrong_plan_is_no_plan(answer, change, words):
    ocp = rest_to_rest().ocp
    data = copy.deepcopy(ocp.plan_to_data(answer.plan))
    change(data)
    with pytest.raises(InvalidData) as caught:
        ct.verify(ocp, data)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize("plan", [3, "plan", None, np.zeros(3), {"phases": None}, []])
def test_what_is_no_plan_is_not_verified(plan):
    with pytest.raises(InvalidData):
        ct.verify(rest_to_rest().ocp, plan)


# -- bad input -----------------------------------------------------------------------------------------


def phase_with(**options):
    return lambda d: OptimalControlProblem().phase(**options)


def state_with(*arguments, **options):
    return lambda d: d.phase.state(*arguments, **options)


def second_phase(d, time=(1, 2), size=1):
    """Another phase with a state x."""
    phase = d.ocp.phase("second", time=time)
    x = phase.state("x", size)
    return SimpleNamespace(phase=phase, x=x)


def after_dynamics(do):
    """Declare the dynamics, then the rest."""

    def declared(d):
        d.phase.dynamics({d.x: d.v, d.v: d.u})
        do(d)

    return declared


REFUSED = {
    # Times.
    "unbounded end": (phase_with(time=(0, None)), ["end of phase 'phase 1' is free", "(lower, upper)"]),
    "half unbounded end": (phase_with(time=(0, (1, INF))), ["end of phase 'phase 1' is free between 1 and inf", "finite"]),
    "open end": (phase_with(time=(0, (None, None))), ["free between -inf and inf", "finite bounds"]),
    "infinite start": (phase_with(time=(-INF, 1)), ["start of phase 'phase 1'", "finite", "-inf"]),
    "backwards": (phase_with(time=(1, 0)), ["must go forward", "start 1", "end 0"]),
    "no length": (phase_with(time=(1, 1)), ["must go forward"]),
    "backwards range": (phase_with(time=(0, (2, 1))), ["end of phase 'phase 1'", "lower 2 exceeds upper 1"]),
    "one time": (phase_with(time=5), ["must be (start, end)", "5"]),
    "three times": (phase_with(time=(0, 1, 2)), ["must be (start, end)"]),
    "range of three": (phase_with(time=(0, (1, 2, 3))), ["a number or (lower, upper)", "(1, 2, 3)"]),
    "time as text": (phase_with(time=(0, "1")), ["end of phase", "number", "'1'"]),
    "time as truth": (phase_with(time=(0, True)), ["end of phase", "number", "True"]),
    "NaN time": (phase_with(time=(0, NAN)), ["end of phase", "nan"]),
    "symbol as time": (phase_with(time=(0, casadi.MX.sym("T"))), ["end of phase", "MX(T)"]),
    "unit of time": (phase_with(unit=3), ["unit of phase 'phase 1' must be a string", "3"]),
    "equation": (phase_with(equation=3), ["equation of phase 'phase 1' must be a string"]),
    # Names and sizes.
    "no name": (state_with(""), ["a state must have a name", "''"]),
    "number as name": (state_with(3), ["name", "3"]),
    "brackets": (state_with("q[0]"), ["without brackets", "'q[0]'"]),
    "same state": (state_with("x"), ["state 'x' is declared already"]),
    "control like state": (lambda d: d.phase.control("x"), ["control 'x' is declared already"]),
    "same phase": (lambda d: d.ocp.phase("phase 1"), ["phase 'phase 1' is declared already"]),
    "same parameter": (lambda d: (d.ocp.parameter("p"), d.ocp.parameter("p")), ["parameter 'p' is declared already"]),
    "size 0": (state_with("q", 0), ["size of 'q'", "from 1 to", "got 0"]),
    "size -1": (state_with("q", -1), ["size of 'q'", "got -1"]),
    "size 2.0": (state_with("q", 2.0), ["whole number", "2.0"]),
    "size true": (state_with("q", True), ["whole number", "True"]),
    "endless size": (state_with("q", 10**9), ["size of 'q'", "1000000000"]),
    "no parameter": (lambda d: d.ocp.parameter("p", 0), ["size of 'p'"]),
    "unit of a state": (state_with("q", unit=3), ["unit of 'q' must be a string", "3"]),
    "name of a problem": (lambda d: OptimalControlProblem(3), ["name must be a string", "3"]),
    # Values.
    "ambiguous tuple": (state_with("q", 2, initial=(0, 1)), ["two values or a range", "write a list", "(0, 1)"]),
    "lower above upper": (state_with("q", lower=2, upper=1), ["bounds of 'q'", "lower 2 exceeds upper 1"]),
    "initial outside": (state_with("q", initial=3, upper=1), ["initial value of 'q'", "[-inf, 1]", "got 3"]),
    "final range outside": (state_with("q", final=(2, 3), upper=1), ["final value of 'q'", "got 2 to 3"]),
    "backwards initial": (state_with("q", initial=(2, 1)), ["initial value of 'q'", "lower 2 exceeds upper 1"]),
    "NaN initial": (state_with("q", initial=NAN), ["initial value of 'q'", "nan"]),
    "infinite initial": (state_with("q", initial=INF), ["initial value of 'q' must be finite", "inf"]),
    "initial from infinity": (state_with("q", initial=(INF, INF)), ["lower end of initial value of 'q'", "inf"]),
    "text": (state_with("q", initial="0"), ["initial value of 'q' must be a number", "'0'"]),
    "text in a list": (state_with("q", 2, lower=[0, "1"]), ["lower bound of 'q'", "'1'"]),
    "truth": (state_with("q", lower=True), ["lower bound of 'q'", "True"]),
    "truth in a list": (state_with("q", 2, lower=[0.0, True]), ["lower bound of 'q'", "True"]),
    "None in a list": (state_with("q", 2, lower=[0.0, None]), ["lower bound of 'q'", "None"]),
    "complex": (state_with("q", initial=1j), ["initial value of 'q'", "1j"]),
    "symbol as bound": (lambda d: d.phase.state("q", upper=d.x), ["upper bound of 'q'", "MX(x)"]),
    "lower at infinity": (state_with("q", lower=INF), ["lower bound of 'q' must be finite or -inf"]),
    "upper at -infinity": (state_with("q", upper=-INF), ["upper bound of 'q' must be finite or inf"]),
    "too many": (state_with("q", 2, lower=[0, 1, 2]), ["lower bound of 'q'", "a number or 2", "(3,)"]),
    "a table": (state_with("q", 2, lower=[[0, 1]]), ["lower bound of 'q'", "(1, 2)"]),
    "tuple of one": (state_with("q", initial=(1,)), ["number or a range (lower, upper)", "(1,)"]),
    "tuple of three": (state_with("q", initial=(1, 2, 3)), ["number or a range (lower, upper)", "(1, 2, 3)"]),
    "scale 0": (state_with("q", scale=0), ["scale of 'q'", "> 0", "got 0"]),
    "scale -1": (state_with("q", 2, scale=[1, -1]), ["scale of 'q'", "> 0"]),
    "infinite scale": (state_with("q", scale=INF), ["scale of 'q' must be finite"]),
    "control bounds": (lambda d: d.phase.control("w", lower=2, upper=1), ["bounds of 'w'", "lower 2 exceeds upper 1"]),
    "parameter bounds": (lambda d: d.ocp.parameter("p", lower=2, upper=1), ["bounds of 'p'", "lower 2 exceeds upper 1"]),
    "parameter guess outside": (lambda d: d.ocp.parameter("p", guess=5, upper=1), ["guess of 'p'", "[-inf, 1]", "got 5"]),
    "infinite parameter guess": (lambda d: d.ocp.parameter("p", guess=INF), ["guess of 'p' must be finite", "inf"]),
    "parameter guess as text": (lambda d: d.ocp.parameter("p", guess="5"), ["guess of 'p'", "'5'"]),
    # Dynamics.
    "state without dynamics": (lambda d: (d.phase.dynamics({d.x: d.v}), d.ocp.minimise(1)), ["phase 'phase 1'", "no dynamics for state 'v'"]),
    "dynamics of a stranger": (lambda d: d.phase.dynamics({"z": d.v}), ["dynamics of 'z'", "states 'x', 'v'"]),
    "dynamics of a control": (lambda d: d.phase.dynamics({d.u: d.v}), ["dynamics of 'u'", "states 'x', 'v'"]),
    "dynamics of an entry": (lambda d: d.phase.dynamics({d.phase.state("q", 2)[0]: 1}), ["dynamics of 'q[0]'", "states"]),
    "dynamics twice": (lambda d: (d.phase.dynamics({d.x: d.v}), d.phase.dynamics({"x": 0})), ["dynamics of 'x' are declared already"]),
    "dynamics twice at once": (lambda d: d.phase.dynamics({d.x: d.v, "x": 0}), ["dynamics of 'x' are declared already"]),
    "no mapping": (lambda d: d.phase.dynamics([d.v, d.u]), ["must map states to their rates"]),
    "rate too long": (lambda d: d.phase.dynamics({d.x: [d.v, d.u]}), ["dynamics of 'x' must have 1 entry", "got 2"]),
    "rate too short": (lambda d: d.phase.dynamics({d.phase.state("q", 3): [d.v, d.u]}), ["dynamics of 'q' must have 3 entries", "got 2"]),
    "symbol as rate of a vector": (lambda d: d.phase.dynamics({d.phase.state("q", 3): d.v}), ["dynamics of 'q' must have 3 entries", "got 1"]),
    "rate as text": (lambda d: d.phase.dynamics({d.x: "v"}), ["dynamics of 'x'", "CasADi expression", "'v'"]),
    "rate None": (lambda d: d.phase.dynamics({d.x: None}), ["dynamics of 'x'", "None"]),
    "rate true": (lambda d: d.phase.dynamics({d.x: True}), ["dynamics of 'x'", "True"]),
    "rate NaN": (lambda d: d.phase.dynamics({d.x: NAN}), ["dynamics of 'x'", "nan"]),
    "NaN in a rate": (lambda d: (d.phase.dynamics({d.x: d.v * NAN, d.v: d.u}), d.ocp.minimise(1)), ["rate", "nan"]),
    "SX rate": (lambda d: d.phase.dynamics({d.x: casadi.SX.sym("a")}), ["dynamics of 'x'", "(MX)", "SX(a)"]),
    "symbol from nowhere": (lambda d: (d.phase.dynamics({d.x: d.v, d.v: casadi.MX.sym("a")}), d.ocp.minimise(1)), ["phase 'phase 1'", "rate", "'a'", "no state, control, time or parameter"]),
    "symbol of another problem": (lambda d: (d.phase.dynamics({d.x: d.v, d.v: rest_to_rest().u}), d.ocp.minimise(1)), ["rate uses 'u'", "of this phase"]),
    "key of another problem": (lambda d: d.phase.dynamics({rest_to_rest().x: d.v}), ["dynamics of 'x'", "another phase's or problem's"]),
    "integral as a rate": (lambda d: (d.phase.dynamics({d.x: d.v, d.v: d.phase.integral(d.x)}), d.ocp.minimise(1)), ["rate uses 'integral 1 of phase 1'"]),
    # Constraints.
    "path without bounds": (lambda d: d.phase.path(d.x), ["path constraint 'path 1' needs a bound", "x <= 1"]),
    "path that is always so": (lambda d: d.phase.path(d.x**2 >= 0), ["needs a bound", "the constant"]),
    "bounds twice": (lambda d: d.phase.path(d.x <= 1, upper=2), ["a relation has its bounds in itself"]),
    "equals and upper": (lambda d: d.phase.path(d.x, equals=1, upper=2), ["give equals, or lower and upper"]),
    "equals infinity": (lambda d: d.phase.path(d.x, equals=INF), ["lower bound of 'path 1'", "inf"]),
    "relation to infinity": (lambda d: d.phase.path(d.x >= INF), ["relation needs finite numbers"]),
    "equal to infinity": (lambda d: d.phase.path(d.x == INF), ["relation needs finite numbers"]),
    "relation to NaN": (lambda d: d.phase.path(d.x <= NAN), ["path constraint 'path 1'", "nan"]),
    "unequal": (lambda d: d.phase.path(d.x != 1), ["a relation is <=, >= or =="]),
    "and": (lambda d: d.phase.path(casadi.logic_and(d.x <= 1, d.x >= 0)), ["a relation is <=, >= or =="]),
    "path true": (lambda d: d.phase.path(True), ["path constraint 'path 1'", "True"]),
    "path as text": (lambda d: d.phase.path("x <= 1"), ["CasADi expression", "'x <= 1'"]),
    "empty path": (lambda d: d.phase.path(casadi.MX(0, 1), upper=1), ["1 entry at least"]),
    "too many bounds": (lambda d: d.phase.path(d.x, upper=[1, 2]), ["upper bound of 'path 1'", "(2,)"]),
    "path bounds crossed": (lambda d: d.phase.path(d.x, lower=2, upper=1), ["bounds of 'path 1'", "lower 2 exceeds upper 1"]),
    "same path": (lambda d: (d.phase.path(d.x <= 1, name="a"), d.phase.path(d.x <= 2, name="a")), ["path constraint 'a' is declared already"]),
    "path and boundary of one name": (lambda d: (d.phase.path(d.x <= 1, name="a"), d.ocp.subject_to(d.phase.final(d.x) <= 2, name="a")), ["boundary constraint 'a' is declared already"]),
    "boundary and path of one name": (lambda d: (d.ocp.subject_to(d.phase.final(d.x) <= 2, name="a"), d.phase.path(d.x <= 1, name="a")), ["path constraint 'a' is declared already"]),
    "invariant and path of one name": (lambda d: (d.phase.invariant("a", d.x), d.phase.path(d.x <= 1, name="a")), ["path constraint 'a' is declared already"]),
    "name of the program's own": (lambda d: d.phase.path(d.x <= 1, name="dynamics of x"), ["cannot be called 'dynamics of x'"]),
    "name of a check": (lambda d: d.ocp.subject_to(d.phase.final(d.x) <= 1, name="objective"), ["cannot be called 'objective'"]),
    "name of a time": (state_with("end time"), ["a state cannot be called 'end time'"]),
    "path scale": (lambda d: d.phase.path(d.x <= 1, scale=0), ["scale of 'path 1'", "> 0"]),
    "path equation": (lambda d: d.phase.path(d.x <= 1, equation=7), ["equation of 'path 1' must be a string", "7"]),
    "path of the end": (after_dynamics(lambda d: (d.phase.path(d.x <= d.phase.end), d.ocp.minimise(1))), ["path uses 'tf of phase 1'"]),
    "boundary without bounds": (lambda d: d.ocp.subject_to(d.phase.final(d.x)), ["boundary constraint 'boundary 1' needs a bound"]),
    "boundary of a course": (after_dynamics(lambda d: (d.ocp.subject_to(d.x <= 1), d.ocp.minimise(1))), ["boundary uses 'x'", "phase.final(…)"]),
    "boundary of a stranger": (after_dynamics(lambda d: (d.ocp.subject_to(rest_to_rest().phase.end <= 1), d.ocp.minimise(1))), ["boundary uses 'tf of phase 1'", "declared nowhere"]),
    "invariant of a control": (lambda d: d.phase.invariant("i", d.x * d.u), ["invariant 'i' uses the control 'u'"]),
    "invariant without a name": (lambda d: d.phase.invariant("", d.x), ["an invariant must have a name"]),
    # Ends, objectives.
    "control at the end": (lambda d: d.phase.final(d.u), ["control 'u' has no value at the ends"]),
    "control at the begin": (lambda d: d.phase.initial(d.x + d.u), ["control 'u' has no value at the ends"]),
    "text at the end": (lambda d: d.phase.final("x"), ["at the ends", "'x'"]),
    "two integrands": (lambda d: d.phase.integral([d.x, d.v]), ["an integrand must be one number", "got 2"]),
    "integral of an end": (after_dynamics(lambda d: d.ocp.minimise(d.phase.integral(d.phase.final(d.x)))), ["integrand uses 'x(tf)'"]),
    "raw state as objective": (after_dynamics(lambda d: d.ocp.minimise(d.x)), ["objective uses 'x'", "phase 'phase 1'", "phase.integral(…)"]),
    "time as objective": (after_dynamics(lambda d: d.ocp.minimise(d.phase.time)), ["objective uses 't of phase 1'", "phase.final(…)"]),
    "objective of another problem": (after_dynamics(lambda d: d.ocp.minimise(rest_to_rest().phase.end)), ["objective uses 'tf of phase 1'", "declared nowhere"]),
    "two objectives": (lambda d: d.ocp.minimise([d.phase.start, d.phase.end]), ["the objective must be one number", "got 2"]),
    "objective as text": (lambda d: d.ocp.minimise("u**2"), ["objective", "CasADi expression", "'u**2'"]),
    "objective NaN": (lambda d: d.ocp.minimise(NAN), ["objective", "nan"]),
    "unit of the objective": (lambda d: d.ocp.minimise(1, unit=3), ["unit of the objective", "3"]),
    "no objective": (after_dynamics(lambda d: None), ["no objective", "minimise(…)"]),
    "no phase": (lambda d: OptimalControlProblem().definition, ["no phase", "phase(…)"]),
    "no state": (lambda d: (d.ocp.phase("idle"), after_dynamics(lambda d: d.ocp.minimise(1))(d)), ["phase 'idle' has no state"]),
    # Links.
    "link to a number": (lambda d: d.ocp.link(d.phase, 3), ["link: 3 is no phase"]),
    "link to itself": (lambda d: d.ocp.link(d.phase, d.phase), ["a phase cannot follow itself"]),
    "link to another problem": (lambda d: d.ocp.link(d.phase, rest_to_rest().phase), ["phase 'phase 1' is no phase of this problem"]),
    "link without states": (lambda d: d.ocp.link(d.phase, d.ocp.phase("b", time=(1, 2))), ["no state bears the same name", "subject_to"]),
    "link of a stranger": (lambda d: d.ocp.link(d.phase, second_phase(d).phase, "v"), ["state 'v' must be in both phases"]),
    "link of other sizes": (lambda d: d.ocp.link(d.phase, second_phase(d, size=2).phase), ["state 'x' has 1 entry in the first and 2"]),
    "link twice": (lambda d: [d.ocp.link(d.phase, b.phase) for b in [second_phase(d)] * 2], ["'x goes on from phase 1 to second' is declared already"]),
    "link over a gap": (lambda d: d.ocp.link(d.phase, second_phase(d, time=(3, 4)).phase), ["time ends in [1, 1] and begins in [3, 3]"]),
    "link of other values": (lambda d: (lambda b: (b.state("v", initial=5), d.ocp.link(d.phase, b)))(d.ocp.phase("b", time=(1, 2))), ["state 'v' ends in [0, 0] and begins in [5, 5]"]),
    "state of another phase": (after_dynamics(lambda d: (second_phase(d).phase.dynamics({"x": d.v}), d.ocp.minimise(1))), ["phase 'second'", "rate uses 'v'"]),
    "key of another phase": (lambda d: second_phase(d).phase.dynamics({d.x: 1}), ["dynamics of 'x'", "another phase's", "'second'"]),
    # Guesses.
    "guess of a stranger": (lambda d: d.phase.guess(z=1), ["guess of 'z'", "'x', 'v', 'u'"]),
    "guess of one sample": (lambda d: d.phase.guess(x=[1]), ["guess of 'x'", "(samples, 1)", "(1,)"]),
    "guess of wrong width": (lambda d: d.phase.guess(x=[[1, 2], [3, 4]]), ["guess of 'x'", "(2, 2)"]),
    "guess without samples": (lambda d: d.phase.guess(x=[]), ["guess of 'x'", "(0,)"]),
    "guess NaN": (lambda d: d.phase.guess(x=[0, NAN]), ["guess of 'x'", "nan"]),
    "guess inf": (lambda d: d.phase.guess(x=[0, INF]), ["guess of 'x' must be finite", "inf"]),
    "guess None": (lambda d: d.phase.guess(x=None), ["guess of 'x' must be numbers", "None"]),
    "guess as text": (lambda d: d.phase.guess(x="a"), ["guess of 'x' must be numbers", "'a'"]),
    "guess as texts": (lambda d: d.phase.guess(x=["1", "2"]), ["guess of 'x' must be numbers"]),
    "guess of a symbol": (lambda d: d.phase.guess(x=d.x), ["guess of 'x' must be numbers", "MX(x)"]),
    "guess of other length": (lambda d: d.phase.guess(time=[0, 1], x=[1, 2, 3]), ["guess of 'x' has 3 samples for 2 times"]),
    "guess back in time": (lambda d: d.phase.guess(time=[1, 0], x=[1, 2]), ["finite, increasing times", "[1, 0]"]),
    "guess at infinity": (lambda d: d.phase.guess(time=[0, INF], x=[1, 2]), ["finite, increasing times", "inf"]),
    "guess at noon": (lambda d: d.phase.guess(time="noon", x=1), ["increasing times", "'noon'"]),
    "guess at one time": (lambda d: d.phase.guess(time=3), ["increasing times", "3"]),
    "guess beyond the end": (lambda d: d.phase.guess(time=[0, 5], x=[1, 2]), ["must end in [1, 1]", "got 5"]),
    "guess before the start": (lambda d: d.phase.guess(time=[-2, 1], x=[1, 2]), ["must begin in [0, 0]", "got -2"]),
    "function of wrong size": (after_dynamics(lambda d: (d.phase.guess(x=lambda t: [t, t]), d.ocp.minimise(1))), ["guess of 'x' must return 1 finite number", "t = 0"]),
    "function that gives NaN": (after_dynamics(lambda d: (d.phase.guess(x=lambda t: NAN), d.ocp.minimise(1))), ["guess of 'x' must return 1 finite number", "nan"]),
    "function that gives text": (after_dynamics(lambda d: (d.phase.guess(x=str), d.ocp.minimise(1))), ["guess of 'x' must return 1 finite number", "'0.0'"]),
    "function that fails": (after_dynamics(lambda d: (d.phase.guess(x=lambda t: 1 / t), d.ocp.minimise(1))), ["guess of 'x' fails at t = 0", "ZeroDivisionError"]),
    "guess of nothing": (lambda d: d.phase.guess(5), ["must be a plan or a solution", "5"]),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_is_named(name):
    declare, words = REFUSED[name]
    part = open_problem()

    def used():
        declare(part)
        return part.ocp.definition

    with pytest.raises(InvalidData) as caught:
        used()
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert caught.value.field
    assert "casadi.py" not in message and "prototypes" not in message


def test_a_plan_with_other_names_is_no_guess(answer):
    part = OptimalControlProblem().phase()
    part.state("height")
    with pytest.raises(InvalidData, match="the plan has 'x', 'v', 'u', none of which"):
        part.guess(answer)


def test_a_solution_without_a_plan_is_no_guess(answer):
    from dataclasses import replace

    with pytest.raises(InvalidData, match="must be a plan or a solution that has one"):
        rest_to_rest().phase.guess(replace(answer, plan=None))


def bad_definitions():
    def put(*path):
        *inner, last, value = path

        def change(data):
            at = data["definition"]
            for key in inner:
                at = at[key]
            if value is ...:
                del at[last]
            else:
                at[last] = value

        return change

    one = ("phases", 0)
    state = (*one, "states", 0)
    return [
        (lambda d: d.update(definition=None), ["definition must be an object", "got None"]),
        (lambda d: d.clear(), ["key 'definition' is missing in the data of model 'optimal-control'"]),
        (lambda d: d.update(definition=3), ["definition must be an object", "got 3"]),
        (lambda d: d.update(extra=3), ["unknown key 'extra'", "definition"]),
        (put("phases", None), ["phases must be a list", "None"]),
        (put("phases", []), ["phases must hold 1 phase"]),
        (put("phases", ...), ["key 'phases' is missing in the data of a definition"]),
        (put("extra", 1), ["unknown key 'extra' in the data of a definition"]),
        (put("parameters", 3), ["parameters must be a list", "3"]),
        (put("parameters", []), ["p of the function has 1 entries, 0 are declared"]),
        (put("boundaries", []), ["boundary of the function has"]),
        (put("endpoint", "nonsense"), ["endpoint is no serialised casadi.Function"]),
        (put("endpoint", 3), ["endpoint must be a casadi.Function", "3"]),
        (put(*one, "states", []), ["phase 'first' has no state"]),
        (put(*one, "states", 3), ["states must be a list"]),
        (put(*one, "controls", []), ["u of the function has 1 entries, 0 are declared"]),
        (put(*one, "paths", []), ["path of the function has 1 entries, 0 are declared"]),
        (put(*one, "integrals", 3), ["integrand of the function has", "3 are declared"]),
        (put(*one, "integrals", -1), ["integrals must be >= 0"]),
        (put(*one, "name", "second"), ["phases: 'second' stands twice"]),
        (put(*one, "start_lower", 5), ["start", "lower 5 exceeds upper 0"]),
        (put(*one, "start_lower", None), ["start_lower must be a number", "None"]),
        (put(*one, "end_upper", 0.5), ["end", "lower 1 exceeds upper 0.5"]),
        (put(*one, "function", 3), ["function must be a casadi.Function"]),
        (put(*one, "guess", "fractions", [0, 0]), ["fractions"]),
        (put(*one, "guess", "end", -1), ["end of a guess must be after its start"]),
        (put(*one, "guess", "states", [[0], [0]]), ["guess of phase 'first' has 1 columns for 2 states"]),
        (put(*state, "name", "u"), ["phase 'first': 'u' stands twice"]),
        (put(*state, "name", "q[0]"), ["without brackets"]),
        (put(*state, "lower", [30, 30]), ["bounds of 'x'", "lower 30 exceeds upper 20"]),
        (put(*state, "lower", [1]), ["upper has 2 entries where lower has 1"]),
        (put(*state, "lower", ["a", 1]), ["lower[0] must be a number", "'a'"]),
        (put(*state, "scale", [0, 1]), ["scale of 'x' must be > 0"]),
        (put(*state, "unit", 3), ["unit must be a string"]),
    ]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), bad_definitions())
def test_a_wrong_file_is_no_problem(change, words):
    data = copy.deepcopy(everything(20).to_dict())
    change(data["data"])
    with pytest.raises(InvalidData) as caught:
        Model.from_dict(data)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"formulation": "simpson"}, ["'simpson'", "optimal-control"]),
        ({"formulation_options": {"nodes": 3}}, ["no option 'nodes'", "intervals"]),
        ({"backend": "highs"}, ["highs"]),
    ],
)
def test_what_cannot_be_had_is_said(options, words):
    with pytest.raises(
        (UnknownName, UnsupportedOption, ct.errors.UnsupportedFormulation)
    ) as caught:
        ct.solve(rest_to_rest().ocp, **options)
    assert all(word in str(caught.value) for word in words), caught.value
