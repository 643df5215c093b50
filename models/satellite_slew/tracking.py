"""Simulated tracking of a planned slew: sampled, disturbed, with limited actuators.

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
from ..fields import Array, Real, frozen, required, show
from ..optimal_control.plan import ControlPlan
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

#: Steps that a flight may have.
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
    """Fly a plan with a sampled controller and return errors, limits and the first breach.

    At each sample, from measured q, w and δ, the controller computes the torque of eq. 32,

        T_c = -K_p q_e - K_d w_e - T_ext + w×(I w + h) + I ẇ_d.

    The paper does not print the gimbal rates that give T_c. Here they are those of the plan plus the
    least correction, δ̇ = δ̇_d - A_tᵀ (A_t A_tᵀ)⁻¹ (T_c + h0 A_t δ̇_d) / h0, with A_t in the middle of
    the sample, plus null motion back to the gimbal angles of the plan. Torque and gimbal rates are
    cut at the limits of the actuators, margin included, and held until the next sample; if one
    gimbal is at its limit, the others compensate. The flight is then checked against all limits of
    the model, between the samples as well.

    Parameters
    ----------
    model : SatelliteSlew
        The satellite.
    plan : ControlPlan or Solution
        The plan to follow.
    natural_frequency, damping : float
        ω_n (rad/s) and ζ of the error's motion, I θ̈ + K_d θ̇ + K_p θ / 2 = 0 for the small angle
        θ = 2 q_e. K_d = 2 ζ ω_n I, and `law` sets K_p.
    sample_time : float
        s; the last sample may be shorter.
    disturbance : array_like, shape (3,), or callable
        T_ext in body axes, N m, or a function of time that returns it.
    known_disturbance : float, optional
        Share of T_ext that the controller compensates. By default 1 with the paper's law, whose
        eq. 32 contains T_ext, and 0 otherwise.
    inertia_error : float or array_like, shape (3,) or (3, 3)
        By how much the true inertia exceeds the model's: as a share of it, or as a symmetric matrix
        or its diagonal, kg m².
    homing : float
        Rate at which null motion, which gives no torque, takes the gimbals back to the plan's, 1/s;
        at most once a sample.
    after : float
        How long the end of the plan is held after it, s.
    tolerance : float
        Share by which a flight may pass a limit of the model; plans go along limits, so that the
        least error passes them.
    final_angle, final_rate : float
        Largest angle from the final attitude (rad), and largest body rate (rad/s), at the end.
    law : {"inertia", "paper"}
        "paper" is the printed K_p = k1 q_e0, a scalar, with k1 = 2 ω_n² tr(I) / 3; "inertia" is
        ours, K_p = 2 ω_n² I.

    Returns
    -------
    Tracking
        With ``verification``, ``ok`` and ``breach``.

    Raises
    ------
    InvalidData
        The plan belongs to another problem, a parameter is out of range, or the motion overflows.

    Notes
    -----
    The gyros have to store the impulse of an outer torque whether the controller knows of it or not,
    and what an error of inertia adds. Their gimbals then leave the plan's, and may be led into a
    singularity: null motion keeps the momentum, so it does not always lead around one. A share of
    torque or gimbal rate in reserve does not help there; a plan with a greater ``singularity_limit``
    does.

    A constant torque that is not compensated leaves the error q_e = K_p⁻¹ T_ext.
    """
    required("model", model, SatelliteSlew)
    phase = slew_phase(model.as_plan(plan))
    for name, value in (
        ("natural_frequency", natural_frequency), ("sample_time", sample_time),
        ("final_angle", final_angle), ("final_rate", final_rate),
    ):  # fmt: skip
        Real(0.0, strict=True).coerce(name, value, {})
    for name, value in (("damping", damping), ("homing", homing), ("after", after)):
        Real(0.0).coerce(name, value, {})
    law = Member(TrackingLaw).coerce("law", law, {})
    assert isinstance(law, TrackingLaw)
    if known_disturbance is None:
        known_disturbance = float(law == TrackingLaw.PAPER)
    Real(0.0, 1.0).coerce("known_disturbance", known_disturbance, {})
    check_tolerance(tolerance)
    truth = SlewMotion(_true_inertia(model, inertia_error), model.momentum, model.beta)
    samples = (phase.duration + after) / min(sample_time, STEP)
    if not samples <= MOST_SAMPLES:
        raise InvalidData(
            f"sample_time must leave at most {MOST_SAMPLES} steps of the motion, got {samples:.3g}",
            field="sample_time",
        )
    controller = Controller(
        model, phase, natural_frequency, damping, _outer(disturbance), known_disturbance, homing,
        law,
    )  # fmt: skip
    return _fly(controller, truth, sample_time, after, tolerance, (final_angle, final_rate))


def _true_inertia(model: SatelliteSlew, error: Any) -> Floats:
    """Return the inertia that a share, or a matrix, makes of the model's."""
    given = np.ndim(error) > 0
    share = 0.0 if given else Real().coerce("inertia_error", error, {})
    if not share > -1.0:
        raise InvalidData(f"inertia_error must be > -1, got {error}", field="inertia_error")
    extra = Inertia((3, 3)).coerce("inertia_error", error, {}) if given else share * model.inertia
    found: Floats = model.inertia + extra
    try:
        check_inertia(found)
    except InvalidData as fault:
        raise InvalidData(
            f"inertia_error makes an inertia that no body has: {fault}", field="inertia_error"
        ) from None
    return found


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


def _move(
    truth: SlewMotion, outer: Callable[[float], Floats], times: Floats, x: Floats, u: Floats
) -> Floats:
    """Return the states at `times`, from `x` at the first, by Runge and Kutta's classical steps."""
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
    """Simulate: the controller's rates are held, the motion of the true satellite integrated."""
    phase, model = controller.phase, controller.model
    end = phase.end + after
    count = max(1, int(np.ceil((end - phase.start) / sample_time - 1e-9)))
    times = np.append(phase.start + sample_time * np.arange(count), end)
    steps = max(1, int(np.ceil(np.diff(times).max() / STEP - 1e-9)))
    x = np.concatenate([model.initial_attitude, np.zeros(3), model.initial_gimbals])
    moved, fine = [x[None]], [times[:1]]
    commanded, held, saturated = [], [], []
    for begin, until in pairwise(times.tolist()):
        torque, rates, cut = controller.command(begin, until - begin, x)
        instants = np.linspace(begin, until, steps + 1)
        way = _move(truth, controller.outer, instants, x, rates)
        x = way[-1]
        moved.append(way[1:])
        fine.append(instants[1:])
        commanded.append(torque)
        held.append(rates)
        saturated.append(cut)
    dense, controls = np.concatenate(moved), np.array(held)
    table = dense[::steps]
    direction = momentum_direction(table[:, 7:], model.beta)
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
        measures=frozen(singularity_measure(table[:, 7:], model.beta)),
        verification=verification,
        breach=breach,
    )
