"""The vehicle model of the estimators, and recordings of drives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Optional, Real, declared, show
from ..inputs import Field, FloatArray, FloatsOrNone
from ..records import Member

__all__ = [
    "GRAVITY", "LOW_SPEED", "MOST_GAP", "UNKNOWN", "Recording", "Tyre", "Vehicle",
    "estimate_speed",
]  # fmt: skip


#: Standard gravity, m/s².
GRAVITY = 9.80665
#: Speed (m/s) below which the sideslip angle is undefined: the single-track model is singular at rest.
LOW_SPEED = 1.0
#: Standard deviation (rad) of an unknown angle, uniform between -90° and 90°.
UNKNOWN = math.pi / math.sqrt(12.0)
#: Longest time (s) between two samples of a valid recording.
MOST_GAP = 2.0
#: Time (s) over which the forward acceleration is computed from the speed.
CHANGE_WINDOW = 0.2
#: Smallest and largest number of samples in a recording.
LEAST, MOST = 10, 1_000_000


class Tyre(StrEnum):
    """Law of an axle's lateral force over its slip angle."""

    #: The force is proportional to the slip angle and has no limit.
    LINEAR = "linear"
    #: Fiala's brush model. The force saturates at friction times static load.
    SATURATING = "saturating"
    #: Magic Formula of Pacejka. The force rises longer in proportion to the slip angle than that of the brush model, and has
    #: its largest value, friction times static load, at a finite slip angle.
    MAGIC_FORMULA = "magic-formula"


@dataclass(frozen=True, eq=False)
class Vehicle(Declared):
    """A single-track vehicle.

    Parameters
    ----------
    mass : float
        Mass in kilograms.
    yaw_inertia : float
        Moment of inertia about the vertical axis, in kilogram square metres.
    front, rear : float
        Distances of the axles from the centre of mass, in metres.
    cornering_front, cornering_rear : float
        Cornering stiffness of each axle, both tyres together, in newtons per radian, > 0.
    friction : float
        Coefficient of friction between tyre and road, > 0, 0.9 by default; unused for linear tyres.
    tyre : Tyre
        Law of the tyre forces, linear by default.
    shape, curvature : float
        Factors C (in [1, 2], 1.35 by default) and E (in [-10, 1], -0.5 by default) of the Magic Formula; unused for others.
    load_loss : float
        Share of its stiffness and friction that each axle loses by the lateral load transfer at 1 g, in [0, 1]; 0, the
        default, neglects it, and linear tyres do not use it. It is ``k (2 h / t)²`` for a centre of mass at the height h, a
        track t, and tyres whose stiffness is ``C z (1 - k (z - 1))`` at z times the static load.
    """

    mass: float = declared(Real(lower=0, strict=True, unit="kg"))
    yaw_inertia: float = declared(Real(lower=0, strict=True, unit="kg m²"))
    front: float = declared(Real(lower=0, strict=True, unit="m"))
    rear: float = declared(Real(lower=0, strict=True, unit="m"))
    cornering_front: float = declared(Real(lower=0, strict=True, unit="N/rad"))
    cornering_rear: float = declared(Real(lower=0, strict=True, unit="N/rad"))
    friction: float = declared(Real(lower=0, strict=True), default=0.9)
    tyre: Field[str, Tyre] = declared(Member(Tyre), default=Tyre.LINEAR)
    shape: float = declared(Real(lower=1.0, upper=2.0), added=True, default=1.35)
    curvature: float = declared(Real(lower=-10.0, upper=1.0), added=True, default=-0.5)
    load_loss: float = declared(Real(lower=0.0, upper=1.0), added=True, default=0.0)

    @property
    def wheelbase(self) -> float:
        """Distance between the axles, m."""
        return self.front + self.rear

    @property
    def loads(self) -> tuple[float, float]:
        """Static loads of the front and the rear axle, N."""
        weight = self.mass * GRAVITY
        return weight * self.rear / self.wheelbase, weight * self.front / self.wheelbase


