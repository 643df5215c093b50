"""Checks of a recording's sensors: sampling, rest, signs, units and noise.

Signs and units follow from kinematics, ``a ≈ u ω`` in slow manoeuvres, and from the steady turn of the single-track
model, ``ω = u δ / (L + K u²)`` with ``K = m (b / C_f - a / C_r) / L`` (R. Rajamani, Vehicle Dynamics and
Control, 2012, chapters 2 and 3).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.checks import sensor_noises
from ...models.sideslip.data import GRAVITY, LOW_SPEED, Recording
from ...models.sideslip.model import SideslipEstimation
from ..run.diagnosis import Finding

__all__ = ["Remark", "asks", "signal_remarks", "tells"]

Floats = NDArray[np.float64]

#: Correlation above which a slope is significant, and largest factor between it and its expected value.
_CLEAR, _SLACK = 0.8, 2.0
#: Factors by which ``a / (u ω)`` is too small if a unit is wrong, with their findings.
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


class Remark(NamedTuple):
    """Finding with a flag that is True if it needs attention."""

    asks: bool
    finding: Finding


def asks(text: str, where: str, **data: Any) -> Remark:
    """Return a remark that needs attention: its text, the field that it concerns, and its numbers."""
    return Remark(True, Finding(text, where=where, data=data))


def tells(text: str, where: str, **data: Any) -> Remark:
    """Return a remark for information. The parameters are those of :func:`asks`."""
    return Remark(False, Finding(text, where=where, data=data))


def signal_remarks(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on the recording and its agreement with the assumed vehicle and noise; the truth is not read."""
    yield from _sampling(model.recording)
    yield from _stale(model)
    yield from _rest(model)
    yield from _signs(model.recording)
    yield from _steering(model)
    yield from _drift(model)
    yield from _noise(model)


def _sampling(drive: Recording) -> Iterator[Remark]:
    """Yield remarks on length, sampling period and jitter, and on missing samples."""
    steps, period = np.diff(drive.times), drive.period
    whole = float(drive.times[-1] - drive.times[0])
    jitter = float(steps[steps < 1.5 * period].std() / period)
    text = f"{len(drive)} samples in {whole:.6g} s, one about every {period:.4g} s"
    text += f", give or take {100 * jitter:.3g} %" if jitter > 1e-3 else ""
    remark = asks if jitter > 0.2 else tells
    yield remark(text, "times", samples=len(drive), seconds=whole, period=period, jitter=jitter)
    lost = int(np.rint(steps / period - 1.0).clip(0, 1e12).sum())
    if lost:
        k = int(steps.argmax())
        share = lost / (lost + len(drive))
        yield (asks if share > 0.01 else tells)(
            f"about {100 * share:.3g} % of the samples are missing; the longest gap is {steps[k]:.3g} s "
            f"after {drive.times[k]:.6g} s",
            "times", missing=lost, gap=float(steps[k]),
        )  # fmt: skip


