"""Controller that tracks a planned slew: measured states in, gimbal rates out.

Source: eq. 24-33 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016. The paper ends at the torque
T_c; the gimbal rates that give it are ours.
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

#: Damping of the correction's inverse near a singularity, in units of A_t A_tᵀ.
DAMPING = 1e-6
#: Torque that must be missing for a sample to count as saturated, N m.
LOST = 1e-2
#: How often the Jacobian is taken anew, in the middle of the motion that it leads to.
PASSES = 2


class TrackingLaw(StrEnum):
    """Gain K_p of the attitude error in eq. 32.

    PAPER is the scalar K_p = k1 q_e0 of the paper's proof, with k1 = 2 ω_n² tr(I) / 3. INERTIA is
    the matrix K_p = 2 ω_n² I, ours, which gives the error the natural frequency ω_n about each axis.
    """

    PAPER = "paper"
    INERTIA = "inertia"

    def stiffness(self, frequency: float, inertia: Floats, scalar: float) -> Floats:
        """Return K_p, N m, shape (3, 3).

        Parameters
        ----------
        frequency : float
            ω_n, rad/s.
        inertia : ndarray, shape (3, 3)
            I, kg m².
        scalar : float
            q_e0, the scalar part of the error quaternion.
        """
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

    Parameters
    ----------
    stiffness, damping : array_like, shape (3, 3)
        K_p (N m) and K_d (N m s), symmetric and positive definite.
    error, rate_error : array_like, shape (3,)
        q_e, the vector part of the error quaternion (eq. 25), and w_e = w - w_d, rad/s.
    outer, gyration, push : array_like, shape (3,)
        T_ext, w×(I w + h) and I ẇ_d, N m.
    """
    feedback = np.asarray(stiffness) @ np.asarray(error) + np.asarray(damping) @ np.asarray(
        rate_error
    )
    found: Floats = np.asarray(gyration) + np.asarray(push) - feedback - np.asarray(outer)
    return found


def lyapunov_function(gain: float, inertia: Floats, error: Floats, rate_error: Floats) -> float:
    """Return V = k1 q_eᵀ q_e + ½ w_eᵀ I w_e (eq. 28), N m.

    Under the law of eq. 32 with K_p = k1 q_e0, without limits, V̇ = -w_eᵀ K_d w_e (eq. 33).
    """
    return float(gain * error @ error + 0.5 * rate_error @ inertia @ rate_error)


@dataclass(frozen=True, eq=False)
class Controller:
    """Controller on one phase of a plan; parameters as in ``track``.

    Parameters
    ----------
    model : SatelliteSlew
        The satellite as the controller models it.
    phase : PhasePlan
        The plan to follow.
    frequency, damping : float
        ω_n (rad/s) and ζ.
    outer : callable
        T_ext, N m, as a function of time.
    known : float
        Share of T_ext that the controller compensates.
    homing : float
        Rate of the null motion back to the plan's gimbals, 1/s.
    law : TrackingLaw
        Gain of the attitude error.
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
        """Return the plan's states at `t`, those of its end after it, shape (11,)."""
        return self.phase.states(np.clip(t, self.phase.start, self.phase.end))

    def errors(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """Return q_e (eq. 25) and w_e."""
        desired = self.wanted(t)
        return attitude_error(x[:4], desired[:4]), x[4:7] - desired[4:7]

    def command(self, t: float, long: float, x: Floats) -> tuple[Floats, Floats, bool]:
        """Return the torque of eq. 32, the gimbal rates that give it, and whether a limit cuts it.

        Parameters
        ----------
        t, long : float
            Time and length of the sample, s.
        x : ndarray, shape (11,)
            Measured state.

        Returns
        -------
        tuple of (ndarray, shape (3,)), (ndarray, shape (4,)), bool
        """
        model, motion = self.model, SlewMotion.of(self.model)
        now, then = self.wanted(t), self.wanted(t + long)
        error, rate_error = self.errors(t, x)
        w, delta = x[4:7], x[7:]
        # Over a sample the plan's mean acceleration and gimbal rate count, which lead where it goes.
        push = (then[4:7] - now[4:7]) / long
        torque = tracking_torque(
            self.law.stiffness(self.frequency, model.inertia, float(error[0])),
            2.0 * self.damping * self.frequency * model.inertia,
            error[1:],
            rate_error,
            self.known * self.outer(t + 0.5 * long),
            np.cross(w, motion.body_momentum(w, delta)),
            model.inertia @ push,
        )
        excess = np.maximum(model.magnitudes(torque) / model.torque_limit, 1.0)
        wanted = -(torque / excess) / model.momentum
        held = (then[7:] - now[7:]) / long
        # Homing that takes longer strides than the way back would swing.
        wished = held + min(self.homing, 1.0 / long) * (now[7:] - delta)
        for _ in range(PASSES):
            jacobian = gimbal_jacobian(delta + 0.5 * long * held, model.beta)
            held = self.steer(jacobian, wanted, wished)
        given = -model.momentum * (jacobian @ held)
        return torque, held, float(np.abs(given - torque).max()) > LOST

    def steer(self, jacobian: Floats, wanted: Floats, wished: Floats) -> Floats:
        """Return gimbal rates that give A_t δ̇ = `wanted`, as near to `wished` as the limits allow.

        Where a gimbal would be too fast the least squares of what is missing are sought within the
        limits, the torque first: four gimbals for three torques leave one to spare.
        """
        square = jacobian @ jacobian.T + DAMPING * np.eye(3)
        rates = wished + jacobian.T @ np.linalg.solve(square, wanted - jacobian @ wished)
        most = self.model.gimbal_rate_limit
        if np.abs(rates).max() > most:
            light = np.sqrt(DAMPING)
            table = np.vstack([jacobian, light * np.eye(4)])
            aim = np.concatenate([wanted, light * rates])
            rates = lsq_linear(table, aim, (-most, most), method="bvls").x
        return rates
