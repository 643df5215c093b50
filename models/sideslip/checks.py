"""Error measures of an estimate, computed from the raw data without an estimator's equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .data import LOW_SPEED, Recording, Vehicle

__all__ = [
    "SENSORS", "kinematic_differences", "kinematic_error", "kinematic_rate", "linear_contradiction",
    "mean_error", "sensor_noises", "stuck_samples", "without_faults",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Interval (s) over which changes of the angle are compared with the measurements.
WINDOW = 1.0
#: Speed (m/s) below which tyres are not compared with kinematics: tight turns at low speed have large angles.
SLOW = 5.0
#: Sensors without their inputs, and ratio of a value's difference from the median of five samples to the deviation of the noise
#: above which it is a spike. The noise is measured with at least `LEAST` third differences.
SENSORS, SPIKE, LEAST = ("yaw_rate", "lateral_acceleration"), 14.0, 100
#: Least duration (s) and number of repetitions of a value by a stuck sensor, and share of other repetitions above which it is rounded.
STUCK, REPEATS, ROUNDED = 1.0, 20, 0.1
#: Least range of the difference ``a - u ω`` in a drive with turns if one sensor never changes: in deviations of the noise, and m/s².
TURNS, LEAST_TURN = 20.0, 1.0


@np.errstate(over="ignore")  # an overflow gives an infinite error, which is no valid objective
def mean_error(recording: Recording, sideslip: Floats, other: Floats) -> float:
    """Return the mean absolute difference of two angles (rad, shape (n,)) in degrees, at 1 m/s or more."""
    return float(np.degrees(np.abs(sideslip - other)[recording.moving].mean()))


@np.errstate(over="ignore", invalid="ignore")
def kinematic_error(recording: Recording, sideslip: Floats) -> float:
    """Return the mean error of the angle's changes (rad, shape (n,)) relative to kinematics, in degrees.

    On a level road ``dβ/dt = a/u - ω`` holds for small angles and any tyres. The change over one second is
    compared with the integral of the measurements by the trapezoidal rule, averaged over all
    seconds without a halt. A recording shorter than one second is compared as a whole. The error is 0 if the
    vehicle never moves at two consecutive samples.
    """
    apart, _, _ = kinematic_differences(recording, sideslip)
    return float(np.degrees(np.abs(apart).mean())) if apart.size else 0.0


def kinematic_rate(recording: Recording) -> Floats:
    """Return the measured rate of the angle, ``a/u - ω``, rad/s, shape (n,); ``-ω`` below 1 m/s."""
    rate = recording.lateral_acceleration / np.where(recording.moving, recording.speed, np.inf)
    return np.asarray(rate - recording.yaw_rate)


@np.errstate(over="ignore", invalid="ignore")
def kinematic_differences(
    recording: Recording, sideslip: Floats
) -> tuple[Floats, NDArray[np.intp], NDArray[np.intp]]:
    """Return the estimated minus the measured change of the angle over each second without a halt.

    The result is the differences (rad), and the indices of the first and the last sample of each interval,
    all of shape (m,). If every second contains a halt, neighbouring samples are compared. The result is empty
    if the vehicle never moves at two consecutive samples.
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
    if not first.size:  # every second contains a halt: compare neighbouring samples
        first = np.flatnonzero(moving[:-1] & moving[1:])
        last = first + 1
    return sideslip[last] - sideslip[first] - (change[last] - change[first]), first, last


def sensor_noises(recording: Recording) -> Floats:
    """Return the deviations of the noise of yaw rate (rad/s) and lateral acceleration (m/s²), shape (2,), by third differences.

    Third differences of a smooth signal are small; those of white noise are √20 times its deviation. The result is 0 if fewer than
    100 of them are regular.
    """
    regular = np.abs(np.diff(recording.times) / recording.period - 1) < 0.1
    even = regular[:-2] & regular[1:-1] & regular[2:]
    if np.count_nonzero(even) < LEAST:
        return np.zeros(2)
    third = [np.abs(np.diff(getattr(recording, name), 3))[even] for name in SENSORS]
    return np.asarray(np.median(third, axis=1) / 0.6745 / np.sqrt(20.0))


