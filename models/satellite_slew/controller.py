"""The controller that flies a slew: measured states in, gimbal rates out.

Source: eq. 24-33 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ..optimal_control.plan import PhasePlan
from .dynamics import SlewMotion
from .gyros import gimbal_jacobian
from .model import SatelliteSlew
from .quaternions import attitude_error

__all__ = ["Controller"]

Floats = NDArray[np.float64]

#: Damping of the correction's inverse near a singularity, in units of A_t A_tᵀ.
DAMPING = 1e-6
#: Torque that must be missing for a sample to count as saturated, N m.
LOST = 1e-2
#: How often the Jacobian is taken anew, in the middle of the motion that it leads to.
PASSES = 2


@dataclass(frozen=True, eq=False)
class Controller:
    """The paper's controller on one phase of a plan; parameters as in ``track``.

    Parameters
    ----------
    model : SatelliteSlew
        What the controller believes.
    phase : PhasePlan
        What to follow.
    frequency, damping : float
        ω_n (rad/s) and ζ.
    outer : callable
        T_ext, N m, as a function of time.
    known : float
        The share of it that is taken off.
    homing : float
        Rate of the null motion back to the plan's gimbals, 1/s.
    """

    model: SatelliteSlew
    phase: PhasePlan
    frequency: float
    damping: float
    outer: Callable[[float], Floats]
    known: float
    homing: float

    def wanted(self, t: float) -> Floats:
        """Return the plan's states at `t`, those of its end after it, shape (11,)."""
        return self.phase.states(np.clip(t, self.phase.start, self.phase.end))

    def errors(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """Return q_e (eq. 25) and w_e."""
        desired = self.wanted(t)
        return attitude_error(x[:4], desired[:4]), x[4:7] - desired[4:7]

    def command(self, t: float, long: float, x: Floats) -> tuple[Floats, Floats, bool]:
        """Return the torque asked for, the gimbal rates for the next `long` s, and if limits cut."""
        model, motion = self.model, SlewMotion.of(self.model)
        now, then = self.wanted(t), self.wanted(t + long)
        error, rate_error = self.errors(t, x)
        w, delta = x[4:7], x[7:]
        # Over a sample the plan's mean acceleration and gimbal rate count, which lead where it goes.
        push = (then[4:7] - now[4:7]) / long
        correction = 2.0 * self.frequency * (self.frequency * error[1:] + self.damping * rate_error)
        torque = model.inertia @ (push - correction)
        torque = torque - self.known * self.outer(t + 0.5 * long)
        torque = torque + np.cross(w, motion.body_momentum(w, delta))
        wanted = -np.clip(torque, -model.torque_limit, model.torque_limit) / model.momentum
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
