"""Independent verification of a slew: re-integration, and limits between the nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ...errors import InvalidData
from ..fields import show
from ..optimal_control.plan import ControlPlan, PhasePlan
from ..verification import Check, Verification, check_tolerance
from .data import SlewData
from .dynamics import SlewMotion, names_of
from .gyros import singularity_measure

__all__ = ["limited", "slew_phase", "verify_slew"]

Floats = NDArray[np.float64]

#: Relative and absolute error of an integration step.
RELATIVE, ABSOLUTE = 1e-10, 1e-12
#: Smallest number of points per interval in addition to its nodes, and of all points.
POINTS, ALL_POINTS = 8, 2000
#: Name, first entry, end entry (None: the last) and unit of the parts of the state.
_PARTS = (
    ("attitude", 0, 4, ""), ("body rates", 4, 7, "rad/s"), ("gimbal angles", 7, None, "rad")
)  # fmt: skip


def slew_phase(plan: ControlPlan, gyros: int = 4) -> PhasePlan:
    """Return the single phase of a plan for so many gyros, or raise ``InvalidData``."""
    if not isinstance(plan, ControlPlan):
        raise InvalidData(f"plan must be a ControlPlan, got {type(plan).__name__}", field="plan")
    if len(plan.phases) != 1:
        raise InvalidData(f"the plan of a slew has 1 phase, got {len(plan.phases)}", field="plan")
    phase = plan.phases[0]
    states, controls = names_of(gyros)
    for what, actual, expected in (
        ("states", phase.state_names, states),
        ("controls", phase.control_names, controls),
    ):
        if actual != expected:
            raise InvalidData(
                f"the plan of a slew has the {what} {', '.join(expected)}, got {show(list(actual))}",
                field="plan",
            )
    return phase


@dataclass(frozen=True, eq=False)
class _Samples:
    """States, controls and re-integrated states at the same times."""

    times: Floats
    states: Floats
    controls: Floats
    anew: Floats | None
    objective: float | None


def verify_slew(model: SlewData, plan: ControlPlan, tolerance: float) -> Verification:
    """Return the objective and all checks of a plan for `model`; see :meth:`SatelliteSlew.verify`."""
    check_tolerance(tolerance)
    phase = slew_phase(plan, model.gyro_count)
    motion = SlewMotion.of(model)
    samples = _sample(model, motion, phase)
    checks = [
        *_ends(model, phase, tolerance),
        *_motion(model, samples, tolerance),
        *_limits(model, motion, samples, tolerance),
        *_invariants(model, motion, samples, tolerance),
    ]
    return Verification(samples.objective, tuple(checks))


def _sizes(model: SlewData) -> tuple[float, float, float]:
    """Return the scales of the parts of the state: a unit quaternion, the rate limit, and a radian."""
    return 1.0, model.rate_limit, 1.0


# -- the ends ----------------------------------------------------------------------------------------


def _ends(model: SlewData, phase: PhasePlan, tolerance: float) -> list[Check]:
    """Return the checks of the times and of all states at both ends."""
    low, high = (float(t) for t in model.time_range)
    excess = max(abs(phase.start), low - phase.end, phase.end - high, 0.0)
    where = f"t0 = {phase.start:.9g} s, tf = {phase.end:.9g} s"
    name = "start at 0, final time within its range"
    checks = [Check.largest(name, excess, high, "s", where, tolerance, equation="13")]
    last = phase.states.intervals - 1
    begin = phase.states.on(0, [-1.0])[0]
    end = phase.states.on(last, [1.0])[0]
    names = names_of(model.gyro_count)[0]
    for side, actual, q, rates, gimbals in (
        ("initial", begin, model.initial_attitude, model.begin_rate, model.initial_gimbals),
        ("final", end, model.final_attitude, model.end_rate, model.final_gimbals),
    ):
        # q and -q represent the same attitude.
        q = -q if q @ actual[:4] < 0.0 else q
        expected = zip(_PARTS, (q, rates, gimbals), _sizes(model), strict=True)
        for (name, first, beyond, unit), target, size in expected:
            if target is None:
                continue

            def place(k: int, first: int = first, actual: Floats = actual, to: Any = target) -> str:
                return f"{names[first + k]} = {actual[first + k]:.9g}, not {to[k]:.9g}"

            difference = np.abs(actual[first:beyond] - target)
            checks.append(
                Check.largest(
                    f"{side} {name}", difference, size, unit, place, tolerance, equation="13"
                )
            )
    return checks


# -- along the way -----------------------------------------------------------------------------------


def _sample(model: SlewData, motion: SlewMotion, phase: PhasePlan) -> _Samples:
    """Return samples on every interval, including the nodes, integrated from the start.

    The cost is integrated with the motion, as the last state.
    """
    intervals = phase.states.intervals
    count = max(POINTS, int(np.ceil(ALL_POINTS / intervals)))
    even = np.linspace(-1.0, 1.0, count + 1)
    weights = model.rate_weight

    def rates(place: float, x: Floats, interval: int, half: float) -> list[float]:
        u = phase.controls.value(interval, place)
        return [half * rate for rate in (*motion.rate(x[:-1], u), 1.0 + float(weights @ u**2))]

    times, states, controls, anew = [], [], [], []
    x: Floats | None = np.append(phase.states.on(0, [-1.0])[0], 0.0)
    for k in range(intervals):
        points = np.unique(np.concatenate([even, phase.states.nodes[k], phase.controls.nodes[k]]))
        begin, end = phase.states.knots[k], phase.states.knots[k + 1]
        times.append(begin + 0.5 * (points + 1.0) * (end - begin))
        states.append(phase.states.on(k, points))
        controls.append(phase.controls.on(k, points))
        if x is not None:
            half = 0.5 * (end - begin)
            with np.errstate(all="ignore"):
                solution = solve_ivp(
                    rates, (-1.0, 1.0), x, "DOP853", points, args=(k, half),
                    rtol=RELATIVE, atol=ABSOLUTE, first_step=min(2.0, 0.5 / half),
                )  # fmt: skip
            complete = solution.success and np.isfinite(solution.y).all()
            x = solution.y[:, -1] if complete else None
            anew.append(solution.y.T)
    return _Samples(
        np.concatenate(times), np.concatenate(states), np.concatenate(controls),
        None if x is None else np.concatenate(anew)[:, :-1], None if x is None else float(x[-1]),
    )  # fmt: skip


def _motion(model: SlewData, samples: _Samples, tolerance: float) -> list[Check]:
    """Return the checks of the plan's states against the re-integrated ones."""
    checks = []
    parts = zip(_PARTS, ("10", "3", ""), _sizes(model), strict=True)
    for (name, first, beyond, unit), equation, size in parts:
        label = f"{name} integrated anew"
        place: Any = "the integration breaks down"
        difference: Any = np.inf
        if samples.anew is not None:
            difference = np.abs(samples.states[:, first:beyond] - samples.anew[:, first:beyond])
            place = _place(samples.times, names_of(model.gyro_count)[0][first:])
        checks.append(
            Check.largest(label, difference, size, unit, place, tolerance, equation=equation)
        )
    return checks


