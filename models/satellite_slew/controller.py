"""Controller that tracks a planned slew: from measured states to gimbal rates.

Source: eq. 24-33 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016. The paper ends at the torque
T_c; the gimbal rates that produce it are ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import lsq_linear

from ..optimal_control.plan import PhasePlan
from .dynamics import SlewMotion
from .gyros import gimbal_jacobian
from .model import SatelliteSlew
from .quaternions import attitude_error

__all__ = ["Controller", "TrackingLaw", "lyapunov_function", "tracking_torque"]

Floats = NDArray[np.float64]

#: Damping of the inverse near a singularity, in units of A_t A_tᵀ.
DAMPING = 1e-6
#: Missing torque above which a sample is saturated, N m.
LOST = 1e-2
#: Number of evaluations of the Jacobian per sample, each in the middle of the previous motion.
PASSES = 2


class TrackingLaw(StrEnum):
    """Gain K_p of the attitude error in eq. 32.

    PAPER: the scalar K_p = k1 q_e0 of the paper's proof, with k1 = 2 ω_n² tr(I) / 3. INERTIA: the
    matrix K_p = 2 ω_n² I, which is ours and gives the error the natural frequency ω_n about each
    axis.
    """

    PAPER = "paper"
    INERTIA = "inertia"

    def stiffness(self, frequency: float, inertia: Floats, scalar: float) -> Floats:
        """Return K_p, N m, shape (3, 3), for ω_n (rad/s), the inertia and the scalar part of q_e."""
        if self == TrackingLaw.INERTIA:
            return 2.0 * frequency**2 * inertia
        gain = 2.0 * frequency**2 * float(np.trace(inertia)) / 3.0
        return gain * scalar * np.eye(3)


def tracking_torque(
    stiffness: ArrayLike,
    damping: ArrayLike,
    error: ArrayLike,
    rate_error: ArrayLike,
    outer: ArrayLike,
    gyration: ArrayLike,
    push: ArrayLike,
) -> Floats:
    """Return T_c = -K_p q_e - K_d w_e - T_ext + w×(I w + h) + I ẇ_d (eq. 32), N m, shape (3,).

    `stiffness` (N m) and `damping` (N m s) are K_p and K_d, shape (3, 3). `error` is the vector part of q_e
    (eq. 25), `rate_error` is w - w_d. `outer`, `gyration` and `push` are T_ext, w×(I w + h) and I ẇ_d, N m.
    """
    feedback = np.asarray(stiffness) @ np.asarray(error) + np.asarray(damping) @ np.asarray(
        rate_error
    )
    torque: Floats = np.asarray(gyration) + np.asarray(push) - feedback - np.asarray(outer)
    return torque


def lyapunov_function(gain: float, inertia: Floats, error: Floats, rate_error: Floats) -> float:
    """Return V = k1 q_eᵀ q_e + ½ w_eᵀ I w_e (eq. 28), N m.

    Under the law of eq. 32 with K_p = k1 q_e0, without limits, V̇ = -w_eᵀ K_d w_e (eq. 33).
    """
    return float(gain * error @ error + 0.5 * rate_error @ inertia @ rate_error)


@dataclass(frozen=True, eq=False)
class Controller:
    """Controller on one phase of a plan.

    `frequency` (rad/s) and `damping` are ω_n and ζ. `outer` is T_ext (N m) as a function of time, and `known`
    the share of it that the controller compensates. `homing` is the rate of the null motion back to the
    plan's gimbal angles, 1/s. `law` is the gain of the attitude error.
    """

    model: SatelliteSlew
    phase: PhasePlan
    frequency: float
    damping: float
    outer: Callable[[float], Floats]
    known: float
    homing: float
    law: TrackingLaw = TrackingLaw.INERTIA

    def wanted(self, t: float) -> Floats:
        """Return the plan's states at `t`, or at its end for later times, shape (7 + gyros,)."""
        return self.phase.states(np.clip(t, self.phase.start, self.phase.end))

    def errors(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """Return q_e (eq. 25) and w_e."""
        desired = self.wanted(t)
        return attitude_error(x[:4], desired[:4]), x[4:7] - desired[4:7]

    def command(self, t: float, long: float, x: Floats) -> tuple[Floats, Floats, bool]:
        """Return T_c of eq. 32, the gimbal rates for it, and whether the gyros produce less.

        `t` and `long` are time and length of the sample, and `x`, shape (7 + gyros,), the measured state.
        """
        model, motion = self.model, SlewMotion.of(self.model)
        current, following = self.wanted(t), self.wanted(t + long)
        error, rate_error = self.errors(t, x)
        w, delta = x[4:7], x[7:]
        # The plan's mean acceleration and gimbal rate over the sample lead to its next state.
        push = (following[4:7] - current[4:7]) / long
        torque = tracking_torque(
            self.law.stiffness(self.frequency, model.inertia, float(error[0])),
            2.0 * self.damping * self.frequency * model.inertia, error[1:], rate_error,
            self.known * self.outer(t + 0.5 * long), np.cross(w, motion.body_momentum(w, delta)),
            model.inertia @ push,
        )  # fmt: skip
        excess = np.maximum(model.magnitudes(torque) / model.torque_limit, 1.0)
        direction = -(torque / excess) / model.momentum
        rates = (following[7:] - current[7:]) / long
        # Faster homing would overshoot within a sample.
        preferred = rates + min(self.homing, 1.0 / long) * (current[7:] - delta)
        for _ in range(PASSES):
            jacobian = gimbal_jacobian(delta + 0.5 * long * rates, model.gyros)
            rates = self.steer(jacobian, direction, preferred)
        produced = -model.momentum * (jacobian @ rates)
        return torque, rates, float(np.abs(produced - torque).max()) > LOST

    def steer(self, jacobian: Floats, wanted: Floats, wished: Floats) -> Floats:
        """Return gimbal rates with A_t δ̇ = `wanted`, as near to `wished` as the limits allow.

        If a gimbal would be too fast, the residual is minimised in the least-squares sense within the
        limits, with priority for the torque: more than three gimbals leave a degree of freedom.
        """
        square = jacobian @ jacobian.T + DAMPING * np.eye(3)
        rates = wished + jacobian.T @ np.linalg.solve(square, wanted - jacobian @ wished)
        most = self.model.gimbal_rate_limit
        if np.abs(rates).max() > most:
            light = np.sqrt(DAMPING)
            table = np.vstack([jacobian, light * np.eye(rates.size)])
            aim = np.concatenate([wanted, light * rates])
            rates = lsq_linear(table, aim, (-most, most), method="bvls").x
        return rates
