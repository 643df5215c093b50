"""The structured interior point: other solvers, known optima, proofs, limits, and its kernels."""

import math
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st
from numpy.polynomial import polynomial
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import MinimumSnap
from crosstrack.models.minimum_snap import FREE, MinimumDerivative
from crosstrack.models.minimum_snap.polynomials import critical_points
from crosstrack.models.minimum_snap.trajectory import Trajectory
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.backend import Limit
from crosstrack.solvers.minimum_snap.chain_kernels import (
    bound_gradient,
    factorise,
    multiply,
    row_values,
    solve_factors,
    transposed,
)
from crosstrack.solvers.minimum_snap.separation import outside

OURS = "interior-point"
INF = math.inf


def solved(model, **options):
    """Return our solution, its bounds checked against one another."""
    answer = ct.solve(model, OURS, **options)
    if answer.primal_bound is not None and answer.dual_bound is not None:
        assert answer.dual_bound <= answer.primal_bound + 1e-7 * abs(answer.primal_bound) + 1e-7, (
            answer
        )
    return answer


def agree(model, *others, rel=1e-6):
    """Solve with ours and with others; all must be optimal and alike."""
    ours = solved(model)
    assert ours.termination == "optimal", ours
    assert ours.verification.ok
    assert ours.gap <= 1.1e-6
    for name in others:
        other = ct.solve(model, name, formulation="legendre")
        assert other.termination == "optimal", other
        assert ours.primal_bound == pytest.approx(other.primal_bound, rel=rel, abs=1e-9), name
    return ours


def corridor(seed, *, count=6, axes=2, order=4, width=0.3, **options):
    """Return a walk with boxes about its legs, and limits that bite a little."""
    generator = np.random.default_rng(seed)
    points = np.cumsum(generator.normal(size=(count + 1, axes)), axis=0)
    times = np.concatenate([[0], np.cumsum(generator.uniform(0.6, 1.8, count))])
    lower = np.minimum(points[:-1], points[1:]) - width
    upper = np.maximum(points[:-1], points[1:]) + width
    return MinimumDerivative(
        points, times, order=order, corridor_lower=lower, corridor_upper=upper, **options
    )


def limited(model, share=0.96):
    """Return `model` with limits at a share of what it needs without them."""
    answer = solved(model)
    assert answer.termination == "optimal", answer
    free, limits = answer.plan, {}
    for order, name in ((1, "velocity_limit"), (2, "acceleration_limit")):
        found = free.extremes(order)
        limits[name] = share * np.maximum(-found.least, found.largest).max(axis=0) + 0.05
        share = (1 + share) / 2
    return replace(model, **limits)


def flown(seed):
    """Return a model that a known plan keeps, by a margin, and the plan.

    The plan interpolates random derivatives, so nothing but arithmetic says that it is feasible.
    """
    generator = np.random.default_rng(seed)
    r, count = int(generator.integers(1, 5)), int(generator.integers(1, 9))
    axes = int(generator.integers(1, 4))
    long = 10 ** generator.uniform(-0.7, 0.7, count)
    times = np.concatenate([[0], np.cumsum(long)])
    size = generator.choice([0.1, 1, 1, 10])
    points = np.cumsum(generator.normal(size=(count + 1, axes)), axis=0) * size
    points += generator.choice([0, 0, 0, 1e3])
    degree = 2 * r - 1 + int(generator.choice([0, 0, 0, 2]))
    jets = generator.normal(size=(count + 1, r, axes)) * size
    jets[:, 0] = points
    jets[[0, -1], 1:] = 0
    ends = np.array(
        [
            [math.perm(p, j) * float(s or p == j) for p in range(2 * r)]
            for s in (0, 1)
            for j in range(r)
        ]
    )
    powers = []
    for k in range(count):
        scale = (long[k] ** np.arange(r))[:, None]
        powers.append(np.linalg.solve(ends, np.concatenate([jets[k] * scale, jets[k + 1] * scale])))
    plan = Trajectory(times, np.array(powers))
    gone = generator.random((count + 1, axes)) < 0.4
    gone[[0, -1]] = False
    points[gone] = FREE
    margin = 10 ** generator.uniform(-6, -0.5)
    options = {}
    if generator.random() < 0.8:
        found = plan.extremes(0)
        wide = margin * np.maximum(found.largest - found.least, 1e-9 * size)
        kept = generator.random((count, axes)) < 0.7
        if generator.random() < 0.7:
            options["corridor_lower"] = np.where(kept, found.least - wide, -INF)
        if generator.random() < 0.7:
            options["corridor_upper"] = np.where(kept, found.largest + wide, INF)
    for order, name in enumerate(("velocity_limit", "acceleration_limit", "jerk_limit"), start=1):
        if order < 2 * r and generator.random() < 0.4:
            found = plan.extremes(order)
            top = np.maximum(-found.least, found.largest)
            options[name] = (top if generator.random() < 0.5 else top.max()) * (1 + margin)
    return MinimumDerivative(points, times, order=r, degree=degree, **options), plan


