"""Forward pass of the Kalman filter and backward pass of the Rauch-Tung-Striebel smoother.

For linear tyres means and covariances are exact (R. E. Kalman, Journal of Basic Engineering 82, 1960;
H. E. Rauch, F. Tung and C. T. Striebel, AIAA Journal 3, 1965). For saturating tyres the model is linearised at
every sample (A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970, chapter 8).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.data import Recording
from ...models.sideslip.dynamics import Linearised, parameters
from ...models.sideslip.model import SideslipEstimation
from ..contract.control import Control
from .kalman_kernels import filter_path, smooth_path
from .native import UNKNOWN

__all__ = ["FilterPass", "filter_drive", "noise_variances", "smooth_drive"]

Floats = NDArray[np.float64]

#: Ratio of the angle's deviation to that of an unknown angle at which the filter restarts.
_LOST = 1e4


class FilterPass(NamedTuple):
    """Result of the Kalman filter: states (rad, rad/s), innovations, and covariances of both.

    `predicted` and `filtered` are the states before and after a sample's measurement is used. The
    innovations, measured minus predicted yaw rate (rad/s) and lateral acceleration (m/s²), include
    samples below 1 m/s, although the filter does not use them. `model` has measurements about predicted
    and transitions about filtered states. `lost` is the number of restarts after the state had become
    unknown.
    """

    predicted: Floats
    predicted_covariance: Floats
    filtered: Floats
    filtered_covariance: Floats
    innovations: Floats
    innovation_covariance: Floats
    model: Linearised
    lost: int


def noise_variances(problem: SideslipEstimation) -> Floats:
    """Return the variances of angle and yaw rate per second, then of measured yaw rate and acceleration."""
    return np.square([*problem.disturbance, *problem.sensor_noises])


def measurements(drive: Recording) -> Floats:
    """Return measured yaw rates (rad/s) and lateral accelerations (m/s²), shape (n, 2)."""
    return np.column_stack([drive.yaw_rate, drive.lateral_acceleration])


def largest_variance(problem: SideslipEstimation) -> float:
    """Return the variance of the angle (rad²) at which the filter restarts."""
    return float((_LOST * max(UNKNOWN, problem.initial_deviation[0])) ** 2)


def filter_drive(problem: SideslipEstimation, control: Control | None = None) -> FilterPass | None:
    """Run the (extended) Kalman filter over the drive; return None if the flag of `control` stopped it.

    Measurements below 1 m/s are not used: the acceleration of a vehicle at rest does not depend on the
    angle.
    """
    drive = problem.recording
    n = len(drive)
    predicted, filtered, innovations = (np.empty((n, 2)) for _ in range(3))
    before, after, between = (np.empty((n, 2, 2)) for _ in range(3))
    model = Linearised.empty(n)
    deviation = problem.initial_deviation
    initial = np.concatenate([problem.initial, deviation**2])
    lost = filter_path(
        drive.times, drive.speed, drive.steering, measurements(drive), drive.moving,
        parameters(problem.vehicle), noise_variances(problem),
        np.insert(initial, 3, 0.0), initial, largest_variance(problem),
        predicted, before, filtered, after, innovations, between, *model,
        np.zeros(1, np.int8) if control is None else control.flag,
    )  # fmt: skip
    if lost < 0:
        return None
    return FilterPass(predicted, before, filtered, after, innovations, between, model, lost)


def smooth_drive(problem: SideslipEstimation, filter_pass: FilterPass) -> tuple[Floats, Floats]:
    """Return the states (rad, rad/s) given all measurements, shape (n, 2), and their covariances, shape (n, 2, 2).

    The states equal those of Rauch, Tung and Striebel. They are computed in the form of D. C. Fraser and
    J. E. Potter (IEEE Transactions on Automatic Control 14, 1969), which inverts no covariance: covariances are
    nearly singular if the disturbance is small.
    """
    drive = problem.recording
    smoothed = np.empty((len(drive), 2)), np.empty((len(drive), 2, 2))
    smooth_path(
        *(drive.times, measurements(drive), drive.moving, noise_variances(problem)),
        *(*filter_pass.model, filter_pass.filtered, filter_pass.filtered_covariance, *smoothed),
    )
    return smoothed
