"""Simulated flight along a plan of a slew, and its verification against the limits of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..verification import Check, Verification
from .checks import limited
from .dynamics import STATES, SlewMotion
from .gyros import singularity_measure
from .model import SatelliteSlew
from .quaternions import attitude_error

__all__ = ["Breach", "Tracking", "verify_flight"]

Floats = NDArray[np.float64]

#: Name, equation, values, limit, entries, unit, times, and accepted share of the limit.
_Case = tuple[str, str, Floats, float, Sequence[str], str, Floats, float]

#: Largest drift of the quaternion's length in a valid simulation.
DRIFT = 1e-6


class Breach(NamedTuple):
    """First violation of a limit by a flight.

    Parameters
    ----------
    name : str
        Violated check.
    time : float
        Time of the first violation, s.
    value, limit : float
        Value at that time and limit, in the check's unit.
    worst : float
        Worst value of the flight.
    """

    name: str
    time: float
    value: float
    limit: float
    worst: float

    def __str__(self) -> str:
        return (
            f"{self.name} {self.value:.4g} at t = {self.time:.4g} s where the limit is "
            f"{self.limit:.4g}, {self.worst:.4g} at worst"
        )


@dataclass(frozen=True, eq=False)
class Tracking:
    """Simulated flight along a plan, sampled at n times, with its verification.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Sampling times of the controller in seconds; the last is the end.
    attitudes : ndarray, shape (n, 4)
        Simulated quaternions.
    rates : ndarray, shape (n, 3)
        Simulated body rates in radians per second.
    gimbals : ndarray, shape (n, gyros)
        Gimbal angles in radians.
    quaternion_errors : ndarray, shape (n, 4)
        q_e, eq. 25; its vector part is half the angle of a small error.
    rate_errors : ndarray, shape (n, 3)
        Error of the body rates, w_e = w - w_d, in radians per second.
    commanded : ndarray, shape (n - 1, 3)
        Control torque T_c commanded by the controller in each sample, in newton metres.
    applied : ndarray, shape (n - 1, 3)
        Control torque produced by the gyros, averaged over each sample, in newton metres.
    gimbal_rates : ndarray, shape (n - 1, gyros)
        Gimbal rates, constant over each sample, in radians per second.
    saturated : ndarray, shape (n - 1,)
        Whether limits of torque and gimbal rates, or a singularity, reduced the commanded torque.
    measures : ndarray, shape (n,)
        det(A_t A_tᵀ).
    verification : Verification
        Checks of the flight against the limits of the model without margin, and of its end, also
        between the samples.
    breach : Breach, optional
        First violation; None if all limits are satisfied.
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
    verification: Verification
    breach: Breach | None

    @property
    def ok(self) -> bool:
        """Whether the flight satisfies every limit."""
        return self.verification.ok

    @property
    def max_quaternion_error(self) -> float:
        """Largest entry of the vector part of the error quaternion."""
        return float(np.abs(self.quaternion_errors[:, 1:]).max())

    @property
    def max_rate_error(self) -> float:
        """Largest error of a body rate, rad/s."""
        return float(np.abs(self.rate_errors).max())

    @property
    def saturated_share(self) -> float:
        """Share of samples with a saturated command."""
        return float(self.saturated.mean())

    def to_data(self) -> dict[str, Any]:
        """Return the flight as JSON data: all arrays as lists, the verification and the breach."""
        result: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            result[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
        result["verification"] = self.verification.to_dict()
        result["breach"] = None if self.breach is None else self.breach._asdict()
        return result

    def __str__(self) -> str:
        share, cut = self.saturated_share, ""
        if share:
            begin = self.times[int(self.saturated.argmax())]
            cut = f" from t = {begin:.4g} s"
        verdict = "verified" if self.breach is None else f"NOT verified: {self.breach}"
        return (
            f"{self.times[-1] - self.times[0]:.4g} s tracked: quaternion error "
            f"{self.max_quaternion_error:.2g}, rate error {self.max_rate_error:.2g} rad/s, "
            f"{100 * share:.3g} % of the samples saturated{cut}; {verdict}"
        )


def verify_flight(
    model: SatelliteSlew,
    times: Floats,
    states: Floats,
    controls: Floats,
    tolerance: float,
    ends: tuple[float, float],
) -> tuple[Verification, Breach | None]:
    """Return the verification of a flight against the limits of `model`, and its first violation.

    The margin is not deducted. States, shape (n, 7 + gyros), are dense enough to represent the motion between
    samples, and gimbal rates, shape (n - 1, gyros), are constant from each time to the next. `tolerance` is
    the accepted excess as a share of a limit. `ends` are the largest angle from the final attitude (rad) and
    the largest error of a body rate (rad/s) at the end.
    """
    motion = SlewMotion.of(model)
    before, after = (motion.torque(x[:, 7:], controls) for x in (states[:-1], states[1:]))
    # The torque of constant rates changes with the Jacobian: take the larger one of a step's ends.
    torque = np.maximum(model.magnitudes(before), model.magnitudes(after))
    measure = singularity_measure(states[:, 7:], model.gyros)[:, None]
    turn = attitude_error(states[-1:, :4], model.target)
    angle = 2.0 * np.arctan2(np.linalg.norm(turn[:, 1:], axis=1), turn[:, 0])[:, None]
    length = np.abs((states[:, :4] ** 2).sum(axis=1) - 1.0)[:, None]
    w, end, item = states[:, 4:7], times[-1:], ("",)
    limits = model.rate_limit, model.gimbal_rate_limit, model.torque_limit
    quantities = zip(limits, limited(model, w, controls, torque), strict=True)
    cases: list[_Case] = [
        *((name, "23", values, limit, entries, unit, times, tolerance)
          for limit, (name, values, entries, unit) in quantities),
        ("singularity measure", "23", measure, model.singularity_limit, item, "", times, tolerance),
        ("final angle off the target", "13", angle, ends[0], item, "rad", end, 0.0),
        ("final body rate", "13", w[-1:] - model.end_rate, ends[1], STATES[4:7], "rad/s", end, 0.0),
        ("drift of the quaternion's length", "23", length, DRIFT, item, "", times, 0.0),
    ]  # fmt: skip
    results = [_check_limit(*case) for case in cases]
    first = min((item for _, item in results if item), key=lambda item: item.time, default=None)
    price = 1.0 + controls**2 @ model.rate_weight
    objective = float(np.diff(times) @ price)
    return Verification(objective, tuple(check for check, _ in results)), first


def _check_limit(
    name: str, equation: str, values: Floats, limit: float, entries: Sequence[str], unit: str,
    times: Floats, share: float,
) -> tuple[Check, Breach | None]:  # fmt: skip
    """Return the check of `values`, shape (n, entries), against a limit, and its first violation."""
    is_lower = name == "singularity measure"
    values = values if is_lower else np.abs(values)
    excess = limit - values if is_lower else values - limit
    excess = np.where(np.isnan(excess), np.inf, excess)
    row, column = (int(k) for k in np.unravel_index(int(excess.argmax()), excess.shape))
    where = f"t = {times[row]:.6g} s" + (f", {entries[column]}" if entries[column] else "")
    worst = max(0.0, float(excess[row, column]))
    check = Check.scaled(name, equation, worst, unit, where, share, limit, limit=limit)
    if check.ok:
        return check, None
    begin = int((excess > check.tolerance).any(axis=1).argmax())
    value = float(values[begin, int(excess[begin].argmax())])
    return check, Breach(name, float(times[begin]), value, limit, float(values[row, column]))
