"""How long a series remembers: autocorrelation, mutual information, and the delays that follow.

Sources: A. M. Fraser and H. L. Swinney, "Independent coordinates for strange attractors from mutual
information", Physical Review A 33, 1986; H. Kantz and T. Schreiber, "Nonlinear Time Series Analysis", 2004,
section 3.3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .nearest import thin_out

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

#: Pairs of values at the most of which a mutual information is counted, and a histogram's bins at the most.
_PAIRS, _BINS = 50_000, 32
#: Lags that are all tried; beyond, each is 1 % longer than the one before.
_EACH = 200
#: Standard deviations, and share of the fall so far, by which a curve must rise after its minimum.
_SURE, _RISE = 3.0, 0.02


def longest(count: int) -> int:
    """Return the longest delay of `count` samples: a tenth of them."""
    return max(count // 10, 1)


def standardised(series: Floats) -> Floats:
    """Return the series with mean 0 and deviation 1, whatever the size of its values."""
    low = series.min()
    found: Floats = (series - low) / (series.max() - low)
    found -= found.mean()
    found /= found.std()
    return found


def autocorrelation(series: Floats, lags: int) -> Floats:
    """Return the autocorrelation at the lags 0 … `lags`, each sum divided by the one of lag 0.

    Parameters
    ----------
    series : ndarray, shape (n,)
    lags : int
        Fewer than n.

    Returns
    -------
    ndarray, shape (lags + 1,)
    """
    from scipy import fft

    x = standardised(series)
    size = fft.next_fast_len(len(x) + lags, real=True)
    found: Floats = fft.irfft(np.abs(fft.rfft(x, size)) ** 2, size)[: lags + 1]
    found /= found[0]
    return found


def decorrelation(series: Floats, level: float) -> int:
    """Return the first lag at which the autocorrelation is at most `level`, a tenth of the samples at most."""
    most = longest(len(series))
    below = autocorrelation(series, most)[1:] <= level
    return int(below.argmax()) + 1 if below.any() else most


def first_zero(series: Floats) -> int:
    """Return the first lag at which the autocorrelation is no larger than noise makes it.

    That is 1.96 / √n, as the sign of what noise makes is chance: without it, every other map would get a delay
    of more than 1.

    Parameters
    ----------
    series : ndarray, shape (n,)
        Not constant.

    Returns
    -------
    int
        From 1 to a tenth of the samples.
    """
    return decorrelation(series, 1.96 / math.sqrt(len(series)))


def mean_period(series: Floats) -> float:
    """Return the reciprocal of the mean frequency of the power spectrum, in samples (Rosenstein and others 1993)."""
    power = np.abs(np.fft.rfft(standardised(series))) ** 2
    return float(power.sum() / (power @ np.fft.rfftfreq(len(series))))


def _ranked(series: Floats, bins: int) -> Ints:
    """Return the bin of each value, of bins that hold about equally many; equal values share one."""
    series = np.round(standardised(series), 9)  # what is equal but for rounding is equal
    edges = np.unique(np.quantile(series, np.arange(1, bins) / bins))
    return np.searchsorted(edges, series, side="right")


def mutual_information(series: Floats, lags: Ints) -> tuple[Floats, float, float]:
    """Return the mutual information of values a lag apart, nats, for each lag.

    Of a histogram whose bins hold equally many values each, so that no transform of the values changes it; of
    50 000 pairs at the most, less what independent values would give on average.

    Parameters
    ----------
    series : ndarray, shape (n,)
    lags : ndarray, shape (k,)
        Each at least 1 and less than n.

    Returns
    -------
    information : ndarray, shape (k,)
    deviation : float
        That of independent values: twice the pairs times the information is χ² of (bins - 1)² degrees.
    entropy : float
        What a value says of itself, nats.
    """
    count = len(series) - int(lags.max())
    at = thin_out(count, _PAIRS)
    bins = min(max(math.isqrt(len(at) // 5), 3), _BINS)
    code = _ranked(series, bins)
    bins = int(code.max()) + 1
    first = code[at] * bins
    found = np.empty(len(lags))
    for k, lag in enumerate(lags.tolist()):
        share = np.bincount(first + code[at + lag], minlength=bins**2).reshape(bins, bins) / len(at)
        alone = share.sum(axis=1)[:, None] * share.sum(axis=0)
        held = share > 0
        found[k] = (share[held] * np.log(share[held] / alone[held])).sum()
    alone = np.bincount(code) / len(code)
    entropy = -float((alone[alone > 0] * np.log(alone[alone > 0])).sum())
    bias = (bins - 1) ** 2 / (2 * len(at))
    return found - bias, (bins - 1) / (math.sqrt(2) * len(at)), entropy


def lags_up_to(most: int) -> Ints:
    """Return the lags to try, ascending, the last of them `most`."""
    if most <= _EACH:
        return np.arange(1, most + 1)
    steps = math.ceil(math.log(most / _EACH) / math.log(1.01))
    longer = np.geomspace(_EACH, most, steps + 1).round().astype(np.int64)
    return np.unique(np.concatenate([np.arange(1, _EACH), longer]))


def first_minimum(series: Floats) -> int:
    """Return the first minimum of the mutual information, or the first zero of the autocorrelation where that is shorter.

    A minimum counts only where the curve rises afterwards by more than chance would make it, and where it is less
    than half of what a value says of itself: the curve of a periodic series is never, and follows the bins. The
    information of maps and of noise falls without a minimum: there, too, the first zero is taken.

    Parameters
    ----------
    series : ndarray, shape (n,)
        Not constant.

    Returns
    -------
    int
        From 1 to a tenth of the samples.
    """
    return minimum_of_information(series)[0]


def minimum_of_information(series: Floats) -> tuple[int, bool]:
    """Return :func:`first_minimum`, and whether it is a minimum of the information."""
    most = first_zero(series)
    # A little beyond, to see that it rises again.
    lags = lags_up_to(min(most + max(most // 4, 2), longest(len(series))))
    found, deviation, entropy = mutual_information(series, lags)
    low = 0
    for k in range(1, len(lags)):
        if found[k] < found[low]:
            low = k
        elif found[low] < entropy / 2 and found[k] - found[low] > max(
            _SURE * deviation, _RISE * (found[0] - found[low])
        ):
            return min(int(lags[low]), most), bool(lags[low] <= most)
    return most, False
