"""Polynomial trajectories through waypoints that minimise a derivative: snap, jerk, any order.

Source: sections 3.2.2 and 3.2.4 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced
for Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021. Lineage:
Mellinger and Kumar 2011; Richter, Bry and Roy 2013; MINCO (Wang, Zhou, Xu, Gao) 2022.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import frozen
from ..inputs import Field, FloatArray, FloatsOrNone, Numbers
from ..verification import TOLERANCE, Verification
from .bounds import PathData, derivative_name
from .checks import check_conditions, verify_trajectory
from .gate_checks import check_gate_data
from .gates import Gate
from .trajectory import Trajectory, increasing
from .vehicle_checks import check_vehicle
from .vehicles import Vehicle
from .yaw import yaw_waypoints

__all__ = ["MinimumDerivative", "MinimumSnap"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


#: Samples per segment when two paths are compared.
SAMPLES = 32


class MinimumDerivative(PathData):
    """Piecewise polynomial through waypoints that minimises ∫ (x^(r))² dt.

    Each axis has one polynomial per segment. Positions are fixed at the waypoints (eq. 24) and
    derivatives at the two ends (eq. 23); derivatives at other knots may be fixed too. Neighbouring
    segments agree in position and in the derivatives up to `continuity` (eq. 25). Corridor and
    limits hold at every instant, not only at samples. A limit bounds each component, not the norm.

    Parameters
    ----------
    waypoints : ndarray, shape (knots, dimensions)
        Positions at the knots in metres. None (or :data:`FREE`) leaves a coordinate free.
    times : ndarray, shape (knots,)
        Times of the knots in seconds, increasing.
    order : int
        Order r of the minimised derivative: 4 snap (default), 3 jerk, 2 acceleration.
    weights : ndarray, shape (order,), optional
        Non-negative weights of the orders 1 … r in the objective. The last must be positive. By
        default, only order r has a weight.
    start, end : ndarray, shape (k, dimensions), optional
        Velocity, acceleration, … at the first and at the last knot. Entries that are None and
        orders above k are free. By default at rest: the orders 1 … r-1 are zero.
    derivatives : ndarray, shape (knots, k, dimensions), optional
        Velocity, acceleration, … at every knot, in addition to `start` and `end`. None is free.
    corridor_lower, corridor_upper : float or ndarray, shape (segments, dimensions), optional
        Box of each segment in metres, broadcast from one number, one entry per axis or a column with one
        entry per segment.
    velocity_limit, acceleration_limit, jerk_limit : float or ndarray, optional
        Largest absolute value of each component, in metres per second, metres per second squared
        and metres per second cubed, broadcast in the same way.
    polytope_segments : ndarray of int, shape (halfspaces,), optional
        Segment of each half-space ``normal @ x <= offset``, which contains the positions of that
        segment. The three polytope fields go together.
    polytope_normals : ndarray, shape (halfspaces, dimensions), optional
        Normals of the half-spaces, of any positive length.
    polytope_offsets : ndarray, shape (halfspaces,), optional
        Right-hand sides of the half-spaces.
    degree : int, optional
        Degree of the polynomials, at least 2r-1 (default). Without corridor and limits, the optimum
        has degree 2r-1.
    continuity : int, optional
        Highest order of a continuous derivative, by default r-1. The paper uses 2 and minimises
        snap: the jerk of its optimum jumps, so it is not the minimum-snap spline.
    vehicle : PointMass, Quadrotor or DifferentialDrive, optional
        Vehicle whose limits hold at every instant, or its JSON data.
    yaw : "tangent", float or ndarray, shape (knots,), optional
        Yaw of the vehicle in radians: along the path, constant, or through an angle per knot (None is
        free) by the shortest turns, with the least angular acceleration. Plans carry it as ``plan.yaw``.
    periodic : bool
        Whether the path is a lap: the ends agree in position and in the derivatives up to the fourth or
        2r-2, whichever is lower (up to 2r-2 by optimality if only waypoints are fixed). `start` and `end`
        are then free by default.
    gates : sequence of Gate
        Discs, balls or polygons that contain the positions of knots, whose waypoints are free.

    Notes
    -----
    The model fills in the defaults that depend on the order (`start`, `end`, `degree`,
    `continuity`), so that a default and the same explicit value give equal models.
    ``dataclasses.replace(model, order=…)`` therefore keeps these values. Pass those that change
    with the order.

    Raises
    ------
    InvalidData
        Times do not increase, shapes differ, fixed values are outside the corridor or the limits,
        or conditions contradict each other. The message names field, index and value.
    """

    kind: ClassVar[str] = "minimum-derivative"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.minimum_snap.formulations.paper:PaperFormulation",
        "monomial": ".models.minimum_snap.formulations.bases:MonomialFormulation",
        "hermite": ".models.minimum_snap.formulations.hermite:HermiteFormulation",
        "legendre": ".models.minimum_snap.formulations.bases:LegendreFormulation",
        "cones": ".models.minimum_snap.formulations.vehicles:VehicleFormulation",
    }
    default_formulation: ClassVar[str] = "legendre"
    certified_distance: ClassVar[float] = 1e-6

    # -- checks ----------------------------------------------------------------------------------

    def check(self) -> None:
        """Fill in the defaults that depend on the order and validate constraints between fields."""
        if self.waypoints.shape[1] == 0:
            raise InvalidData("waypoints must have at least 1 dimension, got 0", field="waypoints")
        increasing("times", self.times)
        # Defaults are resolved here, so that a default and the same explicit value compare equal.
        rest = np.zeros((0 if self.periodic else self.order - 1, self.dimensions))
        for name in ("start", "end"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, frozen(rest))
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
        check_gate_data(self)
        check_conditions(self)
        check_vehicle(self)

    @property
    def preferred_formulation(self) -> str:
        """``cones`` for a vehicle or gates, ``hermite`` if the free derivatives determine the path, else ``legendre``."""
        if self.vehicle is not None or self.gates:
            return "cones"
        free = self.continuity < self.order and not self.fixes_order
        return "hermite" if free else self.default_formulation

    @property
    def certifier(self) -> str:
        """``banded`` without corridor and limits, else ``interior-point``; empty for laps, vehicles, gates."""
        if self.vehicle is not None or self.periodic or self.gates:
            return ""
        return "interior-point" if self.bounded else "banded"

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # an overflow yields NaN, which is a violation
    def verify(self, plan: Trajectory, *, tolerance: float = TOLERANCE) -> Verification:
        """Evaluate the objective by quadrature and all conditions at and between the knots.

        Corridor and limits are evaluated at the exact extremes of the path: the ends of the segments
        and the roots of the next derivative.

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
        return verify_trajectory(self, plan, tolerance)

    def with_yaw(self, plan: Trajectory) -> Trajectory:
        """Return `plan` with the yaw that minimises ∫ ψ̈² dt through the given angles, if the model gives any.

        Its rate is continuous; it is 0 at both ends, or equal there for a lap.
        """
        if self.yaw is None or isinstance(self.yaw, str):
            return plan
        angles = yaw_waypoints(self.yaw, self.times.size, self.periodic)
        # Full turns per lap: a constant rate costs nothing.
        turn = angles[-1] - angles[0] if self.periodic else 0.0
        ramp = turn * (self.times - self.times[0]) / self.durations.sum()
        points = np.where(np.isfinite(angles), angles - ramp, np.inf)
        if self.periodic:
            points[-1] = points[0]
        axis = MinimumDerivative(points[:, None], self.times, order=2, periodic=self.periodic)
        coefficients = axis.formulate("hermite").unbounded_optimum().coefficients.copy()
        coefficients[:, :2, 0] += np.stack([ramp[:-1], np.diff(ramp)], axis=1)
        return replace(plan, yaw=Trajectory(self.times, coefficients))

    def distance(self, plan: Trajectory, other: Trajectory) -> float:
        """Return the largest difference of two paths at equal times, relative to the widest extent."""
        shares = np.arange(SAMPLES) / SAMPLES
        times = self.times[:-1, None] + shares * np.diff(self.times)[:, None]
        apart = np.abs(plan(times.ravel()) - other(times.ravel())).max()
        return float(apart / self.position_scale.max())

    def as_plan(self, value: Any) -> Trajectory:
        """Convert a trajectory, a solution or a SciPy ``PPoly`` to a trajectory."""
        plan = getattr(value, "plan", value)
        if hasattr(plan, "c") and hasattr(plan, "x"):
            plan = Trajectory.from_ppoly(plan)
        return super().as_plan(value if plan is None else plan)

    def describe(self) -> str:
        """Return a one-line summary: derivative, segments, dimensions and bounds."""
        what = derivative_name(self.order)
        more = [b.name for b in self.bounds] + (["polytopes"] if self.halfspaces else [])
        more += [] if self.vehicle is None else [self.vehicle.kind]
        more += ["a lap"] if self.periodic else []
        more += [f"{len(self.gates)} gates"] if self.gates else []
        return (
            f"minimum {what}, {self.segments} segments in {self.dimensions}-D"
            + (", " if more else "")
            + ", ".join(more)
        )


