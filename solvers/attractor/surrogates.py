"""Test of a series against surrogates, which are linear noise with its values and its spectrum.

Sources: J. Theiler, S. Eubank,
A. Longtin, B. Galdrikian and J. D. Farmer, "Testing for nonlinearity in time series: the method of surrogate data",
Physica D 58, 1992; T. Schreiber and A. Schmitz, "Improved surrogate data for nonlinearity tests", Physical Review
Letters 77, 1996; the same, "Surrogate time series", Physica D 142, 2000, for the choice of ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract.option import Option
from .native import Embedding, Poll
from .prediction import ASKED, prediction_error

__all__ = [
    "RANKING",
    "Ranks",
    "match_ends",
    "normal_scores",
    "ranks",
    "statistics",
    "surrogates_of",
]

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
    series: Floats, count: int, generator: np.random.Generator, poll: Poll = bool
) -> Floats:
    """Return surrogates with the values of a series and nearly its spectrum, shape (count, n).

    Phases are random. Then spectrum and values are restored alternately until the order of the values does
    not change (iterated amplitude-adjusted Fourier transform). Long series take at most 12 rounds.
    `poll` is called before each round.
    """
    n = len(series)
    values = np.sort(series)
    wanted = np.abs(np.fft.rfft(series))

    def restored(rows: Floats) -> Floats:
        spectra = np.fft.rfft(rows, axis=1)
        size = np.abs(spectra)
        spectra *= np.divide(wanted, size, out=np.zeros_like(size), where=size > 0)
        return np.fft.irfft(spectra, n, axis=1)

    result = generator.permuted(np.tile(series, (count, 1)), axis=1)
    limit = _ITERATIONS
    if n > _SHORT:
        result, limit = restored(result), _FEWER
    order = np.argsort(result, axis=1, kind="stable")
    if n > _SHORT:
        np.put_along_axis(result, order, np.broadcast_to(values, result.shape), 1)
    open_ = np.arange(count)
    while open_.size and limit:
        poll()
        new = np.argsort(restored(result[open_]), axis=1, kind="stable")
        moved = (new != order[open_]).any(axis=1)
        order[open_] = new
        np.put_along_axis(result, order, np.broadcast_to(values, result.shape), 1)
        open_ = open_[moved]
        limit -= 1
    return result


#: Options of the test.
RANKING: Mapping[str, Option] = {
    "count": Option(39, "number of surrogates", int, lower=19, upper=9999),
    "samples": Option(20_000, "samples of the series compared", int, lower=50, upper=100_000),
    "neighbours": Option(5, "nearest states for a prediction", int, lower=1, upper=100),
}
#: Largest number of values of all surrogates together, beyond which fewer samples are compared.
VALUES = 4_000_000
#: Samples per delay above which samples are skipped.
_FINE = 8
#: Significance level of the rank.
_LEVEL = 0.05
#: Deviations of the surrogates' errors by which the series must be more predictable, and an error treated as 0.
_SIGMAS, _NOTHING = 3.5, 1e-9


@dataclass(frozen=True)
class Ranks:
    """Rank of a series among its surrogates.

    `count` and `exceeded` are those of :class:`~crosstrack.models.attractor.SurrogateTest`. `error` is the
    root mean square error of predicting the normal scores of the series, and `median` that of the
    surrogates. `sigmas` is the difference between the mean of the surrogates' errors and that of the
    series, in deviations, of logarithms. `jump` is that of :func:`match_ends`. Of `among` samples,
    `read` were compared, one in `step`.
    """

    count: int
    exceeded: int
    error: float
    median: float
    sigmas: float
    jump: float
    read: int = 0
    among: int = 0
    step: int = 1

    @property
    def extent(self) -> str:
        """Text about the compared part of the series; empty if it was compared completely."""
        if self.read * self.step >= self.among:
            return ""
        every = f", one in {self.step}" if self.step > 1 else ""
        return (
            f"the test compared {self.read} of {self.among} samples{every}: the option 'samples' "
            "allows more"
        )

    @property
    def rejected(self) -> bool:
        """Whether linear noise is rejected at 5 % and clearly; never for a series that drifts.

        The rank alone rejects 8 % of linear noise, because surrogates have the spectrum of a short stretch.
        The deviations, the measure of Theiler et al., are therefore required, too.
        """
        ranked = (1 + self.exceeded) / (1 + self.count) <= _LEVEL
        return ranked and self.sigmas >= _SIGMAS and self.jump <= 1.0


def ranks(
    series: Floats,
    embedding: Embedding,
    options: Mapping[str, Any],
    seed: int,
    poll: Poll = bool,
    ahead: int | None = None,
) -> Ranks:
    """Return the rank of a series among its surrogates by its prediction, by default one delay ahead.

    `options` are those of :data:`RANKING`. If the time `ahead` has more than 16 samples, samples are skipped so
    that the same number covers a longer time.
    """
    ahead = embedding.delay if ahead is None else ahead
    step = max(ahead // _FINE, 1)
    delay = max(round(embedding.delay / step), 1)
    most = min(options["samples"], max(VALUES // options["count"], ASKED))
    thin = np.ascontiguousarray(series[::step][:most])
    thin = thin / np.abs(thin).max() if thin.any() else thin
    if not np.ptp(thin) > 0:
        thin = series / np.abs(series).max()
    extent = len(thin), len(series), step
    first, end, jump = match_ends(thin)
    part = normal_scores(thin[first:end])
    spread = float(part.std())
    if not spread > 0:
        return Ranks(options["count"], options["count"], 0.0, 0.0, 0.0, jump, *extent)
    part /= spread
    dimension = max(min(embedding.dimension, len(part) // (4 * delay)), 1)
    ahead = max(round(ahead / step), 1)
    theiler = min(embedding.theiler // step, len(part) // 10)

    def error(values: Floats) -> float:
        count = options["neighbours"]
        return math.sqrt(prediction_error(values, delay, dimension, theiler, count, ahead))

    own_error, others = error(part), []
    drawn = surrogates_of(part, options["count"], np.random.default_rng(seed), poll)
    for surrogate in drawn:
        poll()
        others.append(error(surrogate))
    # A series that cannot be predicted, for lack of neighbours, rejects nothing.
    exceeded = sum(not other > own_error for other in others)
    logs = np.log(np.maximum(np.nan_to_num([own_error, *others], nan=1.0), _NOTHING))
    sigmas = float(logs[1:].mean() - logs[0]) / max(float(logs[1:].std(ddof=1)), _NOTHING)
    figures = math.exp(logs[0]), math.exp(float(np.median(logs[1:])))
    return Ranks(options["count"], exceeded, *figures, sigmas, jump, *extent)


def statistics(ranking: Ranks) -> dict[str, Any]:
    """Return the statistics of a test."""
    return {
        "surrogates": ranking.count,
        "samples compared": ranking.read,
        "prediction error": ranking.error,
        "median of the surrogates": ranking.median,
        "deviations below": ranking.sigmas,
        "jump at the seam": ranking.jump,
    }