# -- against other solvers and known optima ------------------------------------------------------------


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_corridors_with_limits(axes, order):
    model = limited(corridor(10 * axes + order, axes=axes, order=order, degree=2 * order + 1))
    agree(model, "piqp")


@pytest.mark.parametrize("seed", range(3))
def test_three_solvers_on_corridors(seed):
    agree(corridor(seed, count=8, axes=2), "piqp", "clarabel")


def test_without_bounds_it_is_scipys_spline():
    generator = np.random.default_rng(3)
    points = np.cumsum(generator.normal(size=(41, 3)), axis=0)
    times = np.concatenate([[0], np.cumsum(generator.uniform(0.5, 2, 40))])
    rest = [(j, np.zeros(3)) for j in (1, 2, 3)]
    spline = make_interp_spline(times, points, k=7, bc_type=(rest, rest))
    answer = solved(MinimumSnap(points, times))
    assert answer.termination == "optimal"
    t = np.linspace(0, times[-1], 500)
    for order in range(4):
        reference = spline(t, order)
        assert np.abs(answer.plan(t, order) - reference).max() <= 1e-7 * np.abs(reference).max()


def test_higher_degree_and_weights():
    agree(limited(corridor(5, degree=9, weights=[0.0, 0.5, 0.2, 1.0])), "piqp")
    agree(limited(corridor(6, order=3, degree=8, weights=[0.3, 0.0, 1.0])), "piqp")


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_one_sided_bounds(side):
    both = corridor(7)
    other = "corridor_upper" if side == "lower" else "corridor_lower"
    agree(replace(both, **{other: None}), "piqp")


def test_bounds_on_some_segments_and_axes():
    model = corridor(8, axes=3)
    kept = np.zeros((6, 3), bool)
    kept[2, 0] = kept[4, 2] = True
    agree(
        replace(
            model,
            corridor_lower=np.where(kept, model.corridor_lower, -INF),
            corridor_upper=np.where(kept, model.corridor_upper, INF),
        ),
        "piqp",
    )


def test_fixed_inner_derivatives_and_free_waypoints():
    model = corridor(9, count=6)
    points = model.waypoints.copy()
    points[[2, 4]] = FREE
    rows = np.full((7, 3, 2), FREE)
    rows[3, 0] = 0.1
    rows[5, 1, 0] = -0.2
    agree(replace(model, waypoints=points, derivatives=rows), "piqp")


def test_free_and_moving_ends():
    start, end = [[0.5, None], [None, None]], [[None, -0.3]]
    agree(replace(corridor(11), start=start, end=end), "piqp")


def test_polytopes():
    """A regular hexagon about the middle of each leg."""
    model = corridor(12, count=5)
    segments, normals, offsets = [], [], []
    for k in range(model.segments):
        a, b = model.waypoints[k : k + 2]
        reach = np.linalg.norm(b - a) / 2 + 0.02
        for angle in np.arange(6) * np.pi / 3:
            normal = np.array([np.cos(angle), np.sin(angle)])
            segments.append(k)
            normals.append(3 * normal)
            offsets.append(3 * (normal @ (a + b) / 2 + reach))
    spaces = {
        "polytope_segments": segments, "polytope_normals": normals, "polytope_offsets": offsets,
    }  # fmt: skip
    plain = MinimumSnap(model.waypoints, model.times)
    assert not replace(plain, **spaces).verify(solved(plain).plan).ok
    agree(replace(plain, **spaces), "piqp", rel=2e-6)
    agree(replace(plain, **spaces, velocity_limit=4.5), "piqp", rel=2e-6)


