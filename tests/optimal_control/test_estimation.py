"""Covariance of estimated parameters: closed form, simulation, bounds and errors."""

import casadi
import numpy as np
import pytest
from optimal_control.measured import alpha_pinene, gas_oil
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit, least_squares

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import covariance

TIMES, TRUE, NOISE = np.linspace(0, 2, 26), (1.5, 0.3, 2.0), 0.02


def course(t, rate, level, start):
    return level + (start - level) * np.exp(-rate * t)


def relaxation(values, start=None, lower=0.0):
    """Return ẋ = -rate (x - level) with measurements as data, and its residuals."""
    ocp = OptimalControlProblem("relaxation")
    rate, level = ocp.parameter("rate", lower=lower, guess=2), ocp.parameter("level")
    measured = ocp.data("measured", len(values), value=values)
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=start)
    phase.dynamics({x: -rate * (x - level)})
    residuals = [phase.at(t, x) - measured[k] for k, t in enumerate(TIMES)]
    ocp.minimise(sum(r**2 for r in residuals))
    return ocp, residuals


def measured(seed):
    return course(TIMES, *TRUE) + NOISE * np.random.default_rng(seed).normal(size=TIMES.size)


@pytest.mark.parametrize(
    ("formulation", "start"),
    [
        ("gauss", None),
        ("hermite-simpson", 2.0),
        pytest.param("gauss", 2.0, marks=pytest.mark.slow),
        pytest.param("hermite-simpson", None, marks=pytest.mark.slow),
    ],
)
def test_covariance_equals_that_of_curve_fit(formulation, start):
    y = measured(0)
    ocp, residuals = relaxation(y, start)
    estimate = covariance(ocp, ct.solve(ocp, formulation=formulation, seed=0).plan, residuals)
    fitted, first = course, (1, 0, 1)
    if start is not None:
        fitted, first = (lambda t, rate, level: course(t, rate, level, start)), (1, 0)
    values, expected = curve_fit(fitted, TIMES, y, first, xtol=1e-14, ftol=1e-14)
    assert estimate.names == ("rate", "level")
    assert estimate.values == pytest.approx(values[:2], abs=1e-6)
    assert estimate.covariance == pytest.approx(expected[:2, :2], rel=1e-5)
    assert estimate.freedom == TIMES.size - len(first)
    assert estimate.correlations[0, 0] == pytest.approx(1)
    assert str(estimate).startswith("rate = 1.")


@pytest.mark.parametrize("draws", [100, pytest.param(200, marks=pytest.mark.slow)])
def test_two_deviations_cover_the_true_values(draws):
    ocp, residuals = relaxation(measured(0))
    solver = ct.prepare(ocp, intervals=1, degree=6)
    inside = []
    for seed in range(draws):
        plan = solver(measured=measured(seed)).plan
        estimate = covariance(ocp, plan, residuals)
        inside.append(np.abs(estimate.values - TRUE[:2]) <= 2 * estimate.deviations)
    share = np.mean(inside, axis=0)
    assert ((share >= 0.9) & (share <= 0.98)).all(), share


def test_covariance_of_gas_oil_equals_that_of_differences():
    # Independent: Jacobian of a shooting method by differences.
    ocp = gas_oil()
    phase = ocp.phases[0]
    y = ct.solve(ocp, seed=0)
    from optimal_control.measured import OIL, OIL_TIMES

    def residuals(k):
        def rate(t, x):
            return [-(k[0] + k[2]) * x[0] ** 2, k[0] * x[0] ** 2 - k[1] * x[1]]

        motion = solve_ivp(rate, (0, 0.95), [1, 0], t_eval=OIL_TIMES, rtol=1e-11, atol=1e-12)
        return (motion.y.T - OIL).ravel()

    fitted = least_squares(residuals, [12, 8, 1], xtol=1e-12, ftol=1e-12)
    variance = 2 * fitted.cost / (OIL.size - 3)
    state = phase.symbols["y"]
    pairs = zip(OIL_TIMES, OIL, strict=True)
    estimate = covariance(ocp, y.plan, [phase.at(t, state) - z for t, z in pairs])
    assert estimate.values == pytest.approx(fitted.x, rel=1e-5)
    expected = variance * np.linalg.inv(fitted.jac.T @ fitted.jac)
    assert estimate.covariance == pytest.approx(expected, rel=1e-3)
    assert estimate.names == ("k[0]", "k[1]", "k[2]")


def test_a_parameter_at_its_bound_has_no_deviation():
    ocp, residuals = relaxation(measured(0), lower=1.7)
    estimate = covariance(ocp, ct.solve(ocp, seed=0).plan, residuals)
    assert estimate.values[0] == pytest.approx(1.7, abs=1e-6)
    assert estimate.deviations[0] == 0 < estimate.deviations[1]
    assert estimate.freedom == TIMES.size - 2


def test_parameters_that_only_occur_as_a_product_are_refused():
    ocp = OptimalControlProblem("product")
    a, b = ocp.parameter("a", guess=1), ocp.parameter("b", guess=1)
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1)
    phase.dynamics({x: -a * b * x})
    residuals = [phase.at(t, x) - np.exp(-2 * t) - 0.01 * t for t in (0.2, 0.5, 0.7, 1.0)]
    ocp.minimise(casadi.sumsqr(casadi.vertcat(*residuals)))
    plan = ct.solve(ocp, seed=0).plan
    with pytest.raises(InvalidData, match="linearly dependent"):
        covariance(ocp, plan, residuals)


def test_bad_input_is_named():
    ocp, residuals = relaxation(measured(0))
    plan = ct.solve(ocp, seed=0).plan
    with pytest.raises(InvalidData, match="declared in this process"):
        covariance(ocp.build(), plan, residuals)
    with pytest.raises(InvalidData, match="more than the 3 estimated quantities, got 3"):
        covariance(ocp, plan, residuals[:3])
    with pytest.raises(InvalidData, match="the residual uses 'x', a function of time"):
        covariance(ocp, plan, ocp.phases[0].symbols["x"])
    other = alpha_pinene()
    with pytest.raises(InvalidData, match="of the plan must be"):
        covariance(other, plan, residuals)
