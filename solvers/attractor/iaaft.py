"""Surrogates of a series that are linear noise, and how predictable a series is.

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

#: Consecutive samples that are to be alike at both ends, and shares of the series that may go at each.
_ALIKE, _CUTS = 3, (0.1, 0.25)
#: Largest number of samples that may go at each end; the comparison needs its square of memory.
_ENDS = 2000
#: Largest number of iterations, of series of up to so many samples and of longer ones. The longer ones begin with the
#: spectrum of the series and need fewer.
_ITERATIONS, _SHORT, _FEWER = 500, 2500, 12


def match_ends(series: Floats) -> tuple[int, int, float]:
    """Return the stretch whose continuation is most like its beginning.

    Surrogates have the spectrum of a periodic repetition, where a jump at the seam would be a frequency of
    its own. A tenth is cut at each end at most, or a quarter where that does not do.

    Parameters
    ----------
    series : ndarray, shape (n,)

    Returns
    -------
    first, end : int
        Its first sample, and the one after its last.
    jump : float
        How much the samples after it differ from its first ones, in root mean squares of the difference of consecutive
        samples: beyond 1 the seam is seen.
    """
    step = float(np.sqrt((np.diff(series) ** 2).mean()))
    for cut in _CUTS:
        most = min(max(int(cut * len(series)), 1), _ENDS)
        begins, ends = np.arange(most), len(series) - _ALIKE - np.arange(most)
        apart = np.zeros((most, most))
        for k in range(_ALIKE):
            apart += (series[begins + k][:, None] - series[ends + k]) ** 2
        best = int(apart.argmin())
        jump = float(np.sqrt(apart.flat[best] / _ALIKE)) / step
        if jump <= 1.0:
            break
    return int(begins[best // most]), int(ends[best % most]), jump


def normal_scores(series: Floats) -> Floats:
    """Return the values a normal distribution has at the ranks of a series, with mean 0; ties share one.

    A series bent by any rising function has the same, and what spectrum and values ask of its surrogates
    goes together: of skewed values they would come out less predictable than the noise they are drawn from.
    """
    from scipy.special import ndtri

    _, place, count = np.unique(series, return_inverse=True, return_counts=True)
    found: Floats = ndtri((np.cumsum(count) - count / 2) / len(series))[place]
    found -= found.mean()
    return found


def surrogates_of(
    series: Floats,
    count: int,
    generator: np.random.Generator,
    stopped: Callable[[], bool] = lambda: False,
) -> Floats:
    """Return surrogates with the values of a series and, all but exactly, its spectrum.

    Phases are drawn; then spectrum and values are restored by turns until the order of the values stays
    (iterated amplitude-adjusted Fourier transform). Long series take at most 12 turns.

    Parameters
    ----------
    series : ndarray, shape (n,)
    count : int
    generator : numpy.random.Generator
    stopped : callable
        Asked after each iteration, whether to leave it there.

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
    """Return the mean square error of predicting by the mean of the nearest states' futures.

    Parameters
    ----------
    series : ndarray, shape (n,)
    delay, dimension : int
        Of the embedding.
    ahead : int
        Samples from the last coordinate to what is predicted.
    theiler : int
        States at most as many samples apart are no neighbours.
    count : int
        Neighbours, by the largest difference of a coordinate.

    Returns
    -------
    float
        In squares of the series' unit; not a number where no state has so many neighbours.
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
            # The last coordinates part first.
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
    """Return the mean square error of :func:`prediction_error` for some states among all.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        All states, ordered by the first coordinate.
    times : ndarray, shape (m,)
        Sample at which each state begins.
    futures : ndarray, shape (m,)
        What each state is followed by.
    places : ndarray, shape (r,)
        Rows of the states that are predicted.
    theiler : int
        States at most as many samples apart are no neighbours.
    count : int
        Neighbours, by the largest difference of a coordinate.

    Returns
    -------
    float
        Not a number if no state has so many neighbours.
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
