"""The controller that tracks a planned slew, simulated: sampled, disturbed, with limited actuators.

Source: eq. 24-33 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Array, Real, frozen, required, show
from ..optimal_control.plan import ControlPlan, PhasePlan
from .checks import slew_phase
from .dynamics import SlewMotion
from .gyros import gimbal_jacobian, momentum_direction, singularity_measure
from .model import SatelliteSlew
from .quaternions import attitude_error

__all__ = ["Tracking", "track"]

Floats = NDArray[np.float64]

#: Damping of the correction's inverse near a singularity, in units of A_t A_tᵀ.
DAMPING = 1e-6
#: Samples that a flight may have.
MOST_SAMPLES = 1_000_000
#: Longest step of the simulated motion, s.
STEP = 0.02
#: Torque that must be missing for a sample to count as saturated, N m.
LOST = 1e-2


@dataclass(frozen=True, eq=False)
class Tracking:
    """A simulated flight along a plan, sampled at n instants.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Instants of the controller, s; the last is the end.
    attitudes : ndarray, shape (n, 4)
        Quaternions flown.
    rates : ndarray, shape (n, 3)
        Body rates flown, rad/s.
    gimbals : ndarray, shape (n, 4)
        Gimbal angles, rad.
    quaternion_errors : ndarray, shape (n, 4)
        q_e, eq. 25; its vector part is half the angle of a small error.
    rate_errors : ndarray, shape (n, 3)
        w_e = w - w_d, rad/s.
    commanded : ndarray, shape (n - 1, 3)
        Control torque T_c that the controller asks for in each sample, N m.
    applied : ndarray, shape (n - 1, 3)
        Control torque that the gyros give, the mean over the sample, N m.
    gimbal_rates : ndarray, shape (n - 1, 4)
        Held over each sample, rad/s.
    saturated : ndarray, shape (n - 1,)
        Whether the limits of torque and gimbal rates kept the gyros from giving what was asked.
    measures : ndarray, shape (n,)
        det(A_t A_tᵀ).
    """

    times: Floats
    attitudes: Floats
    rates: Floats
    gimbals: Floats
    quaternion_errors: Floats
    rate_errors: Floats
    commanded: Floats
    applied: Floats
    gimbal_rates: Floats
    saturated: NDArray[np.bool_]
    measures: Floats

    @property
    def max_quaternion_error(self) -> float:
        """The largest entry of the vector part of the error quaternion."""
        return float(np.abs(self.quaternion_errors[:, 1:]).max())

    @property
    def max_rate_error(self) -> float:
        """The largest error of a body rate, rad/s."""
        return float(np.abs(self.rate_errors).max())

    @property
    def saturated_share(self) -> float:
        """The share of samples in which a limit cut the command."""
        return float(self.saturated.mean())

    def __str__(self) -> str:
        return (
            f"{self.times[-1] - self.times[0]:.4g} s tracked: quaternion error "
            f"{self.max_quaternion_error:.2g}, rate error {self.max_rate_error:.2g} rad/s, "
            f"{100 * self.saturated_share:.2g} % of the samples saturated"
        )


def track(
    model: SatelliteSlew,
    plan: ControlPlan | Any,
    *,
    natural_frequency: float = 2.0,
    damping: float = 1.0,
    sample_time: float = 0.02,
    disturbance: ArrayLike | Callable[[float], ArrayLike] = (0.1, 0.1, 0.1),
    known_disturbance: float = 0.0,
    inertia_error: float = 0.0,
    homing: float = 5.0,
    after: float = 0.0,
) -> Tracking:
    """Fly a plan with the paper's controller, and return how far the satellite strays.

    Once a sample, from measured q, w and δ, the controller asks for the torque

        T_c = -K_p q_e - K_d w_e - T_ext + w×(I w + h) + I ẇ_d.

    The gyros' part is the plan's own gimbal rates and the least correction that makes up what is
    left of the torque, δ̇ = δ̇_d - A_tᵀ (A_t A_tᵀ)⁻¹ (T_c + h0 A_t δ̇_d) / h0, with null motion that
    takes the gimbals back to the plan's, for a disturbance makes them stray. Torque and gimbal rates
    are cut off at the actuators' limits, the model's margin at their disposal, and held until the
    next sample; the other gimbals make up for one that is at its limit.

    Parameters
    ----------
    model : SatelliteSlew
        The satellite.
    plan : ControlPlan or Solution
        What to follow.
    natural_frequency, damping : float
        ω_n (rad/s) and ζ of the error's motion, I θ̈ + K_d θ̇ + K_p θ / 2 = 0 for the small angle
        θ = 2 q_e: K_p = 2 ω_n² I and K_d = 2 ζ ω_n I.
    sample_time : float
        s; the last sample may be shorter.
    disturbance : array_like, shape (3,), or callable
        T_ext in body axes, N m, or a function of time that returns it.
    known_disturbance : float
        The share of T_ext that the controller knows and takes off; the paper's knows it all.
    inertia_error : float
        By how much the true inertia exceeds the model's, as a share of it.
    homing : float
        Rate at which null motion, which gives no torque, takes the gimbals back to the plan's, 1/s.
    after : float
        How long the end of the plan is held after it, s.

    Returns
    -------
    Tracking

    Raises
    ------
    InvalidData
        The plan is none of a slew; a parameter out of range.

    Notes
    -----
    A constant torque that is not known leaves an error: the motion rests where K_p q_e = T_ext, at
    q_e = T_ext / (2 ω_n² I).
    """
    required("model", model, SatelliteSlew)
    phase = slew_phase(model.as_plan(plan))
    for name, value in (("natural_frequency", natural_frequency), ("sample_time", sample_time)):
        Real(0.0, strict=True).coerce(name, value, {})
    for name, value in (("damping", damping), ("homing", homing), ("after", after)):
        Real(0.0).coerce(name, value, {})
    Real(0.0, 1.0).coerce("known_disturbance", known_disturbance, {})
    if not Real().coerce("inertia_error", inertia_error, {}) > -1.0:
        raise InvalidData(f"inertia_error must be > -1, got {inertia_error}", field="inertia_error")
    samples = (phase.duration + after) / sample_time
    if not samples <= MOST_SAMPLES:
        raise InvalidData(
            f"sample_time must leave at most {MOST_SAMPLES} samples, got {samples:.3g}",
            field="sample_time",
        )
    controller = _Controller(
        model, phase, natural_frequency, damping, _outer(disturbance), known_disturbance, homing
    )
    return _fly(controller, SlewMotion.of(model, inertia_error=inertia_error), sample_time, after)


def _outer(disturbance: Any) -> Callable[[float], Floats]:
    """Return the outer torque as a function of time, checked."""
    if not callable(disturbance):
        constant = Array((3,)).coerce("disturbance", disturbance, {})
        return lambda t: constant

    def outer(t: float) -> Floats:
        try:
            found = np.asarray(disturbance(t), float)
        except (TypeError, ValueError):
            found = np.empty(0)
        if found.shape != (3,) or not np.isfinite(found).all():
            raise InvalidData(
                f"disturbance must return 3 finite numbers, got {show(found.tolist())} at t = {t:g}",
                field="disturbance",
            )
        return found

    return outer


@dataclass(frozen=True, eq=False)
class _Controller:
    """The paper's controller: measured states in, gimbal rates out."""

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
        feedforward = (then[7:] - now[7:]) / long
        correction = 2.0 * self.frequency * (self.frequency * error[1:] + self.damping * rate_error)
        torque = model.inertia @ (push - correction) - self.known * self.outer(t)
        torque = torque + np.cross(w, motion.body_momentum(w, delta))
        cut = np.clip(torque, -model.torque_limit, model.torque_limit)
        jacobian = gimbal_jacobian(delta + 0.5 * long * feedforward, model.beta)
        # Null motion towards the plan's gimbals, which stay clear of singularities.
        back = self.homing * (now[7:] - delta)
        inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + DAMPING * np.eye(3))
        feedforward = feedforward + back - inverse @ (jacobian @ back)
        missing = -cut / model.momentum - jacobian @ feedforward
        held = _allot(jacobian, missing, feedforward, model.gimbal_rate_limit)
        given = -model.momentum * (jacobian @ held)
        return torque, held, float(np.abs(given - torque).max()) > LOST


