"""``correlation-dimension``: how the number of pairs of states within a radius grows with it.

Sources: P. Grassberger and I. Procaccia, "Measuring the strangeness of strange attractors", Physica D 9 (1983)
189-208; J. Theiler, "Spurious dimension from correlation algorithms applied to limited time-series data", Physical
Review A 34 (1986) 2427-2432, for the window.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.attractor.checks import ALL, RADII
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate, Method, Slope
from ..backend import Request
from ..option import Option
from .exponents import Fit
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, embed
from .neighbour_kernels import count_pairs
from .partings import BLOCKS, FEW, MOST
from .regions import Stretches, steady_stretches, whole_slope
from .spread import REFERENCES, variants, widened_dimension

__all__ = ["CorrelationDimension", "Counts", "correlation_counts", "fit_dimension", "pair_counts"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Stopped = Callable[[], bool]

#: States that are asked at the least, where not all are.
SOME = 300
#: Pairs that a count may look at, which decides between the two, and states that are asked how many it takes.
WORK, PILOT = 15_000_000, 50
#: Radii at which the curve is drawn in which the region is chosen.
FINE = 64
#: Pairs of states drawn for the range of the radii, and the share of pairs within the largest one.
PAIRS, WHOLE = 20_000, 0.1
#: The least radius of the curve, relative to the largest.
LEAST_RADIUS = 1e-5
#: States asked for the curve in which the region is chosen, where not all are.
FIRST = 1500
#: Neighbours that a state must have on average within the least radius of a region.
NEIGHBOURS = 2.0
#: Points of a region, factor by which its radii must span at the least, and by how much the slopes of its halves
#: may differ.
LEAST, SPAN, CHANGE = 6, 3.0, 0.15
#: Nats that the counts rise by within it at the least: those of repeated values do not rise for a while.
RISE = 0.5
#: Growth of the dimension with one more coordinate that is none.
GROWTH = 0.3


def pair_counts(states: Floats, radii: Floats, theiler: int) -> Ints:
    """Return how many pairs of states lie within each radius by the ∞-norm, exactly.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        In the order of time.
    radii : ndarray, shape (k,)
        Rising.
    theiler : int
        Pairs at most as many samples apart are left out.

    Returns
    -------
    ndarray, shape (k,)
        Every pair counts once.
    """
    found = correlation_counts(states, radii, theiler, references=len(states))
    assert found is not None
    total: Ints = found.counts.sum(axis=0)
    return total // 2


@dataclass(frozen=True, eq=False)
class Counts:
    """How many states lie within radii of reference states, by blocks of time.

    Parameters
    ----------
    radii : ndarray, shape (k,)
        Rising.
    counts : ndarray, shape (blocks, k)
        Ordered pairs.
    references : int
        How many states were asked.
    """

    radii: Floats
    counts: Ints
    references: int

    @property
    def values(self) -> Floats:
        """Logarithm of the counts, minus infinity where there is none."""
        with np.errstate(divide="ignore"):
            found: Floats = np.log(self.counts.sum(axis=0))
        return found

    def slope(self) -> tuple[float, float]:
        """Return the slope over all radii, and its standard deviation, see :func:`whole_slope`."""
        with np.errstate(divide="ignore"):
            left_out = np.log(self.counts.sum(axis=0) - self.counts)
        return whole_slope(np.log(self.radii), self.values, left_out)


def correlation_counts(
    states: Floats,
    radii: Floats,
    theiler: int,
    *,
    references: int = MOST,
    stopped: Stopped = bool,
) -> Counts | None:
    """Return how many states lie within radii of all states, or of some of them where that takes long.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        In the order of time.
    radii : ndarray, shape (k,)
        Rising.
    theiler : int
        Pairs at most as many samples apart are left out.
    references : int
        States asked at the most; up to 1500, and with as many as there are, all are.
    stopped : callable
        Asked between blocks of time.

    Returns
    -------
    Counts, optional
        None where it was stopped.
    """
    count = len(states)
    times = np.argsort(states[:, 0], kind="stable")
    ordered = states[times]
    places = np.empty(count, np.int64)
    places[times] = np.arange(count)

    def part(some: Ints) -> tuple[Ints, int]:
        shells, visits = count_pairs(ordered, times, places[some], theiler, radii)
        return np.cumsum(shells), visits

    asked = np.arange(count)
    if count > ALL and references < count:
        visits = part(np.linspace(0, count - 1, PILOT).astype(np.int64))[1]
        few = min(max(WORK * PILOT // max(visits, 1), SOME), references, count)
        asked = np.sort(np.random.default_rng(0).choice(count, few, replace=False))
    done = []
    for some in np.array_split(asked, min(BLOCKS, len(asked))):
        if stopped():
            return None
        done.append(part(some)[0])
    return Counts(radii, np.array(done), len(asked))


def drawn_radii(
    states: Floats, theiler: int, low: float | None, high: float | None
) -> Floats | None:
    """Return the radii of a curve that shows where the region is; None where no two states differ.

    Unless they are given, the largest has a tenth of all pairs within it, and the least is a hundred thousandth of it.
    """
    one, two = np.random.default_rng(0).integers(0, len(states), (2, PAIRS))
    far = np.abs(one - two) > theiler
    apart = np.abs(states[one[far]] - states[two[far]]).max(axis=1)
    apart = np.sort(apart[apart > 0])
    if not apart.size:
        return None
    most = high or max(float(apart[int(WHOLE * (apart.size - 1))]), (low or 0.0) * SPAN)
    least = low or most * LEAST_RADIUS
    radii: Floats = np.geomspace(least, most, FINE)
    radii[0], radii[-1] = least, most
    return radii


def fit_dimension(
    states: Floats,
    theiler: int,
    *,
    low: float | None = None,
    high: float | None = None,
    references: int = MOST,
    stopped: Stopped = bool,
) -> Fit | None:
    """Return the correlation dimension of `states`.

    The region is the widest plateau of the local slopes, of those in which the states have two neighbours on average
    at the least radius, and about a tenth of all pairs lies at the most within the largest one.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        In the order of time.
    theiler : int
        Pairs at most as many samples apart are left out.
    low, high : float, optional
        The region, radii; what is left open is chosen.
    references : int
        States asked at the most; up to 1500 all are.
    stopped : callable
        Asked now and then.

    Returns
    -------
    Fit, optional
        None where it was stopped.

    Raises
    ------
    InvalidData
        `low` and `high` are no region.
    """
    if low is not None and high is not None and not low < high:
        raise InvalidData(f"low must be < high = {high:g}, got {low:g}", field="low")
    spread = 0.0
    if low is None or high is None:
        radii = drawn_radii(states, theiler, low, high)
        if radii is None:
            return Fit(None, message=NONE.format("no two states differ"))
        few = min(FIRST, references)
        first = correlation_counts(states, radii, theiler, references=few, stopped=stopped)
        if first is None:
            return None
        begin, stretches = plateau(first, low is not None, high is not None)
        region = None if stretches is None else stretches.best
        if stretches is None or region is None:
            return Fit(None, message=NONE.format("the local slopes have no plateau"))
        low, high = float(radii[begin + region[0]]), float(radii[begin + region[1]])
        spread = stretches.spread
    counts = correlation_counts(
        states, np.geomspace(low, high, RADII), theiler, references=references, stopped=stopped
    )
    if counts is None:
        return None
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
    """Return the first radius with enough pairs, and the plateaus of the local slopes from there on.

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


