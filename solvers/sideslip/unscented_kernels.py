"""Kernels of the unscented filter of vehicle, tyres and sensors.

The state is x = (β, ω, s, φ, b_ω, b_a, f, r): sideslip angle (rad), yaw rate (rad/s), inverse of the friction (s = 1/μ), bank
angle of the road (rad, positive if the left side is higher), biases of yaw rate (rad/s) and lateral acceleration (m/s²),
mass factor, which multiplies the mass by f and the yaw inertia by (1 + f) / 2, and balance, which multiplies the front and
the rear cornering stiffness by 1 + r and 1 - r. Linear tyres are the case s = 0 of the brush model.

The covariance P = R Rᵀ is stored as its lower triangular root R, so it is positive semidefinite in floating-point arithmetic, too
(I. Arasaratnam and S. Haykin, Cubature Kalman filters, IEEE Transactions on Automatic Control 54, 2009, appendix B). The 2 n
points are those of S. Julier and J. Uhlmann (Unscented filtering and nonlinear estimation, Proceedings of the IEEE 92, 2004)
with κ = 0: their weights are positive.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.sideslip.data import GRAVITY, LOW_SPEED
from ...models.sideslip.dynamics import LONGEST_STEP, axle_forces, flow, measured, rates

__all__ = ["GATE", "SIZE", "is_sliding", "unscented_path", "unscented_step"]

Floats = NDArray[np.float64]

#: Numbers of states and of points, factor of their spread, and root of their weight.
SIZE, POINTS = 8, 16
_FAR, _PART = math.sqrt(8.0), 0.25
#: Smallest inverse friction of a tyre with a limit, smallest mass factor and largest balance.
_LEAST_INVERSE, _LEAST_FACTOR, _MOST_BALANCE = 1e-3, 0.05, 0.8
#: Share of the cornering stiffness below which more slip adds no force: 98.9 % of the brush model's largest force.
_SLIDES = 0.05
#: Deviations beyond which an innovation may be a spike, and most samples of a spike. On the spins of tests/sideslip/spins.py
#: gates of 5 to 8 deviations have nearly equal errors.
GATE, _SPIKE = 6.0, 2.0
#: Number of samples between two checks of the stop flag.
_SAMPLES = 256


@kernel
def adapt(p: Floats, loads: Floats, x: Floats, own: Floats) -> None:
    """Fill `own` with the vehicle `p`, changed by inverse friction, mass factor and balance of the state."""
    factor = max(x[6], _LEAST_FACTOR)
    balance = min(max(x[7], -_MOST_BALANCE), _MOST_BALANCE)
    for j in range(len(p)):
        own[j] = p[j]
    own[0], own[1] = factor * p[0], 0.5 * (1.0 + factor) * p[1]
    own[4], own[5] = (1.0 + balance) * p[4], (1.0 - balance) * p[5]
    own[6] = own[7] = math.inf
    if x[2] > _LEAST_INVERSE:
        own[6], own[7] = factor * loads[0] / x[2], factor * loads[1] / x[2]


@kernel
def move(x: Floats, dt: float, u: float, du: float, delta: float, ddelta: float, own: Floats) -> None:  # fmt: skip
    """Move angle and yaw rate by `dt`, as :func:`crosstrack.models.sideslip.dynamics.advance` on a banked road."""
    count = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
    h = dt / count
    for i in range(count):
        at = (i + 0.5) / count
        f, g, q, r, s, t = rates(x[0], x[1], u + at * du, delta + at * ddelta, own)
        f -= GRAVITY * math.sin(x[3]) / max(u + at * du, LOW_SPEED)
        e = flow(h * q, h * r, h * s, h * t)
        x[0], x[1] = x[0] + h * (e[4] * f + e[5] * g), x[1] + h * (e[6] * f + e[7] * g)


@kernel
def triangulate(a: Floats, rows: int, columns: int, root: Floats) -> None:
    """Fill the lower triangle T with T Tᵀ = A Aᵀ by the modified Gram-Schmidt method, which overwrites A."""
    for i in range(rows):
        for k in range(i, rows):
            dot = 0.0
            for j in range(columns):
                dot += a[k, j] * a[i, j]
            root[i, k] = 0.0
            root[k, i] = math.sqrt(dot) if k == i else dot / max(root[i, i], 1e-300)
        for k in range(i + 1, rows):
            share = root[k, i] / max(root[i, i], 1e-300)
            for j in range(columns):
                a[k, j] -= share * a[i, j]


@kernel
def spread_points(x: Floats, root: Floats, points: Floats) -> None:
    """Fill `points`, shape (16, 8), with x ± √8 times each column of the root."""
    for i in range(SIZE):
        for j in range(SIZE):
            points[i, j] = x[j] + _FAR * root[j, i]
            points[SIZE + i, j] = x[j] - _FAR * root[j, i]


@kernel
def is_used(innovation: float, variance: float, rejected: Floats, j: int) -> bool:
    """Return False if the innovation of measurement `j` may be a spike, and count it in `rejected`, or if it is missing."""
    if math.isnan(innovation):
        return False
    far = innovation * innovation > GATE * GATE * variance
    rejected[j] = rejected[j] + 1.0 if far else 0.0
    return not far or rejected[j] > _SPIKE


@kernel(interpretable=True)
def unscented_step(
    x: Floats, root: Floats, z: Floats, dt: float, u: float, du: float, delta: float, ddelta: float,
    p: Floats, loads: Floats, noise: Floats, drift: Floats, rejected: Floats, new_x: Floats, new_root: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Predict the state by `dt` seconds and update it with a sample; return χ² of the innovation and the number of used measurements.

    `x`, shape (8,), and `root`, shape (8, 8), are the state at the sample before and the root of its covariance; `new_x` and
    `new_root` are output. `z` are yaw rate (rad/s) and lateral acceleration (m/s²), NaN if missing. `u` and `delta` are speed
    (m/s) and steering angle (rad) at the sample before, `du` and `ddelta` their changes since then. With ``dt = 0`` nothing is
    predicted. `p` is the vehicle (:func:`~crosstrack.models.sideslip.dynamics.parameters`), `loads` the static loads of its
    axles (N), `noise` the variances of angle and yaw rate per second and of both measurements, and `drift`, shape (6, 3), the
    usual value, standard deviation and time constant (s) of s, φ, b_ω, b_a, f and r, which return to their usual values.

    A measurement whose innovation is beyond 6 deviations is treated as missing, but not more than twice in a row: a spin is followed.
    `rejected`, shape (2,), counts such innovations of each measurement since the last one within the gate; it is updated.
    """
    points, own, middle = np.empty((POINTS, SIZE)), np.empty(len(p)), x.copy()
    a, t = np.zeros((SIZE + 2, POINTS + SIZE)), np.zeros((SIZE + 2, SIZE + 2))
    spread_points(x, root, points)
    if dt > 0.0:
        for k in range(POINTS):
            adapt(p, loads, points[k], own)
            move(points[k], dt, u, du, delta, ddelta, own)
            for j in range(SIZE - 2):
                stay = math.exp(-dt / drift[j, 2])
                points[k, 2 + j] = drift[j, 0] + stay * (points[k, 2 + j] - drift[j, 0])
        for i in range(SIZE):
            middle[i] = 0.0
            for k in range(POINTS):
                middle[i] += points[k, i] / POINTS
            for k in range(POINTS):
                a[i, k] = _PART * (points[k, i] - middle[i])
            if i < 2:
                a[i, POINTS + i] = math.sqrt(noise[i] * dt)
            else:
                lost = -math.expm1(-2.0 * dt / drift[i - 2, 2])
                a[i, POINTS + i] = drift[i - 2, 1] * math.sqrt(lost)
        triangulate(a, SIZE, POINTS + SIZE, t)
        spread_points(middle, t, points)
    yaw_rate, acceleration = 0.0, 0.0
    for k in range(POINTS):
        adapt(p, loads, points[k], own)
        value, _, _ = measured(points[k, 0], points[k, 1], u + du, delta + ddelta, own)
        a[0, k], a[1, k] = points[k, 1] + points[k, 4], value + points[k, 5]
        yaw_rate += a[0, k] / POINTS
        acceleration += a[1, k] / POINTS
    r, s = noise[2], noise[3]
    for k in range(POINTS):
        a[0, k], a[1, k] = _PART * (a[0, k] - yaw_rate), _PART * (a[1, k] - acceleration)
        r, s = r + a[0, k] * a[0, k], s + a[1, k] * a[1, k]
    # A measurement that is not used has no relation to the state and no innovation.
    first = 1.0 if is_used(z[0] - yaw_rate, r, rejected, 0) else 0.0
    second = 1.0 if is_used(z[1] - acceleration, s, rejected, 1) else 0.0
    for k in range(POINTS):
        a[0, k], a[1, k] = first * a[0, k], second * a[1, k]
        for i in range(SIZE):
            a[2 + i, k] = _PART * (points[k, i] - middle[i])
    for i in range(SIZE + 2):
        a[i, POINTS] = a[i, POINTS + 1] = 0.0
    a[0, POINTS], a[1, POINTS + 1] = math.sqrt(noise[2]), math.sqrt(noise[3])
    triangulate(a, SIZE + 2, POINTS + 2, t)
    v = (z[0] - yaw_rate) / t[0, 0] if first else 0.0
    w = (z[1] - acceleration - t[1, 0] * v) / t[1, 1] if second else 0.0
    for i in range(SIZE):
        new_x[i] = middle[i] + t[2 + i, 0] * v + t[2 + i, 1] * w
        for j in range(SIZE):
            new_root[i, j] = t[2 + i, 2 + j]
    return v * v + w * w, first + second


