"""A simulated flight along a plan of a slew, and whether it keeps the limits of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..verification import Check, Verification
from .dynamics import CONTROLS, STATES, SlewMotion
from .gyros import singularity_measure
from .model import SatelliteSlew
from .quaternions import attitude_error

__all__ = ["Breach", "Tracking", "verify_flight"]

Floats = NDArray[np.float64]

#: Name, equation, values, limit, entries, unit, instants, and the share of the limit that is forgiven.
_Case = tuple[str, str, Floats, float, Sequence[str], str, Floats, float]

#: How far the length of the quaternion may drift before the simulation is not believed.
DRIFT = 1e-6


class Breach(NamedTuple):
    """Where a flight leaves a limit for the first time.

    Parameters
    ----------
    name : str
        The check that is violated.
    time : float
        The first instant, s.
    value, limit : float
        What is met there, and what is allowed, in the check's unit.
    worst : float
        The worst value of the whole flight.
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
    """A simulated flight along a plan, sampled at n instants, with a verdict.

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
        Whether the limits of torque and gimbal rates, or a singularity, kept the gyros from giving
        what was asked.
    measures : ndarray, shape (n,)
        det(A_t A_tᵀ).
    verification : Verification
        The flight against the limits of the model, its margin at the controller's disposal, and
        against what is asked of its end; between the samples too.
    breach : Breach, optional
        The check that is violated first; None where none is.
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
        """Whether the flight keeps every limit."""
        return self.verification.ok

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

    def to_data(self) -> dict[str, Any]:
        """Return the flight as JSON data: every table as lists, the verification, the breach."""
        found: dict[str, Any] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            found[one.name] = value.tolist() if isinstance(value, np.ndarray) else value
        found["verification"] = self.verification.to_dict()
        found["breach"] = None if self.breach is None else self.breach._asdict()
        return found

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
    """Return whether a flight keeps the limits of `model`, and what it breaks first.

    Parameters
    ----------
    model : SatelliteSlew
        Whose limits count, nothing held in reserve.
    times : ndarray, shape (n,)
        Instants, s, close enough to see what lies between.
    states : ndarray, shape (n, 11)
        What is flown.
    controls : ndarray, shape (n - 1, 4)
        Gimbal rates, held from each instant to the next, rad/s.
    tolerance : float
        Share of a limit by which it may be passed.
    ends : (float, float)
        Largest angle (rad) from the final attitude, and largest body rate (rad/s), at the end.
    """
    motion = SlewMotion.of(model)
    before, after = (motion.torque(x[:, 7:], controls) for x in (states[:-1], states[1:]))
    # The torque of held rates changes with the Jacobian: the greater of a step's ends counts.
    torque = np.maximum(model.magnitudes(before), model.magnitudes(after))
    measure = singularity_measure(states[:, 7:], model.beta)[:, None]
    turn = attitude_error(states[-1:, :4], model.target)
    angle = 2.0 * np.arctan2(np.linalg.norm(turn[:, 1:], axis=1), turn[:, 0])[:, None]
    length = np.abs((states[:, :4] ** 2).sum(axis=1) - 1.0)[:, None]
    w, end, one = states[:, 4:7], times[-1:], ("",)
    cases: list[_Case] = [
        (
            "body rate", "23", model.magnitudes(w), model.rate_limit, model.bounded_names("w"),
            "rad/s", times, tolerance,
        ),
        (
            "gimbal rate", "23", controls, model.gimbal_rate_limit, CONTROLS, "rad/s", times,
            tolerance,
        ),
        (
            "control torque", "23", torque, model.torque_limit, model.bounded_names("T_c"), "N m",
            times, tolerance,
        ),
        ("singularity measure", "23", measure, model.singularity_limit, one, "", times, tolerance),
        ("final angle off the target", "13", angle, ends[0], one, "rad", end, 0.0),
        ("final body rate", "13", w[-1:], ends[1], STATES[4:7], "rad/s", end, 0.0),
        ("drift of the quaternion's length", "23", length, DRIFT, one, "", times, 0.0),
    ]  # fmt: skip
    held = [_held(*case) for case in cases]
    first = min((one for _, one in held if one), key=lambda one: one.time, default=None)
    price = 1.0 + controls**2 @ model.rate_weight
    objective = float(np.diff(times) @ price)
    return Verification(objective, tuple(check for check, _ in held)), first


def _held(
    name: str, equation: str, values: Floats, limit: float, entries: Sequence[str], unit: str,
    times: Floats, share: float,
) -> tuple[Check, Breach | None]:  # fmt: skip
    """Return the check of `values`, shape (n, entries), against a limit, and where they leave it."""
    least = name == "singularity measure"
    values = values if least else np.abs(values)
    over = limit - values if least else values - limit
    over = np.where(np.isnan(over), np.inf, over)
    row, column = (int(k) for k in np.unravel_index(int(over.argmax()), over.shape))
    where = f"t = {times[row]:.6g} s" + (f", {entries[column]}" if entries[column] else "")
    worst = max(0.0, float(over[row, column]))
    check = Check.scaled(name, equation, worst, unit, where, share, limit, limit=limit)
    if check.ok:
        return check, None
    begin = int((over > check.tolerance).any(axis=1).argmax())
    value = float(values[begin, int(over[begin].argmax())])
    return check, Breach(name, float(times[begin]), value, limit, float(values[row, column]))
