"""Vehicles: limits of a trajectory that follow from the forces and wheels that move it.

Sources: Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA
2011 (differential flatness); Watterson and Kumar, "Control of quadrotors using the Hopf fibration on
SO(3)", ISRR 2017 (attitude without a singularity in level flight); Wang, Zhou, Xu and Gao,
"Geometrically constrained trajectory optimization for multicopters", 2022 (drag).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..arrays import NumberTuple
from ..declaration import Declared
from ..specs import Optional, Real, Spec, declared, show
from .jets import Jet, squared_norm
from .motion import Motion, extended
from .peaks import peaks

if TYPE_CHECKING:
    from .motion import Yaw
    from .trajectory import Trajectory

__all__ = ["DifferentialDrive", "Measure", "PointMass", "Quadrotor", "Vehicle", "VehicleSpec"]

Floats = NDArray[np.float64]


class Measure(NamedTuple):
    """Limited quantity of a vehicle.

    Parameters
    ----------
    name : str
        Name of the quantity, such as ``"thrust"``.
    unit : str
        Its unit.
    limit : float
        Limit in that unit.
    function : callable
        Series of a function of the quantity whose limit is the upper bound `level`, from the motion.
    level : float
        Value of `function` at the limit.
    value : callable
        Quantity from the value of `function`.
    cone : callable
        Series ``[t, *y]`` from the motion: the limit holds if and only if ``|y| <= t``.
    is_convex : bool
        Whether the series of the cone are affine in the position, so that they define a convex set.
    is_upper : bool
        Whether the limit is the largest allowed value, else the smallest.
    """

    name: str
    unit: str
    limit: float
    function: Callable[[Motion], Jet]
    level: float
    value: Callable[[Any], Any]
    cone: Callable[[Motion], list[Jet]]
    is_convex: bool
    is_upper: bool = True


class Extreme(NamedTuple):
    """Largest value of a limited quantity along a trajectory, or the smallest one for a lower limit.

    Parameters
    ----------
    name, equation : str
        Name of the quantity, and the equation of its limit (empty).
    amount : float
        Violation of the limit, negative for slack.
    unit : str
        Unit of the quantity.
    time : float
        Instant of the value, s.
    limit, value : float
        Limit and proven extreme value.
    """

    name: str
    equation: str
    amount: float
    unit: str
    time: float
    limit: float
    value: float


def _root(value: Any) -> Any:
    return np.sqrt(np.maximum(value, 0.0))


def _norm(
    name: str, unit: str, limit: float | None, vector: Callable[[Motion], list[Jet]], convex: bool
) -> list[Measure]:
    """Return the measure of the norm of a vector; empty without a limit."""
    if limit is None:
        return []
    return [
        Measure(
            name, unit, limit, lambda at: squared_norm(vector(at)), limit**2, _root,
            lambda at: [_constant(at, limit), *vector(at)], convex,
        )
    ]  # fmt: skip


def _constant(motion: Motion, value: float) -> Jet:
    """Return a constant series of the motion's shape."""
    return motion.position[0] * 0.0 + value


def _limit(unit: str, upper: float | None = None) -> Any:
    return declared(Optional(Real(0.0, upper, strict=True, unit=unit)), default=None)