def _allot(jacobian: Floats, missing: Floats, rates: Floats, most: float) -> Floats:
    """Return gimbal rates within `most` that give what is `missing` beyond the torque of `rates`.

    The least correction; a gimbal that it would drive beyond its limit stays there, and the others
    make up for it as far as they can: four gimbals for three torques leave one to spare.
    """
    held = np.clip(rates, -most, most)
    missing = missing + jacobian @ (rates - held)
    free = np.ones(4, bool)
    for _ in range(4):
        columns = jacobian[:, free]
        square = columns @ columns.T + DAMPING * np.eye(3)
        wanted = held[free] + columns.T @ np.linalg.solve(square, missing)
        cut = np.clip(wanted, -most, most)
        missing = missing - columns @ (cut - held[free])
        held[free] = cut
        beyond = cut != wanted
        if not beyond.any():
            break
        free[np.flatnonzero(free)[beyond]] = False
        if not free.any():
            break
    return held


def _move(
    truth: SlewMotion,
    outer: Callable[[float], Floats],
    t: float,
    until: float,
    x: Floats,
    u: Floats,
) -> Floats:
    """Return the state at time `until`, by Runge and Kutta's classical steps."""
    count = max(1, int(np.ceil((until - t) / STEP - 1e-9)))
    h = (until - t) / count
    for _ in range(count):
        a = np.array(truth.rate(x, u, outer(t)))
        b = np.array(truth.rate(x + 0.5 * h * a, u, outer(t + 0.5 * h)))
        c = np.array(truth.rate(x + 0.5 * h * b, u, outer(t + 0.5 * h)))
        d = np.array(truth.rate(x + h * c, u, outer(t + h)))
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        t += h
    return x


