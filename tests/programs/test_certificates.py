"""Safe and rational bounds are below the optimum, and near it."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from small import INF, exact, linear, pairs, times

import crosstrack as ct
from crosstrack.models.programs import curvature, intervals, safe_bounds
from crosstrack.models.programs.certificates import (
    Proof,
    exact_verification,
    rational_bound,
    rounded_down,
    safe_bound,
    simple_fractions,
    tightened,
)
from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.solvers.run.proofs import prove_bound


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


@pytest.mark.parametrize("count", [40, pytest.param(125, marks=pytest.mark.slow)])
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("free", [False, True])
def test_bounds_of_noisy_multipliers_are_below_the_optimum_and_near_it(whole, free, count):
    draw = np.random.default_rng(11 + 2 * whole + free)
    counts = Counter()
    for _ in range(count):
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
    assert counts["safe"] >= (0.48 if free else 0.92) * count, counts
    assert counts["either"] >= 0.976 * count, counts


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


@pytest.mark.parametrize("skew", [0.0, 1e-13])
def test_the_tangent_is_enclosed(skew):
    draw = np.random.default_rng(2)
    for _ in range(20):
        root = draw.standard_normal((4, 4))
        hessian = sp.csr_array(root @ root.T + skew * np.triu(root))
        p, cost = 100 * draw.standard_normal(4), draw.standard_normal(4)
        fields = linear(cost, np.zeros((0, 4)), 0, 0, -INF, INF).shared()
        program = QuadraticProgram(hessian=hessian, **fields)
        tangent = safe_bounds._Lagrangian.of(program, p, 1.0)
        bent = [
            (v + w) / 2
            for v, w in zip(times(hessian, exact(p)), times(hessian.T, exact(p)), strict=True)
        ]
        gradient = [c + v for c, v in zip(exact(cost), bent, strict=True)]
        low, high = exact(tangent.cost.low), exact(tangent.cost.high)
        assert all(a <= g <= b for a, g, b in zip(low, gradient, high, strict=True))
        true = -sum(x * v for x, v in zip(exact(p), bent, strict=True)) / 2
        assert true - Fraction(1e-8) < tangent.constant <= true
        flat = np.abs(root).sum() * np.abs(p).max() * 1e-12
        assert (tangent.cost.high - tangent.cost.low).max() < 10 * flat


def test_implied_bounds_are_rounded_outwards():
    draw = np.random.default_rng(4)
    for _ in range(100):
        row, lower = np.abs(draw.standard_normal((2, 4))) + 0.1
        side = float(row @ lower + draw.random())
        program = linear(np.ones(4), [row, -row], [-INF, -side], [side, INF], lower, INF)
        weak = np.ones(4, bool)
        limits = safe_bounds.Interval(program.column_lower, program.column_upper)
        high = safe_bounds._implied(program, limits, weak).high
        terms = [c * v for c, v in zip(exact(row), exact(lower), strict=True)]
        for k in range(4):
            true = (Fraction(side) - sum(terms) + terms[k]) / Fraction(row[k])
            assert true <= Fraction(high[k]) <= true * (1 + Fraction(1e-12))


def test_reduced_costs_of_intervals_contain_those_of_their_ends():
    draw = np.random.default_rng(7)
    matrix, cost = draw.standard_normal((3, 4)), draw.standard_normal(4)
    low = draw.standard_normal(3)
    high = low + draw.random(3)
    program = linear(cost, matrix, 0.0, 0.0, 0.0, 1.0)
    costs = safe_bounds.Interval(cost, cost)
    result = safe_bounds._reduced(program, costs, safe_bounds.Interval(low, high))
    for ends in np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3):
        pull = times(program.matrix.T, exact(ends))
        for a, c, v, b in zip(result.low, exact(cost), pull, result.high, strict=True):
            assert Fraction(a) <= c - v <= Fraction(b)


def test_corrected_multipliers_enclose_exact_ones():
    draw = np.random.default_rng(6)
    for _ in range(40):
        (a, b), (c, d) = matrix = draw.standard_normal((2, 2))
        cost = draw.standard_normal(2)
        program = linear(cost, matrix, 1.0, 1.0, -INF, INF)
        y = np.linalg.solve(matrix.T, cost)
        interval = safe_bounds.Interval(cost, cost)
        low, high = safe_bounds._corrected(program, interval, y, np.arange(2), 1e6)
        (a, b, c, d), (p, q) = exact([a, b, c, d]), exact(cost)
        solution = [(p * d - q * c) / (a * d - b * c), (q * a - p * b) / (a * d - b * c)]
        assert all(u <= v <= w for u, v, w in zip(exact(low), solution, exact(high), strict=True))
        assert (high - low).max() < 1e-9


def test_a_nonconvex_program_has_no_safe_bound():
    # The tangent at the saddle point is 0, and the objective at (1, -1) is -1.
    hessian = sp.csr_array(np.array([[1.0, 2.0], [2.0, 1.0]]))
    fields = linear([0.0, 0.0], [[1.0, 1.0]], -INF, INF, -1.0, 1.0).shared()
    program = QuadraticProgram(hessian=hessian, **fields)
    assert program.proven(0.0, np.zeros(1), np.zeros(2)) == (0.0, "solver's bound")
    solution = ct.solve(
        replace(program, hessian=sp.csr_array(np.eye(2))), "clarabel", isolate=False
    )
    wrong = replace(solution, duals=np.zeros(1), plan=np.zeros(2))
    assert ct.verify(program, wrong, exact=True).bound is None


@pytest.mark.parametrize("box", [1e3, 1e6, INF])
def test_curvature_below_0_within_the_tolerance_of_conversions_enters_the_bound(box):
    # The eigenvalue along (1, -1) is -9e-10: require_convex accepts it as rounding.
    hessian = sp.csr_array(np.array([[1.0, 1 + 9e-10], [1 + 9e-10, 1.0]]))
    fields = linear([0.0, 0.0], np.zeros((0, 2)), 0, 0, -box, box).shared()
    program = QuadraticProgram(hessian=hessian, **fields)
    program.require_convex()
    bound = safe_bound(program, np.zeros(0), np.zeros(2))
    point = np.array([1.0, -1.0]) * min(box, 1e9)
    lowest = exact_verification(program, point).objective
    assert bound <= lowest < 0
    assert box == INF or bound >= 2 * lowest
    assert rational_bound(program, np.zeros(0), np.zeros(2)) is None
    assert program.proven(0.0, np.zeros(0), np.zeros(2)) == (0.0, "solver's bound")


@pytest.mark.parametrize("count", [4, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("lowest", [1e-3, 0.0, -1e-12, -1.0])
def test_the_least_curvature_is_below_that_of_every_direction(monkeypatch, sparse, lowest, count):
    if sparse:
        monkeypatch.setattr(curvature, "LARGEST_DENSE", 0)
    draw, proven = np.random.default_rng(9), Counter()
    for _ in range(count):
        size = int(draw.integers(2, 25))
        turn = np.linalg.qr(draw.standard_normal((size, size)))[0]
        values = np.append(lowest, draw.random(size - 1) + max(lowest, 0.0))
        scales = 2.0 ** draw.integers(-20, 20, size)
        matrix = scales[:, None] * (turn * values @ turn.T) * scales
        matrix = 0.5 * (matrix + matrix.T)
        least = curvature.least_curvature(sp.csr_array(matrix))
        proven["convex"] += (least >= 0).all()
        proven["none"] += np.isneginf(least).any()
        if np.isneginf(least).any():
            continue
        for x in ((turn / scales[:, None]).T, draw.standard_normal((3, size))):
            for entry in x:
                values = exact(entry)
                product = times(sp.csr_array(matrix), values)
                excess = sum(v * w for v, w in zip(values, product, strict=True))
                assert excess >= sum(
                    Fraction(d) * v**2 for d, v in zip(least.tolist(), values, strict=True)
                )
    assert proven["convex"] == (count if lowest > 0 else 0) or lowest == 0
    assert proven["none"] == (count if lowest == -1.0 else 0)


def test_a_singular_hessian_of_integers_is_convex_exactly():
    root = np.array([[1.0, 2.0], [3.0, -1.0], [2.0, 2.0], [0.0, 0.0]])
    assert (curvature.least_curvature(sp.csr_array(root @ root.T)) >= 0).all()
    assert (curvature.least_curvature(sp.csr_array([[1.0, 1.0], [1.0, 1 - 2**-53]])) < 0).any()
    assert np.isneginf(curvature.least_curvature(sp.csr_array([[0.0, 1.0], [1.0, 9.0]]))).all()


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
