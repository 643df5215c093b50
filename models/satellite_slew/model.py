"""The rapid slew of a satellite with control moment gyros.

Source: "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, declared, frozen, show
from ..model import Model
from ..optimal_control.plan import ControlPlan
from ..verification import TOLERANCE, Verification
from .gyros import momentum_direction, singularity_measure
from .quaternions import axis_and_angle, conjugate, product, rotation_about, rotation_matrix

if TYPE_CHECKING:
    from ..optimal_control.model import OptimalControlProblem

__all__ = ["SatelliteSlew"]

Floats = NDArray[np.float64]

#: Names that :meth:`SatelliteSlew.about` knows.
AXES = {"roll": (1.0, 0.0, 0.0), "pitch": (0.0, 1.0, 0.0), "yaw": (0.0, 0.0, 1.0)}

#: How far a quaternion's length may be off 1 on the way in; it is made 1.
LENGTH = 1e-6
#: Largest mismatch of momenta that rounded gimbal angles explain, in units of one wheel's.
MOMENTUM = 1e-8


class _Inertia(Array):
    """A symmetric matrix, or its diagonal alone."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        given = self._numbers(name, value)
        if given.shape not in ((3,), (3, 3)):
            raise InvalidData(
                f"{name} must be a symmetric matrix of shape (3, 3) or its diagonal, shape (3,), "
                f"got shape {given.shape}",
                field=name,
            )
        return super().coerce(name, np.diag(given) if given.ndim == 1 else given, sizes)


class _PerGyro(Array):
    """Four numbers, or one for all."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        given = self._numbers(name, value)
        return super().coerce(
            name, np.broadcast_to(given, (4,)) if given.ndim == 0 else given, sizes
        )


class _Attitude(Array):
    """A unit quaternion, scalar first; a length that rounding explains is made 1."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        q = super().coerce(name, value, sizes)
        length = float(np.linalg.norm(q))
        if abs(length - 1.0) > LENGTH:
            raise InvalidData(
                f"{name} must be a unit quaternion, scalar first, got {show(q.tolist())} of length "
                f"{length:.9g}",
                field=name,
            )
        # Left alone where it is 1 but for rounding, lest reading what was written change a digit.
        return q if abs(length - 1.0) <= 1e-15 else frozen(q / length)


def _matrix(rows: Any, **options: Any) -> Any:
    return declared(_Inertia((3, 3)), default=rows, **options)


