"""``c-c``, ``improved-c-c``, ``mutual-information`` and ``autocorrelation``: delays and embeddings.

Each reports the delays of both halves of the series as a measure of reliability. The C-C methods use curves of
correlation sums of disjoint subseries over the delay. Source: the paper of
:mod:`crosstrack.models.attractor.model`, equations 2-10. Equations 2-7 are the C-C method of H. S. Kim, R. Eykholt
and J. D. Salas, "Nonlinear dynamics, delay times, and embedding windows", Physica D 127, 1999. Equations 8-10 are
the paper's improvement.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.attractor.model import LEAST, AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ..contract.backend import Request
from ..contract.option import Option
from .embedding import decorrelation, first_minimum, longest
from .native import EMBEDDING, AttractorBackend, Finding, Poll, embed, poll_of, theiler_window

__all__ = [
    "Autocorrelation",
    "CorrelationIntegral",
    "Curves",
    "ImprovedCorrelationIntegral",
    "MutualInformation",
    "close_pairs",
    "correlation_sums",
    "curves",
    "halves",
    "longest_delay",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest dimension m of the sums, and the radii r_j in standard deviations of the series.
LARGEST, RADII = 5, (0.5, 1.0, 1.5, 2.0)
#: States of the largest dimension that a subseries must have.
_STATES = 10


@kernel
def close_pairs(series: Floats, step: int, radii: Floats, largest: int) -> Ints:
    """Return the number of pairs of states within each radius, shape (subseries, dimensions, radii).

    Each of `step` subseries takes every `step`-th sample, and consecutive samples are coordinates.
    Dimensions 1 … `largest` are counted, with the largest difference of a coordinate as the distance. A
    distance equal to a radius counts (theta(0) = 1 in equation 2); the radii ascend.
    """
    last = len(series)
    count = len(radii)
    close = np.zeros((step, largest, count), np.int64)
    for i in range(last):
        part = i % step
        for j in range(i + step, last, step):
            slot = 0
            for m in range(largest):
                if j + m * step >= last:
                    break
                apart = abs(series[i + m * step] - series[j + m * step])
                while slot < count and apart > radii[slot]:
                    slot += 1
                if slot == count:
                    break
                close[part, m, slot] += 1
    # A radius contains the pairs of all smaller radii.
    for part in range(step):
        for m in range(largest):
            for r in range(1, count):
                close[part, m, r] += close[part, m, r - 1]
    return close


def correlation_sums(series: Floats, delay: int) -> Floats:
    """Return C_s(m, r, t) of equation 2 for the t = `delay` subseries of equation 3, shape (t, 5, 4).

    Each subseries has INT(n / t) samples, so the last n modulo t samples are not used.
    """
    length = len(series) // delay
    radii = np.array(RADII) * float(series.std())
    states = length - np.arange(LARGEST)
    sums: Floats = (
        2.0 * close_pairs(series[: length * delay], delay, radii, LARGEST)
        / (states * (states - 1))[:, None]
    )  # fmt: skip
    return sums


@dataclass(frozen=True)
class Curves:
    """The curves over the delays 1, 2, ….

    `sums` is the mean correlation sum C(t), equations 8 and 9; `mean` the mean statistic S(t), equations 5
    and 7; `spread` the mean dispersion ΔS(t) between the radii, equations 6 and 7.
    """

    sums: Floats
    mean: Floats
    spread: Floats

    @property
    def combined(self) -> Floats:
        """S_cor(t) = ΔS(t) + |S(t)|, equation 7."""
        combined: Floats = self.spread + np.abs(self.mean)
        return combined

    @property
    def periodic(self) -> Floats:
        """S_c(t) = C(t) - S(t), equation 10.

        The sums of m coordinates cancel, so this is the mean of C_s(1, r, t)^m, which contains sums of a
        single coordinate only.
        """
        periodic: Floats = self.sums - self.mean
        return periodic


def longest_delay(count: int, most: int) -> int:
    """Return the longest delay up to `most` whose subseries hold ten states of the largest dimension."""
    return max(min(most, count // (_STATES + LARGEST - 1)), 1)


def curves(series: Floats, most: int, *, poll: Poll = bool) -> Curves:
    """Return the curves for the delays 1 … `most`; `poll` is called after each of them."""
    powers = np.arange(2, LARGEST + 1)[:, None]
    rows = []
    for t in range(1, most + 1):
        sums = correlation_sums(series, t)
        statistic = (sums[:, 1:] - sums[:, :1] ** powers).mean(axis=0)
        rows.append((sums[:, 1:].mean(), statistic.mean(), np.ptp(statistic, axis=1).mean()))
        poll()
    return Curves(*np.array(rows).T)


#: Minimum prominence of a peak, as a share of the curve's range.
_PEAK = 0.3
_DIMENSION: Mapping[str, Option] = {
    name: option for name, option in EMBEDDING.items() if name != "delay"
}


def halves(series: Floats) -> Mapping[str, Floats]:
    """Return the halves of a series that are long enough and not constant, by name."""
    middle = len(series) // 2
    parts = {"first half": series[:middle], "second half": series[middle:]}
    return {k: x for k, x in parts.items() if len(x) >= LEAST and np.ptp(x) > 1e-9 * x.std() > 0}


class DelayBackend(AttractorBackend):
    """Base of the backends that choose a delay only; the dimension is chosen by Cao's method."""

    options: ClassVar[Mapping[str, Option]] = _DIMENSION

    @abstractmethod
    def delay(self, series: Floats, options: Mapping[str, Any]) -> tuple[int, str]:
        """Return the delay in samples, and a remark for the user."""

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Return the embedding with the delay of this method."""
        delay, message = self.delay(problem.series, request.options)
        embedding = embed(problem, {**request.options, "delay": delay})
        half_delays = {
            f"delay of the {half}": self.delay(x, request.options)[0]
            for half, x in halves(problem.series).items()
        }
        return Finding(embedding.plan(), {"delay": delay, **half_delays}, message)


class MutualInformation(DelayBackend):
    """Backend for the first minimum of the mutual information (Fraser and Swinney 1986)."""

    name = "mutual-information"
    summary = "delay at the first minimum of the mutual information"

    def delay(self, series: Floats, options: Mapping[str, Any]) -> tuple[int, str]:
        """Return the first minimum, or the first zero of the autocorrelation if it is reached before."""
        delay, minimum = first_minimum(series)
        none = "the mutual information has no minimum before the first zero of the autocorrelation"
        return delay, "" if minimum else none


class Autocorrelation(DelayBackend):
    """Backend for the lag at which the autocorrelation has fallen to a level."""

    name = "autocorrelation"
    summary = "delay at which the autocorrelation has fallen to a level"
    options: ClassVar[Mapping[str, Option]] = {
        **_DIMENSION,
        "level": Option(math.exp(-1.0), "autocorrelation at the delay", lower=0, upper=0.99),
    }

    def delay(self, series: Floats, options: Mapping[str, Any]) -> tuple[int, str]:
        """Return the first lag with an autocorrelation of at most the level."""
        level = options["level"]
        delay = decorrelation(series, level)
        if delay < longest(len(series)):
            return delay, ""
        return delay, f"the autocorrelation stays above {level:g} for a tenth of the series"


class CorrelationIntegral(AttractorBackend):
    """Backend for the C-C method: delay and window from the dependence of coordinates, equations 2-7 and 11.

    The delay is the first local minimum of ΔS, or the first zero of S. The window is the global minimum of S_cor, and
    the dimension follows from it by equation 11.
    """

    name = "c-c"
    summary = "delay and dimension by the C-C method of correlation integrals"
    options: ClassVar[Mapping[str, Option]] = {
        "lags": Option(200, "longest delay tried, samples", int, lower=1, upper=10_000),
        "samples": Option(3000, "leading samples of the series used", int, lower=50, upper=20_000),
        "criterion": Option(
            "minimum",
            "delay at the first local minimum of ΔS or at the first zero of S",
            str,
            ("minimum", "zero"),
        ),
        "theiler": EMBEDDING["theiler"],
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Return the embedding from the curves of a leading part of the series."""
        series = np.ascontiguousarray(problem.series[: request.options["samples"]])
        if not np.ptp(series) > 0:
            series = problem.series
        delay, window, messages = self._chosen(series, request)
        figures: dict[str, Any] = {"delay": delay, "window": window, "samples": len(series)}
        for half, x in halves(series).items():
            figures[f"delay of the {half}"], figures[f"window of the {half}"], _ = self._chosen(
                x, request
            )
        # Equation 11: the window is (m - 1) delays.
        dimension = max(round(window / delay), 1) + 1
        theiler = request.options["theiler"]
        if theiler is None:
            theiler = theiler_window(problem.series, delay, dimension)
        return Finding(AttractorEstimate(delay, dimension, theiler), figures, "; ".join(messages))

    def _chosen(self, series: Floats, request: Request) -> tuple[int, int, list[str]]:
        """Return delay and window in samples, and messages about both."""
        most = longest_delay(len(series), request.options["lags"])
        result = curves(series / np.abs(series).max(), most, poll=poll_of(request))
        if request.options["criterion"] == "zero":
            delay, message = first_zero_crossing(result.mean)
        else:
            delay, message = first_local_minimum(result.spread)
        window, other = self.window(result, delay)
        return delay, window, [text for text in (message, other) if text]

    def window(self, result: Curves, delay: int) -> tuple[int, str]:
        """Return the window in samples, and a message about it."""
        return int(result.combined.argmin()) + 1, ""


