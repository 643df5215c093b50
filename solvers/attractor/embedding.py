"""Choice of an embedding: delays from the memory of a series, and the number of coordinates from neighbours.

Sources: A. M. Fraser and H. L. Swinney, "Independent coordinates for strange attractors from mutual
information", Physical Review A 33, 1986; H. Kantz and T. Schreiber, "Nonlinear Time Series Analysis", 2004,
section 3.3; L. Cao, "Practical method for determining the minimum embedding dimension of a scalar time series",
Physica D 110, 1997; M. B. Kennel, R. Brown and H. D. I. Abarbanel, "Determining embedding dimension for
phase-space reconstruction using a geometrical construction", Physical Review A 45, 1992.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "LARGEST",
    "autocorrelation",
    "cao_curves",
    "cao_dimension",
    "decorrelation",
    "false_shares",
    "first_minimum",
    "first_zero",
    "largest_dimension",
    "longest",
    "mean_period",
    "mutual_information",
    "nearest",
    "saturated",
    "standardised",
    "states_of",
    "thin_out",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of pairs for a mutual information, and of bins of a histogram.
_PAIRS, _BINS = 50_000, 32
#: Number of lags that are all tried. Beyond it, each lag is 1 % longer than the one before.
_EACH = 200
#: Standard deviations, and share of the decrease so far, by which a curve must rise after its minimum.
_SURE, _RISE = 3.0, 0.02


def longest(count: int) -> int:
    """Return the longest delay for `count` samples, a tenth of them."""
    return max(count // 10, 1)


def standardised(series: Floats) -> Floats:
    """Return the series with mean 0 and deviation 1, for values of any size."""
    low = series.min()
    values: Floats = (series - low) / (series.max() - low)
    values -= values.mean()
    values /= values.std()
    return values


def transform_length(least: int) -> int:
    """Return the smallest product of 1, 3, 5 or 9 and a power of 2 that is at least `least`."""
    return min(factor << max((least - 1) // factor, 0).bit_length() for factor in (1, 3, 5, 9))


def autocorrelation(series: Floats, lags: int) -> Floats:
    """Return the autocorrelation at the lags 0 … `lags`, shape (lags + 1,), each sum divided by that of lag 0."""
    x = standardised(series)
    size = transform_length(len(x) + lags)
    result: Floats = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: lags + 1]
    result /= result[0]
    return result


def decorrelation(series: Floats, level: float) -> int:
    """Return the first lag with an autocorrelation of at most `level`, limited to a tenth of the samples."""
    largest = longest(len(series))
    below = autocorrelation(series, largest)[1:] <= level
    return int(below.argmax()) + 1 if below.any() else largest


def first_zero(series: Floats) -> int:
    """Return the first lag, up to a tenth of the samples, at which the autocorrelation is insignificant.

    The limit is 1.96 / √n, because the sign of noise is random. Otherwise every other map would get a delay
    above 1.
    """
    return decorrelation(series, 1.96 / math.sqrt(len(series)))


def mean_period(series: Floats) -> float:
    """Return the reciprocal of the mean frequency of the power spectrum, in samples (Rosenstein et al. 1993)."""
    power = np.abs(np.fft.rfft(standardised(series))) ** 2
    return float(power.sum() / (power @ np.fft.rfftfreq(len(series))))


def _ranked(series: Floats, bins: int) -> Ints:
    """Return the bin of each value, for bins with equal numbers of values; equal values share a bin."""
    series = np.round(standardised(series), 9)  # values that differ by rounding are equal
    edges = np.unique(np.quantile(series, np.arange(1, bins) / bins))
    return np.searchsorted(edges, series, side="right")


def mutual_information(series: Floats, lags: Ints) -> tuple[Floats, float, float]:
    """Return the mutual information of values one lag apart, its standard deviation, and the entropy, in nats.

    It is computed for each lag from a histogram whose bins hold equal numbers of values, so that no
    monotone transform changes it. At most 50 000 pairs are used, and the mean of independent values is
    subtracted. The deviation is that of independent values: twice the pairs times the information is
    χ²-distributed with (bins - 1)² degrees of freedom.
    """
    count = len(series) - int(lags.max())
    at = thin_out(count, _PAIRS)
    bins = min(max(math.isqrt(len(at) // 5), 3), _BINS)
    code = _ranked(series, bins)
    bins = int(code.max()) + 1
    first = code[at] * bins
    result = np.empty(len(lags))
    for k, lag in enumerate(lags.tolist()):
        share = np.bincount(first + code[at + lag], minlength=bins**2).reshape(bins, bins) / len(at)
        alone = share.sum(axis=1)[:, None] * share.sum(axis=0)
        occupied = share > 0
        result[k] = (share[occupied] * np.log(share[occupied] / alone[occupied])).sum()
    alone = np.bincount(code) / len(code)
    entropy = -float((alone[alone > 0] * np.log(alone[alone > 0])).sum())
    bias = (bins - 1) ** 2 / (2 * len(at))
    return result - bias, (bins - 1) / (math.sqrt(2) * len(at)), entropy


def lags_up_to(most: int) -> Ints:
    """Return the lags to try, ascending, ending with `most`."""
    if most <= _EACH:
        return np.arange(1, most + 1)
    steps = math.ceil(math.log(most / _EACH) / math.log(1.01))
    longer = np.geomspace(_EACH, most, steps + 1).round().astype(np.int64)
    return np.unique(np.concatenate([np.arange(1, _EACH), longer]))


def first_minimum(series: Floats) -> tuple[int, bool]:
    """Return the first minimum of the mutual information, and whether it is below the first zero of the autocorrelation.

    A minimum must be followed by a significant rise, and be less than half of the entropy of a value,
    because the curve of a periodic series follows its bins. The information of maps and of noise decreases
    without a minimum; then the first zero is returned.
    """
    most = first_zero(series)
    # A little further, to detect the rise.
    lags = lags_up_to(min(most + max(most // 4, 2), longest(len(series))))
    result, deviation, entropy = mutual_information(series, lags)
    low = 0
    for k in range(1, len(lags)):
        if result[k] < result[low]:
            low = k
        elif result[low] < entropy / 2 and result[k] - result[low] > max(
            _SURE * deviation, _RISE * (result[0] - result[low])
        ):
            return min(int(lags[low]), most), bool(lags[low] <= most)
    return most, False


#: Default of the largest dimension.
LARGEST = 10
#: Largest number of states among which neighbours are searched, and of states whose neighbours are searched.
_AMONG, _ASKED = 20_000, 2_000
#: Value of Cao's E₁ at which it is saturated; the limit is 1.
_SATURATED = 0.9
#: Kennel's tolerances: relative growth of a distance, and distance in deviations of the series.
_RATIO, _ATTRACTOR = 15.0, 2.0
#: Number of neighbours in the first query, and largest number, above which a state has no neighbour.
_FIRST, _MOST = 4, 1024
#: Fractional part of the golden ratio, whose multiples do not synchronise with any period.
_GOLDEN = 0.6180339887498949
#: Distance relative to the extent of the states that is due to rounding.
_SAME = 1e-10


def thin_out(count: int, most: int) -> Ints:
    """Return at most `most` of the numbers 0 … count - 1, ascending, one from each of equal stretches.

    The position within a stretch follows the multiples of the golden ratio, because an even step would see
    a periodic series at few phases only.
    """
    if count <= most:
        return np.arange(count)
    k = np.arange(most)
    return np.floor((k + k * _GOLDEN % 1.0) * (count / most)).astype(np.int64)


def states_of(series: Floats, at: Ints, delay: int, dimension: int) -> Floats:
    """Return the states that begin at the given samples, shape (len(at), dimension)."""
    result: Floats = series[at[:, None] + delay * np.arange(dimension)]
    return result


def nearest(
    states: Floats, times: Ints, rows: Ints, theiler: int, norm: float = np.inf
) -> tuple[Ints, Floats]:
    """Return the nearest distinct state of each given state that is not near in time, and its distance.

    `states`, shape (m, d), have ascending `times`. States at most `theiler` samples apart are not
    neighbours, nor are those within 1e-10 of the extent of the states. The norm is infinity or 2. Without a
    neighbour the index is -1, and the distance infinite.
    """
    from scipy.spatial import KDTree

    same = _SAME * float(np.ptp(states))
    # A tree of equal states cannot be split, so it contains one of each group of equal states. The first
    # and the last state of a group show whether any is distant in time.
    first, last = _repeats(states)
    tree = KDTree(states[first])
    result = np.full(len(rows), -1)
    apart = np.full(len(rows), np.inf)
    left, count = np.arange(len(rows)), _FIRST
    while left.size and count <= _MOST:
        mine = rows[left]
        far, who = tree.query(states[mine], range(1, min(count, len(first)) + 1), p=norm)
        early, late = first[who], last[who]
        before = np.abs(times[early] - times[mine][:, None]) > theiler
        good = (before | (np.abs(times[late] - times[mine][:, None]) > theiler)) & (far > same)
        some = good.any(axis=1)
        best = good[some].argmax(axis=1)[:, None]
        which = np.where(before, early, late)[some]
        result[left[some]] = np.take_along_axis(which, best, 1)[:, 0]
        apart[left[some]] = np.take_along_axis(far[some], best, 1)[:, 0]
        left = left[~some] if count < len(first) else left[:0]
        count *= 4
    return result, apart


def _repeats(states: Floats) -> tuple[Ints, Ints]:
    """Return the first and the last index of each group of equal states."""
    every = np.arange(len(states))
    if len(np.unique(states[:, 0])) == len(states):
        return every, every
    _, group = np.unique(states, axis=0, return_inverse=True)
    group = group.ravel()
    first, last = np.full((2, int(group.max()) + 1), -1)
    last[group] = every
    first[group[::-1]] = every[::-1]
    return first, last


def largest_dimension(count: int, delay: int, most: int = LARGEST) -> int:
    """Return the largest dimension up to `most` whose states span no more than half of `count` samples."""
    return max(min(most, count // 2 // delay), 1)


def neighbour_growth(
    series: Floats, delay: int, dimension: int, theiler: int, norm: float
) -> tuple[Floats, Floats]:
    """Return the distances of nearest neighbours, and their differences in the next coordinate.

    At most 2000 states have neighbours among at most 20 000; states without one are omitted.
    """
    at = thin_out(len(series) - dimension * delay, _AMONG)
    states = states_of(series, at, delay, dimension + 1)
    rows = thin_out(len(at), _ASKED)
    result, apart = nearest(states[:, :dimension], at, rows, theiler, norm)
    good = result >= 0
    return apart[good], np.abs(states[rows[good], -1] - states[result[good], -1])


def cao_curves(
    series: Floats, delay: int, most: int, theiler: int | None = None
) -> tuple[Floats, Floats]:
    """Return Cao's E₁ and E₂ of the dimensions 1 … `most`; NaN if all neighbours have distance 0.

    E(d) is the mean growth of the distance of nearest neighbours from d to d + 1 coordinates, and E₁(d) =
    E(d + 1) / E(d). E₂ is the same for the distance of the new coordinates alone: 1 in every dimension for
    noise. Neighbours are more than `theiler` samples, by default a delay, apart in time, because neighbours
    on the same piece of a trajectory do not show its folds. Dimensions that span the series are NaN.
    """
    grows, moves = np.full(most + 1, np.nan), np.full(most + 1, np.nan)
    for k in range(min(most + 1, (len(series) - 1) // delay)):
        apart, new = neighbour_growth(
            series, delay, k + 1, delay if theiler is None else theiler, np.inf
        )
        if new.size:
            grows[k] = np.maximum(new / apart, 1.0).mean()
            moves[k] = new.mean()
    with np.errstate(all="ignore"):
        return grows[1:] / grows[:-1], moves[1:] / moves[:-1]


def cao_dimension(series: Floats, delay: int) -> int:
    """Return the smallest dimension at which Cao's E₁ is at least 0.9, and at the next dimension, too.

    If the curve does not saturate, it is the largest dimension tried, 10 or fewer for a short series.
    """
    most = largest_dimension(len(series), delay)
    return saturated(cao_curves(series, delay, most)[0])


def saturated(curve: Floats) -> int:
    """Return the first dimension at which `curve` is at least 0.9, and at the next one, too; else the last.

    Later dips are ignored, because short series have no near neighbours in many dimensions.
    """
    is_saturated = np.append(curve >= _SATURATED, True)
    stays_saturated = is_saturated[:-1] & is_saturated[1:]
    return int(stays_saturated.argmax()) + 1 if stays_saturated.any() else len(curve)


def false_shares(series: Floats, delay: int, most: int, theiler: int) -> Floats:
    """Return the share of false nearest neighbours of the dimensions 1 … `most`; NaN without neighbours.

    A neighbour is false if the next coordinates differ by more than 15 times the distance, or if the
    distance with them exceeds two deviations of the series.
    """
    shares = np.full(most, np.nan)
    size = float(series.std())
    for k in range(most):
        apart, new = neighbour_growth(series, delay, k + 1, theiler, 2)
        if new.size:
            far = np.hypot(new, apart) > _ATTRACTOR * size
            shares[k] = (far | (new > _RATIO * apart)).mean()
    return shares
