"""Gates: their data, exact distances, fixed times by cones, minimum time, and wild cases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import (
    DifferentialDrive,
    Gate,
    MinimumDerivative,
    PointMass,
    Quadrotor,
    TimeAllocation,
)

FREE3 = [None, None, None]
SQUARE = [[6.0, -1, 0], [6, -1, 1], [6, 0, 1], [6, 0, 0]]
DISC = Gate(1, centre=[3, 1, 1], radius=0.5, normal=[2, 0, 0])
BALL = Gate(3, centre=[9, 1, 0], radius=0.5)
GATES = (DISC, Gate(2, polygon=SQUARE), BALL)
TRACK: list[Any] = [[0, 0, 0], FREE3, FREE3, FREE3, [12, 0, 0]]
QUAD = Quadrotor(mass=0.6, thrust=(2.0, 12.0), tilt=1.0, body_rate=4.0, speed=8.0)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"knot": 1}, "either radius or polygon"),
        ({"knot": 1, "centre": [0, 0, 0], "radius": 1.0, "polygon": SQUARE}, "either"),
        ({"knot": 1, "radius": 1.0}, "centre is missing"),
        ({"knot": 1, "centre": [0, 0, 0], "radius": 1.0, "normal": [0, 0, 0]}, "normal"),
        ({"knot": 1, "centre": [0, 0, 0], "radius": 0.0}, "radius"),
        ({"knot": -1, "centre": [0, 0, 0], "radius": 1.0}, "knot"),
        ({"knot": 1, "polygon": [[0, 0, 0], [0, 0, 0]]}, "polygon"),
        ({"knot": 1, "polygon": [[0, 0, 0], [1, 0, 0], [2, 0, 0]]}, "polygon"),
        ({"knot": 1, "polygon": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "polygon"),
        ({"knot": 1, "polygon": [[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]]}, "convex"),
    ],
)
def test_rejects_gates_without_a_shape(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidData, match=words):
        Gate(**fields)


@pytest.mark.parametrize(
    ("gates", "words"),
    [
        ([Gate(9, centre=[0, 0, 0], radius=1.0)], "knot must be < 5"),
        ([Gate(1, centre=[0, 0], radius=1.0)], "3 axes"),
        ([Gate(0, centre=[0, 0, 0], radius=1.0)], "must be free"),
        ([DISC, Gate(1, polygon=SQUARE)], "another gate"),
    ],
)
def test_rejects_gates_that_do_not_fit_the_knots(gates: list[Gate], words: str) -> None:
    with pytest.raises(InvalidData, match=words):
        MinimumDerivative(TRACK, range(5), gates=gates)


def test_distances_are_exact() -> None:
    assert DISC.excess(np.array([3.2, 1.0, 2.0])) == pytest.approx([0.2, 0.5])
    assert BALL.excess(np.array([9.0, 1.0, 2.0])) == pytest.approx([0.0, 1.5])
    for vertices in (SQUARE, SQUARE[::-1]):
        gate = Gate(0, polygon=vertices)
        assert gate.excess(np.array([6.5, -0.5, 0.5])) == pytest.approx([0.5, -0.5])
        # The nearest point is the vertex (6, 0, 1).
        assert gate.excess(np.array([6.0, 3.0, 5.0])) == pytest.approx([0.0, 5.0])
    line = Gate(0, polygon=[[0.0, -1], [0, 1]])
    assert line.excess(np.array([0.5, 1.25])) == pytest.approx([0.5, 0.25])


def test_json_keeps_gates_and_old_digests() -> None:
    plain = MinimumDerivative([[0, 0], [1, 2], [3, 2]], [0, 1, 2])
    assert "gates" not in plain.to_dict()["data"]
    for model in (
        MinimumDerivative(TRACK, range(5), gates=GATES),
        TimeAllocation(TRACK, gates=GATES, vehicle=QUAD, minimise="time"),
    ):
        again = type(model).from_json(model.to_json())
        assert again == model and again.gates[1].polygon is not None
        assert model.digest != type(model).from_data({**model.data(), "gates": []}).digest


def test_fixed_times_agree_with_a_search_for_the_passing_points() -> None:
    times = np.arange(5.0)
    solution = ct.solve(MinimumDerivative(TRACK, times, order=3, gates=GATES), "clarabel")
    assert solution.termination == "optimal" and solution.verification.ok

    def cost(z: np.ndarray) -> float:
        points = np.array([[0, 0, 0], [3, *z[:2]], [6, *z[2:4]], z[4:], [12, 0, 0]])
        return ct.solve(MinimumDerivative(points, times, order=3), "banded").primal_bound / 1e3

    inside = [
        {"type": "ineq", "fun": lambda z: 0.25 - ((z[:2] - [1, 1]) ** 2).sum()},
        {"type": "ineq", "fun": lambda z: 0.25 - ((z[4:] - [9, 1, 0]) ** 2).sum()},
    ]
    box = [(None, None)] * 2 + [(-1, 0), (0, 1)] + [(None, None)] * 3
    begin = np.array([1, 1, -0.5, 0.5, 9, 1, 0])
    best = minimize(cost, begin, bounds=box, constraints=inside, options={"ftol": 1e-11})
    assert solution.primal_bound / 1e3 == pytest.approx(best.fun, rel=1e-6)


def test_a_violated_gate_is_named() -> None:
    model = MinimumDerivative(TRACK, range(5), order=3, gates=GATES)
    points = [[0, 0, 0], [3.1, 1, 1], [6, 0.5, 0.5], [9, 1, 0], [12, 0, 0]]
    other = ct.solve(MinimumDerivative(points, range(5), order=3), "banded").plan
    checks = {check.name: check for check in model.verify(other).violated}
    assert checks["plane of the gate"].worst == pytest.approx(0.1)
    assert "knot 1" in checks["plane of the gate"].where
    assert checks["inside of the gate"].worst == pytest.approx(0.5)
    assert "knot 2" in checks["inside of the gate"].where


@pytest.mark.parametrize("order", [3, 4])
def test_minimum_time_beats_the_weighted_sum(order: int) -> None:
    model = TimeAllocation(TRACK, order=order, gates=GATES, vehicle=QUAD, minimise="time")
    solution = ct.solve(model)
    assert solution.backend == "minco" and solution.verification.ok
    assert all(
        check.worst == 0.0 for check in solution.verification.checks if "limit" in check.name
    )
    assert solution.primal_bound == solution.plan.duration
    weighted = TimeAllocation(TRACK, order=order, gates=GATES, vehicle=QUAD, time_weight=1000.0)
    assert ct.solve(weighted).plan.duration >= 0.999 * solution.plan.duration
    # The straight way at the largest speed is a lower bound.
    assert solution.plan.duration > 12.0 / 8.0


def test_more_knots_give_shorter_times() -> None:
    """From rest to rest over 4 m at most 1 m/s and 1 m/s² takes at least 5 s."""
    bounds: dict[str, Any] = {"velocity_limit": 1.0, "acceleration_limit": 1.0}
    vehicle: dict[str, Any] = {"vehicle": PointMass(1.0, 1.0)}
    for limits, free, hint in ((vehicle, 0, True), (vehicle, 3, False), (bounds, 3, False)):
        points = [[0.0], *[[None]] * free, [4.0]]
        solution = ct.solve(TimeAllocation(points, order=3, minimise="time", **limits))
        assert ("more free knots" in solution.message) is hint
    times = [
        ct.solve(
            TimeAllocation([[0.0], *[[None]] * free, [4.0]], order=3, minimise="time", **bounds)
        ).plan.duration
        for free in (0, 7)
    ]
    assert times[0] == pytest.approx(7.5, rel=1e-3) and 5.0 < times[1] < 5.8


@pytest.mark.parametrize("scale", [1e-3, 1e6])
def test_scales_do_not_matter(scale: float) -> None:
    def model(size: float) -> TimeAllocation:
        gates = [
            Gate(1, centre=[3 * size, size], radius=0.5 * size),
            Gate(2, polygon=[[6 * size, -size], [6 * size, 0.0]]),
        ]
        vehicle = PointMass(speed=4 * size, acceleration=5 * size)
        points = [[0, 0], [None, None], [None, None], [9 * size, 0]]
        return TimeAllocation(points, order=3, gates=gates, vehicle=vehicle, minimise="time")

    usual, other = (ct.solve(model(size)) for size in (1.0, scale))
    assert other.verification.ok
    assert other.plan.duration == pytest.approx(usual.plan.duration, rel=0.01)


@pytest.mark.parametrize(("order", "speed"), [(2, None), (3, None), (4, None), (4, 4.0)])
def test_fixed_times_have_one_optimum_in_all_units(order: int, speed: float | None) -> None:
    """Conic solvers with absolute tolerances called paths of 47 times the optimal cost optimal."""

    def cost(size: float, second: float) -> float:
        gates = [
            Gate(1, centre=[size, 2 * size], radius=0.3 * size),
            Gate(2, polygon=[[2.8 * size, 2 * size], [3.2 * size, 2.3 * size]]),
        ]
        points = [[0, 0], [None, None], [None, None], [4 * size, 0]]
        times = np.array([0, 1, 2.5, 3.5]) * second
        vehicle = None if speed is None else PointMass(speed * size / second)
        model = MinimumDerivative(points, times, order=order, gates=gates, vehicle=vehicle)
        solution = ct.solve(model)
        assert solution.termination == "optimal" and solution.gap < 1e-5
        return solution.primal_bound * second ** (2 * order - 1) / size**2

    usual = cost(1.0, 1.0)
    for size, second in ((1e-6, 1e2), (1e-3, 1e2), (1.0, 1e-2), (1e3, 1.0), (1e6, 1.0), (1e6, 1e2)):
        assert cost(size, second) == pytest.approx(usual, rel=1e-5)


def test_gate_at_the_start_and_at_the_end() -> None:
    gates = [Gate(0, centre=[0, 0], radius=1.0), Gate(2, polygon=[[4, -1], [4, 1]])]
    model = TimeAllocation(
        [[None, None], [2, 3], [None, None]], order=3, gates=gates,
        vehicle=PointMass(speed=2.0, acceleration=2.0), minimise="time",
    )  # fmt: skip
    plan = ct.solve(model).plan
    assert gates[0].excess(plan(0.0))[1] == pytest.approx(0.0, abs=1e-3)  # the near edge
    assert model.verify(plan).ok


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize(
    "fields",
    [
        {"corridor_upper": [4.0, 4.0]},
        {"corridor_upper": [4.45, 9.0]},
        {"polytope_segments": [0, 1], "polytope_normals": [[1, 0], [1, 0]], "polytope_offsets": [4, 4]},
        {"velocity_limit": 2.0},
        {"vehicle": PointMass(speed=2.0)},
        {"vehicle": PointMass(acceleration=2.0)},
    ],
)  # fmt: skip
def test_impossible_gates_are_proven_at_fixed_times(fields: dict[str, Any], order: int) -> None:
    gates = [Gate(1, centre=[5, 5], radius=0.5)]
    model = MinimumDerivative(
        [[0, 0], [None, None], [3, 0]], [0, 1, 2], order=order, gates=gates, **fields
    )
    assert ct.solve(model).termination == "infeasible"


def test_impossible_gates_have_no_plan_of_minimum_time() -> None:
    fields: dict[str, Any] = {
        "gates": [Gate(1, centre=[5, 5], radius=0.5)],
        "corridor_upper": [4.0, 4.0],
    }
    points = [[0, 0], [None, None], [3, 0]]
    free = ct.solve(
        TimeAllocation(points, order=3, vehicle=PointMass(speed=1.0), minimise="time", **fields)
    )
    assert free.plan is None and "no proof" in free.message


def test_segments_without_length_and_gates_that_overlap() -> None:
    vehicle = PointMass(speed=1.0, acceleration=1.0)
    with pytest.raises(InvalidData, match="repeats"):
        TimeAllocation([[0, 0], [0, 0], [1, 0]], vehicle=vehicle, minimise="time")
    gates = [Gate(1, centre=[1, 0], radius=0.5), Gate(2, centre=[1, 0], radius=0.5)]
    model = TimeAllocation(
        [[0, 0], [None, None], [None, None], [2, 0]], order=3, gates=gates, vehicle=vehicle,
        minimise="time",
    )  # fmt: skip
    solution = ct.solve(model)
    assert solution.verification.ok and solution.plan.duration > 2.0


@pytest.mark.parametrize(
    ("points", "gates"),
    [
        ([[0, 0], [None, None]], []),
        ([[None, 1], [2, None]], []),
        ([[0, 0], [None, None]], [Gate(1, centre=[0.5, 0], radius=1.0)]),
        ([[None, None]] * 2, [Gate(k, centre=[0, 0.5 * k], radius=1.0) for k in (0, 1)]),
    ],
)
def test_minimum_time_needs_a_motion(points: list[Any], gates: list[Gate]) -> None:
    fields: dict[str, Any] = {"vehicle": PointMass(1.0, 1.0), "minimise": "time"}
    with pytest.raises(InvalidData, match="path at rest at"):
        TimeAllocation(points, gates=gates, **fields)
    moving = TimeAllocation(points, gates=gates, **fields, start=[[0.5, 0]])
    assert ct.solve(moving).verification.ok


@pytest.mark.parametrize(
    "fields", [{}, {"vehicle": PointMass()}, {"vehicle": QUAD, "time_weight": 1.0},
               {"vehicle": QUAD, "total_time": 1.0}]
)  # fmt: skip
def test_minimum_time_needs_limits_and_nothing_else(fields: dict[str, Any]) -> None:
    with pytest.raises(InvalidData, match="minimise"):
        TimeAllocation([[0, 0, 0], [1, 0, 0]], minimise="time", **fields)


def test_wheels_keep_their_limits_by_stretching() -> None:
    robot = DifferentialDrive(wheel_speed=1.0, wheel_acceleration=1.0, track=0.4)
    gates = [Gate(1, centre=[2, 1], radius=0.3), Gate(2, centre=[4, -1], radius=0.3)]
    model = TimeAllocation(
        [[0, 0], [None, None], [None, None], [6, 0]], order=3, gates=gates, vehicle=robot,
        minimise="time",
    )  # fmt: skip
    solution = ct.solve(model)
    assert solution.verification.ok and solution.plan.duration > 6.0


def test_a_robot_that_must_turn_at_a_knot_has_no_plan() -> None:
    robot = DifferentialDrive(wheel_speed=1.0, wheel_acceleration=1.0, track=0.4)
    there_and_back = [[0, 0], [2, 0], [0, 0]]
    for fields in ({"minimise": "time"}, {"time_weight": 10.0}):
        solution = ct.solve(TimeAllocation(there_and_back, order=3, vehicle=robot, **fields))
        assert solution.termination == "no_solution"
        assert "continuity of heading violated" in solution.message
    solution = ct.solve(MinimumDerivative(there_and_back, [0, 10, 20], vehicle=robot))
    assert solution.termination == "no_solution" and "heading" in solution.message


def test_the_end_of_a_lap_may_be_a_gate_around_its_start() -> None:
    model = TimeAllocation(
        [[0, 0], [2, 0], [2, 2], [None, None]], order=3, periodic=True, minimise="time",
        gates=[Gate(3, centre=[0.3, 0], radius=0.5)], vehicle=PointMass(1.0, 1.0),
    )  # fmt: skip
    solution = ct.solve(model)
    assert solution.verification.ok and np.allclose(solution.plan(solution.plan.duration), 0.0)


def test_other_backends_refuse_gates() -> None:
    model = MinimumDerivative(TRACK, range(5), gates=GATES)
    for name in ("banded", "interior-point"):
        with pytest.raises(ct.errors.UnsupportedFormulation, match="gates"):
            ct.solve(model, name)
    allocation = TimeAllocation(TRACK, gates=GATES, time_weight=1.0)
    with pytest.raises(ct.errors.UnsupportedFormulation, match="gates"):
        ct.solve(allocation, "time-gradient")
    total = TimeAllocation(TRACK, gates=GATES, total_time=4.0)
    for backend in ("minco", "time-gradient", "ipopt"):
        with pytest.raises(ct.errors.UnsupportedFormulation, match="total_time = 4 s"):
            ct.solve(total, backend)
    with pytest.raises(ct.errors.UnsupportedFormulation, match="total_time = 4 s"):
        ct.solve(total)


def test_pictures_show_the_gates() -> None:
    pytest.importorskip("matplotlib", reason="pictures need Matplotlib")
    flat = TimeAllocation(
        [[0, 0], [None, None], [None, None], [6, 0]], order=3, minimise="time",
        gates=[Gate(1, centre=[2, 1], radius=0.4, normal=[1, 0]), Gate(2, centre=[4, -1], radius=0.4)],
        vehicle=PointMass(speed=2.0, acceleration=2.0),
    )  # fmt: skip
    space = MinimumDerivative(TRACK, range(5), gates=GATES)
    for model, lines in ((flat, 2), (space, 5)):
        axes = ct.plot(model).axes[0]
        assert sum(line.get_gid() == "gate" for line in axes.lines) == lines


def test_gates_without_limits_satisfy_the_identity() -> None:
    """ρ ΣT = (2r - 1) J at every optimum without limits, in all scales of the price."""
    for price in (1e-3, 1.0, 1e4):
        model = TimeAllocation(TRACK, order=3, gates=GATES, time_weight=price)
        solution = ct.solve(model)
        assert solution.backend == "minco" and solution.verification.ok
        assert model.identity_residual(solution.plan) < 0.05


def test_a_warm_start_is_never_made_worse() -> None:
    model = TimeAllocation(TRACK, order=3, gates=GATES, vehicle=QUAD, minimise="time")
    first = ct.solve(model)
    again = ct.solve(model, warm_start=first.plan)
    assert again.verification.ok and again.plan.duration <= first.plan.duration
    short = ct.solve(model, "minco", warm_start=first.plan, backend_options={"steps": 1})
    assert short.plan.duration <= first.plan.duration
