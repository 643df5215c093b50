"""Time allocation: slopes by the durations against differences, kernels, and the descent."""

from dataclasses import replace

import numpy as np
import pytest
from allocations import spline_cost, walk

import crosstrack as ct
from crosstrack.models import TimeAllocation
from crosstrack.solvers.minimum_snap.interior_kernels import CONVERGED, centre
from crosstrack.solvers.minimum_snap.interior_state import smooth_start
from crosstrack.solvers.minimum_snap.time_barrier import Barrier, Spline
from crosstrack.solvers.minimum_snap.time_descent import Descent, Variables


def slope_by_differences(function, durations, k, step):
    """The eighth-order central difference along duration `k`."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    unit = np.eye(durations.size)[k]
    total = sum(
        w * (function(durations + m * step * unit) - function(durations - m * step * unit))
        for m, w in weights.items()
    )
    return total / step


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"order": 2},
        {"order": 3, "start": [[1, -2, 0.5], [0.3, 0, 0]], "end": [[None, 0, 1]]},
        {"weights": [0, 0.3, 0, 1]},
        {"continuity": 2},
    ],
)
def test_the_slope_without_limits_is_that_of_central_differences(more):
    model = TimeAllocation(walk(8), 1, **more)
    inner = Spline(model)
    durations = np.random.default_rng(3).uniform(0.7, 2.0, model.segments)
    slope = inner.value(durations).slope

    def cost(at):
        return inner.value(at).objective

    for k in range(model.segments):
        expected = slope_by_differences(cost, durations, k, 1e-2 * durations[k])
        assert slope[k] == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(slope).max())


def test_the_cost_is_that_of_scipys_spline():
    model = TimeAllocation(walk(9), 1)
    durations = np.random.default_rng(5).uniform(0.5, 2.0, model.segments)
    assert Spline(model).value(durations).objective == pytest.approx(
        spline_cost(model, durations), rel=1e-9
    )


DURATIONS = 0.5 * np.arange(7) % 1.3 + 1.5


def tight(*names, share=0.93, **more):
    """A model with bounds that the best path at DURATIONS breaks without them."""
    points = walk(8)
    free = TimeAllocation(points, 1.0, **more)
    inner = Spline(replace(free, degree=2 * free.order - 1))
    path = inner.plan(DURATIONS)
    bounds = {}
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        if name in names:
            found = path.extremes(order)
            bounds[f"{name}_limit"] = share * np.maximum(-found.least, found.largest).max(axis=0)
    if "corridor" in names:
        found = path.extremes(0)
        ends = np.minimum(points[1:], points[:-1]), np.maximum(points[1:], points[:-1])
        bounds["corridor_lower"] = share * found.least + (1 - share) * ends[0] - 1e-3
        bounds["corridor_upper"] = share * found.largest + (1 - share) * ends[1] + 1e-3
    if "polytopes" in names:
        normals = np.random.default_rng(2).standard_normal((7, 3))
        reach = np.maximum((normals * points[1:]).sum(1), (normals * points[:-1]).sum(1))
        most = path.extremes(0, direction=normals).largest[:, 0]
        bounds["polytope_segments"] = np.arange(7)
        bounds["polytope_normals"] = normals
        bounds["polytope_offsets"] = share * most + (1 - share) * reach + 1e-3
    return replace(free, **bounds)


BOUNDED = {
    "limits": lambda: tight("velocity", "acceleration"),
    "a higher degree and a sum": lambda: tight("velocity", degree=9, weights=[0, 0.3, 0, 1]),
    "an end in motion": lambda: tight("jerk", order=3, start=[[0.5, 0.2, -0.5], [0, 0, 0]]),
    "polytopes": lambda: tight("velocity", "polytopes"),
    "a corridor": lambda: tight("corridor", share=0.7),
}


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", BOUNDED)
@pytest.mark.parametrize("gap", [1e-1, 1e-4, 1e-7])
def test_the_slope_with_active_limits_is_that_of_differences(name, gap):
    model = BOUNDED[name]()
    inner = Barrier(model, np.zeros(1, np.int8))
    inner.accuracy = 1e-10
    inner.unit = Spline(replace(model, degree=2 * model.order - 1)).value(DURATIONS).objective
    inner.mu = 0.1 * inner.unit / inner.pairs
    assert np.isfinite(inner.settle(DURATIONS, 1e-6).value)
    inner.mu = gap * inner.unit / inner.pairs
    found = inner.value(DURATIONS)
    assert any((group.iterate.z > 1e3 * inner.mu).any() for group in inner.groups) or gap > 1e-3
    for k in (0, 3, 6):
        at = 1e-4 * DURATIONS[k]
        expected = slope_by_differences(lambda t: inner.value(t).value, DURATIONS, k, at)
        assert found.slope[k] == pytest.approx(
            expected, rel=1e-7, abs=1e-9 * np.abs(found.slope).max()
        )


def test_the_barriers_slope_falls_to_that_of_the_optimum_itself():
    model = tight("velocity", "acceleration")
    inner = Barrier(model, np.zeros(1, np.int8))

    def optimum(at):
        return ct.solve(model.at(model.times(at)), "interior-point").primal_bound

    inner.unit = optimum(DURATIONS)
    inner.mu = 0.1 * inner.unit / inner.pairs
    inner.settle(DURATIONS, 1e-6)
    inner.mu = 1e-8 * inner.unit / inner.pairs
    found = inner.settle(DURATIONS, 1e-9)
    assert found.objective == pytest.approx(inner.unit, rel=1e-7)
    for k in (0, 3):
        unit = 1e-3 * DURATIONS[k] * np.eye(7)[k]
        expected = (
            8 * (optimum(DURATIONS + unit) - optimum(DURATIONS - unit))
            - optimum(DURATIONS + 2 * unit)
            + optimum(DURATIONS - 2 * unit)
        ) / (12 * unit[k])
        assert found.slope[k] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("total", [None, 7.0])
def test_the_variables_derivatives_are_those_of_differences(total):
    rng = np.random.default_rng(2)
    variables = Variables(3.0, total)
    x, matrix, row = rng.normal(size=5), rng.normal(size=(5, 5)), rng.normal(size=5)
    matrix = matrix + matrix.T

    def value(at):
        t = variables.durations(at)
        return row @ t + 0.5 * t @ matrix @ t + 3.0 * t.sum()

    def slope(at):
        t = variables.durations(at)
        return variables.slope(t, row + matrix @ t)

    t = variables.durations(x)
    if total is not None:
        assert t.sum() == pytest.approx(total, rel=1e-15)
    h = 1e-5
    for k in range(5):
        unit = h * np.eye(5)[k]
        expected = (value(x + unit) - value(x - unit)) / (2 * h)
        assert slope(x)[k] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_the_kernel_matches_plain_python():
    model = tight("velocity", "polytopes")
    inner = Barrier(model, np.zeros(1, np.int8))
    (group,) = inner.groups
    posed = group.chain.posed(DURATIONS, group.imposed)
    fixed, known = group.chain.start(DURATIONS)
    results = []
    for kernel in (centre, centre.py_func):
        now = smooth_start(posed, known, np.zeros((7, 0)))
        room = np.full_like(posed.edge, 1e-8)
        status, steps = kernel(posed, now, room, 1.0, 1e-8, 40, np.zeros(1, np.int8))
        assert status == CONVERGED and np.array_equal(now.knots[fixed], known[fixed])
        results.append((steps, *now))
    for compiled, expected in zip(*results, strict=True):
        assert compiled == pytest.approx(expected, rel=1e-6, abs=1e-9)


# -- the descent ---------------------------------------------------------------------------------


def test_descent_on_a_curved_valley_a_kink_and_beside_a_wall():
    def valley(x):
        a, b = 1 - x[0], x[1] - x[0] ** 2
        return a * a + 100 * b * b, np.array([-2 * a - 400 * x[0] * b, 200 * b])

    found = Descent().descend(valley, np.array([-1.2, 1.0]), 1e-12, 200)
    assert found.point == pytest.approx([1, 1], abs=1e-6)

    def kink(x):
        return abs(x[0]) + x[1] ** 2, np.array([np.sign(x[0]), 2 * x[1]])

    found = Descent().descend(kink, np.array([0.7, 1.0]), 1e-9, 200)
    assert found.value < 1e-5

    def wall(x):
        if x[0] <= 0:
            return np.inf, x
        return x[0] - np.log(x[0]) * 1e-3, np.array([1 - 1e-3 / x[0]])

    found = Descent().descend(wall, np.array([3.0]), 1e-9, 200)
    assert found.settled
    assert found.point == pytest.approx([1e-3], rel=1e-5)
    nowhere = Descent().descend(wall, np.array([-1.0]), 1e-9, 200)
    assert not nowhere.settled
