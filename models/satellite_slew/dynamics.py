"""Motion of a satellite with control moment gyros in plain numbers: eq. 3, 9 and 10 without CasADi.

Verification, steering heuristics and the simulation of a controller use this module. The equations for
solvers are written independently in :mod:`crosstrack.models.satellite_slew.lowered`, and a test
compares the two.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .data import SlewData
from .gyros import Gyros, as_coefficients, gimbal_jacobian, momentum_direction
from .quaternions import rotation_matrix

__all__ = ["CONTROLS", "STATES", "SlewMotion", "names_of"]

Floats = NDArray[np.float64]


def names_of(count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the states and controls of a satellite with `count` gyros, in order."""
    parts = (("q", 4), ("w", 3), ("delta", count))
    states = tuple(f"{name}[{k}]" for name, size in parts for k in range(size))
    return states, tuple(f"rate[{k}]" for k in range(count))


#: Names of the states and controls with four gyros.
STATES, CONTROLS = names_of(4)


@dataclass(frozen=True, eq=False)
class SlewMotion:
    """Equations of motion of a satellite with the inertia I (kg m²) and wheels of the momentum h0 (N m s).

    `gyros` is the skew angle of the pyramid of four, rad, or coefficients (:func:`~.gyros.gyro_coefficients`).
    """

    inertia: Floats
    momentum: float
    gyros: Gyros

    def __post_init__(self) -> None:
        # For single instants, Python's float arithmetic is five times as fast as NumPy's.
        object.__setattr__(self, "_rows", self.inertia.tolist())
        object.__setattr__(self, "_inverse", np.linalg.inv(self.inertia).tolist())
        object.__setattr__(self, "_wheels", np.vstack(as_coefficients(self.gyros)).T.tolist())

    @classmethod
    def of(cls, model: SlewData) -> SlewMotion:
        """Return the motion of `model`."""
        return cls(model.inertia, model.momentum, model.gyros)

    def rate(self, x: Floats, u: Floats, outer: Iterable[float] = (0.0, 0.0, 0.0)) -> list[float]:
        """Return ẋ at one instant (eq. 3, 9 and 10).

        `x` stacks q, w and δ, `u` are the gimbal rates, and `outer` is T_ext in body axes, N m.
        """
        a, b, c, d, wx, wy, wz, *angles = x.tolist()
        speeds = u.tolist()
        tx, ty, tz = outer
        h0, gx, gy, gz = self.momentum, 0.0, 0.0, 0.0
        wheels: list[list[float]] = self._wheels  # type: ignore[attr-defined]
        for angle, speed, (bx, by, bz, ax, ay, az) in zip(angles, speeds, wheels, strict=True):
            sine, cosine = h0 * sin(angle), h0 * cos(angle)
            gx += bx * sine + ax * cosine
            gy += by * sine + ay * cosine
            gz += bz * sine + az * cosine
            tx -= (bx * cosine - ax * sine) * speed
            ty -= (by * cosine - ay * sine) * speed
            tz -= (bz * cosine - az * sine) * speed
        (ixx, ixy, ixz), (iyx, iyy, iyz), (izx, izy, izz) = self._rows  # type: ignore[attr-defined]
        hx = ixx * wx + ixy * wy + ixz * wz + gx
        hy = iyx * wx + iyy * wy + iyz * wz + gy
        hz = izx * wx + izy * wy + izz * wz + gz
        tx -= wy * hz - wz * hy
        ty -= wz * hx - wx * hz
        tz -= wx * hy - wy * hx
        return [
            -0.5 * (wx * b + wy * c + wz * d),
            -0.5 * (wy * d - wz * c) + 0.5 * a * wx,
            -0.5 * (wz * b - wx * d) + 0.5 * a * wy,
            -0.5 * (wx * c - wy * b) + 0.5 * a * wz,
            *(row[0] * tx + row[1] * ty + row[2] * tz for row in self._inverse),  # type: ignore[attr-defined]
            *speeds,
        ]  # fmt: skip

    def torque(self, gimbals: ArrayLike, rates: ArrayLike) -> Floats:
        """Return T_c = -h0 A_t δ̇ (eq. 9), N m, shape (…, 3)."""
        jacobian = gimbal_jacobian(gimbals, self.gyros)
        result: Floats = -self.momentum * (jacobian @ np.asarray(rates, float)[..., None])[..., 0]
        return result

    def body_momentum(self, rates: ArrayLike, gimbals: ArrayLike) -> Floats:
        """Return I w + h in body axes, N m s, shape (…, 3)."""
        wheels = self.momentum * momentum_direction(gimbals, self.gyros)
        return np.asarray(rates, float) @ self.inertia.T + wheels

    def total_momentum(self, states: ArrayLike) -> Floats:
        """Return R(q)(I w + h) in inertial axes, N m s, shape (…, 3), constant without outer torque."""
        x = np.asarray(states, float)
        body = self.body_momentum(x[..., 4:7], x[..., 7:])
        return (rotation_matrix(x[..., :4]) @ body[..., None])[..., 0]
