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

__all__ = ["choose_embeddings", "linear_map_error", "noise_level", "prediction_error"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Number of predicted states, dimension above which fewer are predicted to save time, and their number. All states
#: of the compared samples are possible neighbours.
ASKED, HIGH, ASKED_HIGH = 2000, 5, 500
#: Divisors of the delay, and dimensions, whose combinations are compared. Samples and nearest states of a comparison.
DIVISORS, DIMENSIONS, SAMPLES, NEIGHBOURS = (1, 2, 8), (2, 3, 4, 6, 8), 10_000, 5
#: Largest number of embeddings, and largest ratio of the prediction error to the smallest one.
EMBEDDINGS, WORSE = 8, 1.5
#: Neighbours per coefficient of a linear map, its penalty relative to the mean square of a coordinate, and largest dimension.
PER_COEFFICIENT, PENALTY, MAPPED = 2, 1e-6, 20
#: Nearest states for the estimate of the noise, and ratio of the deviation of normal values to the median of their sizes.
NEAREST, ROBUST = 10, 1.4826


def prediction_error(
    values: Floats, delay: int, dimension: int, theiler: int, count: int, ahead: int | None = None
) -> float:
    """Return the mean square error of predictions by the mean future of the nearest states.

    The prediction is `ahead` samples ahead, by default one delay. Up to :data:`ASKED` samples all states are
    predicted, otherwise a sample of them. A state has `count` neighbours by the largest difference of a coordinate,
    more than `theiler` samples away. NaN if no state has enough.
    """
    rows, which, _, futures = _neighbourhoods(values, delay, dimension, theiler, count, ahead)
    if not len(rows):
        return math.nan
    errors = futures[rows] - futures[which].mean(axis=1)
    return float((errors**2).mean())


def linear_map_error(values: Floats, delay: int, dimension: int, theiler: int, ahead: int) -> float:
    """Return the mean square error of predictions by linear maps of the neighbourhoods.

    A map is a regression over two neighbours per coefficient (J. D. Farmer and J. J. Sidorowich, Physical Review Letters
    59, 1987). Its small penalty keeps it unique for states on a line or a surface. The arguments are those of
    :func:`prediction_error`. NaN above :data:`MAPPED` dimensions, too.
    """
    count = PER_COEFFICIENT * (dimension + 1)
    if dimension > MAPPED:
        return math.nan
    rows, which, states, futures = _neighbourhoods(values, delay, dimension, theiler, count, ahead)
    if not len(rows):
        return math.nan
    past, later = states[which], futures[which]
    middle, mean = past.mean(axis=1), later.mean(axis=1)
    past -= middle[:, None]
    turned = past.transpose(0, 2, 1)
    squares = turned @ past
    penalty = PENALTY * np.trace(squares, axis1=1, axis2=2) / dimension
    squares += np.maximum(penalty, np.finfo(float).tiny)[:, None, None] * np.eye(dimension)
    maps = np.linalg.solve(squares, turned @ (later - mean[:, None])[:, :, None])[:, :, 0]
    errors = futures[rows] - mean - (maps * (states[rows] - middle)).sum(axis=1)
    return float((errors**2).mean())


def _neighbourhoods(
    values: Floats, delay: int, dimension: int, theiler: int, count: int, ahead: int | None
) -> tuple[Ints, Ints, Floats, Floats]:
    """Return the predicted states with enough neighbours, the neighbours, all states, and their futures."""
    ahead = delay if ahead is None else ahead
    last = max(len(values) - (dimension - 1) * delay - ahead, 0)
    # The last coordinates diverge first, so the search is along the last one.
    columns = [values[k * delay : k * delay + last] for k in range(dimension - 1, -1, -1)]
    states = np.stack(columns, axis=1)
    ordered, times, places = order_states(states)
    rows = thin_out(last, ASKED if dimension <= HIGH or len(values) <= ASKED else ASKED_HIGH)
    which, _, _ = nearest_states(ordered, times, places[rows], theiler, count, True)
    complete = which[:, -1] >= 0
    return rows[complete], which[complete], states, values[(dimension - 1) * delay + ahead :]


def noise_level(states: Floats, theiler: int) -> float:
    """Return the standard deviation of the noise in each coordinate of states, relative to that of the last one.

    The first estimate is the Gamma test (A. Stefánsson, N. Končar and A. Jones, Neural Computing & Applications 5,
    1997): half the square difference of the last coordinate one sample later, as a linear function of the mean
    square distance of the first to tenth nearest states, tends to the variance of the noise at distance 0. Medians, scaled
    to the variance of normal values, leave out states that a map tears apart. The distance of the nearest states is a
    second estimate, and the smaller one is returned; 0 without enough neighbours.
    """
    states = states / np.ptp(states)  # squares would overflow otherwise
    futures, last = states[1:, -1], len(states) - 1
    ordered, times, places = order_states(states[:last])
    rows = thin_out(last, ASKED if states.shape[1] <= HIGH else ASKED_HIGH)
    which, squares, _ = nearest_states(ordered, times, places[rows], theiler, NEAREST, False)
    complete = which[:, -1] >= 0
    squares, deviation = squares[complete], float(states[:, -1].std())
    means = squares.mean(axis=0) if complete.any() else np.zeros(NEAREST)
    # Rounded values have equal distances.
    if not np.ptp(means) > 1e-6 * means[-1] or not deviation > 0:
        return 0.0
    apart = futures[which[complete]] - futures[rows[complete], None]
    variances = (ROBUST * np.median(np.abs(apart), axis=0)) ** 2 / 2
    at_zero = float(np.polyfit(means / means[-1], variances, 1)[1])
    nearest = math.exp(float(np.log(squares[:, 0]).mean())) / (2 * states.shape[1])
    return math.sqrt(max(min(at_zero, nearest), 0.0)) / deviation


def choose_embeddings(
    problem: AttractorAnalysis,
    options: Mapping[str, Any],
    poll: Poll = bool,
    first: Embedding | None = None,
) -> tuple[list[Embedding], int]:
    """Return at most eight embeddings with the smallest prediction error, the best first, and the time ahead.

    The time ahead in samples is the delay of :func:`~.native.embed`, the same for all embeddings. Delay, dimension and
    window of `options` are not changed. `poll` is called before each comparison. `first` is the result of ``embed`` if it is
    known. Raise InvalidData if the series is too short for them.
    """
    first = first or embed(problem, options)
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
