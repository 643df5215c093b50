"""Estimators that learn from drives with a known angle."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.checks import kinematic_differences, kinematic_error, sensor_noises
from ...models.sideslip.data import LEAST, Recording
from ...models.sideslip.model import SideslipEstimation
from ..contract.backend import Request
from ..contract.option import Option
from .gates import find_contradictions, time_ranges
from .kalman import KalmanFilter, RtsSmoother
from .learning import (
    KernelRegression,
    StraightLine,
    TrainingSet,
    Window,
    curve_features,
    relative_size,
    training_set,
)
from .native import Estimate, SideslipBackend, leave_faults_out

__all__ = ["Grnn", "KalmanGrnn", "LinearRegression", "SmootherGrnn"]

Floats = NDArray[np.float64]

#: Ratio of the errors on drives left out below which the tyre curve corrects the filter instead of the kernel.
_BETTER = 0.95
#: Ratio of the noise of the drive to that of the training drives up to which a tyre curve learned from them is used.
_NOISIER = 2.0
#: Quantile of the filter's deviation on the training drives above which the deviation of the tyre curve grows in proportion.
_USUAL = 0.95
#: Relative change of the mass since the training drives whose effect is named, and the smallest effect, rad.
LOAD, LEAST_EFFECT = 0.1, math.radians(0.1)
#: Factor on a deviation above which a message names the reason.
_NOTED = 1.2
_WINDOW = {
    "lags": Option(
        5, "Measurements of each sensor that an angle is estimated from; 5 in the paper.", int,
        lower=1, upper=1000,
    ),
    "ahead": Option(
        0, "Periods from the newest of them to the angle; 1 in the paper.", int,
        lower=0, upper=1000,
    ),
    "inputs": Option(
        True, "Whether speed and steering angle count among them; False in the paper.", bool
    ),
}  # fmt: skip
_WIDTH = {
    "width": Option(
        None,
        "Width of the kernel in deviations of the features (without scaling in their root mean square deviation); "
        "None takes the best on drives left out.",
        lower=1e-6,
        upper=1e6,
    )
}


class _Learning(SideslipBackend):
    """Base class of the estimators that learn."""

    learns = True
    options = _WINDOW

    def refuses(self, problem: SideslipEstimation) -> str:
        """Return the reason if the training drives are missing or too short, else ""."""
        moving = sum(int(drive.moving.sum()) for drive in problem.training)
        if problem.training and moving < LEAST:
            return f"it learns from {LEAST} samples in motion or more, and training has {moving} samples in motion"
        return super().refuses(problem)

    def window(
        self, problem: SideslipEstimation, request: Request
    ) -> tuple[Window, dict[str, Any]]:
        """Return the window of the features, with the median period of the drives, and other options."""
        others = self.checked_options(request.options)
        period = float(np.median([drive.period for drive in problem.training]))
        return Window(period, **{name: others.pop(name) for name in _WINDOW}), others


def _scaling(default: bool) -> dict[str, Option]:
    return {
        "scaling": Option(
            default,
            "Whether each feature is divided by its deviation; the paper scales nothing.",
            bool,
        )
    }


class Grnn(_Learning):
    """General regression neural network (GRNN) of the paper.

    The estimate is the mean of all training angles, weighted by a Gaussian of the distance of their features.

    Features are not scaled by default, as in the toolbox that the paper uses.
    """

    name = "grnn"
    options = {**_WINDOW, **_WIDTH, **_scaling(False)}
    summary = (
        "Gaussian kernel regression on other drives (the paper's general regression neural network)"
    )

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the weighted mean of the training angles, or None if the run was stopped."""
        window, others = self.window(problem, request)
        learned = KernelRegression(training_set(problem.training, window), **others)
        result = learned(window.features(problem.recording), lambda: request.control.stopped)
        return None if result is None else widen_by_kinematics(problem, *result[:2], learned)


