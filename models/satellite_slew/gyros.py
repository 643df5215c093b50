"""Single-gimbal control moment gyros: momentum, its Jacobian, and singularities.

Each gyro's wheel has the momentum h0 in a direction that its gimbal rotates: about the unit gimbal
axis g, from the wheel axis s at the gimbal angle 0, it is s cos δ + (g × s) sin δ. For four gyros in a
pyramid with skew angle β, the momentum of all is h = h0 A_s(δ)·1 with

    A_s·1 = [-cβ sδ1 - cδ2 + cβ sδ3 + cδ4,
             cδ1 - cβ sδ2 - cδ3 + cβ sδ4,
             sβ (sδ1 + sδ2 + sδ3 + sδ4)],

and A_t = ∂(A_s·1)/∂δ maps gimbal rates to torque, T_c = -ḣ = -h0 A_t δ̇ (eq. 9 of "Path Planning
for Rapid Large-Angle Maneuver of Satellites Based on the Gauss Pseudospectral Method", Mathematical
Problems in Engineering, 2016). If det(A_t A_tᵀ) = 0, the gyros produce no torque in some direction.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..fields import Real, Whole

__all__ = [
    "Gyros",
    "as_coefficients",
    "gimbal_jacobian",
    "gyro_coefficients",
    "momentum_capacity",
    "momentum_direction",
    "pyramid_axes",
    "singularity_measure",
]

Floats = NDArray[np.float64]
#: Gyros as the skew angle of the pyramid of four, rad, or as the coefficients of the sines and of the
#: cosines in A_s·1, each of shape (3, gyros).
Gyros: TypeAlias = float | tuple[Floats, Floats]
#: Fewest and most gyros: two cannot produce torques in all directions, and the guess enumerates gimbal
#: angles.
FEWEST, MOST = 3, 8


def pyramid_axes(count: int, skew: float) -> Floats:
    """Return the gimbal axes of a regular pyramid, for ``SatelliteSlew(gimbal_axes=...)``.

    Parameters
    ----------
    count : int
        Number of gyros, one per face.
    skew : float
        Skew angle β of the faces in degrees.

    Returns
    -------
    ndarray, shape (count, 3)
        Unit vectors in body axes, the first in the plane of x and z.

    Raises
    ------
    InvalidData
        `count` is not a whole number from 3 to 8, or `skew` is not a finite number.
    """
    count, skew = Whole(FEWEST, MOST).coerce("count", count, {}), Real().coerce("skew", skew, {})
    around, beta = 2.0 * np.pi * np.arange(count) / count, np.deg2rad(skew)
    flat = np.column_stack([np.cos(around), np.sin(around)])
    return np.column_stack([np.sin(beta) * flat, np.full(count, np.cos(beta))])


def gyro_coefficients(gimbal_axes: Floats, wheel_axes: Floats) -> tuple[Floats, Floats]:
    """Return the coefficients of the sines and of the cosines in A_s·1, each of shape (3, gyros).

    The rows of `gimbal_axes` are the unit vectors g in body axes, those of `wheel_axes` the perpendicular s.
    """
    return np.cross(gimbal_axes, wheel_axes).T, np.array(wheel_axes.T)


def momentum_capacity(gyros: Gyros, direction: ArrayLike) -> float:
    """Return the largest A_s·1 along the unit vector `direction`, shape (3,), over all gimbal angles."""
    of_sines, of_cosines = as_coefficients(gyros)
    along = np.asarray(direction, float)
    return float(np.hypot(along @ of_sines, along @ of_cosines).sum())


def as_coefficients(gyros: Gyros) -> tuple[Floats, Floats]:
    """Return the coefficients of the sines and of the cosines in A_s·1, each of shape (3, gyros)."""
    return gyros if isinstance(gyros, tuple) else _of_pyramid(gyros)


@lru_cache(maxsize=16)
def _of_pyramid(pyramid: float) -> tuple[Floats, Floats]:
    """Return the coefficients of the pyramid of four with the skew angle `pyramid`, rad."""
    cb, sb = np.cos(pyramid), np.sin(pyramid)
    sines = np.array([[-cb, 0.0, cb, 0.0], [0.0, -cb, 0.0, cb], [sb, sb, sb, sb]])
    cosines = np.array([[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    return sines, cosines


def momentum_direction(gimbals: ArrayLike, pyramid: Gyros) -> Floats:
    """Return A_s(δ)·1 in body axes, shape (…, 3), in units of one wheel's momentum.

    `pyramid` is the skew angle β of the pyramid of four, rad, or the coefficients of :func:`gyro_coefficients`.
    """
    angles = np.asarray(gimbals, float)
    of_sines, of_cosines = as_coefficients(pyramid)
    result: Floats = np.sin(angles) @ of_sines.T + np.cos(angles) @ of_cosines.T
    return result


def gimbal_jacobian(gimbals: ArrayLike, pyramid: Gyros) -> Floats:
    """Return A_t(δ) = ∂(A_s·1)/∂δ, shape (…, 3, gyros); parameters as in :func:`momentum_direction`."""
    angles = np.asarray(gimbals, float)[..., None, :]
    of_sines, of_cosines = as_coefficients(pyramid)
    result: Floats = of_sines * np.cos(angles) - of_cosines * np.sin(angles)
    return result


def singularity_measure(gimbals: ArrayLike, pyramid: Gyros) -> Floats:
    """Return det(A_t A_tᵀ), shape (…), which is 0 for singular gyros.

    It is computed by the Cauchy-Binet formula, as the sum of the squares of all 3 x 3
    determinants, which rounding cannot make negative.
    """
    jacobian = gimbal_jacobian(gimbals, pyramid)
    a, b, c = (jacobian[..., k, :] for k in range(3))
    total: Floats = np.zeros(jacobian.shape[:-2])
    for i, j, k in combinations(range(jacobian.shape[-1]), 3):
        minor = (
            a[..., i] * (b[..., j] * c[..., k] - b[..., k] * c[..., j])
            - a[..., j] * (b[..., i] * c[..., k] - b[..., k] * c[..., i])
            + a[..., k] * (b[..., i] * c[..., j] - b[..., j] * c[..., i])
        )
        total = total + minor**2
    return total