class ImprovedCorrelationIntegral(CorrelationIntegral):
    """The paper's improved C-C method, equations 8-11: the window is at a peak of S_c.

    The paper does not state which peak. The first one that stands out by 30 % of the curve's range is taken, which
    is the mean orbital period on known systems. The first local maximum is often noise, and the global maximum is
    at a multiple of the period that depends on the longest delay tried.
    """

    name = "improved-c-c"
    summary = "delay and dimension by the paper's improved C-C method"

    def window(self, result: Curves, delay: int) -> tuple[int, str]:
        """Return the first prominent peak beyond the delay, or the window of the C-C method without one."""
        from scipy.signal import find_peaks

        prominence = _PEAK * float(np.ptp(result.periodic))
        peaks = find_peaks(result.periodic, prominence=prominence)[0] + 1
        peaks = peaks[peaks > delay]
        if peaks.size:
            return int(peaks[0]), ""
        return super().window(result, delay)[0], "no period stands out; the window is that of c-c"


def first_local_minimum(spread: Floats) -> tuple[int, str]:
    """Return the first delay with a local minimum of ΔS, and a message if the global minimum is used instead."""
    dips = np.flatnonzero((spread[1:-1] < spread[:-2]) & (spread[1:-1] <= spread[2:])) + 1
    if dips.size:
        return int(dips[0]) + 1, ""
    return int(spread.argmin()) + 1, "ΔS̄ has no local minimum; its least value is taken"


def first_zero_crossing(mean: Floats) -> tuple[int, str]:
    """Return the first delay at which S has reached 0, and a message if it never does."""
    crossed = np.flatnonzero(mean <= 0 if mean[0] > 0 else mean >= 0)
    if crossed.size:
        return int(crossed[0]) + 1, ""
    return int(np.abs(mean).argmin()) + 1, "S̄ has no zero; its least absolute value is taken"
