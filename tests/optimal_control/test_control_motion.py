"""Re-integrated motions: difficult ones, the Hamiltonian, and polynomials."""

import math
from dataclasses import replace

import casadi
import numpy as np
import pytest
from checked import check, parametric, phase_plan, piecewise, rest_plan, rest_problem, swing
from hypothesis import given, settings, strategies as st

from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control import integration
from crosstrack.models.optimal_control.checks import motion
from crosstrack.models.optimal_control.hamiltonian import hamiltonian_spread
from crosstrack.models.optimal_control.plan import Piecewise

#: λx' = 0, λv' = -λx, u + λv = 0.
REST_COSTATES = {"x": lambda t: -12 + 0 * t, "v": lambda t: 12 * t - 6}


def unstable(rate=50.0):
    ocp = OptimalControlProblem("unstable")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=1), phase.control("u")
    phase.dynamics({x: rate * x + u})
    ocp.minimise(phase.integral(u**2))
    return ocp


@pytest.mark.parametrize(("intervals", "nodes", "windows"), [(10, 12, 10), (40, 8, 8), (1, 40, 15)])
def test_an_unstable_motion_is_integrated_in_windows(intervals, nodes, windows):
    def plan(shift=0.0):
        course = {"x": lambda t: np.exp(-t) + shift * t}
        control = {"u": lambda t: -51 * np.exp(-t)}
        return ControlPlan(
            (phase_plan(np.linspace(0, 1, intervals + 1), course, control, nodes=nodes),)
        )

    found = motion(unstable(), plan())
    assert found.windows == windows
    assert found.growth == pytest.approx(math.exp(50), rel=1e-2)
    verified = unstable().verify(plan(), tolerance=1e-9)
    assert verified.ok and check(verified, "motion").where.endswith(f"in {windows} windows")
    # The motion cannot be integrated from end to end, so the objective is not compared.
    assert not [one for one in verified.checks if one.name == "objective"]
    assert verified.objective == pytest.approx(51**2 * (1 - math.exp(-2)) / 2, rel=1e-12)
    # Violations are detected in every window.
    assert not check(unstable().verify(plan(1e-4)), "motion").ok


@pytest.mark.parametrize("rate", [60.0, 1e6])
def test_a_stiff_motion_is_integrated(rate):
    ocp = OptimalControlProblem("stiff")
    phase = ocp.phase(time=(0, 4))
    x, u = phase.state("x", initial=1), phase.control("u")
    phase.dynamics({x: rate * (u - x) - casadi.sin(phase.time)})
    ocp.minimise(phase.integral(u**2))
    knots = (0, 1, 2, 3, 4)
    part = phase_plan(knots, {"x": lambda t: np.cos(t)}, {"u": lambda t: np.cos(t)}, nodes=14)
    found = ocp.verify(ControlPlan((part,)), tolerance=1e-8)
    assert found.ok and motion(ocp, ControlPlan((part,))).windows == 1
    off = piecewise(knots, lambda t, _: [np.cos(t) + 1e-3], 14, 1)
    one = check(ocp.verify(ControlPlan((replace(part, controls=off),))), "motion")
    assert one.worst == pytest.approx(1e-3, rel=0.1) and not one.ok


@pytest.mark.parametrize("is_stiff", [True, False])
def test_a_motion_that_becomes_stiff_apart_from_the_plan_is_integrated_implicitly(is_stiff):
    # The stability of the explicit method limits it to 1e6/6 steps.
    times, states = np.linspace(0.0, 1.0, 49), np.ones((49, 1))

    def rate(t, y):
        return 1e6 * (math.cos(t) - y) - math.sin(t)

    steps, _, reason = integration._advance(
        rate, is_stiff, times, times[-1:], np.ones(1), 0.0, states, integration.STEPS
    )
    assert not reason and steps < 2 * integration.EXPLICIT
    assert states[:, 0] == pytest.approx(np.cos(times), abs=1e-9)