def _stale(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on constant sensors and on repeated samples."""
    drive = model.recording
    dead = [
        name for name in ("yaw_rate", "lateral_acceleration") if not np.ptp(getattr(drive, name))
    ]
    # A vehicle that drives straight or in a circle has a constant steering angle, too.
    if not np.ptp(drive.steering) and np.ptp(drive.yaw_rate) > _TURNS * model.yaw_rate_noise:
        dead.append("steering")
    for name in dead:
        value = float(getattr(drive, name)[0])
        yield asks(f"{name} never changes: {value:g} at every sample", name, value=value)
    if dead:
        return
    same = (np.diff(drive.yaw_rate) == 0) & (np.diff(drive.lateral_acceleration) == 0)
    same = same[drive.moving[1:]]
    share = float(same.mean()) if same.size else 0.0
    if share > 0.01:
        yield asks(
            f"{100 * share:.3g} % of the samples repeat both measurements before them: the sensors seem to "
            "be read more often than they measure, or to be rounded",
            "yaw_rate", stale=share,
        )  # fmt: skip


def _sensors(model: SideslipEstimation) -> tuple[tuple[str, str, float], ...]:
    """Return name, unit and declared noise of both sensors."""
    return (
        ("yaw_rate", "rad/s", model.yaw_rate_noise),
        ("lateral_acceleration", "m/s²", model.acceleration_noise),
    )


def _rest(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on the share of samples at rest, and on sensor biases at rest."""
    drive = model.recording
    slow = float((~drive.moving).mean())
    if slow:
        yield tells(
            f"{100 * slow:.3g} % of the samples are below {LOW_SPEED:g} m/s, where the angle has no meaning",
            "speed", still=slow,
        )  # fmt: skip
    stands = drive.speed < _STANDS
    count = int(stands.sum())
    for name, unit, noise in _sensors(model) if count >= _ENOUGH else ():
        shown = float(getattr(drive, name)[stands].mean())
        if abs(shown) > 4.0 * noise / math.sqrt(count):
            yield asks(
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


def _signs(drive: Recording) -> Iterator[Remark]:
    """Yield remarks on contradictions between lateral acceleration, yaw rate and speed."""
    on = drive.moving
    slope, clear = _slope((drive.speed * drive.yaw_rate)[on], drive.lateral_acceleration[on])
    if clear < -_CLEAR:
        yield asks(
            f"yaw rate and lateral acceleration have opposite signs (correlation {clear:.2f}): in a turn to "
            "the left both must be positive",
            "yaw_rate", correlation=clear,
        )  # fmt: skip
    size = abs(slope)
    if abs(clear) > _CLEAR and not 1 / _SLACK < size < _SLACK:
        factor, cause = min(_UNITS, key=lambda entry: abs(math.log(size * entry[0])))
        if not 1 / 1.25 < size * factor < 1.25:
            cause = "a unit or a scale is wrong"
        yield asks(
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
        yield asks(
            f"steering and yaw rate have opposite signs (correlation {clear:.2f}): in a turn to the left both "
            "must be positive",
            "steering", correlation=clear,
        )  # fmt: skip
    elif clear > _CLEAR and size < 1 / 8:
        wheel = "the angle of the steering wheel instead of that of the front wheels"
        cause = wheel if size > 1 / 30 else "degrees instead of rad"
        yield asks(
            f"the vehicle turns {1 / size:.3g} times less than its steering asks for: {cause}?",
            "steering", gain=gain, correlation=clear,
        )  # fmt: skip
    elif clear > _CLEAR and not 0.8 < size < 1.25:
        yield asks(
            f"the vehicle turns {size:.3g} times as much as the believed one with the same steering: "
            + ("mass, stiffness or friction may be wrong" if size < 8 else "a unit or a scale is wrong"),
            "vehicle", gain=gain, correlation=clear,
        )  # fmt: skip
    # Yaw rate at zero steering, by a straight line through both signals.
    gain, clear = _slope(steady_yaw - steady_yaw.mean(), yaw - yaw.mean())
    bias = float(yaw.mean() - gain * steady_yaw.mean())
    least = max(_BIAS * float(yaw.std()), 4.0 * model.yaw_rate_noise / math.sqrt(steady_yaw.size))
    if clear > _CLEAR and abs(bias) > least:
        yield asks(
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
        yield asks(
            f"by kinematics the angle would change by {math.degrees(change):.3g}° over the drive: a sensor "
            "has a bias, or a unit or sign is wrong",
            "lateral_acceleration", change=change,
        )  # fmt: skip


def _noise(model: SideslipEstimation) -> Iterator[Remark]:
    """Yield remarks on noise that is large relative to the signal or differs from its declaration."""
    drive = model.recording
    for (name, unit, noise), estimate in zip(_sensors(model), sensor_noises(drive), strict=True):
        values = getattr(drive, name)
        signal = float(np.sqrt(np.mean(values[drive.moving] ** 2)))
        if signal < 3 * noise:
            yield asks(
                f"{name} is {signal:.3g} {unit} in the mean square, with a declared noise of {noise:.3g}: the "
                "drive hardly excites what is to be estimated",
                name, signal=signal, declared=noise,
            )  # fmt: skip
        if estimate and not 1 / _NOISE < estimate / noise < _NOISE:
            yield asks(
                f"the noise of {name} looks like {estimate:.2g} {unit}, where {noise:.2g} is declared: claimed "
                "deviations follow what is declared",
                name, heard=float(estimate), declared=noise,
            )  # fmt: skip
