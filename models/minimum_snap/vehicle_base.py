"""Base of vehicles: limited quantities, their extremes along a trajectory, and the field of a model."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..specs import Optional, Real, Spec, declared, show
from .jets import Jet, squared_norm
from .motion import Motion, extended
from .peaks import peaks

if TYPE_CHECKING:
    from .motion import Yaw
    from .trajectory import Trajectory

__all__ = [
    "Extreme",
    "Measure",
    "PointMass",
    "Vehicle",
    "VehicleSpec",
    "components",
    "constant",
    "norm_measure",
    "positive",
    "root",
    "sizes",
]

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


def root(value: Any) -> Any:
    """Return the square root; 0 for negative values, which only rounding yields."""
    return np.sqrt(np.maximum(value, 0.0))


def norm_measure(
    name: str, unit: str, limit: float | None, vector: Callable[[Motion], list[Jet]], convex: bool
) -> list[Measure]:
    """Return the measure of the norm of a vector; empty without a limit."""
    if limit is None:
        return []
    return [
        Measure(
            name, unit, limit, lambda at: squared_norm(vector(at)), limit**2, root,
            lambda at: [constant(at, limit), *vector(at)], convex,
        )
    ]  # fmt: skip


def constant(motion: Motion, value: float) -> Jet:
    """Return a constant series of the motion's shape."""
    return motion.position[0] * 0.0 + value


def positive(unit: str) -> Any:
    """Return the field of an optional positive limit in a unit."""
    return declared(Optional(Real(0.0, strict=True, unit=unit)), default=None)


@dataclass(frozen=True, eq=False)
class Vehicle(Declared):
    """Base of vehicles."""

    kind: ClassVar[str] = ""
    #: Vehicles by their kind.
    _kinds: ClassVar[dict[str, type[Vehicle]]] = {}
    #: Number of axes of a trajectory of the vehicle; None for any.
    axes: ClassVar[int | None] = None
    #: Whether the vehicle's quantities depend on the direction of the path.
    follows_path: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        Vehicle._kinds[cls.kind] = cls

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
        arithmetic proves for all instants up to rounding. An extreme near its limit is at most 1e-9 of the
        limit from the value at `time`; smaller ones are less accurate (norms at most 4e-5 of the limit).

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

    speed: float | None = positive("m/s")
    acceleration: float | None = positive("m/s²")

    kind: ClassVar[str] = "point-mass"

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Speed and acceleration."""
        return (
            *norm_measure("speed", "m/s", self.speed, lambda at: at.velocity, True),
            *norm_measure("acceleration", "m/s²", self.acceleration, lambda at: at.acceleration, True),
        )  # fmt: skip

    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        return {"speed": sizes(motion.velocity), "acceleration": sizes(motion.acceleration)}


def components(vector: Iterable[Jet]) -> Floats:
    """Return the values of a vector of series, shape (n, components)."""
    return np.column_stack([component.terms[0] for component in vector])


def sizes(vector: Sequence[Jet]) -> Floats:
    """Return the norms of a vector of series at instants, shape (n,)."""
    norm: Floats = np.linalg.norm(components(vector), axis=1)
    return norm


@dataclass(frozen=True)
class VehicleSpec(Spec):
    """Field that holds a vehicle, given as such or as its JSON data."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Vehicle:
        if isinstance(value, Vehicle):
            return value
        if not isinstance(value, Mapping):
            allowed = ", ".join(vehicle.__name__ for vehicle in Vehicle._kinds.values())
            raise InvalidData(
                f"{name} must be a vehicle ({allowed}) or its data, got {show(value)}", field=name
            )
        kind = value.get("kind")
        if not isinstance(kind, str) or kind not in Vehicle._kinds:
            raise InvalidData(
                f"{name}.kind must be one of {', '.join(Vehicle._kinds)}, got {show(kind)}",
                field=name,
            )
        return Vehicle._kinds[kind]._from_data(
            {key: entry for key, entry in value.items() if key != "kind"}
        )

    def encode(self, value: Vehicle) -> Any:
        return value.data()

    def feed(self, value: Vehicle) -> Iterable[bytes]:
        yield value.kind.encode()
        yield from value._feed()