@dataclass(frozen=True, eq=False)
class Vehicle(Declared):
    """Base of vehicles."""

    kind: ClassVar[str] = ""
    #: Number of axes of a trajectory of the vehicle; None for any.
    axes: ClassVar[int | None] = None
    #: Whether the vehicle's quantities depend on the direction of the path.
    follows_path: ClassVar[bool] = False

    @property
    @abstractmethod
    def measures(self) -> tuple[Measure, ...]:
        """Limited quantities."""

    @property
    def limits(self) -> dict[str, str]:
        """Names of the limited quantities with their units."""
        return {measure.name: measure.unit for measure in self.measures}

    def quantities(
        self, trajectory: Trajectory, t: ArrayLike, yaw: Yaw = None
    ) -> dict[str, Floats]:
        """Return quantities of the flight at given times, for plots, exports and simulations.

        Parameters
        ----------
        trajectory : Trajectory
            Positions, m.
        t : ndarray, shape (n,)
            Times between the first and the last knot, s.
        yaw : None, "tangent", float or Trajectory
            Yaw, rad.

        Returns
        -------
        dict of str to ndarray
            One array with n rows per quantity.

        Raises
        ------
        InvalidData
            The trajectory has another number of axes than the vehicle, or a time is outside it.
        """
        self.require_axes(trajectory.dimensions, "trajectory")
        with np.errstate(all="ignore"):  # undefined quantities are NaN
            series = extended(trajectory, yaw, self.follows_path)
            return self._quantities(series.at(np.atleast_1d(np.asarray(t)), 4))

    def check_curve(
        self, trajectory: Trajectory, yaw: Yaw = None, *, exact: bool = True
    ) -> list[Extreme]:
        """Return the proven extreme of each limited quantity along a trajectory.

        Every extreme is an upper bound (a lower bound for a lower limit) that bisection with interval
        arithmetic proves for all instants up to rounding, at most 1e-9 from the value at `time`.

        Parameters
        ----------
        trajectory : Trajectory
            Positions, m.
        yaw : None, "tangent", float or Trajectory
            Yaw, rad.
        exact : bool
            If false, bounds within the limit may be far above the extreme.

        Raises
        ------
        InvalidData
            The trajectory has another number of axes than the vehicle.
        """
        self.require_axes(trajectory.dimensions, "trajectory")
        series = extended(trajectory, yaw, self.follows_path)
        result = []
        for name, unit, limit, function, level, value, _, _, upper in self.measures:
            accept = -math.inf if exact else level
            bound, _, time = peaks(series, function, scale=abs(level), accept=accept)
            at = int(bound.argmax())
            extreme = float(value(bound[at]))
            amount = extreme - limit if upper else limit - extreme
            result.append(Extreme(name, "", amount, unit, float(time[at]), limit, extreme))
        return result

    @abstractmethod
    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        """Return the quantities of :meth:`quantities` from the series at the times."""

    def require_axes(self, axes: int, field: str) -> None:
        """Raise :class:`InvalidData` unless the vehicle moves along this number of axes."""
        if self.axes is not None and axes != self.axes:
            raise InvalidData(
                f"{field} must have {self.axes} axes for a {type(self).__name__}, got {axes}",
                field=field,
            )

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data, with the kind of the vehicle."""
        return {"kind": self.kind, **super().data()}

    @classmethod
    def from_data(cls, data: Any) -> Any:
        """Return the vehicle that :meth:`data` wrote.

        Parameters
        ----------
        data : mapping
            JSON data with the key ``kind``.

        Raises
        ------
        InvalidData
            The kind is unknown, or a value is invalid.
        """
        return VehicleSpec().coerce("vehicle", data, {})

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is a vehicle of the same type with the same values."""
        if type(self) is not type(other):
            return NotImplemented
        return self.data() == other.data()

    def __hash__(self) -> int:
        return hash((self.kind, tuple(self._feed())))