@pytest.mark.parametrize("count", [1, 3])
def test_one_polytope_is_the_box_it_describes(count):
    model = corridor(13, count=count)
    segments = np.repeat(np.arange(count), 4)
    normals = np.tile([[1.0, 0], [-1, 0], [0, 1], [0, -1]], (count, 1))
    bounds = np.stack([model.corridor_upper, -model.corridor_lower], axis=2).reshape(count * 4)
    cut = MinimumSnap(
        model.waypoints, model.times, polytope_segments=segments, polytope_normals=normals,
        polytope_offsets=bounds,
    )  # fmt: skip
    assert solved(cut).primal_bound == pytest.approx(solved(model).primal_bound, rel=1e-6)


@pytest.mark.parametrize("width", [1e-1, 1e-2, 1e-3])
def test_thin_corridors(width):
    """Straight through boxes hardly wider than the line: nearly an equality."""
    points = np.column_stack([np.arange(6.0), np.zeros(6)])
    points[1:-1] = FREE
    lower = np.column_stack([np.arange(5.0) - 0.2, np.full(5, -width)])
    upper = np.column_stack([np.arange(5.0) + 1.2, np.full(5, width)])
    agree(
        MinimumSnap(
            points, np.arange(6.0), start=[[0, 0.2]], corridor_lower=lower, corridor_upper=upper
        )
        if width > 1e-2
        else MinimumSnap(points, np.arange(6.0), corridor_lower=lower, corridor_upper=upper),
        "piqp",
    )


@pytest.mark.parametrize("level", [0.0, 5.0, -5.0, 1e3, 1e6])
@pytest.mark.parametrize("inner", [False, True])
def test_a_corridor_of_no_width(level, inner):
    """Flight at one height: the box has no inside, its optimum is the line, and nobody may err."""
    middle = level if inner else FREE
    model = MinimumSnap(
        [[level], [middle], [level]], [0, 1, 3], corridor_lower=[level], corridor_upper=[level]
    )
    answer = solved(model)
    assert answer.termination in ("optimal", "feasible"), answer
    assert answer.primal_bound == pytest.approx(0.0, abs=1e-9)
    assert answer.dual_bound is None or answer.dual_bound <= 1e-9


def test_a_corridor_of_no_width_beside_a_wide_one():
    model = MinimumSnap(
        [[0.0, 5], [None, None], [3, 5]], [0, 1, 3], corridor_lower=[-1, 5], corridor_upper=[4, 5]
    )
    agree(model, "piqp")


def test_very_different_durations():
    """Ratios of 400, in a corridor and under a limit that a known plan keeps by a hundredth."""
    generator = np.random.default_rng(14)
    long = np.array([1, 400, 1, 20, 400, 1, 5]) * 0.05
    points = np.cumsum(generator.normal(size=(8, 1)) * np.append(long, 1)[:, None], axis=0)
    times = np.concatenate([[0], np.cumsum(long)])
    known = solved(MinimumDerivative(points, times, order=3))
    assert known.termination == "optimal"
    found = known.plan.extremes(0)
    room = 0.01 * (found.largest - found.least)
    speed = known.plan.extremes(1)
    points[[2, 4, 6]] = FREE
    tight = MinimumDerivative(
        points, times, order=3, corridor_lower=found.least - room,
        corridor_upper=found.largest + room,
        velocity_limit=1.01 * np.maximum(-speed.least, speed.largest),
    )  # fmt: skip
    assert agree(tight, "piqp", rel=1e-5).primal_bound <= known.primal_bound


@pytest.mark.parametrize("far", [1e3, 1e5, 1e6])
def test_far_from_the_origin(far):
    near = corridor(15, axes=1)
    moved = replace(
        near,
        waypoints=near.waypoints + far,
        corridor_lower=near.corridor_lower + far,
        corridor_upper=near.corridor_upper + far,
    )
    answer = solved(moved)
    assert answer.termination == "optimal", answer
    assert answer.primal_bound == pytest.approx(
        solved(near).primal_bound, rel=1e-5 if far > 1e5 else 2e-6
    )


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("clock", [1e-2, 1e2])
def test_units_of_length_and_time(scale, clock):
    base = corridor(16, axes=1, order=3)
    model = MinimumDerivative(
        base.waypoints * scale, base.times * clock, order=3,
        corridor_lower=base.corridor_lower * scale, corridor_upper=base.corridor_upper * scale,
    )  # fmt: skip
    answer = solved(model)
    assert answer.termination == "optimal", answer
    expected = solved(base).primal_bound * scale**2 * clock**-5
    assert answer.primal_bound == pytest.approx(expected, rel=1e-5 if scale >= 1 else 5e-3)


