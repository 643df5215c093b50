"""Minimum-derivative trajectories: the model, its plan, its check, and its programs.

The brute force here shares nothing with the package: Chebyshev polynomials on every segment, and a
dense null space.
"""

import json
import math
import pickle
from dataclasses import replace
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st
from numpy.polynomial import chebyshev, polynomial
from scipy.integrate import quad
from scipy.interpolate import PPoly, make_interp_spline

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import MinimumSnap, Model
from crosstrack.models.minimum_snap import FREE, MinimumDerivative
from crosstrack.models.minimum_snap.polynomials import critical_points, horner
from crosstrack.models.minimum_snap.trajectory import Trajectory

WAYPOINTS = [[0.0, 0], [1, 2], [3, 2]]
TIMES = [0.0, 1, 3]
INF, NAN = math.inf, math.nan
QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def make(cls=MinimumSnap, **changes):
    return cls(**{"waypoints": WAYPOINTS, "times": TIMES, **changes})


def of_order(order, **changes):
    return make(MinimumDerivative, order=order, **changes)


# -- brute force -------------------------------------------------------------------------------------


def chebyshev_rows(at, derivative, degree):
    """Return derivatives in s of T_0 … T_degree on [0, 1] at one point."""
    rows = []
    for number in range(degree + 1):
        inner = chebyshev.chebder(np.eye(degree + 1)[number], derivative) * 2.0**derivative
        rows.append(chebyshev.chebval(2 * at - 1, inner))
    return np.array(rows)


def brute_force(model):
    """Return the optimal trajectory of a model without corridor and limits, None where none is."""
    count, degree = model.segments, model.degree
    size = degree + 1
    long = np.diff(model.times)
    nodes, weights = np.polynomial.legendre.leggauss(degree + 1)
    cost = []
    for order, weight in enumerate(model.order_weights, start=1):
        for k in range(count):
            for node, share in zip((nodes + 1) / 2, weights / 2, strict=True):
                row = np.zeros(count * size)
                row[k * size : (k + 1) * size] = chebyshev_rows(node, order, degree)
                cost.append(row * math.sqrt(weight * share * long[k] ** (1 - 2 * order)))
    cost = np.array(cost)
    powers = np.zeros((count, size, model.dimensions))
    for axis in range(model.dimensions):
        rows, right = [], []

        def add(parts, value, rows=rows, right=right):
            row = np.zeros(count * size)
            for segment, side, order, sign in parts:
                block = slice(segment * size, (segment + 1) * size)
                row[block] += sign * chebyshev_rows(side, order, degree) * long[segment] ** -order
            norm = np.linalg.norm(row)
            rows.append(row / norm)
            right.append(value / norm)

        for knot in range(count + 1):
            for order in range(model.conditions.shape[1]):
                value = model.conditions[knot, order, axis]
                for segment, side in ((knot - 1, 1.0), (knot, 0.0)):
                    if np.isfinite(value) and 0 <= segment < count:
                        add([(segment, side, order, 1.0)], value)
            if 0 < knot < count:
                for order in range(model.continuity + 1):
                    add([(knot - 1, 1.0, order, 1.0), (knot, 0.0, order, -1.0)], 0.0)
        matrix, right = np.array(rows), np.array(right)
        found = null_space_optimum(cost, np.zeros(len(cost)), matrix, right)
        if found is None:
            return None
        for k in range(count):
            own = chebyshev.cheb2poly(found[k * size : (k + 1) * size])
            shifted = polynomial.Polynomial(own)(polynomial.Polynomial([-1.0, 2.0])).coef
            powers[k, : shifted.size, axis] = shifted
    return Trajectory(model.times, powers)


def null_space_optimum(cost, target, matrix, right):
    """Minimise |cost x - target|² with matrix x = right; None where the rows contradict."""
    if not len(matrix):
        return np.linalg.lstsq(cost, target, rcond=None)[0]
    u, values, v = np.linalg.svd(matrix)
    rank = int((values > 1e-10 * values[0]).sum())
    start = v[:rank].T @ ((u[:, :rank].T @ right) / values[:rank])
    if np.abs(matrix @ start - right).max() > 1e-9 * max(1.0, np.abs(right).max()):
        return None
    free = v[rank:].T
    step = np.linalg.lstsq(cost @ free, target - cost @ start, rcond=1e-13)[0]
    return start + free @ step


def solved_densely(program):
    """Return the optimal value of an equality-constrained quadratic program."""
    hessian, matrix = program.hessian.toarray(), program.matrix.toarray()
    assert np.array_equal(program.row_lower, program.row_upper)
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scale[np.diag(hessian) == 0] = 1.0
    values, vectors = np.linalg.eigh(hessian * scale[:, None] * scale)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    # |root y|²/2 + cost'y: the target is what makes the gradient at it the cost.
    target = np.linalg.lstsq(root.T, -program.cost * scale, rcond=1e-13)[0]
    point = scale * null_space_optimum(root, target, matrix * scale, program.row_lower)
    return program.objective(point)


@st.composite
def models(draw, *, most=2, inner=True):
    """Draw models without corridor and limits."""
    r = draw(st.integers(1, 4))
    count, axes = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    times = np.cumsum(
        np.concatenate([[generator.uniform(-2, 2)], generator.uniform(0.4, 2, count)])
    )
    waypoints = generator.normal(size=(count + 1, axes)) * 3
    degree = 2 * r - 1 + draw(st.integers(0, 3))
    options = {"degree": degree, "continuity": draw(st.integers(0, min(r - 1 + most, degree)))}
    if draw(st.booleans()):
        options["weights"] = np.append(generator.uniform(0, 2, r - 1), 1.5)
    if draw(st.booleans()):
        gone = generator.random((count + 1, axes)) < 0.3
        gone[[0, -1]] = False
        waypoints[gone] = FREE
    if inner and r > 1 and draw(st.booleans()):
        rows = np.full((count + 1, r - 1, axes), FREE)
        some = generator.random((count - 1, r - 1, axes)) < 0.3
        rows[1:-1][some] = generator.normal(size=int(some.sum()))
        options["derivatives"] = rows
    if draw(st.booleans()):
        ends = generator.normal(size=(2, r - 1, axes))
        ends[generator.random(ends.shape) < 0.3] = FREE
        options["start"], options["end"] = ends
    return MinimumDerivative(waypoints, times, order=r, **options)


def optimum_of(model):
    """Return the brute-force optimum of `model` where its rows leave one."""
    plan = brute_force(model)
    assume(plan is not None)
    return plan