class KalmanGrnn(_Learning):
    """Kalman filter corrected by a GRNN that learns the filter's errors on the training drives.

    The filter uses the same vehicle parameters on the training drives, so its errors there are similar, and they are
    smaller and smoother than the angle. The correction vanishes far from all training drives. The claimed deviation
    is that of the GRNN. It is scaled up if the filter's deviation exceeds its median on the training drives.
    If least squares on the features of a tyre curve, see :func:`~crosstrack.solvers.sideslip.learning.curve_features`, has a
    smaller error on drives left out, it corrects the filter instead. Real tyres and noisy sensors need it.
    The deviation is then calibrated on drives left out. It grows with that of the filter beyond its 95 % quantile on the training
    drives, and near samples where kinematics contradicts the angle more than there.
    A run that is stopped before the training ends returns the estimate of the filter; a run that is stopped
    before the filter ends returns that of `linear-regression`.
    """

    name = "kalman-grnn"
    options = {**_WINDOW, **_WIDTH, **_scaling(True)}
    summary = "Kalman filter, corrected by kernel regression on its errors on other drives"
    #: Estimator that is corrected.
    corrected: ClassVar[type[SideslipBackend]] = KalmanFilter

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the filter's angle, corrected by its error at similar measurements."""
        window, others = self.window(problem, request)
        base, filtered = self.corrected(), list[Estimate]()
        for drive in (problem.recording, *problem.training):
            drive = replace(drive, sideslip=None)
            alone = replace(problem, recording=drive, training=(), truth=None)
            entry = base.estimate(alone, request)
            if entry is None:
                return _uncorrected(filtered[0], base) if filtered else _unfiltered(problem, window)
            filtered.append(entry)
        here, *there = filtered
        if request.control.stopped:
            return _uncorrected(here, base)
        errors = []
        for drive, entry in zip(problem.training, there, strict=True):
            assert drive.sideslip is not None  # the model refuses such drives
            errors.append(drive.sideslip - entry.sideslip)
        examples = training_set(problem.training, window, errors)
        learned = KernelRegression(examples, **others)
        result = learned(window.features(problem.recording), lambda: request.control.stopped)
        if result is None:
            return _uncorrected(here, base)
        error, deviation, near = result
        on = [drive.moving for drive in problem.training]
        usual = np.concatenate([e.deviation[k] for e, k in zip(there, on, strict=True)])
        if _noise_ratio(problem) <= _NOISIER:
            curved = _correct_by_curve(problem, examples, filtered, _BETTER * learned.error)
            if curved is not None:
                angle = here.sideslip + near * (curved.sideslip - here.sideslip)
                # Kernel and curve estimate the same error. They differ at inputs that the training drives lack.
                apart = 0.5 * np.abs(here.sideslip + near * error - angle)
                apart += (1.0 - near) * learned.spread
                # A filter that is less sure than on the training drives has errors that they lack.
                unsure = np.maximum(here.deviation / np.quantile(usual, _USUAL), 1.0)
                claimed = unsure * np.hypot(curved.deviation, apart)
                deviation, message = widen_near(problem, angle, claimed)
                message = "; ".join(filter(None, (message, name_unseen_load(problem, deviation))))
                return curved._replace(sideslip=angle, deviation=deviation, message=message)
        unsure = np.maximum(here.deviation / np.median(usual), 1.0)
        return Estimate(
            here.sideslip + near * error, deviation * unsure, describe_learning(learned),
            here.message, learned.spread, history=True,
        )  # fmt: skip


def _noise_ratio(problem: SideslipEstimation) -> float:
    """Return the largest ratio of a sensor's noise to the median of that on the training drives; 1 if that is unknown."""
    noises = np.array([sensor_noises(drive) for drive in problem.training])
    noises = noises[noises.any(axis=1)]  # of drives with enough regular samples
    usual = np.median(noises, axis=0) if len(noises) else np.zeros(2)
    here = sensor_noises(problem.recording)
    return float(np.divide(here, usual, out=np.ones(2), where=usual > 0.0).max())


