"""``surrogates``: the decision whether a series is noise, regular or chaotic, and its evidence.

A positive exponent alone proves nothing, because a region can be fitted to noise, too. Linear noise is tested by
surrogates. A clean periodic or quasi-periodic series is its own surrogate, so a second test follows neighbouring
states over a third of the series, and a third one is the 0-1 test of G. A. Gottwald and I. Melbourne, "On the
implementation of the 0-1 test for chaos", SIAM Journal on Applied Dynamical Systems 8, 2009, with the correlation
method (section 3.2) and without the oscillating term (equation 3.1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.checks import ALL
from ...models.attractor.judgement import EDITION
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import Evidence, Judgement, Slope, SurrogateTest
from ..contract.backend import Feature, Request
from ..contract.option import Option
from .embedding import mean_period, standardised, thin_out, transform_length
from .exponents import Rosenstein
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, Poll, poll_of, run_stage
from .neighbour_kernels import nearest_states, order_states
from .prediction import NEIGHBOURS, choose_embeddings, linear_map_error, prediction_error
from .surrogates import RANKING, Ranks, ranks, statistics

__all__ = ["Surrogates", "gather", "judge", "linear_error", "zero_one"]

Floats = NDArray[np.float64]

#: Deviations of the rank below which a better linear prediction means linear noise.
CLEAR = 7.0
#: Orders of autoregressive models, samples per coefficient, and largest number of samples for both predictions.
ORDERS, PER_COEFFICIENT, SAMPLES = (2, 5, 10, 20, 40), 20, 10_000
#: Samples per mean period of the 0-1 test: the mean frequency and its double are then among those of the test. Its
#: smallest and largest number of samples, and number of frequencies.
PER_PERIOD, FEWEST, MOST, FREQUENCIES = 6, 100, 1500, 48
#: States whose neighbours are followed, and times at which their distances are measured.
FOLLOWED, TIMES = 500, 50
#: Smallest distance relative to the extent of the series.
_NOTHING = 1e-9


def zero_one(series: Floats, step: int) -> float:
    """Return the median correlation K of the 0-1 test of one in `step` samples, of the leading ones if they are many.

    The frequencies are spread evenly from π / 5 to 4 π / 5, and displacements are followed over a tenth of the
    samples. K is 0 if these samples are constant.
    """
    part = series[::step][:MOST]
    if not np.ptp(part) > 0:
        return 0.0
    x = standardised(part)
    n, cut = len(x), len(x) // 10
    frequencies = np.pi * (0.2 + 0.6 * (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES)
    paths = np.cumsum(x * np.exp(1j * frequencies[:, None] * np.arange(1, n + 1)), axis=1)
    size, lags = transform_length(2 * n), np.arange(1, cut + 1)
    heads = np.fft.fft(paths[:, : n - cut], size, axis=1)
    products = np.fft.ifft(np.conj(heads) * np.fft.fft(paths, size, axis=1), axis=1).real[
        :, 1 : cut + 1
    ]
    squares = np.cumsum(np.abs(paths) ** 2, axis=1)
    moved = squares[:, n - cut : n] - squares[:, :cut] + squares[:, [n - cut - 1]] - 2 * products
    moved = moved / (n - cut)  # the values have mean 0, so that the oscillating term vanishes
    lags = lags - lags.mean()
    moved -= moved.mean(axis=1)[:, None]
    size = np.sqrt((moved**2).sum(axis=1) * (lags**2).sum())
    return float(np.median((moved @ lags) / np.maximum(size, 1e-300)).clip(-1.0, 1.0))


def linear_error(series: Floats, ahead: int) -> float:
    """Return the error of the best autoregressive prediction `ahead` samples ahead, in standard deviations, 1 without any."""
    if not np.ptp(series[:SAMPLES]) > 0:
        return 1.0
    x, best = standardised(series[:SAMPLES]), math.inf
    for order in ORDERS:
        rows = len(x) - order - ahead + 1
        if rows < PER_COEFFICIENT * order:
            break
        past = np.lib.stride_tricks.sliding_window_view(x[: len(x) - ahead], order)
        futures = x[order - 1 + ahead :]
        past = np.column_stack([past, np.ones(rows)])
        rest = futures - past @ np.linalg.lstsq(past, futures)[0]
        best = min(best, math.sqrt(float(rest @ rest) / (rows - order - 1)))
    return best if math.isfinite(best) else 1.0


def partings(states: Floats, theiler: int, count: int) -> tuple[float, float]:
    """Return the nats between random states and nearest neighbours, at first and after a sixth of `count` samples.

    Distances are the largest difference of a coordinate. The later value is a mean until a third of the samples, or
    half the states if they are fewer.
    """
    latest = min(count // 3, len(states) // 2)
    ahead = np.unique(np.linspace(latest // 2, latest, TIMES).astype(np.int64))
    last = len(states) - int(ahead[-1])
    least = _NOTHING * float(np.ptp(states))
    first, second = np.random.default_rng(0).integers(0, len(states), (2, 4000))
    level = _log_distances(states, first, second, least)
    ordered, times, places = order_states(states[:last])
    rows = thin_out(last, ALL if len(states) <= ALL else FOLLOWED)
    near = nearest_states(ordered, times, places[rows], theiler, 1, True)[0][:, 0]
    rows, near = rows[near >= 0], near[near >= 0]
    if not len(rows):
        return 0.0, 0.0
    later = [_log_distances(states, rows + k, near + k, least) for k in ahead]
    return level - _log_distances(states, rows, near, least), level - float(np.mean(later))


def _log_distances(states: Floats, first: Any, second: Any, least: float) -> float:
    apart = np.abs(states[first] - states[second]).max(axis=1)
    return float(np.log(np.maximum(apart, least)).mean())


def gather(problem: AttractorAnalysis, embedding: Embedding, ahead: int, poll: Poll) -> Evidence:
    """Return the evidence in an embedding, with predictions so many samples ahead."""
    poll()
    series = standardised(problem.series)
    delay, dimension, theiler = embedding.delay, embedding.dimension, embedding.theiler
    step = max(min(round(mean_period(series) / PER_PERIOD), len(series) // FEWEST), 1)
    near, far = partings(problem.states(delay, dimension), theiler, len(series))
    poll()
    part = series[:SAMPLES]
    theiler = min(theiler, len(part) // 4)
    squares = (
        prediction_error(part, delay, dimension, theiler, NEIGHBOURS, ahead),
        linear_map_error(part, delay, dimension, theiler, ahead),
    )
    known = [square for square in squares if math.isfinite(square) and np.ptp(part) > 0]
    nonlinear = math.sqrt(min(known) / part.var()) if known else 1.0
    return Evidence(
        ahead, linear_error(series, ahead), nonlinear, near, far, step, zero_one(series, step), EDITION
    )  # fmt: skip


def judge(
    ranking: Ranks, evidence: Evidence, exponent: Slope | None, duration: float
) -> tuple[SurrogateTest, str]:
    """Return the judgement from the rank, the evidence and the exponent in nats per second, and its reason.

    `duration` is that of the series in seconds.
    """
    judgement, reason = Judgement.NONLINEAR, evidence.refutes
    # Surrogates of a sharp resonance are slightly less predictable than the noise itself.
    linear = evidence.nonlinear > evidence.linear and ranking.sigmas < CLEAR
    if ranking.jump > 1.0:
        judgement = Judgement.NOISE
        reason = "the series drifts: its surrogates have a jump that it has not, and prove nothing"
    elif evidence.stays:
        judgement, reason = Judgement.REGULAR, ""
    elif not ranking.rejected or linear:
        judgement, reason = Judgement.NOISE, "linear noise explains the series as well"
    elif reason:
        pass
    elif exponent is None:
        reason = "no positive exponent was found"
    elif not (reason := evidence.doubts(exponent.value, exponent.deviation, duration)):
        judgement = Judgement.CHAOTIC
    if judgement is Judgement.NONLINEAR:
        reason = f"linear noise does not explain the series, but {reason}"
    reason = "; ".join(filter(None, (reason, ranking.extent)))
    return SurrogateTest(judgement, ranking.count, ranking.exceeded, evidence), reason


class Surrogates(AttractorBackend):
    """Backend for the judgement: a rank test against surrogates (IAAFT), its evidence, and an exponent."""

    name = "surrogates"
    summary = (
        "noise, regular or chaotic: surrogates (IAAFT), partings of neighbours, and a 0-1 test"
    )
    features = frozenset({Feature.INTERRUPT, Feature.SEED})
    deterministic = False
    options: ClassVar[Mapping[str, Option]] = {**EMBEDDING, **RANKING}

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Compute the rank of the series, the evidence and the judgement."""
        options, poll = request.options, poll_of(request)
        embeddings, ahead = choose_embeddings(problem, options, poll)
        embedding, seed = embeddings[0], 0 if request.seed is None else request.seed
        ranking = ranks(problem.series, embedding, options, seed, poll, ahead)
        evidence = gather(problem, embedding, ahead, poll)
        exponent, messages = None, []
        if ranking.rejected and not evidence.stays:
            given = {name: options[name] for name in EMBEDDING}
            answer = run_stage(Rosenstein(True, embeddings), problem, request, given)
            exponent, plan = answer.point.exponent, answer.point
            messages.append(answer.message)
            if exponent is not None:
                embedding = Embedding(plan.delay, plan.dimension, plan.theiler)
                evidence = gather(problem, embedding, ahead, poll)
        test, why = judge(ranking, evidence, exponent, len(problem.series) * problem.period)
        plan = embedding.plan(exponent=exponent, surrogates=test)
        return Finding(plan, statistics(ranking), "; ".join(filter(None, [*messages, why])))
