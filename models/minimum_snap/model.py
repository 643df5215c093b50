"""Polynomial trajectories through waypoints that minimise a derivative: snap, jerk, any order.

Source: sections 3.2.2 and 3.2.4 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced
for Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021. Lineage:
Mellinger and Kumar 2011; Richter, Bry and Roy 2013; MINCO (Wang, Zhou, Xu, Gao) 2022.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import frozen
from ..verification import TOLERANCE, Verification
from .bounds import PathData, derivative_name
from .checks import check_conditions, verify_trajectory
from .trajectory import Trajectory, increasing

__all__ = ["MinimumDerivative", "MinimumSnap"]

Floats = NDArray[np.float64]


#: Samples per segment at which two paths are compared.
SAMPLES = 32


@dataclass(frozen=True, eq=False, repr=False)
class MinimumDerivative(PathData):
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

    kind: ClassVar[str] = "minimum-derivative"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.minimum_snap.formulations.paper:PaperFormulation",
        "monomial": ".models.minimum_snap.formulations.bases:MonomialFormulation",
        "hermite": ".models.minimum_snap.formulations.hermite:HermiteFormulation",
        "legendre": ".models.minimum_snap.formulations.bases:LegendreFormulation",
    }
    default_formulation: ClassVar[str] = "legendre"
    certified_distance: ClassVar[float] = 1e-6

    # -- checks ----------------------------------------------------------------------------------

    def check(self) -> None:
        """Fill in the defaults that depend on the order, and refuse what contradicts itself."""
        if self.waypoints.shape[1] == 0:
            raise InvalidData("waypoints must have at least 1 dimension, got 0", field="waypoints")
        increasing("times", self.times)
        # Resolved here, so that a default and the same value written out are one content.
        rest = np.zeros((self.order - 1, self.dimensions))
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
        check_conditions(self)

    @property
    def preferred_formulation(self) -> str:
        """The program of the free derivatives where they say everything, else the Legendre basis."""
        free = self.continuity < self.order and not (
            self.highest_fixed >= self.order and np.isfinite(self.conditions[:, self.order :]).any()
        )
        return "hermite" if free else self.default_formulation

    @property
    def certifier(self) -> str:
        """``banded`` without corridor and limits, else ``interior-point``."""
        return "interior-point" if self.bounded else "banded"

    # -- plans -----------------------------------------------------------------------------------

    @np.errstate(all="ignore")  # what overflows is no number, and so is violated
    def verify(self, plan: Trajectory, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective by quadrature, and every condition at the knots and in between.

        Corridor and limits are measured at their exact extremes: the ends, and the roots of the
        next derivative.
        """
        return verify_trajectory(self, plan, tolerance)

    def distance(self, plan: Trajectory, other: Trajectory) -> float:
        """Return the largest distance between two paths at the same time, in the model's widest extent."""
        shares = np.arange(SAMPLES) / SAMPLES
        times = self.times[:-1, None] + shares * np.diff(self.times)[:, None]
        apart = np.abs(plan(times.ravel()) - other(times.ravel())).max()
        return float(apart / self.position_scale.max())

    def plan_to_data(self, plan: Trajectory) -> Any:
        """Return ``{"times": […], "coefficients": [[[…]]]}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> Trajectory:
        """Return the trajectory in `data`."""
        return Trajectory.from_data(data)

    def as_plan(self, value: Any) -> Trajectory:
        """Return the trajectory that `value` means; a SciPy ``PPoly`` is one."""
        plan = getattr(value, "plan", value)
        if hasattr(plan, "c") and hasattr(plan, "x"):
            plan = Trajectory.from_ppoly(plan)
        return super().as_plan(value if plan is None else plan)

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
