"""``correlation-dimension``: growth of the number of pairs of states within a radius.

Sources: P. Grassberger and I. Procaccia, "Measuring the strangeness of strange attractors", Physica D 9 (1983)
189-208; J. Theiler, "Spurious dimension from correlation algorithms applied to limited time-series data", Physical
Review A 34 (1986) 2427-2432, for the window.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.attractor.checks import ALL, RADII
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import Method, Slope
from ..contract.backend import Request
from ..contract.option import Option
from .exponents import REFERENCE_STATES, Fit
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, Poll, embed, poll_of
from .neighbour_kernels import count_pairs
from .partings import BLOCKS, MOST, PILOT, Neighbours
from .regions import (
    DIMENSION_ERROR,
    REFERENCES,
    UNCONFIRMED_DIMENSION,
    Stretches,
    describe_variants,
    steady_stretches,
    variants,
    whole_slope,
    widened,
)

__all__ = ["CorrelationDimension", "Counts", "correlation_counts", "fit_dimension"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Smallest number of reference states, if not all states are references.
SOME = 300
#: Pairs that a count may visit, which limits the references.
WORK = 15_000_000
#: Number of radii of the curve that determines the region.
FINE = 64
#: Random pairs of states for the range of the radii, and the share of pairs within the largest radius.
PAIRS, WHOLE = 20_000, 0.1
#: Smallest radius of the curve, relative to the largest.
LEAST_RADIUS = 1e-5
#: Largest number of reference states for the curve that determines the region.
FIRST = 1500
#: Mean number of neighbours of a state within the smallest radius of a region.
NEIGHBOURS = 2.0
#: Smallest number of points of a region, smallest ratio of its radii, and largest relative difference of the
#: slopes of its halves.
LEAST, SPAN, CHANGE = 6, 3.0, 0.15
#: Smallest increase of the counts within a region in nats; repeated values have plateaus without increase.
RISE = 0.5
#: Largest growth of the dimension with one more coordinate.
GROWTH = 0.3


@dataclass(frozen=True, eq=False)
class Counts:
    """Numbers of ordered pairs within ascending `radii` of reference states, by blocks of time.

    `counts` has the shape (blocks, radii), and `references` is the number of reference states.
    """

    radii: Floats
    counts: Ints
    references: int

    @property
    def values(self) -> Floats:
        """Logarithm of the total counts, minus infinity for a count of 0; shape (k,)."""
        with np.errstate(divide="ignore"):
            logs: Floats = np.log(self.counts.sum(axis=0))
        return logs

    def slope(self) -> tuple[float, float]:
        """Return the slope over all radii, and its standard deviation, see :func:`whole_slope`."""
        with np.errstate(divide="ignore"):
            left_out = np.log(self.counts.sum(axis=0) - self.counts)
        return whole_slope(np.log(self.radii), self.values, left_out)


def correlation_counts(
    states: Floats, radii: Floats, theiler: int, *, references: int = MOST, poll: Poll = bool
) -> Counts:
    """Return the numbers of states within radii of all states, or of a random sample to save time.

    States are in the order of time, and pairs at most `theiler` samples apart are excluded. Up to 1500
    states, all are references, otherwise at most `references`. `poll` is called between blocks of time.
    """
    pool = Neighbours(states, theiler, len(states))

    def part(some: Ints) -> tuple[Ints, int]:
        shells, visits = count_pairs(pool.ordered, pool.times, pool.places[some], theiler, radii)
        return np.cumsum(shells), visits

    if len(states) > max(ALL, references):
        references = min(max(WORK * PILOT // max(part(pool.pilot)[1], 1), SOME), references)
    rows, blocks = pool.references(references), []
    for some in np.array_split(rows, min(BLOCKS, len(rows))):
        poll()
        blocks.append(part(some)[0])
    return Counts(radii, np.array(blocks), len(rows))


def drawn_radii(
    states: Floats, theiler: int, low: float | None, high: float | None
) -> Floats | None:
    """Return the radii of a curve to choose a region; None if all states are equal.

    By default the largest radius contains a tenth of all pairs, and the smallest is 1e-5 of it.
    """
    first, second = np.random.default_rng(0).integers(0, len(states), (2, PAIRS))
    is_distant = np.abs(first - second) > theiler
    distances = np.abs(states[first[is_distant]] - states[second[is_distant]]).max(axis=1)
    distances = np.sort(distances[distances > 0])
    if not distances.size:
        return None
    largest = high or max(float(distances[int(WHOLE * (distances.size - 1))]), (low or 0.0) * SPAN)
    smallest = low or largest * LEAST_RADIUS
    radii: Floats = np.geomspace(smallest, largest, FINE)
    radii[0], radii[-1] = smallest, largest
    return radii


def fit_dimension(
    states: Floats,
    theiler: int,
    *,
    low: float | None = None,
    high: float | None = None,
    references: int = MOST,
    poll: Poll = bool,
) -> Fit:
    """Return the correlation dimension of `states`.

    The region is the widest plateau of the local slopes. At its smallest radius the states have two
    neighbours on average, and its largest radius contains about a tenth of all pairs. `low` and `high` fix
    its radii. The other arguments are those of :func:`correlation_counts`.
    """
    if low is not None and high is not None and not low < high:
        raise InvalidData(f"low must be < high = {high:g}, got {low:g}", field="low")
    spread = 0.0
    if low is None or high is None:
        radii = drawn_radii(states, theiler, low, high)
        if radii is None:
            return Fit(None, message=NONE.format("no two states differ"))
        few = min(FIRST, references)
        first = correlation_counts(states, radii, theiler, references=few, poll=poll)
        begin, stretches = plateau(first, low is not None, high is not None)
        region = None if stretches is None else stretches.best
        if stretches is None or region is None:
            return Fit(None, message=NONE.format("the local slopes have no plateau"))
        low, high = float(radii[begin + region[0]]), float(radii[begin + region[1]])
        spread = stretches.spread
    counts = correlation_counts(
        states, np.geomspace(low, high, RADII), theiler, references=references, poll=poll
    )
    value, deviation = counts.slope()
    if not math.isfinite(value):
        return Fit(None, message=NONE.format("there are no pairs within the least radius"))
    shares = counts.counts.sum(axis=0) / (counts.references * len(states))
    statistics: dict[str, Any] = {
        "low": low,
        "high": high,
        "references": counts.references,
        "share of pairs at low": float(shares[0]),
        "share of pairs at high": float(shares[-1]),
        "deviation of the fit": deviation,
        "spread over regions": spread,
    }
    return Fit(Slope(Method.CORRELATION, value, deviation, low, high), statistics)


def plateau(counts: Counts, from_first: bool, to_last: bool) -> tuple[int, Stretches | None]:
    """Return the index of the first radius with enough pairs, and the plateaus of the local slopes from there.

    The plateaus are None if the curve is too short.
    """
    enough = counts.counts.sum(axis=0) >= NEIGHBOURS * counts.references
    begin = 0 if from_first else int(enough.argmax())
    x, y = np.log(counts.radii[begin:]), counts.values[begin:]
    if not enough[begin] or len(x) < LEAST:
        return begin, None
    least = max(LEAST, math.ceil(math.log(SPAN) / (x[1] - x[0])) + 1)
    return begin, steady_stretches(
        x, y, least=least, rise=RISE, change=CHANGE, from_first=from_first, to_last=to_last
    )


def other_dimensions(problem: AttractorAnalysis, embedding: Embedding, poll: Poll) -> list[float]:
    """Return the dimensions in other embeddings that have a plateau."""
    values = []
    for other in variants(embedding, len(problem.series)):
        states = problem.states(other.delay, other.dimension)
        radii = drawn_radii(states, other.theiler, None, None)
        if radii is None:
            continue
        counts = correlation_counts(states, radii, other.theiler, references=REFERENCES, poll=poll)
        stretches = plateau(counts, False, False)[1]
        if stretches is not None and stretches.best is not None:
            values.append(stretches.best_slope)
    return values


def slope_of_shares(
    states: Floats, theiler: int, low: float, high: float, poll: Poll = bool
) -> float | None:
    """Return the slope between the radii that contain given shares of all pairs.

    It compares embeddings without choosing a region in each. None if no slope exists.
    """
    radii = drawn_radii(states, theiler, None, None)
    if radii is None:
        return None
    counts = correlation_counts(states, radii, theiler, references=FIRST, poll=poll)
    shares = counts.counts.sum(axis=0) / (counts.references * len(states))
    chosen = np.flatnonzero((shares >= low) & (shares <= high) & (shares > 0))
    if len(chosen) < 2:
        return None
    part = slice(chosen[0], chosen[-1] + 1)
    return float(np.polyfit(np.log(radii[part]), np.log(shares[part]), 1)[0])


NONE = "no correlation dimension: {}"


class CorrelationDimension(AttractorBackend):
    """Backend for the slope of the log of the correlation sum over the log of the radius (∞-norm)."""

    name = "correlation-dimension"
    summary = "correlation dimension from the number of pairs within radii (Grassberger and Procaccia 1983)"
    options: ClassVar[Mapping[str, Option]] = {
        **EMBEDDING,
        "low": Option(
            None,
            "radius at which the region begins, in the unit of the series; by default from the curve",
            lower=1e-300,
        ),
        "high": Option(
            None,
            "radius at which the region ends, in the unit of the series; by default from the curve",
            lower=1e-300,
        ),
        "references": REFERENCE_STATES,
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Choose a region, compute the slope, and test whether it grows with the embedding dimension."""
        options = request.options
        embedding = embed(problem, options)
        low, high, poll = options.get("low"), options.get("high"), poll_of(request)
        states = problem.states(embedding.delay, embedding.dimension)
        fit = fit_dimension(
            states, embedding.theiler, low=low, high=high, references=options.get("references", MOST),
            poll=poll,
        )  # fmt: skip
        slope, message = fit.slope, fit.message
        statistics = dict(fit.statistics)
        is_automatic = low is None and high is None
        has_room = (
            len(problem.series) - embedding.dimension * embedding.delay > 2 * embedding.theiler
        )
        if slope is not None and is_automatic and has_room:
            higher = slope_of_shares(
                problem.states(embedding.delay, embedding.dimension + 1),
                embedding.theiler,
                statistics["share of pairs at low"],
                statistics["share of pairs at high"],
                poll,
            )
            poll()
            if higher is not None:
                statistics["one dimension more"] = higher
                if higher > slope.value + GROWTH:
                    grows = f"it grows with the embedding, from {slope.value:.3g} to {higher:.3g}"
                    slope, message = None, NONE.format(grows)
        if slope is not None and is_automatic:
            others = other_dimensions(problem, embedding, poll)
            slope = widened(
                slope, statistics["spread over regions"], others,
                relative=DIMENSION_ERROR, unconfirmed=UNCONFIRMED_DIMENSION,
            )  # fmt: skip
            statistics.update(describe_variants(slope, others))
        return Finding(embedding.plan(correlation=slope), statistics, message)
