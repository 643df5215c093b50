"""Four single-gimbal control moment gyros in a pyramid: momentum, its Jacobian, and singularities.

Each gyro's wheel has the momentum h0 in a direction that its gimbal rotates. With the pyramid's skew
angle β and the gimbal angles δ, the momentum of all four is h = h0 A_s(δ)·1 with

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

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["gimbal_jacobian", "momentum_direction", "singularity_measure"]

Floats = NDArray[np.float64]


@lru_cache(maxsize=16)
def _coefficients(pyramid: float) -> tuple[Floats, Floats]:
    """Return the coefficients of the sines and of the cosines in A_s·1, each of shape (3, 4)."""
    cb, sb = np.cos(pyramid), np.sin(pyramid)
    sines = np.array([[-cb, 0.0, cb, 0.0], [0.0, -cb, 0.0, cb], [sb, sb, sb, sb]])
    cosines = np.array([[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    return sines, cosines


def momentum_direction(gimbals: ArrayLike, pyramid: float) -> Floats:
    """Return A_s(δ)·1, the momentum in units of one wheel's, in body axes.

    Parameters
    ----------
    gimbals : array_like, shape (…, 4)
        Gimbal angles δ, rad.
    pyramid : float
        The skew angle β, rad.

    Returns
    -------
    ndarray, shape (…, 3)
    """
    angles = np.asarray(gimbals, float)
    of_sines, of_cosines = _coefficients(pyramid)
    result: Floats = np.sin(angles) @ of_sines.T + np.cos(angles) @ of_cosines.T
    return result


def gimbal_jacobian(gimbals: ArrayLike, pyramid: float) -> Floats:
    """Return A_t(δ) = ∂(A_s·1)/∂δ, shape (…, 3, 4); parameters as in :func:`momentum_direction`."""
    angles = np.asarray(gimbals, float)[..., None, :]
    of_sines, of_cosines = _coefficients(pyramid)
    result: Floats = of_sines * np.cos(angles) - of_cosines * np.sin(angles)
    return result


def singularity_measure(gimbals: ArrayLike, pyramid: float) -> Floats:
    """Return det(A_t A_tᵀ), shape (…), which is 0 for singular gyros.

    It is computed by the Cauchy-Binet formula, as the sum of the squares of the four 3 x 3
    determinants, which rounding cannot make negative.
    """
    jacobian = gimbal_jacobian(gimbals, pyramid)
    a, b, c = (jacobian[..., k, :] for k in range(3))
    total: Floats = np.zeros(jacobian.shape[:-2])
    for i, j, k in combinations(range(4), 3):
        minor = (
            a[..., i] * (b[..., j] * c[..., k] - b[..., k] * c[..., j])
            - a[..., j] * (b[..., i] * c[..., k] - b[..., k] * c[..., i])
            + a[..., k] * (b[..., i] * c[..., j] - b[..., j] * c[..., i])
        )
        total = total + minor**2
    return total
