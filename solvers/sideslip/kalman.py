"""``kalman-filter`` and ``rts-smoother``: estimators based on the single-track model.

The claimed covariance is that of the model, widened if the innovations contradict the
model, see :mod:`crosstrack.solvers.sideslip.mismatch`. The angles are not corrected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.checks import sensor_noises
from ...models.sideslip.model import NOISIER, SideslipEstimation
from ..contract.backend import Request
from .mismatch import mismatch
from .native import Estimate, SideslipBackend, leave_faults_out
from .passes import FilterPass, filter_drive, smooth_drive

__all__ = ["KalmanFilter", "RtsSmoother", "claim"]

Floats = NDArray[np.float64]

#: Widening factor above which the message reports a wrong model.
_WRONG = 2.0


def claim(
    problem: SideslipEstimation, filter_pass: FilterPass, sideslip: Floats, variance: Floats, *,
    ahead: bool = False,
) -> Estimate:  # fmt: skip
    """Return an estimate whose claimed deviation accounts for the filter's innovations.

    `variance` (rad²) is that of the angle (rad) according to the model. `ahead` is true if the estimate
    of a sample uses later samples.
    """
    model_deviation = np.sqrt(np.maximum(variance, 0.0))
    scale, error = mismatch(problem, filter_pass, ahead=ahead)
    deviation = np.sqrt(scale * model_deviation**2 + error**2)
    moving = problem.recording.moving
    widening = float(np.median(deviation[moving] / np.maximum(model_deviation[moving], 1e-300)))
    message = ""
    if widening > _WRONG:
        message = (
            "the measurements contradict the vehicle or the noises of the model: deviations are "
            f"{widening:.2g} times what they would be"
        )
    statistics: dict[str, float] = {"widening": widening}
    if filter_pass.lost:
        statistics["restarts"] = filter_pass.lost
    return Estimate(sideslip, deviation, statistics, message)


class KalmanFilter(SideslipBackend):
    """Kalman filter, extended for saturating tyres. Each angle uses samples up to its time."""

    name = "kalman-filter"
    summary = "Kalman filter on the single-track model, extended for saturating tyres"

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the filtered angles, or None if the run was stopped."""
        filter_pass = filter_drive(problem, request.control)
        if filter_pass is None:
            return None
        angles, variances = filter_pass.filtered[:, 0], filter_pass.filtered_covariance[:, 0, 0]
        return claim(problem, filter_pass, angles, variances)


class RtsSmoother(SideslipBackend):
    """Rauch-Tung-Striebel smoother. Each angle uses all samples.

    Spikes and stuck values of the sensors are left out. If a sensor is more than twice as noisy as declared, its measured noise is used: with a
    smaller one the errors of the vehicle are attributed to the angle.
    """

    name = "rts-smoother"
    summary = "Rauch-Tung-Striebel smoother: the Kalman filter, run back over all samples"

    def revise(self, problem: SideslipEstimation) -> tuple[SideslipEstimation, str]:
        """Return the model without faults of the sensors and with the measured noise of the sensors, if it is clearly larger."""
        problem, remark = leave_faults_out(problem)
        measured, declared = sensor_noises(problem.recording), problem.sensor_noises
        noise = np.where(measured > NOISIER * declared, measured, declared)
        if np.array_equal(noise, declared):
            return problem, remark
        parts = (
            f"the noise of the sensors looks like {noise[0]:.2g} rad/s and {noise[1]:.2g} m/s², which replaces the declared "
            f"{declared[0]:.2g} rad/s and {declared[1]:.2g} m/s²"
        )
        yaw_rate, acceleration = noise.tolist()
        problem = replace(
            problem, truth=None, yaw_rate_noise=yaw_rate, acceleration_noise=acceleration
        )
        return problem, "; ".join(filter(None, (remark, parts)))

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the smoothed angles, or None if the run was stopped."""
        filter_pass = filter_drive(problem, request.control)
        if filter_pass is None:
            return None
        states, covariance = smooth_drive(problem, filter_pass)
        return claim(problem, filter_pass, states[:, 0], covariance[:, 0, 0], ahead=True)
