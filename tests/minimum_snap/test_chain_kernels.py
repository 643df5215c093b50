"""The interior point's kernels against dense algebra, and the extremes outside bounds."""

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from minimum_snap.corridors import INF
from numpy.polynomial import polynomial

from crosstrack.models.minimum_snap.formulations.instants import Limits, outside
from crosstrack.solvers.minimum_snap.chain_kernels import (
    bound_gradient,
    factorise,
    multiply,
    row_values,
    solve_factors,
    transposed,
)


def plain(kernel):
    """Return the plain-Python meaning of a compiled kernel."""
    return getattr(kernel, "py_func", kernel)


def system(seed, count=4, n=3, own=2, c=6):
    generator = np.random.default_rng(seed)
    width = 2 * n + own
    cost = generator.normal(size=(count, c, width))
    sizes = generator.integers(0, 5, count)
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    rows = generator.normal(size=(int(start[-1]), width))
    weight = 10 ** generator.uniform(-3, 3, rows.shape[0])
    fixed = generator.random((count + 1, n)) < 0.3
    return cost, rows, start, weight, fixed


def dense(cost, rows, start, weight, fixed):
    """Return the stacked rows in all coordinates, and the places of knots and interiors."""
    count, _, width = cost.shape
    n = fixed.shape[1]
    own = width - 2 * n
    total = (count + 1) * n + count * own
    places = [
        np.concatenate(
            [np.arange(k * n, (k + 2) * n), (count + 1) * n + np.arange(k * own, (k + 1) * own)]
        )
        for k in range(count)
    ]
    stacked = []
    for k in range(count):
        for row in [
            *cost[k],
            *(rows[start[k] : start[k + 1]] * weight[start[k] : start[k + 1], None]),
        ]:
            wide = np.zeros(total)
            wide[places[k]] = row
            stacked.append(wide)
    matrix = np.array(stacked)
    free = np.concatenate([~fixed.ravel(), np.ones(count * own, bool)])
    return matrix, free


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shape", [(4, 3, 2, 6), (1, 1, 0, 2), (5, 4, 0, 4), (3, 2, 3, 5)])
def test_factors_solve_the_dense_normal_equations(seed, shape):
    count, n, own, c = shape
    cost, rows, start, weight, fixed = system(seed, count, n, own, c)
    matrix, free = dense(cost, rows, start, weight, fixed)
    generator = np.random.default_rng(seed + 100)
    image = matrix[:, free].T @ generator.normal(size=len(matrix))  # in the range for any rank
    right = np.zeros(free.size)
    right[free] = image
    results = []
    for form in (lambda f: f, plain):
        knots = right[: (count + 1) * n].reshape(count + 1, n).copy()
        inner = right[(count + 1) * n :].reshape(count, own).copy()
        factors, last = np.zeros((count, own + n, own + 2 * n)), np.zeros((n, n))
        form(factorise)(cost, rows, start, weight, fixed, factors, last)
        form(solve_factors)(factors, last, fixed, knots, inner)
        results.append((factors, last, knots, inner))
    for compiled, python in zip(*results, strict=True):
        assert np.allclose(
            compiled, python, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(python).max(initial=0))
        )
    found = np.concatenate([results[0][2].ravel(), results[0][3].ravel()])
    if np.linalg.matrix_rank(matrix[:, free]) == free.sum():
        assert np.abs(found[~free]).max(initial=0.0) == 0.0
        expected = np.linalg.lstsq(matrix[:, free].T @ matrix[:, free], image, rcond=None)[0]
        assert np.allclose(
            found[free], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max(initial=1)
        )


