"""Time allocation: the minimum-derivative trajectory with free durations of the segments.

Sources: Richter, Bry and Roy, "Polynomial trajectory planning for aggressive quadrotor flight in
dense indoor environments", ISRR 2013 (J + ρ ΣT, descent on the times); Wang, Zhou, Xu and Gao,
"Geometrically constrained trajectory optimization for multicopters" (MINCO), 2022 (gradients of
the times at the cost of one solve).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Optional, Real, declared, frozen, required
from ..inputs import Field, FloatArray, FloatsOrNone, Numbers
from ..model import Model
from ..records import Member
from ..verification import TOLERANCE, Check, Verification
from .bounds import Bound, Halfspaces, derivative_name
from .gates import Gate
from .model import MinimumDerivative
from .time_checks import check_limits, check_movement
from .trajectory import Trajectory
from .vehicles import Vehicle

__all__ = ["Minimise", "TimeAllocation"]

Floats = NDArray[np.float64]

_SHARED = {field.name: field for field in dataclasses.fields(MinimumDerivative)}

#: Fields whose defaults :class:`MinimumDerivative` fills in.
_COMPLETED = ("start", "end", "degree", "continuity")


def _shared(name: str) -> Any:
    """Return a field with the default and metadata that :class:`MinimumDerivative` declares."""
    field = _SHARED[name]
    return dataclasses.field(default=field.default, metadata=field.metadata)


class Minimise(StrEnum):
    """Objective of a :class:`TimeAllocation`."""

    #: J + ρ ΣT, or J alone for a given total time.
    WEIGHTED = "weighted"
    #: Total time alone.
    TIME = "time"


@dataclass(frozen=True, eq=False, repr=False)
class TimeAllocation(Model[Trajectory]):
    """Trajectory through waypoints with free times of the knots.

    Minimise J + ρ ΣT over the durations T_k > 0 and the polynomials. J = ∫ (x^(r))² dt is the
    objective of :class:`~crosstrack.models.MinimumDerivative` at given times. If the total time is
    given, minimise J alone. Corridor and limits are those of that model, which :meth:`at` returns.

    Stretching time by s changes the cost of a motion from rest to rest to ``s^(1-2r) J``. If only
    positions are fixed or bounded and all fixed derivatives are zero, every optimum therefore
    satisfies ``ρ ΣT = (2r - 1) J``, and the optimal total time is proportional to ``ρ^(-1/2r)``
    (Richter, Bry and Roy 2013). For a sum of several orders, ``ρ ΣT = Σ (2j - 1) J_j``. The problem
    is not convex and may have several local optima.

    Parameters
    ----------
    waypoints : ndarray, shape (knots, dimensions)
        Positions at the knots in metres. None leaves a coordinate free.
    time_weight : float
        Cost ρ of a second in square metres per second to the power 2r, at least 0. It must be positive
        without `total_time`.
    total_time : float, optional
        Total time ΣT in seconds, positive. ρ ΣT is then a constant. By default the total time is free.
    order, weights, start, end, derivatives, corridor_lower, corridor_upper, velocity_limit, \
