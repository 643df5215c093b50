"""Engine of minimum time: gradient against differences, closed forms, regions, polytopes, laps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crosstrack.models import Trajectory
from crosstrack.solvers.minimum_snap import minco_kernels, minco_limits
from crosstrack.solvers.minimum_snap.minco import Fastest, Region, Rows, fastest, limits_of
from crosstrack.solvers.minimum_snap.minco_limits import Multipliers
from crosstrack.solvers.minimum_snap.minco_task import posed

QUAD = SimpleNamespace(
    mass=0.6, gravity=9.81, drag=0.1, thrust=(2.0, 12.0), tilt=1.0, body_rate=4.0, speed=8.0,
    acceleration=30.0,
)  # fmt: skip
POINTS = np.array([[0.0, 0, 0], [3, 1, 1], [5, 4, 0], [9, 3, 1], [12, 0, 0]])


def trajectory(result: Fastest) -> Trajectory:
    return Trajectory(np.concatenate([[0.0], np.cumsum(result.durations)]), result.coefficients)


def regions(points: np.ndarray) -> list[Region]:
    """Return a fixed start, a disc, a triangle, a free knot and a fixed goal."""
    triangle = points[2] + np.array([[0.0, 0.5, 0.5], [0, -0.5, 0.5], [0, 0, -0.5]])
    return [
        Region.fixed(points[0]),
        Region("ball", points[1], np.array([[0.0, 0.5, 0], [0, 0, 0.5]])),
        Region("hull", np.zeros(3), triangle),
        Region("affine", np.zeros(3), 2.0 * np.eye(3)),
        Region.fixed(points[4]),
    ]


@pytest.mark.parametrize("order", [3, 4])
def test_gradient_agrees_with_differences(order: int) -> None:
    generator = np.random.default_rng(order)
    jets = np.full((5, order, 3), np.inf)
    jets[[0, -1], 1:] = 0.0
    jets[2, 1, 0] = 1.5
    rows = Rows(
        np.array([0, 2, 2]), np.array([0, 1, 3]), generator.standard_normal((3, 3)),
        np.array([0.5, 1.0, 2.0]), np.array([1.0, 2.0, 3.0]),
    )  # fmt: skip
    weights = np.linspace(0.1, 1.0, order)
    task = posed(regions(POINTS), jets, rows, limits_of(QUAD), weights, False, 8)
    start = [region.unknowns(point) for region, point in zip(regions(POINTS), POINTS, strict=True)]
    x = np.concatenate([0.1 * generator.standard_normal(4), *start])
    x[4:] += 0.1 * generator.standard_normal(x.size - 4)
    held = Multipliers(
        0.1 * generator.random((4, 8, 6)),
        0.1 * generator.random((3, 8)),
        np.full(4, 0.3),
        1.0,
        1e-3,
    )
    slope, other = np.zeros(x.size), np.zeros(x.size)
    value = minco_kernels.evaluate(task, held, x, slope)
    step = 1e-6 * np.eye(x.size)
    differences = [
        (
            minco_kernels.evaluate(task, held, x + e, other)
            - minco_kernels.evaluate(task, held, x - e, other)
        )
        / 2e-6
        for e in step
    ]
    assert np.abs(slope).max() > 1.0
    assert np.allclose(slope, differences, rtol=1e-6, atol=1e-6 * np.abs(slope).max())
    # The plain Python version of the kernel.
    assert minco_kernels.evaluate.py_func(task, held, x, other) == pytest.approx(value, rel=1e-12)
    assert np.allclose(slope, other, rtol=1e-9, atol=1e-9)


def test_excesses_agree_with_formulas() -> None:
    generator = np.random.default_rng(0)
    x = generator.standard_normal((4, 3))
    excess = np.zeros(6)
    minco_limits._excess(limits_of(QUAD), x, excess)
    force = QUAD.mass * (x[2] + [0, 0, QUAD.gravity]) + QUAD.drag * x[1]
    rate = QUAD.mass * x[3] + QUAD.drag * x[2]
    size = np.linalg.norm(force)
    axis = force / size
    turn = (rate - axis * (axis @ rate)) / size
    spin = (axis[1] * turn[0] - axis[0] * turn[1]) / (1.0 + axis[2])
    assert excess[0] == pytest.approx(x[1] @ x[1] / 64.0 - 1.0)
    assert excess[2] == pytest.approx((size / 12.0) ** 2 - 1.0)
    assert excess[3] == pytest.approx(1.0 - (size / 2.0) ** 2)
    tilt = np.arccos(axis[2])
    assert np.sign(excess[4]) == np.sign(tilt - QUAD.tilt)
    assert excess[5] == pytest.approx((turn @ turn + spin**2) / 16.0 - 1.0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_straight_line_approaches_the_closed_form(scale: float) -> None:
    """4 m at most 1 m/s and 1 m/s² take 5 s with a jump of the acceleration, the lower bound."""
    vehicle = SimpleNamespace(speed=scale, acceleration=scale)
    times = [
        fastest(scale * np.linspace(0, 4, pieces + 1)[:, None], limits_of(vehicle)).durations.sum()
        for pieces in (1, 8)
    ]
    assert times[0] == pytest.approx(7.5, rel=1e-3)  # peak speed of a quintic: 1.875 times the mean
    assert 5.0 < times[1] < 5.6


def test_limits_and_regions_are_kept() -> None:
    result = fastest(POINTS, limits_of(QUAD), regions=regions(POINTS))
    plan = trajectory(result)
    assert result.excess <= 0.0
    t = np.linspace(0.0, plan.duration, 20_001)
    force = QUAD.mass * (plan(t, 2) + np.array([0, 0, QUAD.gravity])) + QUAD.drag * plan(t, 1)
    size = np.linalg.norm(force, axis=1)
    assert np.linalg.norm(plan(t, 1), axis=1).max() <= QUAD.speed * (1 + 1e-6)
    assert size.min() >= 2.0 * (1 - 1e-6) and size.max() <= 12.0 * (1 + 1e-6)
    assert np.arccos(force[:, 2] / size).max() <= QUAD.tilt * (1 + 1e-6)
    knots = plan(plan.times)
    assert knots[1, 0] == pytest.approx(3.0) and np.linalg.norm(knots[1] - POINTS[1]) <= 0.5 + 1e-9
    assert knots[2, 0] == pytest.approx(5.0)
    fixed = fastest(POINTS, limits_of(QUAD), regions=[Region.fixed(p) for p in POINTS])
    assert result.durations.sum() < fixed.durations.sum()


def test_polytopes_are_kept_between_instants() -> None:
    lower = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0]])
    upper = np.array([[6.0, 2, 2], [6, 6, 2], [10, 6, 2]])
    polytopes = [
        (np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([high, -low]))
        for low, high in zip(lower, upper, strict=True)
    ]
    points = np.array([[1.0, 1, 1], [5, 1, 1], [5, 5, 1], [9, 5, 1]])
    plan = trajectory(fastest(points, limits_of(QUAD), polytopes=polytopes))
    for k in range(3):
        inside = plan(np.linspace(plan.times[k], plan.times[k + 1], 5001)[:-1])
        assert (inside >= lower[k] - 1e-9).all() and (inside <= upper[k] + 1e-9).all()


@pytest.mark.parametrize(("seed", "most"), [(0, 2.1), (31, 1.9)])
def test_a_jerk_along_the_thrust_costs_little_time(seed: int, most: float) -> None:
    """A slower motion with such a jerk turns faster. Stretching alone ended at 2.28 and 1.99 s."""
    ways = np.random.default_rng(seed).standard_normal((2, 3)) * [1.0, 1.0, 0.3]
    turns = np.cumsum([[0.0, 0, 0], *(5.0 * w / np.linalg.norm(w) for w in ways)], axis=0)
    knots = np.arange(9) / 4
    points = np.stack([np.interp(knots, range(3), axis) for axis in turns.T], axis=1)
    free = Region("affine", np.zeros(3), 1.25 * np.eye(3))
    places = [free if k % 4 else Region.fixed(point) for k, point in enumerate(points)]
    vehicle = SimpleNamespace(
        mass=0.61, gravity=9.81, drag=0.0, thrust=(2.0, 12.0), tilt=1.05, body_rate=4.2, speed=8.0
    )
    result = fastest(points, limits_of(vehicle), regions=places, order=2)
    assert result.excess <= 0.0
    assert result.durations.sum() < most


def test_descents_end_if_no_slower_motion_keeps_the_limits() -> None:
    """The lowest thrust exceeds the weight. Descents that left slack took 1405 evaluations instead of 443."""
    ways = 4.0 * np.random.default_rng(0).standard_normal((12, 3))
    points = np.cumsum(np.vstack([np.zeros(3), ways]), axis=0)
    vehicle = SimpleNamespace(
        mass=0.61, gravity=9.81, drag=0.0, thrust=(7.0, 12.0), tilt=1.05, body_rate=4.2, speed=8.0
    )
    result = fastest(points, limits_of(vehicle))
    assert result.excess > 0.0
    assert result.evaluations < 900


def test_lap_is_smooth_at_its_joint() -> None:
    angle = 0.25 * np.pi * np.arange(9)
    points = 5.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    discs = [Region("ball", point, 0.5 * np.eye(3)) for point in points]
    free: Any = np.full((9, 3, 3), np.inf)
    plan = trajectory(fastest(points, limits_of(QUAD), regions=discs, jets=free, periodic=True))
    for j in range(5):
        begin, end = plan.at_ends(j)
        assert np.allclose(begin[0], end[-1], atol=1e-7 * max(1.0, np.abs(begin).max()))


def test_same_seed_gives_the_same_plan() -> None:
    first, second = (fastest(POINTS, limits_of(QUAD), seed=3) for _ in range(2))
    assert np.array_equal(first.coefficients, second.coefficients)
