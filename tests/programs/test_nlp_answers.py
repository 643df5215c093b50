"""Common parts of nonlinear backends: derivatives, scaling, and the judgement of endings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from nonlinears import CASES, TWICE, asked

from crosstrack.models.programs.blocks import Block
from crosstrack.models.programs.nonlinear import NonlinearProgram
from crosstrack.solvers.conformance.nonlinear_hard import nonlinear
from crosstrack.solvers.contract.backend import Limit, Request, Termination
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.nlp.base import NonlinearBackend
from crosstrack.solvers.nlp.quality import estimated_duals, worst_blocks
from crosstrack.solvers.nlp.scaled import Scaled
from crosstrack.solvers.programs.attempts import Clock, Ended, Ending

INF = np.inf


# Against known optima.


@st.composite
def convex(draw: Any) -> NonlinearProgram:
    """Draw a strictly convex quadratic program with a point that all rows allow."""
    size, rows = draw(st.integers(1, 3)), draw(st.integers(0, 3))
    numbers = st.integers(-4, 4)

    def array(*shape: int) -> np.ndarray:
        count = int(np.prod(shape))
        return np.array(draw(st.lists(numbers, min_size=count, max_size=count)), float).reshape(
            shape
        )

    root, cost, matrix, inside = array(size, size), array(size), array(rows, size), array(size)
    hessian = root @ root.T + np.eye(size)
    spread = draw(st.lists(st.sampled_from([1.0, 3.0, INF]), min_size=rows, max_size=rows))
    middle = matrix @ inside
    x = casadi.SX.sym("x", size)
    rows_ = casadi.mtimes(casadi.DM(matrix), x) if rows else casadi.SX(0, 1)
    objective = 0.5 * casadi.bilin(casadi.DM(hessian), x, x) + casadi.dot(casadi.DM(cost), x)
    return NonlinearProgram(
        function=casadi.Function("qp", [x], [objective, casadi.densify(rows_)], ["x"], ["f", "g"]),
        row_lower=middle - 1.0,
        row_upper=middle + np.array(spread),
        column_lower=inside - np.where(array(size) > 0, INF, 2.0),
        column_upper=inside + np.where(array(size) > 0, INF, 1.0),
        guess=array(size),
    )


def quadratic_optimum(program: NonlinearProgram) -> float:
    """Return what a quadratic solver makes of a quadratic `program`."""
    from crosstrack.solvers.conformance.quadratic import quadratic

    none, size = np.zeros(program.size), program.size
    hess = np.array(casadi.densify(program.second_order(none, 1.0, np.zeros(program.row_count))))
    hess = hess + np.triu(hess, 1).T
    posed = quadratic(
        hess,
        program.gradient(none).tolist(),
        program.jacobian(none).toarray().reshape(-1, size),
        program.row_lower,
        program.row_upper,
        lower=program.column_lower,
        upper=program.column_upper,
    )
    answer = find_backend("clarabel").run(posed, Request(options={"polish": True}))
    assert answer.termination is Termination.OPTIMAL
    return float(answer.primal_bound)


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(convex())
def test_convex_programs_have_their_optimum(program: NonlinearProgram) -> None:
    optimum = quadratic_optimum(program)
    for name in ("ipopt", "uno", "slsqp"):
        answer = asked(name, program)
        assert answer.termination is Termination.LOCALLY_OPTIMAL, (name, answer)
        assert answer.primal_bound == pytest.approx(optimum, rel=1e-6, abs=1e-6), name
        assert program.stationarity(answer.point, answer.duals) < 1e-3, name


@settings(max_examples=10, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.lists(st.integers(-4, 4), min_size=7, max_size=7))
def test_other_units_make_no_difference(powers: list[int]) -> None:
    case = CASES["nonlinear: HS071"]
    assert isinstance(case.program, NonlinearProgram)
    units = 10.0 ** np.array(powers)
    columns, rows, objective = units[:4], units[4:6], float(units[6])
    x = casadi.MX.sym("x", 4)
    f, g = case.program.function(x / columns)
    other = NonlinearProgram(
        function=casadi.Function("other", [x], [f * objective, g * rows], ["x"], ["f", "g"]),
        row_lower=case.program.row_lower * rows,
        row_upper=case.program.row_upper * rows,
        column_lower=case.program.column_lower * columns,
        column_upper=case.program.column_upper * columns,
        guess=case.program.guess * columns,
        column_scale=columns,
        row_scale=rows,
        objective_scale=objective,
    )
    plain, answer = asked("ipopt", case.program), asked("ipopt", other)
    assert answer.termination is Termination.LOCALLY_OPTIMAL
    assert answer.primal_bound / objective == pytest.approx(plain.primal_bound, rel=1e-8)
    assert answer.point / columns == pytest.approx(plain.point, rel=1e-6)
    assert answer.duals * rows / objective == pytest.approx(plain.duals, rel=1e-5)
    assert answer.statistics["iterations"] == plain.statistics["iterations"]


def test_scaled_functions_are_the_derivatives_of_one_another() -> None:
    case = CASES["nonlinear: badly scaled, its scales given"]
    assert isinstance(case.program, NonlinearProgram)
    scaled = Scaled(case.program)
    posed = scaled.problem()
    z, duals = np.array([1.2, 3.0, 2.0, 1.5]), np.array([0.3, -0.2])
    weight = casadi.MX.sym("w")
    symbols = casadi.MX.sym("y", 2)
    lagrangian = weight * posed["f"] + casadi.dot(symbols, posed["g"])
    automatic = casadi.Function(
        "automatic",
        [posed["x"], weight, symbols],
        [
            casadi.gradient(posed["f"], posed["x"]),
            casadi.jacobian(posed["g"], posed["x"]),
            casadi.hessian(lagrangian, posed["x"])[0],
        ],
    )
    gradient, jacobian, hessian = (np.array(part) for part in automatic(z, 0.7, duals))
    assert np.array(scaled.gradient(z, [])[1]) == pytest.approx(gradient)
    assert np.array(scaled.jacobian(z, [])[1]) == pytest.approx(jacobian)
    assert np.array(scaled.first_order(z, [])[3]) == pytest.approx(jacobian)
    assert np.array(scaled.hessian(z, [], 0.7, duals)) == pytest.approx(np.triu(hessian))
    assert np.array(scaled.whole_hessian(z, [], 0.7, duals)) == pytest.approx(hessian)


def test_derivatives_given_are_used_and_agree() -> None:
    case = CASES["nonlinear: HS100"]
    program = case.program
    assert isinstance(program, NonlinearProgram)
    given_ = replace(program, derivatives=program.first_order, hessian=program.second_order)
    for name in ("ipopt", "sqpmethod"):
        first, second = asked(name, program), asked(name, given_)
        assert first.point == pytest.approx(second.point, abs=1e-9), name
        assert first.statistics["iterations"] == second.statistics["iterations"], name
    x = casadi.SX.sym("x", program.size)
    grad, jac = program.first_order(x)
    wrong = casadi.Function("wrong", [x], [2 * grad, jac], ["x"], ["grad_f", "jac_g"])
    misled = asked("ipopt", replace(program, derivatives=wrong))
    assert misled.statistics["iterations"] != asked("ipopt", program).statistics["iterations"]


# The judgement.


class Told(NonlinearBackend):
    """Solver that returns a given ending."""

    name = "told"
    requires = ()

    def __init__(self, say: Callable[[NonlinearProgram, np.ndarray], Ending]) -> None:
        self.say = say

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: np.ndarray
    ) -> Ending:
        return self.say(program, start)


DISK = CASES["nonlinear: Rosenbrock in the unit disk"]


def told(outcome: Ending, **arguments: Any) -> Any:
    assert isinstance(DISK.program, NonlinearProgram)
    return Told(lambda program, start: outcome).run(DISK.program, Request(**arguments))


def test_a_claimed_optimum_is_recomputed() -> None:
    best = np.array(DISK.expectation.point)
    duals = np.array(DISK.expectation.duals)
    right = told(Ending(Ended.PROVEN, best, duals=duals, statistics={"iterations": 3}))
    assert right.termination is Termination.LOCALLY_OPTIMAL
    assert right.duals == pytest.approx(duals)
    assert right.statistics["iterations"] == 3
    assert right.statistics["stationarity"] < 1e-9
    assert not right.message
    # Without multipliers, or with wrong ones, they are estimated.
    for other in (None, -duals, np.array([np.nan]), np.zeros(2)):
        again = told(Ending(Ended.PROVEN, best, duals=other))
        assert again.termination is Termination.LOCALLY_OPTIMAL
        assert again.duals == pytest.approx(duals, abs=1e-6)
    inside = told(Ending(Ended.PROVEN, np.array([0.1, 0.1])))
    assert inside.termination is Termination.FEASIBLE
    assert "stationarity of" in inside.message
    outside = told(Ending(Ended.PROVEN, np.array([1.0, 1.0])))
    assert outside.termination is Termination.FAILED
    assert outside.point is None
    assert "calls its point an optimum; violated most: row, 1" in outside.message
    nowhere = told(Ending(Ended.PROVEN, np.array([np.nan, 1.0])))
    assert nowhere.termination is Termination.FAILED


def test_multipliers_that_cancel_explain_nothing() -> None:
    """Of an equation stated twice, multipliers of 1e14 leave rounding that looks like anything."""
    program = CASES[TWICE].program
    assert isinstance(program, NonlinearProgram)
    point = np.array([-0.985339036, -np.sqrt(2 - 0.985339036**2), 0.0])
    duals = np.array([-3.35395698e14, 1.67697849e14])
    answer = Told(lambda p, start: Ending(Ended.PROVEN, point, duals=duals)).run(program, Request())
    assert answer.termination is Termination.FEASIBLE
    assert answer.statistics["stationarity"] > 1e-2
    assert np.abs(answer.duals).max() < 10


def test_other_endings_are_reported() -> None:
    good, bad = np.array([0.1, 0.1]), np.array([2.0, 2.0])
    stopped = Ending(Ended.STOPPED, good, limit=Limit.TIME)
    answer = told(stopped)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.TIME)
    answer = told(replace(stopped, point=bad))
    assert (answer.termination, answer.limit) == (Termination.NO_SOLUTION, Limit.TIME)
    kept = told(replace(stopped, point=bad), warm_start=good)
    assert (kept.termination, kept.limit) == (Termination.FEASIBLE, Limit.TIME)
    assert kept.point == pytest.approx(good)
    failed = told(Ending(Ended.FAILED, good, message="it: broke"))
    assert (failed.termination, failed.limit) == (Termination.FEASIBLE, None)
    assert failed.message.startswith("it: broke; its point is feasible")
    failed = told(Ending(Ended.FAILED, bad, message="it: broke"))
    assert failed.termination is Termination.FAILED
    away = told(Ending(Ended.UNBOUNDED, good, message="it: diverging"))
    assert (away.termination, away.point) == (Termination.NO_SOLUTION, None)
    mended = told(Ending(Ended.FAILED, np.array(DISK.expectation.point), message="it"))
    assert mended.termination is Termination.LOCALLY_OPTIMAL
    assert "yet its point is a local optimum" in mended.message


def test_infeasible_rows_are_named_in_the_paper_s_words() -> None:
    program = nonlinear(
        lambda x: (x[0], [x[0] ** 2, x[0] + x[1], x[1], x[0] ** 2 + x[1] ** 2]),
        [0.0, 0.0],
        row_lower=[-INF, 5, 1, -INF],
        row_upper=[1, INF, INF, 4],
        row_scale=[1, 1, 10, 1],
        rows=(
            Block("reach", "8", 0, 1),
            Block(
                "torque limit",
                "9",
                1,
                2,
                "at node {0} of interval {1}",
                np.array([[4, 2], [5, 2]]),
                "N m",
            ),
            Block("speed", "", 3, 1),
        ),
    )
    words = worst_blocks(program, np.array([3.0, -1.2]))
    assert (
        words
        == "eq. 8, reach, 8; speed, 6.44; eq. 9, torque limit, 3.2 N m at node 4 of interval 2"
    )
    assert worst_blocks(program, np.array([3.0, -1.2]), 1) == "eq. 8, reach, 8"
    answer = asked("ipopt", program)
    assert answer.termination is Termination.LOCALLY_INFEASIBLE
    assert answer.point is None
    assert "eq. 9, torque limit" in answer.message


def test_multipliers_are_estimated() -> None:
    for name in ("HS071", "HS043, Rosen and Suzuki", "HS100", "pendulum, 480 columns"):
        case = CASES[f"nonlinear: {name}"]
        assert isinstance(case.program, NonlinearProgram)
        found = estimated_duals(case.program, np.array(case.expectation.point))
        assert found == pytest.approx(np.array(case.expectation.duals), abs=1e-6), name


@pytest.mark.parametrize("ordering", ["metis", "minimum-degree"])
def test_an_equation_twice_is_solved_with_each_ordering(ordering):
    """Check that a point which Ipopt accepts with diverged multipliers is not the answer."""
    answer = asked("ipopt", CASES[TWICE].program, options={"ordering": ordering})
    assert answer.termination is Termination.LOCALLY_OPTIMAL, answer.message
    assert answer.primal_bound == pytest.approx(-2.0, rel=1e-7)
