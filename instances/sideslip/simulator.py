"""Simulation of a vehicle on a road, which gives the true angle.

The single-track model is implemented here independently of the estimators, so that no estimator is tested against
itself. It is integrated by the classic Runge-Kutta method in steps of at most 25 ms, or less if the model is
stiff. The driver follows Guo's preview follower theory (K. Guo and H. Guan, Modelling of driver/vehicle
directional control system, Vehicle System Dynamics 22, 1993), as in the paper. The lateral acceleration
``2/T² (f - y - T v)`` would bring the vehicle onto the course ``f`` at the preview time T. The steering angle is this
acceleration times ``C_0 (1 + T_c s) e^(-T_d s) / (1 + T_h s)``. The gain C_0 of a steady turn is
``L / u² + m (b / C_f - a / C_r) / L``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import kernel
from ...models.sideslip.data import LOW_SPEED, Tyre, Vehicle
from .drivers import Driver
from .roads import Road

__all__ = ["STEERING_LIMIT", "Drive", "simulate"]

Floats = NDArray[np.float64]
Row = tuple[float, ...]

#: Largest steering angle of the front wheels, rad.
STEERING_LIMIT = math.radians(30.0)
#: Longest integration step, s, and largest product of the step and the fastest decay rate.
STEP, STIFFEST = 0.025, 0.5
#: Largest number of integration steps of a drive.
MOST_STEPS = 50_000_000
#: Lower limit (m/s) of the speed in the driver's gain.
SLOW = 3.0


class Drive(NamedTuple):
    """Simulated drive with one entry per sample, each of shape (n,).

    `x` and `y` are the position along the road and to its left, m; `heading` is relative to the road,
    and `sideslip` the angle of the velocity relative to the heading, both rad and positive to the left.
    Rates and the steering angle of the front wheels are in rad/s and rad. `lateral_acceleration` is the
    sum of the axle forces divided by the mass, m/s².
    """

    x: Floats
    y: Floats
    heading: Floats
    sideslip: Floats
    yaw_rate: Floats
    steering: Floats
    lateral_acceleration: Floats


def simulate(
    vehicle: Vehicle, road: Road, driver: Driver, speed: Floats, friction: Floats,
    shocks: Floats, period: float,
) -> Drive:  # fmt: skip
    """Simulate a drive along a road. Position, angles and rates are zero at the start.

    `speed`, shape (n,), is the forward speed at each sample, m/s, interpolated linearly; a vehicle at
    rest does not turn. `friction`, shape (n,), applies from each sample to the next and is unused for
    linear tyres; that of `vehicle` is not read. `shocks`, shape (n, 2), are added to sideslip angle
    (rad) and yaw rate (rad/s) at each sample after the first. `period` is the time between samples, s.

    Raise :class:`InvalidData` if the vehicle spins, which means that its sideslip angle reaches 90°, or
    if the model is too stiff for the largest number of steps.
    """
    v = vehicle
    if v.tyre is Tyre.MAGIC_FORMULA or v.load_loss > 0.0:
        text = f"tyre must be linear or saturating and load_loss 0 for simulated drives, got {v.tyre} and"
        raise InvalidData(f"{text} {v.load_loss:g}", field="tyre")
    slowest = max(float(speed.min()), LOW_SPEED)
    decay = (v.cornering_front + v.cornering_rear) / v.mass
    decay += (v.front**2 * v.cornering_front + v.rear**2 * v.cornering_rear) / v.yaw_inertia
    steps = math.ceil(period * max(1.0 / STEP, decay / slowest / STIFFEST))
    if steps * len(speed) > MOST_STEPS:
        raise InvalidData(
            f"period {period:g} s takes {steps} steps of the integration, {steps * len(speed)} for all samples, where "
            f"at most {MOST_STEPS} are allowed: the vehicle is too stiff",
            field="vehicle",
        )
    needed = v.mass * (v.rear / v.cornering_front - v.front / v.cornering_rear) / v.wheelbase
    # Tuples: without compilation Python numbers are several times as fast as array elements.
    parameters = (
        *(v.mass, v.yaw_inertia, v.front, v.rear, v.cornering_front, v.cornering_rear),
        needed,
    )
    grip = friction if v.tyre is Tyre.SATURATING else np.full(len(speed), math.inf)
    limits = grip[:, None] * np.array(v.loads)
    style = (driver.preview, driver.correction, driver.gain, driver.delay, driver.lag)
    result = np.zeros((7, len(speed)))
    demand = np.zeros(steps * (len(speed) - 1) + 1)
    _drive(
        parameters, road.along, road.aside, road.sine, style, np.asarray(speed, dtype=float), limits, shocks,
        period / steps, steps, demand, result,
    )  # fmt: skip
    if not (np.abs(result[3]) < 0.5 * math.pi).all():
        first = int(np.flatnonzero(~(np.abs(result[3]) < 0.5 * math.pi))[0])
        raise InvalidData(
            f"the vehicle spins {first * period:g} s after the start, and its sideslip angle must stay below 90°: "
            "choose a lower speed, more friction or another driver",
            field="speed",
        )
    return Drive(*result)


@kernel
def _force(angle: float, stiffness: float, limit: float) -> float:
    """Return the lateral force (N) of an axle by Fiala's brush model."""
    if abs(angle) >= 0.5 * math.pi:
        return math.copysign(limit, angle)
    part = stiffness * math.tan(angle) / (3.0 * limit)
    if abs(part) >= 1.0:
        return math.copysign(limit, angle)
    return limit * part * (3.0 - 3.0 * abs(part) + part * part)


