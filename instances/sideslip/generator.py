"""Simulated drives: one to estimate, and training drives.

Only ``Generator.random`` is used, and recordings are rounded, so that a seed gives the same
drives on every platform. Every drive has its own random stream, so the estimated drive does not depend
on the number of training drives.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from ...errors import InvalidData, UnsupportedOption, suggestion
from ...models.declaration import Nested
from ...models.fields import Array, Flag, Optional, Real, Whole
from ...models.records import Member, Table
from ...models.sideslip.data import MOST, MOST_GAP, Recording, Tyre, Vehicle
from ...models.sideslip.model import SideslipEstimation
from .drivers import HELD_OUT, Design, Driver, design_drivers
from .roads import RoadKind, road_of
from .simulator import Drive, simulate
from .vehicles import VEHICLE

__all__ = ["generate"]

Floats = NDArray[np.float64]

#: Largest number of training drives.
MOST_DRIVES = 1000
#: Random streams of the choice of drivers and of the spoilt samples, and the first stream of a drive.
_PICKING, _LOSING, _FIRST = 0, 1, 2
#: Decimal places of recordings: more than sensors resolve, fewer than platforms agree in.
_DIGITS = 9


def generate(
    road: str = "lane-change", *, seed: int = 0,
    driver: Driver | Mapping[str, Any] | None = None, drivers: int = 15, design: str = "uniform",
    vehicle: Vehicle | Mapping[str, Any] = VEHICLE, tyre: str = "linear",
    believed_tyre: str | None = None, mismatch: Mapping[str, float] | None = None,
    friction: float = 0.9, later_friction: float | None = None,
    training_friction: float | None = None,
    speed: float | Sequence[Sequence[float]] | None = None, samples: int | None = None,
    period: float = 0.05, disturbance: ArrayLike = (0.002, 0.01), yaw_rate_noise: float = 0.002,
    acceleration_noise: float = 0.05, decibels: float | None = None,
    bias: ArrayLike = (0.0, 0.0), missing: float = 0.0, stale: float = 0.0, known: bool = True,
    name: str = "",
) -> SideslipEstimation:  # fmt: skip
    """Return the model of a simulated drive.

    Parameters
    ----------
    road : str
        ``"lane-change"`` (double lane change, 80 km/h), the default, or ``"serpentine"`` (65 km/h).
    seed : int
        Seed of the random numbers, >= 0. Equal seeds give equal drives.
    driver : Driver or mapping, optional
        Driver of the estimated drive; by default ``HELD_OUT``, which differs from all training drivers.
    drivers : int
        Number of training drives on the same road, each by another driver, 15 by default and at most 1000.
    design : str
        Choice of the training drivers: ``"uniform"`` (the table U15(15^8)), the default, or ``"random"``.
    vehicle : Vehicle or mapping
        True vehicle. Its tyre law and friction are replaced by `tyre` and `friction`.
    tyre : str
        Tyre law of the true vehicle, ``"linear"`` (default) or ``"saturating"``.
    believed_tyre : str, optional
        Tyre law assumed by estimators; by default the true one.
    mismatch : mapping of str to float, optional
        Factors between assumed and true parameters of :class:`~crosstrack.models.sideslip.Vehicle`,
        such as ``{"mass": 1.3}``; by default none.
    friction : float
        Coefficient of friction, > 0, 0.9 by default; unused for linear tyres.
    later_friction : float, optional
        Coefficient of friction in the second half of the drive; by default `friction`. Estimators assume `friction`.
    training_friction : float, optional
        Coefficient of friction on the training drives; by default that of the estimated drive.
    speed : float or sequence of (time, speed), optional
        Speed, m/s; by default the design speed of the road. A sequence gives times (s, starting at 0) and speeds with
        linear interpolation, also for the training drives. A vehicle at rest does not turn.
    samples : int, optional
        Number of samples of the estimated drive. By default, and on training drives, the drive ends with the road or
        at the last time of `speed`.
    period : float
        Time between samples, s, 0.05 by default and at most 2.
    disturbance : array-like, shape (2,)
        Standard deviation of the noise on angle (rad/√s) and yaw rate (rad/s/√s), both true and assumed.
    yaw_rate_noise, acceleration_noise : float
        Standard deviations of the measurements (rad/s, m/s²), both true and assumed.
    decibels : float, optional
        Signal-to-noise ratio of both sensors on the estimated drive, dB. It replaces the two standard deviations.
    bias : array-like, shape (2,)
        Bias of measured yaw rate (rad/s) and acceleration (m/s²) of the estimated drive, zero by default.
    missing : float
        Share of the estimated drive's samples that are removed, 0 … 0.9. The first and the last sample are kept.
    stale : float
        Share of the estimated drive's samples that repeat the sensor values of the previous sample, 0 … 0.9.
    known : bool
        If True, the default, the model contains the true angle for the verification.
    name : str
        Name of the model.

    Returns
    -------
    SideslipEstimation

    Raises
    ------
    InvalidData
        A value is invalid, or the vehicle spins.
    UnsupportedOption
        A key of `mismatch` is not a parameter of a vehicle.
    """
    kind = RoadKind(Member(RoadKind).coerce("road", road, {}))
    seed = Whole(0).coerce("seed", seed, {})
    first_driver: Any = Nested(Driver).coerce("driver", HELD_OUT if driver is None else driver, {})
    count = Whole(0, MOST_DRIVES).coerce("drivers", drivers, {})
    plan = Design(Member(Design).coerce("design", design, {}))
    positive = Real(lower=0, strict=True)
    grip = positive.coerce("friction", friction, {})
    later = Optional(positive).coerce("later_friction", later_friction, {})
    trained = Optional(positive).coerce("training_friction", training_friction, {})
    law = Member(Tyre).coerce("tyre", tyre, {})
    truth: Any = Nested(Vehicle).coerce("vehicle", vehicle, {})
    truth = dataclasses.replace(truth, tyre=law, friction=grip)
    period = Real(lower=0, strict=True, upper=MOST_GAP, unit="s").coerce("period", period, {})
    speeds = _speeds(kind, speed, samples, period)
    others = _speeds(kind, speed, None, period)
    noise = _Noise(
        Array((2,), lower=0.0).coerce("disturbance", disturbance, {}),
        Real(lower=0, strict=True, unit="rad/s").coerce("yaw_rate_noise", yaw_rate_noise, {}),
        Real(lower=0, strict=True, unit="m/s²").coerce(
            "acceleration_noise", acceleration_noise, {}
        ),
    )
    ratio = Optional(Real(-200.0, 200.0)).coerce("decibels", decibels, {})
    offset = Array((2,)).coerce("bias", bias, {})
    missing_share = Real(0.0, 0.9).coerce("missing", missing, {})
    stale_share = Real(0.0, 0.9).coerce("stale", stale, {})

    def record_drive(
        by: Driver, place: int, speeds: Floats, grips: tuple[float, float]
    ) -> tuple[Drive, _Noise, Recording]:
        rng = np.random.default_rng([seed, place])
        shocks = _normal(rng, len(speeds)) * noise.disturbance * math.sqrt(period)
        grip_at = np.where(np.arange(len(speeds)) * 2 < len(speeds), *grips)
        course = road_of(kind, float(speeds.sum()) * period)
        try:
            drive = simulate(truth, course, by, speeds, grip_at, shocks, period)
        except InvalidData as error:
            which = "recording" if place == _FIRST else f"training[{place - _FIRST - 1}]"
            raise InvalidData(f"{which}: {error}", field=error.field) from None
        spread = noise if ratio is None or place > _FIRST else noise.at(drive, ratio)
        return drive, spread, _recorded(drive, speeds, period, spread, _normal(rng, len(speeds)))

    grips = (grip, grip if later is None else later)
    drive, spread, recording = record_drive(first_driver, _FIRST, speeds, grips)
    roster = design_drivers(count, plan, np.random.default_rng([seed, _PICKING]))
    training = []
    for place, other in enumerate(roster, _FIRST + 1):
        other_drive, _, other_recording = record_drive(
            other, place, others, grips if trained is None else (trained,) * 2
        )
        angle = np.round(other_drive.sideslip, _DIGITS)
        training.append(dataclasses.replace(other_recording, sideslip=angle))
    rng = np.random.default_rng([seed, _LOSING])
    recording, places = _spoilt(recording, rng, offset, missing_share, stale_share)
    return SideslipEstimation(
        vehicle=_believed(truth, believed_tyre, mismatch),
        recording=recording,
        training=tuple(training),
        disturbance=noise.disturbance,
        yaw_rate_noise=spread.yaw_rate,
        acceleration_noise=spread.acceleration,
        truth=np.round(drive.sideslip[places], _DIGITS)
        if Flag().coerce("known", known, {})
        else None,
        name=name,
    )


class _Noise(NamedTuple):
    """Standard deviations of the noise on the state, the yaw rate and the acceleration."""

    disturbance: Floats
    yaw_rate: float
    acceleration: float

    def at(self, drive: Drive, decibels: float) -> _Noise:
        """Return a copy whose sensor noise has the given signal-to-noise ratio (dB) on `drive`."""
        signals = np.stack([drive.yaw_rate, drive.lateral_acceleration])
        power = np.sqrt((signals**2).mean(axis=1)) * 10.0 ** (-decibels / 20.0)
        # Digits in which platforms agree. The limit is for a vehicle that never turns.
        yaw_rate, acceleration = (max(float(f"{entry:.6g}"), 1e-9) for entry in power)
        return self._replace(yaw_rate=yaw_rate, acceleration=acceleration)


def _normal(rng: np.random.Generator, count: int) -> Floats:
    """Return standard normal numbers, shape (count, 2)."""
    result: Floats = ndtri(rng.random((count, 2)) + 2.0**-54)  # avoids 0
    return result


def _speeds(kind: RoadKind, speed: Any, samples: int | None, period: float) -> Floats:
    """Return the speed at every sample, m/s."""
    count = Optional(Whole(2, MOST)).coerce("samples", samples, {})
    if speed is None or isinstance(speed, int | float | np.number):
        road = road_of(kind)
        constant = road.speed if speed is None else Real(0.1, 1000.0).coerce("speed", speed, {})
        whole = _whole(road.length / constant, period) if count is None else count
        return np.full(whole, constant)
    knots = Array(("k", 2), lower=0.0, upper=1e6).coerce("speed", speed, {})
    if len(knots) < 2 or knots[0, 0] != 0.0 or not (np.diff(knots[:, 0]) > 0).all():
        raise InvalidData(
            "speed must be a number, or at least two rows of time and speed whose times begin at 0 and rise",
            field="speed",
        )
    whole = _whole(knots[-1, 0], period) if count is None else count
    result: Floats = np.round(np.interp(np.arange(whole) * period, *knots.T), _DIGITS)
    return result


def _whole(duration: float, period: float) -> int:
    """Return the number of samples in a duration (s), both ends included."""
    steps = duration / period
    if not steps < MOST:
        raise InvalidData(
            f"period must leave at most {MOST} samples, got {period:g} s for {duration:g} s",
            field="period",
        )
    return round(steps) + 1


def _recorded(
    drive: Drive, speeds: Floats, period: float, noise: _Noise, normal: Floats
) -> Recording:
    """Return the recording of a drive, with noise and rounding."""
    return Recording(
        times=np.round(np.arange(len(speeds)) * period, _DIGITS),
        speed=speeds,
        steering=np.round(drive.steering, _DIGITS),
        yaw_rate=np.round(drive.yaw_rate + noise.yaw_rate * normal[:, 0], _DIGITS),
        lateral_acceleration=np.round(
            drive.lateral_acceleration + noise.acceleration * normal[:, 1], _DIGITS
        ),
    )


def _spoilt(
    recording: Recording, rng: np.random.Generator, bias: Floats, missing: float, stale: float
) -> tuple[Recording, NDArray[np.intp]]:
    """Return the recording with biases, stale and missing samples, and the indices of its samples."""
    draw = rng.random((2, len(recording)))
    draw[:, 0] = draw[0, -1] = 1.0
    # A stale sample repeats the last sample that is not stale.
    shown = np.maximum.accumulate(np.where(draw[1] < stale, 0, np.arange(len(recording))))
    places = np.flatnonzero(draw[0] >= missing)
    result = dataclasses.replace(
        recording,
        times=recording.times[places],
        speed=recording.speed[places],
        steering=recording.steering[places],
        yaw_rate=np.round(recording.yaw_rate[shown][places] + bias[0], _DIGITS),
        lateral_acceleration=np.round(
            recording.lateral_acceleration[shown][places] + bias[1], _DIGITS
        ),
    )
    return result, places


def _believed(truth: Vehicle, tyre: str | None, mismatch: Mapping[str, float] | None) -> Vehicle:
    """Return the vehicle assumed by estimators."""
    changes: dict[str, Any] = {}
    allowed = sorted({field.name for field in dataclasses.fields(Vehicle)} - {"tyre"})
    for key, factor in Table().coerce("mismatch", {} if mismatch is None else mismatch, {}).items():
        if key not in allowed:
            raise UnsupportedOption(
                f"mismatch has no parameter {key!r}; {suggestion(key, allowed)}allowed: "
                f"{', '.join(allowed)}"
            )
        times = Real(lower=0, strict=True).coerce(f"mismatch[{key!r}]", factor, {})
        changes[key] = getattr(truth, key) * times
    law = Optional(Member(Tyre)).coerce("believed_tyre", tyre, {})
    return dataclasses.replace(truth, tyre=truth.tyre if law is None else law, **changes)
