"""``unscented-filter``: estimator of the angle, the grip, the bank of the road, the biases of the sensors and the vehicle.

Prior deviations, time constants and the factor on the noise were chosen on spins, on calm drives with wrong vehicles and on
the scenarios of ``tests/sideslip/two_track.py``. ``tests/benchmarks/sideslip/spins.py`` measures other drives.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime
from ...models.sideslip.data import Tyre
from ...models.sideslip.dynamics import parameters
from ...models.sideslip.model import SideslipEstimation
from ..contract.backend import Request
from .gates import intervals, time_ranges
from .kalman import KalmanFilter
from .mismatch import fade
from .native import UNKNOWN, Estimate, SideslipBackend
from .passes import measurements, noise_variances
from .unscented_kernels import GATE, SIZE, unscented_path

__all__ = ["UnscentedFilter", "setting_of"]

Floats = NDArray[np.float64]

#: Usual value, standard deviation and time constant (s) of inverse friction, bank angle (rad), biases of yaw rate (rad/s) and
#: lateral acceleration (m/s²), mass factor and balance. The usual inverse friction is that of the vehicle, 0 for linear tyres.
DRIFT = {
    "inverse friction": (math.nan, 1.0, 5.0),
    "bank": (0.0, 0.02, 20.0),
    "yaw rate bias": (0.0, 0.01, 100.0),
    "acceleration bias": (0.0, 0.2, 100.0),
    "mass factor": (1.0, 0.15, 1000.0),
    "balance": (0.0, 0.1, 1000.0),
}
#: Factor on the noises of the model: the states do not represent every error of a vehicle.
_NOISES = 2.0
#: Ratio of the angle's deviation to that of an unknown angle at which the filter restarts.
_LOST = 1e4
#: Seconds between two slides up to which they are one event, if the period is shorter.
JOINED = 0.2


def setting_of(problem: SideslipEstimation) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return the constant arguments of the kernels for a model, from the vehicle to the initial state; it reads no measurements."""
    vehicle = problem.vehicle
    drift, initial = np.array(list(DRIFT.values())), np.empty((SIZE, 2))
    drift[0, 0] = 0.0 if vehicle.tyre is Tyre.LINEAR else 1.0 / vehicle.friction
    initial[:2, 0], initial[:2, 1] = problem.initial, problem.initial_deviation
    initial[2:] = drift[:, :2]
    noise = _NOISES**2 * noise_variances(problem)
    return parameters(vehicle), np.array(vehicle.loads), noise, drift, initial


class UnscentedFilter(SideslipBackend):
    """Unscented Kalman filter with friction, bank, biases, mass and stiffness as states. Angles use samples up to their time."""

    name = "unscented-filter"
    summary = "unscented Kalman filter that estimates friction, bank angle, biases and mass, too"

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the filtered angles and the times without grip, or None if a run without a time limit was stopped."""
        # The first filter takes a fifteenth of the time. A stopped run with a time limit returns its angles.
        quick = None if request.time_limit is None else KalmanFilter().estimate(problem, request)
        drive, setting = problem.recording, setting_of(problem)
        n = len(drive)
        states, roots, innovations = (np.empty((n, *end)) for end in ((SIZE,), (SIZE, SIZE), (2,)))
        slides = np.empty(n, dtype=bool)
        data = np.where(drive.moving[:, None], measurements(drive), math.nan)
        most = _LOST * max(UNKNOWN, float(problem.initial_deviation[0]))
        lost = -1
        with suppress(OutOfTime):
            lost = unscented_path(
                *(drive.times, drive.speed, drive.steering, data, *setting, most),
                *(states, roots, innovations, slides, request.control.flag),
            )
        if lost < 0:
            words = ("stopped before the filter ended: the angles are those of kalman-filter",)
            return quick and quick._replace(message="; ".join((*words, quick.message)).strip("; "))
        sums = np.empty_like(innovations)
        fade(drive.times, innovations, sums)
        # Birge ratio: innovations beyond the claimed ones scale the variance.
        scale = np.maximum(sums[:, 0] / np.maximum(sums[:, 1], 1.0), 1.0)
        deviation = np.abs(roots[:, 0, 0]) * np.sqrt(scale)
        statistics = dict(zip(DRIFT, states[-1, 2:].tolist(), strict=True))
        statistics |= {"restarts": lost} if lost else {}
        missing = np.where(drive.moving, 2.0, 0.0) - innovations[:, 1]
        message = ""
        if missing.any():
            statistics["spikes"] = int(missing.sum())
            message = (
                f"measurements at {time_ranges(drive, missing > 0)} were treated as missing ({missing.sum():.0f} values), because "
                f"they differ by more than {GATE:g} deviations from the prediction: check the sensors and the noises"
            )
        slides &= drive.moving
        gap = max(JOINED, 1.5 * drive.period)
        events = intervals(drive.times, slides, gap) if slides.any() else ()
        return Estimate(states[:, 0], deviation, statistics, message, grip_lost=events)
