"""Diagnosis of a recording, the vehicle parameters and the training drives before the estimation.

The linear range of tyres, up to about 4 m/s² on a dry road, and the stability criterion are those of R. Rajamani
(Vehicle Dynamics and Control, 2012, chapters 3 and 13).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ...models.sideslip.data import GRAVITY, Tyre, Vehicle
from ...models.sideslip.model import SideslipEstimation
from ..run.diagnosis import Diagnosis
from .signals import Remark, asks, signal_remarks, tells

__all__ = ["critical_speed", "diagnose_sideslip", "gramian"]

Floats = NDArray[np.float64]

#: Lateral acceleration (m/s²) up to which tyres are about linear on a dry road.
_LINEAR_UP_TO = 4.0
#: Share of an axle's stiffness below which its force is insensitive to the angle.
_SLIDING = 0.3
#: Condition number of the Gramian above which the angle is reported as unobservable.
_HIDDEN = 1e6
#: Ratio of two sampling periods above which lagged features are not comparable.
_UNLIKE = 1.5


def diagnose_sideslip(model: SideslipEstimation, time_limit: float | None = None) -> Diagnosis:
    """Return findings about a recording, the vehicle parameters and the training drives.

    The model is always feasible, because every angle below 90° is a plan. The findings check its data.
    Findings that need attention come first. The truth is not read.

    Parameters
    ----------
    model : SideslipEstimation
        The model.
    time_limit : float, optional
        Not used.
    """
    with np.errstate(all="ignore"):  # an overflow gives no finding
        result = [*signal_remarks(model), *_stability(model), *_tyres(model)]
        result += [*_observability(model), *_training(model)]
    asking = [entry.finding for entry in result if entry.asks]
    others = [entry.finding for entry in result if not entry.asks]
    odd = {0: "nothing looks odd", 1: "1 finding asks for a look"}.get(
        len(asking), f"{len(asking)} findings ask for a look"
    )
    summary = f"a plan exists, for every angle below 90° is one; {odd}"
    method = "sampling, signs, units, noise, stability and observability"
    return Diagnosis(model.name, True, method, summary, (*asking, *others))


def critical_speed(vehicle: Vehicle) -> float:
    """Return the critical speed of a vehicle with linear tyres, m/s; infinite if it does not oversteer.

    A vehicle that oversteers, ``a C_f > b C_r``, is unstable above ``L √(C_f C_r / (m (a C_f - b
    C_r)))``.
    """
    front, rear = np.float64(vehicle.cornering_front), np.float64(vehicle.cornering_rear)
    over = vehicle.front * front - vehicle.rear * rear
    return (
        vehicle.wheelbase * math.sqrt(front / vehicle.mass * (rear / over))
        if over > 0
        else math.inf
    )


def gramian(model: SideslipEstimation, speed: float, count: int) -> Floats:
    """Return the observability Gramian of angle and yaw rate over `count` samples at constant speed.

    It is ``Σ (H Φ^k)ᵀ R⁻¹ H Φ^k`` for k from 0 to `count` - 1, a power of 2, for linear tyres and
    without disturbance. Its inverse is the covariance of the first state (rad, rad/s) given these
    measurements alone. The Gramian is NaN if the vehicle parameters overflow.
    """
    car, u = model.vehicle, np.float64(speed)
    stiff = np.array([car.cornering_front, car.cornering_rear])
    arms = np.array([car.front, -car.rear])
    by_slip = -np.stack([np.ones(2), arms / u], axis=1)  # derivatives of the slip angles
    forces = stiff[:, None] * by_slip
    lateral, torque = forces.sum(axis=0) / car.mass, arms @ forces / car.yaw_inertia
    rates = np.stack([lateral / u - [0.0, 1.0], torque])
    seen = np.stack([[0.0, 1.0 / model.yaw_rate_noise], lateral / model.acceleration_noise])
    if not (np.isfinite(rates).all() and np.isfinite(seen).all()):
        return np.full((2, 2), np.nan)
    result: Floats = seen.T @ seen
    step = expm(rates * model.recording.period)
    for _ in range(count.bit_length() - 1):
        result = result + step.T @ result @ step
        step = step @ step
    return result


# -- vehicle -------------------------------------------------------------------------------------


def _stability(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield a remark on the stability of the assumed vehicle at the recorded speeds."""
    critical, fastest = critical_speed(model.vehicle), float(model.recording.speed.max())
    if math.isinf(critical):
        text = "the believed vehicle does not oversteer: it is stable at every speed"
        yield tells(text, "vehicle", critical_speed=None)
        return
    share = float((model.recording.speed > critical).mean())
    clause = (
        f"{100 * share:.3g} % of the samples are" if share else f"the fastest is {fastest:.3g} m/s"
    )
    yield (asks if share else tells)(
        f"the believed vehicle oversteers and is unstable above {critical:.3g} m/s; {clause}",
        "vehicle", critical_speed=critical, share=share,
    )  # fmt: skip


