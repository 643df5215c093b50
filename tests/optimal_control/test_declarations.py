"""Meaning of the declarations of optimal control problems, in one phase and in several."""

import json
import math

import casadi
import numpy as np
import pytest
from control_declared import INF, open_problem, rest_to_rest, solve, two_phases

import crosstrack as ct
from crosstrack.models import OptimalControlProblem


def at_instant(ocp, *, t=0.0, x=(), u=(), p=(), phase=0):
    """Return the declared functions at one instant: rate, path, integrand, invariant."""
    found = ocp.definition.phases[phase].function(t, list(x), list(u), list(p))
    return [np.array(one).ravel() for one in found]


def test_declares_bryson_and_denham_in_twelve_lines():
    ocp = OptimalControlProblem("bryson-denham")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=1 / 9)
    v = phase.state("v", initial=1, final=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2 / 2))
    answer = ct.solve(ocp, tolerance=1e-6, seed=0)
    assert answer.termination == "locally_optimal"
    assert answer.primal_bound == pytest.approx(4.0, abs=4e-6)
    assert answer.verification.ok
    assert answer.plan["x"](0.5) == pytest.approx(1 / 9, abs=2e-6)
    assert ocp.describe() == "1 phase, 2 states, 1 controls"


def test_a_vector_equals_its_entries():
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


#: CasADi warns once that the meaning of NumPy's functions on its symbols may change.
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


def test_infinite_bounds_constrain_nothing():
    free = rest_to_rest()
    free.phase.path(free.x, upper=INF, name="no limit")
    free.phase.path(free.x <= INF)
    free.ocp.subject_to(free.phase.final(free.x), lower=-INF)
    assert solve(free.ocp).primal_bound == pytest.approx(12, rel=1e-9)


def test_path_equations_hold_at_every_instant():
    """Check equal accelerations, with the effort counted twice."""
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
    """Check that x = 6t (1 - t) has the smallest ∫ x'² among curves over [0, 1] with area 1."""
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
    """Check x' = a + b t from 0: (x(1) - 3)² + a² + b² is smallest for a = 4/3, b = 2/3, at 4."""
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
    """Check x' = u t with |u| <= 1, which is fastest with the latest start."""
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
    """Check x' = -2 t x, so that x(0) = e x(1)."""
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


def test_a_constant_objective_accepts_any_plan():
    some = rest_to_rest()
    some.ocp.minimise(3)
    assert solve(some.ocp).primal_bound == 3


def test_time_at_the_ends_is_start_and_end():
    timed = open_problem(time=(2, (3, 4)))
    timed.phase.dynamics({timed.x: timed.v, timed.v: timed.u})
    phase = timed.phase
    timed.ocp.minimise(100 * phase.final(phase.time) + phase.initial(phase.time * 10 + timed.x))
    ends = [2, 3.5, 7, 8, 9, 10]  # t0, tf, x0, v0, xf, vf
    assert float(timed.ocp.definition.endpoint(ends, [])[0]) == 350 + 20 + 7


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


def test_phases_joined_by_boundary_constraints():
    """Check two phases with a jump of the speed by one between them, from x = 0 to 2."""
    ocp = OptimalControlProblem()
    a, b = ocp.phase("a", time=(0, 1)), ocp.phase("b", time=(1, 2))
    x, y = a.state("x", initial=0), b.state("y", final=2)
    u, w = a.control("u"), b.control("w")
    a.dynamics({x: u})
    b.dynamics({y: w})
    ocp.subject_to(b.initial(y) - a.final(x) == 1, name="jump")
    ocp.minimise(a.integral(u**2) + b.integral(w**2))
    assert solve(ocp).primal_bound == pytest.approx(0.5, rel=1e-9)