@pytest.mark.parametrize("order", [1, 2])
def test_limits_of_derivatives_above_the_degree(order):
    """The jerk of a polyline or a parabola is none, and limits on it ask nothing."""
    model = MinimumDerivative(
        [[0.0], [1], [3]], [0, 1, 3], order=order, jerk_limit=1e3, acceleration_limit=1e3
    )
    plain = solved(MinimumDerivative([[0.0], [1], [3]], [0, 1, 3], order=order))
    assert solved(model).termination == "optimal"
    assert solved(model).primal_bound == pytest.approx(plain.primal_bound)


def test_a_straight_flight_at_constant_speed_is_optimal():
    rows = [[1.0], [None], [None]]
    model = MinimumSnap([[0.0], [1], [2]], [0, 1, 2], start=rows, end=rows, velocity_limit=1.5)
    answer = solved(model)
    assert answer.termination == "optimal", answer


def test_hovering():
    answer = solved(MinimumSnap(np.full((4, 3), 2.0), np.arange(4.0), velocity_limit=1.0))
    assert answer.termination == "optimal"
    assert answer.primal_bound == pytest.approx(0.0, abs=1e-12)


# -- what is feasible is never called infeasible --------------------------------------------------------


@pytest.mark.parametrize("seed", range(0, 60, 4))
def test_what_a_plan_keeps_is_solved(seed):
    check_flown(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60, 300))
def test_what_a_plan_keeps_is_solved_always(seed):
    check_flown(seed)


#: Where the warm start after an added instant stalls, although a cold one converges.
@pytest.mark.parametrize("seed", [10, 18, 39, 43, 59, 64, 72, 92, 93, 96])
def test_a_stall_after_added_instants_is_overcome(seed):
    check_flown(seed)


def check_flown(seed):
    model, plan = flown(seed)
    checked = model.verify(plan)
    assert checked.ok, checked
    answer = solved(model)
    assert answer.termination != "infeasible"
    if answer.dual_bound is not None:
        assert answer.dual_bound <= checked.objective * (1 + 1e-6) + 1e-9
    assert answer.termination == "optimal", answer
    assert answer.primal_bound <= checked.objective * (1 + 1e-6) + 1e-9


# -- proofs that there is none --------------------------------------------------------------------------


def refuted(model):
    answer = ct.solve(model, OURS)
    assert answer.termination == "infeasible", answer
    assert answer.plan is None
    words = answer.message.split(" contradict")[0].split("segment")[1].removeprefix("s")
    return {int(word) for word in words.split(",")}


def test_too_slow_for_one_leg():
    model = MinimumSnap([[0.0], [1], [5], [6]], [0, 1, 2, 3], velocity_limit=[[9.0], [3.0], [9.0]])
    assert refuted(model) == {1}
    long = MinimumSnap(
        np.arange(30.0)[:, None], np.arange(30.0),
        velocity_limit=np.where(np.arange(29) == 17, 0.99, 9.0)[:, None],
    )  # fmt: skip
    assert refuted(long) == {17}


def test_boxes_that_do_not_meet():
    for gap in (1.0, 1e-3):
        lower = np.array([[-1.0], [-1], [2 + gap], [2]])
        upper = np.array([[2.0], [2], [6], [6]])
        model = MinimumSnap(
            [[0.0], [None], [None], [None], [5]], np.arange(5.0),
            corridor_lower=lower, corridor_upper=upper,
        )  # fmt: skip
        assert refuted(model) == {1, 2}


def test_boxes_that_touch_in_a_point_do_meet():
    model = MinimumSnap(
        [[0.0], [None], [5]], [0, 1, 2], corridor_lower=[[-1.0], [2]], corridor_upper=[[2.0], [6]]
    )
    agree(model, "piqp")


@pytest.mark.parametrize("legs", [1, 3])
def test_a_stop_that_no_brake_can_do(legs):
    points = np.full((legs + 1, 1), FREE)
    points[[0, -1], 0] = 0, 4
    model = MinimumDerivative(
        points, np.linspace(0, 1, legs + 1), order=2, degree=5, start=[[10.0]], end=[[0.0]],
        acceleration_limit=9.0,
    )  # fmt: skip
    assert refuted(model) <= set(range(legs))


