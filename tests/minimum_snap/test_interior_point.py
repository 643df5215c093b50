"""The structured interior point: other solvers, known optima, limits and options."""

import time
from dataclasses import replace

import numpy as np
import pytest
from minimum_snap.corridors import INF, OURS, agree, corridor, limited, solved
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import MinimumSnap
from crosstrack.models.minimum_snap import FREE, MinimumDerivative
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.contract.backend import Limit


# Axes are solved apart: one number of them for each order.
@pytest.mark.parametrize(("order", "axes"), [(2, 1), (3, 2), (4, 3)])
def test_corridors_with_limits(order, axes):
    model = limited(corridor(10 * axes + order, axes=axes, order=order, degree=2 * order + 1))
    agree(model, "piqp")


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
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
    """A straight line through very narrow boxes, nearly an equality."""
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
    """Flight at one height: the box has no interior, and the optimum is the line."""
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
    assert agree(tight).primal_bound <= known.primal_bound
    other = ct.solve(tight, "piqp", formulation="legendre")  # its path was 4e-6 of the extent off
    assert other.primal_bound == pytest.approx(solved(tight).primal_bound, rel=1e-5)


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
    """The jerk of a polyline or a parabola is 0, so limits on it are inactive."""
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
def test_rejects_unsupported_problems(changes, words):
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


def test_bad_models_do_not_reach_it():
    with pytest.raises(InvalidData):
        corridor(1, velocity_limit=-1)