acceleration_limit, jerk_limit, polytope_segments, polytope_normals, polytope_offsets, degree, \
continuity, vehicle, yaw, periodic, gates
        As in :class:`~crosstrack.models.MinimumDerivative`.
    minimise : {"weighted", "time"}
        Objective: J + ρ ΣT (default), or the total time alone, without J. The second one needs a
        vehicle or a limit of velocity, acceleration or jerk, and excludes `time_weight` and `total_time`.
        The minimum is that of paths with one polynomial per segment: one polynomial from rest to rest
        reaches its limits only at instants, and cannot cruise at the largest speed. Free knots (None)
        between the waypoints make the path faster.

    Raises
    ------
    InvalidData
        The data are invalid for that model. ρ = 0 without a total time: J tends to 0 for unbounded
        times. A waypoint repeats the previous one: the optimal duration of its segment is 0.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import TimeAllocation
    >>> model = TimeAllocation(waypoints=[[0, 0], [1, 2], [3, 2]], time_weight=100)
    >>> solution = ct.solve(model)
    >>> solution.termination, solution.plan.durations.round(3).tolist()
    (<Termination.LOCALLY_OPTIMAL: 'locally_optimal'>, [2.602, 2.487])
    """

    waypoints: FloatArray = _shared("waypoints")
    time_weight: float = declared(Real(0.0), default=0.0)
    total_time: float | None = declared(Optional(Real(0.0, strict=True, unit="s")), default=None)
    order: int = _shared("order")
    weights: FloatsOrNone = _shared("weights")
    start: Field[Numbers | None, Floats] = _shared("start")
    end: Field[Numbers | None, Floats] = _shared("end")
    derivatives: FloatsOrNone = _shared("derivatives")
    corridor_lower: FloatsOrNone = _shared("corridor_lower")
    corridor_upper: FloatsOrNone = _shared("corridor_upper")
    velocity_limit: FloatsOrNone = _shared("velocity_limit")
    acceleration_limit: FloatsOrNone = _shared("acceleration_limit")
    jerk_limit: FloatsOrNone = _shared("jerk_limit")
    polytope_segments: Field[Numbers | None, NDArray[np.int64] | None] = _shared(
        "polytope_segments"
    )
    polytope_normals: FloatsOrNone = _shared("polytope_normals")
    polytope_offsets: FloatsOrNone = _shared("polytope_offsets")
    degree: Field[int | None, int] = _shared("degree")
    continuity: Field[int | None, int] = _shared("continuity")
    vehicle: Field[Vehicle | Mapping[str, Any] | None, Vehicle | None] = _shared("vehicle")
    yaw: Field[Numbers | str | None, Floats | float | str | None] = _shared("yaw")
    periodic: bool = _shared("periodic")
    gates: tuple[Gate, ...] = _shared("gates")
    minimise: Minimise = declared(Member(Minimise), default=Minimise.WEIGHTED, added=True)

    kind: ClassVar[str] = "time-allocation"
    formulations: ClassVar[dict[str, Any]] = {
        "times": ".models.minimum_snap.formulations.times:TimesFormulation"
    }
    default_formulation: ClassVar[str] = "times"
    plan_type: ClassVar[type] = Trajectory

    def check(self) -> None:
        """Validate the data at given times and reject problems without optimal times."""
        if len(self.waypoints) < 2:
            raise InvalidData(
                f"waypoints must hold at least 2 knots, got {len(self.waypoints)}",
                field="waypoints",
            )
        for name in _COMPLETED:
            object.__setattr__(self, name, getattr(self.unit, name))
        if self.minimise is Minimise.TIME:
            check_limits(self)
        elif self.time_weight == 0.0 and self.total_time is None:
            raise InvalidData(
                "time_weight must be > 0 unless total_time is given, got 0: the objective would "
                "fall to 0 for times that grow without end",
                field="time_weight",
            )
        check_movement(self)

    # -- at given times --------------------------------------------------------------------------

    def at(self, times: ArrayLike) -> MinimumDerivative:
        """Return the minimum-derivative problem at given times.

        Parameters
        ----------
        times : ndarray, shape (knots,)
            Times of the knots (s), increasing.

        Raises
        ------
        InvalidData
            `times` do not increase, or their number differs from the number of knots.
        """
        fields = {name: getattr(self, name) for name in _SHARED if name not in ("name", "times")}
        return MinimumDerivative(times=cast(Floats, times), name=self.name, **fields)

    @cached_property
    def unit(self) -> MinimumDerivative:
        """Problem with segments of 1 s, for all properties that are independent of the times."""
        return self.at(np.arange(len(self.waypoints), dtype=float))

    @property
    def segments(self) -> int:
        """Number of segments: polynomials per axis, and durations."""
        return len(self.waypoints) - 1

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        return int(self.waypoints.shape[1])

    @property
    def order_weights(self) -> Floats:
        """Weight of each order 1 … r in the objective, shape (order,)."""
        return self.unit.order_weights

    @property
    def conditions(self) -> Floats:
        """Fixed values at the knots, shape (knots, highest fixed + 1, dimensions), else FREE."""
        return self.unit.conditions

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """Corridor boxes and limits that bound at least one component."""
        return self.unit.bounds

    @property
    def halfspaces(self) -> Halfspaces | None:
        """Half-spaces of the polytopes with normals of length 1; None without polytopes."""
        return self.unit.halfspaces

    @property
    def bounded(self) -> bool:
        """Whether the model has a corridor, a polytope or a limit."""
        return self.unit.bounded

    @property
    def preferred_backend(self) -> str:
        """``minco`` for vehicles, gates, laps and the time alone; otherwise empty."""
        return "minco" if self.beyond_times else ""

    @property
    def beyond_times(self) -> str:
        """Features for backend ``minco`` alone, with the alternatives in words; otherwise empty."""
        if self.minimise is Minimise.TIME:
            return "the minimum of the time alone: take backend minco"
        if self.vehicle is None and not self.gates and not self.periodic:
            return ""
        what = "a vehicle, gates or a periodic path"
        if self.total_time is None:
            return f"{what}: take backend minco"
        return (
            f"{what} with total_time = {self.total_time:g} s: give time_weight or minimise='time' instead, "
            "or fixed times in MinimumDerivative"
        )

    @property
    def objective_name(self) -> str:
        """Objective in words, for summaries."""
        if self.minimise is Minimise.TIME:
            return "minimum time"
        return f"{self.time_weight:g} a second" if self.total_time is None else "of a given total"

    @cached_property
    def from_rest_to_rest(self) -> bool:
        """Whether all fixed derivatives are zero, so that slowing a plan down keeps them."""
        fixed = self.conditions[:, 1:]
        return bool(np.all((fixed == 0.0) | ~np.isfinite(fixed)))

    @cached_property
    def scales(self) -> bool:
        """Whether stretching time keeps all constraints, so that ``ρ ΣT = Σ (2j-1) J_j``."""
        timeless = self.vehicle is None and all(b.derivative == 0 for b in self.bounds)
        return self.from_rest_to_rest and timeless

    # -- plans -----------------------------------------------------------------------------------

    def stretch(self, plan: Trajectory) -> float:
        """Return the factor of the durations of `plan` that reduces its peaks to the limits.

        A path that is stretched in time by a factor s has derivatives of order j smaller by s^j.

        Parameters
        ----------
        plan : Trajectory
            Trajectory with the model's segments and dimensions.

        Returns
        -------
        float
            Factor; below 1 if the plan is slower than the limits allow, and 0 without limits.
        """
        factor = 0.0
        for bound in self.bounds:
            if bound.derivative:
                extremes = plan.extremes(bound.derivative)
                peak = np.maximum(np.abs(extremes.least), np.abs(extremes.largest))
                share = float((peak / np.where(bound.upper > 0, bound.upper, np.inf)).max())
                factor = max(factor, share ** (1.0 / bound.derivative))
        return factor

    def objective(self, plan: Trajectory) -> float:
        """Return J + ρ ΣT, or the total time if that is minimised."""
        if self.minimise is Minimise.TIME:
            return plan.duration
        return self.unit.objective(plan) + self.time_weight * plan.duration

    def identity_residual(self, plan: Trajectory) -> float | None:
        """Return the relative residual of ``ρ ΣT = Σ (2j - 1) J_j``, or None if it does not apply.

        The identity holds at every local optimum if stretching time keeps all constraints.
        """
        if not self.scales or self.total_time is not None or self.minimise is Minimise.TIME:
            return None
        total = 0.0
        for order, weight in enumerate(self.order_weights, start=1):
            if weight:
                share = float(plan.integral_of_square(order).sum())
                total += (2 * order - 1) * weight * share
        price = self.time_weight * plan.duration
        return float(abs(price - total) / max(price, total))

    @np.errstate(all="ignore")  # an overflow yields NaN, which is a violation
    def verify(self, plan: Trajectory, *, tolerance: float = TOLERANCE) -> Verification:
        """Evaluate J + ρ ΣT and all constraints of the problem at the plan's own times.

        The path may start at any time, because only durations enter the problem.

        Parameters
        ----------
        plan : Trajectory
            Trajectory with the model's segments and dimensions.
        tolerance : float
            Largest relative violation of a feasible plan.

        Returns
        -------
        Verification
            Objective and checks.

        Raises
        ------
        InvalidData
            `plan` is not a trajectory of the model's shape.
        """
        required("plan", plan, Trajectory)
        if plan.segments != self.segments:
            raise InvalidData(
                f"plan has {plan.segments} segments, the model {self.segments}", field="plan"
            )
        timed = self.at(plan.times).verify(plan, tolerance=tolerance)
        shortest = int(plan.durations.argmin())
        checks = [
            Check(
                "durations > 0", "", max(0.0, -float(plan.durations[shortest])), "s", 0.0,
                f"segment {shortest} ({plan.durations[shortest]:.6g} s)", 0.0,
            )
        ]  # fmt: skip
        if self.total_time is not None:
            checks.append(
                Check.scaled(
                    "total time", "", abs(plan.duration - self.total_time), "s",
                    f"{plan.duration:.9g} s", tolerance, self.total_time, limit=self.total_time,
                )
            )  # fmt: skip
        # The check of the times would compare the plan's times with themselves.
        checks += [check for check in timed.checks if check.name != "times"]
        value, scale = timed.objective, timed.scale
        if self.minimise is Minimise.TIME:
            value, scale = plan.duration, plan.duration
        elif value is not None:
            value += self.time_weight * plan.duration
        return Verification(value, tuple(checks), scale=scale)

    def as_plan(self, value: Any) -> Trajectory:
        """Convert a trajectory, a solution or a SciPy ``PPoly`` to a trajectory."""
        return self.unit.as_plan(value)

    def times(self, durations: ArrayLike) -> Floats:
        """Return the times of the knots for given durations, starting at 0 s, shape (knots,)."""
        ends = np.cumsum(np.asarray(durations, float))
        return frozen(np.concatenate([[0.0], ends]))

    def describe(self) -> str:
        """Return a one-line summary: objective, segments, dimensions and bounds."""
        more = [b.name for b in self.bounds] + (["polytopes"] if self.halfspaces else [])
        what = self.objective_name
        more += [] if self.vehicle is None else [self.vehicle.kind]
        more += [f"{len(self.gates)} gates"] if self.gates else []
        size = f"{self.segments} segments in {self.dimensions}-D"
        return ", ".join([f"times, {what}, of minimum {derivative_name(self.order)}", size, *more])
