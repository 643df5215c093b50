"""Safe and exact bounds, exact verification, and proofs that a program has no solution."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

import crosstrack as ct
from crosstrack.models.programs import ConeBlock, ConeKind, ConicProgram, intervals
from crosstrack.models.programs.certificates import (
    Proof,
    exact_verification,
    rational_bound,
    rounded_down,
    safe_bound,
    simple_fractions,
    tightened,
)
from crosstrack.models.programs.linear import MixedIntegerProgram, QuadraticProgram
from crosstrack.models.verification import Verification
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.run.proofs import prove_bound, prove_infeasible, prove_unbounded

INF = math.inf


def linear(cost, matrix, row_lower, row_upper, lower, upper, integral=False, offset=0.0):
    """Return a program; scalars are repeated."""
    matrix = np.atleast_2d(np.asarray(matrix, float))
    rows, size = matrix.shape
    return MixedIntegerProgram(
        cost=np.asarray(cost, float),
        matrix=sp.csr_array(matrix),
        row_lower=np.broadcast_to(np.asarray(row_lower, float), rows),
        row_upper=np.broadcast_to(np.asarray(row_upper, float), rows),
        column_lower=np.broadcast_to(np.asarray(lower, float), size),
        column_upper=np.broadcast_to(np.asarray(upper, float), size),
        integral=np.broadcast_to(np.asarray(integral, bool), size),
        offset=offset,
    )


def exact(vector):
    return [Fraction(entry) for entry in np.asarray(vector, float).tolist()]


def pairs(left, right):
    return zip(exact(left), exact(right), strict=True)


def times(matrix, vector):
    """Return ``matrix @ vector`` in rational arithmetic."""
    rows = matrix.toarray().tolist()
    return [
        sum((Fraction(a) * v for a, v in zip(row, vector, strict=True)), Fraction(0))
        for row in rows
    ]


def lagrangian(program, duals):
    """Return the exact bound of multipliers; -inf without one. An independent reference."""
    y, total = exact(duals), Fraction(program.offset)
    pull = times(program.matrix.T, y)
    reduced = [Fraction(c) - v for c, v in zip(program.cost.tolist(), pull, strict=True)]
    for factors, low, high in (
        (y, program.row_lower, program.row_upper),
        (reduced, program.column_lower, program.column_upper),
    ):
        for factor, a, b in zip(factors, low.tolist(), high.tolist(), strict=True):
            side = a if factor > 0 else b
            if factor and not math.isfinite(side):
                return -INF
            total += factor * Fraction(side) if factor else 0
    return total


def known(draw, *, whole, free):
    """Return a linear program, its optimal multipliers and its optimum, by complementary slackness.

    Data that are not whole have 20 binary digits, so that the costs are exact.
    """
    size = int(draw.integers(2, 20))
    rows = int(draw.integers(1, size + 1))
    unit = 1.0 if whole else 2.0**-20
    scale = 1.0 / unit
    matrix = np.round(draw.uniform(-5, 5, (rows, size)) * scale) * unit
    matrix *= draw.random((rows, size)) < 0.6
    x = draw.integers(-4, 5, size).astype(float)
    y = draw.integers(-4, 5, rows).astype(float)
    kind = draw.integers(0, 4 if free else 3, size)  # at a bound, at the other, between, free
    lower, upper = np.full(size, -INF), np.full(size, INF)
    reduced = np.where(kind < 2, np.round(draw.uniform(0, 4, size) * scale) * unit, 0.0)
    lower[kind == 0], upper[kind == 1] = x[kind == 0], x[kind == 1]
    between = kind == 2
    lower[between] = x[between] - 1
    upper[between & (draw.random(size) < 0.5)] = 9.0
    reduced[kind == 1] *= -1
    value = matrix @ x
    equal = draw.random(rows) < 0.4
    row_lower = np.where((y > 0) | equal, value, -INF)
    row_upper = np.where((y < 0) | equal, value, np.where(y == 0, value + 1, INF))
    cost = matrix.T @ y + reduced
    program = linear(cost, matrix, row_lower, row_upper, lower, upper)
    optimum = sum((c * v for c, v in zip(exact(cost), exact(x), strict=True)), Fraction(0))
    return program, x, y, optimum


# Safe and rational bounds.


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("free", [False, True])
def test_bounds_of_noisy_multipliers_are_below_the_optimum_and_near_it(whole, free):
    draw = np.random.default_rng(11 + 2 * whole + free)
    counts = Counter()
    for _ in range(125):
        program, x, y, optimum = known(draw, whole=whole, free=free)
        noise = 10.0 ** draw.integers(-15, -8) * draw.standard_normal(y.size)
        duals = y + np.where(y != 0, noise, 0.0)
        safe, rational = safe_bound(program, duals, x), rational_bound(program, duals)
        assert safe <= optimum
        assert rational is None or rational <= optimum
        near = 1e-6 * max(1.0, abs(float(optimum)))
        counts["safe"] += safe >= optimum - near
        counts["rational"] += rational is not None and rational == optimum
        counts["either"] += safe >= optimum - near or rational == optimum
    # Free columns in excess of the rows need multipliers that are exact.
    assert counts["safe"] >= (60 if free else 115), counts
    assert counts["either"] >= 122, counts


def test_the_plain_bound_is_the_exact_one_rounded_down():
    draw = np.random.default_rng(5)
    for spread in (0, 3, 30, 70):
        for _ in range(40):
            rows, size = (int(n) for n in draw.integers(1, 9, 2))

            def numbers(*shape, spread=spread):
                return draw.standard_normal(shape) * 10.0 ** draw.uniform(-spread, spread, shape)

            lower = numbers(size)
            row_lower = numbers(rows)
            program = linear(
                numbers(size), numbers(rows, size), row_lower, row_lower + abs(numbers(rows)),
                lower, lower + abs(numbers(size)), offset=float(numbers(1)[0]),
            )  # fmt: skip
            y = numbers(rows)
            bound, true = safe_bound(program, y), lagrangian(program, y)
            assert bound <= true
            pull = abs(program.matrix).T @ abs(y) + abs(program.cost)
            width = np.maximum(abs(program.column_lower), abs(program.column_upper))
            sides = np.maximum(abs(program.row_lower), abs(program.row_upper))
            size_of_terms = float(pull @ width + abs(y) @ sides + abs(program.offset))
            assert true - bound <= 1e-13 * size_of_terms + 1e-290


def test_without_its_error_bounds_the_bound_exceeds_the_exact_one(monkeypatch):
    """The random programs above detect a missing error bound."""
    monkeypatch.setattr(intervals, "ROUNDOFF", 0.0)
    draw, above = np.random.default_rng(5), 0
    for _ in range(40):
        matrix, y = draw.standard_normal((30, 4)), draw.standard_normal(30)
        program = linear(matrix.T @ y, matrix, 0.0, 0.0, -1e6, -1e6)
        above += safe_bound(program, y) > lagrangian(program, y)
    assert above


@pytest.mark.parametrize("name", ["sums", "difference", "smallest", "total"])
def test_interval_arithmetic_contains_the_exact_result(name):
    draw = np.random.default_rng(3)
    for spread in (2, 100, 300):
        for _ in range(60):
            a, b, c, d = draw.standard_normal((4, 7)) * 10.0 ** draw.uniform(
                -spread, spread, (4, 7)
            )
            a[draw.random(7) < 0.2] = 0.0
            with np.errstate(all="ignore"):
                if name == "sums":
                    matrix = sp.csr_array(np.array([a, b]))
                    value, error = intervals.sums(matrix, c)
                    for v, e, true in zip(value, error, times(matrix, exact(c)), strict=True):
                        assert not math.isfinite(e) or abs(Fraction(v) - true) <= Fraction(e)
                elif name == "difference":
                    low, high = intervals.difference(a, b, abs(c))
                    for p, q, w, lo, hi in zip(
                        exact(a), exact(b), exact(abs(c)), low, high, strict=True
                    ):
                        assert lo == -INF or Fraction(lo) <= p - q - w
                        assert hi == INF or p - q + w <= Fraction(hi)
                elif name == "smallest":
                    low = intervals.smallest(
                        intervals.Interval(np.minimum(a, b), np.maximum(a, b)),
                        intervals.Interval(np.minimum(c, d), np.maximum(c, d)),
                    )
                    true = [
                        min(p * q for p in left for q in right)
                        for left, right in zip(pairs(a, b), pairs(c, d), strict=True)
                    ]
                    assert all(
                        lo == -INF or lo <= t for lo, t in zip(low.tolist(), true, strict=True)
                    )
                else:
                    low = intervals.total(a)
                    assert low == -INF or rounded_down(sum(exact(a))) >= low
                    assert low == -INF or Fraction(math.nextafter(low, INF)) > sum(exact(a))


def test_sums_that_overflow_give_no_bound():
    assert intervals.total(np.array([1.7e308, 1.7e308])) == -INF
    assert intervals.total(np.array([1.0, np.nan])) == -INF
    program = linear([1e300, 1e300], [[1e300, -1e300]], 1.0, INF, 0.0, INF)
    assert safe_bound(program, np.array([1e300])) in (-INF, 0.0)


@pytest.mark.parametrize(
    "duals", [[0.0, 0.0], [-1.0, -2.0], [1e12, 1e12], [1e-300, -3.0], [np.nan, 0], [INF, 0], [1.0]]
)
def test_any_multipliers_give_a_valid_bound(duals):
    # x + 2 y >= 2 and 3 x + y >= 3 with the optimum at (4/5, 3/5).
    program = linear([1.0, 1.0], [[1, 2], [3, 1]], [2.0, 3.0], INF, 0.0, 10.0)
    assert safe_bound(program, np.array(duals)) <= Fraction(7, 5)
    rational = rational_bound(program, np.array(duals))
    assert rational is None or rational <= Fraction(7, 5)
    bound, proof = prove_bound(program, np.array(duals), np.array([0.8, 0.6])) or (-INF, "")
    assert Fraction(7, 5) - Fraction(1e-6) <= bound <= Fraction(7, 5)
    assert proof in (Proof.EXACT, Proof.SAFE)


def test_an_infinite_bound_is_taken_from_the_rows():
    # Neither column has an upper bound, and both reduced costs are below 0 by rounding.
    program = linear([0.1, 0.3], [[1.0, 3.0]], 0.6, 0.6, 0.0, INF)
    y = np.array([math.nextafter(0.1, 1.0)])
    assert lagrangian(program, y) == -INF
    assert 0.06 - 1e-12 <= safe_bound(program, y) <= Fraction(0.6) * Fraction(0.1)


def test_multipliers_move_if_rows_imply_no_bound():
    # The columns of the second row are unbounded together.
    program = linear([1.0, 1 / 3, -1 / 3], [[1, 0, 0], [0, 1, -1]], [1, 0], INF, 0.0, INF)
    y = np.array([1.0, math.nextafter(1 / 3, 1.0)])
    assert lagrangian(program, y) == -INF
    assert safe_bound(program, y) in (-INF, pytest.approx(1.0, abs=1e-9))
    one_sided = linear([1.0, 1 / 3], [[1, 0.1], [-1, 0.7]], [1, 0], INF, 0.0, INF)
    duals = np.linalg.solve(one_sided.matrix.toarray().T, one_sided.cost) * (1 + 1e-15)
    assert lagrangian(one_sided, duals) == -INF
    optimum = float(duals @ [1, 0])
    assert optimum - 1e-9 <= safe_bound(one_sided, duals) <= optimum + 1e-15


def test_tightened_costs_prove_a_bound():
    program = linear([1.0, 1 / 3, 0.1], [[1, 0.1, 0.3], [0.7, 0.2, 0.9]], [1, 1], INF, 0.0, INF)
    moved = tightened(program)
    assert (moved.cost < program.cost).all()
    solved = ct.solve(program, "scipy", isolate=False)
    bound, _ = prove_bound(program, np.zeros(2), solved.plan)
    assert solved.primal_bound - 1e-6 <= bound <= solved.primal_bound + 1e-9


def test_the_bound_of_a_mixed_integer_program_is_that_of_its_relaxation():
    program = linear([-1.0, -1.0], [[2, 2]], -INF, 3.0, 0.0, 5.0, integral=True)
    assert safe_bound(program, np.array([-0.5])) == pytest.approx(-1.5)
    assert rational_bound(program, np.array([-0.5])) == Fraction(-3, 2)  # the best plan has -1


@pytest.mark.parametrize("kind", ["definite", "dominant", "skew"])
def test_quadratic_bounds_are_below_the_optimum_and_near_it(kind):
    draw = np.random.default_rng(8)
    finite = 0
    for _ in range(30):
        program, x, y, _ = known(draw, whole=True, free=kind == "dominant")
        size = program.size
        root = draw.integers(-2, 3, (size, 2)).astype(float)
        hessian = np.diag(draw.integers(1, 4, size).astype(float))
        hessian += 0.0 if kind == "dominant" else root @ root.T
        bent = hessian @ x
        if kind == "skew":
            hessian = hessian + np.triu(np.full((size, size), 2.0**-46), 1)
            symmetric = (hessian + hessian.T) / 2
            bent = np.array([float(v) for v in times(sp.csr_array(symmetric), exact(x))])
        fields = {**program.shared(), "cost": program.cost - bent}
        quadratic = QuadraticProgram(hessian=sp.csr_array(hessian), **fields)
        value = exact_verification(quadratic, x).objective
        noise = 1e-12 * draw.standard_normal(y.size)
        bound = safe_bound(quadratic, y + np.where(y != 0, noise, 0.0), x + 1e-9)
        assert bound <= Fraction(value) + Fraction(1e-12 * abs(value))
        finite += bound >= value - 1e-6 * max(1.0, abs(value))
        rational = rational_bound(quadratic, y, x)
        if kind != "skew":
            assert rational == Fraction(value)
            assert bound <= rational
    assert finite >= 28


def test_a_tangent_is_that_of_the_symmetric_part():
    hessian = sp.csr_array(np.array([[1.0, 1e-13], [0.0, 1.0]]))
    program = QuadraticProgram(
        hessian=hessian, cost=np.zeros(2), matrix=sp.csr_array((0, 2)), row_lower=[], row_upper=[],
        column_lower=[1.0, 1.0], column_upper=[1.0, 1.0],
    )  # fmt: skip
    value = Fraction(1) + Fraction(1e-13) / 2
    for point in ([1.0, 1.0], [3.0, 2.0], [1e6, -1e6]):
        assert safe_bound(program, np.zeros(0), np.array(point)) <= value


def test_simple_fractions_refuse_long_denominators_and_what_is_not_finite():
    assert simple_fractions(np.array([0.5, 1 / 3]), 2) == [Fraction(1, 2), Fraction(1, 3)]
    assert simple_fractions(np.array([0.5]), 2) is None
    assert simple_fractions(np.array([INF]), 1) is None
    assert simple_fractions(np.random.default_rng(0).random(1000), 1000) is None


def test_rounding_of_fractions():
    assert rounded_down(Fraction(1, 10)) == math.nextafter(0.1, 0.0)
    assert rounded_down(Fraction(-1, 10)) == -0.1
    assert rounded_down(-(Fraction(10) ** 400)) == -INF
    assert math.isfinite(rounded_down(Fraction(10) ** 400))


# Exact verification.


def test_exact_verification_equals_fractions_by_hand():
    program = linear([0.1, 0.2], [[0.1, 0.2], [1, 1]], [0.3, -INF], [INF, 2.0], 0.0, 1.0)
    point = np.array([1.0, 1.0])
    result = ct.verify(program, point, exact=True)
    row = Fraction(0.1) + Fraction(0.2)
    missing = Fraction(0.3) - row  # 0.1 + 0.2 exceeds 0.3 in rational arithmetic, too
    assert result.checks[0].worst == max(0.0, float(missing))
    assert Fraction(result.objective) == Fraction(float(row))
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


@pytest.mark.parametrize(("upper", "termination"), [(2.0, "infeasible"), (INF, "unbounded")])
def test_solve_states_the_proof(upper, termination):
    program = linear([-1.0, 0.0], [[1, 1], [1, 1]], [3.0, -INF], [INF, upper], 0.0, INF)
    solution = ct.solve(program, "scipy", isolate=False)
    assert (str(solution.termination), solution.proof) == (termination, "exact")
    assert f"{termination} (exact)" in str(solution)


# What a result states.


def test_solve_states_a_safe_bound_or_the_solvers():
    program = linear([1.0, 2.0], [[1.0, 1 / 3]], 1.0, INF, 0.0, INF)
    bound, proof = program.proven(1.0, np.array([1.0]), np.array([1.0, 0.0]))
    assert 1 - 1e-12 <= bound <= 1
    assert proof == "safe bound"
    assert program.proven(1.0, np.array([0.5]), np.array([1.0, 0.0])) == (1.0, "solver's bound")
    assert program.proven(1.0, None, None) == (1.0, "solver's bound")


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
