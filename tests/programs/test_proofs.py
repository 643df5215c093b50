"""Exact verification, proofs that a program has no solution, and the kinds of evidence in results."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from small import INF, linear

import crosstrack as ct
from crosstrack.models.programs import ConeBlock, ConeKind, ConicProgram
from crosstrack.models.programs.certificates import (
    Proof,
    exact_verification,
    safe_bound,
)
from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.models.verification import Verification
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.run.proofs import prove_infeasible, prove_unbounded

# Safe bounds of programs whose bounds are rows, as CVXPY states them.


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize(
    ("cost", "side", "duals", "optimum"),
    [
        ([1.0, 2.0], (1.0, INF), [1.0, 0.0, 1.0], 1.0),  # the multipliers shrink
        ([-1.0, -2.0], (-INF, 1.0), [-2.0, 1.0, 0.0], -2.0),  # the multipliers grow
    ],
)
def test_multipliers_of_bounds_need_no_least_squares(
    cost, side, duals, optimum, quick, monkeypatch
):
    def fail(*arguments, **options):
        raise AssertionError("a least-squares problem was solved")

    monkeypatch.setattr("scipy.linalg.lstsq", fail)
    monkeypatch.setattr("scipy.sparse.linalg.lsqr", fail)
    low, high = [side[0], 0.0, 0.0], [side[1], INF, INF]
    program = linear(cost, [[1, 1], [1, 0], [0, 1]], low, high, -INF, INF)
    point = np.array([1.0, 0.0] if cost[0] > 0 else [0.0, 1.0])
    for noise in (1e-15, 1e-12):
        for first, second in itertools.product((-noise, noise), repeat=2):
            given = np.array(duals)
            given += np.array([first, second, second]) * (given != 0)
            bound = safe_bound(program, given, point, quick=quick)
            assert optimum - 10 * noise <= bound <= optimum


# Exact verification.


def test_exact_verification_equals_fractions_by_hand():
    # 0.1 * 3 is rounded up to the row's bound, which the exact product does not reach.
    program = linear([0.1, 1.0], [[0.1, 0.0], [1, 1]], [0.1 * 3, -INF], [INF, 4.0], 0.0, 3.0)
    point = np.array([3.0, 1.0])
    missing = Fraction(0.1 * 3) - 3 * Fraction(0.1)
    assert missing > 0
    assert program.verify(point).checks[0].worst == 0
    result = ct.verify(program, point, exact=True)
    assert Fraction(result.checks[0].worst) == missing
    assert result.objective == float(3 * Fraction(0.1) + 1)
    assert result.ok


@pytest.mark.parametrize("field", ["row_lower", "row_upper", "column_lower", "column_upper"])
@pytest.mark.parametrize("entry", [0, 1])
def test_each_inequality_is_checked_to_the_last_digit(field, entry):
    """A bound that excludes the plan by one unit in the last place is a violation of that size."""
    point = np.array([0.1, 0.7])
    program = linear([1, 1], np.eye(2), point, point, point, point)
    assert all(check.worst == 0 for check in exact_verification(program, point).checks)
    bound = np.array(getattr(program, field))
    bound[entry] = math.nextafter(bound[entry], INF if "lower" in field else -INF)
    moved = exact_verification(replace(program, **{field: bound}), point)
    worst = {check.name: check.worst for check in moved.checks}
    assert worst[field.split("_")[0]] == abs(bound[entry] - point[entry])
    assert sum(value > 0 for value in worst.values()) == 1


def test_exact_verification_of_numbers_beyond_floats():
    program = linear([1e200], [[1e200]], 0.0, 1.0, -INF, INF)
    result = ct.verify(program, np.array([1e200]), exact=True)
    assert not result.ok
    assert result.checks[0].worst == INF


def test_exact_verification_of_integers():
    program = linear([1.0], [[1.0]], 0, 5, 0, 5, integral=True)
    checks = {
        check.name: check for check in exact_verification(program, np.array([2 + 1e-9])).checks
    }
    assert checks["integrality"].worst == pytest.approx(1e-9)
    assert checks["integrality"].ok
    assert not exact_verification(program, np.array([2.5])).ok


def test_verification_of_a_solution_states_its_bound(tmp_path):
    program = linear([1.0, 2.0], [[1.0, 1 / 3]], 1.0, INF, 0.0, INF)
    solution = ct.solve(program, "scipy", isolate=False)
    assert ct.verify(program, solution, exact=True).bound is None  # SciPy returns no multipliers
    solution = replace(solution, duals=np.array([1.0]))
    result = ct.verify(program, solution, exact=True)
    assert (result.bound, result.proof) == (1.0, "exact")
    assert Verification.from_dict(json.loads(json.dumps(result.to_dict()))) == result
    assert "bound" not in ct.verify(program, solution).to_dict()


def test_exact_verification_refuses_other_models():
    with pytest.raises(ct.errors.UnsupportedFormulation, match="exact must be False"):
        ct.verify(_cone(), np.zeros(2), exact=True)


def test_check_verifies_exactly(tmp_path, capsys):
    from crosstrack.__main__ import main
    from crosstrack.instances.storage import write_model

    program = linear([1.0, 2.0], [[1.0, 1 / 3]], 1.0, INF, 0.0, INF)
    solution = replace(ct.solve(program, "scipy", isolate=False), duals=np.array([1.0]))
    write_model(program, tmp_path / "program.json")
    solution.save(tmp_path / "plan.json")
    paths = [str(tmp_path / "program.json"), str(tmp_path / "plan.json")]
    with pytest.raises(SystemExit, match="0"):
        main(["check", *paths, "--exact"])
    assert "bound 1 (exact)" in capsys.readouterr().out


# Programs without a solution.


def test_each_row_of_an_irreducible_infeasible_program_matters():
    # x + y >= 2.2, x <= 1, y <= 1.1 and z is free.
    rows, low, high = [[1, 1, 0], [1, 0, 0], [0, 1, 0]], [2.2, -INF, -INF], [INF, 1.0, 1.1]
    program = linear([1, 1, 1], rows, low, high, -INF, INF)
    proof = prove_infeasible(program)
    assert proof.proof == "exact"
    assert 0 < proof.value <= Fraction(2.2) - 1 - Fraction(1.1)
    for row in range(3):
        others = [k for k in range(3) if k != row]
        assert prove_infeasible(program.only_rows(np.array(others))) is None


def test_touching_constraints_are_not_infeasible():
    program = linear([1, 1], [[1, 1]], 2.0, 2.0, 0.0, 1.0)
    assert prove_infeasible(program) is None
    near = replace(program, column_upper=np.array([1.0, 1.0 - 1e-6]))
    assert prove_infeasible(near).proof == "exact"


@pytest.mark.parametrize("rows", [0, 1])
def test_programs_without_columns_and_with_extreme_coefficients(rows):
    empty = linear(np.zeros(0), np.zeros((rows, 0)), 1.0, 1.0, 0.0, 0.0)
    assert (prove_infeasible(empty) is not None) == bool(rows)
    assert prove_unbounded(empty) is None
    extreme = linear([1e-300, -1e300], [[5e-324, -5e-324]], 1.0, INF, 0.0, INF)
    assert prove_infeasible(extreme) is None
    assert prove_unbounded(extreme) is None


def test_crossed_bounds_are_infeasible():
    crossed = linear([1.0], [[1.0]], 0.0, 1.0, 2.0, 3.0)
    assert prove_infeasible(crossed).value > 0
    assert prove_infeasible(replace(crossed, column_lower=np.array([4.0]))).proof == "exact"


def test_an_unbounded_program_has_an_exact_direction():
    program = linear([-1.0, 0.0], [[1.0, -1.0]], -INF, 1 / 3, 0.0, INF)
    proof = prove_unbounded(program)
    assert proof.proof == "exact"
    assert proof.value < 0
    assert exact_verification(program, proof.point).ok
    # Each constraint that stops the direction ends the proof.
    for changed in (
        {"column_upper": np.array([INF, 5.0])},
        {"column_upper": np.array([5.0, INF])},
        {"cost": np.array([-1.0, 1.0])},
        {"matrix": sp.csr_array(np.array([[1.0, 0.0]]))},
    ):
        assert prove_unbounded(replace(program, **changed)) is None


def test_curvature_bounds_a_quadratic_program():
    fields = linear([-1.0, 0.0], [[1.0, -1.0]], -INF, 1.0, 0.0, INF).shared()
    flat = QuadraticProgram(hessian=sp.csr_array((2, 2)), **fields)
    assert prove_unbounded(flat).proof == "exact"
    curved = replace(flat, hessian=sp.csr_array(np.diag([0.0, 1.0])))
    assert prove_unbounded(curved) is None


def test_curvature_of_the_symmetric_part_bounds_a_quadratic_program():
    # H @ (1, 1) is 0 and (1, 1) @ H is not: from x[0] >= 2 / e the objective rises along (1, 1).
    e = 2.0**-42
    hessian = sp.csr_array(np.array([[1 + e, -1 - e], [-1.0, 1.0]]))
    assert not (hessian @ np.ones(2)).any()
    rows = linear([-1.0, -1.0], [[1.0, -1.0]], -1.0, 1.0, [8.0 / e, -INF], INF)
    assert prove_unbounded(QuadraticProgram(hessian=hessian, **rows.shared())) is None


@pytest.mark.parametrize(("upper", "termination"), [(2.0, "infeasible"), (INF, "unbounded")])
def test_solve_states_the_proof(upper, termination):
    program = linear([-1.0, 0.0], [[1, 1], [1, 1]], [3.0, -INF], [INF, upper], 0.0, INF)
    solution = ct.solve(program, "scipy", isolate=False)
    assert (str(solution.termination), solution.proof) == (termination, "exact")
    assert f"{termination} (exact)" in str(solution)


# Kinds of evidence in results.


def test_solve_states_a_safe_bound_or_the_solvers():
    program = linear([1.0, 2.0], [[1.0, 1 / 3]], 1.0, INF, 0.0, INF)
    bound, proof = program.proven(1.0, np.array([1.0]), np.array([1.0, 0.0]))
    assert 1 - 1e-12 <= bound <= 1
    assert proof == "safe bound"
    assert program.proven(1.0, np.array([0.5]), np.array([1.0, 0.0])) == (1.0, "solver's bound")
    assert program.proven(1.0, None, None) == (1.0, "solver's bound")


def test_terms_that_cancel_do_not_excuse_a_weak_bound():
    rows = [[1.0, -1.0, 0.0]]
    program = linear([1e12, -1e12, 1.0], rows, 0.0, 0.0, [1e6, 0, 1], [1e6, INF, INF])
    y, plan = np.array([1e12]), np.array([1e6, 1e6, 1.0])
    assert program.proven(1.0, y * (1 + 1e-15), plan) in ((1.0, "solver's bound"), (1.0, "exact"))
    assert ct.solve(program, "highs", isolate=False).gap == pytest.approx(0.0, abs=1e-9)


def _cone():
    """Return the program: minimise t with t >= |x| and x = 1."""
    return ConicProgram(
        cost=np.array([1.0, 0.0]), cone_matrix=sp.csr_array(np.eye(2)), cone_offset=np.zeros(2),
        cones=(ConeBlock("cone", "", 0, 2, kind=ConeKind.SECOND_ORDER),),
        column_lower=np.array([-INF, 1.0]), column_upper=np.array([INF, 1.0]),
    )  # fmt: skip


def test_multipliers_outside_of_the_dual_cones_are_stated():
    program, plan = _cone(), np.array([1.0, 1.0])
    assert program.proven(1.0, np.array([1.0, -1.0]), plan)[1] == "solver's bound"
    assert program.proven(1.0, np.array([1.0, -1.1]), plan)[1] == str(Proof.MOVED)


def test_one_solver_behind_two_backends_is_no_cross_check():
    program = linear([1.0, 2.0], [[1.0, 1 / 3]], 1.0, INF, 0.0, INF)
    solution = replace(ct.solve(program, "scipy", isolate=False), proof="solver's bound")
    scip = replace(solution, backend="scip")
    for solver, expected in (("SCIP", "solver's bound"), ("HIGHS", str(Proof.CHECKED))):
        other = replace(solution, backend="cvxpy", statistics={"solver": solver})
        assert judge("lp", [scip, other], program).proof == expected


@pytest.mark.parametrize(
    ("backends", "proofs", "expected"),
    [
        (("highs", "scip"), ("solver's bound",) * 2, "solver's bound, cross-checked"),
        (("highs", "scipy"), ("solver's bound",) * 2, "solver's bound"),
        (("highs",), ("solver's bound",), "solver's bound"),
        (("highs", "scip"), ("solver's bound", "safe bound"), "safe bound"),
        (("highs", "scip"), ("exact", "safe bound"), "exact"),
    ],
)
def test_the_verdict_states_the_kind_of_the_best_bound(backends, proofs, expected):
    program = linear([1.0, 2.0], [[1.0, 1 / 3]], 1.0, INF, 0.0, INF)
    solution = ct.solve(program, "scipy", isolate=False)
    answers = [
        replace(solution, backend=name, proof=proof)
        for name, proof in zip(backends, proofs, strict=True)
    ]
    verdict = judge("lp", answers, program)
    assert verdict.proof == verdict.to_dict()["proof"] == expected
    assert verdict.evidence.endswith(f"({expected})")
    apart = [replace(answer, dual_bound=0.9 - 0.1 * k) for k, answer in enumerate(answers)]
    assert judge("lp", apart, program).proof == proofs[0]
