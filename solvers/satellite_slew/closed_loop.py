"""Closed-loop simulation of an eigenaxis slew with a steering law, and the resulting plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.fields import frozen
from ...models.optimal_control.lagrange import interpolation
from ...models.optimal_control.plan import ControlPlan, PhasePlan, Piecewise
from ...models.satellite_slew.dynamics import SlewMotion, names_of
from ...models.satellite_slew.gyros import gimbal_jacobian, momentum_direction, singularity_measure
from ...models.satellite_slew.model import SatelliteSlew
from ...models.satellite_slew.profile import EigenaxisProfile
from ...models.satellite_slew.quaternions import attitude_error
from .steering import SteeringLaw, null_projection

__all__ = ["ClosedLoop", "Flight"]

Floats = NDArray[np.float64]

#: Natural frequency (rad/s) and damping ratio of the attitude feedback.
FREQUENCY, DAMPING = 2.0, 1.0
#: Rate of the null motion back to the final gimbal angles, 1/s, and its largest share of their limit.
HOMING, HOMING_SHARE = 2.0, 0.3
#: Positions in a step at which states are stored, and those of a parabola or a line of rates.
STATES_AT = frozen(np.linspace(-1.0, 1.0, 5))
PARABOLA, EDGES = frozen(np.array([-1.0, 0.0, 1.0])), frozen(np.array([-1.0, 1.0]))
#: Interpolation from these nodes to the ends and middles of the parts between `STATES_AT`.
_ONTO = {
    nodes.size: interpolation(nodes, np.linspace(-1.0, 1.0, 2 * STATES_AT.size - 1))
    for nodes in (PARABOLA, EDGES)
}


@dataclass(frozen=True, eq=False)
class Flight:
    """Simulated slew: nodes of each step, gimbal rates there, and states at `STATES_AT`.

    `measure` is the smallest det(A_t A_tᵀ). The largest body rate, commanded gimbal rate and commanded
    torque are relative to their limits. `settled` states whether the satellite came to rest at the
    final attitude.
    """

    knots: tuple[float, ...]
    steps: tuple[tuple[Floats, Floats, Floats], ...]
    measure: float
    rate: float
    gimbal_rate: float
    torque: float
    settled: bool

    @property
    def load(self) -> float:
        """Largest commanded gimbal rate or torque, relative to its limit."""
        return max(self.gimbal_rate, self.torque)

    def plan(self, most: float) -> ControlPlan:
        """Return the flight as a plan whose gimbal rates saturate at `most`, rad/s."""
        mesh, limit = np.array(self.knots), np.full(self.steps[0][1].shape[1], most)
        nodes, rates, states = zip(*self.steps, strict=True)
        states_of = Piecewise(mesh, (STATES_AT,) * len(states), states)
        controls = Piecewise(mesh, nodes, rates, -limit, limit)
        return ControlPlan((PhasePlan("slew", states_of, controls, *names_of(limit.size)),))


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Satellite with a rotation to follow and a steering law for the gyros.

    The torque is that of eq. 32 with K_p = 2 ω_n² I and without disturbance, T_c = -K_p q_e - K_d w_e
    + w×(I w + h) + I ẇ_d. The law computes gimbal rates for it. From the start of the braking, null
    motion moves the gimbals to their final angles. `tolerance` is the largest error of a state at the end.
    """

    model: SatelliteSlew
    law: SteeringLaw
    profile: EigenaxisProfile
    tolerance: float

    def command(
        self, t: float, course: tuple[Floats, Floats, Floats], x: Floats
    ) -> tuple[Floats, Floats]:
        """Return the torque, shape (3,), and the gimbal rates, shape (gyros,), before saturation.

        `course` contains the attitude, the body rates and their derivatives of the rotation at `t`.
        """
        model, inertia = self.model, self.model.inertia
        attitude, rates, push = course
        w, delta = x[4:7], x[7:]
        total = inertia @ w + model.momentum * momentum_direction(delta, model.gyros)
        error = attitude_error(x[:4], attitude)[1:]
        acceleration = push - 2.0 * FREQUENCY**2 * error - 2.0 * DAMPING * FREQUENCY * (w - rates)
        gyration = (
            w[1] * total[2] - w[2] * total[1],
            w[2] * total[0] - w[0] * total[2],
            w[0] * total[1] - w[1] * total[0],
        )
        torque = inertia @ acceleration + gyration
        jacobian = gimbal_jacobian(delta, model.gyros)
        gimbal_rates = self.law.rates(t, jacobian, -torque / model.momentum)
        home = model.final_gimbals
        if home is not None and t >= self.profile.duration - self.profile.ramp:
            pull = null_projection(jacobian, HOMING * (home - delta))
            limit = HOMING_SHARE * model.planned_gimbal_rate
            gimbal_rates = gimbal_rates + pull / np.sqrt(1.0 + float(pull @ pull) / limit**2)
        return torque, gimbal_rates

    def distance(self, x: Floats) -> float:
        """Return the largest difference of an entry of the state from its final value."""
        model = self.model
        parts = [attitude_error(x[:4], model.final_attitude)[1:], x[4:7]]
        if model.final_gimbals is not None:
            parts.append(x[7:] - model.final_gimbals)
        return float(np.abs(np.concatenate(parts)).max())

    # -- flying ----------------------------------------------------------------------------------

    def fly(
        self,
        latest: float,
        step: float,
        *,
        least_measure: float = 0.0,
        ending: Callable[[], bool] = lambda: False,
    ) -> Flight:
        """Simulate the rotation until the satellite is at rest at the end, or until the time `latest`.

        The law is sampled at intervals of `step`. The flight is aborted if the singularity measure falls
        below `least_measure`, and before a step if `ending` returns True.

        In each step the gimbal rates are a parabola through the rates of the law at the start, in the
        middle and at the end, from a classical Runge-Kutta step of the closed loop. The states are
        those that the parabola produces, and the next step starts from their end. The steps have a
        fixed length, because the law is far from smooth near a singularity.
        """
        model, motion = self.model, SlewMotion.of(self.model)
        x = np.concatenate([model.initial_attitude, np.zeros(3), model.initial_gimbals])
        earliest = float(model.time_range[0])
        stops = sorted(t for t in (*self.profile.breaks[1:].tolist(), earliest) if 0.0 < t < latest)
        knots, loads = [0.0], [(0.0, 0.0)]
        steps: list[tuple[Floats, Floats, Floats]] = []
        time, settled, measure, largest_rate = 0.0, False, np.inf, 0.0
        while not settled and time < latest - 1e-9 and not ending():
            following = next((t for t in stops if t > time + 1e-9), latest)
            left = following - time
            long = left / np.ceil(left / step - 1e-9) if following in stops else min(step, left)
            nodes, rates, load = self._sample(motion, time, long, x)
            states = _follow(motion, x, nodes, rates, long)
            x = states[-1]
            if not np.isfinite(x).all():
                break
            time = following if abs(following - time - long) < 1e-9 else time + long
            knots.append(time)
            loads.append(load)
            steps.append((nodes, rates, states))
            measure = min(measure, float(singularity_measure(states[:, 7:], model.gyros).min()))
            largest_rate = max(largest_rate, float(model.magnitudes(states[:, 4:7]).max()))
            if measure < least_measure:
                break
            turned = time >= max(self.profile.duration, earliest) - 1e-9
            settled = turned and self.distance(x) <= self.tolerance
        gimbal_rate, torque = (max(column) for column in zip(*loads, strict=True))
        return Flight(
            tuple(knots),
            tuple(steps),
            measure,
            largest_rate / model.rate_limit,
            gimbal_rate / model.planned_gimbal_rate,
            torque / model.planned_torque,
            settled,
        )

    def _sample(
        self, motion: SlewMotion, now: float, long: float, x: Floats
    ) -> tuple[Floats, Floats, tuple[float, float]]:
        """Return nodes, gimbal rates there, and the largest commanded rate and torque of a step."""
        limit = self.model.planned_gimbal_rate
        # The ends are moved inside, so that jumps of the profile belong to the right step.
        times = (now + 1e-9 * long, now + 0.5 * long, now + (1.0 - 1e-9) * long)
        courses = list(zip(*self.profile.course(times), strict=True))

        def slope(k: int, y: Floats) -> tuple[tuple[Floats, Floats], Floats]:
            pair = self.command(times[k], courses[k], y)
            rates = np.minimum(np.maximum(pair[1], -limit), limit)
            return pair, np.array(motion.rate(y, rates))

        first, a = slope(0, x)
        _, b = slope(1, x + 0.5 * long * a)
        _, c = slope(1, x + 0.5 * long * b)
        _, d = slope(2, x + long * c)
        end = x + long / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        last, d = slope(2, end)
        # The midpoint stages are only of second order, and the feedback would act upon their error.
        middle = self.command(times[1], courses[1], 0.5 * (x + end) + 0.125 * long * (a - d))
        commanded = np.array([pair[1] for pair in (first, middle, last)])
        largest = float(np.abs(commanded).max())
        torque = max(float(self.model.magnitudes(pair[0]).max()) for pair in (first, middle, last))
        if largest > limit:
            # A straight line between rates within their limit stays within it.
            return EDGES, np.clip(commanded[[0, 2]], -limit, limit), (largest, torque)
        return PARABOLA, commanded, (largest, torque)


def _follow(motion: SlewMotion, x: Floats, nodes: Floats, rates: Floats, long: float) -> Floats:
    """Return the states at `STATES_AT` of a step with the given gimbal rates, shape (5, 7 + gyros)."""
    table = _ONTO[nodes.size] @ rates
    h = long / (STATES_AT.size - 1)
    result = [x]
    for k in range(STATES_AT.size - 1):
        before, middle, after = table[2 * k : 2 * k + 3]
        a = np.array(motion.rate(x, before))
        b = np.array(motion.rate(x + 0.5 * h * a, middle))
        c = np.array(motion.rate(x + 0.5 * h * b, middle))
        d = np.array(motion.rate(x + h * c, after))
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        result.append(x)
    return np.array(result)
