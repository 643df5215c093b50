"""Steering laws: gimbal rates for a commanded torque.

All laws solve A δ̇ = y, with the Jacobian A of the pyramid and y = -T_c / h0, in one form,

    δ̇ = Aᵀ (A Aᵀ + λ E)⁻¹ y,

and differ in λ and E. λ = 0 is the Moore-Penrose pseudo-inverse: exact, and unbounded near a
singularity. The singularity-robust inverse has E = 1 and λ = λ0 exp(-μ det(A Aᵀ)), and gives
bounded rates for a slightly different torque (Nakamura and Hanafusa, "Inverse kinematic
solutions with singularity robustness for robot manipulator control", Journal of Dynamic Systems,
Measurement, and Control 108, 1986; Bedrossian, Paradiso, Bergmann and Rowell, Journal of Guidance,
Control, and Dynamics 13(6), 1990). The generalised inverse has oscillating off-diagonal entries of
E, so that no torque is locked out (Wie, Bailey and Heiberg, "Singularity robust steering logic for
redundant single-gimbal control moment gyros", Journal of Guidance, Control, and Dynamics 24(5),
2001).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["GeneralisedInverse", "PseudoInverse", "RobustInverse", "SteeringLaw", "null_projection"]

Floats = NDArray[np.float64]

#: Addition to A Aᵀ, whose entries are about 1, that makes it invertible.
LEAST = 1e-12 * np.eye(3)


class SteeringLaw(ABC):
    """Mapping from a torque to gimbal rates."""

    @abstractmethod
    def damping(self, t: float, square: Floats) -> Floats:
        """Return λ E at time `t` for A Aᵀ = `square`, both of shape (3, 3)."""

    def rates(self, t: float, jacobian: Floats, wanted: Floats) -> Floats:
        """Return δ̇, shape (gyros,), for A of shape (3, gyros) and y of shape (3,)."""
        square = jacobian @ jacobian.T
        result: Floats = jacobian.T @ np.linalg.solve(
            square + self.damping(t, square) + LEAST, wanted
        )
        return result


@dataclass(frozen=True)
class PseudoInverse(SteeringLaw):
    """Moore-Penrose pseudo-inverse: λ = 0."""

    def damping(self, t: float, square: Floats) -> Floats:
        return np.zeros((3, 3))


@dataclass(frozen=True)
class RobustInverse(SteeringLaw):
    """Singularity-robust inverse with the damping λ0 = `most`, which decays with μ = `decay` times det(A Aᵀ)."""

    most: float
    decay: float

    def damping(self, t: float, square: Floats) -> Floats:
        return self.size(square) * np.eye(3)

    def size(self, square: Floats) -> float:
        """Return λ."""
        return self.most * float(np.exp(-self.decay * max(np.linalg.det(square), 0.0)))


@dataclass(frozen=True)
class GeneralisedInverse(RobustInverse):
    """Generalised singularity-robust inverse: E has ε sin(ω t + φ_i) off its diagonal.

    `amplitude` is ε and `frequency` is ω, rad/s.
    """

    amplitude: float
    frequency: float

    def damping(self, t: float, square: Floats) -> Floats:
        a, b, c = self.amplitude * np.sin(self.frequency * t + np.array([0.0, 0.5, 1.0]) * np.pi)
        return self.size(square) * np.array([[1.0, c, b], [c, 1.0, a], [b, a, 1.0]])


def null_projection(jacobian: Floats, wanted: Floats) -> Floats:
    """Return the part of the gimbal rates `wanted` that produces no torque, shape (gyros,)."""
    square = jacobian @ jacobian.T + LEAST
    return wanted - jacobian.T @ np.linalg.solve(square, jacobian @ wanted)