def test_a_fast_oscillation_is_integrated_explicitly():
    """The implicit method takes more than 50,000 steps for its 160 periods."""
    times, states = np.linspace(0.0, 1.0, 49), np.eye(2)[[0] * 49]

    def rate(t, y):
        return np.array([1e3 * y[1], -1e3 * y[0]])

    steps, _, reason = integration._advance(
        rate, False, times, times[-1:], np.ones(2), 0.0, states, integration.STEPS
    )
    assert not reason and steps < 6000
    assert states[:, 0] == pytest.approx(np.cos(1e3 * times), abs=1e-8)


def test_rejects_a_motion_that_breaks_down():
    ocp = OptimalControlProblem("escape")
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=1)
    phase.dynamics({x: x**2})
    ocp.minimise(phase.integral(x))
    plan = ControlPlan((phase_plan((0, 0.5, 1.5, 2), {"x": lambda t: 1 + 0 * t}),))
    found = motion(ocp, plan)
    assert "breaks down" in found.failure and np.isnan(found.integrals).all()
    one = check(ocp.verify(plan), "motion")
    assert one.worst == np.inf and "breaks down at t = 1: x is " in one.where, one.where
    assert ocp.verify(plan).to_dict()["checks"][0]["worst"] is None
    # A rate may be NaN from the start, or later in the motion.
    for last, when in ((-1.0, "t = 0:"), (1.0, "t = 1:")):
        root = OptimalControlProblem("root")
        phase = root.phase(time=(0, 2))
        x, y = phase.state("x"), phase.state("y")
        phase.dynamics({x: -1, y: -casadi.sqrt(last - phase.time)})
        root.minimise(phase.final(x))
        still = {"x": lambda t: -t, "y": lambda t: 0 * t}
        failure = motion(root, ControlPlan((phase_plan((0, 2), still),))).failure
        assert when in failure and failure.endswith("the rate of y is not finite"), failure
    # A non-finite integrand gives no objective.
    log = OptimalControlProblem("log")
    phase = log.phase(time=(0, 1))
    x = phase.state("x", initial=-1)
    phase.dynamics({x: 0})
    log.minimise(phase.integral(casadi.log(x)))
    found = log.verify(ControlPlan((phase_plan((0, 1), {"x": lambda t: -1 + 0 * t}),)))
    assert found.objective is None and not found.ok


def test_the_hamiltonian_is_constant_on_an_exact_solution():
    (report,) = hamiltonian_spread(rest_problem(), rest_plan(costates=REST_COSTATES))
    assert report.autonomous and not report.vanishing  # the time is fixed
    assert report.mean == pytest.approx(-18.0, rel=1e-13) and report.end == pytest.approx(-18.0)
    assert report.spread < 1e-12
    off = REST_COSTATES | {"v": lambda t: 12.1 * t - 6}
    (report,) = hamiltonian_spread(rest_problem(), rest_plan(costates=off))
    assert report.spread > 0.1 and report.relative == pytest.approx(report.spread / 54, rel=0.1)
    assert hamiltonian_spread(rest_problem(), rest_plan()) == ()
    assert not hamiltonian_spread(
        parametric(), ControlPlan((replace(swing(), state_names=("x", "y"), costates=swing().states),),
                                  {"rate": [1.0, 1.0]})
    )[0].autonomous  # fmt: skip


def test_the_weight_of_an_integral_is_in_the_hamiltonian():
    # The square root of the same integral: costates are those of J over 2 √J.
    ocp = rest_problem(end=(0.5, 2))
    free = OptimalControlProblem("root")
    phase = free.phase(time=(0, (0.5, 2)))
    x, v, u = phase.state("x"), phase.state("v"), phase.control("u")
    phase.dynamics({x: v, v: u})
    free.minimise(casadi.sqrt(phase.integral(u**2 / 2)) + phase.end)
    scaled = {
        "x": lambda t: REST_COSTATES["x"](t) / math.sqrt(24),
        "v": lambda t: REST_COSTATES["v"](t) / math.sqrt(24),
    }
    (report,) = hamiltonian_spread(free, rest_plan(costates=scaled))
    assert report.mean == pytest.approx(-18 / math.sqrt(24), rel=1e-12) and report.spread < 1e-12
    assert not report.vanishing  # the objective speaks of the end time itself
    assert hamiltonian_spread(ocp, rest_plan(costates=REST_COSTATES))[0].vanishing


