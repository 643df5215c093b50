"""An eigenaxis slew flown by a steering law: attitude feedback, gimbals, and the plan that results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.fields import frozen
from ...models.optimal_control.lagrange import interpolation
from ...models.optimal_control.plan import ControlPlan, PhasePlan, Piecewise
from ...models.satellite_slew.dynamics import CONTROLS, STATES, SlewMotion
from ...models.satellite_slew.gyros import gimbal_jacobian, momentum_direction, singularity_measure
from ...models.satellite_slew.model import SatelliteSlew
from ...models.satellite_slew.profile import EigenaxisProfile
from ...models.satellite_slew.quaternions import attitude_error
from .steering import SteeringLaw, null_projection

__all__ = ["ClosedLoop", "Flight"]

Floats = NDArray[np.float64]

#: Natural frequency (rad/s) and damping ratio of the attitude feedback.
FREQUENCY, DAMPING = 2.0, 1.0
#: Rate at which null motion brings the gimbals home, 1/s, and the most it may use of their limit.
HOMING, HOMING_SHARE = 2.0, 0.3
#: Places in a step at which states are kept, and those that a parabola or a line of rates needs.
STATES_AT = frozen(np.linspace(-1.0, 1.0, 5))
PARABOLA, EDGES = frozen(np.array([-1.0, 0.0, 1.0])), frozen(np.array([-1.0, 1.0]))


@dataclass(frozen=True, eq=False)
class Flight:
    """A flown slew.

    Parameters
    ----------
    knots : tuple of float
        Where the steps begin and end, s.
    steps : tuple of (ndarray, ndarray, ndarray)
        Nodes and gimbal rates there, and the states at `STATES_AT`, of each step.
    measure : float
        The least det(A_t A_tᵀ).
    rate, gimbal_rate, torque : float
        The largest body rate, gimbal rate asked for and torque asked for, by their limits.
    settled : bool
        Whether it ended at rest where it was sent.
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
        """The largest of gimbal rate and torque asked for, by their limits."""
        return max(self.gimbal_rate, self.torque)

    def plan(self, most: float) -> ControlPlan:
        """Return the flight as a plan whose gimbal rates saturate at `most`, rad/s."""
        mesh, limit = np.array(self.knots), np.full(4, most)
        nodes, rates, states = zip(*self.steps, strict=True)
        flown = Piecewise(mesh, (STATES_AT,) * len(states), states)
        steered = Piecewise(mesh, nodes, rates, -limit, limit)
        return ControlPlan((PhasePlan("slew", flown, steered, STATES, CONTROLS),))


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A satellite, a turn to follow and a law that steers the gyros.

    The torque is that of eq. 32 with K_p = 2 ω_n² I and without disturbance, T_c = -K_p q_e - K_d w_e
    + w×(I w + h) + I ẇ_d. The law turns it into gimbal rates, and null motion brings the gimbals
    home from the start of the braking on.

    Parameters
    ----------
    model : SatelliteSlew
        The slew.
    law : SteeringLaw
        How gimbal rates follow from a torque.
    profile : EigenaxisProfile
        The turn.
    tolerance : float
        How near the end must be in every state.
    """

    model: SatelliteSlew
    law: SteeringLaw
    profile: EigenaxisProfile
    tolerance: float

    def asked(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """Return the torque, shape (3,), and the gimbal rates, shape (4,), before any limit."""
        model, inertia = self.model, self.model.inertia
        attitude, rates, push = self.profile.course(t)
        w, delta = x[4:7], x[7:]
        total = inertia @ w + model.momentum * momentum_direction(delta, model.beta)
        error = attitude_error(x[:4], attitude)[1:]
        wanted = push - 2.0 * FREQUENCY**2 * error - 2.0 * DAMPING * FREQUENCY * (w - rates)
        gyration = (
            w[1] * total[2] - w[2] * total[1],
            w[2] * total[0] - w[0] * total[2],
            w[0] * total[1] - w[1] * total[0],
        )
        torque = inertia @ wanted + gyration
        jacobian = gimbal_jacobian(delta, model.beta)
        found = self.law.rates(t, jacobian, -torque / model.momentum)
        home = model.final_gimbals
        if home is not None and t >= self.profile.duration - self.profile.ramp:
            pull = null_projection(jacobian, HOMING * (home - delta))
            most = HOMING_SHARE * model.planned_gimbal_rate
            found = found + pull / np.sqrt(1.0 + float(pull @ pull) / most**2)
        return torque, found

    def distance(self, x: Floats) -> float:
        """Return how far the state is from the end, at most over all entries."""
        model = self.model
        parts = [attitude_error(x[:4], model.final_attitude)[1:], x[4:7]]
        if model.final_gimbals is not None:
            parts.append(x[7:] - model.final_gimbals)
        return float(np.abs(np.concatenate(parts)).max())

    # -- flying ----------------------------------------------------------------------------------

    def fly(self, latest: float, step: float, *, least_measure: float = 0.0) -> Flight:
        """Fly the turn until the satellite has settled.

        Parameters
        ----------
        latest : float
            When to give up, s.
        step : float
            Time between two samples of the law, s.
        least_measure : float
            The measure of singularity below which the flight is broken off.

        Notes
        -----
        In each step the gimbal rates are a parabola through what the law wants at the start, in the
        middle and at the end, by a classical Runge-Kutta step of the closed loop; the states are
        those that the parabola gives by itself, and the next step starts where they really end.
        Steps are of a fixed length, for near a singularity the law is anything but smooth.
        """
        model, motion = self.model, SlewMotion.of(self.model)
        x = np.concatenate([model.initial_attitude, np.zeros(3), model.initial_gimbals])
        earliest = float(model.time_range[0])
        stops = sorted(t for t in (*self.profile.breaks[1:].tolist(), earliest) if 0.0 < t < latest)
        knots, loads = [0.0], [(0.0, 0.0)]
        steps: list[tuple[Floats, Floats, Floats]] = []
        now, settled, measure, fastest = 0.0, False, np.inf, 0.0
        while not settled and now < latest - 1e-9:
            following = next((t for t in stops if t > now + 1e-9), latest)
            left = following - now
            long = left / np.ceil(left / step - 1e-9) if following in stops else min(step, left)
            nodes, rates, load = self._sample(motion, now, long, x)
            states = _follow(motion, x, nodes, rates, long)
            x = states[-1]
            if not np.isfinite(x).all():
                break
            now = following if abs(following - now - long) < 1e-9 else now + long
            knots.append(now)
            loads.append(load)
            steps.append((nodes, rates, states))
            measure = min(measure, float(singularity_measure(states[:, 7:], model.beta).min()))
            fastest = max(fastest, float(model.magnitudes(states[:, 4:7]).max()))
            if measure < least_measure:
                break
            turned = now >= max(self.profile.duration, earliest) - 1e-9
            settled = turned and self.distance(x) <= self.tolerance
        gimbal_rate, torque = (max(column) for column in zip(*loads, strict=True))
        return Flight(
            tuple(knots),
            tuple(steps),
            measure,
            fastest / model.rate_limit,
            gimbal_rate / model.planned_gimbal_rate,
            torque / model.planned_torque,
            settled,
        )

    def _sample(
        self, motion: SlewMotion, now: float, long: float, x: Floats
    ) -> tuple[Floats, Floats, tuple[float, float]]:
        """Return nodes, gimbal rates there, and the largest rate and torque asked for, of a step."""
        most = self.model.planned_gimbal_rate
        # The ends are moved inside: at a jump of the profile, what holds is what holds in the step.
        times = (now + 1e-9 * long, now + 0.5 * long, now + (1.0 - 1e-9) * long)

        def slope(t: float, y: Floats) -> tuple[tuple[Floats, Floats], Floats]:
            pair = self.asked(t, y)
            return pair, np.array(motion.rate(y, np.clip(pair[1], -most, most)))

        first, a = slope(times[0], x)
        _, b = slope(times[1], x + 0.5 * long * a)
        _, c = slope(times[1], x + 0.5 * long * b)
        _, d = slope(times[2], x + long * c)
        end = x + long / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        last, d = slope(times[2], end)
        # The stages in the middle are of second order only, which the feedback would act upon.
        middle = self.asked(times[1], 0.5 * (x + end) + 0.125 * long * (a - d))
        wanted = np.array([pair[1] for pair in (first, middle, last)])
        largest = float(np.abs(wanted).max())
        torque = max(float(self.model.magnitudes(pair[0]).max()) for pair in (first, middle, last))
        if largest > most:
            # A straight line between rates within their limit does not leave it.
            return EDGES, np.clip(wanted[[0, 2]], -most, most), (largest, torque)
        return PARABOLA, wanted, (largest, torque)


def _follow(motion: SlewMotion, x: Floats, nodes: Floats, rates: Floats, long: float) -> Floats:
    """Return the states at `STATES_AT` of a step that the gimbal rates lead to, shape (5, 11)."""
    half_steps = np.linspace(-1.0, 1.0, 2 * STATES_AT.size - 1)
    table = interpolation(nodes, half_steps) @ rates
    h = long / (STATES_AT.size - 1)
    found = [x]
    for k in range(STATES_AT.size - 1):
        before, middle, after = table[2 * k : 2 * k + 3]
        a = np.array(motion.rate(x, before))
        b = np.array(motion.rate(x + 0.5 * h * a, middle))
        c = np.array(motion.rate(x + 0.5 * h * b, middle))
        d = np.array(motion.rate(x + h * c, after))
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        found.append(x)
    return np.array(found)
