"""What quadratic backends share: the polish, the proofs, and the judgement of what a solver says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings, strategies as st
from quadratics import CASES, HERE, Told, asked, programs, told

import crosstrack as ct
from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.solvers.conformance.convex import certified
from crosstrack.solvers.conformance.quadratic import quadratic
from crosstrack.solvers.contract.backend import Limit, Request, Termination
from crosstrack.solvers.programs.attempts import Ended, Ending
from crosstrack.solvers.qp.polishing import _corrected, polished
from crosstrack.solvers.qp.proofs import contradiction, examined, recedes
from crosstrack.solvers.qp.quality import measured

# The polish.


@settings(max_examples=40, deadline=None, derandomize=True)
@given(programs(), st.integers(0, 10**6))
def test_polish_removes_noise(program: QuadraticProgram, seed: int) -> None:
    answer = asked("clarabel", program)
    if answer.termination is not Termination.OPTIMAL:
        return
    draw = np.random.default_rng(seed)
    start = measured(
        program,
        answer.point + 1e-5 * draw.standard_normal(program.size),
        answer.duals + 1e-5 * draw.standard_normal(program.row_count),
    )
    assert start is not None
    better = polished(program, start)
    assert better.merit <= start.merit
    assert better.proves(1e-9, 1e-9), better.describe()


def test_a_guess_of_active_bounds_is_corrected() -> None:
    program = quadratic([1, 1], [-1, 1], lower=0, upper=3)
    # The first column has a multiplier of the wrong sign, and the second is below its bound.
    signs = _corrected(program, np.array([-1, 0], np.int8), np.array([0.0, -1.0]), np.zeros(0))
    assert signs.tolist() == [0, -1]
    signs = _corrected(program, np.array([1, 1], np.int8), np.array([3.0, 3.0]), np.zeros(0))
    assert signs.tolist() == [0, 0]


@pytest.mark.parametrize(("distance", "proven"), [(0.9, True), (1.1, False), (-1.1, False)])
def test_an_optimum_needs_a_bound_within_the_gap(distance: float, proven: bool) -> None:
    quality = measured(quadratic([1], [-100]), np.array([100.0]), None)
    assert quality is not None and quality.objective == -5000
    away = replace(quality, bound=-5000 - distance * 1e-6 * 5000)
    assert away.proves(1e-6, 1e-9) is proven


def test_polish_reaches_the_last_digits() -> None:
    case = CASES["quadratic: portfolio, 200 columns"]
    rough = asked(
        "osqp", case.program, options={"eps": 1e-4, "polish": False}, gap=1, tolerance=1e-2
    )
    start = measured(case.program, rough.point, rough.duals)
    assert start is not None
    assert not start.proves(1e-6, 1e-6)
    exact = polished(case.program, start)
    assert exact.clean
    assert np.abs(exact.point - np.array(case.expectation.point)).max() < 1e-12


def test_polish_never_makes_worse() -> None:
    program = CASES["quadratic: infeasible rows"].program
    start = measured(program, np.array([0.5, 0.5]), None)
    assert start is not None
    assert polished(program, start).merit <= start.merit
    assert not polished(program, start).proves(1e-6, 1e-6)


def test_polish_stops_on_request() -> None:
    program = CASES["quadratic: rows from below"].program
    start = measured(program, np.array([1.01, 0.99]), None)
    assert start is not None
    assert polished(program, start, lambda: True) is start


def test_polish_can_be_switched_off() -> None:
    program = CASES["quadratic: badly scaled"].program
    rough = asked("scs", program, options={"polish": False})
    exact = asked("scs", program)
    assert "polish" in exact.seconds
    assert "polish" not in rough.seconds
    assert exact.point == pytest.approx([50, 1e-3], abs=1e-9)


# Proofs.


def test_a_contradiction_is_recomputed() -> None:
    program = CASES["quadratic: infeasible rows"].program
    assert contradiction(program, np.array([1.0, -1.0]))
    assert contradiction(program, np.array([1e-12, -1e-12]))
    for wrong in ([-1.0, 1.0], [1.0, 0.0], [0.0, 0.0], [1.0, -1.0001], [np.nan, np.nan]):
        assert not contradiction(program, np.array(wrong)), wrong
    # A weak ray: 1e-8 x >= 1 on a free column is met at 1e8, however small it looks.
    faint = quadratic([0], [0], [[1e-8]], 1)
    assert not contradiction(faint, np.array([1.0]))
    # Bounded columns may take what does not cancel.
    boxed = CASES["quadratic: infeasible within the bounds"].program
    assert contradiction(boxed, np.array([-1.0]))


def test_a_recession_direction_is_recomputed() -> None:
    flat = CASES["quadratic: unbounded along a flat direction"].program
    assert recedes(flat, np.array([1.0, -1.0]))
    assert recedes(flat, np.array([1e9, -1e9]))
    for wrong in ([-1.0, 1.0], [1.0, 1.0], [1.0, -0.999], [0.0, 0.0]):
        assert not recedes(flat, np.array(wrong)), wrong
    # Curvature of 1e-12 is curvature: this has its minimum, far away.
    assert not recedes(quadratic([1e-12], [-1]), np.array([1.0]))
    rows = CASES["quadratic: unbounded within rows"].program
    assert recedes(rows, np.array([0.0, 1.0]))
    assert not recedes(rows, np.array([1.0, 0.0]))


def test_phase_one_decides_feasibility() -> None:
    for name, case in CASES.items():
        if case.arguments or case.stop_after is not None:
            continue
        program = case.program
        assert isinstance(program, QuadraticProgram)
        if (program.column_lower > program.column_upper).any() or not program.size:
            continue
        if (program.row_lower > program.row_upper).any():
            continue
        found = examined(program)
        kind = case.expectation.termination[0]
        assert found.infeasible == (kind is Termination.INFEASIBLE), name
        assert found.unbounded == (kind is Termination.UNBOUNDED), name


def test_a_point_for_an_infeasible_program_is_caught() -> None:
    for name in ("quadratic: infeasible rows", "quadratic: infeasible by a thousandth"):
        answer = told(
            CASES[name].program,
            lambda p: Ending(Ended.PROVEN, np.array([0.5, 0.5]), duals=np.zeros(p.row_count)),
        )
        assert answer.termination is Termination.INFEASIBLE
        assert answer.point is None
        assert answer.statistics["proof"] == "a phase 1 of our own"


def test_qpsolvers_returns_points_for_infeasible_programs_that_we_refuse() -> None:
    """Reason for recomputing all claims: solvers behind qpsolvers returned points that do not exist."""
    program = CASES["quadratic: infeasible equalities"].program
    for name in HERE:
        assert asked(name, program).termination is Termination.INFEASIBLE, name


@pytest.mark.parametrize("ended", [Ended.INFEASIBLE, Ended.UNBOUNDED, Ended.UNCLEAR])
def test_a_false_claim_without_proof_is_no_answer(ended: Ended) -> None:
    program = CASES["quadratic: rows from below"].program
    liar = Told(lambda p: Ending(ended, np.array([1.0, 0.0]), duals=np.array([1.0, 1.0])))
    answer = liar.run(program, Request())
    assert answer.termination is Termination.FAILED
    assert "which nothing proves" in answer.message
    assert liar.asked == 3  # once more with each proximal term


def test_a_proximal_attempt_comes_after_a_failure() -> None:
    program = CASES["quadratic: many optimal points"].program

    def say(posed: QuadraticProgram) -> Ending:
        if posed.hessian.toarray()[0, 0] == 1:
            return Ending(Ended.FAILED, message="too flat")
        # The optimum of the proximal program around the origin.
        at = 2 / (2 + 1e-2)
        return Ending(Ended.PROVEN, np.array([at, at]), duals=np.zeros(0))

    answer = told(program, say)
    assert answer.termination is Termination.OPTIMAL
    assert answer.statistics["attempts"] == 2
    assert answer.primal_bound == pytest.approx(-2, abs=1e-12)


def test_an_unclear_ending_is_resolved() -> None:
    unclear = Ending(Ended.UNCLEAR)
    for name, kind in (
        ("quadratic: infeasible, its objective unbounded", Termination.INFEASIBLE),
        ("quadratic: unbounded within rows", Termination.UNBOUNDED),
    ):
        assert told(CASES[name].program, lambda p: unclear).termination is kind


def test_wrong_multipliers_are_corrected_or_prove_nothing() -> None:
    case = CASES["quadratic: rows from below"]
    best = np.array(case.expectation.point)
    mended = told(case.program, lambda p: Ending(Ended.PROVEN, best, duals=np.array([-9.0, 9.0])))
    assert mended.termination is Termination.OPTIMAL
    assert mended.duals == pytest.approx([2, 0])
    raw = Told(lambda p: Ending(Ended.PROVEN, best, duals=np.array([-9.0, 9.0])))
    answer = raw.run(case.program, Request(options={"polish": False}))
    assert answer.termination is Termination.FEASIBLE
    assert "above the bound" in answer.message
    assert answer.dual_bound < answer.primal_bound - 1


def test_a_point_that_is_not_feasible_is_named_with_its_residuals() -> None:
    case = CASES["quadratic: rows from below"]
    liar = Told(lambda p: Ending(Ended.PROVEN, np.array([0.9, 0.9]), duals=np.zeros(2)))
    answer = liar.run(case.program, Request(options={"polish": False}))
    assert answer.termination is Termination.FAILED
    assert answer.point is None
    assert "primal residual 0.1" in answer.message


def test_a_stopped_solver_keeps_its_limit() -> None:
    case = CASES["quadratic: rows from below"]
    stopped = Ending(Ended.STOPPED, np.array([3.0, 3.0]), limit=Limit.TIME)
    answer = told(case.program, lambda p: stopped)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.TIME)
    outside = replace(stopped, point=np.array([0.0, 0.0]))
    answer = told(case.program, lambda p: outside)
    assert (answer.termination, answer.limit) == (Termination.NO_SOLUTION, Limit.TIME)
    kept = Told(lambda p: outside).run(case.program, Request(warm_start=np.array([1.0, 1.0])))
    assert (kept.termination, kept.primal_bound) == (Termination.FEASIBLE, 2.0)


def test_the_bound_of_an_iteration_limit() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    answer = asked("scs", program, options={"max_iters": 3, "polish": False})
    assert answer.termination in (Termination.NO_SOLUTION, Termination.FEASIBLE)
    assert answer.limit is Limit.ITERATIONS


# Through the public face.


def test_solve_verifies_and_bounds() -> None:
    program = CASES["quadratic: receding horizon, 120 columns"].program
    for name in ("clarabel", "osqp", "piqp"):  # the last one in a worker: it cannot be interrupted
        solution = ct.solve(program, name)
        assert solution.termination is Termination.OPTIMAL, str(solution)
        assert solution.gap is not None
        assert solution.gap <= 1e-9
        assert solution.plan == pytest.approx(np.array(CASES_POINT), abs=1e-8)
        assert {"build", "solve", "total"} <= set(solution.seconds)


CASES_POINT = CASES["quadratic: receding horizon, 120 columns"].expectation.point


def test_a_warm_start_saves_iterations() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    best = np.array(CASES["quadratic: portfolio, 200 columns"].expectation.point)
    for name in ("osqp", "scs"):
        cold = asked(name, program).statistics["iterations"]
        warm = asked(name, program, warm_start=best).statistics["iterations"]
        assert warm <= cold, name


def test_a_certified_program_is_certified() -> None:
    draw = np.random.default_rng(0)
    root, matrix = draw.standard_normal((6, 6)), draw.standard_normal((4, 6))
    duals, reduced = np.array([1.0, -2.0, 0.0, 0.5]), np.array([0.0, 1.0, 0.0, -1.0, 0.0, 0.0])
    point = draw.standard_normal(6)
    program = certified(root @ root.T, sp.csr_array(matrix), point, duals, reduced)
    assert program.dual_bound(duals, point) == pytest.approx(program.objective(point), abs=1e-9)


def test_statistics_show_polishing() -> None:
    program = CASES["quadratic: badly scaled"].program
    raw = asked("osqp", program, options={"eps": 1e-3, "polish": False}, gap=1, tolerance=1e-2)
    assert raw.statistics["polished"] == "no"
    assert asked("osqp", program).statistics["polished"] == "yes"


def test_a_comparison_judges_the_solver_alone() -> None:
    program = CASES["quadratic: badly scaled"].program
    options = {"scs": {"polish": True}}
    found = ct.compare(program, ["osqp", "scs"], backend_options=options, time_limit=20)
    osqp, scs = found.solutions
    assert osqp.options["backend_options"] == {"polish": False}
    assert (osqp.statistics["polished"], "polish" in osqp.seconds) == ("no", False)
    assert scs.options["backend_options"] == {"polish": True}
    assert scs.statistics["polished"] == "yes"
