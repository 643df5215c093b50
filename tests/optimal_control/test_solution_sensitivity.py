"""Derivatives of solved problems: closed forms, differences of solutions, and rejected cases."""

from dataclasses import replace

import casadi
import numpy as np
import pytest
from optimal_control.steered import brake, cart_pole
from optimal_control.test_scenarios import cart, push
from optimal_control.test_sensitivity import bounded, relay

import crosstrack as ct
from crosstrack.errors import InvalidData, NoDerivative
from crosstrack.models import OptimalControlProblem
from crosstrack.solvers import Termination

STEP = 1e-4


def move():
    """Return the rest-to-rest move by a distance with the least duration plus effort."""
    ocp = OptimalControlProblem("move")
    distance = ocp.data("distance", value=2.0)
    phase = ocp.phase(time=(0, (0.5, 10)))
    x, v = phase.state("x", initial=0, final=distance), phase.state("v", initial=0, final=0)
    u = phase.control("u", lower=-50, upper=50)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.end + phase.integral(u**2 / 2))
    return ocp


def fit():
    """Return the decay whose rate and start fit two values that are data."""
    ocp = OptimalControlProblem("fit")
    values = ocp.data("values", 2, value=[1.5, 0.4])
    rate, start = ocp.parameter("rate", guess=1.0), ocp.parameter("start", guess=1.0)
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=start)
    phase.dynamics({x: -rate * x})
    ocp.minimise((start - values[0]) ** 2 + (phase.final(x) - values[1]) ** 2 + 0.1 * rate**2)
    return ocp


def oscillator():
    ocp = OptimalControlProblem("oscillator")
    damping, weight = ocp.data("damping", value=1.0), ocp.data("weight", value=1.0)
    phase = ocp.phase(time=(0, 3))
    x, v = phase.state("x", initial=0), phase.state("v", initial=1)
    u = phase.control("u", lower=-0.75, upper=1)
    phase.dynamics({x: v, v: damping * (1 - x**2) * v - x + u})
    ocp.minimise(phase.integral(x**2 + v**2 + weight * u**2))
    return ocp


def glide():
    """Return the fastest slide under a gravity that is data, with the angle as the control."""
    ocp = OptimalControlProblem("glide")
    gravity = ocp.data("gravity", value=9.81)
    phase = ocp.phase(time=(0, (0.2, 3)))
    x, y = phase.state("x", initial=0, final=2, scale=1), phase.state("y", initial=0, final=1)
    v = phase.state("v", initial=0, scale=3)
    angle = phase.control("angle", lower=0, upper=2)
    phase.dynamics(
        {x: v * casadi.sin(angle), y: v * casadi.cos(angle), v: gravity * casadi.cos(angle)}
    )
    phase.guess(time=[0, 1], x=[0, 2], y=[0, 1], v=[0, 4], angle=[0.5, 1.5])
    ocp.minimise(phase.end)
    return ocp


PROBLEMS = {
    "brake": brake,
    "cart-pole": cart_pole,
    "touch": lambda: bounded().given(bound=0.2),
    "relay": relay,
    "move": move,
    "fit": fit,
    "oscillator": oscillator,
    "glide": glide,
    "expectation": lambda: push().scenarios({"a": {"mass": 0.5}, "b": {"mass": 2.0}}),
    "worst": lambda: cart().scenarios({"a": {"mass": 0.8}, "b": {"mass": 1.3}}, objective="worst"),
}


