"""Kernels of the online estimators: one sample at a time, with the kernels of the offline pass."""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.sideslip.data import LOW_SPEED
from .gates import Track, gate_sample
from .kalman_kernels import filter_path
from .mismatch import MEMORY, fit_errors, leave_marks
from .unscented_kernels import is_sliding, unscented_step

__all__ = ["Cloud", "Pair", "kalman_sample", "unscented_sample"]

Floats = NDArray[np.float64]

#: Variance of a measurement that is missing.
_MISSING = 1e30


Pair = namedtuple(
    "Pair",
    "times speed steering data noise start predicted spread filtered covariance innovations innovation_spread step "
    "shift slope level before marks terms after sums scale error usable flag vehicle declared initial",
)
Pair.__doc__ = "Arguments of the filter's kernels for two samples, the one before and the new one."
Cloud = namedtuple(
    "Cloud",
    "times speed steering data filtered root sums rejected vehicle loads noise drift initial begin",
)
Cloud.__doc__ = (
    "Arguments of the unscented filter; `begin` is the root of the initial covariance, and `rejected` is that of "
    ":func:`~crosstrack.solvers.sideslip.unscented_kernels.unscented_step`."
)


@kernel
def kalman_sample(
    first: bool, time: float, speed: float, steering: float, yaw_rate: float, acceleration: float,
    most: float, pair: Pair, track: Track,
) -> tuple[float, float, float, bool]:  # fmt: skip
    """Return angle and deviation (rad) at a new sample, its contradiction by kinematics (rad), and False.

    Measurements are NaN if they are missing. `first` starts the filter. The arrays of `pair` and
    `track` are updated.
    """
    pair.times[0], pair.speed[0], pair.steering[0] = pair.times[1], pair.speed[1], pair.steering[1]
    pair.start[0], pair.start[1] = pair.filtered[1, 0], pair.filtered[1, 1]
    spread = pair.covariance[1]
    pair.start[2], pair.start[3], pair.start[4] = spread[0, 0], spread[0, 1], spread[1, 1]
    if first:
        pair.times[0], pair.speed[0], pair.steering[0] = time, speed, steering
        pair.start[0], pair.start[1] = pair.initial[0], pair.initial[1]
        pair.start[2], pair.start[3], pair.start[4] = pair.initial[2], 0.0, pair.initial[3]
        pair.sums[:] = 0.0
        pair.after[:] = 0.0
    pair.times[1], pair.speed[1], pair.steering[1] = time, speed, steering
    count = 0.0
    for j in range(2):
        value = yaw_rate if j == 0 else acceleration
        known = not math.isnan(value)
        count += 1.0 if known else 0.0
        pair.data[1, j] = value if known else 0.0
        pair.noise[2 + j] = pair.declared[2 + j] if known else _MISSING
        pair.noise[j] = pair.declared[j]
    moving = speed >= LOW_SPEED
    pair.usable[0], pair.usable[1] = False, moving and count > 0.0
    filter_path(
        pair.times, pair.speed, pair.steering, pair.data, pair.usable, pair.vehicle, pair.noise,
        pair.start, pair.initial, most, pair.predicted, pair.spread, pair.filtered, pair.covariance,
        pair.innovations, pair.innovation_spread, pair.step, pair.shift, pair.slope, pair.level,
        pair.flag,
    )  # fmt: skip
    for j in range(len(pair.before)):
        pair.before[j] = pair.after[j]
    leave_marks(
        pair.times, pair.speed, pair.steering, pair.usable, pair.vehicle, pair.noise,
        pair.predicted, pair.filtered, pair.covariance, pair.innovations, pair.innovation_spread,
        pair.step, pair.slope, pair.before, pair.marks, pair.terms, pair.after,
    )  # fmt: skip
    share = math.exp((pair.times[0] - time) / MEMORY)
    terms, sums, marks = pair.terms[1], pair.sums[1], pair.marks[1]
    terms[len(terms) - 1] = count if pair.usable[1] else 0.0
    for j in range(len(terms)):
        sums[j] = (terms[j] if abs(terms[j]) < math.inf else 0.0) + share * sums[j]
    for j in range(len(marks)):
        marks[j] = marks[j] if abs(marks[j]) < math.inf else 0.0
    fit_errors(pair.marks, pair.sums, pair.scale, pair.error)
    variance = pair.scale[1] * max(pair.covariance[1, 0, 0], 0.0) + pair.error[1] * pair.error[1]
    angle, deviation, apart = gate_sample(
        time, speed, yaw_rate, acceleration, pair.filtered[1, 0], math.sqrt(variance), track
    )
    return angle, deviation, apart, False


@kernel
def unscented_sample(
    first: bool, time: float, speed: float, steering: float, yaw_rate: float, acceleration: float,
    most: float, cloud: Cloud, track: Track,
) -> tuple[float, float, float, bool]:  # fmt: skip
    """Do the same as :func:`kalman_sample` with the unscented filter; return True if an axle slides."""
    x, root = cloud.filtered, cloud.root
    before, u, delta, size = cloud.times[0], cloud.speed[0], cloud.steering[0], math.inf
    for i in range(x.shape[1]):
        x[0, i] = x[1, i]
        for j in range(x.shape[1]):
            root[0, i, j] = root[1, i, j]
    moving = speed >= LOW_SPEED
    cloud.data[0] = yaw_rate if moving else math.nan
    cloud.data[1] = acceleration if moving else math.nan
    square, count = 0.0, 0.0
    if first:
        cloud.sums[:] = cloud.rejected[:] = 0.0
        before = time
    else:
        square, count = unscented_step(
            x[0], root[0], cloud.data, time - before, u, speed - u, delta, steering - delta,
            cloud.vehicle, cloud.loads, cloud.noise, cloud.drift, cloud.rejected, x[1], root[1],
        )  # fmt: skip
        size = 0.0
        for j in range(x.shape[1]):
            size += abs(x[1, j]) + abs(root[1, j, j])
    if not (size < math.inf and root[1, 0, 0] < most):
        square, count = unscented_step(
            cloud.initial, cloud.begin, cloud.data, 0.0, speed, 0.0, steering, 0.0,
            cloud.vehicle, cloud.loads, cloud.noise, cloud.drift, cloud.rejected, x[1], root[1],
        )  # fmt: skip
    share = math.exp((before - time) / MEMORY)
    cloud.times[0], cloud.speed[0], cloud.steering[0] = time, speed, steering
    cloud.sums[0] = square + share * cloud.sums[0]
    cloud.sums[1] = count + share * cloud.sums[1]
    scale = max(cloud.sums[0] / max(cloud.sums[1], 1.0), 1.0)
    angle, deviation, apart = gate_sample(
        time, speed, yaw_rate, acceleration, x[1, 0], abs(root[1, 0, 0]) * math.sqrt(scale), track
    )
    slides = is_sliding(x[1], speed, steering, cloud.vehicle, cloud.loads)
    return angle, deviation, apart, moving and slides
