"""Data of a slew: the satellite, its gyros, two attitudes and the limits."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, declared, frozen, show
from ..inputs import Field, FloatArray, FloatsOrNone
from ..model import Model
from ..optimal_control.plan import ControlPlan
from ..records import Member
from .gyros import (
    FEWEST,
    MOST,
    Gyros,
    gyro_coefficients,
    momentum_capacity,
    momentum_direction,
    singularity_measure,
)
from .quaternions import axis_and_angle, conjugate, product, rotation_matrix

__all__ = ["Attitude", "Inertia", "SlewData", "VectorLimits", "check_inertia"]

Floats = NDArray[np.float64]

#: Largest difference of a quaternion's length from 1 that is accepted and normalised.
LENGTH = 1e-6
#: Largest mismatch of momenta that is attributed to rounded gimbal angles, in units of one wheel's.
MOMENTUM = 1e-8


class VectorLimits(StrEnum):
    """Reading of the limits |w| ≤ 1/8 rad/s and |T| ≤ 25 N m of vectors (eq. 23).

    COMPONENTS: the limit bounds the magnitude of each component. NORM: it bounds the Euclidean
    norm, so that plans satisfy both readings.
    """

    COMPONENTS = "components"
    NORM = "norm"


class Inertia(Array):
    """Symmetric matrix, given in full or by its diagonal."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        array = self._numbers(name, value)
        if array.shape not in ((3,), (3, 3)):
            raise InvalidData(
                f"{name} must be a symmetric matrix of shape (3, 3) or its diagonal, shape (3,), "
                f"got shape {array.shape}",
                field=name,
            )
        return super().coerce(name, np.diag(array) if array.ndim == 1 else array, sizes)


class _PerGyro(Array):
    """One number per gyro, or one for all gyros."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        array, count = self._numbers(name, value), sizes.get("gyros", (4, ""))[0]
        whole = np.broadcast_to(array, (count,)) if array.ndim == 0 else array
        return Array((count,), lower=self.lower, unit=self.unit).coerce(name, whole, sizes)


def _normalised(name: str, rows: Floats, must: str, place: str) -> Floats:
    """Return rows of length 1; rows whose length is 1 up to rounding keep their stored digits."""
    lengths = np.linalg.norm(rows, axis=1)
    row = int(np.abs(lengths - 1.0).argmax())
    if abs(lengths[row] - 1.0) > LENGTH:
        raise InvalidData(
            f"{name} must {must}, got {show(rows[row].tolist())} of length {lengths[row]:.9g}"
            + place.format(row),
            field=name,
        )
    lengths[np.abs(lengths - 1.0) <= 1e-15] = 1.0
    return frozen(rows / lengths[:, None])


class _Axes(Array):
    """Rows that are unit vectors; lengths that differ from 1 by rounding are normalised."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        axes = super().coerce(name, value, sizes)
        if not FEWEST <= len(axes) <= MOST:
            raise InvalidData(
                f"{name} must have {FEWEST} to {MOST} rows, one per gyro, got {len(axes)}",
                field=name,
            )
        return _normalised(name, axes, "hold unit vectors", " in row {}")