def other_dimensions(
    problem: AttractorAnalysis, embedding: Embedding, stopped: Stopped
) -> list[float] | None:
    """Return the correlation dimensions in other embeddings that have a plateau; None if the run was stopped."""
    values = []
    for other in variants(embedding, len(problem.series)):
        states = problem.states(other.delay, other.dimension)
        radii = drawn_radii(states, other.theiler, None, None)
        if radii is None:
            continue
        counts = correlation_counts(
            states, radii, other.theiler, references=REFERENCES, stopped=stopped
        )
        if counts is None:
            return None
        stretches = plateau(counts, False, False)[1]
        if stretches is not None and stretches.best is not None:
            values.append(float(stretches.slopes[stretches.scores.argmax()]))
    return values


def slope_of_shares(
    states: Floats, theiler: int, low: float, high: float, stopped: Stopped = bool
) -> float | None:
    """Return the slope between the radii within which there are so large shares of all pairs.

    It compares embeddings without the choice of a region in each; None where it was stopped or has no value.
    """
    radii = drawn_radii(states, theiler, None, None)
    if radii is None:
        return None
    counts = correlation_counts(states, radii, theiler, references=FIRST, stopped=stopped)
    if counts is None:
        return None
    shares = counts.counts.sum(axis=0) / (counts.references * len(states))
    chosen = np.flatnonzero((shares >= low) & (shares <= high) & (shares > 0))
    if len(chosen) < 2:
        return None
    part = slice(chosen[0], chosen[-1] + 1)
    return float(np.polyfit(np.log(radii[part]), np.log(shares[part]), 1)[0])


