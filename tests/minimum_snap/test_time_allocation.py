"""Time allocation: the model, its slopes and curvature, its backends against one another."""

import itertools
import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import MinimumDerivative, Model, TimeAllocation, Trajectory
from crosstrack.solvers.backend import Request
from crosstrack.solvers.minimum_snap.time_barrier import Barrier
from crosstrack.solvers.minimum_snap.time_descent import Variables
from crosstrack.solvers.minimum_snap.time_gradient import TimeGradient
from crosstrack.solvers.minimum_snap.time_inner import Spline
from crosstrack.solvers.minimum_snap.time_rules import distance, trapezoid
from crosstrack.solvers.minimum_snap.time_search import Descent
from crosstrack.solvers.registry import find_backend, recommended

POINTS = [[0, 0], [1, 2], [3, 2], [4, 0]]
LIMITS = {"velocity_limit": 1.5, "acceleration_limit": 3.0}


def walk(knots, dimensions=3, seed=1):
    """Waypoints of a random walk."""
    steps = np.random.default_rng(seed).uniform(-2, 2, (knots, dimensions))
    return np.cumsum(steps, axis=0)


def spline_cost(model, durations):
    """J by SciPy alone: the spline of degree 2r-1 and quadrature that is exact for it."""
    r, times = model.order, np.concatenate([[0.0], np.cumsum(durations)])
    rest = [(j, np.zeros(model.dimensions)) for j in range(1, r)]
    found = make_interp_spline(times, model.waypoints, k=2 * r - 1, bc_type=(rest, rest))
    nodes, weights = np.polynomial.legendre.leggauss(r)
    total = 0.0
    for begin, long in zip(times, durations, strict=False):
        values = found(begin + long * (nodes + 1) / 2, nu=r)
        total += 0.5 * long * float(weights @ (values**2).sum(axis=1))
    return total


