"""Costs with kinks: their epigraph form, its limits, and the optima with values from calculus."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import covariance
from crosstrack.models.optimal_control.epigraph import epigraph_of


def cart(cost, *, terminal=None, sense="upper", limit=None, **bounds):
    """Return a point that moves with a bounded speed, with the integral of `cost(x, u, t)` as objective."""
    ocp = OptimalControlProblem("cart")
    phase = ocp.phase(time=(0, 3))
    x = phase.state("x", initial=1)
    u = phase.control("u", **({"lower": -1, "upper": 2} | bounds))
    phase.dynamics({x: u})
    integral = phase.integral(cost(x, u, phase.time))
    if limit is None:
        ocp.minimise(integral if terminal is None else integral + terminal(phase.final(x)))
    else:
        ocp.subject_to(integral, **{sense: limit})
        ocp.minimise(phase.final(x))
    return ocp.build()


def reward(x, u, t):
    """Return |x| with a reward of 10 above 1, whose derivative does not show the jump."""
    distance = casadi.fabs(x)
    return distance - 10 * (distance > 1)


def names(ocp):
    epigraph = epigraph_of(ocp.definition)
    if epigraph is None:
        return 0, 0
    new = epigraph.problem.definition
    controls = len(new.phases[0].control_names) - len(ocp.definition.phases[0].control_names)
    return controls, len(new.parameter_names) - len(ocp.definition.parameter_names)


@pytest.mark.parametrize(
    ("cost", "count"),
    [
        (lambda x, u, t: casadi.fabs(x), 1),
        (lambda x, u, t: casadi.fabs(u) + 3 * casadi.fmax(x - u, 0.2), 2),
        (lambda x, u, t: -casadi.fmin(x, 1), 1),
        (lambda x, u, t: casadi.exp(-t) * casadi.fabs(x * u), 1),
        (lambda x, u, t: casadi.fmax(casadi.fabs(x), 0.5), 2),
        (lambda x, u, t: casadi.sqrt(x**2 + u**2), 1),
        # Not replaced: the optimum would be another one, or the sign of the weight is not known.
        (lambda x, u, t: -casadi.fabs(x), 0),
        (lambda x, u, t: casadi.fmin(x, 1), 0),
        (lambda x, u, t: x * casadi.fabs(u), 0),
        (lambda x, u, t: casadi.fabs(casadi.fabs(x) - 1), 1),
        (lambda x, u, t: casadi.fmax(x, 0) ** 2, 0),
        (lambda x, u, t: (t - 1) * casadi.fabs(u), 0),
        (reward, 0),
        (lambda x, u, t: casadi.fabs(x) + casadi.if_else(u > 0, 1, 2), 1),
        (lambda x, u, t: casadi.sqrt(1 + u**2), 0),
        (lambda x, u, t: x**2 + u**2, 0),
    ],
)
def test_replaces_kinks_of_costs_that_only_increase_with_them(cost, count):
    assert names(cart(cost)) == (count, 0)


@pytest.mark.parametrize(("sense", "count"), [("upper", 1), ("lower", 0), ("equals", 0)])
def test_replaces_a_kink_of_a_constraint_only_if_its_integral_is_bounded_above(sense, count):
    assert names(cart(lambda x, u, t: casadi.fabs(u), sense=sense, limit=1.0)) == (count, 0)


def test_bounds_the_new_control_if_the_expression_is_affine_and_bounded():
    definition = epigraph_of(cart(lambda x, u, t: casadi.fabs(1 - u)).definition).problem.definition
    new = definition.phases[0].controls[1]
    assert (new.lower, new.upper) == (0.0, 2.0)
    free = epigraph_of(cart(lambda x, u, t: casadi.fabs(x)).definition).problem.definition
    assert np.isposinf(free.phases[0].controls[1].upper)


def test_does_not_bound_the_new_control_if_the_expression_has_jumps():
    ocp = cart(lambda x, u, t: casadi.fabs(casadi.floor(u)))
    assert np.isposinf(epigraph_of(ocp.definition).problem.definition.phases[0].controls[1].upper)


def test_replaces_no_kink_if_a_jump_of_an_integral_rewards_it():
    ocp = OptimalControlProblem("reward")
    phase = ocp.phase(time=(0, 3))
    x, u = phase.state("x", initial=1), phase.control("u", lower=-1, upper=2)
    phase.dynamics({x: u})
    effort = phase.integral(casadi.fabs(u))
    ocp.minimise(effort - 100 * (effort > 5))
    assert epigraph_of(ocp.build().definition) is None


def test_replaces_no_kink_if_the_problem_uses_the_name_of_the_new_control():
    ocp = OptimalControlProblem("name")
    phase = ocp.phase(time=(0, 3))
    x, u = phase.state("x", initial=1), phase.control("epigraph 1", lower=-1, upper=2)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral(casadi.fabs(u)))
    assert epigraph_of(ocp.build().definition) is None


def test_steps_and_sensitivities_do_not_contain_the_new_variables():
    ocp = OptimalControlProblem("decay")
    phase = ocp.phase(time=(0, 2))
    begin, rate = ocp.data("begin", value=2.0), ocp.parameter("rate", lower=0, upper=5)
    x, u = phase.state("x"), phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u - rate * x})
    ocp.subject_to(phase.initial(x) - begin, equals=0)
    target = casadi.fabs(phase.final(x) + 3)
    ocp.minimise(target + (rate - 1) ** 2 + phase.integral(u**2 + casadi.fabs(u - 2)))
    step = ct.prepare(ocp, intervals=1, degree=4)(begin=2.0)
    assert step.ok and step.u0.shape == (1,)
    assert list(step.plan.parameters) == ["begin", "rate"]
    assert list(step.sensitivity("begin").parameters) == ["rate"]


def test_the_covariance_is_that_of_the_declared_problem():
    ocp = OptimalControlProblem("fit")
    phase = ocp.phase(time=(0, 2))
    rate, x = ocp.parameter("rate", lower=0, upper=5), phase.state("x", initial=2)
    phase.dynamics({x: -rate * x})
    measured = [(0.5, 1.41), (1.0, 0.99), (1.5, 0.71)]
    residuals = [phase.at(t, x) - y for t, y in measured]
    ocp.minimise(sum(casadi.fabs(residual) for residual in residuals))
    estimate = covariance(ocp, ct.prepare(ocp, intervals=2, degree=4)().plan, residuals)
    assert estimate.names == ("rate",) and estimate.freedom == 2
    assert estimate.covariance[0, 0] > 0


def test_extends_a_plan_with_the_values_of_the_kinks_and_reduces_it_again():
    ocp = cart(
        lambda x, u, t: casadi.fmax(casadi.fabs(x), u), terminal=lambda x: casadi.fabs(x - 5)
    )
    plan = ocp.formulate("radau", intervals=2, degree=3).decode(
        ocp.formulate("radau", intervals=2, degree=3).program.guess
    )
    epigraph = epigraph_of(ocp.definition)
    wide = epigraph.extended(plan)
    t = wide.phases[0].grid(7)
    x, u = plan["x"](t), plan["u"](t)
    np.testing.assert_allclose(wide["epigraph 1"](t), np.abs(x), atol=1e-12)
    np.testing.assert_allclose(wide["epigraph 2"](t), np.maximum(np.abs(x), u), atol=1e-12)
    assert wide.parameters["epigraph of ends 1"] == pytest.approx(abs(x[-1] - 5))
    narrow = epigraph.reduced(wide)
    assert narrow.phases[0].control_names == ("u",) and not narrow.parameters
    np.testing.assert_array_equal(narrow["u"](t), u)


@pytest.mark.parametrize(
    ("cost", "terminal", "optimum"),
    [
        # From 1 to 2: the effort 3 c² with c = 1/3 costs 1/3, less than the distance 4 at its end.
        (lambda x, u, t: u**2, lambda x: 4 * casadi.fabs(x - 2), 1 / 3),
        # Full speed to 3 in 1 s, and then the ceiling: -(1 + 1 + 2 * 3).
        (lambda x, u, t: -casadi.fmin(x, 3), None, -8.0),
    ],
)
def test_finds_the_optimum_at_a_kink(cost, terminal, optimum):
    solution = ct.solve(cart(cost, terminal=terminal))
    assert solution.verified and solution.termination == "locally_optimal"
    assert solution.primal_bound == pytest.approx(optimum, abs=2e-6)
    assert solution.plan.phases[0].control_names == ("u",)


def test_finds_the_least_of_the_larger_of_two_integrals():
    ocp = OptimalControlProblem("larger")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0, final=1), phase.control("u")
    phase.dynamics({x: u})
    ocp.minimise(casadi.fmax(phase.integral(u**2), phase.integral(x)))
    solution = ct.solve(ocp)
    assert solution.verified and solution.primal_bound == pytest.approx(1.0, abs=1e-6)
    assert not solution.plan.parameters


def test_the_row_of_a_norm_has_a_bounded_gradient_and_a_finite_violation():
    # At rest, the gradient of s² - e² vanishes: with it, a mesh of a coasting point took 2,308 iterations, not 81.
    ocp = cart(lambda x, u, t: casadi.sqrt(x**2 + u**2))
    row = epigraph_of(ocp.definition).problem.definition.phases[0].function
    x, u, s = (casadi.MX.sym(name) for name in "xus")
    path = row(0.0, x, casadi.vertcat(u, s), [])[1]
    values = casadi.Function(
        "values", [x, u, s], [path, casadi.jacobian(path, casadi.vertcat(x, u, s))]
    )
    for least in (1e-9, 1e-3, 1.0):
        value, slopes = values(0.0, 0.0, least)
        assert float(value) == least and slopes.full().ravel().tolist() == [0.0, 0.0, 1.0]
        assert float(values(0.6 * least, 0.8 * least, least)[0]) == pytest.approx(0.0, abs=1e-15)
    assert float(values(0.0, 0.0, 0.0)[0]) == 0.0
    assert -10.0 < float(values(0.3, 0.4, 0.0)[0]) < -0.5