@settings(max_examples=12, deadline=None)
@given(
    st.lists(st.floats(-2, 2), min_size=2, max_size=6),
    st.lists(st.floats(0.05, 1.0), min_size=1, max_size=5),
    st.integers(1, 3),
    st.integers(1, 4),
)
def test_verifies_any_polynomial_motion_of_integrators(coefficients, lengths, order, splits):
    ocp = OptimalControlProblem("chain")
    phase = ocp.phase(time=(0, float(sum(lengths))))
    states = [phase.state(f"x{k}") for k in range(order)]
    u = phase.control("u")
    phase.dynamics(dict(zip(states, [*states[1:], u], strict=True)))
    ocp.minimise(phase.integral(u**2))
    course = np.polynomial.Polynomial(coefficients)

    def plan(knots):
        parts = [course.deriv(k) if k else course for k in range(order + 1)]
        x = piecewise(knots, lambda t, _: [one(t) for one in parts[:-1]], 7, order)
        u = piecewise(knots, lambda t, _: [parts[-1](t)], 7, 1)
        names = tuple(f"x{k}" for k in range(order))
        return ControlPlan((PhasePlan("phase 1", x, u, names, ("u",)),))

    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    knots[-1] = sum(lengths)
    finer = np.interp(
        np.linspace(0, len(lengths), splits * len(lengths) + 1), np.arange(knots.size), knots
    )
    coarse, fine = ocp.verify(plan(knots), tolerance=1e-9), ocp.verify(plan(finer), tolerance=1e-9)
    assert coarse.ok and fine.ok
    squared = (course.deriv(order) ** 2).integ()
    exact = squared(knots[-1]) - squared(0.0)
    for found in (coarse, fine):
        assert found.objective == pytest.approx(exact, rel=1e-10, abs=1e-10)


@pytest.mark.sample(2)
@pytest.mark.parametrize("place", [6, 7, 8, 9, 11, 13])
@pytest.mark.parametrize("excess", [1e-5, 1e-3])
@pytest.mark.parametrize("sign", [1, -1])
def test_stops_where_a_control_saturates_within_a_step(place, excess, sign):
    ocp = OptimalControlProblem("clipped")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u", lower=-9, upper=9)
    phase.dynamics({x: u})
    ocp.minimise(phase.end)
    centre = 0.5 * (1 - np.cos(np.pi * place / 19))

    def control(t):
        return sign * (1 + excess - 4 * (t - centre) ** 2)

    def state(t):
        return sign * ((1 + excess) * t - 4 / 3 * ((t - centre) ** 3 + centre**3))

    limit = {"upper": np.ones(1)} if sign > 0 else {"lower": -np.ones(1)}
    plan = ControlPlan((phase_plan([0, 1], {"x": state}, {"u": control}, **limit),))
    # The integral of the excess, which a step over the saturation would omit.
    lost = 4 / 3 * excess * np.sqrt(excess / 4)
    assert np.abs(motion(ocp, plan).deviation).max() == pytest.approx(lost, rel=1e-6)


def test_finds_the_saturations_of_any_polynomial():
    nodes = -np.cos(np.linspace(0, np.pi, 6))
    wave = 2 * np.cos(5 * np.arccos(nodes))  # 2 T5
    constant, line = np.full(6, 1.5), nodes * 1e-3 + 1 - 1e-12
    table = np.stack([wave, constant, line, 1e308 * nodes, 1 + 1e-12 * wave], axis=1)
    parts = Piecewise([0.0, 2.0, 4.0], (nodes, [0.0]), (table, table[:1]), None, np.ones(5))
    with np.errstate(all="ignore"):
        times = parts.saturations(np.ones(5))
    assert list(times) == [0]
    wave_at = np.array([t for t in times[0] if abs(2 * np.cos(5 * np.arccos(t - 1)) - 1) < 1e-9])
    assert wave_at.size == 5
    assert any(abs(t - 1) < 1e-8 for t in times[0])
    assert Piecewise([0.0, 2.0], (nodes,), (table,)).saturations(np.ones(5)) == {}
