"""Training examples from drives, and kernel and linear regression on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.sideslip.data import LOW_SPEED, Recording

__all__ = [
    "KernelRegression", "Scale", "StraightLine", "TrainingSet", "Window", "curve_features",
    "training_set",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Share of normal errors within two deviations; claimed deviations are calibrated to it.
WITHIN_TWO = math.erf(2.0 / math.sqrt(2.0))
#: Largest number of examples in cross-validation: more change the width little, and cost time.
MOST_LEFT_OUT = 300
#: Largest number of entries of a table of examples by examples, which is held in memory.
MOST_TABLE = 2**24
#: Number of entries in a block of such a table, which fits a processor's cache.
BLOCK = 2**18
#: Smallest number of rows in a block, if memory allows: fewer rows are slow to multiply.
ROWS = 16
#: Least duration (s) and largest number of the parts of a single training drive. With halves of the race-track drive the errors
#: of drives left out are too large, because half of the track is missing.
LEAST_PART, MOST_PARTS = 15.0, 5
#: Search interval of the kernel width, in deviations of the features.
NARROWEST, WIDEST = 0.02, 5.0
#: Number of widths in the grid search, and tolerance of the refinement in the logarithm.
GRID, ACCURACY = 9, 0.05
#: Time (s) over which accelerations are averaged for the tyre curve, and number of values in the mean.
CURVE_WINDOW, CURVE_SAMPLES = 0.2, 9
#: Ratio of a feature's deviation to its largest value below which it is treated as constant.
CONSTANT = 1e-9


class Window(NamedTuple):
    """Window of `lags` lagged measurements per sensor, `period` s apart, used as features.

    The angle follows `ahead` periods after the newest lag: 0 uses the sample itself; the paper uses 1.
    If `inputs`, speed and steering angle are features too; False in the paper.
    """

    period: float
    lags: int = 5
    ahead: int = 0
    inputs: bool = True

    def features(self, recording: Recording) -> Floats:
        """Return the lagged measurements of each sample, shape (n, 2 lags) or (n, 4 lags).

        They are interpolated linearly at multiples of the period, so that missing samples do not shift
        them. Times before the first sample take its values.
        """
        signals = [recording.yaw_rate, recording.lateral_acceleration]
        if self.inputs:
            signals += [recording.speed, recording.steering]
        before = self.period * (self.ahead + np.arange(self.lags))
        instants = recording.times[:, None] - before
        return np.hstack([np.interp(instants, recording.times, entry) for entry in signals])


class TrainingSet(NamedTuple):
    """Training examples, one per sample: features, shape (n, d), and targets (rad), shape (n,).

    A target is the angle or the error of a filter. `drives` has the index of the drive of each example:
    cross-validation leaves out whole drives.
    """

    features: Floats
    angles: Floats
    drives: NDArray[np.int64]


def training_set(
    training: Iterable[Recording], window: Window, targets: Iterable[Floats] | None = None
) -> TrainingSet:
    """Return the examples of all samples at 1 m/s or more.

    The targets (rad) of a drive are its angles by default. A single drive is split into two to five parts, so
    that one of them can be left out.
    """
    drives = list(training)
    result: list[Any] = [drive.sideslip for drive in drives] if targets is None else list(targets)
    features = np.vstack([window.features(drive)[drive.moving] for drive in drives])
    angles = np.concatenate(
        [entry[drive.moving] for entry, drive in zip(result, drives, strict=True)]
    )
    counts = [int(drive.moving.sum()) for drive in drives]
    if len(counts) == 1:
        seconds = drives[0].times[-1] - drives[0].times[0]
        parts = int(np.clip(seconds / LEAST_PART, 2, MOST_PARTS))
        counts = np.diff(np.linspace(0, counts[0], parts + 1).astype(int)).tolist()
    return TrainingSet(features, angles, np.repeat(np.arange(len(counts)), counts))


def curve_features(recording: Recording, sideslip: Floats) -> Floats:
    """Return features for the error of a filter with wrong tyres, shape (n, 12) or (n, 15). The error is linear in them.

    The angle at the rear axle is ``b ω / u - α_r``, and the slip angle α_r is a function of the lateral force, which
    depends on the load and so on the forward acceleration. The features are ω / u, powers of the lateral acceleration
    up to the third, products with powers of the forward acceleration, the yaw acceleration, the measured inputs and the
    angle of the filter. Accelerations are means over the last 0.2 s: the sensors of a real car are noisy. With
    wheel speeds there are also the slip of the driven axle and the yaw rates by the wheels of both axles.
    """
    times, speed = recording.times, np.maximum(recording.speed, LOW_SPEED)
    before = times[:, None] - np.linspace(0.0, CURVE_WINDOW, CURVE_SAMPLES)
    side, yaw, along = (
        np.interp(before, times, values).mean(axis=1)
        for values in (
            recording.lateral_acceleration,
            recording.yaw_rate,
            recording.forward_acceleration,
        )
    )
    turning = (
        recording.yaw_rate - np.interp(before[:, -1], times, recording.yaw_rate)
    ) / CURVE_WINDOW
    columns = [
        *(yaw / speed, side, side * np.abs(side), side**3, turning),
        *(along, along * side, along**2 * side),
        *(sideslip, recording.yaw_rate, recording.steering, speed),
    ]
    if recording.wheel_speeds is not None:
        left, right, rear_left, rear_right = (recording.wheel_speeds / speed[:, None]).T
        columns += [rear_left + rear_right - left - right, right - left, rear_right - rear_left]
    return np.column_stack(columns)


class Scale:
    """Standardisation of features: subtraction of the mean, and division. Constant features become 0.

    If `each`, each feature is divided by its own deviation. Otherwise all are divided by their root mean
    square deviation, which preserves ratios of distances.
    """

    def __init__(self, features: Floats, each: bool = True) -> None:
        self._middle, size = features.mean(axis=0), features.std(axis=0)
        varies = size > CONSTANT * np.abs(features).max(axis=0)
        if not each and varies.any():
            size = np.full_like(size, math.sqrt((size[varies] ** 2).mean()))
        self._size = np.where(varies, size, np.inf)

    def __call__(self, features: Floats) -> Floats:
        """Return the scaled features, shape (n, d)."""
        scaled: Floats = (features - self._middle) / self._size
        return scaled


class KernelRegression:
    """Kernel regression: the mean of all examples, each weighted by a Gaussian of its distance.

    This is the estimator of Nadaraya (Theory of Probability & Its Applications 9, 1964) and Watson
    (Sankhya A 26, 1964), which Specht calls a general regression neural network (IEEE Transactions on
    Neural Networks 2, 1991). Weights are relative to that of the nearest example, so the estimate tends
    to the angle of the nearest example far from all examples.

    The claimed variance is ``c² (s² + r²)``: ``s`` is the weighted standard deviation of the examples'
    angles about the estimate, ``r`` the root mean square error (`error`) in cross-validation over
    drives. The factor ``c`` is set so that 95 % of these errors are within 2 deviations. If the nearest
    example is farther away than for 95 % of the examples in cross-validation, the variance tends to that
    of all angles about the estimate.

    `width` is the deviation of the Gaussian in deviations of the features, or without `scaling` in their
    root mean square deviation; distances then mix rad/s and m/s². None takes the width with the smallest
    squared error in cross-validation. `spread` is the deviation of the training targets, rad.
    """

    def __init__(
        self, examples: TrainingSet, width: float | None = None, scaling: bool = True
    ) -> None:
        self._scale = Scale(examples.features, scaling)
        self._places = self._scale(examples.features)
        self._middle = float(examples.angles.mean())
        self._values = examples.angles - self._middle  # avoids cancellation in variances
        self.spread = float(examples.angles.std())
        self._half = 0.5 * np.einsum("ij,ij->i", self._places, self._places)
        out = left_out(examples.drives)
        scores = self._scores(self._places[out])
        scores[examples.drives[out][:, None] == examples.drives] = -np.inf
        result = best_width(scores, self._values, self._values[out]) if width is None else width
        self.width = result
        mean, spread = weigh(scores, self._values, result)
        off = np.abs(mean - self._values[out])
        self.error = float(np.sqrt((off**2).mean()))
        self._factor = calibrate(off, np.sqrt(spread + self.error**2))
        self._reach = float(np.quantile(self._nearest(self._places[out], scores), WITHIN_TWO))

    def _scores(self, places: Floats) -> Floats:
        """Return minus half the squared distance to each example, up to a constant per row."""
        result: Floats = places @ self._places.T - self._half
        return result

    def _nearest(self, places: Floats, scores: Floats) -> Floats:
        """Return the distance to the nearest example, shape (n,)."""
        result: Floats = np.linalg.norm(places - self._places[scores.argmax(axis=1)], axis=1)
        return result

    def __call__(
        self, features: Floats, stopped: Callable[[], bool] = lambda: False
    ) -> tuple[Floats, Floats, Floats] | None:
        """Return the estimates (rad), their deviations (rad) and the proximity of examples, or None if stopped.

        The proximity is 1 if examples are as near as in cross-validation, and tends to 0 far from all of
        them.
        """
        places = self._scale(features)
        values, deviations, near = np.empty((3, len(places)))
        count = len(self._places)
        rows = max(BLOCK // count, min(ROWS, MOST_TABLE // count), 1)
        for begin in range(0, len(places), rows):
            if stopped():
                return None
            part = slice(begin, begin + rows)
            scores = self._scores(places[part])
            mean, spread = weigh(scores, self._values, self.width)
            beyond = np.maximum(self._nearest(places[part], scores) - self._reach, 0.0)
            known = np.exp(-0.5 * (beyond / max(self.width, self._reach)) ** 2)
            local = self._factor**2 * (spread + self.error**2)
            all_of_them = np.maximum((self._values**2).mean() + mean**2, local)
            values[part], near[part] = mean + self._middle, known
            deviations[part] = np.sqrt(known * local + (1.0 - known) * all_of_them)
        return values, deviations, near


class StraightLine:
    """Linear least squares with a constant, computed in an orthonormal basis of the features.

    The claimed variance is ``c² r² (1 + m h)``: ``r`` is the root mean square error (`error`) in
    cross-validation over drives, ``h`` the leverage of the features and ``m`` the mean number of samples
    per drive, because the errors within a drive are strongly correlated. The factor ``c`` is set so that
    95 % of the errors in cross-validation are within 2 deviations. `spread` is the deviation of the
    training targets, rad.
    """

    def __init__(self, examples: TrainingSet) -> None:
        self._scale = Scale(examples.features)
        ones = self._with_constant(examples.features)
        _, sizes, directions = np.linalg.svd(ones, full_matrices=False)
        significant = sizes > sizes[0] * max(ones.shape) * np.finfo(float).eps
        self._basis = directions[significant].T / sizes[significant]
        rows, angles = ones @ self._basis, examples.angles
        self.spread = float(angles.std())
        self._weights = rows.T @ angles
        off, leverage = np.empty((2, len(rows)))
        for entry in np.unique(examples.drives):
            out = examples.drives == entry
            # The normal matrix of all rows is the identity: subtract that of the rows left out.
            normal = np.eye(rows.shape[1]) - rows[out].T @ rows[out]
            inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
            weights = inverse @ (self._weights - rows[out].T @ angles[out])
            off[out] = np.abs(rows[out] @ weights - angles[out])
            leverage[out] = np.einsum("ij,jk,ik->i", rows[out], inverse, rows[out])
        self._each = len(rows) / len(np.unique(examples.drives))
        self.error = float(np.sqrt((off**2).mean()))
        #: Absolute errors on drives left out, rad, shape (n,).
        self.left_out = off
        self._claims = self._growth(leverage)
        self._deviation = self.error * calibrate(off, self.error * self._claims)

    def recalibrated(self, size: Floats) -> float:
        """Return the factor on deviations that are also multiplied by a size, which is given for each example."""
        return calibrate(self.left_out, self._claims * size) / max(self._deviation, 1e-300)

    def _with_constant(self, features: Floats) -> Floats:
        return np.column_stack([np.ones(len(features)), self._scale(features)])

    def _growth(self, leverage: Floats) -> Floats:
        return np.sqrt(1.0 + self._each * leverage)

    def __call__(self, features: Floats) -> tuple[Floats, Floats]:
        """Return the estimates and their standard deviations, rad, shapes (n,)."""
        rows = self._with_constant(features) @ self._basis
        leverage = np.einsum("ij,ij->i", rows, rows)
        return rows @ self._weights, self._deviation * self._growth(leverage)


def relative_size(errors: Floats, speed: Floats) -> Callable[[Floats], Floats]:
    """Return the size of absolute errors (rad) as a function of the speed (m/s), relative to the mean.

    The function ``c + d / u`` with ``c, d >= 0`` is fitted by least squares: a constant error of the lateral speed causes
    an error of the angle that is inverse to the forward speed. It is 1 if all errors are 0.
    """
    from scipy.optimize import nnls

    def terms(values: Floats) -> Floats:
        return np.column_stack([np.ones(len(values)), 1.0 / np.maximum(values, LOW_SPEED)])

    weights, _ = nnls(terms(speed), errors)
    mean = float((terms(speed) @ weights).mean())
    return lambda values: terms(values) @ weights / mean if mean > 0.0 else np.ones(len(values))


def calibrate(errors: Floats, claimed: Floats) -> float:
    """Return the factor on the claimed deviations with 95 % of the errors within 2 of them."""
    ratios = np.divide(errors, 2.0 * claimed, out=np.zeros_like(errors), where=claimed > 0.0)
    return float(np.quantile(ratios, WITHIN_TWO))


def left_out(drives: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of the validation examples, evenly spaced in each drive."""
    most = min(MOST_LEFT_OUT, max(MOST_TABLE // len(drives), 10))
    stride = -(-len(drives) // most)
    places = [np.flatnonzero(drives == entry) for entry in np.unique(drives)]
    result = np.concatenate([entry[len(entry) % stride // 2 :: stride] for entry in places])
    return result[:: -(-len(result) // most)]  # drives may outnumber `most`


def best_width(scores: Floats, values: Floats, targets: Floats) -> float:
    """Return the kernel width with the least squared error, by grid search and refinement."""
    from scipy.optimize import minimize_scalar

    # Single precision is twice as fast and more accurate than the tolerance of the width.
    table, known = scores.astype(np.float32), values.astype(np.float32)

    def error(logarithm: float) -> float:
        mean, _ = weigh(table, known, math.exp(logarithm))
        return float(((mean - targets) ** 2).mean())

    grid = np.linspace(math.log(NARROWEST), math.log(WIDEST), GRID)
    errors = [error(entry) for entry in grid]
    best = int(np.argmin(errors))
    step = grid[1] - grid[0]
    result = minimize_scalar(
        error, bounds=(grid[best] - step, grid[best] + step), method="bounded",
        options={"xatol": ACCURACY},
    )  # fmt: skip
    return float(math.exp(result.x if result.fun < errors[best] else grid[best]))


def weigh(scores: Any, values: Any, width: float) -> tuple[Floats, Floats]:
    """Return the kernel-weighted means of the values and the variances about them, shapes (n,)."""
    weights = scores - scores.max(axis=1, keepdims=True)
    weights /= width**2
    np.exp(weights, out=weights)
    total, first, second = (weights @ np.stack([np.ones_like(values), values, values**2], 1)).T
    mean = first / total
    return mean, np.maximum(second / total - mean**2, 0.0)