#: A bound, a free time, parameters, a nonlinear motion and scenarios.
FAST = {"touch", "fit"}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in FAST else [pytest.mark.slow]) for n in PROBLEMS]
)
def test_derivatives_agree_with_differences_of_solutions(name):
    problem = PROBLEMS[name]()
    solution = ct.solve(problem, seed=0, isolate=False)
    assert solution.termination == "locally_optimal"
    names = [item.name for item in problem.definition.parameters if item.given]
    for data in names:
        found = solution.sensitivity(data)
        step = found.point
        again = ct.prepare(problem, mesh=step.plan, tolerance=1e-9)
        base = again.data[data]
        for k in range(base.size):
            move = STEP * np.eye(base.size)[k]
            one, two = (again(**{data: base + side * move}, warm=step.plan) for side in (-1, 1))
            assert one.ok and two.ok
            slope = (two.objective - one.objective) / (2 * STEP)
            scale = max(1e-2, abs(solution.primal_bound))
            assert found.objective[k] == pytest.approx(slope, rel=1e-4, abs=1e-4 * scale)
            for value, entries in found.parameters.items():
                ends = [step.plan.parameters[value] for step in (one, two)]
                want = (ends[1] - ends[0]) / (2 * STEP)
                np.testing.assert_allclose(entries[:, k], want, rtol=1e-4, atol=1e-4)
            for number, part in enumerate(step.plan.phases):
                others = [step.plan.phases[number] for step in (one, two)]
                moved = (others[1].end - others[0].end) / (2 * STEP)
                assert found.times[number, 1, k] == pytest.approx(moved, rel=1e-4, abs=1e-4)
                times = part.start + np.array([0.2, 0.6]) * part.duration
                for state in part.state_names:
                    want = (others[1][state](times) - others[0][state](times)) / (2 * STEP)
                    have = found(state, times, phase=part.name)[..., k]
                    size = max(1.0, np.abs(want).max())
                    np.testing.assert_allclose(have, want, atol=1e-4 * size)


def test_derivatives_equal_closed_forms():
    # J(T) = T + 6 d² / T³ has its minimum at T⁴ = 18 d².
    solution = ct.solve(move(), seed=0, isolate=False)
    found = solution.sensitivity("distance")
    time = (18 * 4.0) ** 0.25
    assert solution.plan.end == pytest.approx(time, rel=1e-6)
    assert found.objective[0] == pytest.approx(2 * time / (3 * 2.0), rel=1e-6)
    assert found.times[0, 1, 0] == pytest.approx(time / (2 * 2.0), rel=1e-5)
    # Bryson and Denham's cart touches a wall at 1/6 <= l <= 1/4, with J = 2 + 6 (1 - 4 l)².
    solution = ct.solve(bounded().given(bound=0.2), seed=0, isolate=False)
    assert solution.sensitivity("bound").objective[0] == pytest.approx(-48 * 0.2, rel=1e-3)
    # The slide's time is proportional to gravity ** -0.5.
    solution = ct.solve(glide(), seed=0, isolate=False)
    slope = solution.sensitivity("gravity").objective[0]
    assert slope == pytest.approx(-0.5 * solution.primal_bound / 9.81, rel=1e-5)


def test_rejects_plans_without_derivatives():
    solution = ct.solve(brake(), seed=0, isolate=False)
    with pytest.raises(InvalidData, match="'mass' is no data"):
        solution.sensitivity("mass")
    with pytest.raises(InvalidData, match="name must be"):
        solution.sensitivity(["x0"])
    record = ct.Solution.from_dict(solution.to_dict())
    with pytest.raises(InvalidData, match="needs a solution with a control plan and its model"):
        record.sensitivity("x0")
    feasible = replace(solution, termination=Termination.FEASIBLE)
    with pytest.raises(NoDerivative, match="the plan is feasible: only an optimum"):
        feasible.sensitivity("x0")
    other = replace(solution, primal_bound=2 * solution.primal_bound)
    with pytest.raises(NoDerivative, match="the mesh does not represent the plan"):
        other.sensitivity("x0")
    weak = OptimalControlProblem("weak")
    a = weak.data("a", value=1.0)
    phase = weak.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u", upper=1)
    phase.dynamics({x: u})
    weak.minimise(phase.integral((u - a) ** 2))
    options = {"intervals": 2, "degree": 3, "refine": False}
    found = ct.solve(weak, seed=0, isolate=False, formulation_options=options)
    with pytest.raises(NoDerivative, match="strict complementarity fails"):
        found.sensitivity("a")
