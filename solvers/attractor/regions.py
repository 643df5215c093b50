"""Choice of a scaling region: the longest stretch of a curve with a steady slope."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Stretches", "line_slopes", "steady_stretches", "whole_slope"]

Floats = NDArray[np.float64]

#: Largest number of points of a curve at which a region may begin or end.
PLACES = 160


def line_slopes(x: Floats, y: Floats, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Floats:
    """Return the least-squares slopes of stretches of a curve from the points `begin` to `end`, inclusive."""
    with np.errstate(all="ignore"):  # a curve with an infinite value has no slope
        x, y = x - x.mean(), y - y.mean()
        sums = [np.concatenate(([0.0], np.cumsum(part))) for part in (x, y, x * x, x * y)]
        sx, sy, sxx, sxy = (part[end + 1] - part[begin] for part in sums)
        count = end + 1 - begin
        slopes: Floats = (sxy - sx * sy / count) / (sxx - sx * sx / count)
    return slopes


def whole_slope(x: Floats, y: Floats, left_out: Floats) -> tuple[float, float]:
    """Return the least-squares slope of a whole curve, and its standard deviation.

    States near in time are similar, so the deviation is that of the jackknife over blocks of time:
    `left_out`, shape (blocks, k), is the curve without the states of each block. Half the difference of the
    slopes of the two halves is added in squares.
    """
    first, last = np.array([0]), np.array([len(x) - 1])
    slopes = np.array([line_slopes(x, curve, first, last)[0] for curve in left_out])
    slopes = slopes[np.isfinite(slopes)]
    between = (len(slopes) - 1) * float(slopes.var()) if len(slopes) > 1 else 0.0
    middle, bend = (len(x) - 1) // 2, 0.0
    if middle > 0:
        halves = line_slopes(x, y, np.array([0, middle]), np.array([middle, len(x) - 1]))
        bend = float(halves[1] - halves[0]) / 2
    return float(line_slopes(x, y, first, last)[0]), math.hypot(math.sqrt(between), bend)


@dataclass(frozen=True, eq=False)
class Stretches:
    """Stretches of a curve with a steady slope: first and last points, slopes, and scores.

    The score is the length of a stretch reduced by its bend.
    """

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    slopes: Floats
    scores: Floats

    @property
    def best(self) -> tuple[int, int] | None:
        """First and last point of the stretch with the highest score, None without a stretch."""
        if not self.scores.size:
            return None
        k = int(self.scores.argmax())
        return int(self.begin[k]), int(self.end[k])

    @property
    def spread(self) -> float:
        """Root mean square difference of the slopes from that of the best stretch, weighted by the scores."""
        weights = self.scores.clip(0.0)
        if not weights.sum() > 0:
            return 0.0
        apart = self.slopes - self.slopes[self.scores.argmax()]
        return math.sqrt(float((weights * apart**2).sum() / weights.sum()))


def steady_stretches(
    x: Floats,
    y: Floats,
    *,
    least: int,
    rise: float,
    change: float,
    from_first: bool = False,
    to_last: bool = False,
) -> Stretches:
    """Return the stretches of a finite curve with a steady slope, none if no stretch is acceptable.

    Each stretch is cut into halves, each fitted by a line. A stretch has at least `least` points, `y`
    increases along its line by at least `rise`, and the slopes of its halves differ by at most `change`,
    relative to that of the whole. It begins at the first point if `from_first`, and ends at the last one if
    `to_last`.
    """
    places = np.unique(np.linspace(0, len(x) - 1, PLACES).round().astype(np.int64))
    begin, end = (part.ravel() for part in np.meshgrid(places, places, indexing="ij"))
    wide = end - begin >= max(least, 4) - 1
    if from_first:
        wide &= begin == 0
    if to_last:
        wide &= end == len(x) - 1
    begin, end = begin[wide], end[wide]
    middle = (begin + end) // 2
    whole = line_slopes(x, y, begin, end)
    first, second = line_slopes(x, y, begin, middle), line_slopes(x, y, middle, end)
    with np.errstate(all="ignore"):
        differs = np.abs(second - first) / np.abs(whole)
    length = x[end] - x[begin]
    fits = (differs <= change) & (whole * length >= rise)
    # A shorter and steadier stretch may be better, so a bend reduces the score.
    scores = length[fits] * (1.0 - differs[fits] / change)
    return Stretches(begin[fits], end[fits], whole[fits], scores)
