"""Surrogates of a series that are linear noise, and the predictability of a series.

Sources: T. Schreiber and A. Schmitz, "Improved surrogate data for nonlinearity tests", Physical Review Letters
77, 1996; the same, "Surrogate time series", Physica D 142, 2000, for the choice of ends.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["match_ends", "normal_scores", "prediction_error", "sampled_error", "surrogates_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Number of consecutive samples that must match at both ends, and largest shares cut at each end.
_ALIKE, _CUTS = 3, (0.1, 0.25)
#: Largest number of samples cut at each end; the comparison needs its square of memory.
_ENDS = 2000
#: Largest number of iterations for series up to a length, that length, and the limit for longer series,
#: which start with the spectrum of the series and need fewer.
_ITERATIONS, _SHORT, _FEWER = 500, 2500, 12


def match_ends(series: Floats) -> tuple[int, int, float]:
    """Return the stretch of a series whose continuation is most similar to its beginning.

    Surrogates have the spectrum of a periodic repetition, in which a jump at the seam adds
    frequencies. At most a tenth is cut at each end, or a quarter if that is not sufficient.

    Parameters
    ----------
    series : ndarray, shape (n,)
        The series.

    Returns
    -------
    first, end : int
        Index of the first sample, and of the one after the last.
    jump : float
        Difference between the samples after the stretch and its first samples, relative to the root mean
        square difference of consecutive samples. Above 1 the seam is visible.
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
    """Return surrogates with the values of a series and nearly its spectrum.

    Phases are random. Then spectrum and values are restored alternately until the order of the values
    does not change (iterated amplitude-adjusted Fourier transform). Long series take at most 12 rounds.

    Parameters
    ----------
    series : ndarray, shape (n,)
        The series.
    count : int
        Number of surrogates.
    generator : numpy.random.Generator
        Source of the random phases.
    stopped : callable
        Function that returns True to stop, called after each iteration.

    Returns
    -------
    ndarray, shape (count, n)
    """
    from scipy import fft

    n = len(series)
    values = np.sort(series)
    wanted = np.abs(fft.rfft(series))
    found = generator.permuted(np.tile(series, (count, 1)), axis=1)
    limit = _ITERATIONS
    if n > _SHORT:
        spectra = fft.rfft(found, axis=1)
        size = np.abs(spectra)
        spectra *= np.divide(wanted, size, out=np.zeros_like(size), where=size > 0)
        found, limit = fft.irfft(spectra, n, axis=1), _FEWER
    order = np.argsort(found, axis=1, kind="stable")
    if n > _SHORT:
        np.put_along_axis(found, order, np.broadcast_to(values, found.shape), 1)
    open_ = np.arange(count)
    while open_.size and limit and not stopped():
        spectra = fft.rfft(found[open_], axis=1)
        size = np.abs(spectra)
        spectra *= np.divide(wanted, size, out=np.zeros_like(size), where=size > 0)
        new = np.argsort(fft.irfft(spectra, n, axis=1), axis=1, kind="stable")
        moved = (new != order[open_]).any(axis=1)
        order[open_] = new
        np.put_along_axis(found, order, np.broadcast_to(values, found.shape), 1)
        open_ = open_[moved]
        limit -= 1
    return found


@kernel
def prediction_error(
    series: Floats, delay: int, dimension: int, ahead: int, theiler: int, count: int
) -> Any:
    """Return the mean square error of predictions by the mean future of the nearest states.

    Parameters
    ----------
    series : ndarray, shape (n,)
        The series.
    delay, dimension : int
        The embedding.
    ahead : int
        Samples between the last coordinate and the predicted sample.
    theiler : int
        States at most this number of samples apart are not neighbours.
    count : int
        Number of neighbours, by the largest difference of a coordinate.

    Returns
    -------
    float
        Squared error in the unit of the series; NaN if no state has enough neighbours.
    """
    span = (dimension - 1) * delay
    last = len(series) - span - ahead
    best = np.empty(count)
    future = np.empty(count)
    total, predicted = 0.0, 0
    for i in range(last):
        for k in range(count):
            best[k] = np.inf
        for j in range(last):
            if abs(i - j) <= theiler:
                continue
            far = 0.0
            limit = best[count - 1]
            # The last coordinates diverge first.
            for c in range(span, -1, -delay):
                apart = abs(series[i + c] - series[j + c])
                if apart > far:
                    far = apart
                    if far >= limit:
                        break
            if far < limit:
                k = count - 1
                while k > 0 and best[k - 1] > far:
                    best[k] = best[k - 1]
                    future[k] = future[k - 1]
                    k -= 1
                best[k] = far
                future[k] = series[j + span + ahead]
        if best[count - 1] < np.inf:
            mean = 0.0
            for k in range(count):
                mean += future[k]
            total += (series[i + span + ahead] - mean / count) ** 2
            predicted += 1
    return total / predicted if predicted > 0 else np.nan


@kernel(interpretable=True)
def sampled_error(
    states: Floats, times: Ints, futures: Floats, places: Ints, theiler: int, count: int
) -> float:
    """Return the error of :func:`prediction_error` for a sample of the states.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        All states, ordered by the first coordinate.
    times : ndarray, shape (m,)
        Sample at which each state begins.
    futures : ndarray, shape (m,)
        Future sample of each state.
    places : ndarray, shape (r,)
        Rows of the predicted states.
    theiler : int
        States at most this number of samples apart are not neighbours.
    count : int
        Number of neighbours, by the largest difference of a coordinate.

    Returns
    -------
    float
        NaN if no state has enough neighbours.
    """
    m, d = states.shape
    best, future = np.empty(count), np.empty(count)
    total, predicted = 0.0, 0
    for place in places:
        best[:] = np.inf
        left, right = place - 1, place + 1
        backward = True
        while left >= 0 or right < m:
            backward = not backward
            if (backward and left < 0) or (not backward and right >= m):
                continue
            if backward:
                other = left
                left -= 1
            else:
                other = right
                right += 1
            far = abs(states[other, 0] - states[place, 0])
            limit = best[count - 1]
            if far >= limit:
                if backward:
                    left = -1
                else:
                    right = m
                continue
            if abs(times[other] - times[place]) <= theiler:
                continue
            for column in range(1, d):
                apart = abs(states[other, column] - states[place, column])
                if apart > far:
                    far = apart
                    if far >= limit:
                        break
            if far < limit:
                k = count - 1
                while k > 0 and best[k - 1] > far:
                    best[k] = best[k - 1]
                    future[k] = future[k - 1]
                    k -= 1
                best[k] = far
                future[k] = futures[other]
        if best[count - 1] < np.inf:
            mean = 0.0
            for k in range(count):
                mean += future[k]
            total += (futures[place] - mean / count) ** 2
            predicted += 1
    return total / predicted if predicted > 0 else np.nan
