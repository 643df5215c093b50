"""``g-p`` and ``small-data-sets``: correlation dimension and exponent as the paper prints them.

Source: the paper of :mod:`crosstrack.models.attractor.model`, equations 13-17 and Figures 3-5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.checks import RADII
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate, Method, Slope
from ..contract.backend import Request
from ..contract.option import Option
from .correlation import Counts, correlation_counts
from .delays import ImprovedCorrelationIntegral
from .embedding import LARGEST, decorrelation, largest_dimension, mean_period
from .exponents import FIRST, LEAST, SHARE, STEPS, Rosenstein, mean_level
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, Poll, embed, poll_of, run_stage
from .partings import rosenstein_curve

__all__ = ["GrassbergerProcaccia", "SmallDataSets"]

Floats = NDArray[np.float64]

#: Share of the standard deviation at r_1, and the ratio C(r_1) / C(r_2), equation 17.
_SHARE, _RATIO = 0.25, 5.0
#: Radii among which r_2 is chosen, and the smallest one relative to r_1.
_FINE, _SPAN = 512, 1e-3
#: Level of the autocorrelation at the delay (Rosenstein, Collins and De Luca 1993).
_LEVEL = 1.0 - 1.0 / math.e


def all_pairs(states: Floats, radii: Floats, poll: Poll) -> Counts:
    """Return the counts of equation 15: all ordered pairs closer than each radius, and each state with itself.

    States are in the order of time, and radii ascend.
    """
    # theta(0) = 0 in equation 16, and a distance equal to the radius counts in the kernel.
    counts = correlation_counts(states, np.nextafter(radii, 0.0), 0, poll=poll)
    blocks = np.array_split(np.arange(counts.references), len(counts.counts))
    sizes = np.array([len(block) for block in blocks])[:, None]
    return Counts(radii, counts.counts + sizes, counts.references)


def slope_of(states: Floats, size: float, method: Method, poll: Poll) -> Slope | str:
    """Return the slope of ln C over ln r between the radii r_2 and r_1 of equation 17.

    `size` is the standard deviation of the series. The method is TWO_POINTS for equation 17, or LINE for a
    line through 16 radii as in Figure 4. The result is a text if there is no slope.
    """
    largest = _SHARE * size
    radii = np.geomspace(_SPAN * largest, largest, _FINE)
    counts = all_pairs(states, radii, poll)
    total = counts.counts.sum(axis=0)
    if total[-1] < _RATIO * total[0]:
        return "no radius has a fifth of the pairs within a quarter of the standard deviation"
    smallest = float(radii[np.abs(np.log(total[-1] / total / _RATIO)).argmin()])
    points = RADII if method is Method.LINE else 2
    counts = all_pairs(states, np.geomspace(smallest, largest, points), poll)
    return Slope(method, *counts.slope(), smallest, largest)


class GrassbergerProcaccia(AttractorBackend):
    """The paper's G-P algorithm: the largest slope over the dimensions 2 … 10 is the correlation dimension.

    Equation 15 counts each state as a neighbour of itself and excludes no states that are near in time, unlike
    ``correlation-dimension``. Both make the slopes of a short series too small.
    """

    name = "g-p"
    summary = "correlation dimension by the paper's G-P algorithm (equations 15-17)"
    options: ClassVar[Mapping[str, Option]] = {
        "delay": Option(None, "samples between coordinates; by improved-c-c", int, lower=1),
        "largest": Option(LARGEST, "largest dimension tried", int, lower=2, upper=30),
        "fit": Option(
            "two-points",
            "slope between two radii (equation 17) or of a line through 16 radii (Figure 4)",
            str,
            ("two-points", "line"),
        ),
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Return the slope for the dimension at which it is largest."""
        options = request.options
        delay = options["delay"]
        if delay is None:
            delay = run_stage(ImprovedCorrelationIntegral(), problem, request).point.delay
        most = max(largest_dimension(len(problem.series), delay, options["largest"]), 2)
        figures: dict[str, Any] = {}
        best, dimension, message = None, 2, ""
        for m in range(2, most + 1):
            states = problem.states(delay, m)
            slope = slope_of(states, problem.deviation, Method(options["fit"]), poll_of(request))
            if isinstance(slope, str):
                message = f"no slope from dimension {m} on: {slope}"
                break
            figures[f"slope, dimension {m}"] = slope.value
            if best is None or slope.value > best.value:
                best, dimension = slope, m
        return Finding(AttractorEstimate(delay, dimension, 0, correlation=best), figures, message)


class SmallDataSets(Rosenstein):
    """The paper's five steps for the exponent: the method of ``rosenstein`` in the paper's embedding.

    The delay is the lag at which the autocorrelation, computed by FFT, has fallen to 1 - 1/e. Neighbours are more than
    the mean period of the power spectrum apart. The dimension is the smallest m >= 2 d + 1 with d of ``g-p``.

    The paper fits a straight line and does not state where. It is fitted from step 0 to the step at which the curve has
    covered half of its rise, straight or not, so that every series has an exponent, noise included.
    """

    name = "small-data-sets"
    summary = "largest Lyapunov exponent by the paper's five steps (equations 13-14)"

    def embeddings(self, problem: AttractorAnalysis, request: Request) -> list[Embedding]:
        """Return the embedding of steps 1 and 2; options override its parts."""
        chosen = {name: request.options[name] for name in EMBEDDING}
        if chosen["delay"] is None:
            chosen["delay"] = decorrelation(problem.series, _LEVEL)
        if chosen["theiler"] is None:
            most = len(problem.series) // 10
            chosen["theiler"] = min(math.ceil(mean_period(problem.series)), most)
        if chosen["dimension"] is None:
            options = {"delay": chosen["delay"]}
            answer = request.within(GrassbergerProcaccia(), problem, options=options)
            # Without a slope the dimension is Cao's, as in the other backends.
            if answer.point is not None and answer.point.correlation is not None:
                chosen["dimension"] = math.ceil(2.0 * answer.point.correlation.value + 1.0)
        return [embed(problem, chosen)]

    def region(
        self, states: Floats, embedding: Embedding, request: Request
    ) -> tuple[int | None, int | None]:
        """Return the region up to half of the rise; options override its ends."""
        low, high = super().region(states, embedding, request)
        low = low or 0
        steps = min(STEPS, len(states) // SHARE)
        if high is None and steps > low:
            curve = rosenstein_curve(
                states, embedding.theiler, len(states) - steps, steps, references=FIRST,
                poll=poll_of(request),
            )  # fmt: skip
            if np.isfinite(curve.values).all():
                values = curve.values
                level = min(mean_level(states), float(values[steps // 2 :].mean()))
                reached = values >= (values[low] + level) / 2.0
                high = max(int(reached.argmax()), low + LEAST - 1)
        return low, high
