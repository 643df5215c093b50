"""Simulated tracking of a planned slew with sampling, disturbances and limited actuators.

Source: eq. 24-33 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Real, frozen, required
from ..optimal_control.plan import ControlPlan
from ..optimal_control.simulation import checked_function
from ..records import Member
from ..verification import check_tolerance
from .checks import slew_phase
from .controller import Controller, TrackingLaw
from .data import Inertia, check_inertia
from .dynamics import SlewMotion
from .flight import Tracking, verify_flight
from .gyros import momentum_direction, singularity_measure
from .model import SatelliteSlew

__all__ = ["Tracking", "track"]

Floats = NDArray[np.float64]

#: Largest number of steps of a flight.
MOST_SAMPLES = 1_000_000
#: Longest step of the simulated motion, s.
STEP = 0.02


def track(
    model: SatelliteSlew,
    plan: ControlPlan | Any,
    *,
    natural_frequency: float = 2.0,
    damping: float = 1.0,
    sample_time: float = 0.02,
    disturbance: ArrayLike | Callable[[float], ArrayLike] = (0.1, 0.1, 0.1),
    known_disturbance: float | None = None,
    inertia_error: ArrayLike = 0.0,
    homing: float = 10.0,
    after: float = 0.0,
    tolerance: float = 0.01,
    final_angle: float = 1e-3,
    final_rate: float = 1e-3,
    law: TrackingLaw | str = TrackingLaw.INERTIA,
) -> Tracking:
    """Simulate a sampled controller along a plan and return errors, limits and the first violation.

    At each sample, from measured q, w and δ, the controller computes the torque of eq. 32,

        T_c = -K_p q_e - K_d w_e - T_ext + w×(I w + h) + I ẇ_d.

    The paper does not print the gimbal rates that produce T_c. Here they are those of the plan plus
    the smallest correction, δ̇ = δ̇_d - A_tᵀ (A_t A_tᵀ)⁻¹ (T_c + h0 A_t δ̇_d) / h0, with A_t in the
    middle of the sample, plus null motion back to the gimbal angles of the plan. Torque and gimbal
    rates are clipped at the limits of the actuators, including the margin, and held until the next
    sample. If one gimbal is at its limit, the others compensate. The flight is then checked against
    all limits of the model, also between the samples.

    Parameters
    ----------
    model : SatelliteSlew
        Satellite.
    plan : ControlPlan or Solution
        Plan to follow.
    natural_frequency, damping : float
        ω_n (rad/s) and ζ of the error's motion, I θ̈ + K_d θ̇ + K_p θ / 2 = 0 for the small angle
        θ = 2 q_e. K_d = 2 ζ ω_n I, and `law` sets K_p.
    sample_time : float
        Sampling interval, s; the last sample may be shorter.
    disturbance : array_like, shape (3,), or callable
        T_ext in body axes, N m, or a function of time that returns it.
    known_disturbance : float, optional
        Share of T_ext that the controller compensates. By default 1 with the paper's law, whose
        eq. 32 contains T_ext, and 0 otherwise.
    inertia_error : float or array_like, shape (3,) or (3, 3)
        Difference between the true inertia and the model's: a share of the latter, or a symmetric
        matrix or its diagonal, kg m².
    homing : float
        Rate of the null motion, which produces no torque, back to the plan's gimbal angles, 1/s; at
        most 1 per sample.
    after : float
        Duration for which the end of the plan is held, s; 0 for a slew with a `final_rate`.
    tolerance : float
        Accepted excess of a flight over a limit of the model, as a share of the limit. Plans follow
        limits, so the smallest error exceeds them.
    final_angle, final_rate : float
        Largest angle from the final attitude (rad) and largest error of a body rate (rad/s) at the end.
    law : {"inertia", "paper"}
        "paper" is the printed K_p = k1 q_e0, a scalar, with k1 = 2 ω_n² tr(I) / 3. "inertia" is
        ours, K_p = 2 ω_n² I.

    Returns
    -------
    Tracking
    The flight, with ``verification``, ``ok`` and ``breach``.

    Raises
    ------
    InvalidData
        The plan belongs to another problem, a parameter is out of range, or the motion overflows.

    Notes
    -----
    The gyros have to store the impulse of an outer torque, whether the controller compensates it or
    not, and that of an inertia error. Their gimbals then leave the plan's, possibly towards a
    singularity. Null motion conserves the momentum, so it does not always avoid one. A reserve of
    torque or gimbal rate does not help there, but a plan with a larger ``singularity_limit`` does.

    A constant torque that is not compensated leaves the error q_e = K_p⁻¹ T_ext.
    """
    required("model", model, SatelliteSlew)
    phase = slew_phase(model.as_plan(plan), model.gyro_count)
    for name, value in (
        ("natural_frequency", natural_frequency), ("sample_time", sample_time),
        ("final_angle", final_angle), ("final_rate", final_rate),
    ):  # fmt: skip
        Real(0.0, strict=True).coerce(name, value, {})
    for name, value in (("damping", damping), ("homing", homing), ("after", after)):
        Real(0.0).coerce(name, value, {})
    if after > 0.0 and model.end_rate.any():
        raise InvalidData(
            f"after must be 0, because the slew ends with final_rate, got {after:g}", field="after"
        )
    law = Member(TrackingLaw).coerce("law", law, {})
    assert isinstance(law, TrackingLaw)
    if known_disturbance is None:
        known_disturbance = float(law == TrackingLaw.PAPER)
    Real(0.0, 1.0).coerce("known_disturbance", known_disturbance, {})
    check_tolerance(tolerance)
    truth = SlewMotion(_true_inertia(model, inertia_error), model.momentum, model.gyros)
    samples = (phase.duration + after) / min(sample_time, STEP)
    if not samples <= MOST_SAMPLES:
        raise InvalidData(
            f"sample_time must leave at most {MOST_SAMPLES} steps of the motion, got {samples:.3g}",
            field="sample_time",
        )
    controller = Controller(
        model, phase, natural_frequency, damping, checked_function("disturbance", disturbance, 3), known_disturbance, homing,
        law,
    )  # fmt: skip
    return _fly(controller, truth, sample_time, after, tolerance, (final_angle, final_rate))


def _true_inertia(model: SatelliteSlew, error: Any) -> Floats:
    """Return the true inertia from the model's and its error, a share or a matrix."""
    is_array = np.ndim(error) > 0
    share = 0.0 if is_array else Real().coerce("inertia_error", error, {})
    if not share > -1.0:
        raise InvalidData(f"inertia_error must be > -1, got {error}", field="inertia_error")
    extra = (
        Inertia((3, 3)).coerce("inertia_error", error, {}) if is_array else share * model.inertia
    )
    result: Floats = model.inertia + extra
    try:
        check_inertia(result)
    except InvalidData as fault:
        raise InvalidData(
            f"inertia_error makes an inertia that no body has: {fault}", field="inertia_error"
        ) from None
    return result