@pytest.mark.parametrize("name", ["velocity_limit", "acceleration_limit"])
def test_a_flight_without_any_freedom(name):
    """One leg from rest to rest has one polynomial: its peaks are known, and so is the verdict."""
    peaks = {"velocity_limit": 1.5, "acceleration_limit": 6.0}
    model = MinimumDerivative([[0.0], [1]], [0, 1], order=2)
    kept = replace(model, **{name: peaks[name] * 1.0001})
    assert solved(kept).termination == "optimal"
    assert refuted(replace(model, **{name: peaks[name] * 0.99})) == {0}


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_proofs_with_bounds_on_one_side_only(side):
    """Beside a bound that is infinite: zero times infinity is no violation."""
    points = [[0.0], [None], [None], [0]]
    bound = np.full((3, 1), INF if side == "upper" else -INF)
    bound[1] = -3 if side == "upper" else 3
    model = MinimumSnap(points, [0, 1, 2, 3], velocity_limit=2.0, **{f"corridor_{side}": bound})
    assert refuted(model) <= {0, 1, 2}


def test_a_hair_of_room_is_room():
    """The mean speed is 1: a limit of 1 + 1e-6 is kept, one of 1 - 1e-6 is not."""
    free = {"start": np.zeros((0, 1)), "end": np.zeros((0, 1)), "order": 2, "degree": 5}
    for limit, verdict in ((1 + 1e-6, "optimal"), (1 - 1e-4, "infeasible")):
        model = MinimumDerivative([[0.0], [1], [2]], [0, 1, 2], velocity_limit=limit, **free)
        answer = ct.solve(model, OURS)
        assert answer.termination == verdict, answer


# -- limits, threads, options ---------------------------------------------------------------------------


def long_corridor(count=3000, axes=3):
    return corridor(21, count=count, axes=axes)


def test_a_stopped_run_proves_nothing():
    backend = find_backend(OURS)
    request = Request(options=backend.checked_options({}))
    request.control.stop(Limit.INTERRUPTED)
    answer = backend.run(corridor(1), request)
    assert answer.termination == "no_solution"
    assert answer.limit is Limit.INTERRUPTED
    assert answer.dual_bound is None
    assert answer.point is None


@pytest.mark.parametrize("threads", [None, 2])
def test_a_time_limit_is_kept(threads):
    find_backend(OURS).prepare()
    model = long_corridor()
    for limit in (1e-6, 0.05):
        begin = time.perf_counter()
        answer = ct.solve(model, OURS, time_limit=limit, threads=threads)
        assert time.perf_counter() - begin < 5
        assert answer.termination == "no_solution", answer
        assert answer.limit == "time"
        assert answer.dual_bound is None
    with pytest.raises(UnsupportedOption, match="time_limit must be a number > 0"):
        ct.solve(model, OURS, time_limit=0)


def test_threads_and_repetition_change_nothing():
    model = limited(corridor(2, axes=3, count=10))
    plans = [solved(model, threads=threads).plan for threads in (None, 2, 3, None)]
    for plan in plans[1:]:
        assert np.array_equal(plan.coefficients, plans[0].coefficients)


@pytest.mark.parametrize(
    "options",
    [
        {"samples": 1},
        {"samples": 65},
        {"samples": 8.5},
        {"iterations": 0},
        {"rounds": 0},
        {"gap": 1},
    ],
)
def test_options_are_checked(options):
    with pytest.raises(UnsupportedOption, match=next(iter(options))):
        ct.solve(corridor(1), OURS, backend_options=options)


@pytest.mark.parametrize("samples", [2, 3, 16, 64])
def test_samples_change_nothing(samples):
    model = limited(corridor(4, axes=1))
    best = solved(model).primal_bound
    answer = solved(model, backend_options={"samples": samples})
    assert answer.termination == "optimal", answer
    assert answer.primal_bound == pytest.approx(best, rel=2e-6)


@pytest.mark.parametrize("options", [{"iterations": 1}, {"rounds": 1, "samples": 2}])
def test_too_few_iterations_are_a_limit(options):
    answer = ct.solve(limited(corridor(4)), OURS, backend_options=options)
    assert answer.termination in ("no_solution", "feasible", "rejected"), answer
    if answer.termination == "no_solution":
        assert answer.limit == "iterations"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"continuity": 2}, "continuity 2"),
        ({"continuity": 4, "degree": 9}, "continuity 4"),
        ({"start": np.zeros((4, 2)), "degree": 9}, "above 3 is fixed"),
    ],
)
def test_what_it_does_not_cover(changes, words):
    with pytest.raises(UnsupportedFormulation, match=words):
        ct.solve(replace(corridor(1), **changes), OURS)