def _tyres(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield a remark on the validity of the tyre law at the measured accelerations."""
    drive, car = model.recording, model.vehicle
    size = np.abs(drive.lateral_acceleration[drive.moving])
    most = float(size.max())
    reached = f"the lateral acceleration reaches {most:.3g} m/s²"
    if car.tyre is Tyre.LINEAR:
        share = float((size > _LINEAR_UP_TO + 4 * model.acceleration_noise).mean())
        clause = f"none is clearly above {_LINEAR_UP_TO:g} m/s², up to which tyres are about linear on a dry road"
        if share:
            clause = (
                f"{100 * share:.3g} % of the samples are above {_LINEAR_UP_TO:g} m/s², where an axle slips more "
                "than linear tyres say"
            )
        yield (asks if share else tells)(
            f"{reached}, {clause}", "vehicle.tyre", greatest=most, share=share
        )
        return
    limit = car.friction * GRAVITY
    share = float((size > limit + 4 * model.acceleration_noise).mean())
    # The brush model at a share s of its largest force has (1 - s)^(2/3) of its stiffness left.
    left = (1.0 - min(most / limit, 1.0)) ** (2 / 3)
    if car.tyre is Tyre.MAGIC_FORMULA:  # without curvature
        angle = math.asin(min(most / limit, 1.0))
        left = math.cos(angle) * math.cos(angle / car.shape) ** 2
    if share:
        clause = f"more than the {limit:.3g} m/s² that a friction of {car.friction:g} allows"
    else:
        clause = (
            f"of {limit:.3g} m/s² that a friction of {car.friction:g} allows: tyres then have {100 * left:.3g} % of "
            "their stiffness left"
        )
        clause += ", so that forces say little of the angle" if left < _SLIDING else ""
    yield (asks if share or left < _SLIDING else tells)(
        f"{reached}, {clause}",
        "vehicle.friction", greatest=most, allowed=limit, left=left, share=share,
    )  # fmt: skip


def _observability(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on the observability of the angle and its sensitivity to vehicle parameters."""
    drive, car = model.recording, model.vehicle
    # Number of samples per second, rounded to a power of 2.
    count = 2 ** round(math.log2(min(max(1.0 / drive.period, 1.0), 2.0**20)))
    scale = np.diag(model.initial_deviation)
    worst = (0.0, 0.0, 0.0)
    for speed in np.quantile(drive.speed[drive.moving], np.linspace(0, 1, 9)).tolist():
        info = scale @ gramian(model, speed, count) @ scale
        condition = float(np.linalg.cond(info)) if np.isfinite(info).all() else math.inf
        if not condition < _HIDDEN:
            text = f"the measurements hardly tell the angle at {speed:.3g} m/s (condition {condition:.2g})"
            yield asks(text, "vehicle", speed=speed)
            return
        angle = math.sqrt(np.linalg.inv(info)[0, 0]) * float(scale[0, 0])
        worst = max(worst, (angle, condition, speed))
    angle, condition, speed = worst
    yield tells(
        f"{count} samples tell the angle to {math.degrees(angle):.3g}° where vehicle and noise are as believed and "
        f"nothing disturbs it (at {speed:.3g} m/s, the worst of the drive; condition {condition:.2g})",
        "vehicle", angle=angle, condition=condition, speed=speed, samples=count,
    )  # fmt: skip
    most = float(np.abs(drive.lateral_acceleration[drive.moving]).max())
    moved = 0.1 * car.mass * most / (car.cornering_front + car.cornering_rear)
    yield tells(
        "a mass, or a stiffness of both axles, that is wrong by 10 % moves the angle of estimators that believe "
        f"in it by up to {math.degrees(moved):.3g}°",
        "vehicle.mass", moved=moved,
    )  # fmt: skip


# -- training drives -----------------------------------------------------------------------------


def _training(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on the range and the sampling period of the training drives."""
    drive, others = model.recording, model.training
    if not others:
        text = "there are no drives to learn from, and estimators that learn refuse"
        yield tells(text, "training", drives=0)
        return
    on = drive.moving
    outside = {}
    for name in ("speed", "yaw_rate", "lateral_acceleration"):
        seen = np.concatenate([getattr(entry, name)[entry.moving] for entry in others])
        slack = 0.01 * float(np.abs(seen).max())
        values = getattr(drive, name)[on]
        outside[name] = (values < seen.min() - slack) | (values > seen.max() + slack)
    share = float(np.any(list(outside.values()), axis=0).mean())
    clause = "the recording lies within what they show"
    if share:
        most = max(outside, key=lambda name: int(outside[name].sum()))
        clause = f"{100 * share:.3g} % of the recording lies outside of what they show, most of it by {most}"
    drives = "1 drive" if len(others) == 1 else f"{len(others)} drives"
    yield (asks if share > 0.01 else tells)(
        f"{drives} to learn from, {sum(map(len, others))} samples: {clause}",
        "training", drives=len(others), outside=share,
    )  # fmt: skip
    periods = np.array([entry.period for entry in others])
    if not (periods / drive.period < _UNLIKE).all() or not (drive.period / periods < _UNLIKE).all():
        yield asks(
            f"the drives to learn from have a sample every {periods.min():.3g} … {periods.max():.3g} s, the "
            f"recording every {drive.period:.3g} s",
            "training", shortest=float(periods.min()), longest=float(periods.max()),
        )  # fmt: skip
