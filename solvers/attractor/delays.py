"""``c-c``, ``improved-c-c``, ``mutual-information`` and ``autocorrelation``: delays, and what embedding follows.

Each says how far its delay can be trusted by the delays of both halves of the series.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import LEAST, AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ..backend import Request
from ..option import Option
from .c_c_curves import Curves, curves, longest_delay
from .information import decorrelation, first_zero, longest, minimum_of_information
from .native import EMBEDDING, AttractorBackend, Finding, embed

__all__ = [
    "Autocorrelation",
    "CorrelationIntegral",
    "ImprovedCorrelationIntegral",
    "MutualInformation",
    "halves",
]

Floats = NDArray[np.float64]

#: A peak counts as a period where it stands out by this share of the curve's range.
_PEAK = 0.3
_DIMENSION: Mapping[str, Option] = {name: one for name, one in EMBEDDING.items() if name != "delay"}


def halves(series: Floats) -> Mapping[str, Floats]:
    """Return the halves of a series that are long enough and not constant, by what they are called."""
    middle = len(series) // 2
    found = {"first half": series[:middle], "second half": series[middle:]}
    return {k: x for k, x in found.items() if len(x) >= LEAST and np.ptp(x) > 1e-9 * x.std() > 0}


class DelayBackend(AttractorBackend):
    """Base of those that only choose a delay; the dimension is Cao's."""

    options: ClassVar[Mapping[str, Option]] = _DIMENSION

    @abstractmethod
    def delay(self, series: Floats, options: Mapping[str, Any]) -> tuple[int, str]:
        """Return the delay, and what a person should know of it."""

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding | None:
        """Return the embedding with this delay."""
        delay, message = self.delay(problem.series, request.options)
        found = embed(problem, {**request.options, "delay": delay})
        own = {
            f"delay of the {half}": self.delay(x, request.options)[0]
            for half, x in halves(problem.series).items()
        }
        plan = AttractorEstimate(found.delay, found.dimension, found.theiler)
        return Finding(plan, {"delay": delay, **own}, message)


class MutualInformation(DelayBackend):
    """The first minimum of the mutual information (Fraser and Swinney 1986)."""

    name = "mutual-information"
    summary = "delay at the first minimum of the mutual information"

    def delay(self, series: Floats, options: Mapping[str, Any]) -> tuple[int, str]:
        """Return the first minimum, or the first zero of the autocorrelation where there is none before."""
        delay, minimum = minimum_of_information(series)
        none = "the mutual information has no minimum before the first zero of the autocorrelation"
        return delay, "" if minimum else none


class Autocorrelation(DelayBackend):
    """Where the autocorrelation has fallen to a level."""

    name = "autocorrelation"
    summary = "delay at which the autocorrelation has fallen to a level"
    options: ClassVar[Mapping[str, Option]] = {
        **_DIMENSION,
        "level": Option(1 / np.e, "autocorrelation at the delay", lower=0, upper=0.99),
    }

    def delay(self, series: Floats, options: Mapping[str, Any]) -> tuple[int, str]:
        """Return the first lag at which it is no larger."""
        level = options["level"]
        delay = decorrelation(series, level)
        if delay < longest(len(series)):
            return delay, ""
        return delay, f"the autocorrelation keeps above {level:g} for a tenth of the series"


class CorrelationIntegral(AttractorBackend):
    """The C-C method: delay and window from how dependent coordinates are (Kim, Eykholt and Salas 1999).

    The delay is the first local minimum of ΔS̄, the window the least value of S_cor, and the dimension so many that
    states span the window.
    """

    name = "c-c"
    summary = "delay and dimension by the C-C method of correlation integrals"
    improved = False
    options: ClassVar[Mapping[str, Option]] = {
        "lags": Option(200, "longest delay tried, samples", int, lower=1, upper=10_000),
        "samples": Option(3000, "leading samples of the series used", int, lower=50, upper=20_000),
        "theiler": EMBEDDING["theiler"],
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding | None:
        """Return the embedding from the curves of a leading stretch, whose delays thinning would change."""
        series = np.ascontiguousarray(problem.series[: request.options["samples"]])
        if not np.ptp(series) > 0:
            series = problem.series
        delay, window, messages = self._chosen(series, request)
        own: dict[str, Any] = {"delay": delay, "window": window, "samples": len(series)}
        for half, x in halves(series).items():
            if request.control.stopped:
                return None
            own[f"delay of the {half}"], own[f"window of the {half}"], _ = self._chosen(x, request)
        if request.control.stopped:
            return None
        dimension = max(round(window / delay), 1) + 1
        theiler = request.options["theiler"]
        if theiler is None:
            theiler = min(
                max((dimension - 1) * delay, first_zero(problem.series)), len(problem.series) // 10
            )
        return Finding(AttractorEstimate(delay, dimension, theiler), own, "; ".join(messages))

    def _chosen(self, series: Floats, request: Request) -> tuple[int, int, list[str]]:
        """Return delay and window, samples, and what a person should know of them."""
        found = curves(
            series / np.abs(series).max(),
            longest_delay(len(series), request.options["lags"]),
            improved=self.improved,
            stopped=lambda: request.control.stopped,
        )
        spread, messages = found.spread, []
        dips = np.flatnonzero((spread[1:-1] < spread[:-2]) & (spread[1:-1] <= spread[2:])) + 1
        delay = int(dips[0] if dips.size else spread.argmin()) + 1
        if not dips.size:
            messages.append("ΔS̄ has no local minimum; its least value is taken")
        window, message = self.window(found, delay)
        return delay, window, messages + [message] * bool(message)

    def window(self, found: Curves, delay: int) -> tuple[int, str]:
        """Return the window, and what a person should know of it."""
        return int(found.combined.argmin()) + 1, ""


class ImprovedCorrelationIntegral(CorrelationIntegral):
    """An improved C-C method, with smoother curves and the window at a mean period (Lu, Cai and Jiang 2007).

    ΔS̄ comes from the states of the whole series, and the window is the first peak of |S̄ - S̄ of the whole|, where the
    subseries are in step with the motion. Equations 2-12 of the paper are known by their name only: that they are
    this improvement, the one that is cited most, is assumed; and the peak must stand out by 30 % of the range.
    """

    name = "improved-c-c"
    summary = "delay and dimension by an improved C-C method (Lu, Cai and Jiang 2007)"
    improved = True

    def window(self, found: Curves, delay: int) -> tuple[int, str]:
        """Return the first peak beyond the delay, or the window of the C-C method where there is none."""
        from scipy.signal import find_peaks

        assert found.whole is not None
        apart = np.abs(found.mean - found.whole)
        peaks = find_peaks(apart, prominence=_PEAK * float(np.ptp(apart)))[0] + 1
        peaks = peaks[peaks > delay]
        if peaks.size:
            return int(peaks[0]), ""
        return super().window(found, delay)[0], "no period stands out; the window is that of c-c"