@kernel(interpretable=True)
def unscented_path(
    times: Floats, speed: Floats, steering: Floats, data: Floats,
    p: Floats, loads: Floats, noise: Floats, drift: Floats, initial: Floats, most: float,
    states: Floats, roots: Floats, innovations: Floats, slides: NDArray[np.bool_], flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Run the filter over a drive; return the number of restarts, or -1 if `flag` stopped it.

    `data`, shape (n, 2), is NaN for measurements that are not used. `initial`, shape (8, 2), is the state before the first
    sample and its deviations. At a deviation of the angle above `most` the filter restarts. Output: `states`, shape (n, 8), `roots`,
    shape (n, 8, 8), `innovations`, shape (n, 2), the results of :func:`unscented_step`, and `slides`, shape (n,), those of
    :func:`is_sliding`.
    """
    lost, begin, rejected = 0, np.zeros((SIZE, SIZE)), np.zeros(2)
    for i in range(SIZE):
        begin[i, i] = initial[i, 1]
    for k in range(len(times)):
        if k % _SAMPLES == 0 and flag[0] != 0:
            return -1
        size = math.inf
        if k > 0:
            i, size = k - 1, 0.0
            innovations[k, 0], innovations[k, 1] = unscented_step(
                states[i], roots[i], data[k], times[k] - times[i], speed[i], speed[k] - speed[i],
                steering[i], steering[k] - steering[i], p, loads, noise, drift, rejected, states[k], roots[k],
            )  # fmt: skip
            for j in range(SIZE):
                size += abs(states[k, j]) + abs(roots[k, j, j])
        if not (size < math.inf and roots[k, 0, 0] < most):
            lost += k > 0
            innovations[k, 0], innovations[k, 1] = unscented_step(
                initial[:, 0].copy(), begin, data[k], 0.0, speed[k], 0.0, steering[k], 0.0,
                p, loads, noise, drift, rejected, states[k], roots[k],
            )  # fmt: skip
        slides[k] = is_sliding(states[k], speed[k], steering[k], p, loads)
    return lost


@kernel(interpretable=True)
def is_sliding(x: Floats, u: float, delta: float, p: Floats, loads: Floats) -> bool:
    """Return True if an axle slides: more slip adds less than 5 % of the force that it adds at small slip and static loads."""
    own = np.empty(len(p))
    adapt(p, loads, x, own)
    _, _, front, rear = axle_forces(x[0], x[1], u, delta, own)
    return bool(front < _SLIDES * own[4] or rear < _SLIDES * own[5])
