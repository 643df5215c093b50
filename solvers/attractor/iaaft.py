"""Surrogates of a series that are linear noise.

Sources: T. Schreiber and A. Schmitz, "Improved surrogate data for nonlinearity tests", Physical Review Letters
77, 1996; the same, "Surrogate time series", Physica D 142, 2000, for the choice of ends.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["match_ends", "normal_scores", "surrogates_of"]

Floats = NDArray[np.float64]

#: Number of consecutive samples that must match at both ends, and largest shares cut at each end.
_ALIKE, _CUTS = 3, (0.1, 0.25)
#: Largest number of samples cut at each end; the comparison needs its square of memory.
_ENDS = 2000
#: Largest number of iterations for series up to a length, that length, and the limit for longer series,
#: which start with the spectrum of the series and need fewer.
_ITERATIONS, _SHORT, _FEWER = 500, 2500, 12


def match_ends(series: Floats) -> tuple[int, int, float]:
    """Return the stretch of a series whose continuation is most similar to its beginning, and the jump.

    Surrogates have the spectrum of a periodic repetition, in which a jump at the seam adds frequencies. At
    most a tenth is cut at each end, or a quarter if that is not sufficient. The stretch is given by the
    index of its first sample and of the one after its last. The jump is the difference between the samples
    after the stretch and its first samples, relative to the root mean square difference of consecutive
    samples; above 1 the seam is visible.
    """
    step = float(np.sqrt((np.diff(series) ** 2).mean()))
    for cut in _CUTS:
        largest_cut = min(max(int(cut * len(series)), 1), _ENDS)
        begins, ends = np.arange(largest_cut), len(series) - _ALIKE - np.arange(largest_cut)
        distances = np.zeros((largest_cut, largest_cut))
        for k in range(_ALIKE):
            distances += (series[begins + k][:, None] - series[ends + k]) ** 2
        best = int(distances.argmin())
        jump = float(np.sqrt(distances.flat[best] / _ALIKE)) / step
        if jump <= 1.0:
            break
    return int(begins[best // largest_cut]), int(ends[best % largest_cut]), jump


def normal_scores(series: Floats) -> Floats:
    """Return the quantiles of a normal distribution at the ranks of a series, with mean 0; ties share one.

    They do not change if the series is transformed by a rising function. Surrogates of skewed values would
    be less predictable than the noise they come from.
    """
    from scipy.special import ndtri

    _, index, count = np.unique(series, return_inverse=True, return_counts=True)
    scores: Floats = ndtri((np.cumsum(count) - count / 2) / len(series))[index]
    scores -= scores.mean()
    return scores


def surrogates_of(
    series: Floats,
    count: int,
    generator: np.random.Generator,
    stopped: Callable[[], bool] = lambda: False,
) -> Floats:
    """Return surrogates with the values of a series and nearly its spectrum, shape (count, n).

    Phases are random. Then spectrum and values are restored alternately until the order of the values does
    not change (iterated amplitude-adjusted Fourier transform). Long series take at most 12 rounds.
    `stopped` is polled after each round.
    """
    from scipy import fft

    n = len(series)
    values = np.sort(series)
    wanted = np.abs(fft.rfft(series))
    result = generator.permuted(np.tile(series, (count, 1)), axis=1)
    limit = _ITERATIONS
    if n > _SHORT:
        spectra = fft.rfft(result, axis=1)
        size = np.abs(spectra)
        spectra *= np.divide(wanted, size, out=np.zeros_like(size), where=size > 0)
        result, limit = fft.irfft(spectra, n, axis=1), _FEWER
    order = np.argsort(result, axis=1, kind="stable")
    if n > _SHORT:
        np.put_along_axis(result, order, np.broadcast_to(values, result.shape), 1)
    open_ = np.arange(count)
    while open_.size and limit and not stopped():
        spectra = fft.rfft(result[open_], axis=1)
        size = np.abs(spectra)
        spectra *= np.divide(wanted, size, out=np.zeros_like(size), where=size > 0)
        new = np.argsort(fft.irfft(spectra, n, axis=1), axis=1, kind="stable")
        moved = (new != order[open_]).any(axis=1)
        order[open_] = new
        np.put_along_axis(result, order, np.broadcast_to(values, result.shape), 1)
        open_ = open_[moved]
        limit -= 1
    return result
