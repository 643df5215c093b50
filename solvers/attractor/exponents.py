"""``rosenstein`` and ``kantz``: the largest Lyapunov exponent from how neighbouring states part.

Sources: M. T. Rosenstein, J. J. Collins and C. J. De Luca, "A practical method for calculating largest
Lyapunov exponents from small data sets", Physica D 65 (1993) 117-134; H. Kantz, "A robust method to estimate
the maximal Lyapunov exponent of a time series", Physics Letters A 185 (1994) 77-87.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate, Method, Slope
from ..backend import Request
from ..option import Option
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, embed
from .partings import FEW, MOST, Curve, kantz_curve, kantz_radius, rosenstein_curve
from .regions import steadiest

__all__ = ["Fit", "Kantz", "Rosenstein", "fit_exponent", "mean_level", "scaling_region"]

Floats = NDArray[np.float64]

#: States asked for the curve in which the region is chosen, where not all are.
FIRST = 1000
#: Steps ahead at the most, and how many times as many states there must be.
STEPS, SHARE = 4096, 3
#: Nats that a region ends below where the curve levels off, and that neighbours part by within it at the least.
MARGIN, RISE = 1.25, 1.0
#: Points of a region at the least, and by how much the slopes of its halves may differ.
LEAST, CHANGE = 5, 0.25
#: Pairs of states drawn for the mean logarithm of all distances.
PAIRS = 4000


@dataclass(frozen=True)
class Fit:
    """A slope, or why there is none.

    Parameters
    ----------
    slope : Slope, optional
        The exponent, nats a second.
    statistics : mapping
        How it was found.
    message : str
        Why there is none.
    """

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
) -> tuple[int, int] | None:
    """Return the steps within which neighbours part exponentially, None where they do not.

    That is the longest stretch whose slope stays the same, of those that end :data:`MARGIN` nats below the level
    that the curve reaches and rise by :data:`RISE` nats. The slopes of its halves may differ by a quarter, and each
    stretch counts the less, the more they do.

    Parameters
    ----------
    curve : Curve
        How neighbours part.
    level : float
        Mean logarithm of the distance of states drawn at random.
    shortest : int
        Steps of a region at the least.
    earliest : int
        Step at which a region begins at the earliest.
    low, high : int, optional
        Where the region begins or ends, if that is given.
    """
    values = curve.values
    good = np.isfinite(values)
    if not good.any():
        return None
    values = values[: len(values) if good.all() else int(good.argmin())]
    level = min(level, float(values[len(values) // 2 :].mean())) if len(values) else level
    over = values > level - MARGIN
    end = int(over.argmax()) if over.any() else len(values)
    begin = earliest if low is None else low
    if high is not None:
        end = high + 1
    y = values[begin:end]
    if len(y) < LEAST:
        return None
    x = np.arange(len(y), dtype=float)
    found = steadiest(
        x, y, least=max(LEAST, shortest + 1), rise=RISE, change=CHANGE,
        from_first=low is not None, to_last=high is not None,
    )  # fmt: skip
    return None if found is None else (begin + found[0], begin + found[1])


def mean_level(states: Floats) -> float:
    """Return the mean logarithm of the distance of states drawn at random."""
    one, two = np.random.default_rng(0).integers(0, len(states), (2, PAIRS))
    squares = ((states[one] - states[two]) ** 2).sum(axis=1)
    squares = squares[squares > 0]
    return float(np.log(squares).mean()) / 2 if squares.size else -math.inf


def mean_turn(series: Floats) -> int:
    """Return the mean number of samples from one maximum to the next."""
    steps = np.diff(series)
    rises = steps[steps != 0] > 0
    maxima = int((rises[:-1] & ~rises[1:]).sum())
    return math.ceil(len(series) / max(maxima, 1))


def fit_exponent(
    states: Floats,
    embedding: Embedding,
    period: float,
    *,
    method: Method = Method.ROSENSTEIN,
    low: int | None = None,
    high: int | None = None,
    radius: float | None = None,
    references: int = MOST,
    stopped: Callable[[], bool] = bool,
) -> Fit | None:
    """Return the largest Lyapunov exponent of the motion among `states`.

    The region is chosen in a first curve, and the slope read from a second one: only states with a future of `high`
    steps take part in that.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        All states of the embedding, in the order of time.
    embedding : Embedding
        Of the states.
    period : float
        Seconds between samples.
    method : Method
        Rosenstein's or Kantz'.
    low, high : int, optional
        The region, steps ahead; what is left open is chosen.
    radius : float, optional
        Of Kantz' method; chosen by :func:`~.partings.kantz_radius`.
    references : int
        States asked for neighbours at the most; up to 1500 all are.
    stopped : callable
        Asked now and then.

    Returns
    -------
    Fit, optional
        None where it was stopped.

    Raises
    ------
    InvalidData
        `low` and `high` are no region, or reach beyond the states.
    """
    count, theiler = len(states), embedding.theiler
    if low is not None and high is not None and not low < high:
        raise InvalidData(f"low must be < high = {high}, got {low}", field="low")
    if max(low or 0, high or 0) > count - 2:
        raise InvalidData(
            f"the region must end before the last of {count} states, got {low} … {high} steps",
            field="high",
        )
    steps = max(min(STEPS, count // SHARE), high or 0, min((low or 0) + LEAST, count - 2))
    statistics: dict[str, Any] = {}
    draw: Callable[..., Curve | None] = rosenstein_curve
    if method is Method.KANTZ:
        radius = radius or kantz_radius(states, theiler, count - steps)
        if radius is None:
            return Fit(None, message=_NONE.format("states have too few neighbours for a radius"))
        draw = partial(kantz_curve, radius=radius)
    draw = partial(draw, states, theiler, stopped=stopped)
    if low is None or high is None:
        level = mean_level(states)
        if method is Method.KANTZ and math.log(radius or 1.0) > level - MARGIN:
            return Fit(None, message=_NONE.format("the nearest states are not near"))
        first = draw(count - steps, steps, references=min(FIRST, references))
        if first is None:
            return None
        # States that are nearest by selection part faster at first, for as long as a state spans, and distances swing
        # with each turn. A map has no such span.
        span = (embedding.dimension - 1) * embedding.delay
        shortest = max(span, mean_turn(states[:, 0]))
        earliest = span if embedding.delay > 1 else 0
        region = scaling_region(first, level, shortest, earliest, low, high)
        if region is None:
            return Fit(
                None,
                message=_NONE.format(
                    "there is no scaling region, neighbours do not part at a steady rate"
                ),
            )
        low, high = region
    curve = draw(count - high, high, references=references)
    if curve is None:
        return None
    value, deviation = curve.slope(low, high, period)
    if not math.isfinite(value):
        return Fit(None, message=_NONE.format("there are no neighbours to follow"))
    statistics = {
        "low": low,
        "high": high,
        "references": curve.references,
        "rise": float(curve.values[high] - curve.values[low]),
    }
    slope = Slope(method, value, deviation, float(low), float(high), radius)
    return Fit(slope, statistics)


_NONE = "no exponent: {}"


class Rosenstein(AttractorBackend):
    """Mean logarithm of the distance from the nearest neighbour, as time goes on."""

    name = "rosenstein"
    summary = "largest Lyapunov exponent from nearest neighbours (Rosenstein 1993)"
    method = Method.ROSENSTEIN
    options: ClassVar[Mapping[str, Option]] = {
        **EMBEDDING,
        "low": Option(None, "steps ahead at which the region begins; chosen", int, lower=0),
        "high": Option(None, "steps ahead at which the region ends; chosen", int, lower=1),
        "references": Option(
            MOST, "states asked for neighbours at the most; up to 1500 all are", int, lower=FEW
        ),
    }

    def embedding(self, problem: AttractorAnalysis, request: Request) -> Embedding:
        """Return the embedding for the curve of distances."""
        return embed(problem, request.options)

    def region(
        self, states: Floats, embedding: Embedding, request: Request
    ) -> tuple[int | None, int | None]:
        """Return the first and the last step of the region; None leaves the choice to :func:`scaling_region`."""
        return request.options["low"], request.options["high"]

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding | None:
        """Choose a region and read the slope."""
        options = request.options
        embedding = self.embedding(problem, request)
        states = problem.states(embedding.delay, embedding.dimension)
        low, high = self.region(states, embedding, request)
        found = fit_exponent(
            states,
            embedding,
            problem.period,
            method=self.method,
            low=low,
            high=high,
            radius=options.get("radius"),
            references=options.get("references", MOST),
            stopped=lambda: request.control.stopped,
        )
        if found is None:
            return None
        plan = AttractorEstimate(
            embedding.delay, embedding.dimension, embedding.theiler, exponent=found.slope
        )
        return Finding(plan, found.statistics, found.message)


class Kantz(Rosenstein):
    """Mean logarithm of the mean distance from all neighbours within a radius, as time goes on."""

    name = "kantz"
    summary = "largest Lyapunov exponent from all neighbours within a radius (Kantz 1994)"
    method = Method.KANTZ
    options: ClassVar[Mapping[str, Option]] = {
        **Rosenstein.options,
        "radius": Option(
            None, "within which states are neighbours, in the series' unit; chosen", lower=1e-300
        ),
    }
