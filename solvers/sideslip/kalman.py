"""``kalman-filter`` and ``rts-smoother``: estimates of the angle by the single-track model and its noises.

Their uncertainty is the covariance of the model, increased by the evidence of the innovations against the
model, see :mod:`crosstrack.solvers.sideslip.mismatch`; the estimates themselves are those of the model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.model import SideslipEstimation
from ..backend import Request
from .mismatch import mismatch
from .native import Estimate, SideslipBackend
from .passes import FilterPass, filter_drive, smooth_drive

__all__ = ["KalmanFilter", "RtsSmoother", "claim"]

Floats = NDArray[np.float64]

#: Widening above which a warning states that the model is wrong.
_WRONG = 2.0


def claim(
    problem: SideslipEstimation,
    found: FilterPass,
    sideslip: Floats,
    variance: Floats,
    *,
    ahead: bool = False,
) -> Estimate:
    """Return an estimate that claims what the model and the filter's innovations allow.

    Parameters
    ----------
    problem : SideslipEstimation
        The model.
    found : FilterPass
        Result of the Kalman filter for it.
    sideslip, variance : ndarray, shape (n,)
        The angle (rad) and its variance by the model.
    ahead : bool
        Whether the estimates use later samples.
    """
    own = np.sqrt(np.maximum(variance, 0.0))
    deviation = mismatch(problem, found, ahead=ahead).widen(own)
    moving = problem.recording.moving
    wider = float(np.median(deviation[moving] / np.maximum(own[moving], 1e-300)))
    message = ""
    if wider > _WRONG:
        message = (
            "the measurements contradict the vehicle or the noises of the model: deviations are "
            f"{wider:.2g} times what they would be"
        )
    statistics = {"widening": wider, **({"restarts": found.lost} if found.lost else {})}
    return Estimate(sideslip, deviation, statistics, message)


class KalmanFilter(SideslipBackend):
    """The (extended) Kalman filter: the angle from the samples up to its own."""

    name = "kalman-filter"
    summary = "Kalman filter on the single-track model, extended for saturating tyres"

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Filter."""
        found = filter_drive(problem, request.control)
        if found is None:
            return None
        return claim(problem, found, found.filtered[:, 0], found.filtered_covariance[:, 0, 0])


class RtsSmoother(SideslipBackend):
    """The Rauch-Tung-Striebel smoother: the angle from all samples."""

    name = "rts-smoother"
    summary = "Rauch-Tung-Striebel smoother: the Kalman filter, run back over all samples"

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Filter, and smooth."""
        found = filter_drive(problem, request.control)
        if found is None:
            return None
        smoothed = smooth_drive(problem, found)
        angles, variances = smoothed.states[:, 0], smoothed.covariance[:, 0, 0]
        return claim(problem, found, angles, variances, ahead=True)