def test_every_axis_alone_is_the_same_problem():
    model = corridor(17, axes=3)
    whole = solved(model)
    total = 0.0
    for axis in range(3):
        alone = MinimumSnap(
            model.waypoints[:, [axis]], model.times,
            corridor_lower=model.corridor_lower[:, [axis]],
            corridor_upper=model.corridor_upper[:, [axis]],
        )  # fmt: skip
        one = solved(alone)
        total += one.primal_bound
        t = np.linspace(0, model.times[-1], 200)
        assert np.allclose(one.plan(t)[:, 0], whole.plan(t)[:, axis], atol=1e-6)
    assert whole.primal_bound == pytest.approx(total, rel=1e-9)


def test_three_hundred_segments():
    answer = solved(corridor(18, count=300, axes=3))
    assert answer.termination == "optimal", answer
    assert answer.primal_bound == pytest.approx(477187.2572, rel=1e-7)  # PIQP's


@pytest.mark.slow
def test_a_thousand_segments():
    model = corridor(18, count=1000, axes=3)
    ours = solved(model)
    assert ours.termination == "optimal"
    # With fewer instants from the start its last refinement stalls at a residual of 1e-6.
    other = ct.solve(model, "piqp", formulation="legendre", formulation_options={"samples": 8})
    assert other.termination == "optimal", other
    assert ours.primal_bound == pytest.approx(other.primal_bound, rel=1e-6)


# -- kernels ----------------------------------------------------------------------------------------------


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
    image = matrix[:, free].T @ generator.normal(
        size=len(matrix)
    )  # in the range, whatever the rank
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
    """Return the rows, places and shares of `outside`, compiled and plain alike."""
    edges = np.asarray(lower, float), np.asarray(upper, float)
    sizes = (np.maximum(1.0, np.where(np.isfinite(edge), np.abs(edge), 1.0)) for edge in edges)
    arguments = (np.ascontiguousarray(powers), *edges, *sizes)
    compiled = outside(*arguments, threshold)
    python = plain(outside)(*arguments, threshold)
    for a, b in zip(compiled, python, strict=True):
        assert np.allclose(a, b, rtol=0, atol=1e-9)
    return compiled


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    roots=st.lists(st.floats(-0.5, 1.5), min_size=0, max_size=6),
    sign=st.sampled_from([-1.0, 1.0]),
    share=st.floats(0.01, 1.2),
)
@example(roots=[0.5], sign=-1.0, share=0.5)
@example(roots=[0.25, 0.5, 0.75], sign=-1.0, share=0.1)
@example(roots=[0.0, 1.0], sign=-1.0, share=0.5)
def test_extremes_outside_against_known_roots(roots, sign, share):
    """The slope's roots are given; those apart by a cell of the grid must all be found."""
    inner = sorted(r for r in roots if -0.1 < r < 1.1)
    if any(b - a < 1 / 16 for a, b in pairwise(inner)):
        return
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


def test_three_roots_in_one_cell():
    """Extremes closer than the grid count as one: what is passed over is tiny, and verified."""
    roots = np.array([0.5103, 0.5168, 0.5235])
    powers = 1e4 * polynomial.polyint(-polynomial.polyfromroots(roots))
    values = polynomial.polyval(roots, powers)
    powers[0] -= values.max()
    _, _, found = reported(powers[None], [-INF], [-1e-4])
    assert found.max() == pytest.approx(1e-4, abs=1.001 * np.ptp(values[[0, 2]]))
    exact = polynomial.polyval(critical_points(powers[None])[0], powers)
    assert exact.max() == pytest.approx(0.0, abs=1e-12)


def test_many_rows_are_many_answers():
    """The buffers grow: every second row is far outside at both ends and in the middle."""
    powers = np.tile([[1.0, 0.1, -0.13], [0.0, 0.0, 0.0]], (500, 1))
    rows, _, shares = reported(powers, np.full(1000, -INF), np.full(1000, 0.5))
    assert sorted(set(rows.tolist())) == list(range(0, 1000, 2))
    assert (shares > 0).all()
    assert reported(powers[:0], np.empty(0), np.empty(0))[0].size == 0
    assert reported(powers, np.full(1000, -INF), np.full(1000, INF))[0].size == 0


def test_bad_models_do_not_reach_it():
    with pytest.raises(InvalidData):
        corridor(1, velocity_limit=-1)
