"""A drive as the Kalman filter goes through it, and as the Rauch-Tung-Striebel smoother goes back.

For linear tyres means and covariances are exact (R. E. Kalman, Journal of Basic Engineering 82, 1960;
H. E. Rauch, F. Tung and C. T. Striebel, AIAA Journal 3, 1965); for saturating ones the model is linearised at
every sample (A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970, chapter 8).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.data import Recording
from ...models.sideslip.dynamics import Linearised, parameters
from ...models.sideslip.model import SideslipEstimation
from ..control import Control
from .kalman_kernels import filter_path, smooth_path
from .native import UNKNOWN

__all__ = ["FilterPass", "SmoothedPass", "filter_drive", "noise_variances", "smooth_drive"]

Floats = NDArray[np.float64]

#: Deviation of the angle above which it is unknown, as a multiple of the largest prior deviation.
_LOST = 1e4


class FilterPass(NamedTuple):
    """A drive as the Kalman filter went through it.

    Parameters
    ----------
    predicted, filtered : ndarray, shape (n, 2)
        State (rad, rad/s) at each sample, from the samples before, and with its own.
    predicted_covariance, filtered_covariance : ndarray, shape (n, 2, 2)
        Their covariances.
    innovations : ndarray, shape (n, 2)
        Measurements less what was predicted of them, rad/s and m/s²; those of samples below 1 m/s were not used.
    innovation_covariance : ndarray, shape (n, 2, 2)
        Their covariances.
    model : Linearised
        The model as it was used: measurements about what was predicted, steps about what was filtered.
    lost : int
        How often the filter began anew, because nothing was known any more.
    """

    predicted: Floats
    predicted_covariance: Floats
    filtered: Floats
    filtered_covariance: Floats
    innovations: Floats
    innovation_covariance: Floats
    model: Linearised
    lost: int


class SmoothedPass(NamedTuple):
    """A drive as all of its samples show it.

    Parameters
    ----------
    states : ndarray, shape (n, 2)
        State (rad, rad/s) at each sample.
    covariance : ndarray, shape (n, 2, 2)
        Its covariance.
    """

    states: Floats
    covariance: Floats


def noise_variances(problem: SideslipEstimation) -> Floats:
    """Return the variances of the disturbances in a second and of the measurements, shape (4,)."""
    noises = problem.yaw_rate_noise, problem.acceleration_noise
    return np.square([*problem.disturbance, *noises])


def measurements(drive: Recording) -> Floats:
    """Return yaw rates and lateral accelerations, shape (n, 2)."""
    return np.column_stack([drive.yaw_rate, drive.lateral_acceleration])


def filter_drive(problem: SideslipEstimation, control: Control | None = None) -> FilterPass | None:
    """Run the (extended) Kalman filter over the drive.

    Samples below 1 m/s are not used: the acceleration of a vehicle at rest says nothing about the angle.

    Parameters
    ----------
    problem : SideslipEstimation
        The model; its truth is not looked at.
    control : Control, optional
        Asked whether to stop.

    Returns
    -------
    FilterPass, or None where the run was stopped
    """
    drive = problem.recording
    n = len(drive)
    predicted, filtered, innovations = (np.empty((n, 2)) for _ in range(3))
    before, after, between = (np.empty((n, 2, 2)) for _ in range(3))
    model = Linearised.empty(n)
    deviation = problem.initial_deviation
    lost = filter_path(
        *(drive.times, drive.speed, drive.steering),
        *(measurements(drive), drive.moving),
        *(parameters(problem.vehicle), noise_variances(problem)),
        np.concatenate([problem.initial, deviation**2]),
        (_LOST * max(UNKNOWN, float(deviation[0]))) ** 2,
        *(predicted, before, filtered, after, innovations, between, *model),
        np.zeros(1, np.int8) if control is None else control.flag,
    )
    if lost < 0:
        return None
    return FilterPass(predicted, before, filtered, after, innovations, between, model, lost)


def smooth_drive(problem: SideslipEstimation, found: FilterPass) -> SmoothedPass:
    """Return what all samples say, from what :func:`filter_drive` found of the same model.

    It is what Rauch, Tung and Striebel's formulas give, in the form of D. C. Fraser and J. E. Potter (IEEE
    Transactions on Automatic Control 14, 1969), which inverts no covariance: with hardly
    any disturbance they are singular but for rounding.
    """
    drive = problem.recording
    n = len(drive)
    smoothed = SmoothedPass(np.empty((n, 2)), np.empty((n, 2, 2)))
    smooth_path(
        *(drive.times, measurements(drive), drive.moving, noise_variances(problem)),
        *(*found.model, found.filtered, found.filtered_covariance, *smoothed),
    )
    return smoothed