def _place(times: Floats, entries: tuple[str, ...]) -> Callable[[int, int], str]:
    """Return the function that names a sample and an entry."""
    return lambda row, column: f"t = {times[row]:.6g} s, {entries[column]}"


def limited(
    model: SlewData, rates: Floats, controls: Floats, torques: Floats
) -> tuple[tuple[str, Floats, tuple[str, ...], str], ...]:
    """Return name, magnitudes, entries and unit of the quantities with an upper limit (eq. 23)."""
    return (
        ("body rate", model.magnitudes(rates), model.bounded_names("w"), "rad/s"),
        ("gimbal rate", np.abs(controls), names_of(model.gyro_count)[1], "rad/s"),
        ("control torque", torques, model.bounded_names("T_c"), "N m"),
    )


def _limits(
    model: SlewData, motion: SlewMotion, samples: _Samples, tolerance: float
) -> list[Check]:
    """Return the checks of the limits, reduced by the margin."""
    times, rates, gimbals = samples.times, samples.states[:, 4:7], samples.states[:, 7:]
    torque = motion.torque(gimbals, samples.controls)
    measure = singularity_measure(gimbals, model.gyros)[:, None]
    reserve = f", {100 * model.margin:g} % in reserve" if model.margin else ""
    limits = model.rate_limit, model.planned_gimbal_rate, model.planned_torque
    words = "body rate limit", f"gimbal rate limit{reserve}", f"control torque limit{reserve}"
    cases = limited(model, rates, samples.controls, model.magnitudes(torque))
    checks = [
        Check.within(word, values, upper, unit, _place(times, entries), tolerance, equation="23")
        for word, upper, (_, values, entries, unit) in zip(words, limits, cases, strict=True)
    ]
    lower = model.singularity_limit
    checks.append(
        Check.largest(
            "singularity measure", lower - measure, 1.0, "", _place(times, ("det(A_t A_t')",)),
            tolerance, equation="23", limit=lower,
        )
    )  # fmt: skip
    return checks


def _invariants(
    model: SlewData, motion: SlewMotion, samples: _Samples, tolerance: float
) -> list[Check]:
    """Return the checks of the conserved quantities: the length of q, and the momentum."""
    length = np.abs((samples.states[:, :4] ** 2).sum(axis=1) - 1.0)[:, None]
    drift = np.abs(motion.total_momentum(samples.states) - model.total_momentum)
    return [
        Check.largest(
            "norm of the quaternion", length, 1.0, "", _place(samples.times, ("q·q",)), tolerance,
            equation="23",
        ),
        Check.largest(
            "total momentum", drift, model.momentum, "N m s",
            _place(samples.times, ("x", "y", "z")), tolerance, equation="1",
        ),
    ]  # fmt: skip
