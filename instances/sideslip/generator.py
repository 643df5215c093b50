"""Simulated drives: one whose angle is asked for, and those that estimators learn from.

Only ``Generator.random`` is drawn from, and what is recorded is rounded, so that a seed means the same
drives wherever it is used. Every drive has a stream of its own: the drive that is estimated does not depend
on how many there are to learn from.
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
from ...models.fields import Array, Flag, Optional, Real, Whole, required
from ...models.records import Member, Table
from ...models.sideslip.data import MOST, MOST_GAP, Recording, Tyre, Vehicle
from ...models.sideslip.model import SideslipEstimation
from .drivers import HELD_OUT, Design, Driver, design_drivers
from .roads import RoadKind, road_of
from .settings import VEHICLE
from .simulator import Drive, simulate

__all__ = ["generate"]

Floats = NDArray[np.float64]

#: Drives to learn from, at most.
MOST_DRIVES = 1000
#: Streams of random numbers that are no drive's.
_PICKING, _LOSING, _FIRST = 0, 1, 2
#: Digits after the point of what is recorded: more than any sensor has, fewer than machines agree in.
_DIGITS = 9


def generate(
    road: str = "lane-change",
    *,
    seed: int = 0,
    driver: Driver | Mapping[str, Any] | None = None,
    drivers: int = 15,
    design: str = "uniform",
    vehicle: Vehicle | Mapping[str, Any] = VEHICLE,
    tyre: str = "linear",
    believed_tyre: str | None = None,
    mismatch: Mapping[str, float] | None = None,
    friction: float = 0.9,
    later_friction: float | None = None,
    training_friction: float | None = None,
    speed: float | Sequence[Sequence[float]] | None = None,
    samples: int | None = None,
    period: float = 0.05,
    disturbance: ArrayLike = (0.002, 0.01),
    yaw_rate_noise: float = 0.002,
    acceleration_noise: float = 0.05,
    decibels: float | None = None,
    bias: ArrayLike = (0.0, 0.0),
    missing: float = 0.0,
    stale: float = 0.0,
    known: bool = True,
    name: str = "",
) -> SideslipEstimation:
    """Return the estimation of a simulated drive.

    Parameters
    ----------
    road : str
        ``"lane-change"`` (the double lane change, made for 80 km/h) or ``"serpentine"`` (65 km/h).
    seed : int
        Same seed, same drives.
    driver : Driver or mapping, optional
        Who drives; by default one who is none of those that estimators learn from.
    drivers : int
        How many others drive the same road for estimators to learn from.
    design : str
        How these are picked: ``"uniform"`` (the table U15(15^8)) or ``"random"``.
    vehicle : Vehicle or mapping
        The vehicle that is driven. Its tyres and friction are set by `tyre` and `friction`.
    tyre : str
        Of the vehicle that is driven, ``"linear"`` or ``"saturating"``.
    believed_tyre : str, optional
        That estimators believe in; by default the true one.
    mismatch : mapping of str to float, optional
        By what the parameters of :class:`~crosstrack.models.sideslip.Vehicle` are multiplied that
        estimators believe in, such as ``{"mass": 1.3}``.
    friction : float
        Coefficient of friction, of no account for linear tyres.
    later_friction : float, optional
        The same from the middle of the drive's time on. Estimators believe in the first.
    training_friction : float, optional
        On all of the drives to learn from; by default they meet what the estimated drive meets.
    speed : float or sequence of (time, speed), optional
        m/s; by default what the road is made for. With instants (s, the first 0) the speed is linear in between, also on
        the drives to learn from. A vehicle at rest does not turn.
    samples : int, optional
        Of the drive that is estimated; by default, and for the others, to the end of the road or to the last
        instant of `speed`.
    period : float
        Time between samples, s.
    disturbance : array-like, shape (2,)
        Deviation of the noise on angle (rad/√s) and yaw rate (rad/s/√s), in truth and as believed.
    yaw_rate_noise, acceleration_noise : float
        Deviation of what is measured (rad/s, m/s²), in truth and as believed.
    decibels : float, optional
        Power of the signal to that of the noise, dB, for both sensors on the drive that is estimated: instead
        of the two deviations.
    bias : array-like, shape (2,)
        Added to measured yaw rate (rad/s) and acceleration (m/s²) of the drive that is estimated.
    missing : float
        Share of its samples that are left out, below 0.9; the first and the last are kept.
    stale : float
        Share of its samples that repeat the sensors' values of the sample before, below 0.9.
    known : bool
        Whether the true angle goes into the model, for the verification.
    name : str
        Of the model.

    Raises
    ------
    InvalidData
        A value that is not allowed, named; a vehicle that spins.
    UnsupportedOption
        `mismatch` names no parameter of a vehicle.
    """
    kind = RoadKind(Member(RoadKind).coerce("road", road, {}))
    seed = Whole(0).coerce("seed", seed, {})
    who = _part(Driver, "driver", HELD_OUT if driver is None else driver)
    count = Whole(0, MOST_DRIVES).coerce("drivers", drivers, {})
    plan = Design(Member(Design).coerce("design", design, {}))
    grip = Real(lower=0, strict=True).coerce("friction", friction, {})
    later = Optional(Real(lower=0, strict=True)).coerce("later_friction", later_friction, {})
    trained = Optional(Real(lower=0, strict=True)).coerce(
        "training_friction", training_friction, {}
    )
    law = Member(Tyre).coerce("tyre", tyre, {})
    truth = dataclasses.replace(_part(Vehicle, "vehicle", vehicle), tyre=law, friction=grip)
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
    lost = Real(0.0, 0.9).coerce("missing", missing, {})
    old = Real(0.0, 0.9).coerce("stale", stale, {})

    def driven(
        by: Driver, place: int, speeds: Floats, grips: tuple[float, float]
    ) -> tuple[Drive, _Noise, Recording]:
        rng = np.random.default_rng([seed, place])
        shocks = _normal(rng, len(speeds)) * noise.disturbance * math.sqrt(period)
        met = np.where(np.arange(len(speeds)) * 2 < len(speeds), *grips)
        course = road_of(kind, float(speeds.sum()) * period)
        try:
            drive = simulate(truth, course, by, speeds, met, shocks, period)
        except InvalidData as error:
            which = "recording" if place == _FIRST else f"training[{place - _FIRST - 1}]"
            raise InvalidData(f"{which}: {error}", field=error.field) from None
        heard = noise if ratio is None or place > _FIRST else noise.at(drive, ratio)
        return drive, heard, _recorded(drive, speeds, period, heard, _normal(rng, len(speeds)))

    grips = (grip, grip if later is None else later)
    drive, heard, recording = driven(who, _FIRST, speeds, grips)
    picked = design_drivers(count, plan, np.random.default_rng([seed, _PICKING]))
    training = []
    for place, other in enumerate(picked, _FIRST + 1):
        seen, _, shown = driven(other, place, others, grips if trained is None else (trained,) * 2)
        angle = np.round(seen.sideslip, _DIGITS)
        training.append(dataclasses.replace(shown, sideslip=angle))
    rng = np.random.default_rng([seed, _LOSING])
    recording, kept = _spoilt(recording, rng, offset, lost, old)
    return SideslipEstimation(
        vehicle=_believed(truth, believed_tyre, mismatch),
        recording=recording,
        training=tuple(training),
        disturbance=noise.disturbance,
        yaw_rate_noise=heard.yaw_rate,
        acceleration_noise=heard.acceleration,
        truth=np.round(drive.sideslip[kept], _DIGITS)
        if Flag().coerce("known", known, {})
        else None,
        name=name,
    )


class _Noise(NamedTuple):
    """Deviations of the noise on the state, the yaw rate and the acceleration."""

    disturbance: Floats
    yaw_rate: float
    acceleration: float

    def at(self, drive: Drive, decibels: float) -> _Noise:
        """Return it with the sensors' noise at this distance below the signals of `drive`."""
        signals = np.stack([drive.yaw_rate, drive.lateral_acceleration])
        power = np.sqrt((signals**2).mean(axis=1)) * 10.0 ** (-decibels / 20.0)
        # As many digits as machines agree in; a vehicle that never turns has no signal.
        yaw_rate, acceleration = (max(float(f"{one:.6g}"), 1e-9) for one in power)
        return self._replace(yaw_rate=yaw_rate, acceleration=acceleration)


