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
from .gyros import gimbal_jacobian, momentum_direction
from .quaternions import rotation_matrix

__all__ = ["CONTROLS", "STATES", "SlewMotion"]

Floats = NDArray[np.float64]

#: Names of states and controls, in order.
STATES = (
    *(f"q[{k}]" for k in range(4)),
    *(f"w[{k}]" for k in range(3)),
    *(f"delta[{k}]" for k in range(4)),
)
CONTROLS = tuple(f"rate[{k}]" for k in range(4))


@dataclass(frozen=True, eq=False)
class SlewMotion:
    """Equations of motion of a satellite with four gyros.

    Parameters
    ----------
    inertia : ndarray, shape (3, 3)
        I, kg m².
    momentum : float
        h0, N m s.
    beta : float
        Skew angle of the pyramid, rad.
    """

    inertia: Floats
    momentum: float
    beta: float

    def __post_init__(self) -> None:
        # For single instants, Python's float arithmetic is five times as fast as NumPy's.
        object.__setattr__(self, "_rows", self.inertia.tolist())
        object.__setattr__(self, "_inverse", np.linalg.inv(self.inertia).tolist())
        object.__setattr__(self, "_skew", (cos(self.beta), sin(self.beta)))

    @classmethod
    def of(cls, model: SlewData) -> SlewMotion:
        """Return the motion of `model`."""
        return cls(model.inertia, model.momentum, model.beta)

    def rate(self, x: Floats, u: Floats, outer: Iterable[float] = (0.0, 0.0, 0.0)) -> list[float]:
        """Return ẋ at one instant (eq. 3, 9 and 10).

        Parameters
        ----------
        x : ndarray, shape (11,)
            q, w and δ.
        u : ndarray, shape (4,)
            Gimbal rates δ̇, rad/s.
        outer : iterable of float, length 3
            Outer torque T_ext in body axes, N m.
        """
        a, b, c, d, wx, wy, wz, d1, d2, d3, d4 = x.tolist()
        u1, u2, u3, u4 = u.tolist()
        tx, ty, tz = outer
        s1, s2, s3, s4 = sin(d1), sin(d2), sin(d3), sin(d4)
        c1, c2, c3, c4 = cos(d1), cos(d2), cos(d3), cos(d4)
        (cb, sb), h0 = self._skew, self.momentum  # type: ignore[attr-defined]
        tx -= h0 * (-cb * c1 * u1 + s2 * u2 + cb * c3 * u3 - s4 * u4)
        ty -= h0 * (-s1 * u1 - cb * c2 * u2 + s3 * u3 + cb * c4 * u4)
        tz -= h0 * sb * (c1 * u1 + c2 * u2 + c3 * u3 + c4 * u4)
        (ixx, ixy, ixz), (iyx, iyy, iyz), (izx, izy, izz) = self._rows  # type: ignore[attr-defined]
        hx = ixx * wx + ixy * wy + ixz * wz + h0 * (-cb * s1 - c2 + cb * s3 + c4)
        hy = iyx * wx + iyy * wy + iyz * wz + h0 * (c1 - cb * s2 - c3 + cb * s4)
        hz = izx * wx + izy * wy + izz * wz + h0 * sb * (s1 + s2 + s3 + s4)
        tx -= wy * hz - wz * hy
        ty -= wz * hx - wx * hz
        tz -= wx * hy - wy * hx
        return [
            -0.5 * (wx * b + wy * c + wz * d),
            -0.5 * (wy * d - wz * c) + 0.5 * a * wx,
            -0.5 * (wz * b - wx * d) + 0.5 * a * wy,
            -0.5 * (wx * c - wy * b) + 0.5 * a * wz,
            *(row[0] * tx + row[1] * ty + row[2] * tz for row in self._inverse),  # type: ignore[attr-defined]
            u1, u2, u3, u4,
        ]  # fmt: skip

    def torque(self, gimbals: ArrayLike, rates: ArrayLike) -> Floats:
        """Return T_c = -h0 A_t δ̇ (eq. 9), N m, shape (…, 3)."""
        jacobian = gimbal_jacobian(gimbals, self.beta)
        result: Floats = -self.momentum * (jacobian @ np.asarray(rates, float)[..., None])[..., 0]
        return result

    def body_momentum(self, rates: ArrayLike, gimbals: ArrayLike) -> Floats:
        """Return I w + h in body axes, N m s, shape (…, 3)."""
        gyros = self.momentum * momentum_direction(gimbals, self.beta)
        return np.asarray(rates, float) @ self.inertia.T + gyros

    def total_momentum(self, states: ArrayLike) -> Floats:
        """Return R(q)(I w + h) in inertial axes, N m s, shape (…, 3), constant without outer torque."""
        x = np.asarray(states, float)
        body = self.body_momentum(x[..., 4:7], x[..., 7:])
        result: Floats = (rotation_matrix(x[..., :4]) @ body[..., None])[..., 0]
        return result
