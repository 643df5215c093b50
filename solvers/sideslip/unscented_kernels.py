"""Kernels of the unscented filter of vehicle, tyres and sensors.

The state is x = (β, ω, s, φ, b_ω, b_a, f, r): sideslip angle (rad), yaw rate (rad/s), inverse of the friction (s = 1/μ), bank
angle of the road (rad, positive if the left side is higher), biases of yaw rate (rad/s) and lateral acceleration (m/s²),
mass factor, which multiplies mass and yaw inertia, and balance, which multiplies the front and the rear cornering stiffness
by 1 + r and 1 - r. Linear tyres are the case s = 0 of the brush model.

The covariance P = R Rᵀ is stored as its lower triangular root R. Prediction and update rotate a matrix to lower triangular form,
so P is positive semidefinite in floating-point arithmetic, too (I. Arasaratnam and S. Haykin, Cubature Kalman filters, IEEE
Transactions on Automatic Control 54, 2009, appendix B). The 2 n points are those of S. Julier and J. Uhlmann (Unscented filtering
and nonlinear estimation, Proceedings of the IEEE 92, 2004) with κ = 0: their weights are positive.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.sideslip.data import GRAVITY, LOW_SPEED
from ...models.sideslip.dynamics import LONGEST_STEP, axle_forces, flow, measured, rates

__all__ = ["SIZE", "find_slides", "unscented_path", "unscented_step"]

Floats = NDArray[np.float64]

#: Number of states.
SIZE = 8
#: Smallest inverse friction of a tyre with a limit, smallest mass factor and largest balance.
_LEAST_INVERSE, _LEAST_FACTOR, _MOST_BALANCE = 1e-3, 0.05, 0.8
#: Share of the cornering stiffness below which more slip adds no force: 98.9 % of the brush model's largest force.
_SLIDES = 0.05
#: Number of samples between two checks of the stop flag.
_SAMPLES = 256


@kernel
def adapt(p: Floats, loads: Floats, x: Floats, own: Floats) -> None:
    """Fill `own` with the vehicle `p`, changed by the inverse friction, the mass factor and the balance of the state."""
    inverse, factor = x[2], max(x[6], _LEAST_FACTOR)
    balance = min(max(x[7], -_MOST_BALANCE), _MOST_BALANCE)
    for j in range(len(p)):
        own[j] = p[j]
    own[0], own[1] = factor * p[0], factor * p[1]
    own[4], own[5] = (1.0 + balance) * p[4], (1.0 - balance) * p[5]
    own[6] = own[7] = math.inf
    if inverse > _LEAST_INVERSE:
        own[6], own[7] = factor * loads[0] / inverse, factor * loads[1] / inverse


@kernel
def move(
    beta: float, omega: float, bank: float, dt: float, u: float, du: float, delta: float, ddelta: float, own: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Return angle and yaw rate after `dt`, as :func:`crosstrack.models.sideslip.dynamics.advance` on a banked road."""
    count = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
    h = dt / count
    for i in range(count):
        at = (i + 0.5) / count
        v = u + at * du
        f, g, q, r, s, t = rates(beta, omega, v, delta + at * ddelta, own)
        f -= GRAVITY * math.sin(bank) / max(v, LOW_SPEED)
        e = flow(h * q, h * r, h * s, h * t)
        beta, omega = beta + h * (e[4] * f + e[5] * g), omega + h * (e[6] * f + e[7] * g)
    return beta, omega


@kernel
def triangulate(a: Floats, rows: int, columns: int) -> None:
    """Replace A by the lower triangular matrix T with T Tᵀ = A Aᵀ and a diagonal >= 0, by Householder reflections."""
    for i in range(rows):
        size = 0.0
        for j in range(i, columns):
            size += a[i, j] * a[i, j]
        size = math.sqrt(size)
        if not size > 0.0:
            for j in range(i + 1, columns):
                a[i, j] = 0.0
            continue
        head = a[i, i]
        # v = row + sign(head) size e_i avoids cancellation; the row becomes -sign(head) size e_i.
        a[i, i] = head + math.copysign(size, head)
        square = 2.0 * size * (size + abs(head))
        for k in range(i + 1, rows):
            dot = 0.0
            for j in range(i, columns):
                dot += a[k, j] * a[i, j]
            dot *= 2.0 / square
            for j in range(i, columns):
                a[k, j] -= dot * a[i, j]
        a[i, i] = -math.copysign(size, head)
        for j in range(i + 1, columns):
            a[i, j] = 0.0
        if a[i, i] < 0.0:
            for k in range(i, rows):
                a[k, i] = -a[k, i]