@dataclass(frozen=True, eq=False, repr=False)
class SatelliteSlew(Model[ControlPlan]):
    r"""Turn a satellite from rest to rest as fast as its gyros allow, and never let them get singular.

    The state is x = [q0, q1, q2, q3, wx, wy, wz, δ1, …, δ4]: the attitude q, a unit quaternion from
    body to inertial axes; the body rates w; the gimbal angles δ of four control moment gyros in a
    pyramid. The control is u = δ̇. With the gyros' momentum h = h0 A_s(δ)·1 (see
    :mod:`crosstrack.models.satellite_slew.gyros`) and A_t = ∂(A_s·1)/∂δ,

    - T_c = -h0 A_t δ̇ (eq. 9);
    - I ẇ = T_c - w×(I w + h), q̇0 = -½ w·q, q̇ = -½ w×q + ½ q0 w (eq. 10).

    Minimise J = ∫ (1 + uᵀ R u) dt subject to \|w_i\| ≤ w_max, \|δ̇_i\| ≤ δ̇_max, \|T_c,i\| ≤
    T_max and det(A_t A_tᵀ) ≥ a limit at every instant, the final time free.

    Without outer torque R(q)(I w + h), the momentum in inertial axes, is constant. So the rates
    are a function of attitude and gimbal angles, and with the length of q four of the eleven
    conditions at the end follow from the other seven; :meth:`lower` imposes those seven (three of
    q, four of δ), and :meth:`verify` checks all eleven. The short way round is taken.

    Parameters
    ----------
    inertia : ndarray, shape (3, 3)
        I, kg m², in body axes; a vector of three is the diagonal.
    pyramid_angle : float
        β, the skew angle of the pyramid, degrees.
    momentum : float
        h0, the momentum of one wheel, N m s.
    rate_weight : ndarray, shape (4,)
        R, the diagonal of the weight of gimbal rates, s²; one number counts for all.
    rate_limit : float
        Of each body rate, rad/s.
    gimbal_rate_limit : float
        Of each gimbal rate, rad/s.
    torque_limit : float
        Of each component of the control torque, N m.
    singularity_limit : float
        The least det(A_t A_tᵀ) allowed.
    initial_attitude, final_attitude : ndarray, shape (4,)
        Unit quaternions, scalar first, from body to inertial axes.
    initial_gimbals : ndarray, shape (4,)
        Gimbal angles at the begin, rad.
    final_gimbals : ndarray, shape (4,), optional
        Gimbal angles at the end, rad; None leaves them free.
    time_range : ndarray, shape (2,)
        The least and the largest final time, s.
    margin : float
        Share of the actuators' limits, of torque and of gimbal rate, that is held in reserve for
        the controller that tracks the plan; at least 0, less than 1.

    Raises
    ------
    InvalidData
        An inertia that no body has; quaternions whose length is not 1; gimbals that are singular at
        an end; final gimbals with which the satellite could not be at rest.

    Notes
    -----
    The paper prints neither h0 nor R; its figures come out with h0 = 17.53 N m s and R = 0.1 s²,
    which are the defaults. Misprints: the vector part of the final quaternion, sin 22.5° = 0.38268
    (0.3824); the sign of the defects of the transcription (eq. 14-21); the sign in q_e0 = q0 q_d0 +
    q·q_d (eq. 25).

    Examples
    --------
    >>> from crosstrack.models import SatelliteSlew
    >>> model = SatelliteSlew.about("roll", 45.0, margin=0.1)
    >>> model.final_attitude.round(5).tolist()
    [0.92388, 0.38268, 0.0, 0.0]
    >>> print(model.describe())
    45° about (1, 0, 0), 4 gyros of 17.53 N m s, margin 10 %
    """

    inertia: Floats = _matrix((228.0, 188.0, 176.0))
    pyramid_angle: float = declared(Real(0.0, 90.0, strict=True, unit="degrees"), default=54.73)
    momentum: float = declared(Real(0.0, strict=True, unit="N m s"), default=17.53)
    rate_weight: Floats = declared(_PerGyro((4,), lower=0.0), default=0.1)
    rate_limit: float = declared(Real(0.0, strict=True, unit="rad/s"), default=0.125)
    gimbal_rate_limit: float = declared(Real(0.0, strict=True, unit="rad/s"), default=1.0)
    torque_limit: float = declared(Real(0.0, strict=True, unit="N m"), default=25.0)
    singularity_limit: float = declared(Real(0.0), default=0.2)
    initial_attitude: Floats = declared(_Attitude((4,)), default=(1.0, 0.0, 0.0, 0.0))
    final_attitude: Floats = declared(
        _Attitude((4,)), default=(float(np.cos(np.pi / 8)), float(np.sin(np.pi / 8)), 0.0, 0.0)
    )
    initial_gimbals: Floats = declared(Array((4,)), default=(0.0, 0.0, 0.0, 0.0))
    final_gimbals: Floats | None = declared(Optional(Array((4,))), default=(0.0, 0.0, 0.0, 0.0))
    time_range: Floats = declared(Array((2,), lower=0.0), default=(1.0, 60.0))
    margin: float = declared(Real(0.0), default=0.0)

    kind: ClassVar[str] = "satellite-slew"
    objective_unit: ClassVar[str] = "s"

    @classmethod
    def about(cls, axis: ArrayLike | str, angle: float, **fields: Any) -> Self:
        """Return the slew by `angle` about `axis` from where the satellite is.

        Parameters
        ----------
        axis : array_like, shape (3,), or {"roll", "pitch", "yaw"}
            In body axes, of any length but 0.
        angle : float
            Degrees. Beyond 180° it is the shorter way round, the other way.
        **fields
            The other fields.
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
        begin = _Attitude((4,)).coerce("initial_attitude", start, {})
        return cls(final_attitude=product(begin, turn), **fields)

    # -- the data --------------------------------------------------------------------------------

    def check(self) -> None:
        """Refuse what no satellite is, and ends at which it cannot rest."""
        self._check_inertia()
        if not self.margin < 1.0:
            raise InvalidData(f"margin must be < 1, got {self.margin:g}", field="margin")
        low, high = self.time_range
        if not (high > 0.0 and low <= high):
            raise InvalidData(
                f"time_range must be (least, largest) final time, the largest > 0, got "
                f"({low:g}, {high:g})",
                field="time_range",
            )
        for name in ("initial_gimbals", "final_gimbals"):
            gimbals = getattr(self, name)
            if gimbals is None:
                continue
            measure = float(singularity_measure(gimbals, self.beta))
            if measure < self.singularity_limit:
                raise InvalidData(
                    f"{name} must have det(A_t A_t') >= {self.singularity_limit:g}, got {measure:.6g}",
                    field=name,
                )
        if self.final_gimbals is not None:
            there = momentum_direction(self.final_gimbals, self.beta)
            apart = float(np.abs(there - self.final_momentum / self.momentum).max())
            if apart > MOMENTUM:
                needed = ", ".join(f"{x:.6g}" for x in self.final_momentum)
                have = ", ".join(f"{x:.6g}" for x in self.momentum * there)
                raise InvalidData(
                    "final_gimbals must hold the momentum that the gyros have at the begin, seen in "
                    f"the final body axes: h = ({needed}) N m s, got ({have}); with these the "
                    "satellite would not be at rest",
                    field="final_gimbals",
                )

    def _check_inertia(self) -> None:
        matrix = self.inertia
        if np.abs(matrix - matrix.T).max() > 1e-12 * np.abs(matrix).max():
            raise InvalidData(
                f"inertia must be symmetric, got {show(matrix.tolist())}", field="inertia"
            )
        moments = np.linalg.eigvalsh(matrix)
        shown = ", ".join(f"{x:.6g}" for x in moments)
        if not moments[0] > 0.0:
            raise InvalidData(
                f"inertia must be positive definite, got principal moments {shown} kg m²",
                field="inertia",
            )
        if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-12):
            raise InvalidData(
                "inertia: no principal moment of a body exceeds the sum of the other two, got "
                f"{shown} kg m²",
                field="inertia",
            )

    @property
    def beta(self) -> float:
        """The skew angle of the pyramid in rad."""
        return float(np.deg2rad(self.pyramid_angle))

    @property
    def planned_torque(self) -> float:
        """The limit of torque that a plan must keep, the margin taken off, N m."""
        return self.torque_limit * (1.0 - self.margin)

    @property
    def planned_gimbal_rate(self) -> float:
        """The limit of gimbal rates that a plan must keep, the margin taken off, rad/s."""
        return self.gimbal_rate_limit * (1.0 - self.margin)

    @cached_property
    def target(self) -> Floats:
        """The final attitude with the sign that is nearer to the initial one, shape (4,)."""
        q = self.final_attitude
        return frozen(-q if q @ self.initial_attitude < 0.0 else q.copy())

    @cached_property
    def turn(self) -> tuple[Floats, float]:
        """Axis, shape (3,), and angle (rad) of the rotation from the initial to the final attitude."""
        return axis_and_angle(product(conjugate(self.initial_attitude), self.final_attitude))

    @cached_property
    def total_momentum(self) -> Floats:
        """The momentum of satellite and gyros in inertial axes, N m s, shape (3,): constant."""
        held = self.momentum * momentum_direction(self.initial_gimbals, self.beta)
        return frozen(rotation_matrix(self.initial_attitude) @ held)

    @cached_property
    def final_momentum(self) -> Floats:
        """What the gyros must hold at the end for the satellite to rest, body axes, N m s, (3,)."""
        return frozen(rotation_matrix(self.final_attitude).T @ self.total_momentum)

    # -- the model -------------------------------------------------------------------------------

    def lower(self) -> OptimalControlProblem | None:
        """Return the slew as an optimal control problem; None where CasADi is not installed."""
        if importlib.util.find_spec("casadi") is None:
            return None
        return self._problem

    @cached_property
    def _problem(self) -> OptimalControlProblem:
        from .lowered import slew_problem

        return slew_problem(self)

    def verify(self, plan: ControlPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return J by quadrature and every condition, the motion integrated anew.

        The gimbal rates are integrated by DOP853 from the plan's first state, in NumPy and apart
        from the CasADi expressions that solvers see, and the result is held against the plan's
        states; limits are measured on a dense grid between the nodes.
        """
        from .checks import verify_slew

        return verify_slew(self, plan, tolerance)

    def plan_to_data(self, plan: ControlPlan) -> Any:
        """Return ``{"phases": […], "parameters": {…}}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> ControlPlan:
        """Return the plan in `data`."""
        return ControlPlan.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""
        axis, angle = self.turn
        around = ", ".join(f"{x:.3g}" for x in axis)
        reserve = f", margin {100 * self.margin:g} %" if self.margin else ""
        return f"{np.rad2deg(angle):.6g}° about ({around}), 4 gyros of {self.momentum:g} N m s{reserve}"