@dataclass(frozen=True, eq=False)
class PointMass(Vehicle):
    """Vehicle with limits on the norms of velocity and acceleration, in any dimension.

    Parameters
    ----------
    speed : float, optional
        Largest norm of the velocity, m/s.
    acceleration : float, optional
        Largest norm of the acceleration, m/s².

    Raises
    ------
    InvalidData
        A limit is not positive.
    """

    speed: float | None = _limit("m/s")
    acceleration: float | None = _limit("m/s²")

    kind: ClassVar[str] = "point-mass"

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Speed and acceleration."""
        return (
            *_norm("speed", "m/s", self.speed, lambda at: at.velocity, True),
            *_norm("acceleration", "m/s²", self.acceleration, lambda at: at.acceleration, True),
        )  # fmt: skip

    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        return {"speed": _size(motion.velocity), "acceleration": _size(motion.acceleration)}


@dataclass(frozen=True, eq=False)
class Quadrotor(Vehicle):
    """Quadrotor with limits on its thrust, tilt and body rates, through differential flatness.

    The thrust balances ``F = mass (a + gravity e₃) + drag v``; the body's axis has the direction of F.
    The attitude is the smallest rotation of the vertical to F, followed by the yaw about the body's
    axis (Hopf fibration). Without a yaw, the yaw is 0. The body rate is the norm of the whole
    angular velocity, with its component about the body's axis.

    Parameters
    ----------
    mass : float
        Mass, kg.
    thrust : tuple of float
        Smallest and largest collective thrust, N: ``0 <= low < mass gravity < high``.
    tilt : float, optional
        Largest angle between the body's axis and the vertical, rad, in (0, π/2).
    body_rate : float, optional
        Largest norm of the angular velocity, rad/s.
    drag : float
        Coefficient of the linear drag, kg/s.
    speed, acceleration : float, optional
        Largest norms of velocity (m/s) and acceleration (m/s²).
    yaw_rate : float, optional
        Largest absolute value of the rate of the yaw, rad/s.
    gravity : float
        Gravitational acceleration, m/s².

    Raises
    ------
    InvalidData
        A value is outside its range, or hovering is impossible within the limits of the thrust.
    """

    mass: float = declared(Real(0.0, strict=True, unit="kg"))
    thrust: tuple[float, float] = declared(NumberTuple((2,), unit="N"))
    tilt: float | None = _limit("rad")
    body_rate: float | None = _limit("rad/s")
    drag: float = declared(Real(0.0, unit="kg/s"), default=0.0)
    speed: float | None = _limit("m/s")
    acceleration: float | None = _limit("m/s²")
    yaw_rate: float | None = _limit("rad/s")
    gravity: float = declared(Real(0.0, strict=True, unit="m/s²"), default=9.81)

    kind: ClassVar[str] = "quadrotor"
    axes: ClassVar[int | None] = 3

    def check(self) -> None:
        """Reject thrusts that make hovering impossible, and tilts of a right angle or more."""
        low, high = self.thrust
        weight = self.mass * self.gravity
        if low < 0:
            raise InvalidData(f"thrust[0] must be >= 0 N, got {low:g}", field="thrust")
        if not low < weight < high:
            raise InvalidData(
                f"thrust must enclose the weight mass * gravity = {weight:g} N, otherwise hovering "
                f"is impossible, got ({low:g}, {high:g})",
                field="thrust",
            )
        if self.tilt is not None and self.tilt >= math.pi / 2:
            raise InvalidData(f"tilt must be < pi/2 rad, got {self.tilt:g}", field="tilt")

    def force(self, motion: Motion) -> list[Jet]:
        """Return the series of the force F of the thrust, N."""
        pairs = zip(motion.velocity, motion.acceleration, strict=True)
        force = [
            acceleration * self.mass + velocity * self.drag for velocity, acceleration in pairs
        ]
        return [*force[:2], force[2] + self.mass * self.gravity]

    def _tilt(self, motion: Motion) -> Jet:
        """Return tan²(tilt / 2), which increases from 0 to infinity at the reversed vertical."""
        force = self.force(motion)
        return squared_norm(force[:2]) / (squared_norm(force).root() + force[2]).square()

    def _rates(self, motion: Motion) -> tuple[list[Jet], Jet]:
        """Return the rate of the body's axis and the angular velocity about it."""
        force = self.force(motion)
        size = squared_norm(force).root()
        axis = [component / size for component in force]
        turn = [component.rate() for component in axis]
        spin = (axis[1] * turn[0] - axis[0] * turn[1]) / (axis[2] + 1.0)
        return turn, spin if motion.turn is None else spin + motion.turn

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Thrust, tilt, body rate, speed, acceleration and yaw rate."""
        low, high = self.thrust
        measures = _norm("thrust", "N", high, self.force, True)
        if low > 0:
            measures.append(
                Measure(
                    "lowest thrust", "N", low, lambda at: -squared_norm(self.force(at)), -(low**2),
                    lambda value: _root(-value),
                    lambda at: [squared_norm(self.force(at)).root() - low], False, False,
                )
            )  # fmt: skip
        if self.tilt is not None:
            slope = math.tan(self.tilt)

            def cone(motion: Motion) -> list[Jet]:
                force = self.force(motion)
                return [force[2] * slope, *force[:2]]

            measures.append(
                Measure(
                    "tilt", "rad", self.tilt, self._tilt, math.tan(self.tilt / 2) ** 2,
                    lambda value: 2 * np.arctan(_root(value)), cone, True,
                )
            )  # fmt: skip
        measures += _norm("body rate", "rad/s", self.body_rate, self._body_rates, False)
        measures += PointMass(self.speed, self.acceleration).measures
        measures += _norm("yaw rate", "rad/s", self.yaw_rate, self._yaw_rate, False)
        return tuple(measures)

    def _body_rates(self, motion: Motion) -> list[Jet]:
        """Return a vector whose norm is that of the angular velocity."""
        turn, spin = self._rates(motion)
        return [*turn, spin]

    def _yaw_rate(self, motion: Motion) -> list[Jet]:
        return [_constant(motion, 0.0) if motion.turn is None else motion.turn]

    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        (turn, spin), force = self._rates(motion), _first(self.force(motion))
        size = np.linalg.norm(force, axis=1)
        z, dz = force / size[:, None], _first(turn)
        yaw = motion.heading
        lean = dz[:, 2] / (1.0 + z[:, 2])
        across = z[:, 1] * lean - dz[:, 1]
        along = dz[:, 0] - z[:, 0] * lean
        c, s = np.cos(yaw), np.sin(yaw)
        rates = np.column_stack([c * across + s * along, c * along - s * across, spin.terms[0]])
        half = np.sqrt(2.0 * (1.0 + z[:, 2]))
        w, x, y = 0.5 * half, -z[:, 1] / half, z[:, 0] / half
        ch, sh = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
        attitude = np.column_stack([w * ch, x * ch + y * sh, y * ch - x * sh, w * sh])
        flat = np.hypot(force[:, 0], force[:, 1])
        return {
            "speed": _size(motion.velocity),
            "acceleration": _size(motion.acceleration),
            "thrust": size,
            "tilt": np.arctan2(flat, force[:, 2]),
            "body_rate": np.linalg.norm(rates, axis=1),
            "body_rates": rates,
            "attitude": attitude,
            "yaw": yaw,
            "yaw_rate": np.zeros(len(z)) if motion.turn is None else motion.turn.terms[0],
        }


@dataclass(frozen=True, eq=False)
class DifferentialDrive(Vehicle):
    """Robot on two driven wheels that moves forward along the tangent of its path.

    The speeds of the wheels are ``v ± ω track / 2`` with the speed v and the rate ω of the heading. At
    standstill they are the limit values along the path.

    Parameters
    ----------
    wheel_speed : float
        Largest absolute speed of a wheel over the ground, m/s.
    wheel_acceleration : float, optional
        Largest absolute acceleration of a wheel, m/s².
    track : float
        Distance between the wheels, m.

    Raises
    ------
    InvalidData
        A value is not positive.
    """

    wheel_speed: float = declared(Real(0.0, strict=True, unit="m/s"))
    wheel_acceleration: float | None = _limit("m/s²")
    track: float = declared(Real(0.0, strict=True, unit="m"), default=None)  # required: None raises

    kind: ClassVar[str] = "differential-drive"
    axes: ClassVar[int | None] = 2
    follows_path: ClassVar[bool] = True

    def _wheel_speed(self, side: float, motion: Motion) -> list[Jet]:
        """Return the speed of the wheel on a side: 1 right, -1 left."""
        speed, turn = motion.course
        return [speed + turn * (0.5 * side * self.track)]

    def _wheel_acceleration(self, side: float, motion: Motion) -> list[Jet]:
        return [wheel.rate() for wheel in self._wheel_speed(side, motion)]

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Speed and acceleration of both wheels, and the speed that follows: the mean of the wheels."""
        result = list(PointMass(speed=self.wheel_speed).measures)
        for word, side in (("left", -1.0), ("right", 1.0)):
            result += _norm(
                f"{word} wheel speed", "m/s", self.wheel_speed,
                partial(self._wheel_speed, side), False,
            )  # fmt: skip
            result += _norm(
                f"{word} wheel acceleration", "m/s²", self.wheel_acceleration,
                partial(self._wheel_acceleration, side), False,
            )  # fmt: skip
        return tuple(result)

    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        speed, turn = motion.course
        left, right = (self._wheel_speed(side, motion)[0] for side in (-1.0, 1.0))
        return {
            "speed": speed.terms[0],
            "turn_rate": turn.terms[0],
            "heading": motion.heading,
            "wheel_speeds": np.column_stack([left.terms[0], right.terms[0]]),
            "wheel_accelerations": np.column_stack([left.terms[1], right.terms[1]]),
        }


