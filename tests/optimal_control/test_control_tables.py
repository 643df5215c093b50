"""Tables of data: smoothness inside, and extrapolation."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline, RegularGridInterpolator
from scipy.sparse.linalg import spsolve

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import Model, OptimalControlProblem

DRAW = np.random.default_rng(1)


@pytest.mark.parametrize("points", [2, 3, 4, 5, 30, 3_000])
def test_one_argument_is_scipys_spline(points):
    grid = np.cumsum(DRAW.uniform(0.1, 1.0, points))
    values = DRAW.normal(size=points)
    spline = CubicSpline(grid, values)
    table = ct.table(grid, values)
    at = np.concatenate([grid, DRAW.uniform(grid[0], grid[-1], 300)])
    assert table(at) == pytest.approx(spline(at), abs=1e-9)
    assert table(float(grid[1])) == pytest.approx(values[1], abs=1e-9)
    low, high = grid[[0, -1]]
    assert table(low - 7) == pytest.approx(values[0] - 7 * spline(low, 1), rel=1e-9)
    assert table(high + 1e6) == pytest.approx(values[-1] + 1e6 * spline(high, 1), rel=1e-9)
    held = ct.table(grid, values, "hold")
    assert held([low - 7, high + 1e6]) == pytest.approx(values[[0, -1]], abs=1e-9)


@pytest.mark.parametrize("sizes", [(4, 7), (9, 5), (5, 4, 6), (10, 11, 12)])
def test_several_arguments_are_tensor_products(sizes):
    grids = tuple(np.cumsum(DRAW.uniform(0.5, 1.0, n)) for n in sizes)
    values = DRAW.normal(size=sizes)
    table = ct.table(grids, values)
    at = np.array([DRAW.uniform(one[0], one[-1], 60) for one in grids])
    expected = []
    for point in at.T:
        part = values
        for one, x in zip(grids, point, strict=True):
            part = CubicSpline(one, part)(x)
        expected.append(part)
    assert table(*at) == pytest.approx(np.array(expected), abs=1e-9)
    own = RegularGridInterpolator(grids, values, method="cubic", solver=spsolve)(at.T)
    assert table(*at) == pytest.approx(own, abs=1e-9)


@pytest.mark.parametrize("outside", ["linear", "hold"])
def test_two_arguments_outside(outside):
    grids = np.linspace(0, 1, 6), np.linspace(-1, 1, 8)
    values = np.exp(grids[0])[:, None] * np.cos(grids[1])
    table = ct.table(grids, values, outside)
    axes = CubicSpline(grids[0], np.exp(grids[0])), CubicSpline(grids[1], np.cos(grids[1]))

    def along(spline, x, low, high):
        near = np.clip(x, low, high)
        return spline(near) + (x - near) * spline(near, 1) * (outside == "linear")

    for x, y in [(-2, 0.3), (1.5, -3), (0.5, 9), (-1, -2), (0.2, 0.2)]:
        product = along(axes[0], x, 0, 1) * along(axes[1], y, -1, 1)
        assert table(x, y) == pytest.approx(product, rel=1e-12, abs=1e-12)


def test_derivatives_are_continuous_at_points_and_edges():
    grid = np.array([0.0, 1.0, 1.5, 3.0, 4.0])
    values = DRAW.normal(size=5)
    x = casadi.MX.sym("x")
    value = ct.table(grid, values)(x)
    first, second = casadi.gradient(value, x), casadi.hessian(value, x)[0]
    function = casadi.Function("f", [x], [value, first, second])
    spline, step = CubicSpline(grid, values), 1e-9
    for point in grid:
        before, there, after = (np.ravel(function(point + d)) for d in (-step, 0.0, step))
        assert before[:2] == pytest.approx(after[:2], abs=1e-6)
        assert there[:2] == pytest.approx([float(spline(point)), float(spline(point, 1))], abs=1e-9)
        if 0 < point < 4:
            assert before[2] == pytest.approx(after[2], abs=1e-6)
    assert np.ravel(function(5.0))[1:] == pytest.approx([float(spline(4.0, 1)), 0.0], abs=1e-12)
    held = casadi.gradient(ct.table(grid, values, "hold")(x), x)
    assert float(casadi.evalf(casadi.substitute(held, x, 5.0))) == 0.0


@settings(max_examples=20, deadline=None)
@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(-6, 6))
def test_tables_are_independent_of_scales(size, other, shift):
    grid, values = np.linspace(0, 1, 7) + 10**shift, np.array([0.0, 1, -1, 2, 0, 3, 1])
    at = 10**shift + np.array([0.0, 0.31, 0.77, 1.0])
    table = ct.table(10**size * grid, 10**other * values)
    expected = 10**other * CubicSpline(grid, values)(at)
    assert table(10**size * at) == pytest.approx(expected, rel=1e-7, abs=1e-7 * 10**other)


def climb(outside: str, upper: float | None) -> OptimalControlProblem:
    """Return the largest height in a second, against a tabulated drag up to 2 m/s."""
    speeds = np.linspace(0.0, 2.0, 9)
    drag = ct.table(speeds, speeds**2, outside, name="drag")
    ocp = OptimalControlProblem("climb")
    phase = ocp.phase()
    h, v = phase.state("h", initial=0), phase.state("v", initial=0, upper=upper)
    push = phase.control("push", lower=0, upper=4)
    phase.dynamics({h: v, v: push - 0.1 * drag(v)})
    ocp.minimise(-phase.final(h))
    return ocp


def test_a_problem_with_a_table_is_solved_and_stored():
    # Without a limit v goes beyond the grid, where the drag is 4 + 4 (v - 2).
    free, held = (ct.solve(climb(outside, None), seed=0) for outside in ("linear", "hold"))
    v = free.plan["v"](1.0)
    assert v > 2.5 and free.verification.ok
    # v' = 4 - 0.1 v² up to 2, then v' = 4.4 - 0.4 v.
    root = np.sqrt(40.0)
    crossing = np.arctanh(2 / root) * root / 4
    assert v == pytest.approx(11 - 9 * np.exp(-0.4 * (1 - crossing)), rel=1e-6)
    assert held.plan["v"](1.0) == pytest.approx(2 + 3.6 * (1 - crossing), rel=1e-6)
    model = climb("raise", None).build()
    again = Model.from_json(model.to_json())
    assert again.digest == model.digest
    assert again.verify(free.plan).to_dict() == model.verify(free.plan).to_dict()


def test_verification_names_the_table_and_the_instant_outside():
    free = ct.solve(climb("linear", None), seed=0)
    model = climb("raise", None)
    (one,) = [c for c in model.verify(free.plan).checks if c.name == "table drag within its grid"]
    assert not one.ok and one.worst == pytest.approx(free.plan["v"](1.0) - 2, rel=1e-6)
    assert "t = 1" in one.where or "end" in one.where, one.where
    inside = ct.solve(model, formulation="radau", seed=0)
    assert inside.verification.ok and inside.plan["v"](1.0) == pytest.approx(2.0, abs=1e-6)
    # A state may exceed its bound within the tolerance.
    assert ct.solve(climb("raise", 2.0), seed=0).primal_bound == pytest.approx(
        inside.primal_bound, rel=1e-6
    )


def test_each_use_of_a_table_is_one_constraint():
    table = ct.table(([0, 1], [0, 1, 2]), [[0, 1, 2], [1, 2, 4]], "raise", name="map")
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x = phase.state("x", 2, initial=0)
    phase.dynamics({x: casadi.vertcat(table(x[0], x[1]) + table(x[0], x[1]), table(x[1], 0.5))})
    phase.path(table(x, x[1]) <= 9, name="both")
    ocp.minimise(table(phase.final(x[0]), 1))
    definition = ocp.build().definition
    names = [one.name for one in definition.phases[0].paths]
    own = "table map within its grid"
    # The same arguments twice are one use; a vector is a use for each entry.
    assert names[0] == "both" and sorted(names[1:]) == [own, f"{own} (2)", f"{own} (3)"]
    assert [one.name for one in definition.boundaries] == [f"{own} (4)"]
    assert ocp.formulate("radau").program.row_count
    assert definition.phases[0].paths[1].upper.tolist() == [1.0, 2.0]
    assert ocp.build().digest == ocp.build().digest


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0, 0, 1], [1, 2, 3]), "increasing"),
        (([0], [1]), "2 at least"),
        (([0, 1, np.inf], [1, 2, 3]), "finite"),
        (([0, 1, 2], [1, 2]), r"shape \(3,\)"),
        (([0, 1], [1, np.nan]), "values must be"),
        ((([0, 1], [0, 1], [0, 1], [0, 1]), np.zeros((2, 2, 2, 2))), "1 to 3 axes"),
        (([0, 1], [0, 1], "clamp"), "'linear', 'hold', 'raise'"),
        ((np.arange(10_001), np.arange(10_001)), "10000 at most"),
        (("abc", [0, 1]), "grid"),
    ],
)
def test_bad_tables_are_refused(arguments, words):
    with pytest.raises(InvalidData, match=words):
        ct.table(*arguments)


def test_bad_calls_are_refused():
    table = ct.table(([0, 1], [0, 1]), [[0, 1], [1, 2]], name="map")
    x = casadi.MX.sym("x", 2)
    for arguments in [(1,), (x, casadi.MX.sym("y", 3)), ("a", 1), ([1, 2], [1, 2, 3])]:
        with pytest.raises(InvalidData, match="'map' takes 2 arguments"):
            table(*arguments)
    with pytest.raises(InvalidData, match="name of a table"):
        ct.table([0, 1], [0, 1], name="two words")