def _normal(rng: np.random.Generator, count: int) -> Floats:
    """Return normal numbers, shape (count, 2)."""
    found: Floats = ndtri(rng.random((count, 2)) + 2.0**-54)  # never 0
    return found


def _part(kind: Any, name: str, value: Any) -> Any:
    """Return a part of its own, or the one that its data make."""
    if isinstance(value, Mapping):
        return kind.from_data(value)
    return required(name, value, kind)


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
    found: Floats = np.round(np.interp(np.arange(whole) * period, *knots.T), _DIGITS)
    return found


def _whole(duration: float, period: float) -> int:
    """Return how many samples a duration has."""
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
    """Return what sensors make of a drive."""
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
    """Return a recording by worse sensors, and which of its samples are left."""
    draw = rng.random((2, len(recording)))
    draw[:, 0] = draw[0, -1] = 1.0
    # Each sample shows the last one before it that is not stale.
    shown = np.maximum.accumulate(np.where(draw[1] < stale, 0, np.arange(len(recording))))
    kept = np.flatnonzero(draw[0] >= missing)
    found = dataclasses.replace(
        recording,
        times=recording.times[kept],
        speed=recording.speed[kept],
        steering=recording.steering[kept],
        yaw_rate=np.round(recording.yaw_rate[shown][kept] + bias[0], _DIGITS),
        lateral_acceleration=np.round(
            recording.lateral_acceleration[shown][kept] + bias[1], _DIGITS
        ),
    )
    return found, kept


def _believed(truth: Vehicle, tyre: str | None, mismatch: Mapping[str, float] | None) -> Vehicle:
    """Return the vehicle that estimators believe in."""
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