@dataclass(frozen=True, eq=False, repr=False)
class MinimumSnap(MinimumDerivative):
    """Minimum-snap trajectory through waypoints: :class:`MinimumDerivative` with r = 4.

    ``MinimumSnap(waypoints, times)`` starts and ends at rest: velocity, acceleration and jerk are
    zero at both ends.

    Parameters
    ----------
    waypoints : ndarray, shape (knots, dimensions)
        Positions at the knots in metres. None (or :data:`FREE`) leaves a coordinate free.
    times : ndarray, shape (knots,)
        Times of the knots in seconds, increasing.
    start, end, derivatives, corridor_lower, corridor_upper, velocity_limit, acceleration_limit, \
jerk_limit, polytope_segments, polytope_normals, polytope_offsets, degree, continuity, vehicle, yaw, \
periodic, gates
        As in :class:`MinimumDerivative`.

    Raises
    ------
    InvalidData
        As in :class:`MinimumDerivative`.

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

    if TYPE_CHECKING:  # mypy gives inherited fields of a frozen class the type of the argument
        waypoints: FloatArray = PathData.waypoints
        times: FloatArray = PathData.times
        start: Field[Numbers | None, Floats] = PathData.start
        end: Field[Numbers | None, Floats] = PathData.end
        derivatives: FloatsOrNone = PathData.derivatives
        corridor_lower: FloatsOrNone = PathData.corridor_lower
        corridor_upper: FloatsOrNone = PathData.corridor_upper
        velocity_limit: FloatsOrNone = PathData.velocity_limit
        acceleration_limit: FloatsOrNone = PathData.acceleration_limit
        jerk_limit: FloatsOrNone = PathData.jerk_limit
        polytope_normals: FloatsOrNone = PathData.polytope_normals
        polytope_offsets: FloatsOrNone = PathData.polytope_offsets
        polytope_segments: Field[Numbers | None, Ints | None] = PathData.polytope_segments
        degree: Field[int | None, int] = PathData.degree
        continuity: Field[int | None, int] = PathData.continuity
        vehicle: Field[Vehicle | Mapping[str, Any] | None, Vehicle | None] = PathData.vehicle
        yaw: Field[Numbers | str | None, Floats | float | str | None] = PathData.yaw
        gates: tuple[Gate, ...] = PathData.gates

    kind: ClassVar[str] = "minimum-snap"
    objective_unit: ClassVar[str] = "m²/s⁷"