@kernel
def spread_points(x: Floats, root: Floats, points: Floats) -> None:
    """Fill `points`, shape (16, 8), with x ± √8 times each column of the root."""
    far = math.sqrt(SIZE)
    for i in range(SIZE):
        for j in range(SIZE):
            points[i, j] = x[j] + far * root[j, i]
            points[SIZE + i, j] = x[j] - far * root[j, i]


@kernel(interpretable=True, allocates=True)
def unscented_step(
    x: Floats, root: Floats, z: Floats, dt: float, u: float, du: float, delta: float, ddelta: float,
    p: Floats, loads: Floats, noise: Floats, drift: Floats, new_x: Floats, new_root: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Predict the state by `dt` seconds and update it with a sample.

    Parameters
    ----------
    x, root : ndarray, shape (8,), (8, 8)
        State at the sample before, and lower triangular root of its covariance.
    z : ndarray, shape (2,)
        Measured yaw rate (rad/s) and lateral acceleration (m/s²); NaN for a measurement that is missing.
    dt, u, du, delta, ddelta : float
        Seconds since the sample before, speed (m/s) and steering angle (rad) at that sample and their changes since then.
        With ``dt = 0`` the state is that before the first sample, and only the update is computed.
    p, loads : ndarray, shape (m,), (2,)
        Parameters of the vehicle, see :func:`~crosstrack.models.sideslip.dynamics.parameters`, and static loads of the axles (N).
    noise : ndarray, shape (4,)
        Variances of angle and yaw rate per second, and of both measurements.
    drift : ndarray, shape (6, 3)
        Usual value, standard deviation and time constant (s) of s, φ, b_ω, b_a, f and r. Each returns to its usual value.
    new_x, new_root : ndarray, shape (8,), (8, 8)
        Output: the state after the update and the root of its covariance.

    Returns
    -------
    tuple of float
        Square of the normalised innovation, and the number of measurements that were used.
    """
    points, own = np.empty((2 * SIZE, SIZE)), np.empty(len(p))
    a = np.empty((SIZE + 2, 3 * SIZE))
    middle = np.empty(SIZE)
    part = 1.0 / math.sqrt(2.0 * SIZE)
    for i in range(SIZE):
        middle[i] = x[i]
        for j in range(SIZE):
            new_root[i, j] = root[i, j]
    if dt > 0.0:
        spread_points(x, root, points)
        for k in range(2 * SIZE):
            adapt(p, loads, points[k], own)
            points[k, 0], points[k, 1] = move(
                points[k, 0], points[k, 1], points[k, 3], dt, u, du, delta, ddelta, own
            )
            for j in range(SIZE - 2):
                stay = math.exp(-dt / drift[j, 2])
                points[k, 2 + j] = drift[j, 0] + stay * (points[k, 2 + j] - drift[j, 0])
        for i in range(SIZE):
            total = 0.0
            for k in range(2 * SIZE):
                total += points[k, i]
            middle[i] = total / (2 * SIZE)
            for k in range(2 * SIZE):
                a[i, k] = part * (points[k, i] - middle[i])
            for k in range(SIZE):
                a[i, 2 * SIZE + k] = 0.0
            if i < 2:
                a[i, 2 * SIZE + i] = math.sqrt(noise[i] * dt)
            else:
                lost = -math.expm1(-2.0 * dt / drift[i - 2, 2])
                a[i, 2 * SIZE + i] = drift[i - 2, 1] * math.sqrt(lost)
        triangulate(a, SIZE, 3 * SIZE)
        for i in range(SIZE):
            for j in range(SIZE):
                new_root[i, j] = a[i, j]
    return update(
        middle, new_root, z, u + du, delta + ddelta, p, loads, noise, points, own, a, new_x
    )


@kernel
def update(
    middle: Floats, root: Floats, z: Floats, u: float, delta: float, p: Floats, loads: Floats, noise: Floats,
    points: Floats, own: Floats, a: Floats, new_x: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Update the predicted state and its root with a sample; `points`, `own` and `a` are work arrays."""
    part = 1.0 / math.sqrt(2.0 * SIZE)
    columns = 2 * SIZE + 2
    spread_points(middle, root, points)
    yaw_rate, acceleration = 0.0, 0.0
    for k in range(2 * SIZE):
        adapt(p, loads, points[k], own)
        value, _, _ = measured(points[k, 0], points[k, 1], u, delta, own)
        a[0, k], a[1, k] = points[k, 1] + points[k, 4], value + points[k, 5]
        yaw_rate += a[0, k] / (2 * SIZE)
        acceleration += a[1, k] / (2 * SIZE)
        for i in range(SIZE):
            a[2 + i, k] = part * (points[k, i] - middle[i])
    for k in range(2 * SIZE):
        a[0, k], a[1, k] = part * (a[0, k] - yaw_rate), part * (a[1, k] - acceleration)
    for i in range(SIZE + 2):
        a[i, columns - 2] = a[i, columns - 1] = 0.0
    a[0, columns - 2], a[1, columns - 1] = math.sqrt(noise[2]), math.sqrt(noise[3])
    first, second, used = z[0] - yaw_rate, z[1] - acceleration, 2.0
    for i in range(2):
        if math.isnan(z[i]):  # a row without relation to the state
            used -= 1.0
            for k in range(2 * SIZE):
                a[i, k] = 0.0
            if i == 0:
                first = 0.0
            else:
                second = 0.0
    triangulate(a, SIZE + 2, columns)
    # Normalised innovations, by forward substitution.
    first /= a[0, 0]
    second = (second - a[1, 0] * first) / a[1, 1]
    for i in range(SIZE):
        new_x[i] = middle[i] + a[2 + i, 0] * first + a[2 + i, 1] * second
        for j in range(SIZE):
            root[i, j] = a[2 + i, 2 + j]
    return first * first + second * second, used


@kernel(interpretable=True, allocates=True)
def unscented_path(
    times: Floats, speed: Floats, steering: Floats, data: Floats,
    p: Floats, loads: Floats, noise: Floats, drift: Floats, initial: Floats, most: float,
    states: Floats, roots: Floats, innovations: Floats, flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Run the filter over a drive; return the number of restarts, or -1 if `flag` stopped it.

    `data`, shape (n, 2), is NaN for measurements that are not used. `initial`, shape (8, 2), is the state before the first
    sample and its deviations. At a deviation of the angle above `most` the filter restarts. Output: `states`, shape (n, 8), `roots`,
    shape (n, 8, 8), and `innovations`, shape (n, 2): the normalised squares and the numbers of measurements.
    """
    lost = 0
    begin = np.zeros((SIZE, SIZE))
    for i in range(SIZE):
        begin[i, i] = initial[i, 1]
    for k in range(len(times)):
        if k % _SAMPLES == 0 and flag[0] != 0:
            return -1
        if k > 0:
            innovations[k, 0], innovations[k, 1] = unscented_step(
                states[k - 1], roots[k - 1], data[k], times[k] - times[k - 1],
                speed[k - 1], speed[k] - speed[k - 1], steering[k - 1], steering[k] - steering[k - 1],
                p, loads, noise, drift, states[k], roots[k],
            )  # fmt: skip
            size = 0.0
            for j in range(SIZE):
                size += abs(states[k, j]) + abs(roots[k, j, j])
            if abs(roots[k, 0, 0]) < most and size < math.inf:
                continue
            lost += 1
        innovations[k, 0], innovations[k, 1] = unscented_step(
            initial[:, 0], begin, data[k], 0.0, speed[k], 0.0, steering[k], 0.0,
            p, loads, noise, drift, states[k], roots[k],
        )  # fmt: skip
    return lost


@kernel(interpretable=True, allocates=True)
def find_slides(
    states: Floats, speed: Floats, steering: Floats, p: Floats, loads: Floats,
    slides: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Fill `slides`, shape (n,): True if an axle slides, that is, more slip adds less than 5 % of the force at small slip."""
    own = np.empty(len(p))
    for k in range(len(states)):
        adapt(p, loads, states[k], own)
        _, _, front, rear = axle_forces(states[k, 0], states[k, 1], speed[k], steering[k], own)
        slides[k] = front < _SLIDES * own[4] or rear < _SLIDES * own[5]
