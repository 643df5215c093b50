"""What estimators that learn share: examples from drives, and a regression by kernels on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ...models.sideslip.data import Recording

__all__ = ["KernelRegression", "Scale", "StraightLine", "TrainingSet", "Window", "training_set"]

Floats = NDArray[np.float64]

#: Share of normal errors within two deviations, at which claimed deviations are calibrated.
WITHIN_TWO = math.erf(2.0 / math.sqrt(2.0))
#: Largest number of examples that are left out in turn. More change the width little, and cost time.
MOST_LEFT_OUT = 300
#: Largest number of entries of a table of examples against examples, which is held in memory.
MOST_TABLE = 2**24
#: Entries of a block of such a table: it stays in a processor's cache.
BLOCK = 2**18
#: Smallest number of rows of a block, unless it fills the memory. Fewer are slow to multiply.
ROWS = 16
#: Widths between which the best one is sought, in deviations of the features.
NARROWEST, WIDEST = 0.02, 5.0
#: Widths of the first search, and the accuracy of the second in the logarithm.
GRID, ACCURACY = 9, 0.05
#: A feature whose deviation is this part of its values is constant but for rounding.
CONSTANT = 1e-9


class Window(NamedTuple):
    """Which measurements an angle is estimated from.

    Parameters
    ----------
    period : float
        Time between two of them, s.
    lags : int
        How many.
    ahead : int
        Periods from the newest of them to the angle: 0 uses the sample itself, 1 is that of the paper.
    inputs : bool
        Whether speed and steering angle count among them; False in the paper.
    """

    period: float
    lags: int = 5
    ahead: int = 0
    inputs: bool = True

    def features(self, recording: Recording) -> Floats:
        """Return the measurements before each sample, shape (n, 2 lags) or (n, 4 lags).

        They are taken at multiples of the period, linear between samples, so that missing samples
        shift nothing. Before the first sample all was as it is there.
        """
        signals = [recording.yaw_rate, recording.lateral_acceleration]
        if self.inputs:
            signals += [recording.speed, recording.steering]
        before = self.period * (self.ahead + np.arange(self.lags))
        instants = recording.times[:, None] - before
        return np.hstack([np.interp(instants, recording.times, one) for one in signals])


class TrainingSet(NamedTuple):
    """Training examples, one per sample.

    Parameters
    ----------
    features : ndarray, shape (n, d)
        Features from which the angle is estimated.
    angles : ndarray, shape (n,)
        The angle, or whatever else is to be estimated, rad.
    drives : ndarray, shape (n,)
        The drive of each, which is left out as a whole.
    """

    features: Floats
    angles: Floats
    drives: NDArray[np.int64]


def training_set(
    training: Iterable[Recording], window: Window, targets: Iterable[Floats] | None = None
) -> TrainingSet:
    """Return the examples of drives where the angle has a meaning.

    Parameters
    ----------
    training : iterable of Recording
        Drives with a known angle.
    window : Window
        Features from which the angle is estimated.
    targets : iterable of ndarray, optional
        Target at each sample of each drive; None takes the angle.

    Returns
    -------
    TrainingSet
        Those of a single drive count as two drives, its halves.
    """
    drives = list(training)
    found: list[Any] = [drive.sideslip for drive in drives] if targets is None else list(targets)
    features = np.vstack([window.features(drive)[drive.moving] for drive in drives])
    angles = np.concatenate([one[drive.moving] for one, drive in zip(found, drives, strict=True)])
    counts = [int(drive.moving.sum()) for drive in drives]
    if len(counts) == 1:
        counts = [counts[0] // 2, counts[0] - counts[0] // 2]
    return TrainingSet(features, angles, np.repeat(np.arange(len(counts)), counts))


class Scale(NamedTuple):
    """The shift and the divisor of each feature; constant features become 0.

    Parameters
    ----------
    middle, size : ndarray, shape (d,)
        Mean and divisor; an infinite divisor if all values are the same.
    """

    middle: Floats
    size: Floats

    @classmethod
    def of(cls, features: Floats, each: bool = True) -> Scale:
        """Return the scale of these features.

        Parameters
        ----------
        features : ndarray, shape (n, d)
            The features.
        each : bool
            Divide each feature by its own deviation, else all by their root mean square deviation, which keeps the
            ratios of distances.
        """
        middle, size = features.mean(axis=0), features.std(axis=0)
        varies = size > CONSTANT * np.abs(features).max(axis=0)
        if not each and varies.any():
            size = np.full_like(size, math.sqrt((size[varies] ** 2).mean()))
        return cls(middle, np.where(varies, size, np.inf))

    def __call__(self, features: Floats) -> Floats:
        """Return the features scaled."""
        return (features - self.middle) / self.size


class KernelRegression:
    """The mean of all examples, each weighted by a Gaussian of its distance.

    This is the estimator of Nadaraya (Theory of Probability & Its Applications 9, 1964) and Watson
    (Sankhya A 26, 1964), which Specht calls a general regression neural network (IEEE
    Transactions on Neural Networks 2, 1991). Weights are formed relative to the nearest example's, so
    far from all examples the estimate tends to that of the nearest one.

    The claimed variance at a place is ``c² (s² + r²)``: ``s`` is the weighted spread of the examples' angles
    about the estimate, ``r`` the root mean square error of drives that are left out, and ``c`` makes
    95 % of these errors lie within 2 deviations. Where the nearest example is farther away than those
    of drives left out are, the variance goes over to that of all angles about the estimate.

    Parameters
    ----------
    examples : TrainingSet
        The training examples.
    width : float, optional
        Deviation of the Gaussian in deviations of the features, or in their root mean square deviation without
        `scaling`; None takes the width with the smallest square error on drives that are left out in turn.
    scaling : bool
        Whether each feature is divided by its own deviation. Without it distances mix the units rad/s and m/s².

    Attributes
    ----------
    width : float
        The width taken.
    error : float
        Root mean square error of drives that are left out, rad.
    spread : float
        Deviation of the angles that were learned, rad.
    """

    def __init__(
        self, examples: TrainingSet, width: float | None = None, scaling: bool = True
    ) -> None:
        self._scale = Scale.of(examples.features, scaling)
        self._places = self._scale(examples.features)
        self._middle = float(examples.angles.mean())
        self._values = examples.angles - self._middle  # spreads cancel least about the mean
        self.spread = float(examples.angles.std())
        self._half = 0.5 * np.einsum("ij,ij->i", self._places, self._places)
        out = left_out(examples.drives)
        scores = self._scores(self._places[out])
        scores[examples.drives[out][:, None] == examples.drives] = -np.inf
        found = best_width(scores, self._values, self._values[out]) if width is None else width
        self.width = found
        mean, spread = weigh(scores, self._values, found)
        off = np.abs(mean - self._values[out])
        self.error = float(np.sqrt((off**2).mean()))
        self._factor = calibrate(off, np.sqrt(spread + self.error**2))
        self._reach = float(np.quantile(self._nearest(self._places[out], scores), WITHIN_TWO))

    def _scores(self, places: Floats) -> Floats:
        """Return what is greater for nearer examples by half the square distances' difference."""
        found: Floats = places @ self._places.T - self._half
        return found

    def _nearest(self, places: Floats, scores: Floats) -> Floats:
        """Return the distance of the nearest example."""
        found: Floats = np.linalg.norm(places - self._places[scores.argmax(axis=1)], axis=1)
        return found

    def __call__(
        self, features: Floats, stopped: Callable[[], bool] = lambda: False
    ) -> tuple[Floats, Floats, Floats] | None:
        """Return the estimate, its deviation and how near examples are, or None where it was stopped.

        All have the shape (n,). The last is 1 where examples are as near as those of drives left out
        were, and tends to 0 far from all of them.
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
            own = self._factor**2 * (spread + self.error**2)
            all_of_them = np.maximum((self._values**2).mean() + mean**2, own)
            values[part], near[part] = mean + self._middle, known
            deviations[part] = np.sqrt(known * own + (1.0 - known) * all_of_them)
        return values, deviations, near


class StraightLine:
    """Least squares with a constant, by way of orthonormal combinations of the features.

    The claimed variance is ``c² r² (1 + m h)``: ``r`` is the root mean square error of drives that are left
    out, ``h`` the leverage of the features, ``m`` the samples of a drive, as errors of one drive are so alike
    that they count as one, and ``c`` makes 95 % of the errors of drives left out lie within 2 deviations.

    Parameters
    ----------
    examples : TrainingSet
        The training examples.

    Attributes
    ----------
    error : float
        Root mean square error of drives that are left out, rad.
    spread : float
        Deviation of the angles that were learned, rad.
    """

    def __init__(self, examples: TrainingSet) -> None:
        self._scale = Scale.of(examples.features)
        ones = self._with_constant(examples.features)
        _, sizes, directions = np.linalg.svd(ones, full_matrices=False)
        kept = sizes > sizes[0] * max(ones.shape) * np.finfo(float).eps
        self._basis = directions[kept].T / sizes[kept]
        rows, angles = ones @ self._basis, examples.angles
        self.spread = float(angles.std())
        self._weights = rows.T @ angles
        off, leverage = np.empty((2, len(rows)))
        for one in np.unique(examples.drives):
            out = examples.drives == one
            # Of orthonormal rows the normal matrix is the identity, and without some it is:
            normal = np.eye(rows.shape[1]) - rows[out].T @ rows[out]
            inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
            weights = inverse @ (self._weights - rows[out].T @ angles[out])
            off[out] = np.abs(rows[out] @ weights - angles[out])
            leverage[out] = np.einsum("ij,jk,ik->i", rows[out], inverse, rows[out])
        self._each = len(rows) / len(np.unique(examples.drives))
        self.error = float(np.sqrt((off**2).mean()))
        self._deviation = self.error * calibrate(off, self.error * self._growth(leverage))

    def _with_constant(self, features: Floats) -> Floats:
        return np.column_stack([np.ones(len(features)), self._scale(features)])

    def _growth(self, leverage: Floats) -> Floats:
        return np.sqrt(1.0 + self._each * leverage)

    def __call__(self, features: Floats) -> tuple[Floats, Floats]:
        """Return the estimate and its deviation, shapes (n,)."""
        rows = self._with_constant(features) @ self._basis
        leverage = np.einsum("ij,ij->i", rows, rows)
        return rows @ self._weights, self._deviation * self._growth(leverage)


def calibrate(errors: Floats, claimed: Floats) -> float:
    """Return the factor by which claimed deviations make 95 % of the errors lie within 2 of them."""
    ratios = np.divide(errors, 2.0 * claimed, out=np.zeros_like(errors), where=claimed > 0.0)
    return float(np.quantile(ratios, WITHIN_TWO))


def left_out(drives: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the examples that are left out with their drives: evenly from each, few of many."""
    most = min(MOST_LEFT_OUT, max(MOST_TABLE // len(drives), 10))
    stride = -(-len(drives) // most)
    places = [np.flatnonzero(drives == one) for one in np.unique(drives)]
    found = np.concatenate([one[len(one) % stride // 2 :: stride] for one in places])
    return found[:: -(-len(found) // most)]  # there may be more drives than that


def best_width(scores: Floats, values: Floats, wanted: Floats) -> float:
    """Return the width of the least square error; the first of a grid's best, then refined."""
    # Numbers of half the size are twice as fast, and right to more digits than a width has.
    table, known = scores.astype(np.float32), values.astype(np.float32)

    def error(logarithm: float) -> float:
        mean, _ = weigh(table, known, math.exp(logarithm))
        return float(((mean - wanted) ** 2).mean())

    grid = np.linspace(math.log(NARROWEST), math.log(WIDEST), GRID)
    errors = [error(one) for one in grid]
    best = int(np.argmin(errors))
    step = grid[1] - grid[0]
    found = minimize_scalar(
        error, bounds=(grid[best] - step, grid[best] + step), method="bounded",
        options={"xatol": ACCURACY},
    )  # fmt: skip
    return float(math.exp(found.x if found.fun < errors[best] else grid[best]))


def weigh(scores: Any, values: Any, width: float) -> tuple[Floats, Floats]:
    """Return the weighted mean of the values and their variance about it, shapes (n,)."""
    weights = scores - scores.max(axis=1, keepdims=True)
    weights /= width**2
    np.exp(weights, out=weights)
    total, first, second = (weights @ np.stack([np.ones_like(values), values, values**2], 1)).T
    mean = first / total
    return mean, np.maximum(second / total - mean**2, 0.0)
