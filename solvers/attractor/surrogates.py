"""``surrogates``: whether linear noise explains a series as well, and whether it may be called chaotic.

A positive exponent alone proves nothing, for noise has one too wherever a region is fitted to it. So the series
is first set against surrogates: linear noise with its values and its spectrum. Source: J. Theiler, S. Eubank,
A. Longtin, B. Galdrikian and J. D. Farmer, "Testing for nonlinearity in time series: the method of surrogate data",
Physica D 58, 1992.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate, Judgement, Slope, SurrogateTest
from ..backend import Feature, Request
from ..option import Option
from .exponents import Rosenstein
from .iaaft import match_ends, normal_scores, prediction_error, surrogates_of
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, embed

__all__ = ["RANKING", "Ranks", "Surrogates", "judge", "ranks"]

Floats = NDArray[np.float64]

#: Options of the test itself.
RANKING: Mapping[str, Option] = {
    "count": Option(39, "surrogates", int, lower=19, upper=9999),
    "samples": Option(2000, "samples of the series compared", int, lower=50, upper=20_000),
    "neighbours": Option(5, "nearest states that predict", int, lower=1, upper=100),
}
#: Samples of a delay beyond which every other one, or fewer, are left out.
_FINE = 8
#: Share of orders that reject, and deviations by which an exponent must exceed 0.
_LEVEL, _SURE = 0.05, 2.0
#: Deviations of the surrogates' errors by which the series must be below them, and an error that is none.
_SIGMAS, _NOTHING = 3.5, 1e-9


@dataclass(frozen=True)
class Ranks:
    """How a series ranks among its surrogates.

    Parameters
    ----------
    count, exceeded : int
        As in :class:`~crosstrack.models.attractor.SurrogateTest`.
    error, median : float
        Root mean square error of predicting the normal scores of the series, and the median of the surrogates'.
    sigmas : float
        By how many deviations of the surrogates' errors the series' is less than their mean, in logarithms.
    jump : float
        See :func:`~.iaaft.match_ends`.
    """

    count: int
    exceeded: int
    error: float
    median: float
    sigmas: float
    jump: float

    @property
    def rejected(self) -> bool:
        """Whether linear noise is rejected at 5 %, and clearly, which a series that drifts cannot show.

        The rank alone rejects some 8 % of linear noise, for surrogates have the spectrum that a short stretch
        happens to have: hence the deviations, the measure of Theiler and others.
        """
        ranked = (1 + self.exceeded) / (1 + self.count) <= _LEVEL
        return ranked and self.sigmas >= _SIGMAS and self.jump <= 1.0


def ranks(
    series: Floats,
    embedding: Embedding,
    options: Mapping[str, Any],
    seed: int,
    stopped: Callable[[], bool] = lambda: False,
) -> Ranks | None:
    """Return how a series ranks among its surrogates by its prediction one delay ahead, None where `stopped`.

    Where a delay has more than 16 samples, only some of them are kept: they show the same motion for longer.

    Parameters
    ----------
    series : ndarray, shape (n,)
    embedding : Embedding
    options : mapping
        Values of :data:`RANKING`.
    seed : int
    stopped : callable
    """
    step = max(embedding.delay // _FINE, 1)
    delay = max(round(embedding.delay / step), 1)
    thin = np.ascontiguousarray(series[::step][: options["samples"]])
    thin = thin / np.abs(thin).max() if thin.any() else thin
    if not np.ptp(thin) > 0:
        thin = series / np.abs(series).max()
    first, end, jump = match_ends(thin)
    part = normal_scores(thin[first:end])
    spread = float(part.std())
    if not spread > 0:
        return Ranks(options["count"], options["count"], 0.0, 0.0, 0.0, jump)
    part /= spread
    dimension = max(min(embedding.dimension, len(part) // (4 * delay)), 1)
    theiler = min(embedding.theiler // step, len(part) // 10)

    def error(values: Floats) -> float:
        found = prediction_error(values, delay, dimension, delay, theiler, options["neighbours"])
        return math.sqrt(found)

    own, others = error(part), []
    drawn = surrogates_of(part, options["count"], np.random.default_rng(seed), stopped)
    for one in drawn:
        if stopped():
            return None
        others.append(error(one))
    # What cannot be predicted at all, for want of neighbours, rejects nothing.
    exceeded = sum(not one > own for one in others)
    logs = np.log(np.maximum(np.nan_to_num([own, *others], nan=1.0), _NOTHING))
    sigmas = float(logs[1:].mean() - logs[0]) / max(float(logs[1:].std(ddof=1)), _NOTHING)
    figures = math.exp(logs[0]), math.exp(float(np.median(logs[1:])))
    return Ranks(options["count"], exceeded, *figures, sigmas, jump)


def judge(found: Ranks, exponent: Slope | None) -> tuple[SurrogateTest, str]:
    """Return what the ranks and the exponent amount to, and why."""
    if not found.rejected:
        judgement = Judgement.NOISE
        drifts = "the series drifts: its surrogates have a jump that it has not, and prove nothing"
        said = drifts if found.jump > 1.0 else "linear noise explains the series as well"
    elif exponent is not None and exponent.value - _SURE * exponent.deviation > 0:
        judgement, said = Judgement.CHAOTIC, ""
    else:
        judgement = Judgement.NONLINEAR
        said = "linear noise does not explain the series, but no positive exponent was found"
    return SurrogateTest(judgement, found.count, found.exceeded), said


class Surrogates(AttractorBackend):
    """A rank test against iterated amplitude-adjusted surrogates, and an exponent where they are rejected."""

    name = "surrogates"
    summary = "noise, nonlinear or chaotic: a rank test against linear noise (IAAFT)"
    features = frozenset({Feature.INTERRUPT, Feature.SEED})
    deterministic = False
    options: ClassVar[Mapping[str, Option]] = {**EMBEDDING, **RANKING}

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding | None:
        """Rank the series, and judge."""
        options = request.options
        embedding = embed(problem, options)
        seed = 0 if request.seed is None else request.seed
        found = ranks(
            problem.series, embedding, options, seed, stopped=lambda: request.control.stopped
        )
        if found is None:
            return None
        where = {
            "delay": embedding.delay, "dimension": embedding.dimension, "theiler": embedding.theiler,
        }  # fmt: skip
        exponent, messages = None, []
        if found.rejected:
            answer = request.within(Rosenstein(), problem, options=where)
            if answer.point is None:
                return None
            exponent = answer.point.exponent
            messages.append(answer.message)
        test, said = judge(found, exponent)
        messages.append(said)
        plan = AttractorEstimate(
            embedding.delay, embedding.dimension, embedding.theiler,
            exponent=exponent, surrogates=test,
        )  # fmt: skip
        return Finding(plan, statistics(found), "; ".join(filter(None, messages)))


def statistics(found: Ranks) -> dict[str, Any]:
    """Return the key figures of a test."""
    return {
        "surrogates": found.count,
        "prediction error": found.error,
        "median of the surrogates": found.median,
        "deviations below": found.sigmas,
        "jump at the seam": found.jump,
    }
