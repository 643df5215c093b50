"""Memory of a series: autocorrelation, mutual information, and the delays derived from them.

Sources: A. M. Fraser and H. L. Swinney, "Independent coordinates for strange attractors from mutual
information", Physical Review A 33, 1986; H. Kantz and T. Schreiber, "Nonlinear Time Series Analysis", 2004,
section 3.3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .unfolding import thin_out

__all__ = [
    "autocorrelation",
    "decorrelation",
    "first_minimum",
    "first_zero",
    "longest",
    "mean_period",
    "minimum_of_information",
    "mutual_information",
    "standardised",
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


def autocorrelation(series: Floats, lags: int) -> Floats:
    """Return the autocorrelation at the lags 0 … `lags`, shape (lags + 1,), each sum divided by that of lag 0."""
    from scipy import fft

    x = standardised(series)
    size = fft.next_fast_len(len(x) + lags, real=True)
    result: Floats = fft.irfft(np.abs(fft.rfft(x, size)) ** 2, size)[: lags + 1]
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
        held = share > 0
        result[k] = (share[held] * np.log(share[held] / alone[held])).sum()
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


def first_minimum(series: Floats) -> int:
    """Return the first minimum of the mutual information, at most the first zero of the autocorrelation.

    A minimum must be followed by a significant rise, and be less than half of the entropy of a value,
    because the curve of a periodic series follows its bins. The information of maps and of noise decreases
    without a minimum; then the first zero is returned.
    """
    return minimum_of_information(series)[0]


def minimum_of_information(series: Floats) -> tuple[int, bool]:
    """Return :func:`first_minimum`, and whether it is a minimum of the mutual information."""
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
