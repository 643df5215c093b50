"""Diagnosis of a recording, the vehicle parameters and the training drives before the estimation.

Signs and units follow from kinematics, ``a ≈ u ω`` in slow manoeuvres, and from the steady turn of the single-track
model, ``ω = u δ / (L + K u²)`` with ``K = m (b / C_f - a / C_r) / L``. These formulas, the linear range of tyres, up to about
4 m/s² on a dry road, and the stability criterion are those of R. Rajamani (Vehicle Dynamics and Control, 2012, chapters 2,
3 and 13).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ...models.sideslip.checks import SENSORS, sensor_noises
from ...models.sideslip.data import GRAVITY, LOW_SPEED, Tyre, Vehicle
from ...models.sideslip.model import SideslipEstimation
from ..run.diagnosis import Diagnosis, Finding

__all__ = ["critical_speed", "diagnose_sideslip", "gramian"]

Floats = NDArray[np.float64]
#: Finding with a flag that is True if it needs attention.
Remark = tuple[bool, Finding]

#: Lateral acceleration (m/s²) up to which tyres are about linear on a dry road.
_LINEAR_UP_TO = 4.0
#: Share of an axle's stiffness below which its force is insensitive to the angle.
_SLIDING = 0.3
#: Condition number of the Gramian above which the angle is reported as unobservable.
_HIDDEN = 1e6
#: Ratio of two sampling periods above which lagged features are not comparable.
_UNLIKE = 1.5
#: Correlation above which a slope is significant, and largest factor between it and its expected value.
_CLEAR, _SLACK = 0.8, 2.0
#: Units of the sensors, in their order.
_SENSOR_UNITS = ("rad/s", "m/s²")
#: Factors on ``a / (u ω)`` that correct a wrong unit, with their findings.
_UNITS = (
    (180.0 / math.pi, "the yaw rate seems to be in degrees a second, and must be in rad/s"),
    (GRAVITY, "the lateral acceleration seems to be in g, and must be in m/s²"),
    (3.6, "the speed seems to be in km/h, and must be in m/s"),
    (2.237, "the speed seems to be in miles an hour, and must be in m/s"),
)
#: Bias that is reported, as a share of the yaw rate's deviation.
_BIAS = 0.15
#: Ratio of measured and declared noise that is reported.
_NOISE = 2.0
#: Change of the angle (rad) over a drive by kinematics that is reported, beyond noise.
_DRIFT = 0.1
#: Range of the yaw rate, in deviations of its noise, of a vehicle that is steered.
_TURNS = 20.0
#: Speed (m/s) below which a vehicle is at rest, and smallest number of samples for a mean.
_STANDS, _ENOUGH = 0.01, 10


def warn(text: str, where: str, **data: Any) -> Remark:
    """Return a remark that needs attention: its text, the field that it concerns, and its numbers."""
    return True, Finding(text, where=where, data=data)


def note(text: str, where: str, **data: Any) -> Remark:
    """Return a remark for information. The parameters are those of :func:`warn`."""
    return False, Finding(text, where=where, data=data)


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
        parts = (
            *(_sampling, _stale, _rest, _signs, _steering, _drift, _noise),
            *(_stability, _tyres, _observability, _training),
        )
        result = [remark for part in parts for remark in part(model)]
    asking = [finding for needed, finding in result if needed]
    others = [finding for needed, finding in result if not needed]
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


# -- recording -----------------------------------------------------------------------------------


def _sampling(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on length, sampling period and jitter, and on missing samples."""
    drive = model.recording
    steps, period = np.diff(drive.times), drive.period
    whole = float(drive.times[-1] - drive.times[0])
    jitter = float(steps[steps < 1.5 * period].std() / period)
    text = f"{len(drive)} samples in {whole:.6g} s, one about every {period:.4g} s"
    text += f", give or take {100 * jitter:.3g} %" if jitter > 1e-3 else ""
    remark = warn if jitter > 0.2 else note
    yield remark(text, "times", samples=len(drive), seconds=whole, period=period, jitter=jitter)
    lost = int(np.rint(steps / period - 1.0).clip(0, 1e12).sum())
    if lost:
        k = int(steps.argmax())
        share = lost / (lost + len(drive))
        yield (warn if share > 0.01 else note)(
            f"about {100 * share:.3g} % of the samples are missing; the longest gap is {steps[k]:.3g} s "
            f"after {drive.times[k]:.6g} s",
            "times", missing=lost, gap=float(steps[k]),
        )  # fmt: skip


