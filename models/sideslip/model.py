"""Estimating a vehicle's sideslip angle from what its stability control measures anyway.

Source: "Vehicle Sideslip Angle Estimation Based on General Regression Neural Network", Mathematical
Problems in Engineering 2016, article 3107910, doi 10.1155/2016/3107910.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Listed, Nested
from ..fields import Array, Optional, Real, declared, required
from ..model import Model
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .checks import kinematic_error, mean_error
from .data import Recording, Vehicle
from .plan import SideslipEstimate

__all__ = ["SideslipEstimation"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class SideslipEstimation(Model[SideslipEstimate]):
    """The sideslip angle of a vehicle at every sample of a drive.

    Estimators that know the vehicle believe in a single-track model with noise: between samples the state
    ``(β, ω)`` follows ::

        m u (dβ/dt + ω) = F_f + F_r
        I dω/dt         = a F_f - b F_r

    with the slip angles ``δ - β - a ω / u`` in front and ``b ω / u - β`` behind, and at each sample it
    is disturbed by independent normal noise with the variance ``disturbance² dt``. Yaw rate and lateral
    acceleration ``(F_f + F_r) / m`` are measured with independent normal noise. Estimators that learn
    know none of this: they read other drives whose angle is known.

    Parameters
    ----------
    vehicle : Vehicle or mapping
        The vehicle that estimators believe in, which may not be the one that was driven.
    recording : Recording or mapping
        The measurements, without the angle.
    training : sequence of Recording
        Drives with a known angle, for estimators that learn; none by default.
    disturbance : ndarray, shape (2,)
        Deviation of the noise on angle (rad/√s) and yaw rate (rad/s/√s), >= 1e-9: nothing is exact.
    yaw_rate_noise : float
        Deviation of the measured yaw rate, rad/s, > 0.
    acceleration_noise : float
        Deviation of the measured lateral acceleration, m/s², > 0.
    initial : ndarray, shape (2,)
        The state (rad, rad/s) that is expected before the first sample.
    initial_deviation : ndarray, shape (2,)
        Its deviation, > 0.
    truth : ndarray, shape (n,), optional
        The true angle, rad. Hidden from backends; None where nobody knows it.

    Notes
    -----
    The objective is the mean distance from the truth in degrees. Where there is no truth it is the mean distance of the
    estimate's changes over a second from those that kinematics gives from the measurements, see
    :func:`crosstrack.models.sideslip.checks.kinematic_error`: it sees no constant error. Samples
    below 1 m/s do not count.

    Raises
    ------
    InvalidData
        Naming field, place and value.

    Examples
    --------
    >>> import crosstrack as ct
    >>> model = ct.load("sideslip/lane-change")
    >>> print(model.describe())
    341 samples in 17 s, 15 drives to learn from, linear tyres
    """

    vehicle: Vehicle = declared(Nested(Vehicle))
    recording: Recording = declared(Nested(Recording))
    training: tuple[Recording, ...] = declared(Listed(Recording), default=())
    disturbance: Floats = declared(Array((2,), lower=1e-9), default=(0.002, 0.01))
    yaw_rate_noise: float = declared(Real(lower=0, strict=True, unit="rad/s"), default=0.002)
    acceleration_noise: float = declared(Real(lower=0, strict=True, unit="m/s²"), default=0.05)
    initial: Floats = declared(Array((2,)), default=(0.0, 0.0))
    initial_deviation: Floats = declared(Array((2,), lower=1e-9), default=(0.02, 0.1))
    truth: Floats | None = declared(
        Optional(Array(("n",), lower=-np.pi / 2, upper=np.pi / 2)), hidden=True, default=None
    )

    kind: ClassVar[str] = "sideslip"
    plan_type: ClassVar[type] = SideslipEstimate
    objective_unit: ClassVar[str] = "°"
    agreement: ClassVar[float | None] = 0.1
    formulations: ClassVar[dict[str, Any]] = {
        "full-information": ".models.sideslip.full_information:FullInformation",
        "condensed": ".models.sideslip.full_information:Condensed",
    }
    default_formulation: ClassVar[str] = "full-information"

    def check(self) -> None:
        """Refuse a truth that estimators could read, and drives to learn from that teach nothing."""
        if self.recording.sideslip is not None:
            raise InvalidData(
                "recording must not hold sideslip, which estimators could read: give it as truth",
                field="recording",
            )
        for k, drive in enumerate(self.training):
            if drive.sideslip is None:
                raise InvalidData(
                    f"training[{k}] must hold sideslip, which estimators learn", field="training"
                )
        if self.truth is not None and len(self.truth) != len(self.recording):
            raise InvalidData(
                f"truth has {len(self.truth)} entries where recording has {len(self.recording)}",
                field="truth",
            )

    @property
    def preferred_backend(self) -> str:
        """The filter corrected by regression if there are drives with the truth to learn from.

        Of five estimators in 15 scenarios it has the smallest ratio to the best one: 1.2 in the geometric mean and 2.5 at
        most. ``rts-smoother`` has 2.1 and 66: it is better by about a tenth if the vehicle is right, and worse by a
        factor of 2 to 50 if the vehicle is wrong by 10 to 30 % (``tests/benchmarks/sideslip/errors.py``).
        """
        return "kalman-grnn" if self.training else ""

    @property
    def prefers_native(self) -> bool:
        """True: what a program gives is the same, and an estimator gives it sooner."""
        return True

    def verify(self, plan: SideslipEstimate, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the mean error, and whether the estimate is an angle everywhere."""
        check_tolerance(tolerance)
        angles = self._checked(plan).sideslip
        over = np.abs(angles) - np.pi / 2
        k = int(over.argmax())
        angle = Check.scaled(
            "angle is below 90°", "", max(float(over[k]), 0.0), "rad", f"sample {k}", tolerance,
            np.pi / 2, limit=np.pi / 2,
        )  # fmt: skip
        if self.truth is None:
            return Verification(kinematic_error(self.recording, angles), (angle,))
        return Verification(mean_error(self.recording, angles, self.truth), (angle,))

    def coverage(self, plan: SideslipEstimate | Any, deviations: float = 2.0) -> float:
        """Return the share of samples whose true angle lies within `deviations` of the claimed ones.

        Of normal errors that are claimed rightly 95.4 % lie within 2. Samples below 1 m/s do not count.

        Raises
        ------
        InvalidData
            The truth is not known, or the plan is none for this model.
        """
        found = self._checked(self.as_plan(plan))
        if self.truth is None:
            raise InvalidData("truth is not known, so no coverage can be measured", field="truth")
        within = np.abs(found.sideslip - self.truth) <= deviations * found.deviation
        return float(within[self.recording.moving].mean())

    def _checked(self, plan: SideslipEstimate) -> SideslipEstimate:
        required("plan", plan, SideslipEstimate)
        if len(plan) != len(self.recording):
            raise InvalidData(
                f"sideslip must have {len(self.recording)} entries, one a sample, got {len(plan)}",
                field="sideslip",
            )
        return plan

    def distance(self, plan: SideslipEstimate, other: SideslipEstimate) -> float:
        """Return the mean distance of two estimates, degrees."""
        one, two = self._checked(plan), self._checked(other)
        return mean_error(self.recording, one.sideslip, two.sideslip)

    def plan_to_data(self, plan: SideslipEstimate) -> Any:
        """Return ``{"sideslip": […], "deviation": […]}``."""
        return plan.data()

    def plan_from_data(self, data: Any) -> SideslipEstimate:
        """Return the plan in `data`."""
        return SideslipEstimate.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""
        times = self.recording.times
        count = len(self.training)
        drives = {0: "no drive", 1: "1 drive"}.get(count, f"{count} drives")
        return (
            f"{len(times)} samples in {times[-1] - times[0]:.4g} s, {drives} to learn from, "
            f"{self.vehicle.tyre} tyres"
        )
