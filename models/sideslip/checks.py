"""Checks of an estimate against the raw data, without any equation of an estimator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .data import Recording

__all__ = ["kinematic_differences", "kinematic_error", "kinematic_rate", "mean_error"]

Floats = NDArray[np.float64]

#: Seconds over which a change of the angle is compared with what was measured.
WINDOW = 1.0


@np.errstate(over="ignore")  # what overflows is infinite, and so no objective
def mean_error(recording: Recording, sideslip: Floats, other: Floats) -> float:
    """Return the mean distance of two angles where they have a meaning, degrees."""
    return float(np.degrees(np.abs(sideslip - other)[recording.moving].mean()))


@np.errstate(over="ignore", invalid="ignore")
def kinematic_error(recording: Recording, sideslip: Floats) -> float:
    """Return how far changes of the angle are from those that were measured, degrees.

    On a level road ``dβ/dt = a/u - ω`` for small angles, whatever the tyres do. The change over a second is
    compared with the integral of the measurements by the trapezoidal rule, on average over all
    seconds without a halt; over the whole recording where it is shorter.
    """
    apart, _, _ = kinematic_differences(recording, sideslip)
    return float(np.degrees(np.abs(apart).mean())) if apart.size else 0.0


def kinematic_rate(recording: Recording) -> Floats:
    """Return the rate of the angle that was measured, ``a/u - ω``, rad/s; ``-ω`` below 1 m/s."""
    rate = recording.lateral_acceleration / np.where(recording.moving, recording.speed, np.inf)
    return np.asarray(rate - recording.yaw_rate)


@np.errstate(over="ignore", invalid="ignore")
def kinematic_differences(
    recording: Recording, sideslip: Floats
) -> tuple[Floats, NDArray[np.intp], NDArray[np.intp]]:
    """Return the change of the angle less the measured one over each second without a halt.

    If no second is without a halt, neighbouring samples are compared. The result is empty if the vehicle never
    moves at two samples in a row.

    Returns
    -------
    differences : ndarray, shape (m,)
        rad.
    first, last : ndarray, shape (m,)
        The samples at both ends.
    """
    times, moving = recording.times, recording.moving
    rate = kinematic_rate(recording)
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(times)
    change = np.concatenate([[0.0], np.cumsum(steps)])
    halts = np.concatenate([[0], np.cumsum(~moving)])
    window = min(WINDOW, float(times[-1] - times[0]))
    first = np.flatnonzero(times <= times[-1] - window * (1 - 1e-9))
    last = np.minimum(np.searchsorted(times, times[first] + window * (1 - 1e-9)), len(times) - 1)
    whole = halts[last + 1] == halts[first]
    first, last = first[whole], last[whole]
    if not first.size:  # never a second without a halt: neighbouring samples
        first = np.flatnonzero(moving[:-1] & moving[1:])
        last = first + 1
    return sideslip[last] - sideslip[first] - (change[last] - change[first]), first, last
