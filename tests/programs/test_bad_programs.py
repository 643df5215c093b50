"""Bad programs: every one ends in a true result or in an error that names the cause."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import CrosstrackError, InvalidData, UnsupportedFormulation

cp: Any = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
pytestmark = pytest.mark.filterwarnings("ignore")


def _x() -> Any:
    return cp.Variable(3, name="x")


def _problem(
    goal: Callable[[Any], Any], rows: Callable[[Any], list[Any]], sense: str = "Minimize"
) -> Any:
    x = _x()
    return cp.Problem(getattr(cp, sense)(goal(x)), rows(x))


def _semidefinite() -> Any:
    matrix = cp.Variable((2, 2), symmetric=True, name="X")
    return cp.Problem(cp.Minimize(cp.trace(matrix)), [matrix >> np.eye(2)])


@pytest.mark.parametrize("backend", ["auto", "highs", "clarabel", "osqp", "scs"])
def test_unbounded_and_infeasible(backend: str) -> None:
    unbounded = _problem(lambda x: x[0], lambda x: [x[1:] >= 0], "Maximize")
    infeasible = _problem(lambda x: x[0], lambda x: [x >= 1, cp.sum(x) <= 2])
    for problem, termination in ((unbounded, "unbounded"), (infeasible, "infeasible")):
        answer = ct.solve(problem, backend)
        assert (answer.termination, answer.plan, answer.value) == (termination, None, None)


@pytest.mark.parametrize("backend", ["clarabel", "scs"])
def test_conic_unbounded_and_infeasible(backend: str) -> None:
    matrix = cp.Variable((2, 2), symmetric=True, name="X")
    x = cp.Variable(2, name="x")
    # The semidefinite cone takes no part in the proof.
    infeasible = cp.Problem(
        cp.Minimize(cp.sum_squares(x) + cp.sum_squares(matrix)),
        [x[0] + x[1] == 1, cp.norm(x - 1) <= 0.5, matrix >> np.eye(2)],
    )
    unbounded = cp.Problem(cp.Minimize(x[0]), [cp.norm(x[1:]) <= 1 - x[0]])
    assert ct.solve(infeasible, backend).termination == "infeasible"
    assert ct.solve(unbounded, backend).termination == "unbounded"


def test_diagnosis_uses_the_names_of_the_user() -> None:
    problem = _problem(lambda x: x[0], lambda x: [x >= 1, x <= 0, x[1] >= -5])
    text = str(ct.diagnose(problem))
    assert "1.0 <= x" in text
    assert "x <= 0.0" in text
    assert "-5" not in text


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: _problem(lambda x: np.nan * x[0], lambda x: [x >= 1]),
            r"cost\[0\] must be finite",
        ),
        (lambda: _problem(lambda x: np.inf * x[0], lambda x: [x >= 1]), "finite|infinit|NaN|Inf"),
        (lambda: _problem(lambda x: x[0], lambda x: [np.nan * x >= 1]), "finite|NaN"),
        (lambda: _problem(lambda x: x[0], lambda x: [x >= np.nan]), "nan|NaN"),
        (lambda: cp.Problem(cp.Minimize(0)), "problem must have a variable"),
        (
            lambda: _problem(lambda x: cp.Parameter(name="q") * x[0], lambda x: []),
            "parameter q must have a value",
        ),
        (
            lambda: {
                "P": np.diag([1.0, -1]),
                "q": np.zeros(2),
                "lb": -np.ones(2),
                "ub": np.ones(2),
            },
            r"P\[1, 1\] is -1",
        ),
        (lambda: [1, 2], r"model must be a Model, got \[1, 2\]"),
    ],
    ids=["nan cost", "inf cost", "nan row", "nan bound", "empty", "parameter", "nonconvex", "list"],
)
def test_names_bad_data(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(InvalidData, match=message):
        ct.solve(make())


def test_nonconvex_quadratic_programs_are_refused() -> None:
    # The 2 x 2 minors with a zero do not show it.
    data = {
        "P": np.array([[1.0, 2], [2, 1]]),
        "q": np.zeros(2),
        "lb": -np.ones(2),
        "ub": np.ones(2),
    }
    with pytest.raises(CrosstrackError, match="P must be positive semidefinite"):
        ct.solve(data)


@pytest.mark.parametrize(
    ("backend", "message"),
    [
        ("osqp", "'osqp' accepts 'quadratic-program'.*cannot solve model 'conic-program'"),
        ("highs", "cannot solve model 'conic-program'"),
        ("ecos", "ECOS has no semidefinite cones"),
    ],
)
def test_backends_without_semidefinite_cones_refuse_them(backend: str, message: str) -> None:
    module = "highspy" if backend == "highs" else backend
    pytest.importorskip(module, reason=f"{backend} is not installed")
    with pytest.raises(UnsupportedFormulation, match=message):
        ct.solve(_semidefinite(), backend)


def test_constant_objectives_and_programs_without_rows() -> None:
    for goal in (lambda x: 0 * x[0] + 3, lambda x: cp.Constant(3.0)):
        answer = ct.solve(_problem(goal, lambda x: [x == 1]))
        assert (answer.termination, answer.value, answer.bound) == ("optimal", 3.0, 3.0)
    answer = ct.solve(_problem(lambda x: cp.sum_squares(x - 2), lambda x: []))
    assert answer.value == pytest.approx(0.0, abs=1e-9)
    assert answer.values["x"] == pytest.approx(np.full(3, 2.0))


def _extreme() -> dict[str, tuple[Any, float]]:
    tiny, huge = 1e-300, 1e300
    return {
        "tiny cost": (_problem(lambda x: tiny * x[0], lambda x: [x >= 1]), tiny),
        "tiny maximum": (
            _problem(lambda x: tiny * x[0], lambda x: [x >= 1, x <= 7], "Maximize"),
            7 * tiny,
        ),
        "tiny row": (_problem(lambda x: x[0], lambda x: [tiny * x >= 2 * tiny]), 2.0),
        "tiny square": (_problem(lambda x: tiny * cp.sum_squares(x), lambda x: [x >= 1]), 3 * tiny),
        "huge cost": (_problem(lambda x: huge * x[0], lambda x: [x >= 1]), huge),
        "huge row": (_problem(lambda x: x[0], lambda x: [huge * x >= 1]), tiny),
        "huge row and side": (_problem(lambda x: x[0], lambda x: [huge * x >= 2 * huge]), 2.0),
        "huge side": (_problem(lambda x: x[0] + x[1], lambda x: [x[0] + x[1] >= huge]), huge),
        "huge square": (
            _problem(lambda x: huge * cp.sum_squares(x) + x[0], lambda x: [x >= 1]),
            3 * huge,
        ),
    }


@pytest.mark.parametrize("name", list(_extreme()))
def test_coefficients_at_the_end_of_the_range_of_floats(name: str) -> None:
    problem, optimum = _extreme()[name]
    for backend in ("auto", "highs", "clarabel", "osqp"):
        answer = ct.solve(problem, backend)
        assert answer.termination == "optimal", backend
        assert answer.value == pytest.approx(optimum, rel=1e-6, abs=0), backend
        assert answer.bound == pytest.approx(optimum, rel=1e-6, abs=0), backend


def test_a_bound_far_away_is_no_rounding_error() -> None:
    problem = _problem(lambda x: x[0], lambda x: [cp.norm(1e-300 * x) <= 1e-300])
    for backend in ("clarabel", "scs"):
        assert ct.solve(problem, backend).termination not in ("unbounded", "optimal"), backend


@pytest.mark.parametrize("backend", ["highs", "scipy", "scip"])
def test_fractional_bounds_of_integer_columns(backend: str) -> None:
    # The presolve of HiGHS 1.15 returned -1, 3 with the objective 0.096 for a lower bound of -2.5.
    module = {"highs": "highspy", "scip": "pyscipopt"}.get(backend, backend)
    pytest.importorskip(module, reason=f"{backend} is not installed")
    x = cp.Variable(2, integer=True, bounds=[-2.5, 3], name="x")
    rows = np.array([[0.43149417, -2.12627978], [0.90992122, 0.60596557], [0.83005665, 0.82769834]])
    limits = np.array([-4.18870582, 1.66659731, 1.95684997])
    goal = np.array([0.29851447, -0.53500141]) @ x + cp.norm1(x - np.array([0.25, 2.25]))
    answer = ct.solve(cp.Problem(cp.Minimize(goal), [rows @ x <= limits, cp.sum(x) <= 2]), backend)
    assert answer.value == pytest.approx(-0.57000282, abs=1e-8)
    assert answer.values["x"].tolist() == [0, 2]
    y = cp.Variable(integer=True, bounds=[0.4, 0.6], name="y")
    assert ct.solve(cp.Problem(cp.Minimize(y)), backend).termination == "infeasible"


def test_coefficients_of_one_row_that_no_scaling_reconciles() -> None:
    problem = _problem(lambda x: x[0] + x[1], lambda x: [1e300 * x[0] + 1e-300 * x[1] >= 1, x >= 0])
    answer = ct.solve(problem)
    assert answer.plan is None or answer.value <= 1e-6