# -- the model's data --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"waypoints": "abc"}, "waypoints", "must be an array of numbers"),
        ({"waypoints": [0, 1, 3]}, "waypoints", r"shape \(knots, dimensions\), got \(3,\)"),
        ({"waypoints": [[0, 0], [1], [3, 2]]}, "waypoints", r"row|shape"),
        ({"waypoints": [[0, NAN], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be finite, got nan"),
        ({"waypoints": [[0, -INF], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be finite, got -inf"),
        ({"waypoints": [[0, "1"], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be a number, got '1'"),
        ({"waypoints": [[0, True], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be a number, got True"),
        ({"waypoints": np.zeros((3, 0))}, "waypoints", "at least 1 dimension"),
        ({"waypoints": np.zeros((3, 2), complex)}, "waypoints", "must be a number"),
        ({"times": [0, 1]}, "times", "times has 2 entries where waypoints has 3"),
        ({"times": [0, 1, 1]}, "times", r"times\[2\] must be > times\[1\] = 1, got 1"),
        ({"times": [0, -1, 1]}, "times", r"times\[1\] must be > times\[0\] = 0, got -1"),
        ({"times": [0, NAN, 1]}, "times", r"times\[1\] must be finite, got nan"),
        ({"times": [0, 1, INF]}, "times", r"times\[2\] must be finite, got inf"),
        ({"times": [0, 1, None]}, "times", r"times\[2\] must be a number, got None"),
        ({"times": [[0, 1, 2]]}, "times", r"shape \(knots,\)"),
        ({"waypoints": [[0, 0]], "times": [0]}, "times", "at least 2 entries, got 1"),
        ({"degree": 6}, "degree", "degree must be >= 2 order - 1 = 7, got 6"),
        ({"degree": 99}, "degree", "degree must be <= 31, got 99"),
        ({"degree": 7.5}, "degree", "must be a whole number"),
        ({"degree": "7"}, "degree", "must be a number, got '7'"),
        ({"degree": True}, "degree", "must be a number, got True"),
        ({"continuity": 8}, "continuity", "continuity must be <= degree = 7, got 8"),
        ({"continuity": -1}, "continuity", "continuity must be >= 0, got -1"),
        ({"start": np.zeros((8, 2))}, "start", "fixes 8 derivatives of a polynomial of degree 7"),
        ({"start": [[0, 0, 0]]}, "start", "start has 3 entries where waypoints has 2"),
        ({"start": [[0, NAN]]}, "start", r"start\[0, 1\] must be finite, got nan"),
        ({"end": [0, 0]}, "end", r"shape \(end rows, dimensions\), got \(2,\)"),
        ({"derivatives": np.zeros((2, 1, 2))}, "derivatives", "derivatives has 2 entries where waypoints has 3"),
        ({"derivatives": np.full((3, 8, 2), INF)}, "derivatives", "fixes 8 derivatives"),
        ({"derivatives": np.ones((3, 1, 2))}, "derivatives", r"derivatives\[0, 0, 0\] is 1, but start\[0, 0\] is 0"),
        (
            {"derivatives": [[[None, None]]] * 2 + [[[None, 2]]], "end": [[None, 1]]},
            "derivatives", r"derivatives\[2, 0, 1\] is 2, but end\[0, 1\] is 1",
        ),
        ({"corridor_lower": 9, "corridor_upper": 8}, "corridor_lower", r"corridor_lower\[0, 0\] must be <= corridor_upper\[0, 0\] = 8, got 9"),
        ({"corridor_lower": np.zeros((3, 2))}, "corridor_lower", r"\(2, 2\) \(segments, dimensions\), got shape \(3, 2\)"),
        ({"corridor_lower": [NAN, 0]}, "corridor_lower", r"corridor_lower\[.*0\] must be finite, got nan"),
        ({"corridor_lower": INF}, "corridor_lower", "must be finite, got inf"),
        ({"corridor_upper": [[2.5], [9]], "waypoints": [[0, 0], [1, 3], [3, 2]]}, "waypoints", r"waypoints\[1\].* 3 of knot 1, axis 1 lies outside the corridor of segment 0: \[-inf, 2.5\]"),
        ({"corridor_upper": [[9], [1.5]]}, "waypoints", r"position 3 of knot 2, axis 0 lies outside the corridor of segment 1"),
        ({"corridor_lower": 0.5}, "waypoints", r"waypoints\[0\]"),
        ({"velocity_limit": -1}, "velocity_limit", "must be >= 0, got -1"),
        ({"velocity_limit": [1, 2, 3]}, "velocity_limit", "one for each of 2 dimensions"),
        ({"velocity_limit": "fast"}, "velocity_limit", "must be an array of numbers"),
        ({"velocity_limit": True}, "velocity_limit", "must be a number, got True"),
        ({"velocity_limit": 1, "start": [[2, 0]]}, "start", r"velocity 2 of knot 0, axis 0 lies outside the velocity limit of segment 0: \[-1, 1\]"),
        ({"acceleration_limit": 1, "end": [[0, 0], [0, -3]]}, "end", r"end\[1\].*acceleration -3 of knot 2, axis 1"),
        ({"jerk_limit": [[9], [1]], "derivatives": [[[None] * 2] * 3, [[None] * 2, [None] * 2, [5, 0]], [[None] * 2] * 3]}, "derivatives", r"derivatives\[1, 2\].*jerk 5 of knot 1, axis 0 .* segment 1"),
        ({"polytope_segments": [0]}, "polytope_normals", "polytope_normals is missing"),
        ({"polytope_offsets": [0.0]}, "polytope_segments", "polytope_segments is missing"),
        ({"polytope_segments": [0], "polytope_normals": [[1, 0]]}, "polytope_offsets", "polytope_offsets is missing"),
        ({"polytope_segments": [2], "polytope_normals": [[1, 0]], "polytope_offsets": [9]}, "polytope_segments", r"polytope_segments\[0\] must be < 2 \(segments\), got 2"),
        ({"polytope_segments": [-1], "polytope_normals": [[1, 0]], "polytope_offsets": [9]}, "polytope_segments", r"polytope_segments\[0\] must be >= 0, got -1"),
        ({"polytope_segments": [0.5], "polytope_normals": [[1, 0]], "polytope_offsets": [9]}, "polytope_segments", r"polytope_segments\[0\] must be whole numbers"),
        ({"polytope_segments": [0, 1], "polytope_normals": [[1, 0], [0, 0]], "polytope_offsets": [9, 9]}, "polytope_normals", r"polytope_normals\[1\] must not be zero"),
        ({"polytope_segments": [0, 1], "polytope_normals": [[1, 0]], "polytope_offsets": [9, 9]}, "polytope_normals", "polytope_normals has 1 entries where polytope_segments has 2"),
        ({"polytope_segments": [1], "polytope_normals": [[2, 0]], "polytope_offsets": [5]}, "waypoints", r"waypoints\[2\] = \[3.0, 2.0\] lies 0.5 m outside half-space 0 of segment 1"),
    ],
)  # fmt: skip
def test_bad_data_names_field_place_and_value(changes, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        make(**changes)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"order": 0}, "order", "order must be >= 1, got 0"),
        ({"order": 9}, "order", "order must be <= 8, got 9"),
        ({"order": 2.5}, "order", "whole number"),
        ({"order": 3, "weights": [1, 1]}, "weights", "one entry for each order 1 … 3"),
        ({"order": 2, "weights": [1, 0]}, "weights", "the last > 0"),
        ({"order": 2, "weights": [-1, 1]}, "weights", r"weights\[0\] must be >= 0, got -1"),
        ({"order": 2, "weights": [NAN, 1]}, "weights", r"weights\[0\] must be finite"),
        ({"order": 2, "weights": 1.0}, "weights", "shape"),
    ],
)
def test_bad_orders_and_weights(changes, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        make(MinimumDerivative, **changes)
    assert caught.value.field == field


def test_an_array_of_infinite_times_or_limits_is_no_surprise():
    assert make(velocity_limit=INF).bounds == ()
    assert not make(velocity_limit=[None, None]).bounded
    assert make(velocity_limit=[None, 3]).bounds[0].upper.tolist() == [[INF, 3], [INF, 3]]
    assert make(corridor_lower=[None, -1]).bounds[0].lower.tolist() == [[-INF, -1]] * 2


def test_minimum_snap_has_no_order():
    with pytest.raises(TypeError, match="order"):
        make(order=3)
    with pytest.raises(TypeError, match="weights"):
        make(weights=[0, 0, 0, 1])
    with pytest.raises(ValueError, match="order"):
        replace(make(), order=3)
    with pytest.raises(InvalidData, match="unknown key 'order'"):
        MinimumSnap.from_data({**make().data(), "order": 4})


@pytest.mark.parametrize("key", ["snap", "velocity", "name"])
def test_unknown_keys_raise(key):
    data = {"model": "minimum-snap", "data": {**make().data(), key: 1}}
    with pytest.raises(InvalidData, match=f"unknown key '{key}'"):
        Model.from_json(json.dumps(data))


def test_missing_keys_raise():
    data = make().data()
    del data["times"]
    with pytest.raises(InvalidData, match="key 'times' is missing"):
        MinimumSnap.from_data(data)


def test_defaults_written_out_are_the_same_content():
    zeros = np.zeros((3, 2))
    assert make().digest == make(start=zeros, end=-zeros, degree=7, continuity=3).digest
    assert make().digest == make(name="läbel").digest
    assert make().digest == make(times=[0, 1, 3], waypoints=np.array(WAYPOINTS, np.float32)).digest
    assert make().digest != make(continuity=2).digest
    assert make().digest != make(degree=9).digest
    assert make().digest != make(start=[[0, 0]]).digest
    assert make(velocity_limit=3).digest == make(velocity_limit=[[3, 3], [3, 3]]).digest
    assert make().digest != of_order(4).digest  # another name in JSON
    assert of_order(3).digest == of_order(3, degree=5, continuity=2, start=zeros[:2]).digest


def test_waypoints_fixed_twice_alike_are_one_content_or_refused():
    rows = np.full((3, 3, 2), FREE)
    rows[0] = 0.0
    assert np.array_equal(make(derivatives=rows).conditions, make().conditions)


@pytest.mark.parametrize(
    "model",
    [
        make(name="läbel"),
        make(waypoints=[[0, 0], [None, 2], [3, FREE]]),
        make(start=[[None, 1]], end=[[None, None]]),
        make(start=np.zeros((0, 2))),
        make(derivatives=np.full((3, 2, 2), FREE)),
        make(corridor_lower=[None, -1], corridor_upper=[[4], [None]], velocity_limit=[[None], [2.5]]),
        make(polytope_segments=[0, 1], polytope_normals=[[1, 1], [0, 1]], polytope_offsets=[9, 8.5]),
        of_order(3, weights=[0, 0.5, 1], degree=8, continuity=1),
        of_order(1),
        of_order(1, degree=4),
        make(
            polytope_segments=np.zeros(0, int), polytope_normals=np.zeros((0, 2)),
            polytope_offsets=np.zeros(0),
        ),
        make(derivatives=np.zeros((3, 0, 2))),
    ],
    ids=lambda model: model.describe(),
)  # fmt: skip
def test_json_and_pickle_are_exact(model):
    text = model.to_json()
    assert "NaN" not in text
    assert "Infinity" not in text
    again = Model.from_json(text)
    thawed = pickle.loads(pickle.dumps(model))
    for other in (again, thawed):
        assert type(other) is type(model)
        assert other.digest == model.digest
        assert other.name == model.name
        assert np.array_equal(other.conditions, model.conditions)
        assert not other.waypoints.flags.writeable
        assert not other.start.flags.writeable
    assert json.loads(again.to_json()) == json.loads(text)


def test_everything_free_at_an_end_can_be_written_as_an_empty_list():
    assert make(start=[]).start.shape == (0, 2)
    assert make(start=[]).digest == make(start=np.zeros((0, 2))).digest


def test_arrays_are_copied_and_frozen():
    given_points = np.array(WAYPOINTS)
    model = make(waypoints=given_points, velocity_limit=3, polytope_segments=[0],
                 polytope_normals=[[2.0, 0]], polytope_offsets=[9.0])  # fmt: skip
    given_points[0, 0] = 7
    assert model.waypoints[0, 0] == 0
    spaces = model.halfspaces
    for array in (
        model.waypoints, model.times, model.durations, model.velocity_limit, model.conditions,
        model.start, model.order_weights, spaces.normals, spaces.offsets, model.polytope_segments,
    ):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1


def test_limits_spread():
    one = make(velocity_limit=2.0).velocity_limit
    assert one.tolist() == [[2, 2], [2, 2]]
    # Two segments in 2-D: a flat list is one number an axis, a column one a segment.
    assert make(velocity_limit=[2, 3]).velocity_limit.tolist() == [[2, 3], [2, 3]]
    assert make(velocity_limit=[[2], [3]]).velocity_limit.tolist() == [[2, 2], [3, 3]]
    assert make(velocity_limit=[[2, 3]]).velocity_limit.tolist() == [[2, 3], [2, 3]]
    assert make(velocity_limit=[[2, 3], [4, 5]]).velocity_limit.tolist() == [[2, 3], [4, 5]]
    long = {"waypoints": np.zeros((4, 2)), "times": [0, 1, 2, 3]}
    with pytest.raises(InvalidData, match="one for each of 2 dimensions"):
        make(**long, velocity_limit=[1, 2, 3])
    assert make(**long, velocity_limit=[[1], [2], [3]]).velocity_limit[2].tolist() == [3, 3]


def test_replace_keeps_what_was_said():
    model = make(velocity_limit=[None, 3], name="a")
    other = replace(model, times=[0, 2, 3])
    assert other.name == "a"
    assert other.durations.tolist() == [2, 1]
    assert np.array_equal(other.velocity_limit, model.velocity_limit)
    assert replace(model, times=TIMES).digest == model.digest


def test_replace_of_the_order_keeps_the_defaults_filled_in():
    """A default is content once it is filled in; what should follow the order is named."""
    with pytest.raises(InvalidData, match="degree must be >= 2 order - 1 = 9, got 7"):
        replace(of_order(4), order=5)
    changed = replace(of_order(4), order=5, start=None, end=None, degree=None, continuity=None)
    assert changed.digest == of_order(5).digest


def test_half_spaces_are_distances():
    spaces = make(
        polytope_segments=[1], polytope_normals=[[3, 4]], polytope_offsets=[30]
    ).halfspaces
    assert spaces.normals.tolist() == [[0.6, 0.8]]
    assert spaces.offsets.tolist() == [6.0]
    # A waypoint that is free in one coordinate can be moved inside.
    make(waypoints=[[0, 0], [1, 2], [3, None]], end=np.zeros((0, 2)), polytope_segments=[1],
         polytope_normals=[[1, 1]], polytope_offsets=[4])  # fmt: skip


# -- the trajectory ----------------------------------------------------------------------------------


@st.composite
def trajectories(draw, most=9):
    count, axes = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    degree = draw(st.integers(0, most))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = 10.0 ** draw(st.integers(-6, 6))
    coefficients = generator.normal(size=(count, degree + 1, axes)) * scale
    zeros = draw(st.integers(0, degree))
    if draw(st.booleans()):
        coefficients[:, degree + 1 - zeros :] = 0.0
    times = np.cumsum(10 ** generator.uniform(-1, 1, count + 1))
    return Trajectory(times, coefficients)


def exact(plan, t, derivative):
    """Evaluate by fractions of 50 digits."""
    with mpmath.workdps(50):
        k = min(int(np.searchsorted(plan.times, t, "right")) - 1, plan.segments - 1)
        long = mpmath.mpf(plan.times[k + 1]) - mpmath.mpf(plan.times[k])
        s = (mpmath.mpf(t) - mpmath.mpf(plan.times[k])) / long
        value = []
        for axis in range(plan.dimensions):
            total = mpmath.mpf(0)
            for p in range(derivative, plan.degree + 1):
                total += (
                    mpmath.mpf(plan.coefficients[k, p, axis])
                    * math.perm(p, derivative)
                    * s ** (p - derivative)
                )
            value.append(float(total / long**derivative))
        return np.array(value)  # fmt: skip


@QUICK
@given(plan=trajectories(), share=st.floats(0, 1), derivative=st.integers(0, 11))
def test_values_against_fifty_digits(plan, share, derivative):
    t = float(np.clip(plan.times[0] + share * plan.duration, plan.times[0], plan.times[-1]))
    k = min(int(np.searchsorted(plan.times, t, "right")) - 1, plan.segments - 1)
    size = sum(
        np.abs(plan.coefficients[k, p]).max() * math.perm(p, derivative)
        for p in range(derivative, plan.degree + 1)
    )
    found = plan(t, derivative)
    bound = 1e-11 * size * plan.durations[k] ** -float(derivative)
    assert found.shape == (plan.dimensions,)
    assert np.abs(found - exact(plan, t, derivative)).max() <= bound


def test_calls_at_knots_outside_and_with_arrays():
    plan = Trajectory([0, 1, 3], [[[0.0], [1]], [[5.0], [2]]])
    assert plan(1).tolist() == [5.0]  # the later segment speaks
    assert plan(3).tolist() == [7.0]
    assert plan([[0, 0.5], [1, 3]]).shape == (2, 2, 1)
    assert plan(np.zeros((0,))).shape == (0, 1)
    assert plan(2, 1).tolist() == [1.0]
    assert plan(2, 2).tolist() == [0.0]
    assert plan(2, 30).tolist() == [0.0]
    assert plan(0.5, np.int64(1)).tolist() == [1.0]
    for t in (-1e-6, 3.00001, NAN, INF, [1, 4]):
        with pytest.raises(InvalidData, match=r"t must lie in \[0, 3\]"):
            plan(t)
    for derivative in (-1, 1.0, True, "1", None):
        with pytest.raises(InvalidData, match="derivative must be"):
            plan(1, derivative)
    begin, end = plan.at_ends(0)
    assert begin.tolist() == [[0], [5]]
    assert end.tolist() == [[1], [7]]


@pytest.mark.parametrize(
    ("times", "coefficients", "field", "words"),
    [
        ([0], np.zeros((0, 2, 1)), "times", "at least 2"),
        ([0, 1], np.zeros((2, 2, 1)), "coefficients", "coefficients has 2 entries where times"),
        ([0, 1], np.zeros((1, 0, 1)), "coefficients", "must not be empty"),
        ([0, 1], np.zeros((1, 2, 0)), "coefficients", "must not be empty"),
        ([0, 1], np.zeros((1, 2)), "coefficients", "shape"),
        ([0, 1], [[[NAN]]], "coefficients", r"coefficients\[0, 0, 0\] must be finite"),
        ([1, 1], [[[0]]], "times", r"times\[1\] must be > times\[0\]"),
        ([0, NAN], [[[0]]], "times", "must be finite"),
    ],
)
def test_bad_trajectories_are_refused(times, coefficients, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        Trajectory(times, coefficients)
    assert caught.value.field == field


@QUICK
@given(plan=trajectories())
def test_round_trips(plan):
    size = np.abs(plan.coefficients).max()
    inner = np.linspace(plan.times[0], plan.times[-1], 37)[:-1]
    near = plan(inner)
    piecewise, spline = plan.to_ppoly(), plan.to_bspline()
    assert isinstance(piecewise, PPoly)
    for other in (piecewise(inner), spline(inner)):
        assert np.allclose(other, near, rtol=0, atol=1e-10 * max(size, 1e-300))
    back = Trajectory.from_ppoly(piecewise)
    assert np.allclose(back.coefficients, plan.coefficients, rtol=1e-12, atol=0)
    control = plan.bezier()
    assert np.array_equal(control[:, 0], plan.coefficients[:, 0])
    assert np.allclose(control[:, -1], plan.at_ends()[1], rtol=0, atol=1e-11 * size)
    again = Trajectory.from_bezier(plan.times, control)
    assert np.allclose(again.coefficients, plan.coefficients, rtol=0, atol=1e-9 * size)
    assert Trajectory.from_data(json.loads(json.dumps(plan.to_data()))).to_data() == plan.to_data()


def test_a_ppoly_is_a_plan():
    model = make(MinimumDerivative, order=1, waypoints=[[0.0], [1], [3]])
    piecewise = PPoly(np.array([[1.0, 1.0], [0.0, 1.0]]), [0.0, 1, 3])
    assert model.verify(model.as_plan(piecewise)).ok
    with pytest.raises(InvalidData, match="2 or 3 dimensions"):
        Trajectory.from_ppoly(PPoly(np.zeros((2, 1, 2, 2)), [0.0, 1]))


@QUICK
@given(plan=trajectories(), derivative=st.integers(0, 10))
def test_integral_of_square_against_quadrature(plan, derivative):
    found = plan.integral_of_square(derivative)
    for axis in range(plan.dimensions):
        total = 0.0
        for k in range(plan.segments):
            own = polynomial.Polynomial(plan.coefficients[k, :, axis]).deriv(derivative)
            long = plan.durations[k]
            total += quad(lambda s, own=own: own(s) ** 2, 0, 1, epsabs=0, limit=200)[0] * long ** (
                1 - 2 * derivative
            )
        assert found[axis] == pytest.approx(total, rel=1e-9, abs=1e-300)


def check_extremes(plan, derivative):
    found = plan.extremes(derivative)
    for k in range(plan.segments):
        inner = np.linspace(0, 1, 801)
        for axis in range(plan.dimensions):
            own = polynomial.Polynomial(plan.coefficients[k, :, axis]).deriv(derivative)
            long = plan.durations[k]
            values = own(inner) * long**-derivative
            size = np.abs(own.coef).sum() * long**-derivative
            slack = 1e-11 * size
            assert found.least[k, axis] <= values.min() + slack
            assert found.largest[k, axis] >= values.max() - slack
            for value, t in (
                (found.least[k, axis], found.least_time[k, axis]),
                (found.largest[k, axis], found.largest_time[k, axis]),
            ):
                s = (t - plan.times[k]) / long
                assert -1e-12 <= s <= 1 + 1e-12
                wiggle = 1e-13 * plan.times[-1] / long * (plan.degree + 1) ** 2
                assert abs(own(s) * long**-derivative - value) <= (1e-11 + wiggle) * size


@settings(max_examples=60, deadline=None)
@given(plan=trajectories(), derivative=st.integers(0, 5))
def test_extremes_against_dense_samples(plan, derivative):
    check_extremes(plan, derivative)


@settings(max_examples=80, deadline=None)
@given(
    low=st.lists(st.floats(-2, 2), min_size=1, max_size=4),
    lead=st.sampled_from([0.0, 1e-300, 1e-17, 1e-15, 1e-13, 1e-12, 1e-11, 1e-9, 1e-6]),
    zeros=st.integers(0, 6),
    scale=st.sampled_from([1e-200, 1e-9, 1.0, 1e9, 1e200]),
)
@example(low=[0.0, 1.0, -1.0], lead=0.0, zeros=0, scale=1.0)
@example(low=[0.1, 0.7, -0.9], lead=0.0, zeros=0, scale=1.0)
@example(low=[0.6, -0.4, 0.5], lead=1e-13, zeros=0, scale=1.0)
def test_extremes_where_the_leading_coefficient_is_zero_or_nearly(low, lead, zeros, scale):
    """A cubic that is a parabola: its vertex must not move by the noise of a missing root."""
    coefficients = np.array([*low, *[0.0] * zeros, lead])[:, None] * scale
    check_extremes(Trajectory([0.0, 1.0], coefficients[None]), 0)


@settings(max_examples=40, deadline=None)
@given(roots=st.lists(st.floats(0, 1), min_size=1, max_size=6), sign=st.sampled_from([-1.0, 1.0]))
def test_critical_points_hit_prescribed_roots(roots, sign):
    """The slope's roots are known, so the extremes are."""
    powers = polynomial.polyint(polynomial.polyfromroots(roots)) * sign
    values = polynomial.polyval(np.array([0.0, 1.0, *roots]), powers)
    s = critical_points(powers[None])
    found = horner(powers[None, :, None], s)[0]
    size = np.abs(powers).sum()
    assert ((s >= 0) & (s <= 1)).all()
    assert abs(found.max() - values.max()) <= 1e-12 * size
    assert abs(found.min() - values.min()) <= 1e-12 * size


def test_extremes_along_a_direction():
    plan = Trajectory([0, 2.0], [[[0.0, 0], [1, 1], [0, -1]]])
    found = plan.extremes(0, direction=[[1.0, 1.0]])
    assert found.largest.shape == (1, 1)
    assert found.largest[0, 0] == pytest.approx(1.0)
    assert found.largest_time[0, 0] == pytest.approx(2.0)


def test_sampled():
    plan = Trajectory([1.0, 2.0, 3.05], [[[0.0, 1], [1, 0]], [[1.0, 1], [2, 0]]])
    rows = plan.sampled(10, 2)
    assert rows.shape == (22, 1 + 3 * 2)
    assert rows[0, 0] == 1.0
    assert rows[-1, 0] == 3.05
    assert np.allclose(np.diff(rows[:-1, 0]), 0.1)
    assert np.array_equal(rows[:, 1:3], plan(rows[:, 0]))
    assert np.array_equal(rows[:, 3:5], plan(rows[:, 0], 1))
    assert Trajectory([0, 1.0], [[[0.0]]]).sampled(10).shape == (11, 6)  # ends on a sample
    assert Trajectory([0, 0.3], [[[0.0]]]).sampled(0.1, 0).tolist() == [[0, 0], [0.3, 0]]
    for rate in (0, -1, NAN, INF):
        with pytest.raises(InvalidData, match="rate must be > 0"):
            plan.sampled(rate)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (None, "must be an object"),
        ({}, "'times' is missing"),
        ({"times": [0, 1]}, "'coefficients' is missing"),
        ({"times": [0, 1], "coefficients": [[[0]]], "degree": 0}, "unknown key 'degree'"),
        ({"times": ["0", 1], "coefficients": [[[0]]]}, r"times\[0\] must be a number"),
    ],
)
def test_bad_plan_data(data, words):
    with pytest.raises(InvalidData, match=words):
        make().plan_from_data(data)


# -- verification ------------------------------------------------------------------------------------


def rows_of(found):
    return {check.name: check for check in found.checks}


def violated(model, plan):
    return {check.name for check in model.verify(plan).violated}


def bumped(plan, segment, axis, powers):
    """Return `plan` with a polynomial in s added to one segment and axis."""
    degree = max(plan.degree, len(powers) - 1)
    c = np.zeros((plan.segments, degree + 1, plan.dimensions))
    c[:, : plan.degree + 1] = plan.coefficients
    c[segment, : len(powers), axis] += powers
    return Trajectory(plan.times, c)


@pytest.fixture(scope="module")
def optimum():
    return brute_force(make())


def test_a_right_plan_passes(optimum):
    found = make().verify(optimum)
    assert found.ok, found
    assert not found.within_tolerance
    names = [(check.name, check.equation) for check in found.checks]
    assert names[:3] == [("times", ""), ("waypoints", "24"), ("continuity of position", "25")]
    assert ("velocity at the ends", "23") in names
    assert ("continuity of jerk", "25") in names
    assert "continuity of snap" not in rows_of(found)
    assert found.objective == pytest.approx(optimum.integral_of_square(4).sum())


def test_moved_waypoint(optimum):
    # Both neighbours moved alike, so only the waypoint is off.
    c = optimum.coefficients.copy()
    bump = np.array([0, 0, 0, 0, 35, -84, 70, -20])
    c[0, :, 1] += 0.01 * bump
    c[1, 0, 1] += 0.01
    c[1, :, 1] -= 0.01 * bump
    found = make().verify(Trajectory(TIMES, c))
    assert [check.name for check in found.violated] == ["waypoints"]
    check = rows_of(found)["waypoints"]
    assert check.worst == pytest.approx(0.01)
    assert check.where == "knot 1, axis 1 (t = 1 s)"
    assert check.unit == "m"
    assert check.equation == "24"


@pytest.mark.parametrize(
    ("order", "word"), list(enumerate(["position", "velocity", "acceleration", "jerk"]))
)
def test_jump_of_each_derivative(optimum, order, word):
    free = make(waypoints=[[0, 0], [None, None], [3, 2]])
    basis = np.zeros((8, 8))
    for j in range(4):
        for p in range(8):
            basis[j, p] = math.factorial(j) if p == j else 0
            basis[4 + j, p] = math.perm(p, j)
    bump = np.linalg.solve(basis, np.eye(8)[order])  # its j-th derivative at 0 is 1, the others 0
    amount = 1e-3 * 2.0**order
    found = free.verify(bumped(optimum, 1, 1, amount * bump))
    assert [check.name for check in found.violated] == [f"continuity of {word}"]
    check = found.violated[0]
    assert check.worst == pytest.approx(1e-3, rel=1e-6)
    assert check.where == "knot 1, axis 1 (t = 1 s)"
    assert check.equation == "25"


@pytest.mark.parametrize(
    ("order", "word"), list(enumerate(["velocity", "acceleration", "jerk"], start=1))
)
@pytest.mark.parametrize("knot", [0, 2])
def test_wrong_end_derivative(optimum, order, word, knot):
    rows = np.zeros((3, 2))
    rows[order - 1, 1] = 1e-3
    model = make(**{"start" if knot == 0 else "end": rows})
    found = model.verify(optimum)
    assert [check.name for check in found.violated] == [f"{word} at the ends"]
    assert found.violated[0].worst == pytest.approx(1e-3, rel=1e-3)
    assert found.violated[0].where.startswith(f"knot {knot}, axis 1")
    assert found.violated[0].equation == "23"


def test_wrong_inner_derivative(optimum):
    rows = np.full((3, 2, 2), FREE)
    rows[1, 1, 0] = optimum(1.0, 2)[0] + 0.5
    found = make(derivatives=rows).verify(optimum)
    assert [check.name for check in found.violated] == ["acceleration at inner knots"]
    assert found.violated[0].worst == pytest.approx(0.5)
    assert found.violated[0].where == "knot 1, axis 0 (t = 1 s)"


def test_a_narrow_bump_between_all_samples_is_found(optimum):
    """s^a (1-s)^b of degree 31: half a hundredth wide at what a sampler would step over."""
    model = make(degree=31)
    base = brute_force(make())
    bump = polynomial.polyfromroots([0.0] * 5 + [1.0] * 26)
    s = 5 / 31
    bump = bump / polynomial.polyval(s, bump)
    top = base.extremes().largest[1].max()
    edge = top + 0.5
    poked = bumped(base, 1, 0, bump * (edge - float(base(1 + 2 * s)[0]) + 1e-4))
    exact_top = poked.extremes().largest[1, 0]
    corridor = replace(model, corridor_upper=np.array([[9.0, 9], [exact_top - 1e-5, 9]]))
    found = corridor.verify(poked)
    assert [c.name for c in found.violated] == ["corridor"]
    assert found.violated[0].worst == pytest.approx(1e-5, rel=1e-3)
    assert found.violated[0].where.startswith("segment 1, axis 0 (t = 1.3")
    assert replace(model, corridor_upper=[[9.0, 9], [exact_top + 1e-9, 9]]).verify(poked).ok


@pytest.mark.parametrize(
    ("order", "name"),
    list(enumerate(["velocity_limit", "acceleration_limit", "jerk_limit"], start=1)),
)
@pytest.mark.parametrize("sign", [1, -1])
def test_broken_limits(optimum, order, name, sign):
    plan = Trajectory(optimum.times, sign * optimum.coefficients)
    model = make(waypoints=sign * np.array(WAYPOINTS))
    found = plan.extremes(order)
    top = np.maximum(-found.least, found.largest)[1, 0]
    limits = np.full((2, 2), 1e6)
    limits[1, 0] = top - 0.01
    verdict = replace(model, **{name: limits}).verify(plan)
    assert [check.name for check in verdict.violated] == [name.replace("_", " ")]
    assert verdict.violated[0].worst == pytest.approx(0.01, rel=1e-6)
    assert verdict.violated[0].where.startswith("segment 1, axis 0 (t = ")
    t = float(verdict.violated[0].where.split("t = ")[1].split(" ")[0])
    assert abs(plan(t, order)[0]) == pytest.approx(top, rel=1e-5)
    limits[1, 0] = top + 1e-12
    assert replace(model, **{name: limits}).verify(plan).ok


def test_broken_half_space(optimum):
    normal = np.array([3.0, 4.0])
    t = np.linspace(1, 3, 100001)
    reach = (optimum(t) @ normal / 5).max()
    kept = {"polytope_segments": [0, 1], "polytope_normals": [[0, 1], normal]}
    top = max(optimum.extremes().largest[0, 1], 2.0) + 1
    model = make(**kept, polytope_offsets=[top, 5 * reach + 1e-6])
    assert model.verify(optimum).ok
    inside = make(waypoints=[[0, 0], [None, None], [None, None]], **kept,
                  polytope_offsets=[top, 5 * (reach - 0.02)])  # fmt: skip
    found = inside.verify(optimum)
    assert [check.name for check in found.violated] == ["polytope"]
    assert found.violated[0].worst == pytest.approx(0.02, rel=1e-4)
    assert found.violated[0].where.startswith("segment 1, half-space 1 (t = ")


def test_wrong_times_and_degree(optimum):
    found = make().verify(Trajectory([0, 1.001, 3], optimum.coefficients))
    check = rows_of(found)["times"]
    assert not check.ok
    assert check.where == "knot 1"
    assert check.worst == pytest.approx(1e-3)
    high = bumped(optimum, 1, 0, 1e-3 * polynomial.polyfromroots([0.0] * 4 + [1.0] * 4))
    assert violated(make(), high) == {"degree at most 7"}
    assert make(degree=8).verify(high).ok
    assert make().verify(bumped(optimum, 0, 0, np.zeros(12))).ok


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_small_violations_are_within_tolerance(optimum, share):
    c = optimum.coefficients.copy()
    c[:, 0, 0] += share * 1e-6 * 3  # positions reach 3 m, so that is their scale
    found = make().verify(Trajectory(TIMES, c))
    assert found.ok is (share < 1)
    if found.ok:
        assert "waypoints" in {check.name for check in found.within_tolerance}
    c = optimum.coefficients.copy()
    c[:, 0, 0] += 1e-10
    assert not make().verify(Trajectory(TIMES, c)).within_tolerance


@pytest.mark.parametrize(
    "plan",
    [
        Trajectory([0, 3.0], np.zeros((1, 8, 2))),
        Trajectory([0, 1, 3.0], np.zeros((2, 8, 3))),
    ],
)
def test_plans_of_another_shape_are_refused(plan):
    with pytest.raises(InvalidData, match=r"plan has \d segments in \d-D, the model 2"):
        make().verify(plan)
    with pytest.raises(InvalidData, match="plan has"):
        make().formulate("legendre").encode(plan)


@pytest.mark.parametrize("plan", [None, 3, "route", np.zeros((2, 8, 2))])
def test_what_is_no_plan_is_refused(plan):
    with pytest.raises(InvalidData, match="plan"):
        ct.verify(make(), plan)


@pytest.mark.parametrize("long", [1e-3, 1.0, 1e3])
def test_short_and_long_segments(long):
    times = np.array(TIMES) * long
    model = make(times=times)
    plan = Trajectory(times, brute_force(make()).coefficients)
    assert model.verify(plan).ok
    assert model.verify(plan).objective == pytest.approx(
        make().objective(brute_force(make())) * long**-7
    )
    top = plan.extremes(1).largest[1, 0]
    slow = replace(model, velocity_limit=np.array([[INF, INF], [top * 0.99, INF]]))
    assert violated(slow, plan) == {"velocity limit"}
    off = plan.coefficients.copy()
    off[1, 0, 0] += 1e-4
    assert {"waypoints", "continuity of position"} <= violated(model, Trajectory(times, off))


@pytest.mark.parametrize("far", [1e3, 1e6, 1e7])
def test_a_decimetre_counts_far_from_the_origin(optimum, far):
    """Moving the origin (a map's eastings) changes nothing of the problem, so nothing of its check."""
    points = np.array(WAYPOINTS) + far
    c = optimum.coefficients.copy()
    c[:, 0] += far
    plan = Trajectory(TIMES, c)
    top = optimum.extremes().largest[1, 1]
    upper = np.array([[9.0, 9], [9, top - 0.05]]) + far
    free = [[far, far], [None, None], [far + 3, None]]
    assert make(waypoints=points).verify(plan).ok
    corridor = make(waypoints=free, end=np.zeros((0, 2)), corridor_upper=upper)
    assert violated(corridor, plan) == {"corridor"}
    spaces = {"polytope_segments": [1], "polytope_normals": [[0.0, 1.0]]}
    assert violated(
        make(waypoints=free, end=np.zeros((0, 2)), **spaces, polytope_offsets=[far + top - 0.05]),
        plan,
    ) == {"polytope"}
    c = c.copy()
    c[1, 0, 0] += 0.05
    assert {"waypoints", "continuity of position"} <= violated(
        make(waypoints=points), Trajectory(TIMES, c)
    )


def test_a_wild_segment_excuses_no_jump_elsewhere():
    """A jump of 0.1 m/s² where the path is calm, however violent another segment is."""
    times = np.concatenate([[0.0, 0.1, 0.2], np.arange(1.0, 31.0)])
    points = np.concatenate([[0.0, 1000.0, 2000.0], 2000.0 + np.zeros(30)])
    model = MinimumSnap(points[:, None], times)
    plan = ct.solve(model, "banded").plan
    assert model.verify(plan).ok
    assert np.abs(plan.at_ends(2)[0]).max() > 1e5
    assert np.abs(plan(25.0, 2)).max() < 1
    s = polynomial.Polynomial([0, 1])
    bump = 0.05 * s**2 * (1 - s) ** 4  # jumps by 0.1 m/s² at the start of a late segment
    late = int(np.searchsorted(times, 25.0))
    assert "continuity of acceleration" in violated(model, bumped(plan, late, 0, bump.coef))


def test_polytopes_and_limits_beside_very_unequal_segments():
    """The clock that the extremes are found with must not swallow a short segment."""
    times = [-1e6, 0.0, 1e-11, 1.0]
    plan = Trajectory(times, np.zeros((3, 1, 1)))
    limits = {
        "polytope_segments": [0, 1, 2], "polytope_normals": [[1.0]] * 3, "polytope_offsets": [0.0] * 3,
    }  # fmt: skip
    assert MinimumSnap(np.zeros((4, 1)), times, **limits).verify(plan).ok


def test_position_only_is_scipys_spline():
    times = np.array([0.0, 1, 2.5, 3, 5])
    points = np.array([[0.0, 1], [1, 2], [3, 2], [0, 0], [1, -1]])
    spline = make_interp_spline(
        times, points, k=7, bc_type=([(j, np.zeros(2)) for j in (1, 2, 3)],) * 2
    )
    model = MinimumSnap(points, times)
    plan = brute_force(model)
    t = np.linspace(0, 5, 101)
    assert np.allclose(plan(t), spline(t), atol=1e-8)


# -- formulations ------------------------------------------------------------------------------------


def covering(model):
    names = ["legendre", "monomial"]
    if model.continuity <= model.order - 1:
        names.append("hermite")
    return names


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(model=models())
def test_every_program_agrees_with_brute_force(model):
    plan = optimum_of(model)
    best = model.objective(plan)
    size = max(1.0, np.abs(plan.coefficients).max())
    checked = model.verify(plan)
    assert checked.ok, checked
    assert best == pytest.approx(checked.objective)
    for name in covering(model):
        written = model.formulate(name)
        program = written.program
        point = written.encode(plan)
        rows = program.verify(point)
        assert rows.ok, (name, rows)
        assert program.objective(point) == pytest.approx(best, rel=1e-8, abs=1e-9 * size**2)
        again = written.decode(point)
        assert np.allclose(again.coefficients, plan.coefficients, rtol=0, atol=1e-7 * size)
        assert solved_densely(program) == pytest.approx(best, rel=1e-7, abs=1e-8 * size**2), name


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(model=models(), seed=st.integers(0, 999))
def test_blocks_cover_the_rows_and_name_places(model, seed):
    for name in covering(model):
        program = model.formulate(name).program
        assert sum(block.size for block in program.rows) == program.row_count
        assert sum(block.size for block in program.columns) == program.size
        for block in program.rows:
            for entry in range(block.size):
                place = block.place(entry)
                assert place.startswith(("at knot", "on segment")), place
                knot = int(place.split()[2].strip(","))
                assert 0 <= knot <= model.segments


@settings(max_examples=25, deadline=None)
@given(model=models(inner=False))
def test_the_legendre_hessian_is_zeros_and_ones(model):
    program = model.formulate("legendre").program
    hessian = program.hessian.toarray()
    if model.weights is None or np.count_nonzero(model.weights) == 1:
        assert np.array_equal(hessian, np.diag(np.diag(hessian)))
        each = np.diag(hessian).reshape(-1, model.degree + 1)
        assert np.array_equal(
            each, np.tile(np.arange(model.degree + 1) >= model.order, (len(each), 1))
        )
    largest = np.abs(program.matrix).max(axis=1).toarray().ravel()
    assert np.allclose(largest, 1.0)


def test_hermite_keeps_the_constant_and_has_no_rows():
    model = make()
    program = model.formulate("hermite").program
    assert program.row_count == 0
    assert program.size == 2 * 3  # velocity, acceleration, jerk of one knot in 2-D
    assert program.offset > 0
    straight = MinimumSnap([[0.0], [1]], [0, 1])
    assert straight.formulate("hermite").program.size == 0
    assert straight.formulate("hermite").program.objective(np.empty(0)) == pytest.approx(100800)


@pytest.mark.parametrize("name", ["legendre", "monomial", "hermite"])
@pytest.mark.parametrize(("option", "words"), [
    ({"samples": 1}, r"samples must lie in \[2, 1000\], got 1"),
    ({"samples": 1001}, "must lie in"),
    ({"samples": 8.0}, "must be a whole number"),
    ({"samples": True}, "must be a whole number"),
    ({"samples": "8"}, "must be a whole number"),
    ({"rounds": 3}, "no option 'rounds'"),
    ({"instants": 3}, "no option 'instants'"),
])  # fmt: skip
def test_options_are_checked(name, option, words):
    with pytest.raises(UnsupportedOption, match=words):
        make().formulate(name, **option)


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("paper", {"velocity_limit": 9}, "knows no velocity limit"),
        ("paper", {"corridor_lower": -9}, "knows no corridor"),
        (
            "paper",
            {"polytope_segments": [0], "polytope_normals": [[1, 0]], "polytope_offsets": [9]},
            "knows no polytopes",
        ),
        (
            "paper",
            {"derivatives": [[[None] * 2], [[1, None]], [[None] * 2]]},
            "fixes no derivative at inner knots",
        ),
        ("hermite", {"continuity": 4}, "continuity 4 needs another formulation"),
        ("hermite", {"start": np.zeros((4, 2)), "degree": 8}, "derivative 4 is fixed"),
    ],
)
def test_what_a_formulation_does_not_cover(name, changes, words):
    with pytest.raises(UnsupportedFormulation, match=words):
        make(**changes).formulate(name)


def walk(count, *, seed=0, **options):
    """Return the paper's own problem: C², at rest in velocity and acceleration."""
    generator = np.random.default_rng(seed)
    points = np.cumsum(generator.normal(size=(count + 1, 1)), axis=0)
    rest = np.zeros((2, 1))
    return MinimumSnap(
        points, np.arange(count + 1.0), continuity=2, start=rest, end=rest, **options
    )


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_papers_program_is_right_for_few_segments(count):
    model = walk(count)
    plan = brute_force(model)
    best = model.objective(plan)
    written = model.formulate("paper")
    assert written.program.objective(written.encode(plan)) == pytest.approx(best, rel=1e-4)
    answer = ct.solve(model, "piqp", formulation="paper")
    assert answer.termination == "optimal", answer
    assert answer.primal_bound == pytest.approx(best, rel=1e-6)


def condition(model, name):
    program = model.formulate(name).program
    rows = program.matrix.toarray()
    system = np.block(
        [[program.hessian.toarray(), rows.T], [rows, np.zeros((len(rows), len(rows)))]]
    )
    return np.linalg.cond(system)


def test_the_papers_optimality_system_is_numerically_singular():
    assert condition(walk(5), "paper") > 1e15
    assert condition(walk(5), "legendre") < 1e7


@pytest.mark.parametrize("backend", ["piqp", "clarabel"])
def test_the_papers_program_breaks_down_and_is_rejected(backend):
    model = walk(100)
    broken = ct.solve(model, backend, formulation="paper", time_limit=30)
    assert broken.termination == "rejected", broken
    assert broken.plan is None
    assert broken.dual_bound is None
    right = ct.solve(model, backend, formulation="legendre")
    assert right.termination == "optimal", right
    assert right.verification.ok


def test_the_papers_program_relaxes_the_minimum_snap_spline():
    model = make()
    answer = ct.solve(model, "piqp", formulation="paper")
    assert answer.termination == "rejected"
    assert "continuity of jerk" in {c.name for c in answer.verification.violated}
    paper = make(continuity=2, start=np.zeros((2, 2)), end=np.zeros((2, 2)))
    assert ct.solve(paper, "piqp", formulation="paper").primal_bound < make().objective(
        brute_force(make())
    )


# -- corridors: refinement -----------------------------------------------------------------------------


def bounded(**changes):
    free = brute_force(make())
    top = np.maximum(-free.extremes(1).least, free.extremes(1).largest).max()
    return make(
        velocity_limit=0.95 * top, corridor_upper=[3.05, 2.05], corridor_lower=-0.05, **changes
    )


@pytest.mark.parametrize("name", ["legendre", "hermite"])
@pytest.mark.parametrize("samples", [2, 5, 8])
def test_refinement_adds_instants_until_the_exact_extremes_settle(name, samples):
    from crosstrack.solvers import Request, find_backend

    model = bounded(degree=8)
    backend = find_backend("piqp")
    written = model.formulate(name, samples=samples)
    values, rows, points, bounds = [], [], [], []
    while True:
        request = Request(options=backend.checked_options({}))
        answer = backend.run(written.program, request)
        assert answer.termination == "optimal"
        values.append(written.program.objective(answer.point))
        bounds.append(written.program.dual_bound(answer.duals, answer.point))
        rows.append(written.program.row_count)
        points.append(answer.point)
        finer = written.refined(answer.point, 1e-6)
        if finer is None:
            break
        # The old program is a relaxation of the new one: its rows are among the new ones.
        assert finer.program.row_count >= written.program.row_count
        written = finer
    assert all(a <= b * (1 + 1e-5) for a, b in pairwise(values))
    assert all(bound <= values[-1] * (1 + 1e-7) for bound in bounds)
    assert rows[-1] > rows[0]
    found = model.verify(written.decode(points[-1]))
    assert found.ok, found
    assert len(values) > 1
    solution = ct.solve(model, "piqp", formulation=name, formulation_options={"samples": samples})
    assert solution.termination == "optimal"
    assert solution.primal_bound == pytest.approx(values[-1], rel=1e-6)
    assert solution.statistics["refinements"] == len(values) - 1


def test_a_plan_that_keeps_the_limits_satisfies_every_refined_program():
    from crosstrack.solvers import Request, find_backend

    model = bounded()
    plan = ct.solve(model, "piqp").plan
    backend = find_backend("piqp")
    for name in ("legendre", "monomial", "hermite"):
        written = model.formulate(name, samples=2)
        for _ in range(3):
            assert written.program.verify(written.encode(plan)).ok
            answer = backend.run(written.program, Request(options=backend.checked_options({})))
            written = written.refined(answer.point, 1e-6) or written


def test_limits_above_the_degree_are_no_trouble():
    """The jerk of a polyline is zero; a limit on it says nothing."""
    model = of_order(1, jerk_limit=1.0, velocity_limit=9.0)
    plan = brute_force(of_order(1))
    assert model.verify(plan).ok
    assert ct.solve(model, "piqp").primal_bound == pytest.approx(model.objective(plan))


@pytest.mark.parametrize("backend", ["piqp", "clarabel"])
def test_a_straight_flight_at_constant_speed_is_optimal(backend):
    """Its objective is zero, which no relative gap can measure."""
    rows = [[1.0], [None], [None]]
    model = MinimumSnap([[0.0], [1], [2]], [0, 1, 2], start=rows, end=rows, velocity_limit=1.5)
    answer = ct.solve(model, backend)
    assert answer.termination == "optimal", answer
    assert answer.primal_bound == pytest.approx(0.0, abs=1e-12)
