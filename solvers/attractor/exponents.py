"""``rosenstein`` and ``kantz``: the largest Lyapunov exponent from the divergence of neighbouring states.

Sources: M. T. Rosenstein, J. J. Collins and C. J. De Luca, "A practical method for calculating largest
Lyapunov exponents from small data sets", Physica D 65 (1993) 117-134; H. Kantz, "A robust method to estimate
the maximal Lyapunov exponent of a time series", Physics Letters A 185 (1994) 77-87.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.attractor.judgement import PARTINGS
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import Method, Slope
from ..contract.backend import Request
from ..contract.option import Option
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, Poll, embed, poll_of
from .partings import FEW, MOST, Curve, kantz_curve, kantz_radius, rosenstein_curve
from .prediction import ROBUST, choose_embeddings, noise_level
from .regions import (
    FLOW_ERROR,
    MAP_ERROR,
    NOISE_ERROR,
    RADIUS,
    REFERENCES,
    TURN,
    UNCONFIRMED_EXPONENT,
    Stretches,
    describe_variants,
    steady_stretches,
    variants,
    widened,
)

__all__ = ["Fit", "Kantz", "Rosenstein", "Search", "fit_exponent", "mean_level", "scaling_region"]

Floats = NDArray[np.float64]

#: Largest number of reference states for the curve that determines the region.
FIRST = 1000
#: Largest number of steps ahead, and smallest ratio of states to steps.
STEPS, SHARE = 4096, 3
#: Distance in nats between the end of a region and the level of the curve, and smallest divergence within it.
MARGIN, RISE = 1.25, 1.0
#: Smallest number of points of a region, and largest relative difference of the slopes of its halves.
LEAST, CHANGE = 5, 0.25
#: The same for series that are not linear noise and have no such region: distance, divergence, points and difference.
WIDE, WIDEST = (1.0, 0.7, 3, 0.5), (1.0, 0.7, 3, 0.7)
#: Random pairs of states for the mean logarithm of all distances.
PAIRS = 4000
#: Option of the methods that follow or count neighbours.
REFERENCE_STATES = Option(
    MOST, "largest number of reference states; up to 1500 states all are", int, lower=FEW
)


@dataclass(frozen=True)
class Fit:
    """Fitted slope with its statistics, or the reason for a missing slope."""

    slope: Slope | None
    statistics: Mapping[str, Any] = field(default_factory=dict)
    message: str = ""


def scaling_region(
    curve: Curve,
    level: float,
    shortest: int,
    earliest: int = 0,
    low: int | None = None,
    high: int | None = None,
    limits: tuple[float, float, int, float] = (MARGIN, RISE, LEAST, CHANGE),
) -> tuple[int, Stretches] | None:
    """Return the first step of the search, and the stretches of exponential divergence from there on.

    The best is the longest stretch with a steady slope that ends :data:`MARGIN` nats below the level of the
    curve and rises by at least :data:`RISE` nats. The slopes of its halves may differ by a quarter; a
    larger difference lowers the score of a stretch. `level` is the mean logarithm of the distance between
    random states. A stretch has at least `shortest` steps and begins at `earliest` or later; `low` and
    `high` fix its ends. `limits` replace these constants. None if the curve is too short.
    """
    margin, rise, fewest, change = limits
    values = curve.values
    is_finite = np.isfinite(values)
    if not is_finite.any():
        return None
    values = values[: len(values) if is_finite.all() else int(is_finite.argmin())]
    level = min(level, float(values[len(values) // 2 :].mean())) if len(values) else level
    above = values > level - margin
    end = int(above.argmax()) if above.any() else len(values)
    begin = earliest if low is None else low
    if high is not None:
        end = high + 1
    y = values[begin:end]
    if len(y) < fewest:
        return None
    x = np.arange(len(y), dtype=float)
    stretches = steady_stretches(
        x, y, least=max(fewest, shortest + 1), rise=rise, change=change,
        from_first=low is not None, to_last=high is not None,
    )  # fmt: skip
    return begin, stretches


def mean_level(states: Floats) -> float:
    """Return the mean logarithm of the distance between random states."""
    first, second = np.random.default_rng(0).integers(0, len(states), (2, PAIRS))
    squares = ((states[first] - states[second]) ** 2).sum(axis=1)
    squares = squares[squares > 0]
    return float(np.log(squares).mean()) / 2 if squares.size else -math.inf


def mean_turn(series: Floats) -> int:
    """Return the mean number of samples between maxima."""
    steps = np.diff(series)
    rises = steps[steps != 0] > 0
    maxima = int((rises[:-1] & ~rises[1:]).sum())
    return math.ceil(len(series) / max(maxima, 1))


@dataclass(frozen=True)
class Search:
    """Search for an exponent among the states of an embedding, in the order of time.

    `low` and `high` are the first and last step of the region; None leaves the choice to
    :func:`scaling_region`. The default radius of Kantz' method is :func:`~.partings.kantz_radius`. Up to
    1500 states, all are references, otherwise at most `references`.
    """

    states: Floats
    embedding: Embedding
    method: Method = Method.ROSENSTEIN
    low: int | None = None
    high: int | None = None
    radius: float | None = None
    references: int = MOST
    poll: Poll = bool
    wide: bool = False

    @property
    def steps(self) -> int:
        """Length of the curve that shows the region, in steps ahead."""
        count, low = len(self.states), self.low or 0
        return max(min(STEPS, count // SHARE), self.high or 0, min(low + LEAST, count - 2))

    def with_radius(self) -> Search | None:
        """Return the search with a radius if the method needs one; None if states have too few neighbours."""
        if self.method is not Method.KANTZ or self.radius is not None:
            return self
        last = len(self.states) - self.steps
        radius = kantz_radius(self.states, self.embedding.theiler, last)
        return None if radius is None else replace(self, radius=radius)

    def curve(self, high: int, references: int) -> Curve:
        """Return the curve up to `high` steps."""
        last, theiler = len(self.states) - high, self.embedding.theiler
        draw: Callable[..., Curve] = rosenstein_curve
        if self.radius is not None:
            draw = partial(kantz_curve, radius=self.radius)
        return draw(self.states, theiler, last, high, references=references, poll=self.poll)

    def region(self, references: int) -> tuple[int, Stretches] | str:
        """Return the acceptable regions, or the reason for their absence."""
        level = mean_level(self.states)
        if self.method is Method.KANTZ and math.log(self.radius or 1.0) > level - MARGIN:
            return "the nearest states are not near"
        first = self.curve(self.steps, min(references, self.references))
        # Nearest states diverge faster at first, for as long as a state spans, and distances oscillate
        # with each turn. A map has no such span.
        span = (self.embedding.dimension - 1) * self.embedding.delay
        shortest = max(span, mean_turn(self.states[:, 0]))
        earliest = span if self.embedding.delay > 1 else 0
        turn = mean_turn(self.states[:, 0])
        half, quarter = (turn // 2, turn // 4) if turn >= TURN else (2, 0)
        choices = [(shortest, earliest, (MARGIN, RISE, LEAST, CHANGE))]
        if self.wide:
            choices += [(max(shortest, turn) if turn >= TURN else 2, earliest, WIDE)]
            choices += [(half, quarter, WIDEST)]
        for least, begin, limits in choices:
            result = scaling_region(first, level, least, begin, self.low, self.high, limits)
            if result is not None and result[1].best is not None:
                return result
        return "there is no scaling region, neighbours do not part at a steady rate"

    def steadiest(self) -> float:
        """Return the slope of the best region per step, NaN without one."""
        ready = self.with_radius()
        result = "no radius" if ready is None else ready.region(REFERENCES)
        return math.nan if isinstance(result, str) else result[1].best_slope


def fit_exponent(search: Search, period: float) -> Fit:
    """Return the largest Lyapunov exponent of the motion among states.

    The region is chosen from a first curve. The slope is computed from a second curve, which needs states
    with a future of `high` steps. If the region is chosen, the deviation includes the spread over
    acceptable regions. Raise InvalidData if the given region is empty or exceeds the states.
    """
    count, low, high = len(search.states), search.low, search.high
    if low is not None and high is not None and not low < high:
        raise InvalidData(f"low must be < high = {high}, got {low}", field="low")
    if max(low or 0, high or 0) > count - 2:
        raise InvalidData(
            f"the region must end before the last of {count} states, got {low} … {high} steps",
            field="high",
        )
    ready, spread = search.with_radius(), 0.0
    if ready is None:
        return Fit(None, message=_NONE.format("states have too few neighbours for a radius"))
    if low is None or high is None:
        result = ready.region(FIRST)
        if isinstance(result, str):
            return Fit(None, message=_NONE.format(result))
        begin, stretches = result
        assert stretches.best is not None
        low, high = (begin + place for place in stretches.best)
        spread = stretches.spread / period
    curve = ready.curve(high, ready.references)
    value, deviation = curve.slope(low, high, period)
    if not math.isfinite(value):
        return Fit(None, message=_NONE.format("there are no neighbours to follow"))
    statistics = {
        "low": low,
        "high": high,
        "references": curve.references,
        "rise": float(curve.values[high] - curve.values[low]),
        "deviation of the fit": deviation,
        "spread over regions": spread,
    }
    slope = Slope(ready.method, value, deviation, float(low), float(high), ready.radius)
    return Fit(slope, statistics)


def agreed(searches: list[Search]) -> Search:
    """Return the search whose slope agrees with the median of all slopes; or the first one without slopes.

    It is the first one within a robust deviation or 5 % of the median.
    """
    slopes = [search.steadiest() for search in searches]
    known = [slope for slope in slopes if math.isfinite(slope)]
    if len(searches) == 1 or not known:
        return searches[0]
    middle = float(np.median(known))
    spread = ROBUST * float(np.median(np.abs(np.array(known) - middle)))
    within = max(spread, 0.05 * abs(middle)) * (1.0 + 1e-9)
    good = [abs(slope - middle) <= within for slope in slopes]
    return searches[good.index(True) if True in good else slopes.index(known[0])]


def widen_exponent(
    fit: Fit, search: Search, others: list[Search], problem: AttractorAnalysis
) -> Fit:
    """Return the fit with a deviation that includes regions, other choices and the calibrated error.

    The other choices are embeddings, and for Kantz' method nearest neighbours and half the radius. Those without
    a scaling region are left out.
    """
    assert fit.slope is not None
    searches = list(others)
    if search.method is Method.KANTZ:
        searches.append(replace(search, method=Method.ROSENSTEIN, radius=None))
        if search.radius is not None:
            searches.append(replace(search, radius=search.radius / 2))
    values, change = [], 0.0
    for candidate in searches:
        value = candidate.steadiest() / problem.period
        if candidate.radius is None:
            values += [value] * math.isfinite(value)
        elif math.isfinite(value):
            # The exponent is the limit of small distances. Without chaos the slope falls with the radius.
            change = value - fit.slope.value
    duration = len(problem.series) * problem.period
    noise = noise_level(search.states, search.embedding.theiler)
    is_flow = mean_turn(problem.series) >= TURN and fit.slope.radius is None
    slope = widened(
        fit.slope, fit.statistics["spread over regions"], values,
        relative=math.hypot(FLOW_ERROR if is_flow else MAP_ERROR, NOISE_ERROR * math.sqrt(noise)),
        unconfirmed=UNCONFIRMED_EXPONENT, absolute=math.hypot(PARTINGS / duration, RADIUS * change),
    )  # fmt: skip
    statistics = {**fit.statistics, **describe_variants(slope, values), "relative noise": noise}
    return replace(fit, slope=slope, statistics=statistics)


_NONE = "no exponent: {}"


class Rosenstein(AttractorBackend):
    """Backend for the mean log distance from the nearest neighbour over time."""

    name = "rosenstein"
    summary = "largest Lyapunov exponent from nearest neighbours (Rosenstein 1993)"
    method = Method.ROSENSTEIN
    options: ClassVar[Mapping[str, Option]] = {
        **EMBEDDING,
        "low": Option(
            None, "steps ahead at which the region begins; by default from the curve", int, lower=0
        ),
        "high": Option(
            None, "steps ahead at which the region ends; by default from the curve", int, lower=1
        ),
        "references": REFERENCE_STATES,
    }

    #: Whether wider limits of a region apply: only for series that are not linear noise.
    wide: bool = False
    #: Embeddings that replace those of the options.
    choice: list[Embedding] | None = None

    def __init__(self, wide: bool = False, choice: list[Embedding] | None = None) -> None:
        # An instance with attributes of its own would not share the process with hidden data.
        if wide or choice is not None:
            self.wide, self.choice = wide, choice

    def embeddings(self, problem: AttractorAnalysis, request: Request) -> list[Embedding]:
        """Return the embeddings whose slopes are compared."""
        options = request.options
        if None not in (options["low"], options["high"]):
            return [embed(problem, options)]
        return self.choice or choose_embeddings(problem, options, poll_of(request))[0]

    def region(
        self, states: Floats, embedding: Embedding, request: Request
    ) -> tuple[int | None, int | None]:
        """Return the first and the last step of the region; None leaves the choice to :func:`scaling_region`."""
        return request.options["low"], request.options["high"]

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Choose a region and compute the slope."""
        count = len(problem.series)
        embeddings = self.embeddings(problem, request)
        searches = [self._search(problem, embedding, request) for embedding in embeddings]
        search = agreed(searches)
        embedding = search.embedding
        fit = fit_exponent(search, problem.period)
        if fit.slope is not None and (search.low is None or search.high is None):
            others = [other for other in searches if other is not search]
            if not others:
                others = [self._search(problem, e, request) for e in variants(embedding, count)]
            others = [replace(other, low=None, high=None, radius=None) for other in others]
            open_search = replace(search, low=None, high=None, radius=fit.slope.radius)
            fit = widen_exponent(fit, open_search, others, problem)
        return Finding(embedding.plan(exponent=fit.slope), fit.statistics, fit.message)

    def _search(self, problem: AttractorAnalysis, embedding: Embedding, request: Request) -> Search:
        options, states = request.options, problem.states(embedding.delay, embedding.dimension)
        low, high = self.region(states, embedding, request)
        return Search(
            states, embedding, self.method, low, high, options.get("radius"),
            options.get("references", MOST), poll_of(request), self.wide,
        )  # fmt: skip


class Kantz(Rosenstein):
    """Backend for the log of the mean distance from all neighbours within a radius over time."""

    name = "kantz"
    summary = "largest Lyapunov exponent from all neighbours within a radius (Kantz 1994)"
    method = Method.KANTZ
    options: ClassVar[Mapping[str, Option]] = {
        **Rosenstein.options,
        "radius": Option(
            None,
            "radius within which states are neighbours, in the unit of the series; by default from the states",
            lower=1e-300,
        ),
    }