NONE = "no correlation dimension: {}"


class CorrelationDimension(AttractorBackend):
    """Slope of the logarithm of the correlation sum over that of the radius, by the ∞-norm."""

    name = "correlation-dimension"
    summary = "correlation dimension from the number of pairs within radii (Grassberger and Procaccia 1983)"
    options: ClassVar[Mapping[str, Option]] = {
        **EMBEDDING,
        "low": Option(
            None, "radius at which the region begins, in the series' unit; chosen", lower=1e-300
        ),
        "high": Option(
            None, "radius at which the region ends, in the series' unit; chosen", lower=1e-300
        ),
        "references": Option(
            MOST, "states asked for neighbours at the most; up to 1500 all are", int, lower=FEW
        ),
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding | None:
        """Choose a region, read the slope, and see whether it grows with the dimension of the embedding."""
        options = request.options
        embedding = embed(problem, options)
        how: dict[str, Any] = {
            "low": options.get("low"),
            "high": options.get("high"),
            "references": options.get("references", MOST),
            "stopped": lambda: request.control.stopped,
        }
        states = problem.states(embedding.delay, embedding.dimension)
        found = fit_dimension(states, embedding.theiler, **how)
        if found is None:
            return None
        slope, message = found.slope, found.message
        statistics = dict(found.statistics)
        chosen = how["low"] is None and how["high"] is None
        room = len(problem.series) - embedding.dimension * embedding.delay > 2 * embedding.theiler
        if slope is not None and chosen and room:
            higher = slope_of_shares(
                problem.states(embedding.delay, embedding.dimension + 1),
                embedding.theiler,
                statistics["share of pairs at low"],
                statistics["share of pairs at high"],
                how["stopped"],
            )
            if request.control.stopped:
                return None
            if higher is not None:
                statistics["one dimension more"] = higher
                if higher > slope.value + GROWTH:
                    grows = f"it grows with the embedding, from {slope.value:.3g} to {higher:.3g}"
                    slope, message = None, NONE.format(grows)
        if slope is not None and chosen:
            others = other_dimensions(problem, embedding, how["stopped"])
            if others is None:
                return None
            slope = widened_dimension(slope, statistics["spread over regions"], others)
            statistics["other embeddings"] = len(others)
            statistics["least in other embeddings"] = min(others, default=slope.value)
            statistics["largest in other embeddings"] = max(others, default=slope.value)
        plan = AttractorEstimate(
            embedding.delay, embedding.dimension, embedding.theiler, correlation=slope
        )
        return Finding(plan, statistics, message)
