"""Curves of an embedding computed pair by pair: slow, plain, and independent of the solvers' neighbour search."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .plan import Method, Slope

__all__ = ["RADII", "Sample", "prediction_error"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Number of states up to which all are used, and largest and smallest size of a sample of more states.
ALL, SOME, FEW = 1500, 500, 50
#: Number of coordinate differences that a curve may compute, which limits the sample; and that of one block.
WORK, BLOCK = 100_000_000, 200_000
#: Number of logarithmically spaced radii of a correlation sum for its slope.
RADII = 16
#: Largest number of neighbours within a radius that are followed, evenly chosen, for a sample of states.
NEAR = 2000
#: Relative difference below which squared distances are equal.
TIE = 1e-9


class Sample:
    """States of an embedding, all or a random sample, with their distances from all others.

    States at most `theiler` samples apart are not neighbours. Up to `most` states, all are used.
    """

    def __init__(self, states: Floats, theiler: int, seed: int, most: int = ALL) -> None:
        self.states, self.theiler, self.seed, self.most = states, theiler, seed, most

    @property
    def whole(self) -> bool:
        """Whether all states are used."""
        return len(self.states) <= self.most

    def taken(self, last: int) -> Ints:
        """Return the indices of the sample among the first `last` states."""
        if self.whole:
            return np.arange(last)
        count = min(max(WORK // self.states.size, FEW), SOME, last)
        return np.sort(np.random.default_rng(self.seed).choice(last, count, replace=False))

    def blocks(self, last: int, *, largest: bool) -> Iterator[tuple[Ints, Floats]]:
        """Yield states of the sample and their distances from the first `last`, infinite if near in time.

        The distance is the `largest` difference of a coordinate, or else the sum of squares.
        """
        taken, columns = self.taken(last), np.ascontiguousarray(self.states[:last].T)
        count = max(BLOCK // last, 1)
        apart = np.empty((min(count, len(taken)), last))
        for start in range(0, len(taken), count):
            some = taken[start : start + count]
            result, apart = np.zeros((len(some), last)), apart[: len(some)]
            for column in columns:
                np.subtract(column[some, None], column, out=apart)
                if largest:
                    np.maximum(result, np.abs(apart, out=apart), out=result)
                else:
                    result += np.square(apart, out=apart)
            for row, i in enumerate(some.tolist()):
                result[row, max(i - self.theiler, 0) : i + self.theiler + 1] = np.inf
            yield some, result

    def slope(self, slope: Slope, period: float) -> tuple[float, float, float]:
        """Return the slope of a curve within a region, its uncertainty, and the width of the region.

        The uncertainty is the standard error if a sample is used, or if neighbours are equally near, and 0
        otherwise. The slope is NaN if the region is empty.
        """
        if not slope.method.is_exponent:
            count = 2 if slope.method is Method.TWO_POINTS else RADII
            radii = np.geomspace(slope.low, slope.high, count)
            x, tied = np.log(radii), False
            if slope.method is Method.CORRELATION:
                rows = self._counts(radii)
            else:  # equations 15 and 16: each state is within any radius of itself, and theta(0) = 0
                rows = self._counts(np.nextafter(radii, 0.0)) + 1.0
        else:
            low, high = int(slope.low), int(slope.high)
            ahead = np.arange(low, high + 1)
            x = ahead * period
            rows, tied = self._partings(slope, ahead)
        read = np.asarray if slope.method.is_exponent else np.log
        width = float(x[-1] - x[0])
        rows = rows[np.isfinite(rows).any(axis=1)]
        if not len(rows):
            return np.nan, np.nan, width
        weights = (x - x.mean()) / ((x - x.mean()) ** 2).sum()
        with np.errstate(all="ignore"):
            result = float(read(np.nanmean(rows, axis=0)) @ weights)
            if self.whole and not tied:
                return result, 0.0, width
            # The jackknife, which leaves out each state once.
            count = np.isfinite(rows).sum(axis=0)
            others = (np.nansum(rows, axis=0) - np.nan_to_num(rows)) / (count - np.isfinite(rows))
            slopes = read(others) @ weights
            error = float(np.sqrt((len(rows) - 1) * slopes.var()))
        return result, error, width

    def _counts(self, radii: Floats) -> Floats:
        """Return the number of states within each radius of every state of the sample."""
        result = [
            np.stack([(apart <= r).sum(axis=1) for r in radii], axis=1)
            for _, apart in self.blocks(len(self.states), largest=True)
        ]
        return np.concatenate(result).astype(float)

    def divergence(self, slope: Slope, ahead: Ints) -> Floats:
        """Return the curve of an exponent: the mean logarithm of the distance from neighbours by steps `ahead`.

        The method of `slope` selects the neighbours. Logarithms are in the unit of the series, NaN without
        neighbours.
        """
        rows, _ = self._partings(slope, ahead)
        rows = rows[np.isfinite(rows).any(axis=1)]
        count = np.isfinite(rows).sum(axis=0)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.nansum(rows, axis=0) / count)

    def sums(self, radii: Floats) -> Floats:
        """Return the correlation sums, the share of pairs of states within each radius, shape (k,)."""
        last, taken = len(self.states), self.taken(len(self.states))
        near = np.minimum(taken + self.theiler, last - 1) - np.maximum(taken - self.theiler, 0) + 1
        pairs = float((last - near).sum())
        result = self._counts(radii).sum(axis=0)
        return result / pairs if pairs else np.full(len(radii), np.nan)

    def reach(self) -> tuple[float, float]:
        """Return an estimate of the smallest positive distance between states, and an upper bound of all."""
        _, apart = next(self.blocks(len(self.states), largest=True))
        most = float(np.ptp(self.states, axis=0).max())
        return float(apart[apart > 0].min(initial=most)), most

    def _partings(self, slope: Slope, ahead: Ints) -> tuple[Floats, bool]:
        """Return the log distances from neighbours some steps `ahead`, and whether any were tied.

        The distances have one row per state of the sample. Two nearest neighbours at the same distance are
        tied.
        """
        last = len(self.states) - int(ahead[-1])
        if last < 2:
            return np.full((0, len(ahead)), np.nan), False
        most = max(BLOCK // (len(ahead) * self.states.shape[1]), 1)
        result, tied = [], False
        for some, squares in self.blocks(last, largest=False):
            squares[squares == 0] = np.inf  # equal states never diverge
            for i, row in zip(some.tolist(), squares, strict=True):
                if slope.radius is None:
                    nearest = int(row.argmin())
                    if not np.isfinite(row[nearest]):
                        continue
                    tied |= int((row <= row[nearest] * (1 + TIE)).sum()) > 1
                    near = np.array([nearest])
                else:
                    near = np.flatnonzero(row <= slope.radius**2)
                    if not self.whole:
                        near = near[:: -(-near.size // NEAR) or 1]
                if not near.size:
                    continue
                total = np.zeros(len(ahead))
                for start in range(0, near.size, most):
                    there = near[start : start + most, None] + ahead
                    moved = self.states[there] - self.states[i + ahead]
                    total += np.sqrt((moved**2).sum(axis=2)).sum(axis=0)
                with np.errstate(divide="ignore"):
                    result.append(np.where(total > 0, np.log(total / near.size), np.nan))
        return np.array(result).reshape(-1, len(ahead)), tied


def prediction_error(sample: Sample, ahead: int, column: int = -1) -> float:
    """Return the error of predicting a coordinate, by default the last, by the nearest state, in its deviations.

    Prediction by a random state has the error 1. States at most the Theiler window apart are not neighbours.
    """
    last = len(sample.states) - ahead
    if last < 2:
        return 1.0
    errors = []
    for some, apart in sample.blocks(last, largest=True):
        near = apart.argmin(axis=1)
        good = np.isfinite(apart[np.arange(len(some)), near])
        moved = sample.states[some + ahead, column] - sample.states[near + ahead, column]
        errors.append(moved[good])
    values = np.concatenate(errors)
    # Two random values differ by √2 times their deviation.
    spread = float(sample.states.std()) * np.sqrt(2.0)
    return float(np.sqrt((values**2).mean()) / spread) if values.size else 1.0
