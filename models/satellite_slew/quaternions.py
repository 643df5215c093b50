"""Attitudes as unit quaternions, scalar first, with Hamilton's product.

A quaternion q = (q0, q1, q2, q3) maps a vector's body components to its inertial ones, v_I =
R(q) v_B. With the body rates w its motion is q̇ = ½ q ∘ (0, w), in parts q̇0 = -½ w·q and
q̇ = -½ w×q + ½ q0 w: eq. 10 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on
the Gauss Pseudospectral Method" (Mathematical Problems in Engineering, 2016). q and -q represent
the same attitude. All functions accept stacks of quaternions, shape (…, 4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "attitude_error",
    "axis_and_angle",
    "conjugate",
    "product",
    "quaternion_rate",
    "rotation_about",
    "rotation_matrix",
]

Floats = NDArray[np.float64]

#: Length of the vector part below which a rotation has no axis.
STILL = 1e-12
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
#: Hamilton's product p ∘ q is the product of a matrix with q: its entries are those of p, in this order
#: and with these signs.
_ORDER = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_SIGNS = np.array([[1, -1, -1, -1], [1, 1, -1, 1], [1, 1, 1, -1], [1, -1, 1, 1]], float)


def product(left: ArrayLike, right: ArrayLike) -> Floats:
    """Return Hamilton's product `left` ∘ `right`, shape (…, 4)."""
    p, q = np.asarray(left, float), np.asarray(right, float)
    result: Floats = ((p[..., _ORDER] * _SIGNS) @ q[..., None])[..., 0]
    return result


def conjugate(q: ArrayLike) -> Floats:
    """Return the conjugate, the inverse of a unit quaternion, shape (…, 4)."""
    result: Floats = np.asarray(q, float) * _CONJUGATE
    return result


def rotation_matrix(q: ArrayLike) -> Floats:
    """Return R(q), which maps body components to inertial ones, shape (…, 3, 3).

    R(q) = (q0² - q·q) 1 + 2 q qᵀ + 2 q0 [q×], for a quaternion of length 1.
    """
    array = np.asarray(q, float)
    a, b, c, d = (array[..., k] for k in range(4))
    rows = [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Floats:
    """Return the rotation by `angle` (rad), shape (…), about `axis` of any length but 0, shape (…, 4)."""
    unit = np.asarray(axis, float)
    unit = unit / np.linalg.norm(unit)
    half = 0.5 * np.asarray(angle, float)[..., None]
    return np.concatenate([np.cos(half), np.sin(half) * unit], axis=-1)


def axis_and_angle(q: ArrayLike) -> tuple[Floats, float]:
    """Return axis, shape (3,), and angle (rad, 0 to π) of the shorter rotation.

    The axis of the identity is x.
    """
    turn = np.asarray(q, float)
    turn = -turn if turn[0] < 0.0 else turn
    length = float(np.linalg.norm(turn[1:]))
    if length < STILL:
        return np.array([1.0, 0.0, 0.0]), 0.0
    return turn[1:] / length, 2.0 * float(np.arctan2(length, turn[0]))


def quaternion_rate(q: ArrayLike, rates: ArrayLike) -> Floats:
    """Return q̇ = ½ q ∘ (0, w) for the body rates w (rad/s), eq. 10, shape (…, 4)."""
    w = np.asarray(rates, float)
    return 0.5 * product(q, np.concatenate([np.zeros_like(w[..., :1]), w], axis=-1))


def attitude_error(q: ArrayLike, desired: ArrayLike) -> Floats:
    """Return the error quaternion q_e = q_d* ∘ q, shape (…, 4), eq. 25.

    The scalar part is q_e0 = q0 q_d0 + q·q_d, printed with a minus that violates eq. 26. The vector
    part, half the angle of a small error, is q_d0 q - q0 q_d + q×q_d. The sign is chosen so that
    q_e0 >= 0.
    """
    error = product(conjugate(desired), q)
    return np.where(error[..., :1] < 0.0, -error, error)
