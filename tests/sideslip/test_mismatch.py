"""Claimed deviations if the vehicle or its sensors differ from the model."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sideslip.filters import BOTH, VEHICLE, answer, drawn, filtered, plan, simulated

from crosstrack.instances.sideslip.generator import generate
from crosstrack.models.sideslip import Recording, SideslipEstimate, SideslipEstimation
from crosstrack.models.sideslip.dynamics import linearise
from crosstrack.solvers.sideslip import mismatch as mismatches
from crosstrack.solvers.sideslip.kalman import KalmanFilter, claim
from crosstrack.solvers.sideslip.mismatch import mismatch
from crosstrack.solvers.sideslip.native import UNKNOWN
from crosstrack.solvers.sideslip.passes import FilterPass

Floats = NDArray[np.float64]

STOPPING = [[0, 0], [2, 0], [6, 20], [12, 20], [15, 0], [18, 0], [21, 15]]
#: Wrong models and bad sensors, with the smallest share of true angles within 3 claimed deviations. The share of normal
#: errors is 99.7 %.
WILD: dict[str, tuple[dict[str, Any], float]] = {
    "as believed": ({}, 0.98),
    "saturating": ({"tyre": "saturating"}, 0.98),
    "serpentine beyond linear tyres": (
        {"road": "serpentine", "tyre": "saturating", "believed_tyre": "linear"}, 0.98,
    ),
    "heavier by 30 % in belief": ({"mismatch": {"mass": 1.3}}, 0.98),
    "lighter by 30 % in belief": ({"mismatch": {"mass": 0.7}}, 0.97),
    "heavier on the serpentine": ({"road": "serpentine", "mismatch": {"mass": 1.3}}, 0.98),
    "stiff front": ({"mismatch": {"cornering_front": 1.4}}, 0.98),
    "soft rear": ({"mismatch": {"cornering_rear": 0.3}}, 0.98),
    "rear a thousandth": ({"mismatch": {"cornering_rear": 1e-3}}, 0.98),
    "ice that is known": ({"tyre": "saturating", "friction": 0.2, "speed": 8.0}, 0.98),
    "ice taken for dry": (
        {"tyre": "saturating", "friction": 0.2, "mismatch": {"friction": 4.5}, "speed": 8.0},
        0.98,
    ),
    "friction changes": (
        {"tyre": "saturating", "later_friction": 0.3, "speed": 15.0}, 0.95,
    ),
    "biased acceleration": ({"bias": (0.0, 0.5)}, 0.98),
    "biased yaw rate": ({"bias": (0.02, 0.0)}, 0.98),
    "both biased": ({"bias": (-0.02, 0.5)}, 0.98),
    "samples missing": ({"missing": 0.8}, 0.96),
    "samples stale": ({"stale": 0.5}, 0.92),
    "noise ten times the signal": ({"decibels": -10.0}, 0.98),
    "noise, sliding": ({"decibels": -10.0, "tyre": "saturating"}, 0.98),
    "halts": ({"speed": STOPPING, "tyre": "saturating"}, 0.98),
    "halts, heavier": ({"speed": STOPPING, "mismatch": {"mass": 1.3}}, 0.98),
    "walking pace": ({"speed": [[0, 0.5], [3, 0.9], [6, 1.5], [9, 0.5]]}, 0.96),
}  # fmt: skip


@pytest.mark.parametrize("case", WILD)
def test_what_is_not_known_is_said(case: str) -> None:
    how, share = WILD[case]
    problem = generate(drivers=0, seed=1, **how)
    for backend in BOTH:
        found = plan(problem, backend)
        assert problem.coverage(found, 3.0) >= share
        assert (found.deviation[~problem.recording.moving] == UNKNOWN).all()


@pytest.mark.parametrize(
    ("front", "rear"), [(1e3, 1e-3), (1e-3, 1e3), (1e6, 1.0), (1.0, 1e6), (1e-6, 1e-6), (1e6, 1e6)]
)
@pytest.mark.parametrize("backend", BOTH, ids=lambda one: one.name)
def test_stiffness_a_million_times_wrong(front: float, rear: float, backend: type[Any]) -> None:
    """The estimate cannot be accurate, but it exists and claims less accuracy than the model."""
    for tyre in ("linear", "saturating"):
        factors = {"cornering_front": front, "cornering_rear": rear}
        problem = generate(drivers=0, mismatch=factors, believed_tyre=tyre)
        found = answer(problem, backend)
        assert plan(problem, backend).sideslip.shape == (len(problem.recording),)
        assert found.statistics["widening"] > 1.2
        assert ("measurements contradict" in found.message) == (found.statistics["widening"] > 2)


def test_covariance_alone_would_claim_too_much() -> None:
    problem = generate(drivers=0, road="serpentine", mismatch={"mass": 1.3})
    found = filtered(problem)
    own = np.sqrt(found.filtered_covariance[:, 0, 0])
    assert problem.coverage(SideslipEstimate(found.filtered[:, 0], own)) < 0.3
    widened = plan(problem, KalmanFilter)
    np.testing.assert_array_equal(widened.sideslip, found.filtered[:, 0])
    assert problem.coverage(widened) > 0.9


# Single errors


def noiseless(front: float = 1.0, rear: float = 1.0) -> tuple[SideslipEstimation, Floats]:
    """Return a noise-free drive of a vehicle with scaled forces, and its states."""
    n, dt = 300, 0.01
    times = dt * np.arange(n)
    recording = Recording(
        times, np.full(n, 20.0), 0.03 * np.sin(3 * times), np.zeros(n), np.zeros(n)
    )
    scaled = dataclasses.replace(VEHICLE, cornering_front=9e4 * front, cornering_rear=1.1e5 * rear)
    model = linearise(SideslipEstimation(scaled, recording), np.zeros((n, 2)))
    x = np.zeros((n, 2))
    for k in range(n - 1):
        x[k + 1] = model.step[k] @ x[k] + model.shift[k]
    z = np.einsum("kij,kj->ki", model.slope, x) + model.level
    recording = dataclasses.replace(recording, yaw_rate=z[:, 0], lateral_acceleration=z[:, 1])
    return SideslipEstimation(VEHICLE, recording, truth=x[:, 0]), x


@pytest.mark.parametrize("error", range(4))
def test_marks_are_what_errors_make(error: int) -> None:
    """Marks equal the change of the angle. A single error is identified."""
    size = [1e-3, 1e-3, 1e-4, 1e-3][error]
    bigger = {0: (1 + size, 1 + size), 1: (1 + size, 1 - size)}.get(error, (1.0, 1.0))
    problem, x = noiseless(*bigger)
    if error >= 2:
        biased = ["yaw_rate", "lateral_acceleration"][error - 2]
        moved = getattr(problem.recording, biased) + size
        recording = dataclasses.replace(problem.recording, **{biased: moved})
        problem = dataclasses.replace(problem, recording=recording)
    found = filtered(problem)
    marks, terms = left(problem, found)
    made = x[:, 0] - found.filtered[:, 0]
    np.testing.assert_allclose(marks[:, error] * size, made, atol=0.03 * np.abs(made).max())
    # A single error explains all innovations, so its fit gives its size.
    fit, weight = terms[:, error].sum(), terms[:, 4 + error].sum()
    assert fit / weight == pytest.approx(size, rel=0.03)


def left(problem: SideslipEstimation, found: FilterPass) -> tuple[Floats, Floats]:
    """Return the marks of errors by the interpreted kernel."""
    n, drive = len(problem.recording), problem.recording
    marks, terms = np.empty((n, 4)), np.empty((n, 10))
    mismatches.leave_marks.py_func(
        *(drive.times, drive.speed, drive.steering, drive.moving),
        mismatches.parameters(problem.vehicle),
        *(mismatches.noise_variances(problem), found.predicted, found.filtered),
        *(found.filtered_covariance, found.innovations, found.innovation_covariance),
        *(found.model.step, found.model.slope, np.zeros((2, 4)), marks, terms, np.empty((2, 4))),
    )
    return marks, terms


@pytest.mark.parametrize("bias", [(0.0, 0.5), (0.02, 0.0), (-0.02, -0.5)])
@pytest.mark.parametrize("ahead", [False, True])
def test_a_large_error_is_told_as_large_as_it_is(bias: tuple[float, float], ahead: bool) -> None:
    clean, biased = generate(drivers=0), generate(drivers=0, bias=bias)
    off = np.abs(filtered(biased).filtered[:, 0] - filtered(clean).filtered[:, 0])
    told = mismatch(biased, filtered(biased), ahead=ahead)[1]
    late = slice(60, None)  # 3 s
    assert (told[late] > 0.4 * off[late]).all()
    assert np.median(told[late]) < 4 * np.median(off[late]) + 1e-3
    assert np.median(mismatch(clean, filtered(clean), ahead=ahead)[1]) < 3e-4


def test_noise_that_is_greater_than_declared_scales() -> None:
    problem = simulated(0, n=1500)
    on, rng = problem.recording, np.random.default_rng(0)
    noise = rng.normal(size=(2, 1500)) * [[0.02], [0.5]]
    noisy = dataclasses.replace(
        on,
        yaw_rate=on.yaw_rate + noise[0],
        lateral_acceleration=on.lateral_acceleration + noise[1],
    )
    scale, _ = mismatch(dataclasses.replace(problem, recording=noisy), filtered(
        dataclasses.replace(problem, recording=noisy)))  # fmt: skip
    # Innovations contain the noise of the sample and the filter's error.
    assert 50 < np.median(scale) < 130


def test_widened_is_never_less() -> None:
    problem = drawn(0)
    found = filtered(problem)
    scale, error = mismatch(problem, found)
    assert (scale >= 1).all() and (error >= 0).all()
    variance = found.filtered_covariance[:, 0, 0]
    wide = claim(problem, found, found.filtered[:, 0], variance).deviation
    assert (wide >= np.sqrt(variance)).all()
    np.testing.assert_allclose(wide**2, scale * variance + error**2)


def test_fading_is_an_exponential_sum() -> None:
    rng = np.random.default_rng(0)
    times, terms = np.cumsum(rng.uniform(1e-3, 2, 50)), rng.normal(size=(50, 3))
    sums = np.empty_like(terms)
    mismatches.fade(times, terms, sums)
    apart = np.subtract.outer(times, times)
    shares = np.where(apart >= 0, np.exp(-np.abs(apart) / mismatches.MEMORY), 0.0)
    np.testing.assert_allclose(sums, shares @ terms, rtol=1e-9, atol=1e-12)
