"""``unscented-filter``: estimator of the angle, the grip, the bank of the road, the biases of the sensors and the vehicle.

Prior deviations and time constants were chosen on 24 spins, 25 calm drives of ``tests/benchmarks/sideslip/spins.py`` and the
scenarios of ``tests/sideslip/two_track.py``. The errors there change by less than a third if one of them is halved or doubled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.data import Tyre
from ...models.sideslip.dynamics import parameters
from ...models.sideslip.model import SideslipEstimation
from ..contract.backend import Request
from .mismatch import fade
from .native import UNKNOWN, Estimate, SideslipBackend
from .passes import measurements, noise_variances
from .unscented_kernels import SIZE, find_slides, unscented_path

__all__ = ["Setting", "UnscentedFilter", "setting_of"]

Floats = NDArray[np.float64]

#: Usual value, standard deviation and time constant (s) of inverse friction, bank angle (rad), biases of yaw rate (rad/s) and
#: lateral acceleration (m/s²), mass factor and balance. The usual inverse friction is that of the vehicle, 0 for linear tyres.
DRIFT = (
    (math.nan, 1.0, 5.0),
    (0.0, 0.02, 20.0),
    (0.0, 0.01, 100.0),
    (0.0, 0.2, 100.0),
    (1.0, 0.15, 1000.0),
    (0.0, 0.1, 1000.0),
)
#: Ratio of the angle's deviation to that of an unknown angle at which the filter restarts.
_LOST = 1e4
#: Seconds between two slides up to which they are one event.
JOINED = 0.2
#: Names of the estimated quantities in the statistics, after angle and yaw rate.
_NAMES = (
    "inverse friction",
    "bank",
    "yaw rate bias",
    "acceleration bias",
    "mass factor",
    "balance",
)


class Setting(NamedTuple):
    """Constant arguments of :func:`~crosstrack.solvers.sideslip.unscented_kernels.unscented_step`.

    `initial`, shape (8, 2), is the state before the first sample and its standard deviations. The others are documented there.
    """

    parameters: Floats
    loads: Floats
    noise: Floats
    drift: Floats
    initial: Floats


def setting_of(problem: SideslipEstimation) -> Setting:
    """Return the constant arguments of the filter for a model; measurements are not read."""
    vehicle = problem.vehicle
    drift = np.array(DRIFT)
    drift[0, 0] = 0.0 if vehicle.tyre is Tyre.LINEAR else 1.0 / vehicle.friction
    initial = np.empty((SIZE, 2))
    initial[:2, 0], initial[:2, 1] = problem.initial, problem.initial_deviation
    initial[2:] = drift[:, :2]
    return Setting(
        parameters(vehicle), np.array(vehicle.loads), noise_variances(problem), drift, initial
    )


class UnscentedFilter(SideslipBackend):
    """Unscented Kalman filter with friction, bank, biases, mass and stiffness as states. Angles use samples up to their time."""

    name = "unscented-filter"
    summary = "unscented Kalman filter that estimates friction, bank angle, biases and mass, too"

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the filtered angles and the times without grip, or None if the run was stopped."""
        drive, setting = problem.recording, setting_of(problem)
        n = len(drive)
        states, roots, innovations = (
            np.empty((n, SIZE)),
            np.empty((n, SIZE, SIZE)),
            np.empty((n, 2)),
        )
        data = np.where(drive.moving[:, None], measurements(drive), math.nan)
        most = _LOST * max(UNKNOWN, float(problem.initial_deviation[0]))
        inputs = drive.times, drive.speed, drive.steering
        lost = unscented_path(
            *(*inputs, data, *setting, most, states, roots, innovations, request.control.flag)
        )
        if lost < 0:
            return None
        sums = np.empty_like(innovations)
        fade(drive.times, innovations, sums)
        # Birge ratio: innovations beyond the claimed ones scale the variance.
        scale = np.maximum(sums[:, 0] / np.maximum(sums[:, 1], 1.0), 1.0)
        deviation = np.abs(roots[:, 0, 0]) * np.sqrt(scale)
        slides = np.empty(n, dtype=bool)
        find_slides(states, *inputs[1:], setting.parameters, setting.loads, slides)
        statistics = dict(zip(_NAMES, states[-1, 2:].tolist(), strict=True))
        statistics |= {"restarts": lost} if lost else {}
        events = intervals(drive.times, slides & drive.moving)
        return Estimate(states[:, 0], deviation, statistics, grip_lost=events)


def intervals(times: Floats, flags: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
    """Return first and last time (s) of each group of flagged samples that are at most 0.2 s or one period apart."""
    places = np.flatnonzero(flags)
    if not places.size:
        return ()
    apart = (np.diff(times[places]) > JOINED) & (np.diff(places) > 1)
    cuts = np.flatnonzero(apart)
    first, last = places[np.r_[0, cuts + 1]], places[np.r_[cuts, len(places) - 1]]
    return tuple(zip(times[first].tolist(), times[last].tolist(), strict=True))
