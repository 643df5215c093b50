"""Rapid slew of a satellite with control moment gyros.

Source: "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InvalidData
from ..fields import Array, Real
from ..optimal_control.model import OptimalControlProblem, cached_verification
from ..optimal_control.plan import ControlPlan
from ..verification import TOLERANCE, Verification
from .checks import verify_slew
from .data import Attitude, SlewData
from .lowered import reduced_problem, slew_problem
from .quaternions import product, rotation_about

__all__ = ["SatelliteSlew"]

#: Named axes of :meth:`SatelliteSlew.about`.
AXES = {"roll": (1.0, 0.0, 0.0), "pitch": (0.0, 1.0, 0.0), "yaw": (0.0, 0.0, 1.0)}


class SatelliteSlew(SlewData):
    r"""Fastest slew of a satellite by control moment gyros without singularities.

    The state is x = [q0, q1, q2, q3, wx, wy, wz, δ1, …, δn]: the attitude q, a unit quaternion from
    body to inertial axes; the body rates w; the gimbal angles δ of n control moment gyros, by default
    four in a pyramid. The control is u = δ̇. With the gyros' momentum h = h0 A_s(δ)·1 (see
    :mod:`crosstrack.models.satellite_slew.gyros`) and A_t = ∂(A_s·1)/∂δ,

    - T_c = -h0 A_t δ̇ (eq. 9);
    - I ẇ = T_c - w×(I w + h) (eq. 3);
    - q̇0 = -½ w·q, q̇ = -½ w×q + ½ q0 w (eq. 10).

    Minimise J = ∫ (1 + uᵀ R u) dt (eq. 22) subject to \|w\| ≤ w_max, \|δ̇_i\| ≤ δ̇_max, \|T_c\| ≤
    T_max and det(A_t A_tᵀ) ≥ a limit at every instant (eq. 23), the final time free.

    Without outer torque R(q)(I w + h), the momentum in inertial axes, is constant. The rates are
    therefore a function of attitude and gimbal angles, which the default formulation, ``reduced``,
    uses. With the length of q, four of the 7 + n conditions at the end follow from the others.
    :meth:`lower` imposes three of q and those of δ, and :meth:`verify` checks all. The shorter rotation
    is used.

    Parameters
    ----------
    gimbal_axes : ndarray, shape (n, 3), optional
        Unit vectors of the gimbals' axes in body axes, for 3 to 8 gyros; see
        :func:`~crosstrack.models.satellite_slew.gyros.pyramid_axes`. By default the pyramid of four with
        `pyramid_angle`.
    wheel_axes : ndarray, shape (n, 3), optional
        Unit vectors of the wheels' momenta at the gimbal angle 0, perpendicular to `gimbal_axes`. By
        default z × gimbal axis, normalised, as in the pyramid; x for a gimbal axis along z.
    inertia : ndarray, shape (3, 3)
        Moments of inertia I in kilogram square metres, in body axes; a vector of three is the diagonal.
    pyramid_angle : float
        Skew angle β of the pyramid of four in degrees; unused with `gimbal_axes`.
    momentum : float
        Momentum h0 of one wheel in newton metre seconds.
    rate_weight : ndarray, shape (n,)
        Diagonal of the weight R of gimbal rates in square seconds; one number applies to all.
    rate_limit : float
        Limit of the body rates in radians per second (`vector_limits`).
    gimbal_rate_limit : float
        Limit of each gimbal rate in radians per second.
    torque_limit : float
        Limit of the control torque in newton metres (`vector_limits`).
    singularity_limit : float
        Smallest allowed det(A_t A_tᵀ).
    initial_attitude, final_attitude : ndarray, shape (4,)
        Unit quaternions, scalar first, from body to inertial axes.
    initial_gimbals : ndarray, shape (n,)
        Gimbal angles at the start in radians; one number applies to all.
    final_gimbals : ndarray, shape (n,), optional
        Gimbal angles at the end in radians; None for free angles. With a `final_rate` the gimbals must
        store its momentum, so None is usual.
    time_range : ndarray, shape (2,)
        Smallest and largest final time in seconds.
    margin : float
        Share of the limits of torque and gimbal rate that is reserved for the controller that
        tracks the plan, in 0 <= margin < 1.
    vector_limits : {"components", "norm"}
        Whether `rate_limit` and `torque_limit` bound each component (default) or the Euclidean
        norm, ``VectorLimits``.
    initial_rate, final_rate : ndarray, shape (3,), optional
        Body rates at the start and at the end in radians per second, for example of a moving target; by
        default at rest.

    Raises
    ------
    InvalidData
        The inertia is not that of a body, a quaternion or an axis has another length than 1, the gimbals
        are singular at an end, or the satellite cannot have the final rate with the final gimbals.

    Notes
    -----
    The paper prints neither h0 nor R. Its final time, 7.836 s, results from R = 0.1 s² with h0 =
    22.36 N m s if the limits bound norms (``satellite-slew/paper``), and with h0 = 17.47 N m s if
    they bound components. The default, h0 = 17.53 N m s with components, gives 7.826 s.

    Examples
    --------
    >>> from crosstrack.models import SatelliteSlew
    >>> model = SatelliteSlew.about("roll", 45.0, margin=0.1)
    >>> model.final_attitude.round(5).tolist()
    [0.92388, 0.38268, 0.0, 0.0]
    >>> print(model.describe())
    45° about (1, 0, 0), 4 gyros of 17.53 N m s, margin 10 %
    """

    kind: ClassVar[str] = "satellite-slew"
    formulations: ClassVar[dict[str, Any]] = {
        "reduced": ".models.satellite_slew.reduced:Reduced",
    }
    default_formulation: ClassVar[str] = "reduced"
    objective_unit: ClassVar[str] = "s"
    plan_type: ClassVar[type] = ControlPlan

    @classmethod
    def about(cls, axis: ArrayLike | str, angle: float, **fields: Any) -> Self:
        """Return the slew by `angle` about `axis` from the initial attitude.

        Parameters
        ----------
        axis : array_like, shape (3,), or {"roll", "pitch", "yaw"}
            Axis in body axes, of any length but 0.
        angle : float
            Angle in degrees. Beyond 180° the slew takes the shorter rotation in the other direction.
        **fields
            Other fields of the model.

        Returns
        -------
        SatelliteSlew
            The slew.

        Raises
        ------
        InvalidData
            The axis is unknown or zero, or a field is invalid.
        """
        if isinstance(axis, str):
            if axis not in AXES:
                raise InvalidData(
                    f"axis must be one of {', '.join(AXES)} or three numbers, got {axis!r}",
                    field="axis",
                )
            axis = AXES[axis]
        direction = Array((3,)).coerce("axis", axis, {})
        if not direction.any():
            raise InvalidData("axis must not be zero", field="axis")
        if "final_attitude" in fields:
            raise InvalidData(
                "final_attitude follows from axis and angle: leave it out", field="final_attitude"
            )
        turn = rotation_about(direction, np.deg2rad(Real().coerce("angle", angle, {})))
        start = fields.get("initial_attitude", (1.0, 0.0, 0.0, 0.0))
        begin = Attitude((4,)).coerce("initial_attitude", start, {})
        return cls(final_attitude=product(begin, turn), **fields)

    # -- the model -------------------------------------------------------------------------------

    def lower(self) -> OptimalControlProblem:
        """Return the slew as an optimal control problem."""
        return self._problem

    @cached_property
    def reduced(self) -> OptimalControlProblem:
        """The slew with attitude and gimbal angles as the only states, for the formulation ``reduced``."""
        return reduced_problem(self, self.name)

    @cached_property
    def _problem(self) -> OptimalControlProblem:
        return slew_problem(self, self.name)

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def verify(self, plan: ControlPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return J by quadrature and every condition, with the motion re-integrated.

        DOP853 integrates the gimbal rates from the plan's initial state in NumPy, independently of the
        CasADi expressions for solvers. The result is compared with the plan's states. Limits are
        evaluated on a dense grid between the nodes. The last results are cached for equal tolerance and plan.
        """
        return cached_verification(
            self, tolerance, plan, lambda: verify_slew(self, plan, tolerance)
        )

    def describe(self) -> str:
        """Return the size in a few words."""
        axis, angle = self.turn
        around = ", ".join(f"{x:.3g}" for x in axis)
        reserve = f", margin {100 * self.margin:g} %" if self.margin else ""
        ends = ", moving ends" if self.begin_rate.any() or self.end_rate.any() else ""
        gyros = f"{self.gyro_count} gyros of {self.momentum:g} N m s"
        return f"{np.rad2deg(angle):.6g}° about ({around}), {gyros}{ends}{reserve}"
