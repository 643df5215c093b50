"""Slopes of curves: the choice of a scaling region, and stated deviations.

A region is the longest stretch of a curve with a steady slope. The jackknife of a slope measures the sample
only. The error that matters is usually that of the region and the embedding, so the deviation adds in squares

- the jackknife and half the difference of the slopes within the halves of the region (:func:`whole_slope`),
- the spread of the slopes of all regions that were acceptable (:attr:`Stretches.spread`),
- the root mean square difference of the slopes in other embeddings (:func:`variants`),
- the effect of measurement noise: it limits the distance of neighbours, so that the slope is too small,
- a relative and an absolute error that none of these shows: finite distances of neighbours in a finite series.

The constants of the last part are calibrated by ``tests/benchmarks/attractor/coverage.py`` on one set of systems. The
table of the documentation reports the coverage on another set.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.plan import Slope
from .native import Embedding
from .prediction import ROBUST

__all__ = [
    "REFERENCES",
    "Stretches",
    "describe_variants",
    "line_slopes",
    "steady_stretches",
    "variants",
    "whole_slope",
    "widened",
]

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
    def best_slope(self) -> float:
        """Slope of the stretch with the highest score."""
        return float(self.slopes[self.scores.argmax()])

    @property
    def spread(self) -> float:
        """Root mean square difference of the slopes from that of the best stretch, weighted by the scores."""
        weights = self.scores.clip(0.0)
        if not weights.sum() > 0:
            return 0.0
        apart = self.slopes - self.best_slope
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
    wide = end - begin >= max(least, 3) - 1
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


#: Reference states of the curves in other embeddings.
REFERENCES = 500
#: Relative error of the exponent of a map and of a flow, and of a correlation dimension. Neighbours on a flow are also
#: separated along it. This distance does not grow, so that exponents of flows are too small. For Kantz' method the
#: change with the radius shows this error, so the value for maps is used.
MAP_ERROR, FLOW_ERROR, DIMENSION_ERROR = 0.03, 0.08, 0.04
#: Relative error of an exponent per root of the relative noise. It is nearly independent of system and length: with noise of
#: 2 % and 5 % exponents of the calibration systems are too small by a third on average.
NOISE_ERROR = 1.5
#: Smallest number of samples per turn of a flow.
TURN = 6
#: Relative error that is added if no other embedding has a slope: of an exponent, of a dimension.
UNCONFIRMED_EXPONENT, UNCONFIRMED_DIMENSION = 0.10, 0.05
#: Factor of the change of an exponent with half the radius.
RADIUS = 2.0


def variants(embedding: Embedding, count: int) -> Iterator[Embedding]:
    """Yield other embeddings that show the same attractor, if the `count` samples of a series suffice for them.

    They have one and two coordinates more, half the delay, and half the coordinates if there are at least
    six.
    """
    delay, dimension = embedding.delay, embedding.dimension
    other = [(delay, dimension + 1), (delay, dimension + 2)]
    if delay > 1:
        other.append((delay // 2, dimension + 1))
    if dimension >= 6:
        other.append((delay, (dimension + 1) // 2))
    for step, columns in other:
        theiler = max(embedding.theiler, min((columns - 1) * step, count // 10))
        if count - (columns - 1) * step > max(2 * theiler, count // 2):
            yield Embedding(step, columns, theiler)


def describe_variants(slope: Slope, others: Sequence[float]) -> dict[str, float]:
    """Return the statistics of the slopes in other embeddings."""
    return {
        "other embeddings": len(others),
        "least in other embeddings": min(others, default=slope.value),
        "largest in other embeddings": max(others, default=slope.value),
    }


def widened(
    slope: Slope,
    region: float,
    others: Sequence[float],
    *,
    relative: float,
    unconfirmed: float,
    absolute: float = 0.0,
) -> Slope:
    """Return the slope with the deviation that includes all parts.

    `region` is the spread of the slopes of the acceptable regions, and `others` are the slopes in other
    embeddings. The calibrated error is the sum in squares of the share `relative` of the slope and of
    `absolute`. Without others, the share `unconfirmed` of the slope is added.
    """
    squares = [(value - slope.value) ** 2 for value in others if math.isfinite(value)]
    between = unconfirmed * abs(slope.value)
    if squares:
        between = math.sqrt(sum(squares) / len(squares))
        if len(squares) > 2:  # a few embeddings may be wrong
            between = min(between, ROBUST * math.sqrt(float(np.median(squares))))
    parts = slope.deviation, region, between, relative * abs(slope.value), absolute
    return replace(slope, deviation=math.hypot(*parts))