def _correct_by_curve(
    problem: SideslipEstimation, examples: TrainingSet, filtered: list[Estimate], limit: float
) -> Estimate | None:
    """Return the filter's angle, corrected by its error at similar points of the tyre curve.

    `filtered` are the estimates of the drive and of the training drives, and `examples` the errors there. The result
    is None if the error (rad) on drives left out exceeds `limit`. Features are limited to their range on the training
    drives: powers grow fast beyond it.
    """
    drives = problem.recording, *problem.training
    # A sensor that some drives lack would give them another feature.
    missing: dict[str, Any] = {
        name: None
        for name in ("wheel_speeds", "longitudinal_acceleration")
        if any(getattr(drive, name) is None for drive in drives)
    }
    drives = tuple(replace(drive, **missing) for drive in drives)
    here, *there = (
        curve_features(drive, entry.sideslip) for drive, entry in zip(drives, filtered, strict=True)
    )
    known = np.vstack([entry[drive.moving] for drive, entry in zip(drives[1:], there, strict=True)])
    if not np.isfinite(known).all() or not np.isfinite(examples.angles).all():
        return None
    learned = StraightLine(examples._replace(features=known))
    if not learned.error <= limit:
        return None
    error, deviation = learned(np.clip(here, known.min(axis=0), known.max(axis=0)))
    speeds = np.concatenate([drive.speed[drive.moving] for drive in drives[1:]])
    size = relative_size(learned.left_out, speeds)
    deviation *= size(drives[0].speed) * learned.recalibrated(size(speeds))
    said = {**describe_learning(learned), "tyre curve": 1.0}
    angle = filtered[0].sideslip + error
    return Estimate(angle, deviation, said, "", learned.spread, history=True)


def name_unseen_load(problem: SideslipEstimation, deviation: Floats) -> str:
    """Return the times at which a larger mass than on the training drives would go unnoticed, or an empty text.

    In a steady turn the error is constant, so that kinematics does not contradict it, and no deviation of the estimate (rad)
    includes it.
    """
    drive, car = problem.recording, problem.vehicle
    angle = car.mass * drive.lateral_acceleration / (car.cornering_front + car.cornering_rear)
    angle *= LOAD
    before = np.interp(drive.times - 1.0, drive.times, angle)
    unseen = (np.abs(angle) > np.maximum(2.0 * deviation, LEAST_EFFECT)) & (
        np.abs(angle - before) <= deviation
    )
    unseen &= drive.moving
    if not unseen.any():
        return ""
    most = math.degrees(float(np.abs(angle[unseen]).max()))
    return (
        f"at {time_ranges(drive, unseen)} kinematics does not show a constant error: a mass {100 * LOAD:g} % above that of the "
        f"training drives would change the angle by up to {most:.2g}°, which deviations do not include"
    )


def widen_near(problem: SideslipEstimation, angle: Floats, deviation: Floats) -> tuple[Floats, str]:
    """Return a wider deviation (rad) near samples where kinematics contradicts the angle (rad), and the reason.

    It is that of :func:`widen_by_kinematics`, with the differences of the seconds that contain a sample: a situation that the
    training drives lack, such as a bias, a load or ice, may last for a part of the drive.
    """

    def error(drive: Recording, angle: Floats) -> Floats:
        bounded = np.clip(angle, -math.pi / 2, math.pi / 2)
        apart, first, last = kinematic_differences(drive, bounded)

        def around(values: Floats) -> Floats:
            ends = len(drive) + 1
            steps = np.bincount(first, values, ends) - np.bincount(last + 1, values, ends)
            return np.cumsum(steps)[:-1]

        known = np.where(np.isfinite(apart), np.abs(apart), 0.0)
        mean: Floats = around(known) / np.maximum(around(np.ones(len(first))), 1.0)
        return mean

    drives = [(entry, entry.sideslip) for entry in problem.training]
    usual = max(error(entry, true).max() for entry, true in drives if true is not None)
    beyond = np.sqrt(math.pi * np.maximum(error(problem.recording, angle) ** 2 - usual**2, 0.0)) / 2
    wider = np.hypot(deviation, beyond)
    widened = wider > _NOTED * deviation
    if not widened.any():
        return wider, ""
    return wider, (
        f"the angle's changes over a second differ at {time_ranges(problem.recording, widened)} more from those that yaw rate and "
        f"acceleration give than the {math.degrees(usual):.2g}° on training drives: deviations are wider there"
    )


