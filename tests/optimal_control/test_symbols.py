"""NumPy functions of declared symbols give correct expressions without warnings, or an error that helps."""

import warnings

import casadi
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.programs.symbols import explain_symbols

A = np.array([[1.0, 2.0, 0.5], [0.0, -1.0, 3.0], [2.0, 1.0, 1.0]])
V = np.array([1.0, -2.0, 0.5])

#: Expressions of two numbers x, y and a column z of 3.
EXPRESSIONS = {
    "sin": lambda x, y, z: np.sin(x),
    "sqrt": lambda x, y, z: np.sqrt(y),
    "exp": lambda x, y, z: np.exp(z),
    "abs": lambda x, y, z: np.abs(x) + abs(-y),
    "arctan2": lambda x, y, z: np.arctan2(x, y),
    "hypot": lambda x, y, z: np.hypot(x, y),
    "maximum": lambda x, y, z: np.maximum(x, 0) + np.minimum(0.5, y),
    "clip": lambda x, y, z: np.clip(x, -0.1, 0.2),
    "where": lambda x, y, z: np.where(x > 0, x, 3 * y),
    "log1p": lambda x, y, z: np.log1p(y) + np.tanh(x),
    "sum": lambda x, y, z: np.sum(z) + np.mean(z),
    "norm": lambda x, y, z: np.linalg.norm(z),
    "power": lambda x, y, z: np.power(y, 3) + np.square(x),
    "scalar left": lambda x, y, z: np.float64(2) * x - np.float64(1),
    "scalar right": lambda x, y, z: x * np.float64(2) / np.float64(4),
    "array": lambda x, y, z: V.reshape(z.shape) * z,
    "matrix left": lambda x, y, z: A @ z,
    "matrix right": lambda x, y, z: z.T @ A,
    "quadratic form": lambda x, y, z: z.T @ A @ z,
    "dot of vectors": lambda x, y, z: np.dot(z[:, 0], z[:, 0]),
    "outer": lambda x, y, z: np.outer(z, V),
    "stack": lambda x, y, z: np.vstack([x, y]),
    "array of symbols": lambda x, y, z: np.array([[1.0, 2.0], [3.0, 4.0]]) @ np.array([x, y]),
}


def _symbols():
    """Return two scalar states and a vector of three states."""
    phase = OptimalControlProblem("symbols").phase(time=(0, 1))
    return phase.state("x", initial=0), phase.state("y"), phase.state("z", 3)


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_numpy_functions_of_symbols_equal_those_of_numbers(name):
    x, y, z = _symbols()
    values = -0.3, 0.7, np.array([[0.2], [-1.5], [0.9]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expression = EXPRESSIONS[name](x, y, z)
    if isinstance(expression, np.ndarray):
        expression = casadi.vertcat(*expression)
    function = casadi.Function("f", [x, y, z], [expression])
    expected = np.asarray(EXPRESSIONS[name](*values), float)
    np.testing.assert_allclose(function(*values).full().ravel(), expected.ravel(), rtol=1e-14)


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (lambda x, z: np.dot(V, z), "numpy.dot.*casadi.dot"),
        (lambda x, z: V @ z, "casadi.dot"),
        (lambda x, z: z @ A, "x.T @ A"),
        (lambda x, z: z @ z, "casadi.dot"),
        (lambda x, z: np.polyval([1.0, 2.0], x), "numpy.polyval.*crosstrack.table"),
        (lambda x, z: np.einsum("i,i", z, V), "numpy.einsum.*casadi.mtimes"),
        (lambda x, z: np.isnan(x), "numpy.isnan"),
        (lambda x, z: sum(z), "casadi.sum1"),
        (lambda x, z: list(z), "casadi.vertsplit"),
        (lambda x, z: int(x), "numpy.sin"),
    ],
)
def test_an_impossible_operation_names_the_alternative(expression, words):
    x, _, z = _symbols()
    with pytest.raises(InvalidData, match=words):
        expression(x, z)


def test_numpy_expressions_declare_a_problem_that_solves():
    ocp = OptimalControlProblem("numpy")
    phase = ocp.phase(time=(0, 1))
    z = phase.state("z", 2, initial=[0, 0], final=[1, 0])
    u = phase.control("u")
    drift = np.array([[0.0, 1.0], [0.0, 0.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        phase.dynamics({z: drift @ z + np.array([0.0, 1.0]) * u})
        ocp.minimise(phase.integral(np.square(u)))
        solution = ct.solve(ocp, seed=0)
    assert solution.verified
    assert solution.primal_bound == pytest.approx(12.0, rel=1e-6)


@pytest.mark.skipif(not hasattr(casadi.GlobalOptions, "setNumpyMode"), reason="before CasADi 3.8")
def test_keeps_the_numpy_mode_that_the_user_chose():
    before = casadi.GlobalOptions.getNumpyMode()
    try:
        casadi.GlobalOptions.setNumpyMode(1)
        explain_symbols()
        assert casadi.GlobalOptions.getNumpyMode() == 1
        casadi.GlobalOptions.setNumpyMode(0)
        explain_symbols()
        assert casadi.GlobalOptions.getNumpyMode() == -1
    finally:
        casadi.GlobalOptions.setNumpyMode(before)


def test_constants_are_converted_as_before():
    _symbols()
    assert int(casadi.MX(2)) == 2
    assert float(casadi.SX(2.5)) == 2.5
    assert bool(casadi.MX(1) > 0)