@kernel
def _rates(
    p: Row, speed: float, steering: float, sideslip: float, yaw_rate: float, front: float,
    rear: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the time derivatives of angle and yaw rate, and the lateral acceleration."""
    least = max(speed, LOW_SPEED)
    # Slip by the lateral speed of each axle, which vanishes at rest for any angle.
    aside = speed * sideslip
    front_slip = (speed * steering - aside - p[2] * yaw_rate) / least
    rear_slip = (p[3] * yaw_rate - aside) / least
    # An infinite limit marks linear tyres.
    front_force = p[4] * front_slip if front == math.inf else _force(front_slip, p[4], front)
    rear_force = p[5] * rear_slip if rear == math.inf else _force(rear_slip, p[5], rear)
    acceleration = (front_force + rear_force) / p[0]
    turn = (p[2] * front_force - p[3] * rear_force) / p[1]
    return acceleration / least - yaw_rate, turn, acceleration


@kernel
def _aside(along: Floats, aside: Floats, sine: bool, at: float, piece: int) -> tuple[float, int]:
    """Return the lateral position of the road at `at` (m), and its segment, searched from `piece`."""
    last = len(along) - 2
    while piece < last and along[piece + 1] < at:
        piece += 1
    while piece > 0 and along[piece] > at:
        piece -= 1
    share = (at - along[piece]) / (along[piece + 1] - along[piece])
    share = min(max(share, 0.0), 1.0)
    rise = share * share * (3.0 - 2.0 * share)
    if sine:
        rise = 0.5 - 0.5 * math.cos(math.pi * share)
    return float(aside[piece] + (aside[piece + 1] - aside[piece]) * rise), piece


@kernel(interpretable=True)
def _drive(
    p: Row, along: Floats, aside: Floats, sine: bool, style: Row, speeds: Floats, limits: Floats,
    shocks: Floats, h: float, steps: int, demand: Floats, output: Floats,
) -> None:  # fmt: skip
    """Fill `demand` with the driver's steering before delay and lag, and `output` with the drive.

    The steering angle is linear in time within an integration step.
    """
    preview, correction, gain, late, lag = style[0], style[1], style[2], style[3] / h, style[4]
    x, y, heading, sideslip, yaw_rate, steering, muscle = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    fade = 1.0 - math.exp(-h / lag)
    piece, now = 0, 0
    for k in range(len(speeds)):
        if k > 0:
            front, rear = float(limits[k - 1, 0]), float(limits[k - 1, 1])
            begin = float(speeds[k - 1])
            growth = (float(speeds[k]) - begin) / steps
            for j in range(steps):
                u0 = begin + growth * j
                u1 = u0 + 0.5 * growth
                u2 = u0 + growth
                goal, piece = _aside(along, aside, sine, x + preview * u0, piece)
                drift = u0 * math.sin(heading + sideslip)
                least = max(u0, SLOW)
                factor = gain * ((p[2] + p[3]) / (least * least) + p[6])
                demand[now] = factor * 2.0 * (goal - y - preview * drift) / (preview * preview)
                before = max(now - late, 0.0)
                whole = int(before)
                delayed = float(demand[whole])
                if whole < now:
                    delayed += (before - whole) * (float(demand[whole + 1]) - delayed)
                muscle += fade * (delayed - muscle)
                next_steering = muscle + correction * (delayed - muscle) / lag
                next_steering = min(max(next_steering, -STEERING_LIMIT), STEERING_LIMIT)
                half = 0.5 * (steering + next_steering)
                # Classic Runge-Kutta.
                a1, b1, _ = _rates(p, u0, steering, sideslip, yaw_rate, front, rear)
                s1, w1 = sideslip + 0.5 * h * a1, yaw_rate + 0.5 * h * b1
                a2, b2, _ = _rates(p, u1, half, s1, w1, front, rear)
                s2, w2 = sideslip + 0.5 * h * a2, yaw_rate + 0.5 * h * b2
                a3, b3, _ = _rates(p, u1, half, s2, w2, front, rear)
                s3, w3 = sideslip + h * a3, yaw_rate + h * b3
                a4, b4, _ = _rates(p, u2, next_steering, s3, w3, front, rear)
                c1 = heading + sideslip
                c2, c3 = heading + 0.5 * h * yaw_rate + s1, heading + 0.5 * h * w1 + s2
                c4 = heading + h * w2 + s3
                middle = 2.0 * u1 * (math.cos(c2) + math.cos(c3))
                x += h / 6.0 * (u0 * math.cos(c1) + middle + u2 * math.cos(c4))
                middle = 2.0 * u1 * (math.sin(c2) + math.sin(c3))
                y += h / 6.0 * (u0 * math.sin(c1) + middle + u2 * math.sin(c4))
                heading += h / 6.0 * (yaw_rate + 2.0 * (w1 + w2) + w3)
                sideslip += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
                yaw_rate += h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)
                steering = next_steering
                now += 1
            sideslip += float(shocks[k, 0])
            yaw_rate += float(shocks[k, 1])
        _, _, acceleration = _rates(
            p, speeds[k], steering, sideslip, yaw_rate, limits[k, 0], limits[k, 1]
        )
        output[0, k], output[1, k], output[2, k] = x, y, heading
        output[3, k], output[4, k], output[5, k] = sideslip, yaw_rate, steering
        output[6, k] = acceleration