def _move(
    truth: SlewMotion, outer: Callable[[float], Floats], times: Floats, x: Floats, u: Floats
) -> Floats:
    """Return the states at `times`, from `x` at the first, by classical Runge-Kutta steps."""
    states = [x]
    for t, until in pairwise(times.tolist()):
        h, middle = until - t, outer(0.5 * (t + until))
        a = np.array(truth.rate(x, u, outer(t)))
        b = np.array(truth.rate(x + 0.5 * h * a, u, middle))
        c = np.array(truth.rate(x + 0.5 * h * b, u, middle))
        d = np.array(truth.rate(x + h * c, u, outer(until)))
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        states.append(x)
    if not np.isfinite(x).all():
        raise InvalidData(
            f"the motion is beyond all numbers at t = {until:g} s: the disturbance is too great",
            field="disturbance",
        )
    return np.array(states)


def _fly(
    controller: Controller, truth: SlewMotion, sample_time: float, after: float,
    tolerance: float, ends: tuple[float, float],
) -> Tracking:  # fmt: skip
    """Simulate the flight: the controller's rates are held, and the true motion is integrated."""
    phase, model = controller.phase, controller.model
    end = phase.end + after
    count = max(1, int(np.ceil((end - phase.start) / sample_time - 1e-9)))
    times = np.append(phase.start + sample_time * np.arange(count), end)
    steps = max(1, int(np.ceil(np.diff(times).max() / STEP - 1e-9)))
    x = np.concatenate([model.initial_attitude, model.begin_rate, model.initial_gimbals])
    motions, fine = [x[None]], [times[:1]]
    commanded, rate_steps, saturated = [], [], []
    for begin, until in pairwise(times.tolist()):
        torque, rates, cut = controller.command(begin, until - begin, x)
        instants = np.linspace(begin, until, steps + 1)
        path = _move(truth, controller.outer, instants, x, rates)
        x = path[-1]
        motions.append(path[1:])
        fine.append(instants[1:])
        commanded.append(torque)
        rate_steps.append(rates)
        saturated.append(cut)
    dense, controls = np.concatenate(motions), np.array(rate_steps)
    table = dense[::steps]
    direction = momentum_direction(table[:, 7:], model.gyros)
    errors = [controller.errors(float(t), y) for t, y in zip(times, table, strict=True)]
    verification, breach = verify_flight(
        model, np.concatenate(fine), dense, np.repeat(controls, steps, axis=0), tolerance, ends
    )
    return Tracking(
        times=frozen(times),
        attitudes=frozen(table[:, :4]),
        rates=frozen(table[:, 4:7]),
        gimbals=frozen(table[:, 7:]),
        quaternion_errors=frozen(np.array([pair[0] for pair in errors])),
        rate_errors=frozen(np.array([pair[1] for pair in errors])),
        commanded=frozen(np.array(commanded)),
        applied=frozen(-model.momentum * np.diff(direction, axis=0) / np.diff(times)[:, None]),
        gimbal_rates=frozen(controls),
        saturated=frozen(np.array(saturated)),
        measures=frozen(singularity_measure(table[:, 7:], model.gyros)),
        verification=verification,
        breach=breach,
    )