def _fly(controller: _Controller, truth: SlewMotion, sample_time: float, after: float) -> Tracking:
    """Simulate: the controller's rates are held, the motion of the true satellite integrated."""
    phase, model = controller.phase, controller.model
    end = phase.end + after
    count = max(1, int(np.ceil((end - phase.start) / sample_time - 1e-9)))
    times = np.append(phase.start + sample_time * np.arange(count), end)
    x = np.concatenate([model.initial_attitude, np.zeros(3), model.initial_gimbals])
    states = [x]
    commanded, applied, held, saturated = [], [], [], []
    for begin, until in pairwise(times.tolist()):
        torque, rates, cut = controller.command(begin, until - begin, x)
        before, x = x, _move(truth, controller.outer, begin, until, x, rates)
        turned = momentum_direction(np.stack([before[7:], x[7:]]), model.beta)
        states.append(x)
        commanded.append(torque)
        applied.append(-model.momentum * (turned[1] - turned[0]) / (until - begin))
        held.append(rates)
        saturated.append(cut)
    table = np.array(states)
    errors = [controller.errors(float(t), y) for t, y in zip(times, table, strict=True)]
    return Tracking(
        times=frozen(times),
        attitudes=frozen(table[:, :4]),
        rates=frozen(table[:, 4:7]),
        gimbals=frozen(table[:, 7:]),
        quaternion_errors=frozen(np.array([pair[0] for pair in errors])),
        rate_errors=frozen(np.array([pair[1] for pair in errors])),
        commanded=frozen(np.array(commanded)),
        applied=frozen(np.array(applied)),
        gimbal_rates=frozen(np.array(held)),
        saturated=frozen(np.array(saturated)),
        measures=frozen(singularity_measure(table[:, 7:], model.beta)),
    )
