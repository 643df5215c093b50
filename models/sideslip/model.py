"""Estimation of a vehicle's sideslip angle from the sensors of its stability control.

Source: "Vehicle Sideslip Angle Estimation Based on General Regression Neural Network", Mathematical
Problems in Engineering 2016, article 3107910, doi 10.1155/2016/3107910.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Listed, Nested
from ..fields import Array, Optional, Real, declared, required
from ..inputs import Field, FloatArray, FloatsOrNone
from ..model import Model
from ..specs import count_rows
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .checks import SLOW, kinematic_error, linear_contradiction, mean_error, sensor_noises
from .data import Recording, Vehicle
from .plan import SideslipEstimate

__all__ = ["NOISIER", "SideslipEstimation"]

#: Largest and mean contradiction of linear tyres (degrees) that excite the further states of ``unscented-filter``, the
#: deviations of noise in both, and their smallest ratio to the training drives.
EXCITED, NOISES, FACTOR = (0.5, 0.15), (8.0, 4.0), 2.0
#: Ratio of the measured and the declared noise of a sensor above which the declaration is wrong, and factor on the measured
#: noise: that of real cars is not normal.
NOISIER, REAL = 2.0, 2.0


@dataclass(frozen=True, eq=False, repr=False)
class SideslipEstimation(Model[SideslipEstimate]):
    """Estimation of a vehicle's sideslip angle at every sample of a drive.

    Model-based estimators assume a single-track model with noise. Between samples the state
    ``(β, ω)`` follows ::

        m u (dβ/dt + ω) = F_f + F_r
        I dω/dt         = a F_f - b F_r

    with the slip angles ``δ - β - a ω / u`` at the front and ``b ω / u - β`` at the rear. At each sample
    independent normal noise with the variance ``disturbance² dt`` is added to it. Yaw rate and lateral
    acceleration ``(F_f + F_r) / m`` are measured with independent normal noise. Estimators that learn
    use training drives with a known angle instead of this model.

    Parameters
    ----------
    vehicle : Vehicle or mapping
        Vehicle parameters assumed by the estimators. They may differ from those of the real vehicle.
    recording : Recording or mapping
        Measurements, without the angle.
    training : sequence of Recording
        Drives with a known angle, for estimators that learn; empty by default.
    disturbance : ndarray, shape (2,)
        Standard deviation of the noise on the angle, in radians, and on the yaw rate, in radians per second,
        both per square root of a second, >= 1e-9; (0.002, 0.01) by default.
    yaw_rate_noise : float
        Standard deviation of the measured yaw rate, in radians per second, > 0; 0.002 by default.
    acceleration_noise : float
        Standard deviation of the measured lateral acceleration, in metres per second squared,
        > 0; 0.05 by default.
    initial : ndarray, shape (2,)
        Expected state in radians and radians per second before the first measurement; zero by default.
    initial_deviation : ndarray, shape (2,)
        Standard deviation of the initial state, in radians and radians per second, >= 1e-9;
        (0.02, 0.1) by default.
    truth : ndarray, shape (n,), optional
        True angle in radians. It is hidden from backends. None if it is unknown.

    Notes
    -----
    The objective is the mean absolute error in degrees. If `truth` is None, it is the mean difference between the
    estimate's changes over one second and those that kinematics gives from the measurements. That measure is
    insensitive to a constant error. Samples below 1 m/s are ignored.

    Raises
    ------
    InvalidData
        A field has an invalid value. The message gives field, position and value.

    Examples
    --------
    >>> import crosstrack as ct
    >>> model = ct.load("sideslip/lane-change")
    >>> print(model.describe())
    341 samples in 17 s, 15 drives to learn from, linear tyres
    """

    vehicle: Field[Vehicle | Mapping[str, Any], Vehicle] = declared(Nested(Vehicle))
    recording: Field[Recording | Mapping[str, Any], Recording] = declared(Nested(Recording))
    training: Field[Sequence[Recording | Mapping[str, Any]], tuple[Recording, ...]] = declared(
        Listed(Recording), default=()
    )
    disturbance: FloatArray = declared(Array((2,), lower=1e-9), default=(0.002, 0.01))
    yaw_rate_noise: float = declared(Real(lower=0, strict=True, unit="rad/s"), default=0.002)
    acceleration_noise: float = declared(Real(lower=0, strict=True, unit="m/s²"), default=0.05)
    initial: FloatArray = declared(Array((2,)), default=(0.0, 0.0))
    initial_deviation: FloatArray = declared(Array((2,), lower=1e-9), default=(0.02, 0.1))
    truth: FloatsOrNone = declared(
        Optional(Array(("n",), lower=-np.pi / 2, upper=np.pi / 2, unit="rad")),
        hidden=True,
        default=None,
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
        """Raise :class:`InvalidData` if the truth is visible, has a wrong length, or is missing in training."""
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
        if self.truth is not None:
            count_rows("truth", len(self.truth), "", {"": (len(self.recording), "recording")})

    @property
    @np.errstate(over="ignore", invalid="ignore")  # noises of any size are allowed
    def preferred_backend(self) -> str:
        """``unscented-filter`` if kinematics contradicts linear tyres, else ``smoother-grnn`` if there are training drives.

        The largest contradiction must exceed 0.5° and eight deviations of the acceleration's noise, or the mean one 0.15° and four
        deviations of the noise of both sensors, and twice that on training drives (``tests/benchmarks/sideslip/spins.py``).
        If a sensor is more than twice as noisy as declared, twice its measured noise is used, and the mean is not compared.
        Otherwise, without training drives, it is ``rts-smoother``. The ratio of its error to that of the best estimator is measured by
        ``tests/benchmarks/sideslip/recommended.py``.
        """
        car, drive = self.vehicle, self.recording
        stiffness, fast = car.cornering_front + car.cornering_rear, drive.speed[drive.speed >= SLOW]
        declared, measured = self.sensor_noises, sensor_noises(drive)
        noisy = measured > NOISIER * declared
        noise = np.where(noisy, REAL * measured, declared)
        rate = np.hypot(noise[0], noise[1] / fast.mean() if fast.size else 0.0)
        noises = car.mass * noise[1] / stiffness, rate / np.sqrt(max(fast.size, 1))
        here = np.array(linear_contradiction(car, drive))
        excited = here > EXCITED + np.degrees(np.multiply(NOISES, noises))
        excited[1] &= not noisy.any()
        if excited.any():
            # The mean over a short drive differs more from 0 than that over a long one.
            seconds = float(drive.times[-1] - drive.times[0])
            known = [linear_contradiction(car, other, seconds) for other in self.training]
            if (excited & (here > FACTOR * np.max([(0.0, 0.0), *known], axis=0))).any():
                return "unscented-filter"
        return "smoother-grnn" if self.training else ""

    @property
    def sensor_noises(self) -> NDArray[np.float64]:
        """Declared standard deviations of yaw rate (rad/s) and lateral acceleration (m/s²), shape (2,)."""
        return np.array([self.yaw_rate_noise, self.acceleration_noise])

    @property
    def prefers_native(self) -> bool:
        """True: estimators give the same result as the programs in less time."""
        return True

    def verify(self, plan: SideslipEstimate, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the mean error (degrees) as objective, and the check that all angles are within ±90°."""
        check_tolerance(tolerance)
        angles = self.checked_plan(plan).sideslip
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
        """Return the share of samples whose error is at most `deviations` times the claimed deviation.

        The share is 95.4 % within 2 deviations if the errors are normal and the deviations correct.
        Samples below 1 m/s are ignored.

        Parameters
        ----------
        plan : SideslipEstimate, JSON data or Solution
            The estimate.
        deviations : float
            Multiple of the claimed deviation, 2 by default.

        Returns
        -------
        float
            The share, between 0 and 1.

        Raises
        ------
        InvalidData
            The truth is unknown, or the plan does not fit this model.
        """
        result = self.checked_plan(self.as_plan(plan))
        if self.truth is None:
            raise InvalidData("truth is not known, so no coverage can be measured", field="truth")
        within = np.abs(result.sideslip - self.truth) <= deviations * result.deviation
        return float(within[self.recording.moving].mean())

    def checked_plan(self, plan: SideslipEstimate) -> SideslipEstimate:
        """Return the plan, or raise :class:`InvalidData` if it is of another type or length."""
        required("plan", plan, SideslipEstimate)
        if len(plan) != len(self.recording):
            raise InvalidData(
                f"sideslip must have {len(self.recording)} entries, one per sample, got {len(plan)}",
                field="sideslip",
            )
        return plan

    def distance(self, plan: SideslipEstimate, other: SideslipEstimate) -> float:
        """Return the mean absolute difference of two estimates, in degrees."""
        first, second = self.checked_plan(plan), self.checked_plan(other)
        return mean_error(self.recording, first.sideslip, second.sideslip)

    def describe(self) -> str:
        """Return a one-line summary: samples, duration, training drives and tyre law."""
        times = self.recording.times
        count = len(self.training)
        drives = {0: "no drive", 1: "1 drive"}.get(count, f"{count} drives")
        return (
            f"{len(times)} samples in {times[-1] - times[0]:.4g} s, {drives} to learn from, "
            f"{self.vehicle.tyre} tyres"
        )
