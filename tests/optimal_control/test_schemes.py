"""Collocation schemes: exactness, nodes and weights."""

import tracemalloc
from itertools import pairwise

import mpmath
import numpy as np
import pytest

from crosstrack.models.optimal_control import piecewise
from crosstrack.models.optimal_control.lagrange import differentiation, interpolation
from crosstrack.models.optimal_control.piecewise import Piecewise
from crosstrack.models.optimal_control.transcription.schemes import (
    gauss,
    gauss_points,
    hermite_simpson,
    integration,
    radau,
    radau_points,
    trapezoid,
)

#: Scheme, degree to which its rows are exact for X (the last row by itself), that of the quadrature,
#: and that of the plan's polynomial.
SCHEMES = [
    *((gauss(n), n, 2 * n, 2 * n - 1, n) for n in (1, 2, 3, 5, 8, 13)),
    *((radau(n), n, n, 2 * n - 2, n) for n in (1, 2, 3, 5, 8, 13)),
    (hermite_simpson(), 3, 4, 3, 3),
    (trapezoid(), 2, 2, 1, 2),
]


NAMES = [
    *(f"{name}-{n}" for name in ("gauss", "radau") for n in (1, 2, 3, 5, 8, 13)),
    "hermite-simpson",
    "trapezoid",
]


def defects(scheme, degree):
    """Return the residuals of the rows for X = T_degree and its derivative on [-1, 1]."""
    basis = np.polynomial.chebyshev.Chebyshev.basis(degree)
    return scheme.left @ basis(scheme.points) - scheme.right @ basis.deriv()(scheme.control_points)


@pytest.mark.parametrize(("scheme", "rows", "last", "quadrature", "plan"), SCHEMES, ids=NAMES)
def test_rows_are_exact_to_their_degree_and_not_beyond(scheme, rows, last, quadrature, plan):
    for degree in range(last + 1):
        found = defects(scheme, degree)
        assert abs(found[-1]) < 1e-11
        if degree <= rows:
            assert np.abs(found).max() < 1e-10
    assert np.abs(defects(scheme, rows + 1)).max() > 1e-6
    assert abs(defects(scheme, last + 1)[-1]) > 1e-9


@pytest.mark.parametrize(("scheme", "rows", "last", "quadrature", "plan"), SCHEMES, ids=NAMES)
def test_weights_are_exact_to_their_degree_and_not_beyond(scheme, rows, last, quadrature, plan):
    assert (scheme.weights > 0).all() and scheme.weights.sum() == pytest.approx(2, abs=1e-13)

    def error(degree):
        basis = np.polynomial.chebyshev.Chebyshev.basis(degree)
        whole = basis.integ()
        return scheme.weights @ basis(scheme.control_points) - (whole(1) - whole(-1))

    assert max(abs(error(degree)) for degree in range(quadrature + 1)) < 1e-12
    assert abs(error(quadrature + 1)) > 1e-9


@pytest.mark.parametrize(("scheme", "rows", "last", "quadrature", "plan"), SCHEMES, ids=NAMES)
def test_the_plan_follows_polynomials_of_its_degree(scheme, rows, last, quadrature, plan):
    for degree in range(plan + 1):
        basis = np.polynomial.chebyshev.Chebyshev.basis(degree)
        values = scheme.from_states @ basis(scheme.points)
        values = values + scheme.from_rates @ basis.deriv()(scheme.control_points)
        assert values == pytest.approx(basis(scheme.plan_points), abs=1e-12)
    assert scheme.points[0] == -1 and scheme.points[-1] == 1 and (np.diff(scheme.points) > 0).all()
    assert (scheme.plan_points[0], scheme.plan_points[-1]) == (-1, 1)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 20, 64, 150])
