"""Polynomial trajectories through waypoints that minimise a derivative: snap, jerk, any order.

Source: sections 3.2.2 and 3.2.4 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced
for Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021. Lineage:
Mellinger and Kumar 2011; Richter, Bry and Roy 2013; MINCO (Wang, Zhou, Xu, Gao) 2022.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Broadcast, Optional, Whole, declared, frozen
from ..model import Model
from ..verification import TOLERANCE, Verification
from .trajectory import Trajectory, increasing

__all__ = [
    "FREE",
    "Bound",
    "Halfspaces",
    "MinimumDerivative",
    "MinimumSnap",
    "derivative_name",
    "derivative_unit",
]

Floats = NDArray[np.float64]

#: Stands for a coordinate or derivative that is free; None and JSON's null mean the same.
FREE = np.inf

_NAMES = ("position", "velocity", "acceleration", "jerk", "snap", "crackle", "pop")


def derivative_name(order: int) -> str:
    """Return ``"velocity"`` for 1, and so on."""
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
        Which derivative in time.
    lower, upper : ndarray, shape (segments, dimensions)
        Infinite where there is none.
    """

    name: str
    derivative: int
    lower: Floats
    upper: Floats


class Halfspaces(NamedTuple):
    """Half-spaces that hold the position throughout a segment: ``normals @ x <= offsets``.

    Parameters
    ----------
    segments : ndarray of int, shape (halfspaces,)
        The segment of each.
    normals : ndarray, shape (halfspaces, dimensions)
        Normals of length 1, so that a violation is a distance.
    offsets : ndarray, shape (halfspaces,)
        Right-hand sides.
    """

    segments: NDArray[np.int64]
    normals: Floats
    offsets: Floats


