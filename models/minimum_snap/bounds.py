"""Fields of a path problem at given times: conditions at the knots, corridor and limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Listed
from ..fields import Array, Broadcast, Flag, Optional, Whole, declared, frozen, show
from ..inputs import Field, FloatArray, FloatsOrNone, Numbers
from ..model import Model
from .gates import Gate
from .trajectory import Trajectory
from .vehicles import Vehicle, VehicleSpec
from .yaw import YawSpec

__all__ = ["FREE", "Bound", "Halfspaces", "PathData", "derivative_name", "derivative_unit"]

Floats = NDArray[np.float64]

#: Largest magnitude of a coordinate or derivative. Squares of larger values overflow.
MOST_MAGNITUDE = 1e100


class _Free(float):
    """Type of :data:`FREE`, which distinguishes it from an accidental infinity in a list."""

    def __repr__(self) -> str:
        return "FREE"


#: Marker of a free coordinate or derivative. None and JSON's null mean the same. Arrays of floats
#: store it as an infinity.
FREE = _Free("inf")


class Coordinates(Array):
    """Array of coordinates or derivatives; entries may be free."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        """Return the checked array. Reject a list with an infinity other than FREE."""
        array = super().coerce(name, value, sizes)
        free = np.isinf(array)
        if free.any() and isinstance(value, list | tuple):
            entries = np.empty(array.shape, object)
            entries[...] = value
            for index in np.argwhere(free):
                entry = entries[tuple(index)]
                if entry is not None and type(entry) is not _Free:
                    where = f"[{', '.join(map(str, index))}]"
                    raise InvalidData(
                        f"{name}{where} must be finite, or FREE or None for a free coordinate, "
                        f"got {show(entry)}",
                        field=name,
                    )
        large = ~free & (np.abs(array) > MOST_MAGNITUDE)
        self._refuse(name, array, large, f"must be within ±{MOST_MAGNITUDE:g}")
        return array


_NAMES = ("position", "velocity", "acceleration", "jerk", "snap", "crackle", "pop")


def derivative_name(order: int) -> str:
    """Return the name of a derivative in time.

    Parameters
    ----------
    order : int
        Order of the derivative, at least 0.

    Returns
    -------
    str
        ``"position"`` for 0, ``"velocity"`` for 1, … ``"pop"`` for 6, then ``"derivative 7"``.

    Raises
    ------
    InvalidData
        `order` is not a non-negative integer.
    """
    order = Whole(0).coerce("order", order, {})
    return _NAMES[order] if order < len(_NAMES) else f"derivative {order}"


def derivative_unit(order: int) -> str:
    """Return the unit of a derivative of a position in metres."""
    return "m" if order == 0 else "m/s" if order == 1 else f"m/s^{order}"


class Bound(NamedTuple):
    """A bound on every component of one derivative, throughout each segment.

    Parameters
    ----------
    name : str
        ``"corridor"``, ``"velocity limit"``, …
    derivative : int
        Order of the derivative in time: 0 position, 1 velocity, …
    lower, upper : ndarray, shape (segments, dimensions)
        Smallest and largest value, m/s^derivative; infinite for unbounded components.
    """

    name: str
    derivative: int
    lower: Floats
    upper: Floats


class Halfspaces(NamedTuple):
    """Half-spaces that contain the positions of a segment: ``normals @ x <= offsets``.

    Parameters
    ----------
    segments : ndarray of int, shape (halfspaces,)
        Index of the segment of each half-space.
    normals : ndarray, shape (halfspaces, dimensions)
        Normals of length 1, so that a violation is a distance.
    offsets : ndarray, shape (halfspaces,)
        Right-hand sides in metres.
    """

    segments: NDArray[np.int64]
    normals: Floats
    offsets: Floats


def _limit(unit: str) -> Optional:
    """Return the specification of a non-negative limit of each axis on each segment."""
    return Optional(Broadcast(("knots", "dimensions"), lower=0, infinity=1, unit=unit))


@dataclass(frozen=True, eq=False, repr=False)
class PathData(Model[Trajectory]):
    """Fields of :class:`~crosstrack.models.MinimumDerivative` and the values derived from them.

    The model and the checks of its data and plans read these fields. The model describes the
    parameters.
    """

    waypoints: FloatArray = declared(Coordinates(("knots", "dimensions"), infinity=1, unit="m"))
    times: FloatArray = declared(Array(("knots",), unit="s"))
    order: int = declared(Whole(1, 8), default=4)
    weights: FloatsOrNone = declared(Optional(Array(("orders",), lower=0)), default=None)
    start: Field[Numbers | None, Floats] = declared(
        Optional(Coordinates(("start rows", "dimensions"), infinity=1)), default=None
    )
    end: Field[Numbers | None, Floats] = declared(
        Optional(Coordinates(("end rows", "dimensions"), infinity=1)), default=None
    )
    derivatives: FloatsOrNone = declared(
        Optional(Coordinates(("knots", "derivative rows", "dimensions"), infinity=1)), default=None
    )
    corridor_lower: FloatsOrNone = declared(
        Optional(Broadcast(("knots", "dimensions"), infinity=-1, unit="m")), default=None
    )
    corridor_upper: FloatsOrNone = declared(
        Optional(Broadcast(("knots", "dimensions"), infinity=1, unit="m")), default=None
    )
    velocity_limit: FloatsOrNone = declared(_limit("m/s"), default=None)
    acceleration_limit: FloatsOrNone = declared(_limit("m/s²"), default=None)
    jerk_limit: FloatsOrNone = declared(_limit("m/s³"), default=None)
    polytope_segments: Field[Numbers | None, NDArray[np.int64] | None] = declared(
        Optional(Array(("halfspaces",), int, lower=0)), default=None
    )
    polytope_normals: FloatsOrNone = declared(
        Optional(Array(("halfspaces", "dimensions"))), default=None
    )
    polytope_offsets: FloatsOrNone = declared(
        Optional(Array(("halfspaces",), unit="m")), default=None
    )
    degree: Field[int | None, int] = declared(Optional(Whole(1, 31)), default=None)
    continuity: Field[int | None, int] = declared(Optional(Whole(0)), default=None)
    vehicle: Field[Vehicle | Mapping[str, Any] | None, Vehicle | None] = declared(
        Optional(VehicleSpec()), default=None, added=True
    )
    yaw: Field[Numbers | str | None, Floats | float | str | None] = declared(
        Optional(YawSpec()), default=None, added=True
    )
    periodic: bool = declared(Flag(), default=False, added=True)
    gates: tuple[Gate, ...] = declared(Listed(Gate), default=(), added=True)

    plan_type: ClassVar[type] = Trajectory

    # -- sizes and conditions --------------------------------------------------------------------

    @property
    def segments(self) -> int:
        """Number of segments: polynomials per axis."""
        return int(self.times.size) - 1

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        return int(self.waypoints.shape[1])

    @cached_property
    def durations(self) -> Floats:
        """Duration of each segment, s, shape (segments,)."""
        return frozen(np.diff(self.times))

    @cached_property
    def order_weights(self) -> Floats:
        """Weight of each order 1 … r in the objective, shape (order,)."""
        if self.weights is not None:
            return self.weights
        single = np.zeros(self.order)
        single[-1] = 1.0
        return frozen(single)

    @property
    def highest_fixed(self) -> int:
        """Highest order of a derivative that is fixed at any knot."""
        rows = 0 if self.derivatives is None else self.derivatives.shape[1]
        return max(len(self.start), len(self.end), rows)

    @cached_property
    def conditions(self) -> Floats:
        """Fixed values at the knots, shape (knots, highest_fixed + 1, dimensions).

        ``conditions[k, j]`` is derivative j at knot k. Free components are :data:`FREE`.
        """
        table = np.full((self.times.size, self.highest_fixed + 1, self.dimensions), FREE)
        table[:, 0] = self.waypoints
        if self.derivatives is not None:
            table[:, 1 : 1 + self.derivatives.shape[1]] = self.derivatives
        for knot, rows in ((0, self.start), (-1, self.end)):
            given = table[knot, 1 : 1 + len(rows)]
            table[knot, 1 : 1 + len(rows)] = np.where(np.isfinite(rows), rows, given)
        return frozen(table)

    @cached_property
    def jets(self) -> Floats:
        """Fixed derivatives 0 … r-1 at the knots, shape (knots, order, dimensions), else FREE."""
        table = np.full((self.times.size, self.order, self.dimensions), FREE)
        rows = min(self.order, self.conditions.shape[1])
        table[:, :rows] = self.conditions[:, :rows]
        return frozen(table)

    @property
    def fixes_order(self) -> bool:
        """Whether a derivative of order r or above is fixed at any knot."""
        return bool(np.isfinite(self.conditions[:, self.order :]).any())

    @cached_property
    def bounds(self) -> tuple[Bound, ...]:
        """Corridor boxes and limits that bound at least one component."""
        candidates = []
        if self.corridor_lower is not None or self.corridor_upper is not None:
            free = np.full((self.segments, self.dimensions), np.inf)
            lower = frozen(-free) if self.corridor_lower is None else self.corridor_lower
            upper = frozen(free) if self.corridor_upper is None else self.corridor_upper
            candidates.append(Bound("corridor", 0, lower, upper))
        for order, limit in enumerate(
            (self.velocity_limit, self.acceleration_limit, self.jerk_limit), start=1
        ):
            if limit is not None:
                name = f"{derivative_name(order)} limit"
                candidates.append(Bound(name, order, frozen(-limit), limit))
        return tuple(
            bound
            for bound in candidates
            if np.isfinite(bound.lower).any() or np.isfinite(bound.upper).any()
        )

    @cached_property
    def halfspaces(self) -> Halfspaces | None:
        """Half-spaces of the polytopes with normals of length 1; None without polytopes."""
        if self.polytope_segments is None or not self.polytope_segments.size:
            return None
        assert self.polytope_normals is not None and self.polytope_offsets is not None
        length = np.linalg.norm(self.polytope_normals, axis=1)
        return Halfspaces(
            self.polytope_segments,
            frozen(self.polytope_normals / length[:, None]),
            frozen(self.polytope_offsets / length),
        )

    @cached_property
    def reach(self) -> tuple[Floats, Floats]:
        """Smallest and largest coordinate of waypoints and corridor per axis, m, else inf and -inf."""
        tables = (self.waypoints, self.corridor_lower, self.corridor_upper)
        shapes = [
            gate.frame.centre[None] if gate.polygon is None else gate.polygon for gate in self.gates
        ]
        table = np.concatenate([table for table in (*tables, *shapes) if table is not None])
        low = np.where(np.isfinite(table), table, np.inf).min(axis=0)
        high = np.where(np.isfinite(table), table, -np.inf).max(axis=0)
        return frozen(low), frozen(high)

    @cached_property
    def position_scale(self) -> Floats:
        """Scale of position violations per axis, m, shape (dimensions,).

        Extent of the waypoints and the corridor on each axis, at least a tenth of the widest extent.
        Unlike the positions, it is independent of the origin. If only derivatives are given, the
        scale is the distance that they cover in a mean segment, or 1 if they are all 0.
        """
        low, high = self.reach
        extent = np.where(np.isfinite(low), high - low, 0.0)
        fixed = np.where(np.isfinite(self.conditions[:, 1:]), np.abs(self.conditions[:, 1:]), 0.0)
        orders = np.arange(1, fixed.shape[1] + 1)
        distance = fixed.max(axis=(0, 2), initial=0.0) * float(self.durations.mean()) ** orders
        widest = max(float(extent.max()), float(distance.max(initial=0.0)))
        return frozen(np.maximum(extent, 0.1 * widest if widest > 0 else 1.0))

    def derivative_scale(self, order: int) -> Floats:
        """Return the minimum scale of violations of a derivative, shape (dimensions,).

        It is the peak of the derivative if the path covers :attr:`position_scale` in equal segments
        of the whole duration, each segment as half a sine wave.

        Parameters
        ----------
        order : int
            Order of the derivative.
        """
        if order == 0:
            return self.position_scale
        return 0.5 * np.pi**order * self._mean_rate(order)

    def _mean_rate(self, order: int) -> Floats:
        """Return the mean step of the path over the mean duration to a power, shape (dimensions,)."""
        with np.errstate(all="ignore"):  # extreme durations yield a rate of 0 or infinity
            rate: Floats = self.position_scale / self.segments / self._mean_duration**order
        return rate

    @cached_property
    def _mean_duration(self) -> np.float64:
        return np.float64(self.durations.mean())

    @cached_property
    def objective_scale(self) -> float:
        """Objective of a path whose derivatives equal the mean rates throughout.

        Half waves would give a scale thousands of times as large, which exceeds the objective of
        smooth paths in corridors.
        """
        whole = float(self.durations.sum())
        parts = (
            weight * float((self._mean_rate(order) ** 2).sum())
            for order, weight in enumerate(self.order_weights.tolist(), start=1)
        )
        return float(whole * sum(parts))

    def bound_scale(self, bound: Bound) -> tuple[Floats, Floats]:
        """Return the scales of violations of `bound` from below and from above.

        Parameters
        ----------
        bound : Bound
            Bound of this model.

        Returns
        -------
        tuple of ndarray, shape (segments, dimensions)
            Magnitude of the bound, or :meth:`derivative_scale` if the bound is 0 or infinite. For
            positions, :attr:`position_scale`.
        """
        fallback = np.broadcast_to(self.derivative_scale(bound.derivative), bound.lower.shape)
        if bound.derivative == 0:
            return fallback, fallback
        return tuple(
            np.where(np.isfinite(edge) & (edge != 0), np.abs(edge), fallback)
            for edge in (bound.lower, bound.upper)
        )  # type: ignore[return-value]

    def in_unit(self, length: float) -> Self:
        """Return the model with lengths in units of `length` m. Its objective is J / length²."""
        names = [
            "waypoints", "start", "end", "derivatives", "corridor_lower", "corridor_upper",
            "velocity_limit", "acceleration_limit", "jerk_limit", "polytope_offsets",
        ]  # fmt: skip
        fields = {name: getattr(self, name) for name in names}
        scaled = {name: value / length for name, value in fields.items() if value is not None}
        return replace(self, **scaled, gates=tuple(gate.in_unit(length) for gate in self.gates))

    @property
    def bounded(self) -> bool:
        """Whether the model has a corridor, a polytope or a limit."""
        return bool(self.bounds) or self.halfspaces is not None

    @property
    def joint_order(self) -> int:
        """Highest derivative that agrees at the first and last knot of a lap; -1 without laps.

        It is 4, as the snap determines the motors' torques, or that of inner knots if it is higher. Orders up
        to 2r-2 agree by optimality if only waypoints are fixed.
        """
        return max(self.continuity, min(4, 2 * self.order - 2)) if self.periodic else -1

    def require_shape(self, plan: Trajectory) -> None:
        """Check the shape of a plan.

        Parameters
        ----------
        plan : Trajectory
            Trajectory to check.

        Raises
        ------
        InvalidData
            `plan` has another number of segments or dimensions.
        """
        if plan.segments != self.segments or plan.dimensions != self.dimensions:
            raise InvalidData(
                f"plan has {plan.segments} segments in {plan.dimensions}-D, the model "
                f"{self.segments} in {self.dimensions}-D",
                field="plan",
            )

    def objective(self, plan: Trajectory) -> float:
        """Return Σ w_j ∫ (x^(j))² dt over all axes, m²/s^(2r-1)."""
        total = 0.0
        for order, weight in enumerate(self.order_weights, start=1):
            if weight:
                total += float(weight) * float(plan.integral_of_square(order).sum())
        return total