def test_nodes_and_weights_agree_with_thirty_digits(count):
    with mpmath.workdps(30):

        def legendre(n, x):
            before, value = mpmath.mpf(1), mpmath.mpf(x)
            if n == 0:
                return before
            for k in range(2, n + 1):
                before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
            return value

        def slope(n, x):
            return n * (x * legendre(n, x) - legendre(n - 1, x)) / (x * x - 1)

        nodes, weights = gauss_points(count)
        for k in range(0, count, max(1, count // 7)):
            x = mpmath.mpf(float(nodes[k]))
            x -= legendre(count, x) / slope(count, x)
            assert abs(float(x - nodes[k])) < 1e-15
            exact = 2 / ((1 - x * x) * slope(count, x) ** 2)
            assert abs(float(exact / weights[k]) - 1) < 1e-10
        nodes, weights = radau_points(count)
        assert nodes[-1] == 1 and weights[-1] == pytest.approx(2 / count**2, rel=1e-11)
        for k in range(0, count - 1, max(1, count // 7)):
            x = mpmath.mpf(float(nodes[k]))
            for _ in range(2):
                value = legendre(count, x) - legendre(count - 1, x)
                x -= value / (slope(count, x) - slope(count - 1, x))
            assert abs(float(x - nodes[k])) < 1e-15
            exact = (1 + x) / (count * legendre(count - 1, x)) ** 2
            assert abs(float(exact / weights[k]) - 1) < 1e-10


@pytest.mark.parametrize("count", [5, 40, 200])
def test_interpolation_differentiation_and_integration_of_many_nodes(count):
    nodes = np.concatenate([[-1.0], radau_points(count)[0]])
    fine = np.linspace(-1, 1, 333)
    rough = 1e-2 if count == 5 else 1e-12
    assert np.abs(interpolation(nodes, fine) @ np.sin(nodes) - np.sin(fine)).max() < rough
    slope = np.abs(differentiation(nodes) @ np.sin(nodes) - np.cos(nodes)).max()
    assert slope < (0.1 if count == 5 else 1e-15 * count**3)
    own, onto = integration(count)
    assert np.abs(onto @ np.cos(own) - np.sin(np.append(own, 1)) - np.sin(1)).max() < rough


def test_integration_of_many_nodes_needs_the_memory_of_its_matrix():
    integration.cache_clear()
    tracemalloc.start()
    _, onto = integration(150)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * onto.nbytes


def test_a_derivative_is_computed_for_the_intervals_of_the_times_alone(monkeypatch):
    knots, nodes = np.linspace(0, 1, 21), gauss(4).points
    values = tuple((a + (nodes + 1) * (b - a) / 2)[:, None] ** 3 for a, b in pairwise(knots))
    cubic, calls = Piecewise(knots, (nodes,) * 20, values), []
    monkeypatch.setattr(
        piecewise, "differentiation", lambda x: calls.append(x) or differentiation(x)
    )
    assert cubic(0.33, 2) == pytest.approx(6 * 0.33) and len(calls) == 1
    times = np.array([0.01, 0.99, 0.02, 0.51])
    assert cubic(times, 1)[:, 0] == pytest.approx(3 * times**2) and len(calls) == 4


def test_the_papers_gauss_method_with_two_nodes_by_hand():
    root, a = np.sqrt(3.0), 1 / np.sqrt(3.0)
    scheme = gauss(2)
    # Eq. 14 with t0 = 1 and tf = 3: t = 2.5 is τ = 0.5.
    tau = Piecewise(np.array([1.0, 3.0]), ([-1.0, 1.0],), ([[-1.0], [1.0]],))
    assert tau(2.5) == pytest.approx(0.5)
    # The nodes are the roots of (3 τ² - 1) / 2, and both weights are 1.
    assert scheme.points == pytest.approx([-1, -a, a, 1], abs=1e-15)
    assert scheme.weights == pytest.approx([1, 1])
    # Eq. 16: l0 = (3 τ² - 1) / 2, and eq. 17: ũ1 = (1 - √3 τ) / 2, at τ = 0.5.
    assert interpolation(scheme.points[:3], 0.5)[0, 0] == pytest.approx(-0.125)
    halves = [(1 - 0.5 * root) / 2, (1 + 0.5 * root) / 2]
    assert interpolation([-a, a], 0.5)[0] == pytest.approx(halves)
    # Eq. 18: the slopes of l0, l1 and l2 at both nodes.
    slopes = np.array([[-root, 1.5, root - 1.5], [root, -root - 1.5, 1.5]])
    assert scheme.left[:2] == pytest.approx(np.hstack([slopes, np.zeros((2, 1))]))
    # Eq. 19 and 20 for x = t², whose rate is 2 t, on [0, 2]: t = 1 + τ and tf = 2, so (tf - t0) / 2 = 1.
    states, rates = np.array([0, (1 - a) ** 2, (1 + a) ** 2, 4]), np.array([2 - 2 * a, 2 + 2 * a])
    assert slopes @ states[:3] == pytest.approx(rates)
    assert scheme.left @ states == pytest.approx(scheme.right @ rates)
    assert scheme.left[2] @ states == pytest.approx(4)
    # The printed sign (t0 - tf) / 2 would leave twice the rate.
    assert np.abs(scheme.left[:2] @ states + rates).max() == pytest.approx(4 + 4 * a)