class SmootherGrnn(KalmanGrnn):
    """Rauch-Tung-Striebel smoother with the correction of :class:`KalmanGrnn`. Each angle uses all samples."""

    name = "smoother-grnn"
    summary = "smoother, corrected by kernel regression on its errors on other drives"
    corrected = RtsSmoother

    def revise(self, problem: SideslipEstimation) -> tuple[SideslipEstimation, str]:
        """Return the model without faults of the sensors."""
        return leave_faults_out(problem)


class LinearRegression(_Learning):
    """Linear least squares with a constant: the baseline for other estimators that learn."""

    name = "linear-regression"
    summary = "least squares on other drives: the floor that whatever learns must beat"

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the linear combination of the measurements."""
        return _fit_line(problem, self.window(problem, request)[0])


def _fit_line(problem: SideslipEstimation, window: Window) -> Estimate:
    learned = StraightLine(training_set(problem.training, window))
    return widen_by_kinematics(problem, *learned(window.features(problem.recording)), learned)


def widen_by_kinematics(
    problem: SideslipEstimation, angle: Floats, deviation: Floats,
    learned: KernelRegression | StraightLine,
) -> Estimate:  # fmt: skip
    """Return an estimate with a wider deviation everywhere if kinematics contradicts it on average.

    Yaw rate and acceleration determine the change of the angle for any tyre. The mean difference of the
    estimate from this change is compared with the largest one of the true angle on a training drive. The
    excess is an error of the estimate or of the sensors. It is the mean absolute difference of two
    angles, and so ``2 / √π`` deviations of one. Samples contradicted one by one are left to
    :mod:`crosstrack.solvers.sideslip.gates`.
    """
    drive = problem.recording
    bounded = np.clip(angle, -math.pi / 2, math.pi / 2)
    trusted = find_contradictions(problem, bounded, deviation) == 0.0
    apart, first, last = kinematic_differences(drive, bounded)
    apart = apart[trusted[first] & trusted[last]]
    here = math.degrees(float(np.abs(apart).mean())) if apart.size else 0.0
    drives = [(entry, entry.sideslip) for entry in problem.training]
    there = max(kinematic_error(entry, true) for entry, true in drives if true is not None)
    beyond = math.radians(math.sqrt(math.pi * max(here**2 - there**2, 0.0)) / 2.0)
    claims = deviation[drive.moving & trusted]
    missing = max(beyond**2 - float((claims**2).mean()), 0.0) if claims.size else 0.0
    message = (
        f"on average the angle's changes over a second are {here:.2g}° from those that yaw rate and "
        f"acceleration give, and at most {there:.2g}° on training drives: all deviations are wider for that"
    )
    wider = np.sqrt(deviation**2 + missing)
    statistics, is_kernel = describe_learning(learned), isinstance(learned, KernelRegression)
    remark = message if missing else ""
    return Estimate(angle, wider, statistics, remark, learned.spread, history=is_kernel)


def describe_learning(learned: KernelRegression | StraightLine) -> dict[str, float]:
    """Return the statistics of a regression: its validation error (degrees) and kernel width."""
    said = {"error of drives left out": float(np.degrees(learned.error))}
    if isinstance(learned, KernelRegression):
        said["width"] = learned.width
    return said


def _unfiltered(problem: SideslipEstimation, window: Window) -> Estimate:
    """Return the estimate of linear least squares for a run that was stopped before the filter ended."""
    words = "stopped before the filter ended: the angles are those of linear regression"
    line = _fit_line(problem, window)
    return line._replace(message="; ".join(filter(None, (words, line.message))))


def _uncorrected(filtered: Estimate, base: SideslipBackend) -> Estimate:
    """Return the estimate of the filter `base` for a run that was stopped before the training ended."""
    words = f"stopped before it had learned: the angles are those of {base.name}"
    return filtered._replace(message="; ".join(filter(None, (words, filtered.message))))
