"""Drives for the tests of filters, and estimates computed in this process."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from crosstrack.models.sideslip import Recording, SideslipEstimate, SideslipEstimation, Vehicle
from crosstrack.solvers.contract.backend import Answer, Request
from crosstrack.solvers.sideslip.kalman import KalmanFilter, RtsSmoother
from crosstrack.solvers.sideslip.passes import FilterPass, filter_drive

Floats = NDArray[np.float64]

VEHICLE = Vehicle(1500.0, 2500.0, 1.2, 1.5, 9e4, 1.1e5)
GRIPPING = dataclasses.replace(VEHICLE, tyre="saturating")
BOTH = [KalmanFilter, RtsSmoother]


def answer(problem: SideslipEstimation, backend: type[Any]) -> Answer:
    """Return the answer of a backend, run in this process without the truth."""
    found: Answer = backend().run(problem.blinded(), Request())
    return found


def plan(problem: SideslipEstimation, backend: type[Any]) -> SideslipEstimate:
    found = answer(problem, backend).point
    assert isinstance(found, SideslipEstimate)
    assert np.isfinite(found.sideslip).all() and np.isfinite(found.deviation).all()
    assert (found.deviation >= 0).all()
    return found


def filtered(problem: SideslipEstimation) -> FilterPass:
    found = filter_drive(problem)
    assert found is not None
    return found


def drawn(seed: int, vehicle: Vehicle = VEHICLE, n: int = 30, **more: Any) -> SideslipEstimation:
    """Return a random drive with irregular samples and halts. No vehicle has such measurements."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.001, 0.01, 0.05, 0.3, 1.9], n, p=[0.1, 0.4, 0.3, 0.15, 0.05]))
    speed = np.where(rng.random(n) < 0.15, rng.uniform(0, 1, n), rng.uniform(1, 40, n))
    speed[n // 2] = 20.0
    noise = rng.normal(size=(3, n))
    recording = Recording(times, speed, 0.03 * noise[0], 0.2 * noise[1], 2.0 * noise[2])
    return SideslipEstimation(vehicle, recording, **more)


#: True states of the simulated drives, by seed.
TRUE: dict[int, Floats] = {}


def simulated(seed: int, n: int = 150, dt: float = 0.02) -> SideslipEstimation:
    """Return a drive simulated from the model by matrix exponentials, with its declared noise."""
    rng = np.random.default_rng(seed)
    u, (m, inertia, a, b) = 22.0, (1500.0, 2500.0, 1.2, 1.5)
    front, rear = 9e4, 1.1e5
    force = np.array([[-(front + rear), (b * rear - a * front) / u], [0, 0]])
    force[1] = b * rear - a * front, -(a * a * front + b * b * rear) / u
    pull = np.array([front, a * front])
    by = np.array([[m * u], [inertia]])
    whole = np.zeros((3, 3))
    whole[:2, :2] = (force / by - [[0, 1], [0, 0]]) * dt
    whole[:2, 2] = pull / by[:, 0] * dt
    step = expm(whole)
    times = dt * np.arange(n)
    delta = 0.03 * np.sin(2 * np.pi * times / 2)
    x = np.empty((n, 2))
    x[0] = rng.normal(size=2) * [0.02, 0.1]
    for k in range(n - 1):
        middle = 0.5 * (delta[k] + delta[k + 1])
        shock = rng.normal(size=2) * [0.002, 0.01] * np.sqrt(dt)
        x[k + 1] = step[:2, :2] @ x[k] + step[:2, 2] * middle + shock
    TRUE[seed] = x
    acceleration = (x @ force[0] + front * delta) / m
    noise = rng.normal(size=(2, n)) * [[0.002], [0.05]]
    recording = Recording(times, np.full(n, u), delta, x[:, 1] + noise[0], acceleration + noise[1])
    return SideslipEstimation(VEHICLE, recording, truth=x[:, 0])