def _first(vector: Iterable[Jet]) -> Floats:
    """Return the values of a vector of series, shape (n, components)."""
    return np.column_stack([component.terms[0] for component in vector])


def _size(vector: Sequence[Jet]) -> Floats:
    norm: Floats = np.linalg.norm(_first(vector), axis=1)
    return norm


#: Vehicles by their name in JSON.
_KINDS: dict[str, type[Vehicle]] = {
    vehicle.kind: vehicle for vehicle in (PointMass, Quadrotor, DifferentialDrive)
}


@dataclass(frozen=True)
class VehicleSpec(Spec):
    """Field that holds a vehicle, given as such or as its JSON data."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Vehicle:
        if isinstance(value, Vehicle):
            return value
        if not isinstance(value, Mapping):
            allowed = ", ".join(vehicle.__name__ for vehicle in _KINDS.values())
            raise InvalidData(
                f"{name} must be a vehicle ({allowed}) or its data, got {show(value)}", field=name
            )
        kind = value.get("kind")
        if not isinstance(kind, str) or kind not in _KINDS:
            raise InvalidData(
                f"{name}.kind must be one of {', '.join(_KINDS)}, got {show(kind)}", field=name
            )
        return _KINDS[kind]._from_data(
            {key: entry for key, entry in value.items() if key != "kind"}
        )

    def encode(self, value: Vehicle) -> Any:
        return value.data()

    def feed(self, value: Vehicle) -> Iterable[bytes]:
        yield value.kind.encode()
        yield from value._feed()
