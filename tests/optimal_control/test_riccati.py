"""Linear-quadratic problems compared with Riccati's equation: orders, costates, units."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from transcribed import FORMULATIONS, LINEAR, regulator, solved

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.hamiltonian import hamiltonian_spread

SLOW = pytest.mark.slow
QUICK = settings(
    max_examples=3, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)


@st.composite
def linear(draw):
    """Draw a linear-quadratic problem of one to three states."""
    n, m = draw(st.integers(1, 3)), draw(st.integers(1, 2))
    make = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    a, b = make.uniform(-1, 1, (n, n)), make.uniform(-1, 1, (n, m))
    root, other = make.uniform(-1, 1, (n, n)), make.uniform(-1, 1, (n, n))
    r = np.diag(make.uniform(0.5, 2, m))
    begin = make.uniform(0.5, 1, n) * make.choice([-1, 1], n)
    return a, b, root @ root.T, r, other @ other.T, begin, make.uniform(1, 2)


#: Formulation, options, and smallest orders of convergence of objective and final state.
ORDERS = [
    ("gauss", {"degree": 2}, 4),
    ("radau", {"degree": 2}, 3),
    ("radau", {"degree": 3}, 5),
    ("hermite-simpson", {}, 4),
    ("trapezoid", {}, 2),
]


@pytest.mark.parametrize(
    ("name", "options", "order"),
    [pytest.param(*one, marks=[SLOW] if one == ORDERS[1] else []) for one in ORDERS],
)
@QUICK
@given(problem=linear())
def test_discrete_optima_converge_to_riccati_at_their_order(name, options, order, problem):
    ocp, (matrix, state) = regulator(*problem)
    begin, horizon = problem[5], problem[6]
    exact = 0.5 * begin @ matrix(0.0) @ begin
    end = state(horizon, begin)
    values, ends = [], []
    meshes = (4, 8, 16) if order <= 4 else (2, 4, 8)
    for count in meshes:
        value, plan = solved(ocp, name, intervals=count, refine=False, **options)
        values.append(abs(value - exact) / max(1.0, exact))
        ends.append(np.abs(plan["x"](horizon) - end).max() / max(1.0, np.abs(end).max()))
    for errors in (values, ends):
        # Order by the last halving, unless the errors reach rounding or the coarse one is small by chance.
        reached = math.log2(max(errors[1], 1e-15) / max(errors[2], 1e-15))
        overall = math.log2(max(errors[0], 1e-15) / max(errors[2], 1e-15)) / 2
        assert max(reached, overall) > order - 0.6 or errors[2] < 1e-10, errors
        assert errors[2] < 2e-2 * 4.0 ** (2 - order) or errors[2] < 1e-6, errors


@pytest.mark.parametrize("name", ["gauss", "radau"])
@QUICK
@given(problem=linear())
def test_costates_are_the_gradient_of_the_optimal_cost(name, problem):
    """Check λ = ∂J*/∂x = P(t) x(t) with its sign, at every node and at both ends."""
    ocp, (matrix, _) = regulator(*problem)
    value, plan = solved(ocp, name, intervals=4, degree=8)
    begin = problem[5]
    assert value == pytest.approx(0.5 * begin @ matrix(0.0) @ begin, rel=1e-9, abs=1e-12)
    (phase,) = plan.phases
    costates = phase.costates
    for k in (0, 1, 3):
        low, high = costates.knots[k], costates.knots[k + 1]
        for tau, found in zip(costates.nodes[k], costates.values[k], strict=True):
            t = low + 0.5 * (tau + 1) * (high - low)
            wanted = matrix(t) @ phase.states.on(k, [tau])[0]
            assert found == pytest.approx(wanted, abs=1e-6 * max(1.0, np.abs(wanted).max()))
    (report,) = hamiltonian_spread(ocp, plan)
    assert report.autonomous and report.relative < 1e-6


def test_costates_predict_the_cost_of_a_changed_start():
    """Check the prediction by finite differences for a nonlinear problem."""

    def problem(begin):
        ocp = OptimalControlProblem()
        phase = ocp.phase(time=(0, 1))
        x, u = phase.state("x", initial=begin), phase.control("u")
        phase.dynamics({x: -(x**3) + u})
        ocp.minimise(phase.integral(x**2 + u**2) + phase.final(x) ** 4)
        return ocp

    options = {"formulation_options": {"intervals": 3, "degree": 8, "refine": False}}
    high, low = (ct.solve(problem(1 + d), **options, seed=0).primal_bound for d in (1e-3, -1e-3))
    for name in ("gauss", "radau"):
        plan = ct.solve(problem(1), formulation=name, **options, seed=0).plan
        assert plan.phases[0].costates(0.0)[0] == pytest.approx((high - low) / 2e-3, rel=1e-5)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_low_order_schemes_report_missing_costates(name):
    _, plan = solved(regulator(*LINEAR)[0], name, intervals=2)
    assert (plan.phases[0].costates is None) == (name in ("hermite-simpson", "trapezoid"))


@pytest.mark.parametrize(
    "name",
    ["gauss", "trapezoid", *(pytest.param(n, marks=SLOW) for n in ("radau", "hermite-simpson"))],
)
@QUICK
@given(problem=linear(), shift=st.floats(-50, 50), size=st.sampled_from([1e-3, 7.0, 1e4]))
def test_optima_are_independent_of_clock_and_units(name, problem, shift, size):
    value, plan = solved(regulator(*problem)[0], name, intervals=3)
    for change in ({"start": shift}, {"size": size}):
        moved, other = solved(regulator(*problem, **change)[0], name, intervals=3)
        assert moved == pytest.approx(value, rel=1e-8, abs=1e-10)
        part = plan.phases[0]
        there = other.phases[0]["x"](there_grid(other)) / change.get("size", 1.0)
        assert there == pytest.approx(part["x"](there_grid(plan)), abs=1e-6)


def there_grid(plan):
    return plan.phases[0].grid(9)


@pytest.mark.parametrize("name", ["radau", pytest.param("gauss", marks=SLOW)])
@QUICK
@given(problem=linear(), cut=st.floats(0.15, 0.85))
def test_linked_phases_and_more_intervals_are_the_same_motion(name, problem, cut):
    value, plan = solved(regulator(*problem)[0], name, intervals=2, degree=10)
    for other, mesh in (
        (regulator(*problem, cuts=(cut,))[0], {"intervals": 2, "degree": 10}),
        (regulator(*problem)[0], {"mesh": [0, cut, 1], "degree": 12}),
        (regulator(*problem)[0], {"intervals": 5, "degree": 7}),
    ):
        again, moved = solved(other, name, **mesh)
        assert again == pytest.approx(value, rel=1e-8, abs=1e-11)
        for part in moved.phases:
            t = part.grid(5)
            assert part["x"](t) == pytest.approx(plan["x"](t), abs=1e-6)
            assert part.costates(t) == pytest.approx(plan.phases[0].costates(t), abs=1e-5)