@dataclass(frozen=True, eq=False, repr=False)
class MinimumDerivative(Model[Trajectory]):
    """The piecewise polynomial through waypoints with the least ∫ (x^(r))² dt.

    One set of polynomials an axis, one polynomial a segment. Positions are fixed at the waypoints
    (eq. 24), derivatives at the two ends (eq. 23), and any derivative at any knot; neighbours agree
    in position and in the derivatives up to `continuity` (eq. 25). Corridor and limits hold at
    every instant, not at samples. A limit holds for every component: it is a box, not a ball.

    Parameters
    ----------
    waypoints : ndarray, shape (knots, dimensions)
        Positions at the knots (m). None (or :data:`FREE`) leaves a coordinate free.
    times : ndarray, shape (knots,)
        Times of the knots (s), increasing.
    order : int
        r, the derivative that is minimised: 4 snap, 3 jerk, 2 acceleration.
    weights : ndarray, shape (order,), optional
        Weights of the orders 1 … r, for a sum of several; the last must be positive. Without it,
        r alone counts.
    start, end : ndarray, shape (k, dimensions), optional
        Velocity, acceleration, … at the first and the last knot; what is not given is free, and so
        is None. Without it: at rest, the orders 1 … r-1 are zero.
    derivatives : ndarray, shape (knots, k, dimensions), optional
        Velocity, acceleration, … fixed at any knot; None is free. Beside `start` and `end`.
    corridor_lower, corridor_upper : float or ndarray, shape (segments, dimensions), optional
        A box a segment (m): one number, one an axis, one a segment in a column, or all.
    velocity_limit, acceleration_limit, jerk_limit : float or ndarray, optional
        Largest absolute value of each component, broadcast alike.
    polytope_segments : ndarray of int, shape (halfspaces,), optional
        With the next two, half-spaces ``normal @ x <= offset`` that hold a segment's positions.
    polytope_normals : ndarray, shape (halfspaces, dimensions), optional
        Their normals, of any length.
    polytope_offsets : ndarray, shape (halfspaces,), optional
        Their right-hand sides.
    degree : int, optional
        Degree of the polynomials, at least and by default 2r-1: the optimum has no other without
        corridor and limits.
    continuity : int, optional
        The highest derivative that must be continuous, by default r-1. The paper asks for 2 while it
        minimises snap, which is not the minimum-snap spline: its jerk jumps.

    Notes
    -----
    Defaults that depend on the order (`start`, `end`, `degree`, `continuity`) are filled in, so that
    a default and the same value written out are one content; ``dataclasses.replace(model, order=…)``
    therefore keeps them, and wants those named that should change with it.

    Raises
    ------
    InvalidData
        Naming field, index and value: times that do not increase, shapes, fixed values outside the
        corridor or the limits, contradicting conditions.
    """

    waypoints: Floats = declared(Array(("knots", "dimensions"), infinity=1))
    times: Floats = declared(Array(("knots",)))
    order: int = declared(Whole(1, 8), default=4)
    weights: Floats | None = declared(Optional(Array(("orders",), lower=0)), default=None)
    start: Floats = declared(
        Optional(Array(("start rows", "dimensions"), infinity=1)), default=None
    )
    end: Floats = declared(Optional(Array(("end rows", "dimensions"), infinity=1)), default=None)
    derivatives: Floats | None = declared(
        Optional(Array(("knots", "derivative rows", "dimensions"), infinity=1)), default=None
    )
    corridor_lower: Floats | None = declared(
        Optional(Broadcast(("knots", "dimensions"), infinity=-1)), default=None
    )
    corridor_upper: Floats | None = declared(
        Optional(Broadcast(("knots", "dimensions"), infinity=1)), default=None
    )
    velocity_limit: Floats | None = declared(
        Optional(Broadcast(("knots", "dimensions"), lower=0, infinity=1)), default=None
    )
    acceleration_limit: Floats | None = declared(
        Optional(Broadcast(("knots", "dimensions"), lower=0, infinity=1)), default=None
    )
    jerk_limit: Floats | None = declared(
        Optional(Broadcast(("knots", "dimensions"), lower=0, infinity=1)), default=None
    )
    polytope_segments: NDArray[np.int64] | None = declared(
        Optional(Array(("halfspaces",), int, lower=0)), default=None
    )
    polytope_normals: Floats | None = declared(
        Optional(Array(("halfspaces", "dimensions"))), default=None
    )
    polytope_offsets: Floats | None = declared(Optional(Array(("halfspaces",))), default=None)
    degree: int = declared(Optional(Whole(1, 31)), default=None)
    continuity: int = declared(Optional(Whole(0)), default=None)

    kind: ClassVar[str] = "minimum-derivative"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.minimum_snap.formulations.paper:PaperFormulation",
        "monomial": ".models.minimum_snap.formulations.bases:MonomialFormulation",
        "hermite": ".models.minimum_snap.formulations.hermite:HermiteFormulation",
        "legendre": ".models.minimum_snap.formulations.bases:LegendreFormulation",
    }
    default_formulation: ClassVar[str] = "legendre"

    # -- checks ----------------------------------------------------------------------------------

    def check(self) -> None:
        """Fill in the defaults that depend on the order, and refuse what contradicts itself."""
        from .checks import check_conditions

        if self.waypoints.shape[1] == 0:
            raise InvalidData("waypoints must have at least 1 dimension, got 0", field="waypoints")
        increasing("times", self.times)
        # Resolved here, so that a default and the same value written out are one content.
        rest = np.zeros((self.order - 1, self.dimensions))
        for name in ("start", "end"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, frozen(rest.copy()))
        if self.weights is not None:
            if self.weights.size != self.order or self.weights[-1] <= 0:
                raise InvalidData(
                    f"weights must hold one entry for each order 1 … {self.order}, the last > 0, "
                    f"got {self.weights.tolist()}",
                    field="weights",
                )
        if self.derivatives is not None and self.derivatives.shape[1] == 0:
            object.__setattr__(self, "derivatives", None)
        least = 2 * self.order - 1
        if self.degree is None:
            object.__setattr__(self, "degree", least)
        if self.degree < least:
            raise InvalidData(
                f"degree must be >= 2 order - 1 = {least}, got {self.degree}", field="degree"
            )
        if self.continuity is None:
            object.__setattr__(self, "continuity", self.order - 1)
        if self.continuity > self.degree:
            raise InvalidData(
                f"continuity must be <= degree = {self.degree}, got {self.continuity}",
                field="continuity",
            )
        check_conditions(self)

    # -- sizes and conditions --------------------------------------------------------------------

    @property
    def segments(self) -> int:
        """Number of polynomials an axis."""
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
        """The highest derivative that is fixed at some knot."""
        rows = 0 if self.derivatives is None else self.derivatives.shape[1]
        return max(len(self.start), len(self.end), rows)

    @cached_property
    def conditions(self) -> Floats:
        """What is fixed at the knots: shape (knots, highest_fixed + 1, dimensions), else FREE.

        Derivative j of knot k stands in ``conditions[k, j]``.
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
    def bounds(self) -> tuple[Bound, ...]:
        """The corridor's boxes and the limits, where there are any."""
        found = []
        if self.corridor_lower is not None or self.corridor_upper is not None:
            free = np.full((self.segments, self.dimensions), np.inf)
            lower = -free if self.corridor_lower is None else self.corridor_lower
            upper = free if self.corridor_upper is None else self.corridor_upper
            found.append(Bound("corridor", 0, lower, upper))
        for order, limit in enumerate(
            (self.velocity_limit, self.acceleration_limit, self.jerk_limit), start=1
        ):
            if limit is not None:
                found.append(Bound(f"{derivative_name(order)} limit", order, -limit, limit))
        return tuple(b for b in found if np.isfinite(b.lower).any() or np.isfinite(b.upper).any())

    @cached_property
    def halfspaces(self) -> Halfspaces | None:
        """The polytopes' half-spaces with normals of length 1, None where there are none."""
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
    def position_scale(self) -> Floats:
        """What a violation of a position is held against, m, shape (dimensions,).

        The extent of the waypoints and the corridor on each axis, at least 1: it does not change
        with the origin, as the positions themselves do.
        """
        tables = [self.waypoints]
        tables += [t for t in (self.corridor_lower, self.corridor_upper) if t is not None]
        table = np.concatenate(tables)
        low = np.where(np.isfinite(table), table, np.inf).min(axis=0)
        high = np.where(np.isfinite(table), table, -np.inf).max(axis=0)
        extent = np.where(np.isfinite(low) & np.isfinite(high), high - low, 0.0)
        return frozen(np.maximum(1.0, extent))

    def bound_scale(self, bound: Bound) -> tuple[Floats, Floats]:
        """Return what violations of `bound` from below and above are held against.

        Returns
        -------
        tuple of ndarray, shape (segments, dimensions)
            ``max(1, |bound|)``, and for positions :attr:`position_scale`.
        """
        if bound.derivative == 0:
            scale = np.broadcast_to(self.position_scale, bound.lower.shape)
            return scale, scale
        return tuple(
            np.maximum(1.0, np.where(np.isfinite(edge), np.abs(edge), 1.0))
            for edge in (bound.lower, bound.upper)
        )  # type: ignore[return-value]

    @property
    def bounded(self) -> bool:
        """Whether there is a corridor or a limit."""
        return bool(self.bounds) or self.halfspaces is not None

    # -- plans -----------------------------------------------------------------------------------

    def objective(self, plan: Trajectory) -> float:
        """Return Σ w_j ∫ (x^(j))² dt, over all axes."""
        total = 0.0
        for order, weight in enumerate(self.order_weights, start=1):
            if weight:
                total += float(weight) * float(plan.integral_of_square(order).sum())
        return total

    def verify(self, plan: Trajectory, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective by quadrature, and every condition at the knots and in between.

        Corridor and limits are measured at their exact extremes: the ends, and the roots of the
        next derivative.
        """
        from .checks import verify_trajectory

        return verify_trajectory(self, plan, tolerance)

    def plan_to_data(self, plan: Trajectory) -> Any:
        """Return ``{"times": […], "coefficients": [[[…]]]}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> Trajectory:
        """Return the trajectory in `data`."""
        return Trajectory.from_data(data)

    def as_plan(self, value: Any) -> Trajectory:
        """Return the trajectory that `value` means; a SciPy ``PPoly`` is one."""
        found = super().as_plan(value)
        if hasattr(found, "c") and hasattr(found, "x"):
            found = Trajectory.from_ppoly(found)
        return found

    def describe(self) -> str:
        """Return the size in a few words."""
        what = derivative_name(self.order)
        more = [b.name for b in self.bounds] + (["polytopes"] if self.halfspaces else [])
        return (
            f"minimum {what}, {self.segments} segments in {self.dimensions}-D"
            + (", " if more else "")
            + ", ".join(more)
        )


@dataclass(frozen=True, eq=False, repr=False)
class MinimumSnap(MinimumDerivative):
    """The minimum-snap trajectory through waypoints: :class:`MinimumDerivative` with r = 4.

    ``MinimumSnap(waypoints, times)`` goes from rest to rest, with velocity, acceleration and jerk
    zero at both ends. All other parameters are those of the base, `order` and `weights` left out.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import MinimumSnap
    >>> path = ct.solve(MinimumSnap(waypoints=[[0, 0], [1, 2], [3, 2]], times=[0, 1, 3])).plan
    >>> path(1.0).round(6).tolist()
    [1.0, 2.0]
    """

    order: int = field(init=False, default=4)
    weights: Floats | None = field(init=False, default=None)

    kind: ClassVar[str] = "minimum-snap"
    objective_unit: ClassVar[str] = "m²/s⁷"
