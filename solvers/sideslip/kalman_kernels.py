"""Kernels of the Kalman filter and of the Rauch-Tung-Striebel smoother.

Symmetric matrices [[a, b], [b, c]] are stored as a, b, c.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.sideslip.dynamics import congruence, linearise_measurement, linearise_step

__all__ = ["filter_path", "smooth_path"]

Floats = NDArray[np.float64]

#: Number of samples between two checks of the stop flag.
_SAMPLES = 1024


@kernel
def keep(
    k: int, x: float, y: float, a: float, b: float, c: float, states: Floats, spread: Floats
) -> None:
    """Store the state of sample k and its covariance."""
    states[k, 0], states[k, 1] = x, y
    spread[k, 0, 0], spread[k, 0, 1], spread[k, 1, 0], spread[k, 1, 1] = a, b, b, c


@kernel(interpretable=True)
def filter_path(
    times: Floats, speed: Floats, steering: Floats, data: Floats, usable: NDArray[np.bool_],
    p: Floats, noise: Floats, start: Floats, initial: Floats, most: float,
    predicted: Floats, spread: Floats, filtered: Floats, filtered_spread: Floats,
    innovations: Floats, innovation_spread: Floats,
    step: Floats, shift: Floats, slope: Floats, level: Floats, flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Run the extended Kalman filter over a drive; return the number of restarts, or -1 if `flag` stopped it.

    Measurements `data`, shape (n, 2), of `usable` samples are linearised about the predicted state,
    transitions about the filtered state. `noise` are the variances of the disturbances per second and of
    the measurements, and `start` is the state before the first sample and its covariance a, b, c. At an
    angle variance above `most` the filter restarts from the state `initial` and its variances; the transition matrix
    is then zero. The arrays from `predicted` to `level` are output: states and innovations, shape (n, 2), their
    covariances, shape (n, 2, 2), and the linearised model.
    """
    n = len(times)
    x, y = start[0], start[1]
    a, b, c = start[2], start[3], start[4]
    lost = 0
    for k in range(n):
        if k % _SAMPLES == 0 and flag[0] != 0:
            return -1
        keep(k, x, y, a, b, c, predicted, spread)
        linearise_measurement(k, x, y, speed, steering, p, slope, level)
        g, h = slope[k, 1, 0], slope[k, 1, 1]
        v = data[k, 0] - y
        w = data[k, 1] - (g * x + h * y + level[k, 1])
        # Covariance of the second measurement with the state, and H P Hᵀ + R.
        i, j = g * a + h * b, g * b + h * c
        r, s, t = c + noise[2], j, g * i + h * j + noise[3]
        keep(k, v, w, r, s, t, innovations, innovation_spread)
        if usable[k]:
            # The variance of the second given the first is at least that of its noise.
            rest = max(t - s * s / r, noise[3])
            d, e = (i - b * s / r) / rest, (j - c * s / r) / rest
            f, o = (b - d * s) / r, (c - e * s) / r
            x += f * v + d * w
            y += o * v + e * w
            # Joseph's form keeps the covariance positive: (I - K H) P (I - K H)ᵀ + K R Kᵀ.
            a, b, c = congruence(1.0 - d * g, -f - d * h, -e * g, 1.0 - o - e * h, a, b, c)
            i, j, r = congruence(f, d, o, e, noise[2], 0.0, noise[3])
            a, b, c = a + i, b + j, c + r
        keep(k, x, y, a, b, c, filtered, filtered_spread)
        if k + 1 < n:
            x, y = linearise_step(k, x, y, times, speed, steering, p, step, shift)
            dt = times[k + 1] - times[k]
            a, b, c = congruence(
                step[k, 0, 0], step[k, 0, 1], step[k, 1, 0], step[k, 1, 1], a, b, c
            )
            a, c = a + noise[0] * dt, c + noise[1] * dt
            if not (a < most and c < math.inf and abs(x) < math.inf and abs(y) < math.inf):
                lost += 1
                x, y = initial[0], initial[1]
                a, b, c = initial[2], 0.0, initial[3]
                shift[k, 0], shift[k, 1] = x, y
                step[k, 0, 0], step[k, 0, 1], step[k, 1, 0], step[k, 1, 1] = 0.0, 0.0, 0.0, 0.0
    return lost


@kernel(interpretable=True)
def smooth_path(
    times: Floats, data: Floats, usable: NDArray[np.bool_], noise: Floats,
    step: Floats, shift: Floats, slope: Floats, level: Floats,
    filtered: Floats, filtered_spread: Floats, smoothed: Floats, smoothed_spread: Floats,
) -> None:  # fmt: skip
    """Run the smoother backwards over a filtered drive; fill `smoothed` and `smoothed_spread`.

    The log-likelihood of later samples given a state x is carried as -xᵀ J x / 2 + xᵀ y and combined with the
    filtered state.
    """
    a, b, c, v, w = 0.0, 0.0, 0.0, 0.0, 0.0  # J = [[a, b], [b, c]] and y
    last = len(filtered) - 1
    for k in range(last, -1, -1):
        if k < last:
            if usable[k + 1]:
                r, s = 1.0 / noise[2], 1.0 / noise[3]
                g, h = slope[k + 1, 1, 0], slope[k + 1, 1, 1]
                a, b, c = a + s * g * g, b + s * g * h, c + r + s * h * h
                e = s * (data[k + 1, 1] - level[k + 1, 1])
                v, w = v + e * g, w + e * h + r * data[k + 1, 0]
            # Disturbance: (I + J Q)⁻¹ J and (I + J Q)⁻¹ (y - J shift).
            dt = times[k + 1] - times[k]
            q, r = noise[0] * dt, noise[1] * dt
            det = max(a * c - b * b, 0.0)
            rest = 1.0 + a * q + c * r + q * r * det
            d, e = shift[k, 0], shift[k, 1]
            v, w = v - a * d - b * e, w - b * d - c * e
            v, w = ((1.0 + c * r) * v - b * r * w) / rest, ((1.0 + a * q) * w - b * q * v) / rest
            a, b, c = (a + r * det) / rest, b / rest, (c + q * det) / rest
            # Transition: Aᵀ J A and Aᵀ y.
            g, h, i, j = step[k, 0, 0], step[k, 0, 1], step[k, 1, 0], step[k, 1, 1]
            a, b, c = congruence(g, i, h, j, a, b, c)
            v, w = g * v + i * w, h * v + j * w
        x, y = filtered[k, 0], filtered[k, 1]
        d, e, f = filtered_spread[k, 0, 0], filtered_spread[k, 0, 1], filtered_spread[k, 1, 1]
        # The covariance (P⁻¹ + J)⁻¹ in a form without division by zero.
        r, s = max(a * c - b * b, 0.0), max(d * f - e * e, 0.0)
        rest = 1.0 + max(d * a + 2.0 * e * b + f * c, 0.0) + r * s
        d, e, f = (d + s * c) / rest, (e - s * b) / rest, (f + s * a) / rest
        g, h = v - a * x - b * y, w - b * x - c * y
        x, y = x + d * g + e * h, y + e * g + f * h
        keep(k, x, y, d, e, f, smoothed, smoothed_spread)