def stuck_samples(recording: Recording) -> NDArray[np.bool_]:
    """Return the samples in motion at which each sensor repeats a value for a second or more, shape (2, n).

    A sensor without noise, or one that often repeats its value because it is rounded, is not stuck. One that never changes is
    stuck if the other one shows turns.
    """
    result = np.zeros((2, len(recording)), bool)
    noises = sensor_noises(recording)
    # In a steady turn a = u ω. A constant value is a fault only if the difference varies. Quantiles exclude spikes.
    speed, times = recording.speed, recording.times
    values = [getattr(recording, name) for name in SENSORS]
    apart = np.ptp(np.quantile((values[1] - speed * values[0])[recording.moving], (0.01, 0.99)))
    turns = apart > max(TURNS * np.hypot(speed.max() * noises[0], noises[1]), LEAST_TURN)
    for row, series, noise in zip(result, values, noises, strict=True):
        same = np.diff(series) == 0.0
        first, last = np.flatnonzero(np.diff(np.pad(same, 1).astype(int))).reshape(-1, 2).T
        long = (times[last] - times[first] >= STUCK) & (last - first >= REPEATS)
        others = np.count_nonzero(same) - (last - first)[long].sum()
        if (noise > 0.0 or (turns and same.all())) and others <= ROUNDED * len(same):
            for begin, end in zip(first[long], last[long], strict=True):
                row[begin : end + 1] = recording.moving[begin : end + 1]
    return result


def without_faults(recording: Recording) -> Recording:
    """Return a recording without spikes of one or two samples and without stuck values of both sensors.

    The median of five samples replaces a spike, which differs from it by 14 deviations of the noise, and by 14 times the
    median difference of the five samples: values in fast turns and vibrations of kerbs remain. A stuck sensor is replaced by the
    other one, with a constant angle: a = u ω. The result is `recording` itself if nothing changes.
    """
    changes = {}
    for name, noise in zip(SENSORS, sensor_noises(recording), strict=True):
        values = getattr(recording, name)
        near = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, mode="reflect"), 5)
        middle = np.median(near, axis=1)
        usual = np.median(np.abs(near - middle[:, None]), axis=1)
        spikes = np.abs(values - middle) > SPIKE * np.maximum(usual, noise)
        if noise > 0.0 and spikes.any():
            changes[name] = np.where(spikes, middle, values)
    stuck = stuck_samples(recording)
    for name, wrong, power in zip(SENSORS, stuck & ~stuck[::-1], (-1.0, 1.0), strict=True):
        if wrong.any():
            other = SENSORS[name == SENSORS[0]]
            speed = np.maximum(recording.speed, LOW_SPEED) ** power
            values = speed * changes.get(other, getattr(recording, other))
            changes[name] = np.where(wrong, values, changes.get(name, getattr(recording, name)))
    return replace(recording, **changes) if changes else recording


@np.errstate(over="ignore", invalid="ignore")
def linear_contradiction(
    vehicle: Vehicle, recording: Recording, seconds: float = np.inf
) -> tuple[float, float]:
    """Return the largest and the mean difference between linear tyres and kinematics at 5 m/s or more, in degrees.

    With linear tyres yaw rate, acceleration and steering angle of one sample determine the angle. Its changes over one
    second are compared with those of kinematics, as in :func:`kinematic_error`. The largest absolute difference shows
    tyres that slide or a wrong vehicle. The absolute mean shows a sensor with a bias or a bank of the road. It is the largest
    one of all stretches of `seconds`, or that of the whole recording if it is shorter. Spikes of a sensor and
    seconds with a stuck sensor are left out.
    """
    stuck = np.cumsum(np.pad(stuck_samples(recording).any(axis=0), (1, 0)))
    recording = without_faults(recording)
    front, rear = vehicle.cornering_front, vehicle.cornering_rear
    arm = (vehicle.rear * rear - vehicle.front * front) / np.maximum(recording.speed, SLOW)
    force = front * recording.steering + arm * recording.yaw_rate
    angle = (force - vehicle.mass * recording.lateral_acceleration) / (front + rear)
    apart, first, last = kinematic_differences(recording, angle)
    fast = np.minimum(recording.speed[first], recording.speed[last]) >= SLOW
    apart = apart[fast & (stuck[last + 1] == stuck[first])]
    if not apart.size:
        return 0.0, 0.0
    count = int(min(max(seconds / recording.period, 1.0), apart.size))
    sums = np.concatenate([[0.0], np.cumsum(apart)])
    means = (sums[count:] - sums[:-count]) / count
    return float(np.degrees(np.abs(apart).max())), float(np.degrees(np.abs(means).max()))