@pytest.mark.parametrize("seed", range(3))
def test_products_are_those_of_the_dense_rows(seed):
    cost, rows, start, _, fixed = system(seed)
    count, c, _ = cost.shape
    n = fixed.shape[1]
    generator = np.random.default_rng(seed)
    knots, inner = generator.normal(size=(count + 1, n)), generator.normal(size=(count, 2))
    matrix, _ = dense(cost, rows[:0], np.zeros(count + 1, np.int64), np.empty(0), fixed)
    bounds, _ = dense(cost[:, :0], rows, start, np.ones(len(rows)), fixed)
    point = np.concatenate([knots.ravel(), inner.ravel()])
    for form in (lambda f: f, plain):
        assert np.allclose(form(multiply)(cost, knots, inner).ravel(), matrix @ point)
        assert np.allclose(form(row_values)(rows, start, knots, inner), bounds @ point)
        value, push = generator.normal(size=(count, c)), generator.normal(size=len(rows))
        g_knots, g_inner = np.ones_like(knots), np.ones_like(inner)
        form(transposed)(cost, value, g_knots, g_inner)
        form(bound_gradient)(rows, start, push, g_knots, g_inner)
        expected = 1 + matrix.T @ value.ravel() + bounds.T @ push
        assert np.allclose(np.concatenate([g_knots.ravel(), g_inner.ravel()]), expected)


def reported(powers, lower, upper, threshold=1e-9):
    """Return the rows, places and shares of `outside`."""
    edges = np.asarray(lower, float), np.asarray(upper, float)
    sizes = (np.maximum(1.0, np.where(np.isfinite(edge), np.abs(edge), 1.0)) for edge in edges)
    rows = np.arange(len(powers))
    limits = Limits(rows, rows, rows, rows, np.ones((len(powers), 1)), *edges, *sizes)
    at, share = outside(powers, limits, threshold)
    return at.row, at.s, share


@settings(max_examples=60, deadline=None)
@given(
    roots=st.lists(st.floats(-0.5, 1.5), min_size=0, max_size=6),
    sign=st.sampled_from([-1.0, 1.0]),
    share=st.floats(0.01, 1.2),
)
@example(roots=[0.5], sign=-1.0, share=0.5)
@example(roots=[0.25, 0.5, 0.75], sign=-1.0, share=0.1)
@example(roots=[0.0, 1.0], sign=-1.0, share=0.5)
def test_extremes_outside_against_known_roots(roots, sign, share):
    """The slope's roots are given, however close."""
    powers = polynomial.polyint(polynomial.polyfromroots(roots)) * sign * 10
    at = np.array([0.0, 1.0, *[r for r in roots if 0 <= r <= 1]])
    values = polynomial.polyval(at, powers)
    top, low = values.max(), values.min()
    upper = top - share * (top - low)
    row, place, found = reported(powers[None], [-INF], [upper])
    worst = (top - upper) / max(1.0, abs(upper))
    if worst > 1e-7:
        assert row.size, (powers, upper)
        assert found.max() == pytest.approx(worst, rel=1e-6, abs=1e-9)
        values = (polynomial.polyval(place, powers) - upper) / max(1.0, abs(upper))
        assert np.allclose(values, found, atol=1e-9)
    row, _, found = reported(-powers[None], [-upper], [INF])
    assert (found.max() if row.size else 0.0) == pytest.approx(max(worst, 0.0), rel=1e-6, abs=1e-7)


def test_adjacent_extremes_are_distinguished():
    roots = np.array([0.5103, 0.5168, 0.5235])
    powers = 1e4 * polynomial.polyint(-polynomial.polyfromroots(roots))
    values = polynomial.polyval(roots, powers)
    powers[0] -= values.max()
    _, place, found = reported(powers[None], [-INF], [-1e-4])
    assert place == pytest.approx(roots[[0, 2]], abs=1e-6)
    assert found == pytest.approx(1e-4 + values[[0, 2]] - values.max(), abs=1e-12)


def test_many_rows_are_many_answers():
    """Every second row is far outside."""
    powers = np.tile([[1.0, 0.1, -0.13], [0.0, 0.0, 0.0]], (500, 1))
    rows, _, shares = reported(powers, np.full(1000, -INF), np.full(1000, 0.5))
    assert rows.tolist() == list(range(0, 1000, 2))
    assert (shares > 0).all()
    assert reported(powers[:0], np.empty(0), np.empty(0))[0].size == 0
    assert reported(powers, np.full(1000, -INF), np.full(1000, INF))[0].size == 0
