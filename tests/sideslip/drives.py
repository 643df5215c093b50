"""Drives for tests from closed formulas, independent of simulator and estimators."""

import numpy as np

from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, SideslipEstimate, Vehicle

#: Mid-size car that understeers.
CAR = {
    "mass": 1500.0, "yaw_inertia": 2500.0, "front": 1.2, "rear": 1.5,
    "cornering_front": 80_000.0, "cornering_rear": 90_000.0,
}  # fmt: skip


def kinematic(n=201, period=0.05, speed=20.0, *, noise=(0.0, 0.0), seed=0, **fields):
    """Return a model with a consistent recording: a = u (dβ/dt + ω), for chosen β and ω.

    β = 0.02 sin(t) rad and ω = 0.2 sin(1.5 t) rad/s, steering as at low speed.
    """
    drawn = np.random.default_rng(seed)
    times = period * np.arange(n)
    speeds = np.broadcast_to(np.asarray(speed, float), (n,))
    yaw = 0.2 * np.sin(1.5 * times)
    lateral = speeds * (0.02 * np.cos(times) + yaw)
    steering = np.clip(2.7 * yaw / np.maximum(speeds, 1.0), -0.5, 0.5)
    recording = Recording(
        times, speeds, steering, yaw + noise[0] * drawn.normal(size=n),
        lateral + noise[1] * drawn.normal(size=n),
    )  # fmt: skip
    truth = 0.02 * np.sin(times)
    fields = {"vehicle": Vehicle(**CAR), "truth": truth, "name": "formula", **fields}
    return SideslipEstimation(recording=recording, **fields)


def estimate(angles, deviation=0.001):
    """Return a plan with a constant deviation, or one given for each sample."""
    angles = np.asarray(angles, float)
    return SideslipEstimate(angles, np.broadcast_to(np.asarray(deviation, float), angles.shape))
