"""Plans within the limits of vehicles: optimality, proofs of infeasibility, yaw and laps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import NonlinearConstraint, minimize

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances import read_poly7, read_samples, write_poly7, write_samples
from crosstrack.models import (
    DifferentialDrive,
    MinimumDerivative,
    MinimumSnap,
    PointMass,
    Quadrotor,
)
from crosstrack.solvers import Termination

POINTS = np.array([[0, 0, 0], [1, 2, 1], [3, 2, 0.5], [4, 0, 1]], float)
TIMES = np.array([0, 1, 2.5, 4])
LAP = np.array([[0, 0, 1], [2, 0, 1], [2, 2, 1.5], [0, 2, 1], [0, 0, 1]], float)


def sampled_optimum(model: MinimumSnap) -> float:
    """Return the optimum of the model with its limits at 200 instants per segment, by SciPy."""
    plain = MinimumSnap(model.waypoints, model.times).formulate("hermite")
    program = plain.program
    t = np.linspace(model.times[0], model.times[-1], 200 * model.segments + 1)
    s = np.clip(np.searchsorted(model.times, t, "right") - 1, 0, model.segments - 1)
    u = (t - model.times[s]) / model.durations[s]
    zero = plain.decode(np.zeros(program.size))
    base = [zero(t, j) for j in (1, 2, 3)]
    basis = [
        np.stack([plain.decode(e)(t, j) - b for e in np.eye(program.size)])
        for j, b in zip((1, 2, 3), base, strict=True)
    ]
    assert u.min() >= 0
    vehicle = model.vehicle

    def excess(x):
        v, a, j = (b + np.tensordot(x, part, 1) for b, part in zip(base, basis, strict=True))
        if isinstance(vehicle, PointMass):
            return (np.linalg.norm(v, axis=1) - vehicle.speed) / vehicle.speed
        force = vehicle.mass * (a + np.array([0, 0, vehicle.gravity]))
        size = np.linalg.norm(force, axis=1)
        turn = np.linalg.norm(np.cross(force, vehicle.mass * j), axis=1) / size**2
        z, low = force / size[:, None], vehicle.thrust[0]
        dz = vehicle.mass * j / size[:, None]
        dz -= z * (z * dz).sum(axis=1, keepdims=True)
        spin = (z[:, 1] * dz[:, 0] - z[:, 0] * dz[:, 1]) / (1 + z[:, 2])
        parts = [(low - size) / low, (size - vehicle.thrust[1]) / vehicle.thrust[1]]
        if vehicle.body_rate is not None:
            parts.append((np.hypot(turn, spin) - vehicle.body_rate) / vehicle.body_rate)
        if vehicle.tilt is not None:
            parts.append(np.arccos(np.clip(z[:, 2], -1, 1)) - vehicle.tilt)
        return np.concatenate(parts)

    start = np.linalg.solve(program.hessian.toarray(), -program.cost)
    scale = program.objective(start)
    result = minimize(
        lambda x: program.objective(x) / scale, start, method="SLSQP",
        jac=lambda x: (program.hessian @ x + program.cost) / scale,
        constraints=NonlinearConstraint(excess, -np.inf, 0.0),
        options={"maxiter": 60, "ftol": 1e-12},
    )  # fmt: skip
    assert excess(result.x).max() < 1e-5
    return float(result.fun * scale)


@pytest.mark.parametrize(
    ("vehicle", "termination"),
    [
        (PointMass(speed=4.8), Termination.OPTIMAL),
        (Quadrotor(1.0, (2, 15.5), 0.8), Termination.OPTIMAL),
        pytest.param(
            Quadrotor(1.0, (7.6, 16)), Termination.LOCALLY_OPTIMAL, marks=pytest.mark.slow
        ),
        (Quadrotor(1.0, (7.6, 20), body_rate=3.5), Termination.LOCALLY_OPTIMAL),
    ],
)
def test_optimum_equals_that_of_scipy_on_dense_samples(vehicle, termination):
    model = MinimumSnap(POINTS, TIMES, vehicle=vehicle)
    solution = ct.solve(model, "clarabel")
    assert solution.termination is termination
    assert solution.primal_bound > 14160.6  # the path without limits exceeds them
    # Between its samples, the path of SciPy exceeds the limits by up to 3e-4.
    sampled = sampled_optimum(model)
    assert sampled * (1 - 2e-5) <= solution.primal_bound <= sampled * (1 + 1e-3)
    if termination is Termination.OPTIMAL:
        assert solution.dual_bound == pytest.approx(solution.primal_bound, rel=2e-6)
    t = np.linspace(0, 4, 8001)  # 2 kHz
    values = vehicle.quantities(solution.plan, t)
    for name, limit in vehicle.data().items():
        if name in ("speed", "tilt", "body_rate") and limit is not None:
            assert values[name].max() <= limit * (1 + 1e-6)
    if isinstance(vehicle, Quadrotor):
        low, high = vehicle.thrust
        assert values["thrust"].min() >= low * (1 - 1e-6)
        assert values["thrust"].max() <= high * (1 + 1e-6)


@pytest.mark.parametrize("backend", ["clarabel", "scs"])
@pytest.mark.parametrize("vehicle", [PointMass(speed=2.0), Quadrotor(1.0, (9.0, 10.5))])
def test_infeasible_limits_are_proven(vehicle, backend):
    solution = ct.solve(MinimumSnap(POINTS, TIMES, vehicle=vehicle), backend)
    assert solution.termination is Termination.INFEASIBLE


@pytest.mark.parametrize(
    ("vehicle", "points", "largest"),
    [
        (lambda limit: PointMass(speed=limit), [[0.0], [1.0]], 1.5),
        (lambda limit: PointMass(acceleration=limit), [[0.0], [1e-3]], 6e-3),
        (lambda limit: Quadrotor(1.0, (limit, 90.0)), [[0.0, 0, 0], [0, 0, 1]], 9.81 - 6.0),
        (lambda limit: DifferentialDrive(1e4, limit, track=0.3), [[0.0, 0], [1e3, 0]], 6e3),
    ],
)
def test_a_path_without_freedom_is_optimal_or_proven_infeasible(vehicle, points, largest):
    """The only cubic from rest to rest reaches 1.5 times its mean velocity, and 6 times its acceleration."""
    ends = {1e-3: Termination.INFEASIBLE, 0.0: Termination.OPTIMAL, -1e-5: Termination.OPTIMAL}
    for off, termination in ends.items():
        off = -off if largest == 9.81 - 6.0 else off
        model = MinimumDerivative(points, [0, 1], order=2, vehicle=vehicle(largest * (1 - off)))
        assert ct.solve(model).termination is termination, off


def test_limits_that_only_the_linearisation_exceeds_prove_nothing():
    model = MinimumSnap(POINTS[:3], [0, 1, 2], vehicle=Quadrotor(1.0, (0, 90), body_rate=0.05))
    solution = ct.solve(model, "clarabel")
    assert solution.termination is Termination.NO_SOLUTION and solution.dual_bound is None


def test_a_linearisation_that_has_not_converged_is_feasible(monkeypatch):
    model = MinimumSnap(POINTS, TIMES, vehicle=Quadrotor(1.0, (0, 90), body_rate=3.0))
    monkeypatch.setattr("crosstrack.models.minimum_snap.formulations.vehicles.STEPS", 3)
    early = ct.solve(model, "clarabel")
    assert early.termination is Termination.FEASIBLE and "not converged" in early.message
    assert early.verified and early.dual_bound is None


def test_conic_solvers_agree():
    model = MinimumSnap(POINTS, TIMES, vehicle=PointMass(speed=5.0, acceleration=9.9))
    bounds = [ct.solve(model, name).primal_bound for name in ("clarabel", "scs")]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-5)


@pytest.mark.parametrize("scale", [1e-3, 1e6])
def test_limits_scale_with_lengths(scale):
    vehicle = PointMass(4.8 * scale)
    solution = ct.solve(MinimumSnap(POINTS * scale, TIMES, vehicle=vehicle))
    assert solution.termination is Termination.OPTIMAL
    assert solution.primal_bound / scale**2 == pytest.approx(15350.79, rel=1e-5)


def test_other_formulations_refuse_vehicles():
    model = MinimumSnap(POINTS, TIMES, vehicle=PointMass(5.0))
    for name in ("paper", "monomial", "hermite", "legendre"):
        with pytest.raises(UnsupportedFormulation, match="cones"):
            model.formulate(name)
    with pytest.raises(UnsupportedFormulation, match="no vehicle"):
        MinimumSnap(POINTS, TIMES).formulate("cones")
    for backend in ("banded", "interior-point"):
        with pytest.raises(UnsupportedFormulation, match="cones"):
            ct.solve(model, backend)


def test_wheels_are_within_their_limits():
    vehicle = DifferentialDrive(4.38, 8.46, 0.5)  # without limits: 4.435 m/s and 8.471 m/s²
    solution = ct.solve(MinimumSnap(POINTS[:3, :2], TIMES[:3], vehicle=vehicle), "clarabel")
    assert solution.termination is Termination.LOCALLY_OPTIMAL
    values = vehicle.quantities(solution.plan, np.linspace(0, 2.5, 5001))
    assert np.abs(values["wheel_speeds"]).max() <= 4.38 * (1 + 1e-6)
    assert np.abs(values["wheel_accelerations"]).max() <= 8.46 * (1 + 1e-6)


def test_a_robot_on_a_line_keeps_its_wheels_equal():
    line = np.outer([0.0, 1, 2, 3], [1, 0])
    vehicle = DifferentialDrive(1.1, None, 0.5)
    solution = ct.solve(MinimumSnap(line, [0, 1.5, 2.5, 4], vehicle=vehicle))
    assert solution.termination in (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL)
    left, right = vehicle.quantities(solution.plan, np.linspace(0, 4, 101))["wheel_speeds"].T
    assert np.allclose(left, right, atol=1e-6) and left.max() <= 1.1 * (1 + 1e-6)


# -- laps and yaw ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "limits",
    [
        {},
        {"velocity_limit": 2.4},
        {"vehicle": Quadrotor(1.0, (2, 25), speed=2.2)},
        {"vehicle": Quadrotor(1.0, (2, 25), body_rate=1.5)},
    ],
)
def test_laps_close_in_the_derivatives_up_to_four(limits):
    solution = ct.solve(MinimumSnap(LAP, np.arange(5.0), periodic=True, **limits))
    assert solution.termination in (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL)
    assert solution.primal_bound >= 597.57
    plan = solution.plan
    for order in range(5 if limits else 7):
        begin, end = plan(0.0, order), plan(4.0, order)
        assert np.abs(begin - end).max() <= 1e-6 * max(1.0, np.abs(begin).max())
    assert np.abs(plan(0.0, 1)).max() > 1  # the lap does not stop at its joint


def test_a_lap_costs_the_same_from_any_knot():
    moved = np.concatenate([LAP[2:4], LAP[:3]])
    bounds = [
        ct.solve(MinimumSnap(points, times, periodic=True)).primal_bound
        for points, times in ((LAP, [0, 1, 3, 4, 5.5]), (moved, [0, 1, 2.5, 3.5, 5.5]))
    ]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-9)


def test_verification_finds_an_open_joint():
    model = MinimumSnap(LAP, np.arange(5.0), periodic=True)
    still = ct.solve(MinimumSnap(LAP, np.arange(5.0))).plan  # from rest to rest
    names = [check.name for check in model.verify(still).violated]
    assert names == ["snap at the joint of the lap"]


def test_yaw_has_the_least_acceleration_by_the_shortest_turns():
    model = MinimumSnap(POINTS, TIMES, yaw=[0, None, 3, -3])
    plan = ct.solve(model).plan
    curve = plan.yaw
    assert curve(4.0)[0] == pytest.approx(2 * np.pi - 3) and curve(2.5)[0] == pytest.approx(3)
    assert [curve(t, 1)[0] for t in (0.0, 4.0)] == pytest.approx([0, 0], abs=1e-12)
    # The interpolating cubic spline has the least acceleration; a free angle is no knot of it.
    spline = CubicSpline(TIMES[[0, 2, 3]], [0, 3, 2 * np.pi - 3], bc_type="clamped")
    t = np.linspace(0, 4, 50)
    assert np.allclose(curve(t)[:, 0], spline(t), atol=1e-9)
    assert type(plan).from_data(plan.to_data()) == plan
    checks = {check.name for check in model.verify(plan).checks}
    assert {"yaw at knots", "continuity of yaw", "continuity of yaw rate"} <= checks
    bare = type(plan)(plan.times, plan.coefficients)
    assert [check.name for check in model.verify(bare).violated] == ["plan has a yaw"]
    other = MinimumSnap(POINTS, TIMES, yaw=[0, None, 3, 3]).with_yaw(bare)
    assert [(c.name, c.where) for c in model.verify(other).violated] == [
        ("yaw at knots", "knot 3 (t = 4 s)")
    ]


def test_yaw_of_a_lap_may_turn_once():
    model = MinimumSnap(LAP, np.arange(5.0), periodic=True, yaw=[0, 1.5, 3, 4.5, None])
    curve = model.with_yaw(ct.solve(MinimumSnap(LAP, np.arange(5.0), periodic=True)).plan).yaw
    angles = np.array([0, 1.5, 3, 4.5, 2 * np.pi])
    ramp = angles[-1] * np.arange(5) / 4
    spline = CubicSpline(np.arange(5.0), angles - ramp, bc_type="periodic")
    t = np.linspace(0, 4, 50)
    assert np.allclose(curve(t)[:, 0], spline(t) + angles[-1] * t / 4, atol=1e-9)


def test_yaw_rate_limits_are_verified():
    vehicle = Quadrotor(1.0, (0, 40), yaw_rate=1.0)
    for yaw, ok in (([0, 0.1, 0.2, 0.3], True), ([0, 2, 0, 2], False), (0.4, True)):
        model = MinimumSnap(POINTS, TIMES, vehicle=vehicle, yaw=yaw)
        plan = model.with_yaw(ct.solve(MinimumSnap(POINTS, TIMES)).plan)
        checks = {check.name: check.ok for check in model.verify(plan).checks}
        assert checks["yaw rate limit"] == ok


def test_a_tangent_yaw_is_slowed_down_within_its_rate():
    vehicle = Quadrotor(1.0, (2, 25), yaw_rate=1.572)
    model = MinimumSnap(LAP, np.arange(5.0), periodic=True, yaw="tangent", vehicle=vehicle)
    solution = ct.solve(model, "clarabel")
    assert solution.termination is Termination.LOCALLY_OPTIMAL
    rate = vehicle.quantities(solution.plan, np.linspace(0, 4, 4001), "tangent")["yaw_rate"]
    assert np.abs(rate).max() <= 1.572 * (1 + 1e-6)


def test_exports_keep_the_yaw_of_a_plan(tmp_path):
    vehicle = Quadrotor(1.0, (0, 40))
    plan = ct.solve(MinimumSnap(POINTS, TIMES, vehicle=vehicle, yaw=[0.5, None, 1, 2])).plan
    t = np.linspace(0, 4, 7)
    write_poly7(plan, tmp_path / "p.csv", precision="float64")
    assert np.allclose(read_poly7(tmp_path / "p.csv")(t)[:, 3], plan.yaw(t)[:, 0], atol=1e-9)
    write_poly7(plan, tmp_path / "p.csv", yaw=0.25)
    assert (read_poly7(tmp_path / "p.csv")(t)[:, 3] == 0.25).all()
    samples = read_samples(write_samples(plan, tmp_path / "s.csv", derivatives=1))
    assert samples.values.shape[2] == 4
    for order in (0, 1):
        expected = plan.yaw(samples.times, order)
        assert np.allclose(samples.values[order, :, 3:], expected, atol=1e-12)
    flat = ct.solve(MinimumSnap(POINTS[:, :2], TIMES, yaw=0.5)).plan
    with pytest.raises(InvalidData, match="3 axes"):
        write_samples(flat, tmp_path / "s.csv")
