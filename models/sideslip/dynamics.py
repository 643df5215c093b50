"""The single-track model of the estimators in discrete time, and its derivatives.

Both tyre laws use the exponential Rosenbrock-Euler method. It is exact for linear tyres
at constant speed and steering, and stays accurate when the model becomes stiff at low speed
(Hochbruck and Ostermann, Exponential integrators, Acta Numerica 2010).

Angles are in rad, rates in rad/s, speeds in m/s, forces in N and times in s throughout.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .data import GRAVITY, LOW_SPEED, Tyre, Vehicle
from .model import SideslipEstimation

__all__ = [
    "LONGEST_STEP",
    "Linearised",
    "advance",
    "axle_force",
    "congruence",
    "flow",
    "linearise",
    "magic_force",
    "measured",
    "parameters",
    "rates",
]

Floats = NDArray[np.float64]
Numbers4 = tuple[float, float, float, float]
Numbers6 = tuple[float, float, float, float, float, float]
Numbers8 = tuple[float, float, float, float, float, float, float, float]

#: Longest integration step (s). Longer times between samples are divided.
LONGEST_STEP = 0.02
#: Norm up to which the series is summed, and its number of terms: the remainder is below rounding.
_NORM, _TERMS = 0.5, 14


class Linearised(NamedTuple):
    """Model linearised about a state at each of n samples.

    Without noise ``x[k + 1] = step[k] @ x[k] + shift[k]`` and ``z[k] = slope[k] @ x[k] + level[k]``, in
    which z are yaw rate and lateral acceleration. The shapes are (n - 1, 2, 2), (n - 1, 2), (n, 2, 2)
    and (n, 2).
    """

    step: Floats
    shift: Floats
    slope: Floats
    level: Floats

    @classmethod
    def empty(cls, count: int) -> Linearised:
        """Return uninitialised arrays for `count` samples."""
        shapes = (count - 1, 2, 2), (count - 1, 2), (count, 2, 2), (count, 2)
        return cls(*(np.empty(shape) for shape in shapes))


def parameters(vehicle: Vehicle) -> Floats:
    """Return the parameter vector of a vehicle for the kernels, shape (11,).

    It holds m, I, a, b, C_f, C_r, the largest forces (N) of both axles, which are infinite for linear tyres, shape and
    curvature of the Magic Formula, with shape 0 for other laws, and the loss by load transfer per (m/s²)².
    """
    limits, law = [math.inf, math.inf], [0.0, 0.0, 0.0]
    if vehicle.tyre is not Tyre.LINEAR:
        limits = [vehicle.friction * load for load in vehicle.loads]
        law[2] = vehicle.load_loss / GRAVITY**2
    if vehicle.tyre is Tyre.MAGIC_FORMULA:
        law[:2] = vehicle.shape, vehicle.curvature
    return np.array(
        [
            *(vehicle.mass, vehicle.yaw_inertia, vehicle.front, vehicle.rear),
            *(vehicle.cornering_front, vehicle.cornering_rear),
            *limits,
            *law,
        ]
    )


def linearise(problem: SideslipEstimation, states: Floats, first: int = 0) -> Linearised:
    """Return the model linearised about the states of consecutive samples, shape (n, 2), from sample `first` on.

    Only the vehicle and the recording's times, speed and steering are used. For linear tyres the states
    affect the result by rounding only.
    """
    drive, part = problem.recording, slice(first, first + len(states))
    linear = Linearised.empty(len(states))
    linearise_path(
        *(drive.times[part], drive.speed[part], drive.steering[part]),
        *(parameters(problem.vehicle), np.ascontiguousarray(states, dtype=float), *linear),
    )
    return linear


@kernel
def axle_force(slip: float, stiffness: float, most: float) -> tuple[float, float]:
    """Return an axle's lateral force (N) at a slip angle (rad), and its derivative (N/rad).

    If `most` is infinite, the law is linear with the stiffness (N/rad). Otherwise it is E. Fiala's brush
    model (VDI-Zeitschrift 96, 1954) in the tangent of the slip angle, as in R. Rajamani, Vehicle
    Dynamics and Control (2012), section 13.7. The force is `most` once the whole contact patch slides.
    """
    if math.isinf(most):
        return stiffness * slip, stiffness
    size = abs(slip)
    if size < 0.5 * math.pi:
        tangent = math.tan(size)
        grip = 1.0 - stiffness * tangent / (3.0 * most)
        if grip > 0.0:
            # Factor 1 - grip³ to avoid cancellation at small slip angles.
            force = stiffness * tangent / 3.0 * (1.0 + grip + grip * grip)
            return math.copysign(force, slip), stiffness * grip * grip * (1.0 + tangent * tangent)
    return math.copysign(most, slip), 0.0


@kernel
def magic_force(
    slip: float, stiffness: float, most: float, shape: float, curvature: float
) -> tuple[float, float]:
    """Return the force (N) and its derivative (N/rad) by the Magic Formula; by :func:`axle_force` if `shape` is 0.

    The law is ``D sin(C atan(x - E (x - atan x)))`` with x = stiffness slip / (C D), D = `most`, C = `shape` and E =
    `curvature` (H. B. Pacejka, Tire and Vehicle Dynamics, 2012, equation 4.6).
    """
    if shape == 0.0 or math.isinf(most):
        return axle_force(slip, stiffness, most)
    x = stiffness * slip / (shape * most)
    bent = x - curvature * (x - math.atan(x))
    turn = shape * math.atan(bent)
    slope = stiffness * math.cos(turn) / (1.0 + bent * bent)
    return most * math.sin(turn), slope * (1.0 - curvature * (1.0 - 1.0 / (1.0 + x * x)))


@kernel
def axle_forces(beta: float, omega: float, u: float, delta: float, p: Floats) -> Numbers4:
    """Return front and rear axle forces, and their derivatives with respect to the slip angles.

    The load transfer follows from the lateral acceleration u ω of a steady turn. Derivatives neglect its change.
    """
    v = max(u, LOW_SPEED)
    left = max(1.0 - p[10] * (u * omega) * (u * omega), 0.2) if p[10] > 0.0 else 1.0
    front_slip, rear_slip = delta - beta - p[2] * omega / v, p[3] * omega / v - beta
    front, front_slope = magic_force(front_slip, left * p[4], left * p[6], p[8], p[9])
    rear, rear_slope = magic_force(rear_slip, left * p[5], left * p[7], p[8], p[9])
    return front, rear, front_slope, rear_slope


@kernel
def rates(beta: float, omega: float, u: float, delta: float, p: Floats) -> Numbers6:
    """Return dβ/dt, dω/dt and the Jacobian with respect to the state, row by row.

    `u` and `delta` are speed and steering angle, and `p` the vehicle, see :func:`parameters`. Speeds
    below 1 m/s are replaced by 1 m/s.
    """
    v = max(u, LOW_SPEED)
    front, rear, c, d = axle_forces(beta, omega, u, delta, p)
    turn = p[3] * d - p[2] * c
    return (
        (front + rear) / (p[0] * v) - omega, (p[2] * front - p[3] * rear) / p[1],
        -(c + d) / (p[0] * v), turn / (p[0] * v * v) - 1.0, turn / p[1],
        -(p[2] * p[2] * c + p[3] * p[3] * d) / (p[1] * v),
    )  # fmt: skip


@kernel
def measured(
    beta: float, omega: float, u: float, delta: float, p: Floats
) -> tuple[float, float, float]:
    """Return the lateral acceleration ``(F_f + F_r) / m``, m/s², and its derivatives by the state.

    The yaw rate is measured directly and needs no function. The arguments are those of :func:`rates`.
    """
    front, rear, c, d = axle_forces(beta, omega, u, delta, p)
    slope = (p[3] * d - p[2] * c) / max(u, LOW_SPEED)
    return (front + rear) / p[0], -(c + d) / p[0], slope / p[0]


@kernel
def flow(a: float, b: float, c: float, d: float) -> Numbers8:
    """Return exp(A) and φ₁(A) = ∫ exp(s A) ds over [0, 1] for A = [[a, b], [c, d]], row by row.

    The series of φ₁ is evaluated at A / 2^m and doubled m times with φ₁(2A) = φ₁(A) (exp(A) + I) / 2.
    This uses no eigenvalues and stays accurate if they nearly coincide. The result is NaN if A is not finite.
    """
    # Upper bound on the norm of A after its variables are scaled so that |b| = |c|.
    norm = abs(a) + abs(d) + math.sqrt(abs(b)) * math.sqrt(abs(c))
    if not norm < math.inf:
        nan = math.nan
        return nan, nan, nan, nan, nan, nan, nan, nan
    doublings = 0
    part = 1.0
    while norm * part > _NORM:
        part *= 0.5
        doublings += 1
    a, b, c, d = part * a, part * b, part * c, part * d
    # Horner's rule: φ₁ = I + A/2 (I + A/3 (I + …)).
    p, q, r, s = 1.0, 0.0, 0.0, 1.0
    for k in range(_TERMS, 1, -1):
        p, r = 1.0 + (a * p + b * r) / k, (c * p + d * r) / k
        q, s = (a * q + b * s) / k, 1.0 + (c * q + d * s) / k
    e, f, g, h = 1.0 + a * p + b * r, a * q + b * s, c * p + d * r, 1.0 + c * q + d * s
    for _ in range(doublings):
        p, q = 0.5 * (p + p * e + q * g), 0.5 * (q + p * f + q * h)
        r, s = 0.5 * (r + r * e + s * g), 0.5 * (s + r * f + s * h)
        e, f, g, h = e * e + f * g, f * (e + h), g * (e + h), h * h + f * g
    return e, f, g, h, p, q, r, s


@kernel
def advance(
    beta: float, omega: float, dt: float, u: float, du: float, delta: float, ddelta: float,
    p: Floats,
) -> Numbers6:  # fmt: skip
    """Return the noise-free state after `dt`, and its Jacobian by the current state, row by row.

    Speed and steering change by `du` and `ddelta` and are interpolated linearly. Each step of at most
    :data:`LONGEST_STEP` uses their values at its midpoint. The Jacobian is the product of the steps'
    ``exp(h J)``.
    """
    count = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
    h = dt / count
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    for i in range(count):
        at = (i + 0.5) / count
        f, g, q, r, s, t = rates(beta, omega, u + at * du, delta + at * ddelta, p)
        e = flow(h * q, h * r, h * s, h * t)
        beta, omega = beta + h * (e[4] * f + e[5] * g), omega + h * (e[6] * f + e[7] * g)
        a, c = e[0] * a + e[1] * c, e[2] * a + e[3] * c
        b, d = e[0] * b + e[1] * d, e[2] * b + e[3] * d
    return beta, omega, a, b, c, d


@kernel
def congruence(
    w: float, m: float, u: float, v: float, a: float, b: float, c: float
) -> tuple[float, float, float]:
    """Return a, b, c of M P Mᵀ for M = [[w, m], [u, v]] and P = [[a, b], [b, c]]."""
    p, q, r, s = w * a + m * b, w * b + m * c, u * a + v * b, u * b + v * c
    return p * w + q * m, p * u + q * v, r * u + s * v


@kernel(interpretable=True)
def linearise_path(
    times: Floats, speed: Floats, steering: Floats, p: Floats, states: Floats,
    step: Floats, shift: Floats, slope: Floats, level: Floats,
) -> None:  # fmt: skip
    """Fill in the arrays of a :class:`Linearised` for the given states."""
    n = len(times)
    for k in range(n):
        beta, omega = states[k, 0], states[k, 1]
        linearise_measurement(k, beta, omega, speed, steering, p, slope, level)
        if k + 1 < n:
            linearise_step(k, beta, omega, times, speed, steering, p, step, shift)


@kernel
def linearise_measurement(
    k: int, beta: float, omega: float, speed: Floats, steering: Floats, p: Floats,
    slope: Floats, level: Floats,
) -> None:  # fmt: skip
    """Fill in the measurement equations of sample k, linearised about the given state."""
    value, by_beta, by_omega = measured(beta, omega, speed[k], steering[k], p)
    slope[k, 0, 0], slope[k, 0, 1], level[k, 0] = 0.0, 1.0, 0.0
    slope[k, 1, 0], slope[k, 1, 1] = by_beta, by_omega
    level[k, 1] = value - by_beta * beta - by_omega * omega


@kernel
def linearise_step(
    k: int, beta: float, omega: float, times: Floats, speed: Floats, steering: Floats, p: Floats,
    step: Floats, shift: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Fill in the transition from sample k, linearised about the given state; return the next state."""
    next_beta, next_omega, a, b, c, d = advance(
        beta, omega, times[k + 1] - times[k], speed[k], speed[k + 1] - speed[k],
        steering[k], steering[k + 1] - steering[k], p,
    )  # fmt: skip
    step[k, 0, 0], step[k, 0, 1], step[k, 1, 0], step[k, 1, 1] = a, b, c, d
    shift[k, 0] = next_beta - a * beta - b * omega
    shift[k, 1] = next_omega - c * beta - d * omega
    return next_beta, next_omega