class Attitude(Array):
    """Unit quaternion, scalar first; a length that differs from 1 by rounding is normalised."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Floats:
        q = super().coerce(name, value, sizes)
        return _normalised(name, q[None], "be a unit quaternion, scalar first", "").reshape(4)


def check_inertia(matrix: Floats) -> None:
    """Raise ``InvalidData`` if no body has this inertia, shape (3, 3), kg m²."""
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


def _matrix(rows: Any, **options: Any) -> Any:
    return declared(Inertia((3, 3)), default=rows, **options)


@dataclass(frozen=True, eq=False, repr=False)
class SlewData(Model[ControlPlan]):
    """Data of a slew; see :class:`~crosstrack.models.SatelliteSlew`."""

    gimbal_axes: FloatsOrNone = declared(
        Optional(_Axes(("gyros", 3))), default=None, added=True, kw_only=True
    )
    wheel_axes: FloatsOrNone = declared(
        Optional(_Axes(("gyros", 3))), default=None, added=True, kw_only=True
    )
    inertia: FloatArray = _matrix((228.0, 188.0, 176.0))
    pyramid_angle: float = declared(Real(0.0, 90.0, strict=True, unit="degrees"), default=54.73)
    momentum: float = declared(Real(0.0, strict=True, unit="N m s"), default=17.53)
    rate_weight: FloatArray = declared(_PerGyro(("gyros",), lower=0.0), default=0.1)
    rate_limit: float = declared(Real(0.0, strict=True, unit="rad/s"), default=0.125)
    gimbal_rate_limit: float = declared(Real(0.0, strict=True, unit="rad/s"), default=1.0)
    torque_limit: float = declared(Real(0.0, strict=True, unit="N m"), default=25.0)
    singularity_limit: float = declared(Real(0.0), default=0.2)
    initial_attitude: FloatArray = declared(Attitude((4,)), default=(1.0, 0.0, 0.0, 0.0))
    final_attitude: FloatArray = declared(
        Attitude((4,)), default=(float(np.cos(np.pi / 8)), float(np.sin(np.pi / 8)), 0.0, 0.0)
    )
    initial_gimbals: FloatArray = declared(_PerGyro(("gyros",), unit="rad"), default=0.0)
    final_gimbals: FloatsOrNone = declared(Optional(_PerGyro(("gyros",), unit="rad")), default=0.0)
    time_range: FloatArray = declared(Array((2,), lower=0.0, unit="s"), default=(1.0, 60.0))
    margin: float = declared(Real(0.0), default=0.0)
    vector_limits: Field[str, VectorLimits] = declared(
        Member(VectorLimits), default=VectorLimits.COMPONENTS, added=True
    )
    initial_rate: FloatsOrNone = declared(
        Optional(Array((3,), unit="rad/s")), default=None, added=True
    )
    final_rate: FloatsOrNone = declared(
        Optional(Array((3,), unit="rad/s")), default=None, added=True
    )

    def check(self) -> None:
        """Raise if no satellite has these properties, or if an end is impossible."""
        check_inertia(self.inertia)
        self._check_gyros()
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
            measure = float(singularity_measure(gimbals, self.gyros))
            if measure < self.singularity_limit:
                raise InvalidData(
                    f"{name} must have det(A_t A_t') >= {self.singularity_limit:g}, got {measure:.6g}",
                    field=name,
                )
        for name, rates in (("initial_rate", self.begin_rate), ("final_rate", self.end_rate)):
            largest = float(self.magnitudes(rates).max())
            if largest > self.rate_limit:
                raise InvalidData(
                    f"{name} must be within rate_limit, {self.rate_limit:g} rad/s, got {largest:.6g}",
                    field=name,
                )
        needed = float(np.linalg.norm(self.final_momentum)) / self.momentum
        along = self.final_momentum / max(self.momentum * needed, np.finfo(float).tiny)
        capacity = momentum_capacity(self.gyros, along)
        if needed > capacity * (1.0 + LENGTH):
            name = "initial_rate" if self.final_rate is None else "final_rate"
            raise InvalidData(
                f"{name} needs a momentum of {self.momentum * needed:.6g} N m s in the gyros at the end, "
                f"which hold at most {self.momentum * capacity:.6g} N m s in its direction",
                field=name,
            )
        if self.final_gimbals is not None:
            direction = momentum_direction(self.final_gimbals, self.gyros)
            mismatch = float(np.abs(direction - self.final_momentum / self.momentum).max())
            if mismatch > MOMENTUM:
                wanted = ", ".join(f"{x:.6g}" for x in self.final_momentum)
                actual = ", ".join(f"{x:.6g}" for x in self.momentum * direction)
                raise InvalidData(
                    "final_gimbals must hold the momentum that the gyros have at the start, seen in "
                    f"the final body axes, less that of final_rate: h = ({wanted}) N m s, got "
                    f"({actual}); with these the satellite would not "
                    f"{'be at rest' if self.final_rate is None else 'have final_rate'}; None leaves "
                    "them free",
                    field="final_gimbals",
                )

    def _check_gyros(self) -> None:
        """Raise if the wheel axes do not fit the gimbal axes."""
        if self.wheel_axes is None:
            return
        if self.gimbal_axes is None:
            raise InvalidData(
                "wheel_axes needs gimbal_axes, the axes of the gimbals that turn the wheels",
                field="wheel_axes",
            )
        lean = np.abs((self.wheel_axes * self.gimbal_axes).sum(axis=1))
        if lean.max() > LENGTH:
            row = int(lean.argmax())
            raise InvalidData(
                f"wheel_axes must be perpendicular to gimbal_axes, got a cosine of {lean[row]:.3g} in "
                f"row {row}",
                field="wheel_axes",
            )

    @cached_property
    def gyros(self) -> Gyros:
        """Skew angle of the pyramid of four, rad, or coefficients of the momentum by `gimbal_axes`."""
        if self.gimbal_axes is None:
            return self.beta
        return gyro_coefficients(self.gimbal_axes, self.wheels)

    @cached_property
    def wheels(self) -> Floats:
        """Unit vectors of the wheels' momenta at the gimbal angle 0, shape (gyros, 3), with `gimbal_axes`."""
        assert self.gimbal_axes is not None
        if self.wheel_axes is not None:
            return self.wheel_axes
        level = np.cross([0.0, 0.0, 1.0], self.gimbal_axes)
        lengths = np.linalg.norm(level, axis=1, keepdims=True)
        is_level = lengths > LENGTH
        return frozen(np.where(is_level, level / np.where(is_level, lengths, 1.0), [1.0, 0.0, 0.0]))

    @property
    def gyro_count(self) -> int:
        """Number of gyros."""
        return len(self.initial_gimbals)

    @property
    def begin_rate(self) -> Floats:
        """Body rates at the start, rad/s, shape (3,); zero by default."""
        return np.zeros(3) if self.initial_rate is None else self.initial_rate

    @property
    def end_rate(self) -> Floats:
        """Body rates at the end, rad/s, shape (3,); zero by default."""
        return np.zeros(3) if self.final_rate is None else self.final_rate

    @property
    def beta(self) -> float:
        """Skew angle of the pyramid, rad."""
        return float(np.deg2rad(self.pyramid_angle))

    @property
    def planned_torque(self) -> float:
        """Torque limit for plans, reduced by the margin, N m."""
        return self.torque_limit * (1.0 - self.margin)

    @property
    def planned_gimbal_rate(self) -> float:
        """Gimbal rate limit for plans, reduced by the margin, rad/s."""
        return self.gimbal_rate_limit * (1.0 - self.margin)

    def magnitudes(self, vectors: ArrayLike) -> Floats:
        """Return the values bounded by a limit: magnitudes of components, or the norm, shape (…, 3 or 1)."""
        array = np.asarray(vectors, float)
        norm = self.vector_limits == VectorLimits.NORM
        result: Floats = np.linalg.norm(array, axis=-1, keepdims=True) if norm else np.abs(array)
        return result

    def bounded_names(self, vector: str) -> tuple[str, ...]:
        """Return the names of the entries of :meth:`magnitudes` for a vector called `vector`."""
        if self.vector_limits == VectorLimits.NORM:
            return (f"|{vector}|",)
        return tuple(f"{vector}[{k}]" for k in range(3))

    @cached_property
    def target(self) -> Floats:
        """Final attitude with the sign that is nearer to the initial one, shape (4,)."""
        q = self.final_attitude
        return frozen(-q if q @ self.initial_attitude < 0.0 else q)

    @cached_property
    def turn(self) -> tuple[Floats, float]:
        """Axis, shape (3,), and angle (rad) of the rotation from the initial to the final attitude."""
        axis, angle = axis_and_angle(product(conjugate(self.initial_attitude), self.final_attitude))
        return frozen(axis), angle

    @cached_property
    def total_momentum(self) -> Floats:
        """Constant momentum of satellite and gyros in inertial axes, N m s, shape (3,)."""
        gyros = self.momentum * momentum_direction(self.initial_gimbals, self.gyros)
        body = gyros + self.inertia @ self.begin_rate
        return frozen(rotation_matrix(self.initial_attitude) @ body)

    @cached_property
    def final_momentum(self) -> Floats:
        """Momentum of the gyros at the end with `final_rate`, body axes, N m s, shape (3,)."""
        total = rotation_matrix(self.final_attitude).T @ self.total_momentum
        return frozen(total - self.inertia @ self.end_rate)