class Times(Array):
    """Array of strictly increasing times with at most :data:`MOST_GAP` seconds between neighbours."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        result = super().coerce(name, value, sizes)
        if not LEAST <= len(result) <= MOST:
            raise InvalidData(
                f"{name} must hold {LEAST} … {MOST} samples, got {len(result)}", field=name
            )
        steps = np.diff(result)
        bad = np.flatnonzero(~(steps > 0))
        if bad.size:
            k = int(bad[0]) + 1
            what = "a sample twice" if result[k] == result[k - 1] else "a step back"
            raise InvalidData(
                f"{name} must rise strictly, got {what}: {name}[{k}] = {show(float(result[k]))} s after "
                f"{show(float(result[k - 1]))} s",
                field=name,
            )
        wide = np.flatnonzero(steps > MOST_GAP * (1 + 1e-9))
        if wide.size:
            k = int(wide[0])
            raise InvalidData(
                f"{name} must leave no gap above {MOST_GAP:g} s, got {steps[k]:g} s after "
                f"{name}[{k}] = {show(float(result[k]))} s: split the recording there",
                field=name,
            )
        return result


@dataclass(frozen=True, eq=False)
class Recording(Declared):
    """Measurements of a drive, with one entry per sample.

    The axes are those of ISO 8855: forward, left and up. A turn to the left has a positive steering
    angle, yaw rate and lateral acceleration. The sideslip angle is the angle between velocity and forward axis,
    positive to the left.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Times in seconds, strictly increasing, at most 2 seconds apart.
    speed : ndarray, shape (n,)
        Forward speed in metres per second, >= 0, assumed exact.
    steering : ndarray, shape (n,)
        Steering angle of the front wheels, in radians, assumed exact.
    yaw_rate : ndarray, shape (n,)
        Measured yaw rate in radians per second.
    lateral_acceleration : ndarray, shape (n,)
        Measured lateral acceleration at the centre of mass, in metres per second squared.
    sideslip : ndarray, shape (n,), optional
        True sideslip angle in radians. Required for training drives, None for a drive to estimate.
    wheel_speeds : ndarray, shape (n, 4), optional
        Rim speeds of the wheels (angular speed times radius) in metres per second: front left, front right, rear
        left and rear right. ``kalman-grnn`` and ``smoother-grnn`` use them if all drives have them.
    longitudinal_acceleration : ndarray, shape (n,), optional
        Measured acceleration along the forward axis, in metres per second squared. ``kalman-grnn`` and ``smoother-grnn``
        use it if all drives have it; otherwise the forward acceleration follows from the speed.
    """

    times: FloatArray = declared(Times(("n",), unit="s"))
    speed: FloatArray = declared(Array(("n",), lower=0.0, unit="m/s"))
    steering: FloatArray = declared(Array(("n",), lower=-np.pi / 2, upper=np.pi / 2, unit="rad"))
    yaw_rate: FloatArray = declared(Array(("n",), lower=-100.0, upper=100.0, unit="rad/s"))
    lateral_acceleration: FloatArray = declared(
        Array(("n",), lower=-1000.0, upper=1000.0, unit="m/s²")
    )
    sideslip: FloatsOrNone = declared(
        Optional(Array(("n",), lower=-np.pi / 2, upper=np.pi / 2, unit="rad")), default=None
    )
    wheel_speeds: FloatsOrNone = declared(
        Optional(Array(("n", 4), lower=0.0, upper=1000.0, unit="m/s")), added=True, default=None
    )
    longitudinal_acceleration: FloatsOrNone = declared(
        Optional(Array(("n",), lower=-1000.0, upper=1000.0, unit="m/s²")), added=True, default=None
    )

    def check(self) -> None:
        """Raise :class:`InvalidData` if the speed never reaches 1 m/s or exceeds 1000 m/s."""
        fastest = float(self.speed.max())
        if not fastest >= LOW_SPEED:
            raise InvalidData(
                f"speed must reach {LOW_SPEED:g} m/s somewhere, got at most {fastest:g}: the sideslip "
                "angle of a vehicle at rest has no meaning",
                field="speed",
            )
        if not fastest <= 1000.0:
            raise InvalidData(f"speed must be <= 1000 m/s, got {fastest:g}", field="speed")

    def __len__(self) -> int:
        return len(self.times)

    @property
    def period(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.times)))

    @property
    def forward_acceleration(self) -> NDArray[np.float64]:
        """Forward acceleration, m/s², shape (n,): measured, or the change of the speed over the last 0.2 s."""
        if self.longitudinal_acceleration is not None:
            return self.longitudinal_acceleration
        before = np.interp(self.times - CHANGE_WINDOW, self.times, self.speed)
        result: NDArray[np.float64] = (self.speed - before) / CHANGE_WINDOW
        return result

    @property
    def moving(self) -> NDArray[np.bool_]:
        """True for samples at 1 m/s or more, whose angle is defined, shape (n,)."""
        result: NDArray[np.bool_] = self.speed >= LOW_SPEED
        return result


def estimate_speed(
    wheel_speeds: ArrayLike, steering: ArrayLike, yaw_rate: ArrayLike, track: float = 1.5
) -> NDArray[np.float64]:
    """Return the forward speed of a vehicle at its centre of mass from the speeds of its wheels.

    Each wheel that rolls without slip gives the speed: ``w ± ω t / 2`` at the rear, and ``w cos δ ± ω t / 2`` at the front. A
    driven wheel is faster and a braked wheel slower. The result stays within the second and the third of the four sorted speeds,
    and changes as little as possible. One wheel that spins, locks or fails, or one axle that is driven, therefore changes it little.
    If all wheels are braked, it is too small by the slip of the second fastest wheel.

    Parameters
    ----------
    wheel_speeds : array-like, shape (n, 4)
        Rim speeds in metres per second: front left, front right, rear left and rear right.
    steering : array-like, shape (n,)
        Steering angle of the front wheels, in radians.
    yaw_rate : array-like, shape (n,)
        Yaw rate in radians per second.
    track : float
        Distance between the left and the right wheels, in metres, 1.5 by default.

    Returns
    -------
    ndarray, shape (n,)
        Speed in metres per second, >= 0.

    Raises
    ------
    InvalidData
        A value is not finite or out of range, or the shapes differ.
    """
    sizes: dict[str, tuple[int, str]] = {}
    rims = Array(("n", 4), lower=0.0, upper=1000.0).coerce("wheel_speeds", wheel_speeds, sizes)
    angle = Array(("n",), lower=-np.pi / 2, upper=np.pi / 2).coerce("steering", steering, sizes)
    turn = Array(("n",), lower=-100.0, upper=100.0).coerce("yaw_rate", yaw_rate, sizes)
    half = 0.5 * Real(0, strict=True, upper=10.0, unit="m").coerce("track", track, {}) * turn
    forward = np.column_stack([rims[:, :2] * np.cos(angle)[:, None], rims[:, 2:]])
    forward += np.column_stack([half, -half, half, -half])
    middle = np.maximum(np.sort(forward, axis=1)[:, 1:3], 0.0)
    speed, result = float(middle[:1].sum()) / 2.0, np.empty(len(middle))
    for k, (low, high) in enumerate(middle.tolist()):
        result[k] = speed = min(max(speed, low), high)
    return result