def _stale(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on constant sensors and on repeated samples."""
    drive = model.recording
    dead = [name for name in SENSORS if not np.ptp(getattr(drive, name))]
    # A vehicle that drives straight or in a circle has a constant steering angle, too.
    if not np.ptp(drive.steering) and np.ptp(drive.yaw_rate) > _TURNS * model.yaw_rate_noise:
        dead.append("steering")
    for name in dead:
        value = float(getattr(drive, name)[0])
        yield warn(f"{name} never changes: {value:g} at every sample", name, value=value)
    if dead:
        return
    same = (np.diff(drive.yaw_rate) == 0) & (np.diff(drive.lateral_acceleration) == 0)
    same = same[drive.moving[1:]]
    share = float(same.mean()) if same.size else 0.0
    if share > 0.01:
        yield warn(
            f"{100 * share:.3g} % of the samples repeat both measurements before them: the sensors seem to "
            "be read more often than they measure, or to be rounded",
            "yaw_rate", stale=share,
        )  # fmt: skip


def _rest(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on the share of samples at rest, and on sensor biases at rest."""
    drive = model.recording
    slow = float((~drive.moving).mean())
    if slow:
        yield note(
            f"{100 * slow:.3g} % of the samples are below {LOW_SPEED:g} m/s, where the angle has no meaning",
            "speed", still=slow,
        )  # fmt: skip
    stands = drive.speed < _STANDS
    count = int(stands.sum())
    sensors = zip(SENSORS, _SENSOR_UNITS, model.sensor_noises.tolist(), strict=True)
    for name, unit, noise in sensors if count >= _ENOUGH else ():
        shown = float(getattr(drive, name)[stands].mean())
        if abs(shown) > 4.0 * noise / math.sqrt(count):
            yield warn(
                f"at rest {name} shows {shown:.3g} {unit} on average of {count} samples: a bias that no "
                "estimator removes, to be subtracted from the recording",
                name, bias=shown, samples=count,
            )  # fmt: skip


def _slope(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of the least-squares line through 0, and the correlation about 0."""
    across, square_x, square_y = float(x @ y), float(x @ x), float(y @ y)
    if not (square_x > 1e-200 and square_y > 1e-200):
        return 0.0, 0.0
    return across / square_x, across / math.sqrt(square_x) / math.sqrt(square_y)


def _signs(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on contradictions between lateral acceleration, yaw rate and speed."""
    drive = model.recording
    on = drive.moving
    slope, clear = _slope((drive.speed * drive.yaw_rate)[on], drive.lateral_acceleration[on])
    if clear < -_CLEAR:
        yield warn(
            f"yaw rate and lateral acceleration have opposite signs (correlation {clear:.2f}): in a turn to "
            "the left both must be positive",
            "yaw_rate", correlation=clear,
        )  # fmt: skip
    size = abs(slope)
    if abs(clear) > _CLEAR and not 1 / _SLACK < size < _SLACK:
        factor, cause = min(_UNITS, key=lambda entry: abs(math.log(size * entry[0])))
        if not 1 / 1.25 < size * factor < 1.25:
            cause = "a unit or a scale is wrong"
        yield warn(
            f"the lateral acceleration is {size:.3g} times speed times yaw rate, where about 1 is right: {cause}",
            "lateral_acceleration", slope=slope, correlation=clear,
        )  # fmt: skip


def _steering(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on contradictions between yaw rate and steering."""
    drive, car = model.recording, model.vehicle
    on = drive.moving
    under = (
        car.mass / car.wheelbase * (car.rear / car.cornering_front - car.front / car.cornering_rear)
    )
    turn = car.wheelbase + under * drive.speed**2
    on &= turn > 0.2 * car.wheelbase  # a steady turn requires less than the critical speed
    steady_yaw, yaw = (drive.speed * drive.steering / turn)[on], drive.yaw_rate[on]
    if steady_yaw.size < _ENOUGH:
        return
    gain, clear = _slope(steady_yaw, yaw)
    size = abs(gain)
    if clear < -0.5:
        yield warn(
            f"steering and yaw rate have opposite signs (correlation {clear:.2f}): in a turn to the left both "
            "must be positive",
            "steering", correlation=clear,
        )  # fmt: skip
    elif clear > _CLEAR and size < 1 / 8:
        wheel = "the angle of the steering wheel instead of that of the front wheels"
        cause = wheel if size > 1 / 30 else "degrees instead of rad"
        yield warn(
            f"the vehicle turns {1 / size:.3g} times less than its steering asks for: {cause}?",
            "steering", gain=gain, correlation=clear,
        )  # fmt: skip
    elif clear > _CLEAR and not 0.8 < size < 1.25:
        yield warn(
            f"the vehicle turns {size:.3g} times as much as the believed one with the same steering: "
            + ("mass, stiffness or friction may be wrong" if size < 8 else "a unit or a scale is wrong"),
            "vehicle", gain=gain, correlation=clear,
        )  # fmt: skip
    # Yaw rate at zero steering, by a straight line through both signals.
    gain, clear = _slope(steady_yaw - steady_yaw.mean(), yaw - yaw.mean())
    bias = float(yaw.mean() - gain * steady_yaw.mean())
    least = max(_BIAS * float(yaw.std()), 4.0 * model.yaw_rate_noise / math.sqrt(steady_yaw.size))
    if clear > _CLEAR and abs(bias) > least:
        yield warn(
            f"yaw_rate is {bias:.3g} rad/s where the steering says straight ahead: one of both has a bias",
            "yaw_rate", bias=bias,
        )  # fmt: skip


def _drift(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield a remark if the kinematic change of the angle over the drive is implausible."""
    drive = model.recording
    speed = np.maximum(drive.speed, LOW_SPEED)
    rate = np.where(drive.moving, drive.lateral_acceleration / speed - drive.yaw_rate, 0.0)
    change = float(np.trapezoid(rate, drive.times))
    spread = np.hypot(model.acceleration_noise / speed, model.yaw_rate_noise)
    noise = math.sqrt(float(np.trapezoid(spread**2, drive.times)) * drive.period)
    if abs(change) > _DRIFT + 4.0 * noise:
        yield warn(
            f"by kinematics the angle would change by {math.degrees(change):.3g}° over the drive: a sensor "
            "has a bias, or a unit or sign is wrong",
            "lateral_acceleration", change=change,
        )  # fmt: skip


def _noise(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on noise that is large relative to the signal or differs from its declaration."""
    drive = model.recording
    noises = model.sensor_noises.tolist(), sensor_noises(drive)
    for name, unit, noise, estimate in zip(SENSORS, _SENSOR_UNITS, *noises, strict=True):
        values = getattr(drive, name)
        signal = float(np.sqrt(np.mean(values[drive.moving] ** 2)))
        if signal < 3 * noise:
            yield warn(
                f"{name} is {signal:.3g} {unit} in the mean square, with a declared noise of {noise:.3g}: the "
                "drive hardly excites what is to be estimated",
                name, signal=signal, declared=noise,
            )  # fmt: skip
        if estimate and not 1 / _NOISE < estimate / noise < _NOISE:
            yield warn(
                f"the noise of {name} looks like {estimate:.2g} {unit}, where {noise:.2g} is declared: claimed "
                "deviations follow what is declared",
                name, heard=float(estimate), declared=noise,
            )  # fmt: skip


# -- vehicle -------------------------------------------------------------------------------------


def _stability(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield a remark on the stability of the assumed vehicle at the recorded speeds."""
    critical, fastest = critical_speed(model.vehicle), float(model.recording.speed.max())
    if math.isinf(critical):
        text = "the believed vehicle does not oversteer: it is stable at every speed"
        yield note(text, "vehicle", critical_speed=None)
        return
    share = float((model.recording.speed > critical).mean())
    clause = (
        f"{100 * share:.3g} % of the samples are" if share else f"the fastest is {fastest:.3g} m/s"
    )
    yield (warn if share else note)(
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
        yield (warn if share else note)(
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
    yield (warn if share or left < _SLIDING else note)(
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
            yield warn(text, "vehicle", speed=speed)
            return
        angle = math.sqrt(np.linalg.inv(info)[0, 0]) * float(scale[0, 0])
        worst = max(worst, (angle, condition, speed))
    angle, condition, speed = worst
    yield note(
        f"{count} samples tell the angle to {math.degrees(angle):.3g}° where vehicle and noise are as believed and "
        f"nothing disturbs it (at {speed:.3g} m/s, the worst of the drive; condition {condition:.2g})",
        "vehicle", angle=angle, condition=condition, speed=speed, samples=count,
    )  # fmt: skip
    most = float(np.abs(drive.lateral_acceleration[drive.moving]).max())
    moved = 0.1 * car.mass * most / (car.cornering_front + car.cornering_rear)
    yield note(
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
        yield note(text, "training", drives=0)
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
    yield (warn if share > 0.01 else note)(
        f"{drives} to learn from, {sum(map(len, others))} samples: {clause}",
        "training", drives=len(others), outside=share,
    )  # fmt: skip
    periods = np.array([entry.period for entry in others])
    if not (periods / drive.period < _UNLIKE).all() or not (drive.period / periods < _UNLIKE).all():
        yield warn(
            f"the drives to learn from have a sample every {periods.min():.3g} … {periods.max():.3g} s, the "
            f"recording every {drive.period:.3g} s",
            "training", shortest=float(periods.min()), longest=float(periods.max()),
        )  # fmt: skip