def slope_by_differences(function, durations, k, step):
    """The eighth-order central difference along duration `k`."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    unit = np.eye(durations.size)[k]
    total = sum(
        w * (function(durations + m * step * unit) - function(durations - m * step * unit))
        for m, w in weights.items()
    )
    return total / step


# -- the model ---------------------------------------------------------------------------------------


def test_the_model_is_its_problem_at_given_times_with_the_times_free():
    model = TimeAllocation(POINTS, 100, order=3, **LIMITS, corridor_lower=[-1, -0.5])
    at = model.at([0, 1, 3, 4])
    assert isinstance(at, MinimumDerivative)
    assert at.durations.tolist() == [1, 2, 1]
    for name in ("order", "degree", "continuity"):
        assert getattr(model, name) == getattr(at, name)
    assert np.array_equal(model.start, np.zeros((2, 2)))
    assert np.array_equal(model.corridor_lower, at.corridor_lower)
    assert "minimum jerk" in model.describe()
    assert "velocity limit" in repr(model)
    assert recommended(model).name == "time-gradient"


def test_json_is_exact_and_defaults_written_out_are_the_same_content():
    model = TimeAllocation(
        [[0, 0], [1, None], [3, 2.5]], total_time=7.3, start=[[1, None]], **LIMITS, name="x"
    )
    again = Model.from_json(model.to_json())
    assert isinstance(again, TimeAllocation)
    assert again.digest == model.digest
    assert again.to_json() == model.to_json()
    plain = TimeAllocation(POINTS, 5)
    full = TimeAllocation(POINTS, 5.0, end=np.zeros((3, 2)), degree=7, continuity=3)
    assert plain.digest == full.digest
    assert plain.digest != TimeAllocation(POINTS, 6).digest
    assert plain.digest != TimeAllocation(POINTS, 5, total_time=3).digest


@pytest.mark.parametrize(
    ("data", "field", "says"),
    [
        ({}, "time_weight", "without end"),
        ({"time_weight": 0}, "time_weight", "total_time"),
        ({"time_weight": -1}, "time_weight", "-1"),
        ({"time_weight": float("nan")}, "time_weight", "nan"),
        ({"time_weight": 1, "total_time": 0}, "total_time", "> 0 s, got 0"),
        ({"time_weight": 1, "velocity_limit": -1}, "velocity_limit", r"velocity_limit\[0, 0\]"),
        ({"time_weight": 1, "weights": [1, 2]}, "weights", "order"),
        ({"time_weight": 1, "degree": 5}, "degree", ">= 2 order - 1 = 7, got 5"),
        ({"time_weight": 1, "start": [[9, 0]], "velocity_limit": 2}, "start", "velocity 9"),
        ({"time_weight": 1, "waypoints": [[0, 0]]}, "waypoints", "at least 2 knots, got 1"),
        ({"time_weight": 1, "waypoints": [[0], [1], [1], [2]]}, "waypoints", r"\[2\].*repeats"),
        ({"time_weight": 1, "waypoints": [[0], [math.nan]]}, "waypoints", r"waypoints\[1, 0\]"),
        ({"time_weight": 1, "corridor_upper": 1.5}, "waypoints", "outside the corridor"),
    ],
)
def test_bad_data_is_refused_with_field_index_and_value(data, field, says):
    with pytest.raises(InvalidData, match=says) as caught:
        TimeAllocation(**{"waypoints": POINTS, **data})
    assert caught.value.field == field


def test_a_segment_that_returns_to_its_start_is_refused_only_where_it_could_stand_still():
    TimeAllocation([[0], [0], [1]], 1, start=[[2], [0], [0]])
    TimeAllocation([[0, 0], [None, None], [1, 1]], 1)
    with pytest.raises(InvalidData, match=r"waypoints\[1\] = \[0.0, None\]"):
        TimeAllocation([[0, 0], [0, None], [1, 1]], 1)


def test_verification_recomputes_the_objective_and_checks_the_total():
    model = TimeAllocation(POINTS, 2.0, total_time=6)
    plan = ct.solve(model.at([0, 2, 4, 6])).plan
    found = model.verify(plan)
    assert found.ok
    assert found.objective == pytest.approx(spline_cost(model, [2, 2, 2]) + 2.0 * 6, rel=1e-12)
    assert [c.name for c in found.checks][:2] == ["durations > 0", "total time"]
    late = Trajectory(plan.times + 10, plan.coefficients)
    assert model.verify(late).ok
    assert model.verify(late).objective == pytest.approx(found.objective, rel=1e-12)
    assert model.as_plan(plan.to_ppoly()).durations == pytest.approx([2, 2, 2])
    assert model.as_plan(model.plan_to_data(plan)).times.tolist() == [0, 2, 4, 6]
    wrong = replace(model, total_time=5)
    checks = {c.name: c for c in wrong.verify(plan).violated}
    assert list(checks) == ["total time"]
    assert checks["total time"].worst == pytest.approx(1.0)
    with pytest.raises(InvalidData, match="3 segments, the model 2"):
        TimeAllocation(POINTS[:3], 1).verify(plan)
    with pytest.raises(InvalidData, match="must be a Trajectory"):
        model.verify(None)


# -- slopes and curvature ----------------------------------------------------------------------------


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


@pytest.mark.parametrize("name", BOUNDED)
@pytest.mark.parametrize("gap", [1e-1, 1e-4, 1e-7])
def test_slope_and_curvature_with_active_limits_are_those_of_differences(name, gap):
    model = BOUNDED[name]()
    inner = Barrier(model, np.zeros(1, np.int8))
    inner.accuracy = 1e-10
    inner.unit = Spline(replace(model, degree=2 * model.order - 1)).value(DURATIONS).objective
    inner.mu = 0.1 * inner.unit / inner.pairs
    assert np.isfinite(inner.settle(DURATIONS, 1e-6).value)
    inner.mu = gap * inner.unit / inner.pairs
    found = inner.value(DURATIONS)
    assert (
        any(
            (group.iterate.z_above > 1e3 * inner.mu).any()
            or (group.iterate.z_below > 1e3 * inner.mu).any()
            for group in inner.groups
        )
        or gap > 1e-3
    )
    bent = inner.curvature(DURATIONS)
    for k in (0, 3, 6):
        at = 1e-4 * DURATIONS[k]
        expected = slope_by_differences(lambda t: inner.value(t).value, DURATIONS, k, at)
        assert found.slope[k] == pytest.approx(
            expected, rel=1e-7, abs=1e-9 * np.abs(found.slope).max()
        )
        rows = slope_by_differences(lambda t: inner.value(t).slope, DURATIONS, k, at)
        assert bent[k] == pytest.approx(rows, rel=1e-4, abs=1e-5 * np.abs(bent).max())


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
    way = rng.normal(size=5)
    h = 1e-5
    ahead, behind = variables.durations(x + h * way), variables.durations(x - h * way)
    assert variables.change(t, way) == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)
    bent = variables.curvature(t, row + matrix @ t, matrix)
    for k in range(5):
        unit = h * np.eye(5)[k]
        expected = (value(x + unit) - value(x - unit)) / (2 * h)
        assert slope(x)[k] == pytest.approx(expected, rel=1e-6, abs=1e-7)
        rows = (slope(x + unit) - slope(x - unit)) / (2 * h)
        assert bent[k] == pytest.approx(rows, rel=1e-6, abs=1e-6)


def test_kernels_mean_what_their_python_says():
    from crosstrack.solvers.minimum_snap import time_curvature, time_polynomials, time_rows

    model = tight("velocity", "polytopes")
    inner = Barrier(model, np.zeros(1, np.int8))
    inner.unit = Spline(model).value(DURATIONS).objective
    inner.mu = 1e-2 * inner.unit / inner.pairs
    inner.value(DURATIONS)
    (group,), forms = inner.groups, inner.forms
    rows, now = group.rows, group.iterate
    given = (
        DURATIONS, 4, 3, forms.unit_cost, forms.cost_orders, rows.unit, rows.mix,
        rows.derivative, rows.start,
    )  # fmt: skip
    pull = now.z_above - now.z_below

    def sloped(function):
        slope = np.zeros(7)
        cost = function(*given, now.knots, now.inner, pull, slope)
        return cost, slope

    def curved(function):
        bent = np.zeros((7, 7))
        found = function(
            *given, rows.lower, rows.upper, group.fixed, *now, inner.unit, bent
        )  # fmt: skip
        return (*found, bent)

    powers = time_polynomials.powers_of
    for function, call in (
        (time_rows.pose, lambda f: f(*given)),
        (time_rows.slopes, sloped),
        (time_curvature.curvature, curved),
        (powers, lambda f: (f(DURATIONS, 4, 3, forms.basis, now.knots, now.inner),)),
    ):
        for got, expected in zip(call(function), call(function.py_func), strict=True):
            assert got == pytest.approx(expected, rel=1e-10, abs=1e-12)


# -- the descent -------------------------------------------------------------------------------------


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
    bent = Descent().descend(
        wall, np.array([3.0]), 1e-9, 200, curvature=lambda x: np.array([[1e-3 / x[0] ** 2]])
    )
    assert bent.point == pytest.approx([1e-3], rel=1e-5)
    nowhere = Descent().descend(wall, np.array([-1.0]), 1e-9, 200)
    assert not nowhere.settled


def test_a_system_that_is_not_positive_is_refused_until_it_is_shifted():
    from crosstrack.solvers.minimum_snap.time_curvature import shifted_solve

    matrix = np.random.default_rng(4).normal(size=(50, 50))
    matrix = matrix + matrix.T
    right = np.arange(50.0)
    assert not shifted_solve(matrix, 0.0, right.copy())
    found = right.copy()
    assert shifted_solve(matrix, 50.0, found)
    assert (matrix + 50.0 * np.eye(50)) @ found == pytest.approx(right, abs=1e-9)


# -- optima ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [{"order": 2}, {"order": 3}, {}, {"weights": [0.1, 0, 0.5, 1]}])
def test_at_the_optimum_time_costs_what_the_identity_says(more):
    model = TimeAllocation(walk(20), 40.0, **more)
    found = ct.solve(model, "time-gradient", backend_options={"gradient": 1e-10})
    assert found.termination == "locally_optimal"
    assert found.statistics["identity residual"] <= 1e-9
    r = model.order
    shares = [
        (2 * j - 1) * w * found.plan.integral_of_square(j).sum()
        for j, w in enumerate(model.order_weights, start=1)
    ]
    assert 40.0 * found.plan.duration == pytest.approx(sum(shares), rel=1e-9)
    if not more.get("weights"):
        cost = found.primal_bound - 40.0 * found.plan.duration
        assert 40.0 * found.plan.duration == pytest.approx((2 * r - 1) * cost, rel=1e-9)
    assert model.identity_residual(found.plan) <= 1e-9


def test_where_the_identity_need_not_hold_nothing_is_said_of_it():
    assert TimeAllocation(POINTS, 1, corridor_upper=5).scales
    for more in (LIMITS, {"start": [[1, 0]]}):
        assert not TimeAllocation(POINTS, 1, **more).scales
    found = ct.solve(TimeAllocation(POINTS, 50, **LIMITS))
    assert "identity residual" not in found.statistics


def test_a_corridor_keeps_the_identity():
    model = TimeAllocation(POINTS, 100, corridor_lower=[-0.05, -0.05], corridor_upper=[4.05, 2.05])
    found = ct.solve(model, backend_options={"gradient": 1e-9})
    assert found.termination == "locally_optimal"
    assert found.primal_bound > ct.solve(TimeAllocation(POINTS, 100)).primal_bound * 1.001
    assert found.statistics["identity residual"] <= 1e-6


@pytest.mark.parametrize("order", [2, 3, 4])
def test_no_grid_of_times_is_better(order):
    model = TimeAllocation(POINTS[:3], 30.0, order=order)
    found = ct.solve(model)
    best = min(
        spline_cost(model, pair) + 30.0 * sum(pair)
        for pair in itertools.product(np.linspace(0.5, 4, 60), repeat=2)
    )
    assert found.primal_bound <= best * (1 + 1e-12)
    assert found.primal_bound == pytest.approx(best, rel=1e-2)


def test_no_grid_of_times_within_limits_is_better():
    model = TimeAllocation(POINTS, 400.0, **LIMITS)
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.verification.ok
    assert not found.verification.within_tolerance
    inner = Barrier(model, np.zeros(1, np.int8))
    inner.unit = found.primal_bound
    best = np.inf
    for durations in itertools.product(
        *[np.linspace(0.6 * t, 1.5 * t, 9) for t in found.plan.durations]
    ):
        inner.mu = 1e-4 * inner.unit / inner.pairs
        value = inner.settle(np.array(durations), 1e-6)
        best = min(best, value.objective + 400.0 * sum(durations))
    assert best >= found.primal_bound
    assert best == pytest.approx(found.primal_bound, rel=0.05)


def test_a_given_total_is_kept_and_shared_best():
    model = TimeAllocation(POINTS, total_time=6.0)
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.plan.duration == pytest.approx(6.0, rel=1e-14)
    shares = [
        (a, b, 6.0 - a - b)
        for a, b in itertools.product(np.linspace(0.5, 4, 40), repeat=2)
        if a + b < 5.5
    ]
    best = min(spline_cost(model, share) for share in shares)
    assert found.primal_bound <= best
    assert found.primal_bound == pytest.approx(best, rel=2e-2)
    # The same total, found where time has the price that makes it the best.
    free = ct.solve(TimeAllocation(POINTS, 7 * found.primal_bound / 6.0))
    assert free.plan.duration == pytest.approx(6.0, rel=1e-7)
    assert free.plan.durations == pytest.approx(found.plan.durations, rel=1e-6)


def test_a_total_so_short_that_the_rules_shares_find_no_path():
    free = ct.solve(TimeAllocation(POINTS, 1e5, **LIMITS))
    model = TimeAllocation(POINTS, total_time=1.01 * free.plan.duration, **LIMITS)
    for name in ("time-trapezoid", "time-distance"):
        nothing = ct.solve(model, name)
        assert nothing.termination == "no_solution"
        assert "no total time" in nothing.message
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.plan.duration == pytest.approx(model.total_time, rel=1e-12)
    short = ct.solve(TimeAllocation(POINTS, total_time=0.5, **LIMITS))
    assert short.termination == "no_solution"
    assert "no proof" in short.message


# -- ends in motion ----------------------------------------------------------------------------------

#: One segment whose path is fixed by its duration: it starts at 2 m/s towards a wall at 1.2 m.
TOWARDS_A_WALL = {
    "waypoints": [[0.0], [1.0]],
    "order": 2,
    "start": [[2.0]],
    "corridor_upper": 1.05,
    "acceleration_limit": 12.0,
}


def test_slowing_down_breaks_the_corridor_of_an_end_in_motion():
    model = TimeAllocation(time_weight=1e-3, **TOWARDS_A_WALL)
    keeps = [
        t
        for t in np.linspace(0.2, 4, 381)
        if model.verify(ct.solve(_unbounded(model).at([0, t])).plan).ok
    ]
    assert min(keeps) > 0.2
    assert max(keeps) < 2.5, "a longer motion overshoots: uniform stretching would be wrong"
    for weight in (1e-3, 1e3):
        found = ct.solve(TimeAllocation(time_weight=weight, **TOWARDS_A_WALL))
        assert found.termination == "locally_optimal"
        assert found.verification.ok
        assert min(keeps) - 0.01 <= found.plan.duration <= max(keeps) + 0.01
    # J falls with T but at T = 1.5, where its slope is 0: with a price there is a local optimum
    # there, and another one at the wall.
    costs = {
        t: ct.solve(_unbounded(model).at([0, t])).primal_bound + 1e-3 * t for t in keeps
    }  # fmt: skip
    near = min(cost for t, cost in costs.items() if t < 1.51)
    assert ct.solve(model).primal_bound == pytest.approx(near, rel=1e-4)
    late = ct.solve(_unbounded(model).at([0, 1.55])).plan
    found = ct.solve(model, warm_start=late)
    assert found.termination == "locally_optimal"
    assert found.primal_bound <= min(costs.values())
    assert found.plan.duration == pytest.approx(max(keeps), abs=0.01)


def _unbounded(model):
    return replace(model, corridor_upper=None, acceleration_limit=None)


def test_ends_in_motion_within_limits():
    model = TimeAllocation(
        POINTS, 50, start=[[1, 0], [0, 0], [0, 0]], end=[[0.5, -1], [0, 0], [0, 0]],
        **LIMITS, corridor_lower=-0.3, corridor_upper=4.3,
    )  # fmt: skip
    found = ct.solve(model)
    assert found.termination == "locally_optimal"
    assert found.verification.ok
    assert not found.verification.within_tolerance
    assert found.plan(0.0, derivative=1) == pytest.approx([1, 0])
    assert found.plan(found.plan.duration, derivative=1) == pytest.approx([0.5, -1])


# -- backends against one another --------------------------------------------------------------------


@pytest.mark.parametrize("more", [{"time_weight": 100}, {"total_time": 6.0, "order": 3}])
def test_no_backend_contradicts_another(more):
    model = TimeAllocation(POINTS, **more)
    names = ["time-gradient", "time-simplex", "time-trapezoid", "time-distance"]
    verdict = ct.compare([model], names, time_limit=60).verdicts[0]
    assert verdict.outcome != "CONTRADICTION"
    best = {s.backend: s.primal_bound for s in verdict.solutions}
    assert set(best) == set(names)
    assert best["time-gradient"] <= min(best.values()) * (1 + 1e-9)
    assert best["time-simplex"] == pytest.approx(best["time-gradient"], rel=1e-7)
    assert best["time-gradient"] < 0.98 * min(best["time-trapezoid"], best["time-distance"])


@pytest.mark.parametrize("more", [{"velocity_limit": 1.2}, {"weights": [0, 0.5, 1]}])
def test_a_simplex_over_another_solver_finds_the_same_times(more):
    pytest.importorskip("daqp")
    model = TimeAllocation(POINTS[:3], 60.0, order=3, **more)
    own = ct.solve(model, "time-gradient")
    options = {"inner": "daqp", "accuracy": 1e-6, "restarts": 0}
    other = ct.solve(model, "time-simplex", backend_options=options)
    assert own.termination == "locally_optimal"
    assert other.termination == "feasible"
    assert other.primal_bound == pytest.approx(own.primal_bound, rel=1e-6)
    assert own.primal_bound <= other.primal_bound * (1 + 1e-7)
    assert other.plan.durations == pytest.approx(own.plan.durations, rel=2e-3)


@pytest.mark.parametrize("name", ["time-trapezoid", "time-distance"])
@pytest.mark.parametrize("more", [{}, {"weights": [0.5, 0, 0, 1]}, LIMITS])
def test_rules_keep_their_proportions_at_the_best_total(name, more):
    model = TimeAllocation(POINTS, 100, **more)
    rule = {"time-trapezoid": trapezoid, "time-distance": distance}[name](model)
    found = ct.solve(model, name)
    assert found.termination == "feasible"
    assert found.verification.ok
    assert not found.verification.within_tolerance
    ratio = found.plan.durations / rule
    assert ratio == pytest.approx(np.full(3, ratio[0]), rel=1e-9)
    for factor in (0.99, 1.01):
        at = model.at(model.times(factor * found.plan.durations))
        other = ct.solve(at, "interior-point" if at.bounded else "banded")
        if other.plan is not None:
            cost = other.primal_bound + 100 * other.plan.duration
            assert cost > found.primal_bound


def test_the_trapezoid_knows_the_limits():
    model = TimeAllocation([[0], [10], [10.5]], 1, velocity_limit=2, acceleration_limit=1)
    assert trapezoid(model) == pytest.approx([10 / 2 + 2, 2 * np.sqrt(0.5)])
    assert distance(model) == pytest.approx([10, 0.5])


# -- laws --------------------------------------------------------------------------------------------

weights = st.floats(1e-2, 1e4)
seeds = st.integers(0, 50)
PRECISE = {"gradient": 1e-10}


@given(weight=weights, seed=seeds, order=st.sampled_from([2, 3, 4]), factor=st.floats(0.2, 5))
@settings(max_examples=15, deadline=None)
def test_times_grow_as_a_root_of_the_price(weight, seed, order, factor):
    model = TimeAllocation(walk(5, 2, seed), weight, order=order)
    here = ct.solve(model, backend_options=PRECISE)
    there = ct.solve(replace(model, time_weight=weight * factor), backend_options=PRECISE)
    share = factor ** (-1 / (2 * order))
    assert there.plan.durations == pytest.approx(share * here.plan.durations, rel=1e-5)
    assert there.primal_bound == pytest.approx(factor * share * here.primal_bound, rel=1e-9)


@given(seed=seeds, shift=st.floats(-1e3, 1e3), size=st.floats(0.1, 10))
@settings(max_examples=10, deadline=None)
def test_moving_and_enlarging_the_path_with_its_limits(seed, shift, size):
    points = walk(4, 2, seed)
    limits = {"velocity_limit": 1.0, "acceleration_limit": 1.5}
    here = ct.solve(TimeAllocation(points, 5.0, order=3, **limits))
    enlarged = {name: size * value for name, value in limits.items()}
    model = TimeAllocation(size * points + shift, 5.0 * size**2, order=3, **enlarged)
    there = ct.solve(model)
    assert here.termination == there.termination == "locally_optimal"
    assert there.primal_bound == pytest.approx(size**2 * here.primal_bound, rel=2e-5)


@given(seed=seeds, unit=st.floats(0.2, 5))
@settings(max_examples=8, deadline=None)
def test_another_unit_of_time_is_the_same_problem(seed, unit):
    points = walk(4, 2, seed)
    here = ct.solve(TimeAllocation(points, 5.0, order=3, velocity_limit=1.0, jerk_limit=6.0))
    model = TimeAllocation(
        points, 5.0 / unit**6, order=3, velocity_limit=1.0 / unit, jerk_limit=6.0 / unit**3
    )
    there = ct.solve(model)
    assert there.primal_bound == pytest.approx(here.primal_bound / unit**5, rel=2e-5)


# -- the common request ------------------------------------------------------------------------------


def test_starts_seeds_and_warm_starts():
    model = TimeAllocation(walk(6), 20.0, **{**LIMITS, "order": 3})
    several = ct.solve(model, "time-gradient", starts=3, seed=0)
    assert [s.termination for s in several.starts] == ["locally_optimal"] * 3
    assert several.primal_bound <= min(s.primal_bound for s in several.starts)
    once, twice = (ct.solve(model, "time-gradient", seed=2) for _ in range(2))
    assert once.plan.times.tolist() == twice.plan.times.tolist()
    assert once.plan.times.tolist() == several.starts[2].plan.times.tolist()
    warm = ct.solve(model, "time-gradient", warm_start=several)
    assert warm.primal_bound == pytest.approx(several.primal_bound, rel=1e-6)
    with pytest.raises(UnsupportedOption, match="seed"):
        ct.solve(model, "time-trapezoid", seed=1)


def test_a_limit_keeps_the_incumbent():
    model = TimeAllocation(walk(400), 1000.0, velocity_limit=2.5, acceleration_limit=4)
    ct.solve(TimeAllocation(POINTS, 1, **LIMITS))  # compiled
    heard = []
    begin = time.perf_counter()
    found = ct.solve(model, time_limit=0.8, on_incumbent=heard.append)
    assert time.perf_counter() - begin < 8
    assert found.limit == "time"
    assert found.termination in ("feasible", "no_solution")
    if found.termination == "feasible":
        assert found.verification.ok


def test_a_stop_from_another_thread_ends_the_simplex_with_its_best():
    model, simplex = TimeAllocation(walk(12), 1000.0), find_backend("time-simplex")
    options = {"accuracy": 1e-14, "restarts": 1000, "evaluations": 10**6}
    request = Request(options=simplex.checked_options(options))
    timer = threading.Timer(0.3, request.control.stop, ("interrupted",))
    timer.start()
    answer = simplex.run(model, request)
    timer.join()
    assert answer.limit == "interrupted"
    assert model.verify(answer.point).ok


def test_what_is_not_covered_is_said():
    model = TimeAllocation(POINTS, 1, end=np.zeros((4, 2)), degree=9)
    with pytest.raises(UnsupportedFormulation, match="snap"):
        ct.solve(model, "time-gradient")
    assert TimeGradient().refuses(TimeAllocation(POINTS, 1, continuity=2, **LIMITS))
    options = {"inner": "spline"}
    with pytest.raises(UnsupportedFormulation, match="corridor or limits"):
        ct.solve(TimeAllocation(POINTS, 1, **LIMITS), "time-simplex", backend_options=options)
