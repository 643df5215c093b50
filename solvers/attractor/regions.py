"""The choice of a scaling region: the longest stretch of a curve whose slope stays the same."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["line_slopes", "steadiest", "whole_slope"]

Floats = NDArray[np.float64]

#: Places along a curve at which a region may begin or end, at the most.
PLACES = 160


def line_slopes(x: Floats, y: Floats, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Floats:
    """Return the least-squares slopes of stretches of a curve, their last points included.

    Parameters
    ----------
    x, y : ndarray, shape (k,)
        The curve.
    begin, end : ndarray
        Indices of the first and the last point, broadcast.
    """
    with np.errstate(all="ignore"):  # a curve that holds an infinite value has no slope
        x, y = x - x.mean(), y - y.mean()
        sums = [np.concatenate(([0.0], np.cumsum(part))) for part in (x, y, x * x, x * y)]
        sx, sy, sxx, sxy = (part[end + 1] - part[begin] for part in sums)
        count = end + 1 - begin
        found: Floats = (sxy - sx * sy / count) / (sxx - sx * sx / count)
    return found


def whole_slope(x: Floats, y: Floats, left_out: Floats) -> tuple[float, float]:
    """Return the least-squares slope of a whole curve, and its standard deviation.

    States that are near in time are alike, so the deviation is that of the jackknife over blocks of time, to which half
    the difference of the slopes within the halves of the curve is added in squares.

    Parameters
    ----------
    x, y : ndarray, shape (k,)
        The curve.
    left_out : ndarray, shape (blocks, k)
        The same curve without the states of each block.
    """
    first, last = np.array([0]), np.array([len(x) - 1])
    slopes = np.array([line_slopes(x, one, first, last)[0] for one in left_out])
    slopes = slopes[np.isfinite(slopes)]
    between = (len(slopes) - 1) * float(slopes.var()) if len(slopes) > 1 else 0.0
    middle, bend = (len(x) - 1) // 2, 0.0
    if middle > 0:
        halves = line_slopes(x, y, np.array([0, middle]), np.array([middle, len(x) - 1]))
        bend = float(halves[1] - halves[0]) / 2
    return float(line_slopes(x, y, first, last)[0]), math.hypot(math.sqrt(between), bend)


def steadiest(
    x: Floats,
    y: Floats,
    *,
    least: int,
    rise: float,
    change: float,
    from_first: bool = False,
    to_last: bool = False,
) -> tuple[int, int] | None:
    """Return the stretch of a curve that is longest among those whose slope stays the same.

    Each stretch is cut into halves, each fitted by a line.

    Parameters
    ----------
    x, y : ndarray, shape (k,)
        The curve; all finite.
    least : int
        Points of a stretch.
    rise : float
        Of `y` by the line over the stretch at the least.
    change : float
        How much the slopes of the halves may differ, relative to that of the whole, at the most.
    from_first, to_last : bool
        Whether only stretches from the first point on, or up to the last one, count.

    Returns
    -------
    tuple of int, optional
        The first and the last point; None where no stretch will do.
    """
    places = np.unique(np.linspace(0, len(x) - 1, PLACES).round().astype(np.int64))
    begin, end = (part.ravel() for part in np.meshgrid(places, places, indexing="ij"))
    wide = end - begin >= max(least, 4) - 1
    if from_first:
        wide &= begin == 0
    if to_last:
        wide &= end == len(x) - 1
    begin, end = begin[wide], end[wide]
    if not begin.size:
        return None
    middle = (begin + end) // 2
    whole = line_slopes(x, y, begin, end)
    first, second = line_slopes(x, y, begin, middle), line_slopes(x, y, middle, end)
    with np.errstate(all="ignore"):
        differs = np.abs(second - first) / np.abs(whole)
    length = x[end] - x[begin]
    fits = (differs <= change) & (whole * length >= rise)
    if not fits.any():
        return None
    # A shorter stretch that is steadier may be the better: its length counts less, the more it bends.
    score = np.where(fits, length * (1.0 - differs / change), -np.inf)
    best = int(score.argmax())
    return int(begin[best]), int(end[best])
