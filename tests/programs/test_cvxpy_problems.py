"""Problems of CVXPY: the same optimum, variables, multipliers and status as its own ``solve``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cvxpy_problems import KINDS, random_problem

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models.programs.conic import ConicProgram
from crosstrack.models.programs.linear import MixedIntegerProgram, QuadraticProgram
from crosstrack.solvers import Termination

cp: Any = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
pytestmark = pytest.mark.filterwarnings("ignore")

COUNT = 200
CLASSES = {
    "linear": MixedIntegerProgram,
    "quadratic": QuadraticProgram,
    "integer": MixedIntegerProgram,
}


def _dense(value: Any) -> Any:
    return value.toarray() if hasattr(value, "toarray") else np.array(value)


def _violation(problem: Any) -> float:
    return max(float(np.max(constraint.violation())) for constraint in problem.constraints)


@pytest.mark.parametrize("count", [COUNT // 8, pytest.param(COUNT, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_answers_equal_those_of_cvxpy(kind: str, count: int) -> None:
    if kind == "integer":
        pytest.importorskip("pyscipopt", reason="SCIP is not installed")
    for number in range(KINDS.index(kind), count, len(KINDS)):
        problem = random_problem(number)
        answer = ct.solve(problem, "highs" if kind == "integer" else "clarabel")
        assert answer.termination == "optimal", (number, answer)
        assert type(answer.source) is CLASSES.get(kind, ConicProgram), number
        answer.assign()
        values = {v.name(): _dense(v.value) for v in problem.variables()}
        assigned, status = problem.value, problem.status
        assert _violation(problem) <= 1e-6, number
        for name, value in answer.values.items():
            assert np.allclose(value, values[name], atol=1e-6), (number, name)
        # Not HIGHS: its presolve cuts off the optimum of problem 23 in the form of CVXPY.
        problem.solve(solver="SCIP" if kind == "integer" else "CLARABEL")
        assert status == problem.status == "optimal"
        close = pytest.approx(problem.value, rel=1e-6, abs=1e-6)
        assert assigned == close, number
        assert answer.value == close, number
        assert answer.bound == pytest.approx(problem.value, rel=2e-6, abs=2e-6), number


def test_booleans_are_at_most_1() -> None:
    whole, part = cp.Variable(2, boolean=True, name="whole"), cp.Variable(3, boolean=[(0, 2)])
    limits = [whole[0] + whole[1] <= 5, part <= 4, part >= -4]
    problem = cp.Problem(cp.Maximize(cp.sum(whole) + cp.sum(part)), limits)
    for sense, value in ((cp.Maximize, 8.0), (cp.Minimize, -4.0)):
        answer = ct.solve(cp.Problem(sense(problem.objective.expr), limits), "highs")
        assert answer.value == pytest.approx(value)


def test_multipliers_equal_those_of_cvxpy() -> None:
    # Strictly convex, with independent active constraints: the multipliers are unique.
    draw = np.random.default_rng(0)
    for sense in (cp.Minimize, cp.Maximize):
        x, matrix = cp.Variable(4, name="x"), cp.Variable((2, 2), symmetric=True, name="X")
        cost, sign = draw.normal(size=4), 1 if sense is cp.Minimize else -1
        objective = cp.sum_squares(x - cost) + cp.sum_squares(matrix) + cp.exp(x[3])
        problem = cp.Problem(
            sense(sign * objective),
            [
                x[0] + x[1] == 1,
                x[2] >= 2,
                cp.SOC(cp.Constant(1.0), x[:2] - 1),
                matrix >> np.array([[1.0, 0.3], [0.3, 2.0]]),
            ],
        )
        ct.solve(problem, "clarabel").assign()
        duals = [
            np.hstack([np.ravel(d.value) for d in c.dual_variables]) for c in problem.constraints
        ]
        problem.solve(solver="CLARABEL")
        for mine, constraint in zip(duals, problem.constraints, strict=True):
            theirs = np.hstack([np.ravel(d.value) for d in constraint.dual_variables])
            assert np.allclose(mine, theirs, atol=1e-5), constraint


def test_complex_variables_get_complex_values() -> None:
    w = cp.Variable(2, complex=True, name="w")
    problem = cp.Problem(
        cp.Minimize(cp.sum_squares(cp.abs(w - np.array([1, 1j]))) + cp.real(w[0])),
        [cp.imag(w) == 1],
    )
    answer = ct.solve(problem, "clarabel")
    answer.assign()
    value, point = problem.value, w.value
    problem.solve(solver="CLARABEL")
    assert value == pytest.approx(problem.value, abs=1e-6)
    assert np.allclose(point, w.value, atol=1e-4)
    assert np.iscomplexobj(answer.values["w"])


def _unsupported() -> dict[str, tuple[Any, str]]:
    x = cp.Variable(3, name="x")
    z = cp.Variable(2, integer=True, name="z")
    positive = cp.Variable(2, pos=True, name="u")
    problem = cp.Problem
    return {
        "power cone": (
            problem(cp.Minimize(x[0]), [cp.PowCone3D(x[0], x[1], x[2], 0.3)]),
            r"Pow3D\(x\[0\], x\[1\], x\[2\]; 0.3\).*PowCone3D",
        ),
        "atom of power cones": (
            problem(cp.Maximize(cp.geo_mean(x, approx=False)), [x <= 1]),
            r"maximize GeoMean\(x, .*PowConeND",
        ),
        "integers in a cone": (
            problem(cp.Minimize(z[0]), [x[0] >= 0, cp.norm(z - 1.5) <= 2]),
            r"pnorm\(z \+ -1.5, 2\) <= 2.0.*SOC.*together with integers",
        ),
        "concave objective": (
            problem(cp.Minimize(cp.sqrt(x[0])), [x >= 1]),
            r"minimize power\(x\[0\], 0.5\)', whose expression is concave.*qcp=True",
        ),
        "concave constraint": (
            problem(cp.Minimize(x[1]), [cp.geo_mean(x) <= 1]),
            r"geo_mean\(x, .* <= 1.0', whose expression is concave",
        ),
        "convex equality": (
            problem(cp.Minimize(x[0]), [cp.square(x[0]) == 1]),
            r"power\(x\[0\], 2.0\) == 1.0', whose expression is convex",
        ),
        "product": (problem(cp.Minimize(x[0] * x[1])), r"'x\[0\] \* x\[1\]' in 'minimize"),
        "nonconvex quadratic form": (
            problem(cp.Minimize(cp.quad_form(x, np.diag([1, -1, 1]))), [x >= 1]),
            r"QuadForm\(x, ",
        ),
        "geometric": (
            problem(cp.Minimize(positive[0] * positive[1]), [positive[0] / positive[1] >= 2]),
            r"u\[0\] \* u\[1\].*gp=True",
        ),
    }


@pytest.mark.parametrize("name", list(_unsupported()))
def test_messages_contain_the_unsupported_part(name: str) -> None:
    problem, message = _unsupported()[name]
    with pytest.raises(UnsupportedFormulation, match=message):
        ct.load(problem)


@pytest.mark.parametrize("sense", ["Minimize", "Maximize"])
@pytest.mark.parametrize("status", ["infeasible", "unbounded"])
def test_assigns_infeasible_and_unbounded_like_cvxpy(status: str, sense: str) -> None:
    x = cp.Variable(2, name="x")
    x.value = np.ones(2)
    goal = getattr(cp, sense)(cp.sum(x))
    bounds = [x <= 1] if sense == "Minimize" else [x >= 1]
    problem = cp.Problem(goal, bounds if status == "unbounded" else [x >= 1, x <= 0])
    answer = ct.solve(problem)
    assert answer.termination == status
    answer.assign()
    mine = problem.status, problem.value, x.value, problem.constraints[0].dual_value
    problem.solve(solver="CLARABEL")
    assert mine[:3] == (problem.status, problem.value, None)
    assert x.value is None
    assert mine[3] is None or status == "infeasible"


def test_assigns_no_answer_without_plan_or_claim() -> None:
    problem = random_problem(0)
    answer = replace(
        ct.solve(problem), termination=Termination.NO_SOLUTION, plan=None, stored_plan=None
    )
    with pytest.raises(InvalidData, match="assign: there is no plan"):
        answer.assign()


def test_assigned_status_of_an_unproven_plan_is_not_optimal() -> None:
    x = cp.Variable(nonneg=True, name="x")
    problem = cp.Problem(cp.Minimize(x), [x >= 1])
    program = ct.load(problem)
    program.source.assign(np.array([2.0]), None, 2.0, "feasible")
    assert (problem.status, problem.value) == ("user_limit", 2.0)
