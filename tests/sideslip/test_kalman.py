"""Kalman filter and smoother: comparison with least squares, and claimed deviations."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from sideslip.filters import (
    BOTH,
    GRIPPING,
    TRUE,
    VEHICLE,
    answer,
    drawn,
    filtered,
    plan,
    simulated,
)

import crosstrack as ct
from crosstrack.instances.sideslip.generator import generate
from crosstrack.models.sideslip import Recording, SideslipEstimate, SideslipEstimation, Vehicle
from crosstrack.models.sideslip.checks import stuck_samples, without_faults
from crosstrack.models.sideslip.dynamics import linearise
from crosstrack.solvers.contract.backend import Request, Termination
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.contract.selection import recommended
from crosstrack.solvers.sideslip import kalman_kernels, mismatch as mismatches, passes
from crosstrack.solvers.sideslip.kalman import KalmanFilter, RtsSmoother, claim
from crosstrack.solvers.sideslip.mismatch import mismatch
from crosstrack.solvers.sideslip.passes import smooth_drive

Floats = NDArray[np.float64]

both = pytest.mark.parametrize("backend", BOTH, ids=lambda one: one.name)


def batch(problem: SideslipEstimation, model: Any, last: int) -> tuple[Floats, Floats]:
    """Return the states up to `last` and their covariance by batch least squares."""
    n = last + 1
    rows: list[Floats] = []
    values: list[float] = []

    def add(blocks: dict[int, Floats], value: Floats, deviation: Floats) -> None:
        for i in range(2):
            row = np.zeros(2 * n)
            for k, block in blocks.items():
                row[2 * k : 2 * k + 2] = block[i]
            rows.append(row / deviation[i])
            values.append(float(value[i] / deviation[i]))

    add({0: np.eye(2)}, problem.initial, problem.initial_deviation)
    drive = problem.recording
    for k in range(n):
        if drive.speed[k] >= 1.0:
            data = np.array([drive.yaw_rate[k], drive.lateral_acceleration[k]])
            noise = np.array([problem.yaw_rate_noise, problem.acceleration_noise])
            add({k: model.slope[k]}, data - model.level[k], noise)
        if k + 1 < n:
            root = np.sqrt(drive.times[k + 1] - drive.times[k])
            blocks = {k + 1: np.eye(2), k: -model.step[k]}
            add(blocks, model.shift[k], problem.disturbance * root)
    whole = np.array(rows)
    # Scale columns to length 1, because rows differ in size.
    size = np.linalg.norm(whole, axis=0)
    found, *_ = np.linalg.lstsq(whole / size, np.array(values), rcond=None)
    inverse = np.linalg.pinv(whole / size)
    return (found / size).reshape(n, 2), (inverse @ inverse.T) / size / size[:, None]


# Comparison with least squares


@pytest.mark.parametrize("vehicle", [VEHICLE, GRIPPING], ids=["linear", "saturating"])
@pytest.mark.parametrize("seed", range(6))
def test_filter_and_smoother_are_least_squares(seed: int, vehicle: Vehicle) -> None:
    """Linear tyres, and saturating tyres with the linearisation of the filter."""
    problem = drawn(seed, vehicle, initial=(0.01, -0.1))
    found = filtered(problem)
    n = len(problem.recording)
    for last in (0, 1, n // 2, n - 1):
        states, covariance = batch(problem, found.model, last)
        np.testing.assert_allclose(found.filtered[last], states[-1], atol=1e-9)
        np.testing.assert_allclose(
            found.filtered_covariance[last], covariance[-2:, -2:], rtol=1e-6, atol=1e-12
        )
    smoothed, smoothed_covariance = smooth_drive(problem, found)
    np.testing.assert_allclose(smoothed, states, atol=1e-9)
    blocks = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(n)])
    np.testing.assert_allclose(smoothed_covariance, blocks, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(
    "more",
    [
        {"initial_deviation": (1e3, 1e3)},
        {"initial_deviation": (1e-6, 1e-6)},
        {"disturbance": (2e-6, 2.0)},
        {"disturbance": (0.5, 1e-6)},
        {"yaw_rate_noise": 1e-6},
        {"acceleration_noise": 1e-4},
        {"yaw_rate_noise": 10.0, "acceleration_noise": 1e3},
    ],
    ids=str,
)
def test_noises_of_all_sizes(more: dict[str, Any]) -> None:
    problem = drawn(7, **more)
    found = filtered(problem)
    states, covariance = batch(problem, found.model, 29)
    smoothed, smoothed_covariance = smooth_drive(problem, found)
    deviation = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    assert (np.abs(smoothed - states) < 1e-5 * deviation + 1e-10).all()
    own = np.sqrt(np.diagonal(smoothed_covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(own, deviation, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("disturbance", [(1e-9, 1e-9), (1e-9, 0.01), (0.002, 1e-9)], ids=str)
def test_hardly_a_disturbance(disturbance: tuple[float, float]) -> None:
    """The predicted covariance is nearly singular. A slightly larger disturbance gives nearly the same."""
    problem = drawn(3, disturbance=disturbance)
    nearly = drawn(3, disturbance=np.maximum(disturbance, 1e-7))
    states, covariance = smooth_drive(problem, filtered(problem))
    near_states, near_covariance = smooth_drive(nearly, filtered(nearly))
    np.testing.assert_allclose(states, near_states, atol=1e-5)
    np.testing.assert_allclose(covariance, near_covariance, atol=1e-7)
    assert (np.diagonal(covariance, axis1=1, axis2=2) >= 0).all()


def test_linear_model_is_that_of_the_dynamics() -> None:
    problem = drawn(0)
    for mine, other in zip(
        filtered(problem).model, linearise(problem, np.zeros((30, 2))), strict=True
    ):
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("vehicle", [VEHICLE, GRIPPING], ids=["linear", "saturating"])
def test_innovations_and_order(vehicle: Vehicle) -> None:
    problem = drawn(1, vehicle)
    found, drive = filtered(problem), problem.recording
    data = np.column_stack([drive.yaw_rate, drive.lateral_acceleration])
    shown = np.einsum("kij,kj->ki", found.model.slope, found.predicted) + found.model.level
    np.testing.assert_allclose(found.innovations, data - shown, atol=1e-12)
    slope, noise = found.model.slope, np.diag([0.002**2, 0.05**2])
    spread = slope @ found.predicted_covariance @ slope.transpose(0, 2, 1) + noise
    np.testing.assert_allclose(found.innovation_covariance, spread, rtol=1e-9)
    still = ~drive.moving
    assert still.any()
    np.testing.assert_array_equal(found.filtered[still], found.predicted[still])
    # More samples never increase the covariance. At the last sample both are equal.
    smoothed, smoothed_covariance = smooth_drive(problem, found)
    for less, more in (
        (found.predicted_covariance, found.filtered_covariance),
        (found.filtered_covariance, smoothed_covariance),
    ):
        lost = np.linalg.eigvalsh(less - more)
        assert (lost >= -1e-9 * np.abs(less).max(axis=(1, 2))[:, None]).all()
    np.testing.assert_array_equal(smoothed[-1], found.filtered[-1])


# Claimed deviations


def test_claims_hold_where_the_model_does() -> None:
    """On 200 drives of the model the share within 2 deviations and the innovations are as expected."""
    within: dict[str, list[float]] = {"filter": [], "smoother": [], "covariance": []}
    squares, surprises = [], []
    for seed in range(200):
        problem = simulated(seed)
        found = filtered(problem)
        smoothed, smoothed_covariance = smooth_drive(problem, found)
        angles, variances = found.filtered[:, 0], found.filtered_covariance[:, 0, 0]
        claims = {
            "covariance": SideslipEstimate(angles, np.sqrt(variances)),
            "filter": claim(problem, found, angles, variances),
            "smoother": claim(
                problem, found, smoothed[:, 0], smoothed_covariance[:, 0, 0], ahead=True
            ),
        }
        for name, one in claims.items():
            estimate = SideslipEstimate(one.sideslip, one.deviation)
            within[name].append(problem.coverage(estimate))
        x = TRUE[seed] - found.filtered
        solved = np.linalg.solve(found.filtered_covariance, x[..., None])[..., 0]
        squares.append(float((x * solved).sum(axis=1).mean()))
        solved = np.linalg.solve(found.innovation_covariance, found.innovations[..., None])[..., 0]
        surprises.append(float((found.innovations * solved).sum(axis=1).mean()))
    # Errors are correlated over about 0.1 s, so 200 drives of 3 s have about 6000 independent ones.
    assert np.mean(within["covariance"]) == pytest.approx(0.9545, abs=0.012)
    assert np.mean(squares) == pytest.approx(2.0, abs=0.1)
    assert np.mean(surprises) == pytest.approx(2.0, abs=0.04)
    assert 0.945 < np.mean(within["filter"]) < 0.985
    assert 0.945 < np.mean(within["smoother"]) < 0.985


@both
def test_an_unstable_vehicle_begins_anew(backend: type[Any]) -> None:
    """Without grip at the rear the state is unknown after 2 s at 100 m/s. The filter recovers."""
    n = 40
    rng = np.random.default_rng(0)
    vehicle = dataclasses.replace(VEHICLE, cornering_rear=1.0, cornering_front=1e8)
    recording = Recording(
        2.0 * np.arange(n),
        np.full(n, 100.0),
        0.01 * rng.normal(size=n),
        0.1 * rng.normal(size=n),
        rng.normal(size=n),
    )
    problem = SideslipEstimation(vehicle, recording)
    found = filtered(problem)
    assert found.lost > 0
    assert np.isfinite(found.filtered).all() and np.isfinite(found.filtered_covariance).all()
    assert answer(problem, backend).statistics["restarts"] == found.lost
    plan(problem, backend)


@both
def test_any_time_of_day_and_few_samples(backend: type[Any]) -> None:
    problem = drawn(5, n=10)
    later = dataclasses.replace(
        problem,
        recording=dataclasses.replace(problem.recording, times=problem.recording.times + 1e5),
    )
    one, two = plan(problem, backend), plan(later, backend)
    np.testing.assert_allclose(one.sideslip, two.sideslip, atol=1e-7)
    np.testing.assert_allclose(one.deviation, two.deviation, rtol=1e-5)


@both
def test_a_run_that_is_stopped_has_no_answer(backend: type[Any]) -> None:
    control = Control()
    control.flag[0] = 1
    found = backend().run(drawn(0), Request(control=control))
    assert found.termination is Termination.NO_SOLUTION and found.point is None


def test_through_the_front_door() -> None:
    problem = generate(drivers=0)
    one, two = (ct.solve(problem, backend.name) for backend in BOTH)
    for result in (one, two):
        assert result.primal_bound == pytest.approx(problem.verify(result.plan).objective)
        assert result.primal_bound < 0.03  # degrees
    assert two.primal_bound <= one.primal_bound


# Properties


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_left_and_right_are_alike(seed: int, slides: bool) -> None:
    problem = drawn(seed, GRIPPING if slides else VEHICLE)
    on = problem.recording
    turned = Recording(on.times, on.speed, -on.steering, -on.yaw_rate, -on.lateral_acceleration)
    other = dataclasses.replace(problem, recording=turned)
    for backend in BOTH:
        one, two = plan(problem, backend), plan(other, backend)
        np.testing.assert_array_equal(one.sideslip, -two.sideslip)
        np.testing.assert_array_equal(one.deviation, two.deviation)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3), st.booleans())
def test_mass_cancels(seed: int, by: float, slides: bool) -> None:
    one = GRIPPING if slides else VEHICLE
    names = "mass", "yaw_inertia", "cornering_front", "cornering_rear"
    two = dataclasses.replace(one, **{name: by * getattr(one, name) for name in names})
    for backend in BOTH:
        first, second = (plan(drawn(seed, vehicle), backend) for vehicle in (one, two))
        np.testing.assert_allclose(first.sideslip, second.sideslip, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(first.deviation, second.deviation, rtol=1e-5)


# Kernels


@pytest.mark.parametrize("vehicle", [VEHICLE, GRIPPING], ids=["linear", "saturating"])
def test_kernels_mean_the_same_interpreted(
    vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = drawn(2, vehicle)

    def everything() -> list[Floats]:
        found = filtered(problem)
        smoothed, smoothed_covariance = smooth_drive(problem, found)
        both_ways = mismatch(problem, found), mismatch(problem, found, ahead=True)
        parts = [*found[:6], *found.model, smoothed, smoothed_covariance]
        return parts + [array for each in both_ways for array in each]

    compiled = everything()
    # Patch the calling modules: an interpreted kernel also calls interpreted kernels.
    monkeypatch.setattr(passes, "filter_path", kalman_kernels.filter_path.py_func)
    monkeypatch.setattr(passes, "smooth_path", kalman_kernels.smooth_path.py_func)
    monkeypatch.setattr(mismatches, "leave_marks", mismatches.leave_marks.py_func)
    monkeypatch.setattr(mismatches, "fade", mismatches.fade.py_func)
    monkeypatch.setattr(mismatches, "fit_errors", mismatches.fit_errors.py_func)
    for mine, other in zip(everything(), compiled, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-12)


# -- wrong declarations of the sensors ---------------------------------------------------------------


def spoilt(spikes: int, drivers: int = 0) -> SideslipEstimation:
    """Return a drive whose acceleration has spikes of 50 m/s²."""
    model = generate(drivers=drivers)
    side = model.recording.lateral_acceleration.copy()
    side[np.linspace(30, 300, spikes).astype(int)] += 50.0
    drive = dataclasses.replace(model.recording, lateral_acceleration=side)
    return dataclasses.replace(model, recording=drive)


@pytest.mark.parametrize(("drivers", "name"), [(0, "rts-smoother"), (3, "smoother-grnn")])
def test_spikes_change_neither_the_choice_nor_the_angle(drivers: int, name: str) -> None:
    model, calm = spoilt(4, drivers), generate(drivers=drivers)
    backend = recommended(model)
    assert backend.name == name
    found, usual = backend.run(model.blinded(), Request()), backend.run(calm.blinded(), Request())
    assert "spikes of the sensors (4) are replaced" in found.message
    assert "spikes" not in usual.message
    error, least = (model.verify(entry.point).objective for entry in (found, usual))
    assert error < 1.1 * least
    assert model.coverage(found.point) >= 0.9


@pytest.mark.parametrize("sample", [0, 1, 339, 340])
@pytest.mark.parametrize("name", ["yaw_rate", "lateral_acceleration"])
def test_spikes_at_both_ends_of_a_drive_are_replaced(name: str, sample: int) -> None:
    model = generate(drivers=0)
    values = getattr(model.recording, name).copy()
    values[sample] = 90.0
    repaired = without_faults(dataclasses.replace(model.recording, **{name: values}))
    assert abs(getattr(repaired, name)[sample]) < 1.0


@pytest.mark.parametrize("seed", range(3))
def test_turns_steps_and_vibrations_are_no_spikes(seed: int) -> None:
    drive = generate("serpentine", seed=seed, drivers=0).recording
    kerb = np.zeros(len(drive))
    kerb[100:] += 10.0  # a step of 1 g
    kerb[200:206] = 20.0, -5.0, 18.0, -2.0, 22.0, 1.0
    for addition in (0.0, kerb):
        side = drive.lateral_acceleration + addition
        rough = dataclasses.replace(drive, lateral_acceleration=side)
        assert without_faults(rough) is rough


@pytest.mark.parametrize("name", ["yaw_rate", "lateral_acceleration"])
def test_the_other_sensor_replaces_a_stuck_one(name: str) -> None:
    model = generate(drivers=0)
    values = getattr(model.recording, name).copy()
    values[150:190] = values[150]
    stuck = dataclasses.replace(
        model, recording=dataclasses.replace(model.recording, **{name: values})
    )
    backend = recommended(stuck)
    assert backend.name == "rts-smoother"
    result = backend.run(stuck.blinded(), Request())
    assert f"{name} is stuck at 7.5-9.45 s: it is replaced by the other sensor" in result.message
    usual = model.verify(answer(model, RtsSmoother).point).objective
    assert stuck.verify(result.point).objective < 2.5 * usual
    assert stuck.coverage(result.point) >= 0.9


@pytest.mark.parametrize("name", ["yaw_rate", "lateral_acceleration"])
@pytest.mark.parametrize("value", [0.0, 0.3])
def test_the_other_sensor_replaces_one_that_never_changes(name: str, value: float) -> None:
    model = generate("serpentine", drivers=0)
    drive = dataclasses.replace(model.recording, **{name: np.full(len(model.recording), value)})
    dead = dataclasses.replace(model, recording=drive)
    backend = recommended(dead)
    assert backend.name == "rts-smoother"
    result = backend.run(dead.blinded(), Request())
    assert f"{name} is stuck at 0-" in result.message
    assert dead.verify(result.point).objective < 0.2
    assert dead.coverage(result.point) >= 0.8  # an angle that changes contradicts a = u ω


def test_a_quiet_sensor_on_a_straight_road_is_not_stuck() -> None:
    drive = generate(drivers=0).recording
    straight = dataclasses.replace(drive, yaw_rate=np.zeros(len(drive)), lateral_acceleration=
        0.05 * np.random.default_rng(0).normal(size=len(drive)))  # fmt: skip
    assert not stuck_samples(straight).any()


@pytest.mark.parametrize("name", ["yaw_rate", "lateral_acceleration"])
def test_a_constant_value_that_agrees_with_the_other_sensor_is_not_stuck(name: str) -> None:
    """On a circle without noise yaw rate or acceleration may be constant while the speed rises."""
    drive = generate(drivers=0).recording
    speed = np.linspace(8.0, 20.0, len(drive))
    circle = {"yaw_rate": 4.0 / speed, "lateral_acceleration": 0.3 * speed}
    circle[name] = np.full(len(drive), 0.3 if name == "yaw_rate" else 4.0)
    steady = dataclasses.replace(drive, speed=speed, **circle)
    assert without_faults(steady) is steady


def test_a_spike_on_a_straight_road_is_no_turn() -> None:
    drive = generate(drivers=0).recording
    side = 0.05 * np.random.default_rng(0).normal(size=len(drive))
    side[100] = 90.0
    straight = dataclasses.replace(drive, yaw_rate=0.0 * side, lateral_acceleration=side)
    assert not stuck_samples(straight).any()


def test_short_repetitions_and_rounded_values_are_not_stuck() -> None:
    drive = generate(drivers=0).recording
    side = drive.lateral_acceleration.copy()
    side[150:170] = side[150]  # 19 steps of 0.05 s
    short = dataclasses.replace(drive, lateral_acceleration=side)
    assert not stuck_samples(short).any()
    rounded = np.round(drive.lateral_acceleration / 0.1) * 0.1
    rounded[150:190] = rounded[150]
    assert not stuck_samples(dataclasses.replace(drive, lateral_acceleration=rounded)).any()


def test_the_smoother_uses_the_noise_that_it_measures() -> None:
    model = generate(drivers=0, yaw_rate_noise=0.02, acceleration_noise=1.0)
    small = dataclasses.replace(model, yaw_rate_noise=0.002, acceleration_noise=0.05)
    right, found = answer(model, RtsSmoother), answer(small, RtsSmoother)
    assert "noise of the sensors looks like" in found.message
    assert "noise of the sensors" not in right.message
    error, least = (model.verify(entry.point).objective for entry in (found, right))
    assert error < 1.2 * least < 0.5 * small.verify(answer(small, KalmanFilter).point).objective
    assert model.coverage(found.point) >= 0.9
    # Such noise alone does not show sliding tyres.
    assert recommended(small).name == "rts-smoother"
