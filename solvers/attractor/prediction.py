"""Predictions by neighbouring states: their error, and the embeddings with the smallest one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from .embedding import standardised, thin_out
from .native import Embedding, Poll, embed, theiler_window
from .neighbour_kernels import nearest_states, order_states

__all__ = ["choose_embeddings", "prediction_error"]

Floats = NDArray[np.float64]

#: Number of predicted states, dimension above which fewer are predicted to save time, and their number. All states
#: of the compared samples are possible neighbours.
ASKED, HIGH, ASKED_HIGH = 2000, 5, 500
#: Divisors of the delay, and dimensions, whose combinations are compared. Samples and nearest states of a comparison.
DIVISORS, DIMENSIONS, SAMPLES, NEIGHBOURS = (1, 2, 8), (2, 3, 4, 6, 8), 10_000, 5
#: Largest number of embeddings, and largest ratio of the prediction error to the smallest one.
EMBEDDINGS, WORSE = 8, 1.5


def prediction_error(
    values: Floats, delay: int, dimension: int, theiler: int, count: int, ahead: int | None = None
) -> float:
    """Return the mean square error of predictions by the mean future of the nearest states.

    The prediction is `ahead` samples ahead, by default one delay. Up to :data:`ASKED` samples all states are
    predicted, otherwise a sample of them. A state has `count` neighbours by the largest difference of a coordinate,
    more than `theiler` samples away. NaN if no state has enough.
    """
    ahead = delay if ahead is None else ahead
    last = len(values) - (dimension - 1) * delay - ahead
    if last < 1:
        return math.nan
    # The last coordinates diverge first, so the search is along the last one.
    columns = [values[k * delay : k * delay + last] for k in range(dimension - 1, -1, -1)]
    states, times, places = order_states(np.stack(columns, axis=1))
    rows = thin_out(last, ASKED if dimension <= HIGH or len(values) <= ASKED else ASKED_HIGH)
    which, _, _ = nearest_states(states, times, places[rows], theiler, count, True)
    complete = which[:, -1] >= 0
    if not complete.any():
        return math.nan
    futures = values[(dimension - 1) * delay + ahead :]
    errors = futures[rows[complete]] - futures[which[complete]].mean(axis=1)
    return float((errors**2).mean())


def choose_embeddings(
    problem: AttractorAnalysis, options: Mapping[str, Any], poll: Poll = bool
) -> tuple[list[Embedding], int]:
    """Return at most eight embeddings with the smallest prediction error, the best first, and the time ahead.

    The time ahead in samples is the delay of :func:`~.native.embed`, the same for all embeddings. Delay, dimension and
    window of `options` are not changed. `poll` is called before each comparison. Raise InvalidData if the series is
    too short for them.
    """
    first = embed(problem, options)
    ahead = first.delay
    delays = sorted({max(ahead // part, 1) for part in DIVISORS}, reverse=True)
    delays = [ahead] if options.get("delay") else delays
    dimensions = sorted({*DIMENSIONS, first.dimension})
    dimensions = [first.dimension] if options.get("dimension") else dimensions
    if len(delays) * len(dimensions) == 1:
        return [first], ahead
    values, ranked = standardised(problem.series[:SAMPLES]), []
    for delay in delays:
        for dimension in dimensions:
            if (dimension - 1) * delay > len(values) // 4:
                continue
            poll()
            theiler = options.get("theiler")
            if theiler is None:
                theiler = theiler_window(problem.series, delay, dimension)
            error = prediction_error(
                values, delay, dimension, min(theiler, len(values) // 4), NEIGHBOURS, ahead
            )
            if error > 0:
                ranked.append((math.sqrt(error), Embedding(delay, dimension, theiler)))
    if not ranked:
        return [first], ahead
    ranked.sort(key=lambda pair: pair[0])
    good = [found for error, found in ranked if error <= WORSE * ranked[0][0]]
    return good[:EMBEDDINGS], ahead
